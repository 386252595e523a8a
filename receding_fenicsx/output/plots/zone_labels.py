"""Where the numbers of the states go in a zone map: inside a zone, or beside it with an arrow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import Array
from receding_fenicsx.output.plots.zone_map import ZoneMap

INSIDE = 0.075
"""Inches from a number's middle to its zone's end, at least."""
CLEAR = 0.17
"""Inches between two numbers, or from a number to an arrow's tip, at least."""
WORTH_AN_ARROW = 0.2
"""Inches that a zone too thin for its number must be long, to have the number beside it."""
FAR = 0.6
"""Inches that an arrow may be long."""
DOTS = 100
"""Raster points an inch."""


@dataclass(frozen=True)
class Label:
    """The number of one zone.

    Attributes:
        state: the state.
        at: (x, s) of the number's middle.
        tip: (x, s) that an arrow from the number points to; None when the number is inside.
        on: state on which the number is written.
    """

    state: State
    at: tuple[float, float]
    tip: tuple[float, float] | None
    on: State


def place_labels(
    drawn: ZoneMap, x_range: tuple[float, float], inches: tuple[float, float]
) -> list[Label]:
    """Place the numbers of a zone map.

    Args:
        drawn: the map.
        x_range: part of x that is shown.
        inches: width and height of the axes.

    Returns:
        The labels; zones too small to be seen have none.
    """
    raster, x, s = _raster(drawn, x_range, inches)
    room = np.full(raster.shape, np.inf)
    zones: list[tuple[State, NDArray[np.bool_], Array]] = []
    for state in State:
        parts, n = ndimage.label(raster == state)
        for k in range(1, n + 1):
            depth = ndimage.distance_transform_edt(np.pad(parts == k, 1))[1:-1, 1:-1] / DOTS
            room = np.where(parts == k, depth, room)
            zones.append((state, parts == k, depth))
    zones.sort(key=lambda zone: -float(zone[2].max()))
    labels, taken = [], np.zeros(raster.shape, dtype=bool)
    for state, part, depth in zones:
        tip = np.unravel_index(int(np.argmax(depth)), depth.shape)
        if depth[tip] >= INSIDE:
            labels.append(Label(state, (x[tip[1]], s[tip[0]]), None, state))
            taken[tip] = True
            continue
        rows, columns = np.nonzero(part)
        if np.hypot(np.ptp(rows), np.ptp(columns)) < WORTH_AN_ARROW * DOTS:
            continue
        place = _beside(raster, room, taken, tip)
        if place is not None:
            at, point = (x[place[1]], s[place[0]]), (x[tip[1]], s[tip[0]])
            labels.append(Label(state, at, point, State(int(raster[place]))))
            taken[place] = taken[tip] = True
    return labels


def _raster(
    drawn: ZoneMap, x_range: tuple[float, float], inches: tuple[float, float]
) -> tuple[NDArray[np.int8], Array, Array]:
    """States at raster points (s, x), and the points' coordinates."""
    nx, ns = (max(8, round(DOTS * inch)) for inch in inches)
    x = x_range[0] + (np.arange(nx) + 0.5) / nx * (x_range[1] - x_range[0])
    s = (np.arange(ns) + 0.5) / ns
    states = np.array([line.at(s) for line in drawn.timelines], dtype=np.int8).T
    nearest = np.searchsorted(0.5 * (drawn.x[1:] + drawn.x[:-1]), x)
    return states[:, nearest], x, s


def _beside(
    raster: NDArray[np.int8], room: Array, taken: NDArray[np.bool_], tip: tuple[np.intp, ...]
) -> tuple[int, int] | None:
    """The nearest free place for a number, in a zone of another state."""
    clear = ndimage.distance_transform_edt(~taken) / DOTS if taken.any() else np.inf
    rows, columns = np.indices(raster.shape)
    distance = np.hypot(rows - tip[0], columns - tip[1]) / DOTS
    free = (room >= INSIDE) & (clear >= CLEAR) & (distance >= CLEAR) & (distance <= FAR)
    free &= raster != raster[tip]
    if not free.any():
        return None
    best = np.unravel_index(int(np.argmin(np.where(free, distance, np.inf))), raster.shape)
    return int(best[0]), int(best[1])
