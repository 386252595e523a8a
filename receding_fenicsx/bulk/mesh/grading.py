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
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, line_of, sides
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import MAX_CONTACT_ELEMENTS, Refinement


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
    """Return positions of an edge's vertices; places of sizes above the base are breaks only."""
    low, high = ends
    near = 1e-9 * (high - low)  # closer breaks are one
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
    mean = np.where(np.abs(ratio) > 1e-6, (right - left) / np.where(ratio, ratio, 1.0), left)
    so_far = np.append(0.0, np.cumsum(np.diff(knots) / mean))
    count = max(1, math.ceil(so_far[-1] - 1e-6))
    if count > MAX_CONTACT_ELEMENTS:
        raise InputError(
            f"[mesh] refine: makes {count} elements on a contact edge, at most "
            f"{MAX_CONTACT_ELEMENTS} are possible; enlarge size or growth"
        )
    wanted = so_far[-1] * np.arange(count) / count
    j = np.clip(np.searchsorted(so_far, wanted, side="right") - 1, 0, len(mean) - 1)
    part = (wanted - so_far[j]) / (so_far[j + 1] - so_far[j])
    curved = np.abs(ratio[j]) > 1e-6
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
    """Return gmsh's callback for the size around places, each with both ends (2,) of its range."""
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
    """Replace the nodes inside a meshed straight curve by points (n, 2), in order along it."""
    mesh = gmsh.model.mesh
    ends = [mesh.getNodes(0, point)[:2] for _, point in gmsh.model.getBoundary([(1, curve)])]
    (first, last), (begin, end) = ((int(tags[0]) for tags, _ in ends), (at[:2] for _, at in ends))
    if np.any((points[-1:] - points[:1]) @ (end - begin) < 0.0):
        points = points[::-1]
    mesh.clear([(1, curve)])
    tags = int(mesh.getMaxNodeTag()) + 1 + np.arange(len(points))
    flat = np.column_stack([points, np.zeros(len(points))]).ravel()
    mesh.addNodes(1, curve, tags, flat, gmsh.model.getParametrization(1, curve, flat))
    chain = np.concatenate([[first], tags, [last]])
    mesh.addElementsByType(curve, 1, [], np.column_stack([chain[:-1], chain[1:]]).ravel())


def grade_half(
    gmsh: Any, places: Sequence[Refinement], stations: Array, unit: float, both: bool
) -> None:
    """Mesh the half rectangle's boundary, with contact vertices at x = stations (over the unit)."""
    # physical curves "bottom" and "top" of rectangle.geo, and their y
    edges = ((1, 0.0), (3, 1.0))[: 1 + both]
    spots = []
    for place, (_, y) in itertools.product(places, edges):
        a, b = (np.array([s / unit, y]) for s in place.span)
        spots.append((replace(place, size=place.size / unit), a, b))
    gmsh.model.mesh.setSizeCallback(size_callback(spots))
    gmsh.model.mesh.generate(1)
    for group, y in edges:
        (curve,) = gmsh.model.getEntitiesForPhysicalGroup(1, group)
        place_nodes(gmsh, curve, np.column_stack([stations[1:-1], np.full(len(stations) - 2, y)]))


def mesh_refined(
    gmsh: Any, places: Sequence[Refinement], coarse: RawMesh, scale: float, where: str
) -> None:
    """Mesh gmsh's model again, with smaller elements at places, each with edge and growth.

    ``coarse`` is the mesh without them, in gmsh's coordinates times ``scale``.
    """
    if coarse.cell != "triangle":
        raise InputError(f"{where}: is for triangles; leave it out, or mesh without Recombine")
    model = gmsh.model
    groups = {model.getPhysicalName(1, t) or str(t): t for _, t in model.getPhysicalGroups(1)}
    spots = [
        (replace(place, size=place.size / scale), point, point)
        for place in dict.fromkeys(replace(p, edge=None) for p in places if p.at == "corners")
        for point in _reentrant_corners(gmsh, coarse, scale)
    ]
    vertices: list[tuple[int, Array]] = []
    for edge in dict.fromkeys(place.edge for place in places):
        assert edge is not None
        line = line_of(coarse, edge, where)
        knots = np.unique(line.along(coarse.points[np.unique(coarse.edges[edge])]))
        ends, near = (float(knots[0]), float(knots[-1])), 1e-9 * line.length
        own = _places_on(places, edge, ends, near, where)
        curves = [int(c) for c in model.getEntitiesForPhysicalGroup(1, groups[edge])]
        corners = []
        for curve in curves:
            ends_of = [tag for _, tag in model.getBoundary([(1, curve)])]
            points = np.array([model.getValue(0, tag, [])[:2] for tag in ends_of])
            corners.append(tuple(line.along(scale * points).tolist()))
        stops = sorted({s for pair in corners for s in pair})
        breaks = [Refinement(line.length, s, 2.0) for s in stops]
        positions = graded(ends, Base(knots, np.diff(knots)), [*own, *breaks])
        for curve, (first, last) in zip(curves, corners, strict=True):
            low, high = min(first, last) + near, max(first, last) - near
            inner = positions[(positions > low) & (positions < high)]
            vertices.append((curve, (line.middle + np.outer(inner, line.direction)) / scale))
        for place in own:
            a, b = (line.middle + s * line.direction for s in place.span)
            spots.append((replace(place, size=place.size / scale), a / scale, b / scale))
    try:
        model.mesh.clear()
        model.mesh.setSizeCallback(size_callback(spots))
        model.mesh.generate(1)
        for curve, points in vertices:
            place_nodes(gmsh, curve, points)
        model.mesh.generate(2)
    except Exception as caught:  # gmsh raises nothing more special
        reason = " ".join(str(caught).split())
        raise MeshMisfit(f"{where}: gmsh cannot mesh it: {reason}; use other sizes") from None


def _places_on(
    places: Sequence[Refinement], edge: str, ends: tuple[float, float], near: float, where: str
) -> list[Refinement]:
    """Return the places on an edge, "ends" by their positions."""
    found = []
    for place in places:
        if place.edge != edge or place.at == "corners":
            continue
        # nothing ends on the axis of a body of revolution, where positions are 0
        at = [s for s in ends if abs(s) > near] if isinstance(place.at, str) else [place.at]
        found += [replace(place, at=s) for s in at]
        low, high = min(p.span[0] for p in found), max(p.span[1] for p in found)
        if low < ends[0] - near or high > ends[1] + near:
            raise InputError(
                f"{where}: at = {low if low < ends[0] - near else high:g} lies beyond '{edge}', "
                f"which runs from {ends[0]:g} to {ends[1]:g}; move it"
            )
    return found


def _reentrant_corners(gmsh: Any, mesh: RawMesh, scale: float) -> list[Array]:
    """Return the points of gmsh's geometry at which the angle of a mesh is re-entrant."""
    x = mesh.points[mesh.cells]
    after, before = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    cross = np.abs(after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0])
    angle = np.bincount(mesh.cells.ravel(), np.arctan2(cross, (after * before).sum(axis=2)).ravel())
    pairs, count = np.unique(sides(mesh.cells)[0], axis=0, return_counts=True)
    outline = np.unique(pairs[count == 1])
    # where curves join smoothly the angle is nearly pi
    sharp = mesh.points[outline[angle[outline] > 7.0 / 6.0 * np.pi]] / scale
    points = [gmsh.model.getValue(0, tag, [])[:2] for _, tag in gmsh.model.getEntities(0)]
    return [p for p in points if np.any(np.hypot(*(sharp - p).T) < 1e-9 * mesh.size / scale)]
