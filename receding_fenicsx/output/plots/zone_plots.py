"""Zone maps as figures (the paper's Figs. 5, 7 and 9)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import Array
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.series import NEGLIGIBLE_SLIP, Still, leg_ends
from receding_fenicsx.output.plots.units import Scales, describe_leg, scales_of
from receding_fenicsx.output.plots.zone_labels import place_labels
from receding_fenicsx.output.plots.zone_map import FLICKER, ZoneMap, zone_map

PANEL_HEIGHT = 1.85
"""Inches from the bottom to the top of a panel's axes, or a little less."""
AXES_WIDTH = 2.95
"""Inches from the left to the right of the axes, or a little less."""
JUMP = 0.25
"""Part of a leg between two neighbouring nodes' instants across which no line is drawn."""
TURNING = 0.005
"""Part of a leg within which its end is taken for the turning point."""
DASHED: dict[str, Any] = {"color": "black", "dashes": (3, 1.5), "lw": 1.0}


def zone_maps(
    record: Record,
    legs: int | list[tuple[int, int]],
    scales: Scales | None = None,
    still: Still | None = None,
    columns: int = 1,
) -> Figure:
    """Map the zones along legs.

    Args:
        record: the record; it must hold samples of the legs.
        legs: (cycle, leg), a panel each; or a cycle, for all its legs.
        scales: units; the record's own when left out.
        still: nodes that reach the friction limit without slipping, for a dashed line.
        columns: panels beside each other at most; with more than one the figure is as wide as a
            page, and every cycle begins a row.

    Returns:
        The figure; only x >= 0 is shown where the contact is symmetric.

    Raises:
        InputError: the record has no samples of a leg.
    """
    scales = scales or scales_of(record)
    legs = selection.legs(record, legs)
    stuck = None if still is None else still.stuck
    with mpl.rc_context(style.RC):
        places = _places(legs, columns)
        rows = places[-1][0] + 1
        width = style.COLUMN if columns == 1 else style.PAGE
        figure = style.new_figure(width, 0.9 + (PANEL_HEIGHT + 0.25) * rows)
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for place in set(np.ndindex(grid.shape)) - set(places):
            grid[place].set_axis_off()
        shown: set[int] = set()
        dashed = False
        for n, ((row, column), (cycle, leg)) in enumerate(zip(places, legs, strict=True)):
            axes = grid[row, column]
            drawn = zone_map(record, cycle, leg, stuck, FLICKER)
            shown |= {int(state) for state, _ in drawn.pieces}
            axes.set_title(
                style.panel_title(n, len(legs), describe_leg(record, cycle, leg, scales))
            )
            begin, end, label = load_axis(record, cycle, leg, scales)
            inches = (AXES_WIDTH - style.COLUMN + width) / columns
            _draw_map(axes, drawn, (begin, end), scales, inches)
            if column == 0 or label != load_axis(record, *legs[n - 1], scales)[2]:
                axes.set_ylabel(label)
            if still is not None:
                dashed |= _draw_limit(axes, record, still, leg, (begin, end), scales)
            if (row + 1, column) not in places:
                axes.set_xlabel(scales.x_label)
                axes.tick_params(labelbottom=True)
        handles: list[Line2D] = []
        if still is not None and dashed:
            text = "reaches the friction limit, does not slip"
            if not still.strict:
                text = (
                    f"reaches the friction limit, slips < {_power(NEGLIGIBLE_SLIP)} of the largest"
                )
            handles = [Line2D([], [], label=text, **DASHED)]
            figure.legend(handles=handles, loc="outside upper center")
        figure.legend(
            handles=style.state_patches(shown, bool(np.any(record.f > 0.0))),
            loc="outside lower center",
            ncols=2 if columns == 1 else 4,
            columnspacing=1.4,
        )
    return figure


