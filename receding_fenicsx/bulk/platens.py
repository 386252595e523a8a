"""Platens (edges that move rigidly without rotation) and prescribed displacements of edges.

The nodes of a platen (slaves) share the displacement of one of them (the master). With u = P u',
where u' is zero at the slaves, the stiffness becomes P^T A P and nodal forces P^T f: an exact
elimination that adds no unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.edges import edge_nodes
from receding_fenicsx.bulk.loads import profile_values
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import FREE, Load, Scene

EQUAL_TOLERANCE = 1e-12
"""Largest difference of displacements prescribed on one platen, over the largest displacement."""


@dataclass(frozen=True)
class Ties:
    """The platens of a body, alike on every rank.

    Attributes:
        slaves: (n,) slave nodes, sorted.
        masters: (n,) the master node of each.
        places, master_places: (n, 2) coordinates of both.
    """

    slaves: Ints
    masters: Ints
    places: Array
    master_places: Array

    def leader(self, nodes: Ints) -> Ints:
        """Return the node that each node moves with: its master, or itself."""
        at = np.minimum(np.searchsorted(self.slaves, nodes), max(len(self.slaves) - 1, 0))
        if not len(self.slaves):
            return nodes
        return np.where(self.slaves[at] == nodes, self.masters[at], nodes)


@dataclass(frozen=True)
class Prescribed:
    """The displacement that a load prescribes with factor 1, alike on every rank.

    Attributes:
        dofs: (n,) global degrees of freedom, sorted; those of platens by their master.
        values: (n,) displacements.
        places: (n, 2) coordinates of their nodes.
    """

    dofs: Ints
    values: Array
    places: Array


def find_ties(scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> Ties:
    """Find the nodes of the platens; loads on the same edge and span share one.

    Raises:
        InputError: two platens meet; on all ranks.
    """
    keys: dict[tuple[str, tuple[float, float] | None], str] = {}
    for load in scene.loads:
        if load.platen:
            keys.setdefault((load.edge, load.span), load.name)
    taken: dict[int, tuple[str, str]] = {}
    parts: list[tuple[Ints, Ints, Array, Array]] = []
    for (edge, span), name in keys.items():
        nodes, places = edge_nodes(space, body, edge, span)
        for node in nodes:
            other, where = taken.setdefault(int(node), (name, f"{edge} {span}"))
            if where != f"{edge} {span}":
                raise InputError(
                    f"load '{name}': its platen on '{edge}' meets that of load '{other}'; give "
                    "both the same edge and span, or a span that leaves a gap between them"
                )
        n = len(nodes) - 1
        master = np.full(n, nodes[0])
        parts.append((nodes[1:], master, places[1:], np.repeat(places[:1], n, axis=0)))
    if not parts:
        none, nowhere = np.empty(0, dtype=np.int64), np.empty((0, 2))
        return Ties(none, none, nowhere, nowhere)
    slaves, masters, places, master_places = (
        np.concatenate([p[k] for p in parts]) for k in range(4)
    )
    order = np.argsort(slaves)
    return Ties(slaves[order], masters[order], places[order], master_places[order])


def find_prescribed(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, ties: Ties
) -> dict[str, Prescribed]:
    """Find the displacement that each load prescribes, by the load's name.

    Raises:
        InputError: it is not constant on a platen, or free in both components; on all ranks.
    """
    parts: dict[str, list[tuple[Ints, Array, Array]]] = {}
    for load in scene.loads:
        if load.displacement is not None:
            parts.setdefault(load.name, []).extend(_given(load, space, body, ties))
    return {name: _prescribed(name, given) for name, given in parts.items()}


def _given(
    load: Load, space: fem.FunctionSpace, body: BodyMesh, ties: Ties
) -> list[tuple[Ints, Array, Array]]:
    """Return degrees of freedom, values and places (n, 2) of each prescribed component."""
    assert load.displacement is not None
    nodes, places = edge_nodes(space, body, load.edge, load.span)
    given = [
        (2 * ties.leader(nodes) + axis, profile_values(load, body, part, places), places)
        for axis, part in enumerate(load.displacement)
        if part != FREE
    ]
    if not given:
        raise InputError(f"load '{load.name}' displacement: is free in both directions; give one")
    return given


def _prescribed(name: str, given: list[tuple[Ints, Array, Array]]) -> Prescribed:
    """Join the components on all edges of a load; they agree where they share a node."""
    every, values, places = (np.concatenate([part[k] for part in given]) for k in range(3))
    dofs, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    differs = np.abs(values - values[first][inverse])
    if differs.max() > EQUAL_TOLERANCE * np.abs(values).max():
        x, y = places[int(np.argmax(differs))]
        raise InputError(
            f"load '{name}' displacement: has two values at ({x:g}, {y:g}), of two edges or on a "
            "platen, which moves without rotation; give equal numbers"
        )
    return Prescribed(dofs, values[first], places[first])


def tie_matrix(matrix: PETSc.Mat, ties: Ties) -> PETSc.Mat | None:
    """Return P, or None without platens.

    The rows of the slaves store a zero on the diagonal, so that P^T A P stores its diagonal too.
    """
    if not len(ties.slaves):
        return None
    dofs = np.arange(*matrix.getOwnershipRange())
    leaders = 2 * ties.leader(dofs // 2) + dofs % 2
    follows = dofs != leaders
    rows = np.concatenate([dofs, dofs[follows]])
    columns = np.concatenate([dofs, leaders[follows]])
    values = np.concatenate([np.where(follows, 0.0, 1.0), np.ones(follows.sum())])
    order = np.lexsort((columns, rows))
    begin = np.concatenate([[0], np.cumsum(1 + follows)])
    csr = begin.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order]
    P = PETSc.Mat().createAIJ(matrix.getSizes(), csr=csr, comm=matrix.comm)
    P.assemble()
    return P


def tied_dofs(ties: Ties) -> Ints:
    """Return the global degrees of freedom of the slaves."""
    return np.concatenate([2 * ties.slaves, 2 * ties.slaves + 1])
