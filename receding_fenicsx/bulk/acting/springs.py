"""Elastic foundations of edges: their part of the stiffness, and the motions that they hold."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.edges import edge_facets, integrate, measure, shape_functions
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene


def add_springs(matrix: PETSc.Mat, space: fem.FunctionSpace, body: BodyMesh, scene: Scene) -> None:
    """Add int (k_n n n + k_t t t) N_i N_j dA / E to A, which is then to be assembled."""
    for spring in scene.springs:
        facets = edge_facets(space, body, spring.edge, spring.span)
        n, nodes = facets.nodes.shape
        shapes = np.tile(shape_functions(nodes).T, (n, 1))

        def weighted(points: Array, _: Array, shapes: Array = shapes) -> Array:
            return measure(scene, points) * shapes

        normal = np.einsum("fa,fb->fab", facets.outward, facets.outward)
        stiffness = spring.normal * normal + spring.tangential * (np.eye(2) - normal)
        mass = integrate(facets, weighted) / scene.material.young
        values = np.einsum("fij,fab->fiajb", mass, stiffness).reshape(n, 2 * nodes, 2 * nodes)
        rows = (2 * facets.nodes[:, :, None] + np.arange(2)).reshape(n, 2 * nodes)
        for row, block in zip(rows.astype(PETSc.IntType), values, strict=True):
            matrix.setValues(row, row, block, addv=PETSc.InsertMode.ADD_VALUES)


def spring_rows(space: fem.FunctionSpace, body: BodyMesh, scene: Scene, pivot: Array) -> Array:
    """Return (m, 3) components of the rigid motions that the springs resist; on every rank."""
    rows = [np.empty((0, 3))]
    found = on_all(
        body.mesh.comm,
        lambda: [edge_facets(space, body, part.edge, part.span) for part in scene.springs],
    )
    for spring, facets in zip(scene.springs, found, strict=True):
        count = facets.nodes.shape[1]
        moved = motions(facets.points.reshape(-1, 2), pivot, body.size)
        along = np.column_stack([-facets.outward[:, 1], facets.outward[:, 0]])
        for stiffness, axis in ((spring.normal, facets.outward), (spring.tangential, along)):
            if stiffness > 0.0:
                rows.append(np.einsum("nak,na->nk", moved, np.repeat(axis, count, axis=0)))
    return np.concatenate(body.mesh.comm.allgather(np.concatenate(rows)))
