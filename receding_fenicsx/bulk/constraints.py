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
from typing import NamedTuple

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.edges import edge_nodes
from receding_fenicsx.bulk.loads import profile_values
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.checks import nearest
from receding_fenicsx.scene.model import FREE, Scene


class Dofs(NamedTuple):
    """Degrees of freedom 2 node + component, the coordinates (n, 2) of their nodes, and values."""

    dofs: Ints
    places: Array
    values: Array

    def at(self, which: Ints | NDArray[np.bool_]) -> Dofs:
        """Return some of them."""
        return Dofs(self.dofs[which], self.places[which], self.values[which])

    @staticmethod
    def joined(parts: list[Dofs]) -> Dofs:
        """Return all parts one after the other."""
        none = Dofs(np.empty(0, dtype=np.int64), np.empty((0, 2)), np.empty(0))
        return Dofs(*(np.concatenate(arrays) for arrays in zip(none, *parts, strict=True)))


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
        dofs = np.arange(*stiffness.getOwnershipRange())
        leaders = _leader(self.slaves, self.masters, dofs)
        follows = dofs != leaders
        rows = np.concatenate([dofs, dofs[follows]])
        columns = np.concatenate([dofs, leaders[follows]])
        values = np.concatenate([np.where(follows, 0.0, 1.0), np.ones(follows.sum())])
        order = np.lexsort((columns, rows))
        begin = np.concatenate([[0], np.cumsum(1 + follows)])
        csr = begin.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order]
        P = PETSc.Mat().createAIJ(stiffness.getSizes(), csr=csr, comm=stiffness.comm)
        P.assemble()
        return P


def _leader(slaves: Ints, masters: Ints, dofs: Ints) -> Ints:
    """Return the dof that each dof follows, or itself."""
    if not len(slaves):
        return dofs
    at = np.minimum(np.searchsorted(slaves, dofs), len(slaves) - 1)
    return np.where(slaves[at] == dofs, masters[at], dofs)


def find_constraints(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: Ints
) -> Constraints:
    """Find all constraints of a body, also those of the nodes on contact edges; collective."""
    slaves, masters = _platens(scene, space, body, contact)
    follows = slaves.dofs, masters.dofs
    held = _held(scene, space, body)
    if scene.axisymmetric and len(slaves.dofs):
        # a rigid ring cannot widen
        held = Dofs.joined([masters.at(masters.dofs % 2 == 0), held])
    held = held._replace(dofs=_leader(*follows, held.dofs))
    moved = {}
    for name, found in _displacements(scene, space, body).items():
        found = found._replace(dofs=_leader(*follows, found.dofs))
        _, first, inverse = np.unique(found.dofs, return_index=True, return_inverse=True)
        differs = np.abs(found.values - found.values[first][inverse])
        against = np.isin(found.dofs, held.dofs) & (found.values != 0.0)
        # equal to round-off where the same profile is evaluated twice
        if differs.max() > 1e-12 * np.abs(found.values).max():
            x, y = found.places[int(np.argmax(differs))]
            raise InputError(
                f"load '{name}' displacement: has two values at ({x:g}, {y:g}), of two edges or "
                "on a platen, which moves without rotation; give equal numbers"
            )
        if against.any():
            x, y = found.places[int(np.argmax(against))]
            raise InputError(
                f"load '{name}': its displacement moves the node at ({x:.6g}, {y:.6g}), which a "
                "support, symmetry or the axis holds; restrict it by a span, or drop the support"
            )
        moved[name] = found.at(first)
    every = Dofs.joined([held, *moved.values()])
    given, first = np.unique(every.dofs, return_index=True)
    prescribed = {name: np.zeros(len(given)) for name in moved}
    for name, found in moved.items():
        prescribed[name][np.searchsorted(given, found.dofs)] = found.values

    def components(part: Dofs) -> Array:
        moving = motions(part.places, body.pivot, body.size)
        return moving[np.arange(len(part.dofs)), part.dofs % 2]

    tied = components(slaves) - components(masters)
    return Constraints(*follows, given, prescribed, components(every.at(first)), tied)


