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
    check_span,
    curve_of,
    facets_between,
    line_of,
    nearest_facet,
)
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import Joint, Load, Scene, Spring, Support


@dataclass(frozen=True)
class Interface:
    """One contact edge, or a tied one."""

    line: Along  # the first body's edge
    facets: Ints  # numbers of the first body's facets on its edge
    # numbers of the second body's facets on its edge; None for a rigid plane
    against: Ints | None = None
    # the second body's edge, where its nodes do not match and it is curved
    back: Along | None = None
    slave: bool = True  # whether the contact points are the first body's nodes


def find_interfaces(scene: Scene, meshes: Sequence[RawMesh], half: bool) -> tuple[Interface, ...]:
    """Return one interface a contact, then one a tie; check the groups that the scene uses."""
    for body, mesh in zip(scene.bodies, meshes, strict=True):
        _check_groups(scene, body.name, mesh, half)
    found = []
    for joint, where in zip(scene.joints, scene.joint_labels, strict=True):
        mesh, edge = _mesh_of(scene, meshes, joint.edge)
        line = curve_of(mesh, edge, f"{where} edge")
        facets = np.arange(len(mesh.edges[edge]))
        if joint.span is not None:
            if not half:
                check_span(mesh, mesh.edges[edge], line, joint.span, f"{where} span")
            facets = facets_between(mesh, mesh.edges[edge], line, joint.span)
        if joint.against is None:
            found.append(Interface(line, facets))
            continue
        other, facing = _mesh_of(scene, meshes, joint.against)
        back = curve_of(other, facing, f"{where} against")
        sides = _Side(mesh, edge, line, facets), _Side(other, facing, back)
        found.append(_opposed(joint, sides, where))
    _check_apart(scene, meshes, found, half)
    return tuple(found)


def middle_of(scene: Scene, meshes: Sequence[RawMesh], interfaces: Sequence[Interface]) -> Array:
    """Return the middle (2,) of the box around all contacts."""
    found = []
    for contact, interface in zip(scene.contacts, interfaces, strict=False):
        mesh, edge = _mesh_of(scene, meshes, contact.edge)
        found.append(mesh.points[mesh.edges[edge][interface.facets]].reshape(-1, 2))
    points = np.vstack(found)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _mesh_of(scene: Scene, meshes: Sequence[RawMesh], edge: str) -> tuple[RawMesh, str]:
    body, name = scene.find_edge(edge)
    return meshes[scene.bodies.index(body)], name


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
            place = "inside the body" if count.max() > 1 else "off the body"
            raise InputError(
                f"{where}: the group '{group}' lies {place} at ({x:g}, {y:g}); use curves of its "
                "boundary"
            )
        own = _keys(facets)
        shared = [key for key in own if key in group_of]
        if shared:
            x, y = mesh.points[list(shared[0])].mean(axis=0)
            raise InputError(
                f"the groups '{group_of[shared[0]]}' and '{group}' overlap in {len(shared)} "
                f"facets, one at ({x:g}, {y:g}); put each curve in one of the groups that the "
                "scene uses"
            )
        group_of |= dict.fromkeys(own, group)


def _keys(facets: Ints) -> list[tuple[int, ...]]:
    """Return the points of each facet, alike in both orientations."""
    return list(map(tuple, np.sort(facets, axis=1).tolist()))


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
        """Return how far off the other side its vertices lie at most, and one of these.

        Vertices beyond the ends of the other side do not count.
        """
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


def _opposed(joint: Joint, sides: tuple[_Side, _Side], where: str) -> Interface:
    """Return the facets of both bodies where their edges lie on each other."""
    first, second = sides
    names = f"'{joint.edge}' and '{joint.against}'"
    near = STRAIGHT_TOLERANCE * min(side.line.length for side in sides)
    near += 1.5 * sum(side.line.sag for side in sides)
    off, (x, y) = max((first.offset(second), second.offset(first)), key=lambda found: found[0])
    on = [first.on(second, near), second.on(first, near)]
    middles = 0.5 * (second.a + second.b)[on[1]]
    facing = np.sum(first.line.inward(middles) * second.line.inward(middles), axis=1)
    if off > near or facing.max(initial=-1.0) > 0.0:
        raise InputError(
            f"{where}: {names} do not lie on each other, but {off:.3g} apart at ({x:g}, {y:g}); "
            "move one of the bodies (a gap is given by initial_gap)"
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
            return Interface(first.line, first.chosen[on[0]], second.chosen[on[1]])
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
    facets = [side.chosen[part] for side, part in zip(sides, on, strict=True)]
    back = None if isinstance(second.line, Line) else second.line
    return Interface(first.line, facets[0], facets[1], back, k == 0)


def load_facets(mesh: RawMesh, load: Load | Spring | Support, edge: str, half: bool) -> Ints:
    """Return the facets (k, 2) of a load or support on an edge of its body."""
    facets = mesh.edges[edge]
    span = None if isinstance(load, Support) else load.span
    if span is None or half:
        return facets
    assert not isinstance(load, Support)
    line = line_of(mesh, edge, f"{load.label} span")
    check_span(mesh, facets, line, span, f"{load.label} span")
    return facets[facets_between(mesh, facets, line, span)]


def _check_apart(
    scene: Scene, meshes: Sequence[RawMesh], found: Sequence[Interface], half: bool
) -> None:
    """Check that contacts and ties share no facet with each other, loads and supports."""
    # the contact edge of each facet of each body
    taken: list[dict[tuple[int, ...], str]] = [{} for _ in meshes]
    for joint, where, interface in zip(scene.joints, scene.joint_labels, found, strict=True):
        for edge, numbers in ((joint.edge, interface.facets), (joint.against, interface.against)):
            if edge is None or numbers is None:
                continue
            body, name = scene.find_edge(edge)
            place = scene.bodies.index(body)
            own = _keys(meshes[place].edges[name][numbers])
            for key in own:
                if key in taken[place]:
                    x, y = meshes[place].points[list(key)].mean(axis=0)
                    raise InputError(
                        f"{where}: '{edge}' lies on '{taken[place][key]}', which is in another "
                        f"contact or tie, at ({x:g}, {y:g}); keep them apart by their spans or "
                        "groups"
                    )
            taken[place] |= dict.fromkeys(own, edge)
    uses: list[tuple[str, str, Load | Spring | Support]] = [
        (part.edge, part.label, part) for part in scene.edge_parts
    ]
    uses += [(s.edge, "[[support]] edge", s) for s in scene.supports if s.edge is not None]
    for edge, where, thing in uses:
        body, name = scene.find_edge(edge)
        if body.mesh is None and not scene.others:
            # checked by the scene
            continue
        place = scene.bodies.index(body)
        for key in _keys(load_facets(meshes[place], thing, name, half)):
            if key in taken[place]:
                raise InputError(
                    f"{where}: '{edge}' lies on the contact edge '{taken[place][key]}' where the "
                    "contact is; use another group, or a span beside the contact's"
                )
