"""Placement of the numbers of states in a zone map: inside a zone, or next to it with an arrow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.output.plots.zones.zone_map import ZoneMap

MIN_DEPTH = 0.075
"""Smallest distance in inches of a number's centre from the boundary of its zone."""
MIN_DISTANCE = 0.17
"""Smallest distance in inches between two numbers, or between a number and an arrow's tip."""
MIN_ARROW_ZONE = 0.2
"""Smallest length in inches of a thin zone that has its number next to it."""
MAX_NUMBERS = 24
"""Largest number of zones, from the deepest on, that have numbers."""
RASTER = 100
"""Raster points per inch."""


@dataclass(frozen=True)
class Label:
    """The number of one zone.

    Attributes:
        state: the state.
        at: (x, s) of the number's centre.
        tip: (x, s) that an arrow from the number points to; None when the number is inside.
        on: state of the zone on which the number is written.
    """

    state: State
    at: tuple[float, float]
    tip: tuple[float, float] | None
    on: State


def place_labels(
    drawn: ZoneMap,
    x_range: tuple[float, float],
    inches: tuple[float, float],
    arrows: bool = True,
) -> list[Label]:
    """Place the numbers of a zone map.

    Args:
        drawn: the map.
        x_range: part of x that is shown.
        inches: width and height of the axes.
        arrows: whether thin zones have their numbers next to them.

    Returns:
        The labels; very small zones have none, nor have those beyond ``MAX_NUMBERS``.
    """
    raster, x, s = _raster(drawn, x_range, inches)
    room = np.full(raster.shape, np.inf)
    zones: list[tuple[float, State, tuple[int, int], float]] = []
    for state in State:
        parts, _ = ndimage.label(raster == state)
        for k, box in enumerate(ndimage.find_objects(parts), start=1):
            part = parts[box] == k
            depth = ndimage.distance_transform_edt(np.pad(part, 1))[1:-1, 1:-1] / RASTER
            room[box] = np.where(part, depth, room[box])
            row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
            rows, columns = np.nonzero(part)
            extent = float(np.hypot(np.ptp(rows), np.ptp(columns))) / RASTER
            tip = int(row) + box[0].start, int(column) + box[1].start
            zones.append((float(depth.max()), state, tip, extent))
    zones.sort(key=lambda zone: -zone[0])
    labels, taken = [], np.zeros(raster.shape, dtype=bool)
    for depth, state, tip, extent in zones[:MAX_NUMBERS]:
        point = x[tip[1]], s[tip[0]]
        if depth >= MIN_DEPTH:
            labels.append(Label(state, point, None, state))
            taken[tip] = True
        elif arrows and extent >= MIN_ARROW_ZONE:
            place = _beside(raster, room, taken, tip)
            if place is not None:
                on = State(int(raster[place]))
                labels.append(Label(state, (x[place[1]], s[place[0]]), point, on))
                taken[place] = taken[tip] = True
    return labels


def _raster(
    drawn: ZoneMap, x_range: tuple[float, float], inches: tuple[float, float]
) -> tuple[NDArray[np.int8], Array, Array]:
    """Return states at raster points (s, x), and x and s of these points."""
    nx, ns = (max(8, round(RASTER * inch)) for inch in inches)
    x = x_range[0] + (np.arange(nx) + 0.5) / nx * (x_range[1] - x_range[0])
    s = (np.arange(ns) + 0.5) / ns
    states = np.array([line.at(s) for line in drawn.timelines], dtype=np.int8).T
    nearest = np.searchsorted(0.5 * (drawn.x[1:] + drawn.x[:-1]), x)
    return states[:, nearest], x, s


def _beside(
    raster: NDArray[np.int8], room: Array, taken: NDArray[np.bool_], tip: tuple[int, int]
) -> tuple[int, int] | None:
    """Return the nearest free place for a number, in a zone of another state."""
    clear = ndimage.distance_transform_edt(~taken) / RASTER if taken.any() else np.inf
    rows, columns = np.indices(raster.shape)
    distance = np.hypot(rows - tip[0], columns - tip[1]) / RASTER
    # largest length of an arrow in inches
    free = (
        (room >= MIN_DEPTH)
        & (clear >= MIN_DISTANCE)
        & (distance >= MIN_DISTANCE)
        & (distance <= 0.6)
    )
    free &= raster != raster[tip]
    if not free.any():
        return None
    best = np.unravel_index(int(np.argmin(np.where(free, distance, np.inf))), raster.shape)
    return int(best[0]), int(best[1])