def _places(legs: list[tuple[int, int]], columns: int) -> list[tuple[int, int]]:
    """Row and column of each leg's panel."""
    places = [(0, 0)]
    for (before, _), (cycle, _) in pairwise(legs):
        row, column = places[-1]
        full = column + 1 == columns or (columns > 1 and cycle != before)
        places.append((row + 1, 0) if full else (row, column + 1))
    return places


def load_axis(record: Record, cycle: int, leg: int, scales: Scales) -> tuple[float, float, str]:
    """Return what stands vertically in a zone map: its value at the ends of the leg, its label.

    It is the load over its largest value where one load alone changes, else the part s of the leg.
    """
    begin, end = (load / scales.load_max for load in leg_ends(record, cycle, leg))
    changing = np.flatnonzero(begin != end)
    if len(changing) != 1:
        return 0.0, 1.0, "part $s$ of the leg"
    k = int(changing[0])
    return float(begin[k]), float(end[k]), scales.load_label(record.load_names[k])


def _draw_map(
    axes: Axes, drawn: ZoneMap, ends: tuple[float, float], scales: Scales, inches: float
) -> None:
    """Draw zones, their ends and the states' numbers; the axes are so many inches wide."""
    begin, end = ends

    def place(points: Array) -> Array:
        return points * [1.0 / scales.length, end - begin] + [0.0, begin]

    colours = [style.STATE_COLOURS[state] for state, _ in drawn.pieces]
    # the hairline of the same colour closes the seams that antialiasing leaves
    axes.add_collection(
        PolyCollection(
            [place(polygon) for _, polygon in drawn.pieces],
            facecolors=colours,
            edgecolors=colours,
            linewidths=0.4,
        )
    )
    axes.add_collection(
        LineCollection(
            list(place(drawn.boundaries)), colors="black", linewidths=0.6, capstyle="round"
        )
    )
    low, high = drawn.x[0], drawn.x[-1]
    if scales.symmetric and low < 0.0:
        low = 0.0
    left = scales.ends(drawn.x)[0] if scales.axisymmetric else low / scales.length
    axes.set_xlim(left, high / scales.length)
    axes.set_ylim(min(ends), max(ends))
    style.ticks(axes.xaxis, 5)
    axes.set_axisbelow(False)
    for label in place_labels(drawn, (low, high), (inches, PANEL_HEIGHT)):
        at = _pair(place(np.array(label.at)))
        ink = style.STATE_INKS[label.on]
        text = str(int(label.state))
        if label.tip is None:
            axes.text(*at, text, ha="center", va="center", color=ink)
            continue
        arrow = {"arrowstyle": "-|>,head_length=0.3,head_width=0.12", "lw": 0.6, "color": ink}
        axes.annotate(
            text,
            _pair(place(np.array(label.tip))),
            xytext=at,
            ha="center",
            va="center",
            color=ink,
            arrowprops={**arrow, "shrinkA": 1.0, "shrinkB": 0.0},
        )


def _draw_limit(
    axes: Axes,
    record: Record,
    still: Still,
    leg: int,
    ends: tuple[float, float],
    scales: Scales,
) -> bool:
    """Draw where nodes reach the limit without slipping; return whether any do on this leg."""
    # what happens at the turning point itself would lie on the frame
    here = (still.leg == leg) & (still.s > TURNING) & (still.s < 1.0 - TURNING)
    node, s = still.node[here], still.s[here]
    if scales.symmetric and record.x[0] < 0.0:
        right = record.x[node] >= 0.0
        node, s = node[right], s[right]
    cuts = np.flatnonzero((np.diff(node) > 1) | (np.abs(np.diff(s)) > JUMP)) + 1
    for nodes, part in zip(np.split(node, cuts), np.split(s, cuts), strict=True):
        if len(nodes) > 1:
            y = ends[0] + part * (ends[1] - ends[0])
            axes.plot(record.x[nodes] / scales.length, y, **DASHED)
    return len(node) > 1


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _power(value: float) -> str:
    return f"$10^{{{round(np.log10(value))}}}$"
