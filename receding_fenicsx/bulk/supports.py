"""Degrees of freedom held by symmetry, supports and prescribed displacements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.edges import edge_facets
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.platens import Prescribed, Ties
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.checks import nearest
from receding_fenicsx.scene.model import Scene, Support

Held = tuple[Ints, Array, str]
"""Global numbers of nodes, their coordinates (n, 2), and the held components "x", "y" or "xy"."""


def find_held(
    scene: Scene,
    space: fem.FunctionSpace,
    body: BodyMesh,
    ties: Ties,
    prescribed: Mapping[str, Prescribed],
) -> tuple[Ints, Array]:
    """Find all held degrees of freedom, also those of contact nodes; collective.

    Args:
        scene: the scene of this body alone.
        space: displacement space.
        body: the mesh.
        ties: its platens, whose nodes are held by their master.
        prescribed: displacements that loads prescribe, by the load's name.

    Returns:
        Global degrees of freedom, sorted, and the coordinates (n, 2) of their nodes; alike on every
        rank.

    Raises:
        InputError: a support without nodes, or a prescribed displacement of a held node.
    """
    comm = body.mesh.comm
    parts = comm.allgather(on_all(comm, lambda: _held_here(scene, space, body)))
    if scene.body.mesh is not None:
        _check_found(scene.supports, parts)
    dofs, places = [np.empty(0, dtype=np.int64)], [np.empty((0, 2))]
    if scene.axisymmetric:
        # a rigid ring cannot widen
        dofs.append(2 * ties.masters)
        places.append(ties.master_places)
    for numbers, points, components in (held for part in parts for held in part):
        for component in components:
            dofs.append(2 * numbers + "xy".index(component))
            places.append(points)
    numbers = np.concatenate(dofs)
    leaders = 2 * ties.leader(numbers // 2) + numbers % 2
    for name, part in prescribed.items():
        against = np.isin(part.dofs, leaders) & (part.values != 0.0)
        if against.any():
            x, y = part.places[np.argmax(against)]
            raise InputError(
                f"load '{name}': its displacement moves the node at ({x:.6g}, {y:.6g}), which a "
                "support, symmetry or the axis holds; restrict it by a span, or drop the support"
            )
    leaders = np.concatenate([leaders, *(part.dofs for part in prescribed.values())])
    places += [part.places for part in prescribed.values()]
    unique, first = np.unique(leaders, return_index=True)
    return unique, np.concatenate(places)[first]


def _held_here(scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> list[Held]:
    """Return this rank's nodes held by symmetry, if there is any, then those of each support."""
    start, coordinates = _own_nodes(space)
    found: list[Held] = []
    if scene.axisymmetric:
        near = POSITION_TOLERANCE * body.size
        r = coordinates[:, 0]
        if r.min(initial=0.0) < -near:
            raise InputError(
                f"body: a node has r = x = {r.min():g}; an axisymmetric body lies at x >= 0"
            )
        at = np.flatnonzero(r <= near)
        found.append((start + at.astype(np.int64), coordinates[at], "x"))
    elif body.half:
        found.append(_on_edge(space, body, "axis", "x"))
    for support in scene.supports:
        if support.edge is not None:
            found.append(_on_edge(space, body, support.edge, support.fix))
        elif support.point is not None:
            found.append((*nodes_at(space, body, support.point), support.fix))
    return found


def _on_edge(space: fem.FunctionSpace, body: BodyMesh, edge: str, components: str) -> Held:
    """Return this rank's held nodes on an edge."""
    facets = edge_facets(space, body, edge)
    return facets.nodes.ravel(), facets.points.reshape(-1, 2), components


def _own_nodes(space: fem.FunctionSpace) -> tuple[int, Array]:
    """Return the number of this rank's first node, and the coordinates (n, 2) of its nodes."""
    start, end = space.dofmap.index_map.local_range
    return start, space.tabulate_dof_coordinates()[: end - start, :2]


def nodes_at(
    space: fem.FunctionSpace, body: BodyMesh, point: tuple[float, float] | str
) -> tuple[Ints, Array]:
    """Return this rank's nodes at a point, or at those of a named group, and their coordinates."""
    start, coordinates = _own_nodes(space)
    points = np.array([point]) if isinstance(point, tuple) else _group(body, point)
    distance = np.hypot(*np.moveaxis(coordinates[:, None] - points, 2, 0)).min(axis=1)
    at = np.flatnonzero(distance <= POSITION_TOLERANCE * body.size)
    return start + at.astype(np.int64), coordinates[at]


def _group(body: BodyMesh, name: str) -> Array:
    """Return the coordinates (n, 2) of a named group of points."""
    if name in body.spots:
        return body.spots[name]
    close = nearest(name, body.spots)
    known = ", ".join(sorted(body.spots)) or f'none, declare Physical Point("{name}")'
    hint = f"did you mean '{close}'?" if close else f"it has {known}"
    raise InputError(f"point: the mesh has no group of points '{name}'; {hint}")


def _check_found(supports: tuple[Support, ...], parts: list[list[Held]]) -> None:
    """Check that every support holds a node of the user's mesh."""
    for k, support in enumerate(supports, start=-len(supports)):
        if not any(len(part[k][0]) for part in parts):
            raise MeshMisfit(
                f"support at {support.edge or support.point}: no node lies there; move it"
            )
