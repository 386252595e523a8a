"""Springs to the ground: their part of the stiffness, and the motions that they hold."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.edges import edge_facets, facet_mass
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.bulk.supports import nodes_at
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene, Spring


def add_springs(matrix: PETSc.Mat, space: fem.FunctionSpace, body: BodyMesh, scene: Scene) -> None:
    """Add int (k_n n n + k_t t t) N_i N_j dA / E to A, and k / E at points.

    A is then to be assembled.
    """
    for point, stiffness in _single(scene):
        # of a ring the stiffness per radian
        size = scene.material.young * (2.0 * np.pi if scene.axisymmetric else 1.0)
        for node in nodes_at(space, body, point)[0]:
            row = (2 * node + np.arange(2)).astype(PETSc.IntType)
            values = np.diag(stiffness) / size
            matrix.setValues(row, row, values, addv=PETSc.InsertMode.ADD_VALUES)
    for spring in _foundations(scene):
        facets = edge_facets(space, body, spring.edge, spring.span)
        n, nodes = facets.nodes.shape
        normal = np.einsum("fa,fb->fab", facets.outward, facets.outward)
        k = spring.normal * normal + spring.tangential * (np.eye(2) - normal)
        mass = facet_mass(scene, facets) / scene.material.young
        values = np.einsum("fij,fab->fiajb", mass, k).reshape(n, 2 * nodes, 2 * nodes)
        rows = (2 * facets.nodes[:, :, None] + np.arange(2)).reshape(n, 2 * nodes)
        for row, block in zip(rows.astype(PETSc.IntType), values, strict=True):
            matrix.setValues(row, row, block, addv=PETSc.InsertMode.ADD_VALUES)


def spring_rows(space: fem.FunctionSpace, body: BodyMesh, scene: Scene, pivot: Array) -> Array:
    """Return (m, 3) components of the rigid motions that the springs resist; on every rank.

    Raises:
        MeshMisfit: no node lies at the point of a spring; on all ranks.
    """
    rows = [np.empty((0, 3))]
    foundations = _foundations(scene)
    found = on_all(
        body.mesh.comm,
        lambda: [edge_facets(space, body, part.edge, part.span) for part in foundations],
    )
    for spring, facets in zip(foundations, found, strict=True):
        count = facets.nodes.shape[1]
        moved = motions(facets.points.reshape(-1, 2), pivot, body.size)
        along = np.column_stack([-facets.outward[:, 1], facets.outward[:, 0]])
        for stiffness, axis in ((spring.normal, facets.outward), (spring.tangential, along)):
            if stiffness > 0.0:
                rows.append(np.einsum("nak,na->nk", moved, np.repeat(axis, count, axis=0)))
    single = _single(scene)
    places = on_all(
        body.mesh.comm, lambda: [nodes_at(space, body, point)[1] for point, _ in single]
    )
    for (point, values), place in zip(single, places, strict=True):
        if not body.mesh.comm.allreduce(len(place)):
            raise MeshMisfit(f"[[spring]] at {point}: no node lies there; move it")
        moved = motions(place, pivot, body.size)
        rows += [moved[:, k] for k, value in enumerate(values) if value > 0.0]
    return np.concatenate(body.mesh.comm.allgather(np.concatenate(rows)))


def _single(scene: Scene) -> list[tuple[tuple[float, float] | str, tuple[float, float]]]:
    """Return the points of springs at points, and their stiffness along x and y."""
    return [(part.point, (part.x, part.y)) for part in scene.springs if part.point is not None]


def _foundations(scene: Scene) -> list[Spring]:
    """Return the springs between an edge and the ground."""
    return [part for part in scene.springs if part.edge and part.against is None]
