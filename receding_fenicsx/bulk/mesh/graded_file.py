"""Mesh of a .geo file made again, with smaller elements at places on its edges and at corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.mesh.graded_edges import NEAR, Base, graded, place_nodes, size_callback
from receding_fenicsx.bulk.mesh.raw_mesh import Line, RawMesh, line_of, sides
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Refinement

REENTRANT = 7.0 / 6.0 * np.pi
"""Angle of a body from which a corner is re-entrant; where curves join it is nearly pi."""


def mesh_refined(
    gmsh: Any, places: Sequence[Refinement], coarse: RawMesh, scale: float, where: str
) -> None:
    """Mesh gmsh's model again.

    Args:
        gmsh: gmsh with the meshed model of the file.
        places: refined places, each with edge and growth.
        coarse: the mesh without them.
        scale: its coordinates over those of gmsh.
        where: beginning of messages.

    Raises:
        InputError: the body cannot be meshed so.
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
        ends, near = (float(knots[0]), float(knots[-1])), NEAR * line.length
        own = _places_on(places, edge, ends, near, where)
        curves = [int(c) for c in model.getEntitiesForPhysicalGroup(1, groups[edge])]
        corners = [_ends_of(gmsh, curve, line, scale) for curve in curves]
        stops = sorted({s for pair in corners for s in pair})
        breaks = [Refinement(line.length, s, 2.0) for s in stops]
        positions = graded(ends, Base(knots, np.diff(knots)), [*own, *breaks])
        for curve, (first, last) in zip(curves, corners, strict=True):
            low, high = min(first, last) + near, max(first, last) - near
            inner = positions[(positions > low) & (positions < high)]
            inner = inner if first < last else inner[::-1]
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
        raise InputError(f"{where}: gmsh cannot mesh it: {reason}; use other sizes") from None


def _places_on(
    places: Sequence[Refinement], edge: str, ends: tuple[float, float], near: float, where: str
) -> list[Refinement]:
    """Return the places on an edge, "ends" by their positions."""
    found = []
    for place in places:
        if place.edge != edge or place.at == "corners":
            continue
        # nothing ends on the axis of a body of revolution
        at = ends if isinstance(place.at, str) else (place.at,)
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
    sharp = mesh.points[outline[angle[outline] > REENTRANT]] / scale
    points = [gmsh.model.getValue(0, tag, [])[:2] for _, tag in gmsh.model.getEntities(0)]
    return [p for p in points if np.any(np.hypot(*(sharp - p).T) < NEAR * mesh.size / scale)]


def _ends_of(gmsh: Any, curve: int, line: Line, scale: float) -> tuple[float, float]:
    """Return the positions along a line of the first and the last point of a curve."""
    points = [gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getBoundary([(1, curve)])]
    first, last = line.along(scale * np.array(points)[:, :2])
    return float(first), float(last)
