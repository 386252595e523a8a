"""Contact edges with smaller elements at given places: positions of vertices, sizes around them.

With the element size h_0 that an edge has by itself and places k, ranges of the edge with the sizes
h_k and growths g_k, elements have the size

    h(s) = min(h_0(s), min_k (h_k + (g_k - 1) d_k(s))),

d_k being the distance from the place, inside the body the distance in the plane. Between two breaks
(places, ends of contacts and loads, middles of bodies) the vertices s_j are where
the integral of ds / h takes equal steps of at most 1. h is piecewise linear, so the integral is a
sum of logarithms.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import MAX_CONTACT_ELEMENTS, Refinement

COUNT_TOLERANCE = 1e-6
"""Part of an element by which the integral of ds / h may exceed a whole number."""
BOTTOM = 1
"""Number of the group of the contact edge in ``rectangle.geo``."""
NEAR = 1e-9
"""Distance of breaks, over the length of the edge, below which they are one."""


@dataclass(frozen=True)
class Base:
    """Element sizes of an edge without refinement: ``sizes[j]`` from ``knots[j]`` to the next."""

    knots: Array
    sizes: Array

    def at(self, s: Array) -> Array:
        """Return the size at positions between the knots."""
        cell = np.searchsorted(self.knots, s, side="right") - 1
        return np.asarray(self.sizes[np.clip(cell, 0, len(self.sizes) - 1)])


def graded(ends: tuple[float, float], base: Base, places: Sequence[Refinement]) -> Array:
    """Return the positions of the vertices of an edge.

    Args:
        ends: both ends of the edge.
        base: sizes without refinement.
        places: refined places with growth; those with a size above the base are breaks only.

    Raises:
        InputError: more elements than a contact edge can have.
    """
    low, high = ends
    near = NEAR * (high - low)
    spans = [s for place in places for s in place.span if low + near < s < high - near]
    breaks = np.array(sorted([low, *spans]))
    breaks = np.append(breaks[np.diff(breaks, prepend=-np.inf) > near], high)
    pieces = [_piece(a, b, base, places) for a, b in itertools.pairwise(breaks)]
    return np.append(np.concatenate(pieces), high)


def _piece(a: float, b: float, base: Base, places: Sequence[Refinement]) -> Array:
    """Return the vertices between two breaks, without the last one."""
    lines = np.array([[_size(place, a), _size(place, b)] for place in places]).reshape(-1, 2)
    inner = base.knots[(base.knots > a) & (base.knots < b)]
    # where the smallest of the linear functions may change
    flat = np.column_stack([np.unique(base.sizes)] * 2)
    every = np.vstack([lines, flat])
    start, rise = every[:, 0], every[:, 1] - every[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        meet = (start[:, None] - start) / (rise - rise[:, None])
    meet = meet[(meet > 0.0) & (meet < 1.0)]
    knots = np.unique(np.concatenate([[a], a + (b - a) * meet, inner, [b]]))
    middle = base.at(0.5 * (knots[1:] + knots[:-1]))
    t = (knots - a) / (b - a)
    values = lines[:, :1] * (1.0 - t) + lines[:, 1:] * t
    h = values.min(axis=0, initial=np.inf)
    left, right = np.minimum(h[:-1], middle), np.minimum(h[1:], middle)
    ratio = np.log(right / left)
    # (right - left) / ratio, the logarithmic mean of both sizes
    mean = np.where(
        np.abs(ratio) > COUNT_TOLERANCE, (right - left) / np.where(ratio, ratio, 1.0), left
    )
    so_far = np.append(0.0, np.cumsum(np.diff(knots) / mean))
    count = max(1, math.ceil(so_far[-1] - COUNT_TOLERANCE))
    if count > MAX_CONTACT_ELEMENTS:
        raise InputError(
            f"[mesh] refine: makes {count} elements on a contact edge, at most "
            f"{MAX_CONTACT_ELEMENTS} are possible; enlarge size or growth"
        )
    wanted = so_far[-1] * np.arange(count) / count
    j = np.clip(np.searchsorted(so_far, wanted, side="right") - 1, 0, len(mean) - 1)
    part = (wanted - so_far[j]) / (so_far[j + 1] - so_far[j])
    curved = np.abs(ratio[j]) > COUNT_TOLERANCE
    safe = np.where(curved, ratio[j], 1.0)
    part = np.where(curved, np.expm1(part * safe) / np.expm1(safe), part)
    return np.asarray(knots[j] + part * np.diff(knots)[j])


def _size(place: Refinement, s: float) -> float:
    """Return the element size that a place asks for at a position along its edge."""
    low, high = place.span
    assert place.growth is not None
    return place.size + (place.growth - 1.0) * max(low - s, s - high, 0.0)


def size_callback(
    spots: Sequence[tuple[Refinement, Array, Array]],
) -> Callable[..., float]:
    """Return gmsh's callback for the size around places in the plane.

    Args:
        spots: each place with both ends (2,) of its range.
    """
    ranges = []
    for place, a, b in spots:
        length = float(np.hypot(*(b - a)))
        along = (b - a) / length if length else np.zeros(2)
        assert place.growth is not None
        ranges.append((place.size, place.growth - 1.0, *a.tolist(), *along.tolist(), length))

    def size(dim: int, tag: int, x: float, y: float, z: float, wanted: float) -> float:
        for smallest, slope, ax, ay, tx, ty, length in ranges:
            t = min(max((x - ax) * tx + (y - ay) * ty, 0.0), length)
            wanted = min(wanted, smallest + slope * math.hypot(x - ax - t * tx, y - ay - t * ty))
        return wanted

    return size


def place_nodes(gmsh: Any, curve: int, points: Array) -> None:
    """Replace the nodes inside a meshed curve.

    Args:
        gmsh: gmsh, its model meshed in one dimension.
        curve: tag of the curve.
        points: (n, 2) new positions, from the curve's start to its end.
    """
    mesh = gmsh.model.mesh
    ends = gmsh.model.getBoundary([(1, curve)])
    first, last = (int(mesh.getNodes(0, point)[0][0]) for _, point in ends)
    mesh.clear([(1, curve)])
    tags = int(mesh.getMaxNodeTag()) + 1 + np.arange(len(points))
    flat = np.column_stack([points, np.zeros(len(points))]).ravel()
    if len(points):
        mesh.addNodes(1, curve, tags, flat, gmsh.model.getParametrization(1, curve, flat))
    chain = np.concatenate([[first], tags, [last]])
    mesh.addElementsByType(curve, 1, [], np.column_stack([chain[:-1], chain[1:]]).ravel())


def grade_half(gmsh: Any, places: Sequence[Refinement], stations: Array, unit: float) -> None:
    """Mesh the boundary of the half rectangle, its contact edge with vertices at the stations.

    Args:
        gmsh: gmsh with the geometry of ``rectangle.geo``.
        places: refined places.
        stations: (n,) x of the vertices, over the unit.
        unit: length of gmsh's unit.
    """
    scaled = [replace(place, size=place.size / unit) for place in places]
    ends = [np.array([[s, 0.0] for s in place.span]) / unit for place in places]
    spots = [(place, a, b) for place, (a, b) in zip(scaled, ends, strict=True)]
    gmsh.model.mesh.setSizeCallback(size_callback(spots))
    gmsh.model.mesh.generate(1)
    (curve,) = gmsh.model.getEntitiesForPhysicalGroup(1, BOTTOM)
    place_nodes(gmsh, curve, np.column_stack([stations[1:-1], np.zeros(len(stations) - 2)]))
