"""Displacements and stresses at points as sparse rows of the degrees of freedom of cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.loads import thermal_strain
from receding_fenicsx.bulk.material import linear_stresses, stiffness_in, unit_stress
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.stress import Discretisation
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.mpi import on_all

CELL_TOLERANCE = 1e-9
"""Distance from a cell, over its size, up to which it touches a point."""


@dataclass(frozen=True)
class PointValues:
    """Values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points as sparse rows; alike on every rank."""

    row: Ints  # (k,) row of each entry, 6 times the point's number plus the component's
    dof: Ints  # (k,) global degree of freedom
    value: Array  # (k,) coefficient
    # (6m, n_loads) part of each load with factor 1 beside the displacements: the stress that a
    # thermal strain takes away
    of_loads: Array


def point_values(bulk: Discretisation, points: Array, labels: list[str]) -> PointValues:
    """Return displacements and stresses at points (m, 2) of the modelled body; collective.

    Stresses jump from cell to cell: a point on several cells gets the mean over them. A point in no
    cell is an error, by its label.
    """
    found = on_all(bulk.comm, lambda: _in_own_cells(bulk, points))
    every = [part for parts in bulk.comm.allgather(found) for part in parts]
    count = np.bincount([part[0] for part in every], minlength=len(points))
    for point, label, n in zip(points, labels, count, strict=True):
        if n == 0:
            raise MeshMisfit(
                f"{label}: ({point[0]:g}, {point[1]:g}) lies outside the mesh of the body; move it "
                "inside"
            )
    rows = [np.repeat(6 * i + np.arange(6), len(dofs)) for i, dofs, _, _ in every]
    of_loads = np.zeros((len(points), 6, len(bulk.load_names)))
    for i, _, _, stress in every:
        of_loads[i, 2:] -= stress / count[i]
    return PointValues(
        np.concatenate(rows),
        np.concatenate([np.tile(dofs, 6) for _, dofs, _, _ in every]),
        np.concatenate([value.ravel() / count[i] for i, _, value, _ in every]),
        of_loads.reshape(6 * len(points), -1),
    )


def _in_own_cells(bulk: Discretisation, points: Array) -> list[tuple[int, Ints, Array, Array]]:
    """Return point, dofs, values (6, dofs) and thermal stresses of this rank's cells at points."""
    mesh, dofmap = bulk.body.mesh, bulk.space.dofmap
    owned = mesh.topology.index_map(2).size_local
    corners = mesh.geometry.x[_dolfinx.cell_nodes(mesh)[:owned], :2]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = CELL_TOLERANCE * (high - low).max(axis=1, initial=0.0)[:, None]
    cell_type, degree = bulk.body.cell, bulk.scene.mesh.degree
    midpoint = _dolfinx.reference_corners(cell_type).mean(axis=0)
    stiffness = stiffness_in(bulk.scene, bulk.body)
    found = []
    for i, point in enumerate(points):
        near = np.all((point >= low - slack) & (point <= high + slack), axis=1)
        for cell in np.flatnonzero(near):
            at = reference(cell_type, corners[cell], point)
            if at is None:
                continue
            local = dofmap.cell_dofs(int(cell))
            numbers = dofmap.index_map.local_to_global(local.astype(np.int32)).astype(np.int64)
            dofs = (2 * numbers[:, None] + np.arange(2)).ravel()
            shape, gradient = shape_functions(cell_type, degree, corners[cell], at)
            place = point if degree > 1 else mapped(cell_type, corners[cell], midpoint)[0]
            strain = thermal_strain(bulk.scene, bulk.load_names, place)
            C = stiffness if stiffness.ndim == 2 else stiffness[cell]
            stress = np.outer(unit_stress(C, bulk.scene.material), strain)
            found.append((i, dofs, _values(bulk, C, shape, gradient, point), stress))
    return found


def _values(bulk: Discretisation, C: Array, shape: Array, gradient: Array, point: Array) -> Array:
    """Return (6, 2n) values of a cell's degrees of freedom from its n shape functions."""
    n = len(shape)
    # gradients [xx, xy, yx, yy, zz] that each degree of freedom causes
    caused = np.zeros((n, 2, 5))
    caused[:, 0, :2], caused[:, 1, 2:4] = gradient, gradient
    if bulk.scene.axisymmetric:
        on_axis = abs(point[0]) <= POSITION_TOLERANCE * bulk.body.size
        caused[:, 0, 4] = gradient[:, 0] if on_axis else shape / point[0]
    values = np.zeros((6, 2 * n))
    values[0, ::2], values[1, 1::2] = shape, shape
    values[2:] = linear_stresses(C, caused).reshape(2 * n, 4).T
    return values


def mapped(cell: str, corners: Array, at: Array) -> tuple[Array, Array]:
    """Return the place of reference coordinates in a cell, and its Jacobian dx/dX."""
    value, slopes = _dolfinx.tabulated(cell, 1, at[None])
    return value[0] @ corners, (slopes[:, 0] @ corners).T


def reference(cell: str, corners: Array, point: Array) -> Array | None:
    """Return the reference coordinates of a point in a cell or on its boundary to round-off."""
    at = np.full(2, 0.5)
    # Newton's method; the map of a triangle is linear
    for _ in range(1 if cell == "triangle" else 20):
        place, jacobian = mapped(cell, corners, at)
        if np.linalg.det(jacobian) == 0.0:
            return None
        at = at + np.linalg.solve(jacobian, point - place)
    off = np.abs(mapped(cell, corners, at)[0] - point).max() / np.ptp(corners, axis=0).max()
    far = at.sum() if cell == "triangle" else at.max()
    return at if max(off, -at.min(), far - 1.0) <= CELL_TOLERANCE else None


def shape_functions(cell: str, degree: int, corners: Array, at: Array) -> tuple[Array, Array]:
    """Return values (n,) and gradients (n, 2) of a cell's shape functions at a reference point."""
    value, slopes = _dolfinx.tabulated(cell, degree, at[None])
    return value[0], slopes[:, 0].T @ np.linalg.inv(mapped(cell, corners, at)[1])
