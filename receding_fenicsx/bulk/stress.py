"""Stresses of a displacement field in cells and at vertices."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.loads import thermal_strain
from receding_fenicsx.bulk.material import free_gradient, linear_stresses, stiffness_in
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import Scene

STRESSES = ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear")
"""Names of the stresses; "max_shear" is the largest shear in the plane. In an axisymmetric body
"x" is r, "y" is z and "szz" the hoop stress."""


@dataclass
class Discretisation:
    """Scene of one body, its mesh, space of displacements, and names of its loads."""

    scene: Scene
    body: BodyMesh
    space: fem.FunctionSpace
    load_names: tuple[str, ...]

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.body.mesh.comm


@dataclass(frozen=True)
class Stresses:
    """Stresses of a displacement field, each by its name in ``STRESSES``."""

    # piecewise constant functions: the stress at each cell's midpoint
    cell: dict[str, fem.Function]
    # continuous functions of degree 1: averages over the cells around a vertex
    nodal: dict[str, fem.Function]


def stresses(
    bulk: Discretisation, displacement: fem.Function, load: Array | None = None
) -> Stresses:
    """Return the stresses of a displacement field, at midpoints of cells and averaged at vertices.

    The load factors, on every rank, are needed where the body has a thermal strain.
    """
    corners = _dolfinx.reference_corners(bulk.body.cell)
    points = np.vstack([corners, corners.mean(axis=0)])
    gradient = _gradient(bulk, displacement, points)
    if any(part.thermal_strain is not None for part in bulk.scene.loads):
        # at order 1 that of the midpoint, the last one
        at = np.repeat(points[-1:], len(points), axis=0) if bulk.scene.mesh.degree == 1 else points
        places = _dolfinx.evaluate_in_cells(ufl.SpatialCoordinate(bulk.body.mesh), at, bulk.space)
        strain = thermal_strain(bulk.scene, bulk.load_names, places) @ given(load)
        gradient -= strain[..., None] * free_gradient(bulk.scene.material)
    constant = _dolfinx.scalar_space(bulk.body.mesh, "DG", 0)
    linear = _dolfinx.scalar_space(bulk.body.mesh, "Lagrange", 1)
    cell_dofs = _dolfinx.cell_dofs(constant)[: len(gradient), 0]
    vertex_dofs = _dolfinx.cell_dofs(linear)[: len(gradient)]
    count = _sum_at_vertices(linear, vertex_dofs, np.ones(vertex_dofs.shape))
    in_cells, at_vertices = {}, {}
    components = np.moveaxis(linear_stresses(stiffness_in(bulk.scene, bulk.body), gradient), -1, 0)
    for name, value in named_stresses(*components).items():
        in_cells[name] = fem.Function(constant, name=name)
        in_cells[name].x.array[cell_dofs] = value[:, -1]
        in_cells[name].x.scatter_forward()
        total = _sum_at_vertices(linear, vertex_dofs, value[:, :-1])
        at_vertices[name] = fem.Function(linear, name=name)
        _dolfinx.owned_values(at_vertices[name])[:] = total / count
        at_vertices[name].x.scatter_forward()
    return Stresses(in_cells, at_vertices)


def _gradient(bulk: Discretisation, displacement: fem.Function, points: Array) -> Array:
    """Return (cells, n, [xx, xy, yx, yy, zz]) displacement gradients at reference points.

    The last is 0 in the plane; in an axisymmetric body it is the hoop strain u_r/r, on the axis
    du_r/dr.
    """
    grad = ufl.grad(displacement)
    if not bulk.scene.axisymmetric:
        plane = _dolfinx.evaluate_in_cells(grad, points, bulk.space)
        return np.concatenate([plane, np.zeros_like(plane[..., :1])], axis=-1)
    x = ufl.SpatialCoordinate(bulk.body.mesh)
    parts = [grad[0, 0], grad[0, 1], grad[1, 0], grad[1, 1], displacement[0], x[0]]
    values = _dolfinx.evaluate_in_cells(ufl.as_vector(parts), points, bulk.space)
    r = values[..., 5]
    on_axis = np.abs(r) <= POSITION_TOLERANCE * bulk.body.size
    hoop = np.where(on_axis, values[..., 0], values[..., 4] / np.where(on_axis, 1.0, r))
    return np.concatenate([values[..., :4], hoop[..., None]], axis=-1)


def named_stresses(sxx: Array, syy: Array, szz: Array, sxy: Array) -> dict[str, Array]:
    """Return each stress of ``STRESSES`` from the components."""
    pairs = (sxx - syy) ** 2 + (syy - szz) ** 2 + (szz - sxx) ** 2
    von_mises = np.sqrt(0.5 * pairs + 3.0 * sxy**2)
    max_shear = np.hypot(0.5 * (sxx - syy), sxy)
    return dict(zip(STRESSES, (sxx, syy, szz, sxy, von_mises, max_shear), strict=True))


def _sum_at_vertices(space: fem.FunctionSpace, local: NDArray[np.int32], values: Array) -> Array:
    """Sum values given cell by cell, over all ranks' cells, at this rank's own vertices."""
    index_map = space.dofmap.index_map
    sizes = (index_map.size_local, index_map.size_global)
    total = PETSc.Vec().createMPI(sizes, comm=space.mesh.comm)
    numbers = index_map.local_to_global(local.ravel()).astype(PETSc.IntType)
    total.setValues(numbers, values.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
    total.assemble()
    result = total.getArray().copy()
    total.destroy()
    return result
