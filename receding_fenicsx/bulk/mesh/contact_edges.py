"""Facets of the contact edges, and matching facets of bodies in contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.mesh.raw_mesh import (
    STRAIGHT_TOLERANCE,
    Along,
    Line,
    RawMesh,
    cells_behind,
    curve_of,
    line_of,
    nearest_facet,
)
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import Joint, Scene


@dataclass(frozen=True)
class ContactFacets:
    """One contact or tied edge of a body."""

    joint: int  # number of the contact, or of the tie after all contacts
    body: int  # number of the body
    edge: str  # name of the edge on its body
    facets: Ints  # numbers of its facets among those of the edge
    line: Along  # the first body's edge, so that both sides have the same positions
    # the edge whose normals are those of the nodes, with a sign into the first body
    frame: tuple[Along, float]
    slave: bool  # whether the contact points are this edge's nodes where those of both do not match
    tie: bool  # whether the edge is a tied one
    tag: int = 0  # tag of its facets

    def inward(self, points: Array) -> Array:
        """Return the normals n (n, 2) into the first body."""
        line, sign = self.frame
        return sign * line.inward(points) + 0.0


def find_interfaces(
    scene: Scene, meshes: Sequence[RawMesh], half: bool
) -> tuple[ContactFacets, ...]:
    """Return the sides of each contact, then of each tie; check the groups that the scene uses."""
    for body, mesh in zip(scene.bodies, meshes, strict=True):
        _check_groups(scene, body.name, mesh, half)
    found: list[ContactFacets] = []
    for k, (joint, where) in enumerate(zip(scene.joints, scene.joint_labels, strict=True)):
        body, edge = scene.find_edge(joint.edge)
        place, tie = scene.bodies.index(body), k >= len(scene.contacts)
        mesh = meshes[place]
        line = curve_of(mesh, edge, f"{where} edge")
        facets = _facets_in(mesh, edge, joint.span, f"{where} span", half)
        if joint.against is None:
            found.append(ContactFacets(k, place, edge, facets, line, (line, 1.0), True, tie))
            continue
        body, facing = scene.find_edge(joint.against)
        other = scene.bodies.index(body)
        back = curve_of(meshes[other], facing, f"{where} against")
        sides = _Side(mesh, edge, line, facets), _Side(meshes[other], facing, back)
        own, against, slave, match = _opposed(joint, sides, where)
        # beside a curved edge whose nodes do not match
        frame = (line, 1.0) if match or isinstance(back, Line) else (back, -1.0)
        found.append(ContactFacets(k, place, edge, own, line, (line, 1.0), slave, tie))
        found.append(ContactFacets(k, other, facing, against, line, frame, not slave, tie))
    _check_apart(scene, meshes, found, half)
    return tuple(found)


def _facets_in(
    mesh: RawMesh, edge: str, span: tuple[float, float] | None, where: str, half: bool
) -> Ints:
    """Return the numbers of the facets of an edge in a span, whose ends are vertices."""
    facets = mesh.edges[edge]
    if span is None:
        return np.arange(len(facets))
    line = curve_of(mesh, edge, where)
    along, near = line.along(mesh.points[np.unique(facets)]), STRAIGHT_TOLERANCE * line.length
    if not half and not span[1] - span[0] > near:
        raise InputError(f"{where}: [{span[0]:g}, {span[1]:g}] is empty; write [lower, upper end]")
    for end in () if half else span:
        if not along.min() - near <= end <= along.max() + near:
            raise InputError(
                f"{where}: {end:g} lies beyond the edge, which runs from {along.min():g} to "
                f"{along.max():g}; shorten the span"
            )
        closest = along[np.argmin(np.abs(along - end))]
        if abs(closest - end) > near:
            raise MeshMisfit(
                f"{where}: no vertex of the mesh lies at {end:g}, the nearest at {closest:g}; put "
                "a point of the geometry there, or move the end"
            )
    middle = line.along(mesh.points[facets].mean(axis=1))
    return np.flatnonzero((middle > span[0]) & (middle < span[1]))


def edges_of(scene: Scene) -> list[tuple[str, str]]:
    """Return all edges that a scene uses, each with its place in messages."""
    named: list[tuple[str | None, str]] = []
    for joint, where in zip(scene.joints, scene.joint_labels, strict=True):
        named += [(joint.edge, f"{where} edge"), (joint.against, f"{where} against")]
    named += [(part.edge, f"{part.label} edge") for part in scene.edge_parts]
    named += [(spring.against, "[[spring]] against") for spring in scene.springs]
    named += [(support.edge, "[[support]] edge") for support in scene.supports]
    return [(edge, where) for edge, where in named if edge is not None]


def _check_groups(scene: Scene, name: str, mesh: RawMesh, half: bool) -> None:
    """Check that the groups used on a body exist, lie on its boundary and do not overlap."""
    used: set[str] = set()
    group_of: dict[tuple[int, ...], str] = {}
    for edge, where in edges_of(scene):
        body, group = scene.find_edge(edge)
        if body.name != name or group in used:
            continue
        used.add(group)
        facets = mesh.facets(group, where)
        if half and not len(facets):
            continue
        if not len(facets):
            raise InputError(f"{where}: the group '{group}' holds no curve; put one in")
        count = cells_behind(mesh, facets)[0]
        if np.any(count != 1):
            x, y = mesh.points[facets[np.argmax(count != 1)]].mean(axis=0)
            place = "inside the body" if count.max() > 1 else "off the sides of cells"
            raise InputError(
                f"{where}: the group '{group}' lies {place} at ({x:g}, {y:g}); use curves of its "
                "boundary"
            )
        own = list(map(tuple, np.sort(facets, axis=1).tolist()))
        shared = [key for key in own if key in group_of]
        if shared:
            x, y = mesh.points[list(shared[0])].mean(axis=0)
            raise InputError(
                f"the groups '{group_of[shared[0]]}' and '{group}' overlap in {len(shared)} "
                f"facets, one at ({x:g}, {y:g}); put each curve in one of the groups that the "
                "scene uses"
            )
        group_of |= dict.fromkeys(own, group)


class _Side:
    """Some facets of an edge, where the other side may touch them."""

    def __init__(self, mesh: RawMesh, edge: str, line: Along, chosen: Ints | None = None) -> None:
        self.line = line
        self.chosen = np.arange(len(mesh.edges[edge])) if chosen is None else chosen
        facets = mesh.edges[edge][self.chosen]
        vertices, times = np.unique(facets, return_counts=True)
        self.vertices, self.ends = mesh.points[vertices], mesh.points[vertices[times == 1]]
        self.a, self.b = np.moveaxis(mesh.points[facets], 1, 0)
        self.length = np.linalg.norm(self.b - self.a, axis=1)

    def containing(self, points: Array, near: float) -> Ints:
        """Return the facets that points lie on, not at a vertex."""
        facet, s, apart = nearest_facet(points, self.a, self.b)
        return facet[(apart <= near) & (np.minimum(s, 1.0 - s) > STRAIGHT_TOLERANCE)]

    def offset(self, other: _Side) -> tuple[float, Array]:
        """Return how far off the other side, between its ends, vertices lie, and the farthest."""
        facet, s, apart = nearest_facet(self.vertices, other.a, other.b)
        nearest = np.where(s[:, None] < 0.5, other.a[facet], other.b[facet])
        at_end = (nearest[:, None] == other.ends).all(axis=2).any(axis=1)
        apart = np.where(at_end & ((s <= 0.0) | (s >= 1.0)), 0.0, apart)
        if isinstance(self.line, Line) and isinstance(other.line, Line):
            apart = np.abs((self.vertices - other.line.middle) @ other.line.outward)
        k = int(np.argmax(apart))
        return float(apart[k]), self.vertices[k]

    def on(self, other: _Side, near: float) -> NDArray[np.bool_]:
        """Return which facets have both ends and the middle on the other side."""
        places = np.stack([self.a, self.b, 0.5 * (self.a + self.b)])
        apart = nearest_facet(places.reshape(-1, 2), other.a, other.b)[2]
        return np.asarray((apart.reshape(3, -1) <= near).all(axis=0))


def _opposed(joint: Joint, sides: tuple[_Side, _Side], where: str) -> tuple[Ints, Ints, bool, bool]:
    """Return the facets of both bodies that touch, if the first is the slave, if nodes match."""
    first, second = sides
    names = f"'{joint.edge}' and '{joint.against}'"
    near = STRAIGHT_TOLERANCE * min(side.line.length for side in sides)
    near += 1.5 * sum(side.line.sag for side in sides)
    off, (x, y) = max((first.offset(second), second.offset(first)), key=lambda found: found[0])
    on = [first.on(second, near), second.on(first, near)]
    middles = 0.5 * (second.a + second.b)[on[1]]
    facing = np.sum(first.line.inward(middles) * second.line.inward(middles), axis=1)
    if off > near:
        raise InputError(
            f"{where}: {names} do not lie on each other, but {off:.3g} apart at ({x:g}, {y:g}); "
            "move one of the bodies (a gap is given by initial_gap)"
        )
    if facing.max(initial=-1.0) > 0.0:
        raise InputError(
            f"{where}: {names} lie on each other with both bodies on the same side; "
            "move one of the bodies or name another edge of it"
        )
    if not on[0].any() and not on[1].any():
        raise InputError(f"{where}: {names} do not overlap; move one of the bodies")
    touching = [
        np.unique(np.vstack([side.a[k], side.b[k]]), axis=0)
        for side, k in zip(sides, on, strict=True)
    ]
    close = 1e-6 * min(side.length.min() for side in sides)
    if len(touching[0]) == len(touching[1]):
        apart = np.linalg.norm(touching[0][:, None] - touching[1], axis=2).min(axis=1)
        if apart.max(initial=0.0) <= close:
            return first.chosen[on[0]], second.chosen[on[1]], True, True
    cut = [first.containing(second.ends, near), second.containing(first.ends, near)]
    order = [0, 1] if on[0].sum() >= on[1].sum() else [1, 0]
    if joint.slave is not None:
        order = [("edge", "against").index(joint.slave)]
    usable = [k for k in order if not len(cut[k]) and on[k].any()]
    if not usable:
        k = order[0]
        x, y = 0.5 * (sides[k].a + sides[k].b)[cut[k][0]] if len(cut[k]) else sides[k].ends[0]
        raise MeshMisfit(
            f"{where}: one edge of {names} ends inside a facet of the other one at ({x:g}, {y:g});"
            " put a vertex there" + (", or leave out slave" if joint.slave else "")
        )
    k = usable[0]
    # of the other side all facets that overlap these
    on[1 - k][sides[1 - k].containing(np.vstack([sides[k].a[on[k]], sides[k].b[on[k]]]), near)] = (
        True
    )
    return first.chosen[on[0]], second.chosen[on[1]], k == 0, False


def _check_apart(
    scene: Scene, meshes: Sequence[RawMesh], found: Sequence[ContactFacets], half: bool
) -> None:
    """Check that contacts and ties share no facet with each other, loads and supports."""
    every = []
    for side in found:
        joint, body = scene.joints[side.joint], scene.bodies[side.body]
        first = scene.find_edge(joint.edge) == (body, side.edge)
        name = joint.edge if first else joint.against
        every.append((scene.joint_labels[side.joint], name, side.body, side.edge, side.facets))
    uses = [(part.edge, part.label, part.span) for part in scene.edge_parts]
    uses += [(s.edge, "[[support]] edge", None) for s in scene.supports if s.edge is not None]
    for name, where, span in uses:
        body, edge = scene.find_edge(name)
        # of one rectangle checked by the scene
        if body.mesh is not None or scene.others:
            place = scene.bodies.index(body)
            if span is not None:
                line_of(meshes[place], edge, f"{where} span")
            facets = _facets_in(meshes[place], edge, span, f"{where} span", half)
            every.append((where, name, place, edge, facets))
    # the contact or tie of each facet of each edge; groups do not overlap
    taken: dict[tuple[int, str], Ints] = {}
    for k, (where, name, place, edge, facets) in enumerate(every):
        ends = meshes[place].edges[edge]
        joints = taken.setdefault((place, edge), np.full(len(ends), -1))
        shared = facets[joints[facets] >= 0]
        if len(shared):
            x, y = meshes[place].points[ends[shared[0]]].mean(axis=0)
            raise InputError(
                f"{where}: '{name}' overlaps {scene.joint_labels[joints[shared[0]]]} at ({x:g}, "
                f"{y:g}); keep them apart by their spans or groups"
            )
        if k < len(found):
            joints[facets] = found[k].joint
