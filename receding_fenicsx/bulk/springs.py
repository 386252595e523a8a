r"""Springs: between an edge or a point and the ground, and between parallel edges of two bodies.

Those to the ground add their part to $A$ and hold the rigid motions that they resist.

With $J = u_1 - u_2$ the displacement of an edge of a body relative to the point straight across on
the other body, and $d$ the edge's normal $n$ or tangent $t$, springs between these have the energy
$\frac{1}{2} \int k_d (J \cdot d)^2 dA$. With the shape functions $N_i$ of the edge, whose nodes are
those across,
$D_i = \int N_i\, J \cdot d \, dA$ and $M_{ij} = \int N_i N_j \, dA$ it is
$\frac{1}{2} k_d D^T M^{-1} D$. So the unit loads $N_i d$ on the edge and $-N_i d$ across, of which
$D$ are the work-conjugates, have the factors $F = -k_d M^{-1} D$, as bolts have without tightening
(:mod:`~receding_fenicsx.bulk.closures`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from scipy.linalg import block_diag

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.constraints import nodes_at
from receding_fenicsx.bulk.edges import edge_facets, edge_nodes, facet_mass, gathered
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene, Spring

NAME = "[[spring]] "
"""Beginning of the names of the unit loads, which no load of a scene has."""


def add_springs(matrix: PETSc.Mat, space: fem.FunctionSpace, body: BodyMesh, scene: Scene) -> Array:
    """Add int (k_n n n + k_t t t) N_i N_j dA / E to A, and k / E at points; collective.

    A is then to be assembled. Returns (m, 3) components of the rigid motions that springs to the
    ground resist, on every rank.
    """
    comm, young = body.mesh.comm, scene.material.young
    springs = [spring for spring in scene.springs if spring.against is None]

    def add() -> tuple[Array, list[int]]:
        rows, counts = [np.empty((0, 3))], []
        for spring in springs:
            if spring.point is not None:
                node, places = nodes_at(space, body, spring.point)
                nodes, stiffness = node[:, None], np.array([spring.x, spring.y])
                # of a ring the stiffness per radian
                k = np.diag(stiffness) / (young * (2.0 * np.pi if scene.axisymmetric else 1.0))
                blocks = np.tile(k, (len(node), 1, 1))
                rows += list(
                    motions(places, body.pivot, body.size)[:, stiffness > 0.0].swapaxes(0, 1)
                )
            else:
                facets = edge_facets(space, body, spring.edge, spring.span)
                nodes, n = facets.nodes, facets.outward
                t = np.column_stack([-n[:, 1], n[:, 0]])
                moved = motions(facets.points.reshape(-1, 2), body.pivot, body.size)
                both = [(spring.normal, n), (spring.tangential, t)]
                k = sum(part * np.einsum("fa,fb->fab", axis, axis) for part, axis in both)
                mass = facet_mass(scene, facets) / young
                size = 2 * nodes.shape[1]
                blocks = np.einsum("fij,fab->fiajb", mass, k).reshape(len(nodes), size, size)
                for axis in (axis for part, axis in both if part > 0.0):
                    axis = np.repeat(axis, nodes.shape[1], axis=0)
                    rows.append(np.einsum("nak,na->nk", moved, axis))
            counts.append(len(nodes))
            dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 2 * nodes.shape[1])
            for at, block in zip(dofs.astype(PETSc.IntType), blocks, strict=True):
                matrix.setValues(at, at, block, addv=PETSc.InsertMode.ADD_VALUES)
        return np.concatenate(rows), counts

    every = comm.allgather(on_all(comm, add))
    for spring, *counts in zip(springs, *(counts for _, counts in every), strict=True):
        if spring.point is not None and not sum(counts):
            raise MeshMisfit(f"[[spring]] at {spring.point}: no node lies there; move it")
    return np.concatenate([rows for rows, _ in every])


def add_links(scene: Scene, parts: Mapping[str, Bulk]) -> Array:
    """Append the unit loads of all springs between two bodies to these, by name; collective.

    Returns M / k_d (m, m) of the m unit loads, on every rank. The first edge has to be straight,
    with the nodes of the other one straight across.
    """
    blocks: list[Array] = []
    number = count()
    for spring in (part for part in scene.springs if part.against is not None):
        named = [scene.find_edge(edge) for edge in (spring.edge, spring.against or "")]
        a, b = (parts[body.name] for body, _ in named)
        nodes, places = edge_nodes(a.space, a.body, named[0][1], spring.span)
        mass, normal = _mass(a, named[0][1], spring, nodes)
        others, beyond = edge_nodes(b.space, b.body, named[1][1], None)
        others = others[_across(spring, places, beyond, normal)]
        tangent = np.array([-normal[1], normal[0]])
        for k, d in ((spring.normal, normal), (spring.tangential, tangent)):
            for row in mass if k > 0.0 else ():
                name = f"{NAME}{next(number)}"
                _append(a, name, nodes, np.outer(row, d))
                _append(b, name, others, -np.outer(row, d))
            blocks += [mass / k] if k > 0.0 else []
    return np.asarray(block_diag(*blocks)) if blocks else np.zeros((0, 0))


def _mass(part: Bulk, edge: str, spring: Spring, nodes: Ints) -> tuple[Array, Array]:
    """Return int N_i N_j dA of the nodes of an edge, and its outward normal, on every rank."""
    facets = gathered(part.comm, lambda: edge_facets(part.space, part.body, edge, spring.span))
    matrix = np.zeros((len(nodes), len(nodes)))
    rows = np.searchsorted(nodes, facets.nodes)
    np.add.at(matrix, (rows[:, :, None], rows[:, None]), facet_mass(part.scene, facets))
    if np.abs(facets.outward - facets.outward[0]).max() > 1e-9:
        raise InputError(f"[[spring]] against: '{spring.edge}' is not straight")
    return matrix, facets.outward[0]


def _across(spring: Spring, places: Array, beyond: Array, normal: Array) -> Ints:
    """Return which of the nodes beyond are straight across from the nodes of an edge."""
    size = float(np.ptp(places, axis=0).max())
    offset = beyond - places[:, None]
    aside = np.abs(offset @ [-normal[1], normal[0]])
    found = np.argmin(aside, axis=1)
    worst = int(np.argmax(aside.min(axis=1)))
    gap = offset[np.arange(len(found)), found] @ normal
    if aside[worst].min() > 1e-9 * size or gap.min() < -1e-9 * size:
        x, y = places[worst]
        raise InputError(
            f"[[spring]] against: '{spring.against}' has no node straight across from the one of "
            f"'{spring.edge}' at ({x:g}, {y:g}); give a span, or both edges the same nodes"
        )
    if spring.tangential > 0.0 and gap.max() > 1e-9 * size:
        raise InputError(
            f"[[spring]] tangential: '{spring.edge}' and '{spring.against}' are {gap.max():g} "
            "apart, where forces along them would not balance in moment; put them on each other"
        )
    return found


def _append(part: Bulk, name: str, nodes: Ints, forces: Array) -> None:
    """Append a load with forces (n, 2) at nodes (n,) to a body."""
    vector = part.stiffness.createVecLeft() if part.ties is None else part.ties.createVecLeft()
    vector.set(0.0)
    if part.comm.rank == 0:
        rows = (2 * nodes[:, None] + np.arange(2)).ravel().astype(PETSc.IntType)
        vector.setValues(rows, forces.ravel())
    vector.assemble()
    if part.ties is not None:
        untied, vector = vector, part.stiffness.createVecLeft()
        part.ties.multTranspose(untied, vector)
        untied.destroy()
    part.loads.append(vector)
    part.load_names = (*part.load_names, name)
