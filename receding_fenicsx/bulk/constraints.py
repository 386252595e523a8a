"""Linear constraints u = P u' + sum_k lambda_k d_k of a body: supports, platens, displacements.

Each constraint determines one degree of freedom (dof) of the body. It is *given*, zero by a
support, by symmetry or on the axis, and d_k under a load that prescribes a displacement; or it
*follows* another one, as the nodes of a platen (an edge that moves rigidly without rotation)
follow one of them. With u' zero at the dofs that follow, the stiffness becomes P^T A P and nodal
forces P^T f: an exact elimination that adds no unknowns. A dof that is given and follows another
one gives that one.

Where a platen touches the contact, its nodes follow the contact node, whose conditions of contact
thus act on the whole platen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from scipy import sparse

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.loads import edge_nodes, profile_values
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.model import FREE, Scene


@dataclass(frozen=True)
class Constraints:
    """The constraints of a body, alike on every rank."""

    # slaves, masters: (n,) dofs that follow, sorted, and the dof that each follows
    slaves: Ints
    masters: Ints
    given: Ints  # (m,) dofs of u' that are given, sorted; none of them follows
    prescribed: dict[str, Array]  # by the name of the load, (m,) their value with factor 1
    rows: Array  # (m, 3) components of the rigid motions at the given dofs
    tied: Array  # (k, 3) combinations of the rigid motions that platens exclude

    def matrix(self, stiffness: PETSc.Mat) -> PETSc.Mat | None:
        """Return P, or None where nothing follows.

        The rows of the slaves store a zero on the diagonal, so that P^T A P stores its diagonal
        too.
        """
        if not len(self.slaves):
            return None
        start, end = stiffness.getOwnershipRange()
        dofs = np.arange(start, end)
        leaders = _leader(self.slaves, self.masters, dofs)
        follows = dofs != leaders
        rows = np.concatenate([dofs, dofs[follows]])
        columns = np.concatenate([dofs, leaders[follows]])
        values = np.concatenate([np.where(follows, 0.0, 1.0), np.ones(follows.sum())])
        local = sparse.csr_matrix(
            (values, (rows - start, columns)), (end - start, stiffness.getSize()[1])
        )
        csr = *(part.astype(PETSc.IntType) for part in (local.indptr, local.indices)), local.data
        P = PETSc.Mat().createAIJ(stiffness.getSizes(), csr=csr, comm=stiffness.comm)
        P.assemble()
        return P


def _leader(slaves: Ints, masters: Ints, dofs: Ints) -> Ints:
    """Return the dof that each dof follows, or itself."""
    if not len(slaves):
        return dofs
    at = np.minimum(np.searchsorted(slaves, dofs), len(slaves) - 1)
    return np.where(slaves[at] == dofs, masters[at], dofs)


class _Nodes:
    """Nodes of a body that are constrained, and where they lie."""

    def __init__(self, scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> None:
        self.scene, self.space, self.body = scene, space, body
        self.places: dict[int, list[float]] = {}

    def put(self, nodes: Ints, places: Array) -> tuple[Ints, Array]:
        """Keep where nodes lie, and return them."""
        self.places |= dict(zip(nodes.tolist(), places.tolist(), strict=True))
        return nodes, places

    def on_edge(self, edge: str, span: tuple[float, float] | None) -> tuple[Ints, Array]:
        """Return the nodes of an edge and their places; collective."""
        return self.put(*edge_nodes(self.space, self.body, edge, span))

    def of(self, dofs: Ints) -> Array:
        """Return the places (n, 2) of degrees of freedom."""
        return np.array([self.places[dof // 2] for dof in dofs.tolist()]).reshape(-1, 2)

    def components(self, dofs: Ints) -> Array:
        """Return the components (n, 3) of the rigid motions at degrees of freedom."""
        moving = motions(self.of(dofs), self.body.pivot, self.body.size)
        return moving[np.arange(len(dofs)), dofs % 2]


def find_constraints(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: Ints
) -> Constraints:
    """Find all constraints of a body, also those of the nodes on contact edges; collective."""
    nodes = _Nodes(scene, space, body)
    slaves, masters = _platens(nodes, contact)
    held = _held(nodes)
    if scene.axisymmetric:
        # a rigid ring cannot widen
        held = np.concatenate([masters[masters % 2 == 0], held])
    held = _leader(slaves, masters, held)
    moved = {}
    for name, (every, values) in _displacements(nodes).items():
        dofs = _leader(slaves, masters, every)
        own, first, inverse = np.unique(dofs, return_index=True, return_inverse=True)
        differs = np.abs(values - values[first][inverse])
        against = np.isin(dofs, held) & (values != 0.0)
        # equal to round-off where the same profile is evaluated twice
        if differs.max() > 1e-12 * np.abs(values).max():
            x, y = nodes.of(every)[np.argmax(differs)]
            raise InputError(
                f"load '{name}' displacement: has two values at ({x:g}, {y:g}), of two edges or "
                "on a platen, which moves without rotation; give equal numbers"
            )
        if against.any():
            x, y = nodes.of(every)[np.argmax(against)]
            raise InputError(
                f"load '{name}': its displacement moves the node at ({x:.6g}, {y:.6g}), which a "
                "support, symmetry or the axis holds; restrict it by a span, or drop the support"
            )
        moved[name] = own, values[first]
    given = np.unique(np.concatenate([held, *(dofs for dofs, _ in moved.values())]))
    prescribed = {name: np.zeros(len(given)) for name in moved}
    for name, (dofs, values) in moved.items():
        prescribed[name][np.searchsorted(given, dofs)] = values
    tied = nodes.components(slaves) - nodes.components(masters)
    return Constraints(slaves, masters, given, prescribed, nodes.components(given), tied)


def _platens(nodes: _Nodes, contact: Ints) -> tuple[Ints, Ints]:
    """Return the dofs of platens that follow, sorted, and the one that each follows.

    Loads on the same edge and span share a platen.
    """
    names: dict[tuple[str, tuple[float, float] | None], str] = {}
    for load in nodes.scene.loads:
        if load.platen:
            names.setdefault((load.edge, load.span), load.name)
    taken: dict[int, str] = {}
    slaves, masters = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for (edge, span), name in names.items():
        own, places = nodes.on_edge(edge, span)
        for node in own.tolist():
            if node in taken:
                raise InputError(
                    f"load '{name}': its platen on '{edge}' meets that of load '{taken[node]}'; "
                    "give both the same edge and span, or a span that leaves a gap between them"
                )
        taken |= dict.fromkeys(own.tolist(), name)
        touches = np.flatnonzero(np.isin(own, contact))
        if len(touches) > 1:
            ends = sorted(places[touches].tolist())
            at = " and ".join(f"({x:.6g}, {y:.6g})" for x, y in (ends[0], ends[-1]))
            raise InputError(
                f"load '{name}': its platen on '{edge}' joins contact nodes, as those at {at}; "
                "restrict it by a span, or give it a pressure or traction instead"
            )
        master = touches[0] if len(touches) else 0
        follow = np.delete(own, master)
        slaves.append((2 * follow[:, None] + np.arange(2)).ravel())
        masters.append(np.tile(2 * own[master] + np.arange(2), len(follow)))
    order = np.argsort(np.concatenate(slaves))
    return np.concatenate(slaves)[order], np.concatenate(masters)[order]


def _displacements(nodes: _Nodes) -> dict[str, tuple[Ints, Array]]:
    """Return the dofs that each load prescribes, and their values, by the load's name."""
    found: dict[str, tuple[Ints, Array]] = {}
    for load in nodes.scene.loads:
        if load.displacement is None:
            continue
        own, places = nodes.on_edge(load.edge, load.span)
        parts = [found[load.name]] if load.name in found else []
        axes = [axis for axis, part in enumerate(load.displacement) if part != FREE]
        if not axes:
            raise InputError(
                f"load '{load.name}' displacement: is free in both directions; give one"
            )
        for axis in axes:
            values = profile_values(load, nodes.body, load.displacement[axis], places)
            parts.append((2 * own + axis, values))
        dofs, values = map(np.concatenate, zip(*parts, strict=True))
        found[load.name] = dofs, values
    return found


