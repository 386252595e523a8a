"""Facets of the contact edges, and matching facets of bodies in contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.mesh.raw_mesh import (
    STRAIGHT_TOLERANCE,
    Line,
    RawMesh,
    cells_behind,
    check_span,
    facets_between,
    line_of,
)
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import Contact, Load, Scene, Spring, Support


@dataclass(frozen=True)
class Interface:
    """One contact edge.

    Attributes:
        line: the line of the first body's edge; n is its inward normal there.
        facets: numbers of the first body's facets on its edge.
        against: numbers of the second body's facets on its edge; None for a rigid plane.
    """

    line: Line
    facets: Ints
    against: Ints | None = None


def find_interfaces(scene: Scene, meshes: Sequence[RawMesh], half: bool) -> tuple[Interface, ...]:
    """Find the facets of all contacts, and check the groups that the scene uses.

    Args:
        scene: the scene.
        meshes: mesh of each body.
        half: the meshes are the halves x >= 0.

    Returns:
        One interface a contact.

    Raises:
        InputError: a group is missing, overlaps another one or lies inside the body; a contact edge
            is not straight; the nodes of two bodies do not match.
    """
    for body, mesh in zip(scene.bodies, meshes, strict=True):
        _check_groups(scene, body.name, mesh, half)
    found = []
    for i, contact in enumerate(scene.contacts):
        where = "[contact]" if len(scene.contacts) == 1 else f"[[contact]] number {i + 1}"
        mesh, edge = _mesh_of(scene, meshes, contact.edge)
        line = line_of(mesh, edge, f"{where} edge")
        facets = np.arange(len(mesh.edges[edge]))
        if contact.span is not None:
            if not half:
                check_span(mesh, mesh.edges[edge], line, contact.span, f"{where} span")
            facets = facets_between(mesh, mesh.edges[edge], line, contact.span)
        if contact.against is None:
            found.append(Interface(line, facets))
            continue
        other, facing = _mesh_of(scene, meshes, contact.against)
        back = line_of(other, facing, f"{where} against")
        found.append(_matched(contact, (mesh, edge, line, facets), (other, facing, back), where))
    _check_apart(scene, meshes, found, half)
    return tuple(found)


def middle_of(scene: Scene, meshes: Sequence[RawMesh], interfaces: Sequence[Interface]) -> Array:
    """Return the middle (2,) of the box around all contacts."""
    found = []
    for contact, interface in zip(scene.contacts, interfaces, strict=True):
        mesh, edge = _mesh_of(scene, meshes, contact.edge)
        found.append(mesh.points[mesh.edges[edge][interface.facets]].reshape(-1, 2))
    points = np.vstack(found)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _mesh_of(scene: Scene, meshes: Sequence[RawMesh], edge: str) -> tuple[RawMesh, str]:
    body, name = scene.find_edge(edge)
    return meshes[scene.bodies.index(body)], name


def _check_groups(scene: Scene, name: str, mesh: RawMesh, half: bool) -> None:
    """Check that the groups used on a body exist, lie on its boundary and do not overlap."""
    named: list[tuple[str | None, str]] = []
    for i, contact in enumerate(scene.contacts):
        where = f"[[contact]] number {i + 1}" if len(scene.contacts) > 1 else "[contact]"
        named += [(contact.edge, f"{where} edge"), (contact.against, f"{where} against")]
    named += [(part.edge, f"{part.label} edge") for part in scene.edge_parts]
    named += [(spring.against, "[[spring]] against") for spring in scene.springs]
    named += [(support.edge, "[[support]] edge") for support in scene.supports]
    used: dict[str, Ints] = {}
    for edge, where in named:
        if edge is None:
            continue
        body, group = scene.find_edge(edge)
        if body.name != name or group in used:
            continue
        used[group] = mesh.facets(group, where)
        if half and not len(used[group]):
            continue
        if not len(used[group]):
            raise InputError(f"{where}: the group '{group}' holds no curve; put one in")
        count = cells_behind(mesh, used[group])[0]
        if np.any(count != 1):
            x, y = mesh.points[used[group][np.argmax(count != 1)]].mean(axis=0)
            place = "inside the body" if count.max() > 1 else "off the body"
            raise InputError(
                f"{where}: the group '{group}' lies {place} at ({x:g}, {y:g}); use curves of its "
                "boundary"
            )
    groups = list(used)
    for i, first in enumerate(groups):
        for second in groups[:i]:
            shared = _same_facets(used[first], used[second])
            if len(shared):
                x, y = mesh.points[used[first][shared[0]]].mean(axis=0)
                raise InputError(
                    f"the groups '{second}' and '{first}' overlap in {len(shared)} facets, one at "
                    f"({x:g}, {y:g}); put each curve in one of the groups that the scene uses"
                )


def _same_facets(a: Ints, b: Ints) -> Ints:
    """Return the numbers of the facets of a that are also in b."""
    known = {tuple(pair) for pair in np.sort(b, axis=1).tolist()}
    return np.array([i for i, p in enumerate(np.sort(a, axis=1).tolist()) if tuple(p) in known])


def _matched(
    contact: Contact,
    first: tuple[RawMesh, str, Line, Ints],
    second: tuple[RawMesh, str, Line],
    where: str,
) -> Interface:
    """Return the facets of both bodies where their edges lie on each other."""
    mesh, edge, line, chosen = first
    other, facing, back = second
    names = f"'{contact.edge}' and '{contact.against}'"
    near = STRAIGHT_TOLERANCE * min(line.length, back.length)
    opposite = other.points[np.unique(other.edges[facing])]
    off = np.abs((opposite - line.middle) @ line.outward).max()
    if off > near or line.outward @ back.outward > 0.0:
        raise InputError(
            f"{where}: {names} do not lie on each other, but {off:.3g} apart; move one of the "
            "bodies (a gap is given by initial_gap)"
        )
    facets, across = mesh.edges[edge][chosen], other.edges[facing]
    own, theirs = line.along(mesh.points[np.unique(facets)]), line.along(opposite)
    span = (max(own.min(), theirs.min()) - near, min(own.max(), theirs.max()) + near)
    if not span[1] - span[0] > 4.0 * near:
        raise InputError(f"{where}: {names} do not overlap; move one of the bodies")
    mine = chosen[facets_between(mesh, facets, line, span)]
    against = facets_between(other, across, line, span)
    a = mesh.points[np.unique(mesh.edges[edge][mine])]
    b = other.points[np.unique(across[against])]
    a, b = (points[np.argsort(line.along(points))] for points in (a, b))
    if len(a) < 2 or len(b) < 2:
        raise MeshMisfit(f"{where}: {names} share no facet; refine both meshes")
    # over the length of the shortest facet
    close = 1e-6 * min(np.diff(line.along(p)).min() for p in (a, b))
    for here, there, names_of in (
        (a, b, (contact.edge, contact.against)),
        (b, a, (contact.against, contact.edge)),
    ):
        distance = np.abs(line.along(here)[:, None] - line.along(there)).min(axis=1)
        if np.any(distance > close):
            i = int(np.argmax(distance > close))
            raise MeshMisfit(
                f"{where}: the nodes of {names} do not match: at ({here[i, 0]:g}, {here[i, 1]:g}) "
                f"'{names_of[0]}' has one, but '{names_of[1]}' only {distance[i]:.3g} away; give "
                "both edges the same nodes"
            )
    return Interface(line, mine, against)


def load_facets(mesh: RawMesh, load: Load | Spring | Support, edge: str, half: bool) -> Ints:
    """Return the facets (k, 2) of a load or support on an edge of its body.

    Raises:
        InputError: the load's span does not fit the mesh.
    """
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
    """Check that contacts share no node with each other, and no facet with loads and supports."""
    taken: list[tuple[str, int, Ints]] = []
    for contact, interface in zip(scene.contacts, found, strict=True):
        parts = [(contact.edge, interface.facets)]
        if contact.against is not None and interface.against is not None:
            parts.append((contact.against, interface.against))
        for edge, numbers in parts:
            body, name = scene.find_edge(edge)
            place = scene.bodies.index(body)
            facets = meshes[place].edges[name][numbers]
            for before, owner, theirs in taken:
                shared = np.intersect1d(facets, theirs) if owner == place else []
                if len(shared):
                    x, y = meshes[place].points[shared[0]]
                    raise InputError(
                        f"[[contact]]: '{before}' and '{edge}' share the node at ({x:g}, {y:g}), "
                        "which cannot lie on two planes; keep a facet off one of them by its span"
                    )
            taken.append((edge, place, facets))
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
        facets = load_facets(meshes[place], thing, name, half)
        for contact_edge, owner, theirs in taken:
            if owner == place and len(_same_facets(facets, theirs)):
                raise InputError(
                    f"{where}: '{edge}' lies on the contact edge '{contact_edge}' where the "
                    "contact is; use another group, or a span beside the contact's"
                )