def _platens(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: Ints
) -> tuple[Dofs, Dofs]:
    """Return the dofs of platens that follow, and the one that each follows.

    Loads on the same edge and span share a platen.
    """
    names: dict[tuple[str, tuple[float, float] | None], str] = {}
    for load in scene.loads:
        if load.platen:
            names.setdefault((load.edge, load.span), load.name)
    taken: dict[int, tuple[str, str]] = {}
    slaves: list[Dofs] = []
    masters: list[Dofs] = []
    for (edge, span), name in names.items():
        nodes, places = edge_nodes(space, body, edge, span)
        for node in nodes.tolist():
            other, where = taken.setdefault(node, (name, f"{edge} {span}"))
            if where != f"{edge} {span}":
                raise InputError(
                    f"load '{name}': its platen on '{edge}' meets that of load '{other}'; give "
                    "both the same edge and span, or a span that leaves a gap between them"
                )
        touches = np.flatnonzero(np.isin(nodes, contact))
        if len(touches) > 1:
            ends = sorted(places[touches].tolist())
            at = " and ".join(f"({x:.6g}, {y:.6g})" for x, y in (ends[0], ends[-1]))
            raise InputError(
                f"load '{name}': its platen on '{edge}' joins contact nodes, as those at {at}; "
                "restrict it by a span, or give it a pressure or traction instead"
            )
        master = touches[0] if len(touches) else 0
        for dofs, part in ((slaves, np.delete(np.arange(len(nodes)), master)), (masters, master)):
            follow = np.full(len(nodes) - 1, part)
            numbers = (2 * nodes[follow][:, None] + np.arange(2)).ravel()
            dofs.append(Dofs(numbers, np.repeat(places[follow], 2, axis=0), 0.0 * numbers))
    every, leading = Dofs.joined(slaves), Dofs.joined(masters)
    order = np.argsort(every.dofs)
    return every.at(order), leading.at(order)


def _displacements(scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> dict[str, Dofs]:
    """Return the dofs that each load prescribes, by the load's name."""
    found: dict[str, Dofs] = {}
    for load in scene.loads:
        if load.displacement is None:
            continue
        nodes, places = edge_nodes(space, body, load.edge, load.span)
        given = [
            Dofs(2 * nodes + axis, places, profile_values(load, body, part, places))
            for axis, part in enumerate(load.displacement)
            if part != FREE
        ]
        if not given:
            raise InputError(
                f"load '{load.name}' displacement: is free in both directions; give one"
            )
        before = [found[load.name]] if load.name in found else []
        found[load.name] = Dofs.joined([*before, *given])
    return found


def _held(scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> Dofs:
    """Return the dofs that symmetry or the axis holds, then those of each support; collective."""
    near = POSITION_TOLERANCE * body.size

    def on_axis(places: Array) -> NDArray[np.bool_]:
        r = places[:, 0]
        if r.min(initial=0.0) < -near:
            raise InputError(
                f"body: a node has r = x = {r.min():g}; an axisymmetric body lies at x >= 0"
            )
        return r <= near

    found = []
    if scene.axisymmetric:
        found.append((*find_nodes(space, on_axis), "x"))
    elif body.half:
        found.append((*edge_nodes(space, body, "axis", None), "x"))
    for support in scene.supports:
        if support.edge is not None:
            nodes, places = edge_nodes(space, body, support.edge, None)
        else:
            nodes, places = nodes_at(space, body, support.point or "")
        if not len(nodes) and scene.body.mesh is not None:
            raise MeshMisfit(
                f"support at {support.edge or support.point}: no node lies there; move it"
            )
        found.append((nodes, places, support.fix))
    return Dofs.joined(
        [
            Dofs(2 * nodes + "xy".index(axis), places, np.zeros(len(nodes)))
            for nodes, places, fix in found
            for axis in fix
        ]
    )


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
        close = nearest(point, body.spots)
        known = ", ".join(sorted(body.spots)) or f'none, declare Physical Point("{point}")'
        hint = f"did you mean '{close}'?" if close else f"it has {known}"
        raise InputError(f"point: the mesh has no group of points '{point}'; {hint}")

    def at_one(places: Array) -> NDArray[np.bool_]:
        apart = np.linalg.norm(places[:, None] - points, axis=2).min(axis=1)
        return np.asarray(apart <= POSITION_TOLERANCE * body.size)

    return find_nodes(space, at_one)