def _held(nodes: _Nodes) -> Ints:
    """Return the dofs that symmetry or the axis holds, then those of each support; collective."""
    scene, body = nodes.scene, nodes.body
    near = POSITION_TOLERANCE * body.size

    def on_axis(places: Array) -> NDArray[np.bool_]:
        r = places[:, 0]
        if r.min(initial=0.0) < -near:
            raise InputError(
                f"body: a node has r = x = {r.min():g}; an axisymmetric body lies at x >= 0"
            )
        return r <= near

    found = [np.empty(0, dtype=np.int64)]
    if scene.axisymmetric:
        found.append(2 * nodes.put(*find_nodes(nodes.space, on_axis))[0])
    elif body.half:
        found.append(2 * nodes.on_edge("axis", None)[0])
    for support in scene.supports:
        if support.edge is not None:
            own, _ = nodes.on_edge(support.edge, None)
        else:
            own, _ = nodes.put(*nodes_at(nodes.space, body, support.point or ""))
        if not len(own) and scene.body.mesh is not None:
            raise MeshMisfit(
                f"support at {support.edge or support.point}: no node lies there; move it"
            )
        found += [2 * own + "xy".index(axis) for axis in support.fix]
    return np.concatenate(found)


def find_nodes(
    space: fem.FunctionSpace, chosen: Callable[[Array], NDArray[np.bool_]]
) -> tuple[Ints, Array]:
    """Return numbers and places (n, 2) of the nodes whose places are chosen; collective."""
    start, end = space.dofmap.index_map.local_range
    places = space.tabulate_dof_coordinates()[: end - start, :2]
    at = np.flatnonzero(on_all(space.mesh.comm, lambda: chosen(places))).astype(np.int64)
    parts = space.mesh.comm.allgather((start + at, places[at]))
    nodes, places = map(np.concatenate, zip(*parts, strict=True))
    return nodes, places


def nodes_at(
    space: fem.FunctionSpace, body: BodyMesh, point: tuple[float, float] | str
) -> tuple[Ints, Array]:
    """Return the nodes at a point, or at those of a named group, and their places; collective."""
    if isinstance(point, tuple):
        points = np.array([point])
    elif point in body.spots:
        points = body.spots[point]
    else:
        declare = f'declare Physical Point("{point}")'
        hint = suggestion(point, sorted(body.spots)) if body.spots else declare
        raise InputError(f"point: the mesh has no group of points '{point}'; {hint}")

    def at_one(places: Array) -> NDArray[np.bool_]:
        apart = np.linalg.norm(places[:, None] - points, axis=2).min(axis=1)
        return np.asarray(apart <= POSITION_TOLERANCE * body.size)

    return find_nodes(space, at_one)
