"""Axes of a zone map: zones, their numbers, the friction limit without slip, legends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.limit_nodes import NEGLIGIBLE_SLIP, LimitNodes
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import Scales
from receding_fenicsx.output.plots.zones.zone_labels import Label, place_labels
from receding_fenicsx.output.plots.zones.zone_map import ZoneMap

BOUNDARY, BOUNDARY_OF_LEG = 0.6, 20.0
"""Largest width of a boundary in points, and its largest width over the height of a leg in
inches."""
TURNING_POINT = 0.005
"""Part of a leg next to its ends that belongs to the turning points."""
DASHED: dict[str, Any] = {"color": "black", "dashes": (3, 1.5), "lw": 1.0}


def add_legends(
    figure: Figure, record: Record, shown: set[int], dashed: Sequence[LimitNodes], wide: bool
) -> None:
    """Name the states shown below the panels, the dashed lines above them."""
    if dashed:
        handles = [Line2D([], [], label=_limit_label(dashed), **DASHED)]
        figure.legend(handles=handles, loc="outside upper center")
    figure.legend(
        handles=style.state_patches(shown, record.friction.present),
        loc="outside lower center",
        ncols=4 if wide else 2,
        columnspacing=1.4,
    )


def _limit_label(dashed: Sequence[LimitNodes]) -> str:
    """Return the label of the dashed lines."""
    if all(still.strict for still in dashed):
        return "reaches the friction limit, does not slip"
    power = f"$10^{{{round(np.log10(NEGLIGIBLE_SLIP))}}}$"
    return f"reaches the friction limit, slips < {power} of the largest"


def draw_map(
    axes: Axes,
    drawn: ZoneMap,
    ends: tuple[float, float],
    scales: Scales,
    inches: tuple[float, float],
    legs: int = 1,
) -> None:
    """Draw zones, their boundaries and numbers; no arrows to zones of very many legs.

    Args:
        axes: the axes.
        drawn: the map.
        ends: vertical positions of s = 0 and s = 1.
        scales: units.
        inches: width and height of the axes, for the numbers.
        legs: number of legs in the map.
    """
    begin, end = ends

    def place(points: Array) -> Array:
        return points * [1.0 / scales.length, end - begin] + [0.0, begin]

    height = inches[1] / legs
    width = min(BOUNDARY, BOUNDARY_OF_LEG * height)
    colours = [style.STATE_COLOURS[state] for state, _ in drawn.pieces]
    # a hairline of the same colour closes the gaps between polygons that PDF viewers leave, no
    # antialiasing those in PNG files
    axes.add_collection(
        PolyCollection(
            [place(polygon) for _, polygon in drawn.pieces],
            facecolors=colours,
            edgecolors=colours,
            linewidths=0.4,
            antialiaseds=False,
        )
    )
    axes.add_collection(
        LineCollection(
            list(place(drawn.boundaries)), colors="black", linewidths=width, capstyle="round"
        )
    )
    low, high = drawn.x[0], drawn.x[-1]
    if scales.symmetric and low < 0.0:
        low = 0.0
    left = 0.0 if scales.begins_on_axis else low / scales.length
    axes.set_xlim(left, high / scales.length)
    axes.set_ylim(min(ends), max(ends))
    style.ticks(axes.xaxis, 5)
    axes.set_axisbelow(False)
    # smallest height of a leg in inches with which numbers beside thin zones point to them
    numbers = place_labels(drawn, (low, high), inches, height >= 0.1)
    for label in numbers:
        tip = None if label.tip is None else _pair(place(np.array(label.tip)))
        _write_number(axes, label, _pair(place(np.array(label.at))), tip)


def _write_number(
    axes: Axes, label: Label, at: tuple[float, float], tip: tuple[float, float] | None
) -> None:
    """Write the number of a state, with an arrow to its zone if it stands beside it."""
    ink = style.STATE_INKS[label.on]
    text = str(int(label.state))
    look: dict[str, Any] = {"ha": "center", "va": "center", "color": ink}
    if tip is None:
        axes.text(*at, text, **look)
        return
    arrow: dict[str, Any] = {"arrowstyle": "-|>,head_length=0.3,head_width=0.12", "lw": 0.6}
    arrow |= {"color": ink, "shrinkA": 1.0, "shrinkB": 0.0}
    axes.annotate(text, tip, xytext=at, arrowprops=arrow, **look)


def draw_limit(
    axes: Axes,
    record: Record,
    still: LimitNodes,
    legs: Sequence[int],
    ends: Sequence[float] | Array,
    scales: Scales,
) -> bool:
    """Draw where nodes reach the friction limit without slip; return whether there are any.

    Args:
        axes: axes of a map of some legs.
        record: the record.
        still: the nodes.
        legs: the legs, from s = 0 of the map to s = 1.
        ends: (n + 1,) vertical positions of the ends of the legs.
        scales: units.
    """
    # at a turning point of a map of one leg the line would lie on the frame
    inside = (still.s > TURNING_POINT) & (still.s < 1.0 - TURNING_POINT)
    here = np.isin(still.leg, legs) & (inside if len(legs) == 1 else True)
    if scales.symmetric and record.x[0] < 0.0:
        here &= record.x[still.node] >= 0.0
    node = still.node[here]
    s = (np.searchsorted(legs, still.leg[here]) + still.s[here]) / len(legs)
    # largest part of a leg between the instants of two neighbouring nodes on one dashed line
    # or the same over the height of a map of many legs
    step = 0.25 if len(legs) == 1 else 0.1
    cuts = np.flatnonzero((np.diff(node) > 1) | (np.abs(np.diff(s)) > step)) + 1
    for nodes, part in zip(np.split(node, cuts), np.split(s, cuts), strict=True):
        if len(nodes) > 1:
            y = np.interp(part, np.linspace(0.0, 1.0, len(ends)), ends)
            axes.plot(record.x[nodes] / scales.length, y, **DASHED)
    return len(node) > 1


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
