"""Figures of zone maps: a panel for each leg, or one map for each cycle with the loads beside it.

The numbers of states are inside a zone, or next to it with an arrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy import ndimage

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.measures.limit_nodes import (
    NEGLIGIBLE_SLIP,
    LimitNodes,
    is_settled,
    limit_nodes,
)
from receding_fenicsx.output.plots import series, style
from receding_fenicsx.output.plots.labels import MOST_TOLD, Scales, leg_pieces, load_text, scales_of
from receding_fenicsx.output.plots.zone_map import FLICKER, ZoneMap, zone_map

MAX_PANELS = 6
"""Largest number of legs of a cycle that have a panel each; more are one continuous map."""


@mpl.rc_context(style.RC)
def zone_maps(
    record: Record,
    legs: int | list[tuple[int, int]],
    scales: Scales | None = None,
    columns: int = 1,
) -> Figure:
    """Draw zone maps of legs that have samples, one panel each; of a symmetric contact x >= 0 only.

    Legs are a list of (cycle, leg), or a cycle for all its legs; one of more than ``MAX_PANELS``
    legs is one map, see :func:`cycle_maps`. With more than one column in a row the figure is as
    wide as a page, and each cycle begins a row. Nodes whose slip in a settled cycle is negligible
    are shown as sticking; a dashed line shows where they reach the friction limit.
    """
    scales = scales or scales_of(record)
    shown_legs = series.requested_legs(record, legs)
    if not isinstance(legs, list) and len(shown_legs) > MAX_PANELS:
        return cycle_maps(record, [shown_legs[0][0]], scales)
    places = [(0, 0)]
    for (before, _), (cycle, _) in pairwise(shown_legs):
        row, column = places[-1]
        full = column + 1 == columns or (columns > 1 and cycle != before)
        places.append((row + 1, 0) if full else (row, column + 1))
    rows = places[-1][0] + 1
    width = style.COLUMN if columns == 1 else style.PAGE
    # approximate width and height in inches of the axes
    inches = ((2.95 - style.COLUMN + width) / columns, 1.85)
    wide = inches[0] - (0.25 if columns == 1 else 0.45)
    titles = []
    for n, where in enumerate(shown_legs):
        text = style.wrapped(leg_pieces(record, *where, scales), wide)
        titles.append(style.panel_title(n, len(shown_legs), text))
    lines = 1 + max(title.count("\n") for title in titles)
    figure = style.new_figure(width, 0.9 + (inches[1] + 0.1 + 0.15 * lines) * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for place in set(np.ndindex(grid.shape)) - set(places):
        grid[place].set_axis_off()
    shown: set[int] = set()
    dashed: list[LimitNodes] = []
    sides = [load_axis(record, *where, scales) for where in shown_legs]
    for n, ((row, column), (cycle, leg)) in enumerate(zip(places, shown_legs, strict=True)):
        axes, (*ends, label) = grid[row, column], sides[n]
        axes.set_title(titles[n])
        _draw_zones(axes, record, cycle, [leg], np.array(ends), scales, inches, shown, dashed)
        if column == 0 or label != sides[n - 1][2]:
            axes.set_ylabel(label)
        if (row + 1, column) not in places:
            axes.set_xlabel(scales.x_label)
            axes.tick_params(labelbottom=True)
    add_legends(figure, record, shown, dashed, columns > 1)
    return figure


def load_axis(record: Record, cycle: int, leg: int, scales: Scales) -> tuple[float, float, str]:
    """Return the vertical axis of a zone map: values at both ends of the leg, and its label.

    If one load alone changes, it is this load in the scene's units or over its largest value, else
    s.
    """
    begin, end = series.leg_ends(record, cycle, leg)
    changing = np.flatnonzero(begin != end)
    if len(changing) != 1:
        return 0.0, 1.0, "position $s$ on the leg"
    k = int(changing[0])
    unit, label = scales.load_axis(k, record.load_names[k])
    return float(begin[k]) / unit, float(end[k]) / unit, label


@mpl.rc_context(style.RC)
def cycle_maps(record: Record, cycles: int | Sequence[int], scales: Scales | None = None) -> Figure:
    """Draw the zones along one or several whole cycles, with the loads beside them.

    All legs of a cycle are stacked upwards, each of the same height; those of a harmonic history
    are drawn over the phase. Zones are shown as those of :func:`zone_maps`.
    """
    scales = scales or scales_of(record)
    chosen = series.requested_cycles(record, cycles)
    angles = series.phases(record) if chosen[0] else None
    # inches: height of the axes, width of the axes of the loads
    height = float(np.clip(0.22 * len(series.legs_of(record, chosen[-1])), 3.0, 5.6))
    width, loads = style.COLUMN if len(chosen) == 1 else style.PAGE, 0.85
    wide = (width - 0.6 - loads) / len(chosen)
    figure = style.new_figure(width, height + 1.1)
    ratios = {"width_ratios": [*[wide] * len(chosen), loads]}
    *panels, beside = figure.subplots(1, len(chosen) + 1, sharey=True, gridspec_kw=ratios)
    shown: set[int] = set()
    dashed: list[LimitNodes] = []
    for n, (axes, cycle) in enumerate(zip(panels, chosen, strict=True)):
        legs = [leg for _, leg in series.legs_of(record, cycle)]
        ends, inches = np.arange(len(legs) + 1.0) if angles is None else angles, (wide, height)
        _draw_zones(axes, record, cycle, legs, ends, scales, inches, shown, dashed)
        name = f"cycle {cycle}" if cycle else "first loading"
        axes.set_title(style.panel_title(n, len(chosen), name))
        axes.set_xlabel(scales.x_label)
    if angles is None:
        panels[0].set_ylabel("leg of the cycle")
        panels[0].yaxis.set_major_locator(MaxNLocator(8, integer=True))
    else:
        style.phase_axis(panels[0].yaxis)
    _draw_loads(beside, record, chosen[-1], scales, ends)
    add_legends(figure, record, shown, dashed, len(chosen) > 1)
    return figure


def _draw_loads(axes: Axes, record: Record, cycle: int, scales: Scales, at: Array) -> None:
    """Draw the load factors at the ends of the legs of a cycle, upwards as the zones."""
    ends = [series.leg_ends(record, *leg) for leg in series.legs_of(record, cycle)]
    load = np.array([ends[0][0], *(end for _, end in ends)]) / scales.load_max
    # none has the colour of a state
    looks: tuple[dict[str, Any], ...] = (
        {"color": "#000000", "lw": 1.0},
        {"color": "#009e73", "lw": 1.0, "dashes": (5, 1.5)},
        {"color": "#cc79a7", "lw": 1.4, "dashes": (1.2, 1.0)},
        {"color": "#56b4e9", "lw": 1.2, "dashes": (5, 1.2, 1.2, 1.2)},
    )
    for k, name in enumerate(record.load_names):
        axes.plot(load[:, k], at, label=load_text(name), **looks[k % len(looks)])
    axes.axvline(0.0, color=style.GUIDE_COLOUR, lw=0.4)
    reach = 1.08 * max(1.0, float(np.abs(load).max()))
    axes.set_xlim(-reach if load.min() < 0.0 else -0.08, reach)
    axes.set_xlabel("loads over\nlargest")
    axes.tick_params(labelleft=False)
    style.ticks(axes.xaxis, 2)
    if len(record.load_names) <= MOST_TOLD:
        look: dict[str, Any] = {"borderaxespad": 0.2, "labelspacing": 0.2, "handlelength": 1.8}
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), **look)


DASHED: dict[str, Any] = {"color": "black", "dashes": (3, 1.5), "lw": 1.0}
"""Style of the lines where nodes reach the friction limit without slip."""


def add_legends(
    figure: Figure, record: Record, shown: set[int], dashed: Sequence[LimitNodes], wide: bool
) -> None:
    """Name the states shown below the panels, the dashed lines above them."""
    if dashed:
        label = "reaches the friction limit, does not slip"
        if not all(still.strict for still in dashed):
            power = f"$10^{{{round(np.log10(NEGLIGIBLE_SLIP))}}}$"
            label = f"reaches the friction limit, slips < {power} of the largest"
        figure.legend(handles=[Line2D([], [], label=label, **DASHED)], loc="outside upper center")
    patches = style.state_patches(shown, record.friction.present)
    ncols = 4 if wide else 2
    figure.legend(handles=patches, loc="outside lower center", ncols=ncols, columnspacing=1.4)


def _draw_zones(
    axes: Axes,
    record: Record,
    cycle: int,
    legs: list[int],
    ends: Array,
    scales: Scales,
    inches: tuple[float, float],
    shown: set[int],
    dashed: list[LimitNodes],
) -> None:
    """Draw the zones of one or all legs of a cycle between these values at the ends of the legs.

    The states that are drawn are added to ``shown``, and nodes at the limit to ``dashed``.
    """
    limit = limit_nodes(record, cycle) if is_settled(record, cycle) else None
    one = legs[0] if len(legs) == 1 else None
    drawn = zone_map(record, cycle, one, None if limit is None else limit.stuck, FLICKER)
    begin, end = float(ends[0]), float(ends[-1])
    if len(legs) > 1:
        drawn = drawn.moved_to((ends - begin) / (end - begin))
    shown.update(int(state) for state, _ in drawn.pieces)

    def place(points: Array) -> Array:
        return points * [1.0 / scales.length, end - begin] + [0.0, begin]

    height = inches[1] / len(legs)
    colours = [style.STATE_COLOURS[state] for state, _ in drawn.pieces]
    # a hairline of the same colour closes the gaps between polygons that PDF viewers leave, no
    # antialiasing those in PNG files
    look: dict[str, Any] = {"linewidths": 0.4, "antialiaseds": False}
    polygons = [place(polygon) for _, polygon in drawn.pieces]
    axes.add_collection(PolyCollection(polygons, facecolors=colours, edgecolors=colours, **look))
    # boundaries of thin legs are thinner
    width, lines = min(0.6, 20.0 * height), list(place(drawn.boundaries))
    axes.add_collection(LineCollection(lines, colors="black", linewidths=width, capstyle="round"))
    low, high = drawn.x[0], drawn.x[-1]
    if scales.symmetric and low < 0.0:
        low = 0.0
    axes.set_xlim(0.0 if scales.begins_on_axis else low / scales.length, high / scales.length)
    axes.set_ylim(min(begin, end), max(begin, end))
    style.ticks(axes.xaxis, 5)
    axes.set_axisbelow(False)
    # smallest height of a leg in inches with which numbers beside thin zones point to them
    for label in place_labels(drawn, (low, high), inches, height >= 0.1):
        x, y = place(np.array(label.at)).tolist()
        ink, text = style.STATE_INKS[label.on], str(int(label.state))
        look = {"ha": "center", "va": "center", "color": ink}
        if label.tip is None:
            axes.text(x, y, text, **look)
            continue
        arrow: dict[str, Any] = {"arrowstyle": "-|>,head_length=0.3,head_width=0.12", "lw": 0.6}
        arrow |= {"color": ink, "shrinkA": 1.0, "shrinkB": 0.0}
        tip = place(np.array(label.tip)).tolist()
        axes.annotate(text, (tip[0], tip[1]), xytext=(x, y), arrowprops=arrow, **look)
    if limit is not None and _draw_limit(axes, record, limit, legs, ends, scales):
        dashed.append(limit)


def _draw_limit(
    axes: Axes,
    record: Record,
    limit: LimitNodes,
    legs: list[int],
    ends: Array,
    scales: Scales,
) -> bool:
    """Draw where nodes reach the friction limit without slip; return whether there are any."""
    here = np.isin(limit.leg, legs)
    if len(legs) == 1:
        # at a turning point the line would lie on the frame
        here &= (limit.s > 0.005) & (limit.s < 0.995)
    if scales.symmetric and record.x[0] < 0.0:
        here &= record.x[limit.node] >= 0.0
    node = limit.node[here]
    s = (np.searchsorted(legs, limit.leg[here]) + limit.s[here]) / len(legs)
    # largest part of a leg, or of a map of many legs, between neighbouring nodes of a dashed line
    step = 0.25 if len(legs) == 1 else 0.1
    cuts = np.flatnonzero((np.diff(node) > 1) | (np.abs(np.diff(s)) > step)) + 1
    for nodes, part in zip(np.split(node, cuts), np.split(s, cuts), strict=True):
        if len(nodes) > 1:
            y = np.interp(part, np.linspace(0.0, 1.0, len(ends)), ends)
            axes.plot(record.x[nodes] / scales.length, y, **DASHED)
    return len(node) > 1


class Label(NamedTuple):
    """The number of one zone."""

    state: State
    at: tuple[float, float]  # (x, s) of the number's centre
    # (x, s) that an arrow from the number points to; None when the number is inside
    tip: tuple[float, float] | None
    on: State  # state of the zone on which the number is written


def place_labels(
    drawn: ZoneMap, x_range: tuple[float, float], inches: tuple[float, float], arrows: bool = True
) -> list[Label]:
    """Place the numbers of the 24 deepest zones of a map; very small zones have none.

    ``x_range`` is the part that is shown, ``inches`` the size of the axes; thin zones have their
    numbers next to them only with ``arrows``.
    """
    # states at raster points (s, x), 100 an inch
    raster_points = 100
    nx, ns = (max(8, round(raster_points * inch)) for inch in inches)
    x = x_range[0] + (np.arange(nx) + 0.5) / nx * (x_range[1] - x_range[0])
    s = (np.arange(ns) + 0.5) / ns
    states = np.array([line.at(s) for line in drawn.timelines], dtype=np.int8).T
    raster = states[:, np.searchsorted(0.5 * (drawn.x[1:] + drawn.x[:-1]), x)]
    room = np.full(raster.shape, np.inf)
    zones: list[tuple[float, State, tuple[int, int], float]] = []
    for state in State:
        parts, _ = ndimage.label(raster == state)
        for k, box in enumerate(ndimage.find_objects(parts), start=1):
            part = parts[box] == k
            depth = ndimage.distance_transform_edt(np.pad(part, 1))[1:-1, 1:-1] / raster_points
            room[box] = np.where(part, depth, room[box])
            row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
            rows, columns = np.nonzero(part)
            extent = float(np.hypot(np.ptp(rows), np.ptp(columns))) / raster_points
            tip = int(row) + box[0].start, int(column) + box[1].start
            zones.append((float(depth.max()), state, tip, extent))
    zones.sort(key=lambda zone: -zone[0])
    labels, taken = [], np.zeros(raster.shape, dtype=bool)
    deep = 0.075  # smallest distance in inches of a number's centre from the boundary of its zone
    for depth, state, tip, extent in zones[:24]:
        point = x[tip[1]], s[tip[0]]
        if depth >= deep:
            labels.append(Label(state, point, None, state))
            taken[tip] = True
        # smallest length in inches of a thin zone that has its number next to it
        elif arrows and extent >= 0.2:
            clear = ndimage.distance_transform_edt(~taken) if taken.any() else np.inf
            place = _beside(raster, room >= deep, clear, tip, raster_points)
            if place is not None:
                on = State(int(raster[place]))
                labels.append(Label(state, (x[place[1]], s[place[0]]), point, on))
                taken[place] = taken[tip] = True
    return labels


def _beside(
    raster: NDArray[np.int8],
    deep: NDArray[np.bool_],
    clear: Array | float,
    tip: tuple[int, int],
    inch: int,
) -> tuple[int, int] | None:
    """Return the nearest free place for a number, in a zone of another state."""
    rows, columns = np.indices(raster.shape)
    distance = np.hypot(rows - tip[0], columns - tip[1]) / inch
    # smallest distance in inches from the tip and from other numbers, largest length of an arrow
    free = deep & (clear / inch >= 0.17) & (distance >= 0.17) & (distance <= 0.6)
    free &= raster != raster[tip]
    if not free.any():
        return None
    best = np.unravel_index(int(np.argmin(np.where(free, distance, np.inf))), raster.shape)
    return int(best[0]), int(best[1])
