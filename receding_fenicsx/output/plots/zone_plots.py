"""Figures of zone maps (Figs. 5, 7 and 9 of the paper)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.series import NEGLIGIBLE_SLIP, Still, leg_ends
from receding_fenicsx.output.plots.units import Scales, describe_leg, scales_of
from receding_fenicsx.output.plots.zone_labels import place_labels
from receding_fenicsx.output.plots.zone_map import FLICKER, ZoneMap, zone_map

PANEL_HEIGHT = 1.85
"""Approximate height of a panel's axes in inches."""
AXES_WIDTH = 2.95
"""Approximate width in inches of the axes of a figure with one column."""
MAX_LINE_STEP = 0.25
"""Largest part of a leg between the instants of two neighbouring nodes on one dashed line."""
TURNING_POINT = 0.005
"""Part of a leg next to its ends that belongs to the turning points."""
DASHED: dict[str, Any] = {"color": "black", "dashes": (3, 1.5), "lw": 1.0}


def zone_maps(
    record: Record,
    legs: int | list[tuple[int, int]],
    scales: Scales | None = None,
    still: Still | None = None,
    columns: int = 1,
) -> Figure:
    """Draw zone maps of legs, one panel each.

    Args:
        record: the record; it must hold samples of the legs.
        legs: list of (cycle, leg), or a cycle for all its legs.
        scales: units; by default those of the record.
        still: nodes that reach the friction limit without slip, drawn as a dashed line.
        columns: largest number of panels in a row; if greater than 1, the figure is as wide as a
            page, and each cycle begins a row.

    Returns:
        The figure; of a symmetric contact it shows x >= 0 only.

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
        inches = (AXES_WIDTH - style.COLUMN + width) / columns
        labels = [load_axis(record, *where, scales)[2] for where in legs]
        for n, ((row, column), (cycle, leg)) in enumerate(zip(places, legs, strict=True)):
            axes = grid[row, column]
            drawn = zone_map(record, cycle, leg, stuck, FLICKER)
            shown |= {int(state) for state, _ in drawn.pieces}
            title = describe_leg(record, cycle, leg, scales)
            axes.set_title(style.panel_title(n, len(legs), title))
            begin, end, label = load_axis(record, cycle, leg, scales)
            _draw_map(axes, drawn, (begin, end), scales, inches)
            if column == 0 or label != labels[n - 1]:
                axes.set_ylabel(label)
            if still is not None:
                dashed |= _draw_limit(axes, record, still, leg, (begin, end), scales)
            if (row + 1, column) not in places:
                axes.set_xlabel(scales.x_label)
                axes.tick_params(labelbottom=True)
        _add_legends(figure, record, shown, still if dashed else None, columns)
    return figure


def _add_legends(
    figure: Figure, record: Record, shown: set[int], still: Still | None, columns: int
) -> None:
    """Name the states shown below the panels, the dashed line above them."""
    if still is not None:
        handles = [Line2D([], [], label=_limit_label(still), **DASHED)]
        figure.legend(handles=handles, loc="outside upper center")
    figure.legend(
        handles=style.state_patches(shown, bool(np.any(record.friction.present))),
        loc="outside lower center",
        ncols=2 if columns == 1 else 4,
        columnspacing=1.4,
    )


def _limit_label(still: Still) -> str:
    """Return the label of the dashed line."""
    if still.strict:
        return "reaches the friction limit, does not slip"
    power = f"$10^{{{round(np.log10(NEGLIGIBLE_SLIP))}}}$"
    return f"reaches the friction limit, slips < {power} of the largest"


def _places(legs: list[tuple[int, int]], columns: int) -> list[tuple[int, int]]:
    """Return row and column of each leg's panel."""
    places = [(0, 0)]
    for (before, _), (cycle, _) in pairwise(legs):
        row, column = places[-1]
        full = column + 1 == columns or (columns > 1 and cycle != before)
        places.append((row + 1, 0) if full else (row, column + 1))
    return places


def load_axis(record: Record, cycle: int, leg: int, scales: Scales) -> tuple[float, float, str]:
    """Return the vertical axis of a zone map: values at both ends of the leg, and its label.

    If one load alone changes, it is the load factor over its largest value, else s.
    """
    begin, end = (load / scales.load_max for load in leg_ends(record, cycle, leg))
    changing = np.flatnonzero(begin != end)
    if len(changing) != 1:
        return 0.0, 1.0, "position $s$ on the leg"
    k = int(changing[0])
    return float(begin[k]), float(end[k]), scales.load_label(record.load_names[k])


def _draw_map(
    axes: Axes, drawn: ZoneMap, ends: tuple[float, float], scales: Scales, inches: float
) -> None:
    """Draw zones, their boundaries and numbers on axes with a width in inches."""
    begin, end = ends

    def place(points: Array) -> Array:
        return points * [1.0 / scales.length, end - begin] + [0.0, begin]

    colours = [style.STATE_COLOURS[state] for state, _ in drawn.pieces]
    # a hairline of the same colour closes the gaps that antialiasing leaves
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
    """Draw where nodes reach the friction limit without slip; return whether there are any."""
    # at a turning point the line would lie on the frame
    here = (still.leg == leg) & (still.s > TURNING_POINT) & (still.s < 1.0 - TURNING_POINT)
    node, s = still.node[here], still.s[here]
    if scales.symmetric and record.x[0] < 0.0:
        right = record.x[node] >= 0.0
        node, s = node[right], s[right]
    cuts = np.flatnonzero((np.diff(node) > 1) | (np.abs(np.diff(s)) > MAX_LINE_STEP)) + 1
    for nodes, part in zip(np.split(node, cuts), np.split(s, cuts), strict=True):
        if len(nodes) > 1:
            y = ends[0] + part * (ends[1] - ends[0])
            axes.plot(record.x[nodes] / scales.length, y, **DASHED)
    return len(node) > 1


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
