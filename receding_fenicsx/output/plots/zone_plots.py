"""Figures of zone maps: a panel for each leg, or one map for each cycle with the loads beside it.

The numbers of states are inside a zone, or next to it with an arrow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

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
from receding_fenicsx.interface.law import MIRRORED, State
from receding_fenicsx.measures.limit_nodes import (
    NEGLIGIBLE_SLIP,
    LimitNodes,
    is_settled,
    limit_nodes,
)
from receding_fenicsx.output.plots import series, style
from receding_fenicsx.output.plots.labels import MOST_TOLD, Scales, leg_pieces, load_text
from receding_fenicsx.output.plots.zone_map import zone_map

MAX_PANELS = 6
"""Largest number of legs of a cycle that have a panel each; more are one continuous map."""


@mpl.rc_context(style.RC)
def zone_maps(record: Record, legs: int | list[tuple[int, int]], columns: int = 1) -> Figure:
    """Draw zone maps of legs that have samples, one panel each; of a symmetric contact x >= 0 only.

    Legs are a list of (cycle, leg), or a cycle for all its legs: of more than ``MAX_PANELS`` one
    map, see :func:`cycle_maps`. With several columns each cycle begins a row. Nodes whose slip in a
    settled cycle is negligible stick, a dashed line shows where they reach the friction limit.
    """
    scales, shown_legs = Scales(record), series.requested_legs(record, legs)
    if not isinstance(legs, list) and len(shown_legs) > MAX_PANELS:
        return cycle_maps(record, [shown_legs[0][0]])
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
        text = style.wrapped(leg_pieces(*where, scales), wide)
        titles.append(style.panel_title(n, len(shown_legs), text))
    lines = 1 + max(title.count("\n") for title in titles)
    figure = style.new_figure(width, 0.9 + (inches[1] + 0.1 + 0.15 * lines) * rows)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for place in set(np.ndindex(grid.shape)) - set(places):
        grid[place].set_axis_off()
    drawn, before_label = [], ""
    for title, (row, column), (cycle, leg) in zip(titles, places, shown_legs, strict=True):
        axes = grid[row, column]
        axes.set_title(title)
        # upwards is the load that alone changes, else the position on the leg
        both = series.leg_ends(record, cycle, leg)
        changing = np.flatnonzero(both[0] != both[1])
        ends, label = np.array([0.0, 1.0]), "position $s$ on the leg"
        if len(changing) == 1:
            k = int(changing[0])
            unit, label = scales.load_axis(k, record.load_names[k])
            ends = np.array([load[k] / unit for load in both])
        drawn.append(_draw_zones(axes, record, cycle, [leg], ends, scales, inches))
        if column == 0 or label != before_label:
            axes.set_ylabel(label)
        before_label = label
        if (row + 1, column) not in places:
            axes.set_xlabel(scales.x_label)
            axes.tick_params(labelbottom=True)
    _add_legends(figure, record, drawn, 2 if columns == 1 else 4)
    return figure


@mpl.rc_context(style.RC)
def cycle_maps(record: Record, cycles: int | Sequence[int]) -> Figure:
    """Draw the zones along whole cycles with the loads beside them, legs of equal heights upwards.

    Those of a harmonic history are drawn over the phase.
    """
    scales, chosen = Scales(record), series.requested_cycles(record, cycles)
    angles = series.phases(record) if chosen[0] else None
    # inches: height of the axes, width of the axes of the loads
    height = float(np.clip(0.22 * len(series.legs_of(record, chosen[-1])), 3.0, 5.6))
    width, loads = style.COLUMN if len(chosen) == 1 else style.PAGE, 0.85
    wide = (width - 0.6 - loads) / len(chosen)
    figure = style.new_figure(width, height + 1.1)
    ratios = {"width_ratios": [*[wide] * len(chosen), loads]}
    *panels, beside = figure.subplots(1, len(chosen) + 1, sharey=True, gridspec_kw=ratios)
    drawn = []
    for n, (axes, cycle) in enumerate(zip(panels, chosen, strict=True)):
        legs = [leg for _, leg in series.legs_of(record, cycle)]
        ends = np.arange(len(legs) + 1.0) if angles is None else angles
        drawn.append(_draw_zones(axes, record, cycle, legs, ends, scales, (wide, height)))
        name = f"cycle {cycle}" if cycle else "first loading"
        axes.set_title(style.panel_title(n, len(chosen), name))
        axes.set_xlabel(scales.x_label)
    if angles is None:
        panels[0].set_ylabel("leg of the cycle")
        panels[0].yaxis.set_major_locator(MaxNLocator(8, integer=True))
    else:
        style.phase_axis(panels[0].yaxis)
    _draw_loads(beside, record, chosen[-1], scales, ends)
    _add_legends(figure, record, drawn, 2 if len(chosen) == 1 else 4)
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


# of the lines where nodes reach the friction limit without slip
_DASHED: dict[str, Any] = {"color": "black", "dashes": (3, 1.5), "lw": 1.0}


def _add_legends(figure: Figure, record: Record, drawn: list[Any], ncols: int) -> None:
    """Name the states shown below the panels, the dashed lines above them."""
    dashed = [limit for _, limit in drawn if limit is not None]
    if dashed:
        label = "reaches the friction limit, does not slip"
        if not all(limit.strict for limit in dashed):
            power = f"$10^{{{round(np.log10(NEGLIGIBLE_SLIP))}}}$"
            label = f"reaches the friction limit, slips < {power} of the largest"
        figure.legend(handles=[Line2D([], [], label=label, **_DASHED)], loc="outside upper center")
    states = set[State]().union(*(states for states, _ in drawn))
    patches = style.state_patches(states, record.friction.present)
    figure.legend(handles=patches, loc="outside lower center", ncols=ncols, columnspacing=1.4)


def _draw_zones(
    axes: Axes,
    record: Record,
    cycle: int,
    legs: list[int],
    ends: Array,
    scales: Scales,
    inches: tuple[float, float],
) -> tuple[set[State], LimitNodes | None]:
    """Draw zones of legs between values at their ends; return states and nodes at the limit."""
    limit = limit_nodes(record, cycle) if is_settled(record, cycle) else None
    one = legs[0] if len(legs) == 1 else None
    # with elements of degree 2 single nodes at the ends of zones change between stick and slip, and
    # change back within 0.08 of a leg
    drawn = zone_map(record, cycle, one, None if limit is None else limit.stuck, flicker=0.08)

    def place(points: Array) -> Array:
        s = np.interp(points[..., 1], np.arange(len(ends)), ends)
        return np.stack([points[..., 0] / scales.length, s], axis=-1)

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
    # of a symmetric contact, whose states are all mirror images, x >= 0 is shown
    centred = np.abs(record.x + record.x[::-1]).max() <= 1e-9 * np.ptp(record.x)
    tables = record.turning_points.state, record.samples.state
    half = centred and all(np.array_equal(MIRRORED[state][:, ::-1], state) for state in tables)
    low, high = 0.0 if half else record.x[0], record.x[-1]
    axes.set_xlim(0.0 if half else scales.ends[0], scales.ends[1])
    axes.set_ylim(float(ends.min()), float(ends.max()))
    style.ticks(axes.xaxis, 5)
    axes.set_axisbelow(False)
    # states at raster points (s, x), 100 an inch
    nx, ns = (max(8, round(100 * inch)) for inch in inches)
    x = low + (np.arange(nx) + 0.5) / nx * (high - low)
    even = (np.arange(ns) + 0.5) / ns
    s = np.interp(even, (ends - ends[0]) / (ends[-1] - ends[0]), np.arange(len(ends)))
    near = np.searchsorted(0.5 * (record.x[1:] + record.x[:-1]), x)
    # numbers beside thin zones point to them where a leg is higher than 0.1 inches
    for state, number, tip, on in _numbers(drawn.states(s).T[:, near], arrows=height >= 0.1):
        at, end = (place(np.array([x[k], s[j]])).tolist() for j, k in (number, tip))
        look = {"ha": "center", "va": "center", "color": style.STATE_INKS[on]}
        if number == tip:
            axes.text(at[0], at[1], str(int(state)), **look)
            continue
        arrow: dict[str, Any] = {"arrowstyle": "-|>,head_length=0.3,head_width=0.12", "lw": 0.6}
        arrow |= {"color": look["color"], "shrinkA": 1.0, "shrinkB": 0.0}
        axes.annotate(str(int(state)), end, xytext=at, arrowprops=arrow, **look)
    dashed = False
    if limit is not None:
        here = np.isin(limit.leg, legs)
        if one is not None:
            # at a turning point the line would lie on the frame
            here &= (limit.s > 0.005) & (limit.s < 0.995)
        if half:
            here &= record.x[limit.node] >= 0.0
        node, s = limit.node[here], np.searchsorted(legs, limit.leg[here]) + limit.s[here]
        # largest part of a leg, or of a map of many legs, between neighbours of a dashed line
        step = 0.25 if one is not None else 0.1 * len(legs)
        cuts = np.flatnonzero((np.diff(node) > 1) | (np.abs(np.diff(s)) > step)) + 1
        for line in np.split(place(np.column_stack([record.x[node], s])), cuts):
            if len(line) > 1:
                axes.plot(*line.T, **_DASHED)
        dashed = len(node) > 1
    return {state for state, _ in drawn.pieces}, limit if dashed else None


def _numbers(
    raster: NDArray[np.int8], arrows: bool
) -> Iterator[tuple[State, tuple[int, int], tuple[int, int], State]]:
    """Yield the numbers of the 24 deepest zones of a raster of 100 points an inch.

    Each is its state, the point of the number, the point that an arrow from it points to (the same
    where the number is inside), and the state below the number. Thin zones need ``arrows``.
    """
    rows, columns = np.indices(raster.shape)
    room = np.full(raster.shape, np.inf)
    zones: list[tuple[float, State, tuple[int, int], float]] = []
    for state in State:
        parts, _ = ndimage.label(raster == state)
        for k, box in enumerate(ndimage.find_objects(parts), start=1):
            part = parts[box] == k
            depth = ndimage.distance_transform_edt(np.pad(part, 1))[1:-1, 1:-1] / 100.0
            room[box] = np.where(part, depth, room[box])
            deepest = np.unravel_index(int(np.argmax(depth)), depth.shape)
            tip = int(deepest[0]) + box[0].start, int(deepest[1]) + box[1].start
            extent = np.hypot(np.ptp(rows[box][part]), np.ptp(columns[box][part])) / 100.0
            zones.append((float(depth.max()), state, tip, float(extent)))
    zones.sort(key=lambda zone: -zone[0])
    taken = np.zeros(raster.shape, dtype=bool)
    deep = 0.075  # smallest distance in inches of a number's centre from the boundary of its zone
    for depth, state, tip, extent in zones[:24]:
        if depth >= deep:
            taken[tip] = True
            yield state, tip, tip, state
        # smallest length in inches of a thin zone that has its number next to it
        elif arrows and extent >= 0.2:
            clear = ndimage.distance_transform_edt(~taken) / 100.0 if taken.any() else np.inf
            distance = np.hypot(rows - tip[0], columns - tip[1]) / 100.0
            # the nearest place in a zone of another state; smallest distance in inches from the tip
            # and from other numbers, largest length of an arrow
            free = (room >= deep) & (clear >= 0.17) & (distance >= 0.17) & (distance <= 0.6)
            free &= raster != raster[tip]
            if free.any():
                best = int(np.argmin(np.where(free, distance, np.inf)))
                number = best // raster.shape[1], best % raster.shape[1]
                taken[number] = taken[tip] = True
                yield state, number, tip, State(int(raster[number]))
