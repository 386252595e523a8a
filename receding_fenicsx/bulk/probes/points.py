"""Displacements and stresses at points of a body, from its degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.stress import linear_stresses
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all

CELL_TOLERANCE = 1e-9
"""Distance from a cell, over its size, up to which it touches a point."""
NEWTON_STEPS = 20
"""Steps of Newton's method for reference coordinates in a quadrilateral."""


@dataclass(frozen=True)
class PointValues:
    """Values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points as sparse rows; alike on every rank.

    Attributes:
        row: (k,) row of each entry, 6 times the point's number plus the component's.
        dof: (k,) global degree of freedom.
        value: (k,) coefficient.
    """

    row: Ints
    dof: Ints
    value: Array


def point_values(bulk: Bulk, points: Array, labels: list[str]) -> PointValues:
    """Return displacements and stresses at points; collective.

    Stresses jump from cell to cell: a point on several cells gets the mean over them.

    Args:
        bulk: the body.
        points: (m, 2) points of the modelled body.
        labels: (m,) names of the points in messages.

    Returns:
        The rows of all points.

    Raises:
        InputError: a point lies in no cell; on all ranks.
    """
    found = on_all(bulk.comm, lambda: _in_own_cells(bulk, points))
    every = [part for parts in bulk.comm.allgather(found) for part in parts]
    count = np.bincount([i for i, _, _ in every], minlength=len(points))
    for point, label, n in zip(points, labels, count, strict=True):
        if n == 0:
            raise InputError(
                f"{label}: ({point[0]:g}, {point[1]:g}) lies outside the mesh of the body; move it "
                "inside"
            )
    rows = [np.repeat(6 * i + np.arange(6), len(dofs)) for i, dofs, _ in every]
    return PointValues(
        np.concatenate(rows),
        np.concatenate([np.tile(dofs, 6) for _, dofs, _ in every]),
        np.concatenate([value.ravel() / count[i] for i, _, value in every]),
    )


def _in_own_cells(bulk: Bulk, points: Array) -> list[tuple[int, Ints, Array]]:
    """Return point, global dofs and values (6, dofs) of each cell of this rank at each point."""
    mesh, dofmap = bulk.body.mesh, bulk.space.dofmap
    owned = mesh.topology.index_map(2).size_local
    width = len(_dolfinx.REFERENCE_CORNERS[bulk.body.cell])
    nodes = np.array([_dolfinx.cell_nodes(mesh, c) for c in range(owned)], dtype=np.int64)
    corners = mesh.geometry.x[nodes.reshape(owned, width), :2]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = CELL_TOLERANCE * (high - low).max(axis=1, initial=0.0)[:, None]
    coordinates = bulk.space.tabulate_dof_coordinates()[:, :2]
    found = []
    for i, point in enumerate(points):
        near = np.all((point >= low - slack) & (point <= high + slack), axis=1)
        for cell in np.flatnonzero(near):
            at = _reference(corners[cell], point)
            if not _touches(at, width):
                continue
            local = dofmap.cell_dofs(int(cell))
            numbers = dofmap.index_map.local_to_global(local.astype(np.int32)).astype(np.int64)
            dofs = (2 * numbers[:, None] + np.arange(2)).ravel()
            shape, gradient = _shape_functions(corners[cell], coordinates[local], at)
            found.append((i, dofs, _values(bulk, shape, gradient, point)))
    return found


def _values(bulk: Bulk, shape: Array, gradient: Array, point: Array) -> Array:
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
    values[2:] = linear_stresses(bulk.scene.material, caused).reshape(2 * n, 4).T
    return values


def _map(corners: Array, at: Array) -> tuple[Array, Array]:
    """Return the place of reference coordinates in a cell, and its Jacobian dx/dX."""
    first, along = corners[0], corners[1:3] - corners[0]
    if len(corners) == 3:
        return first + at @ along, along.T
    twist = corners[3] - corners[1] - corners[2] + first
    jacobian = np.column_stack([along[0] + at[1] * twist, along[1] + at[0] * twist])
    return first + at @ along + at[0] * at[1] * twist, jacobian


def _reference(corners: Array, point: Array) -> Array:
    """Return the reference coordinates of a point of a cell; NaN where there are none."""
    at = np.full(2, 0.5)
    for _ in range(1 if len(corners) == 3 else NEWTON_STEPS):
        place, jacobian = _map(corners, at)
        if np.linalg.det(jacobian) == 0.0:
            return np.full(2, np.nan)
        at = at + np.linalg.solve(jacobian, point - place)
    off = np.abs(_map(corners, at)[0] - point).max()
    return at if off <= CELL_TOLERANCE * np.ptp(corners, axis=0).max() else np.full(2, np.nan)


def _touches(at: Array, corners: int) -> bool:
    """Return whether reference coordinates lie in a cell, or on its boundary up to round-off."""
    inside = at.min() >= -CELL_TOLERANCE
    far = at.sum() if corners == 3 else at.max()
    return bool(inside and far <= 1.0 + CELL_TOLERANCE)


def _shape_functions(corners: Array, nodes: Array, at: Array) -> tuple[Array, Array]:
    """Return values (n,) and gradients (n, 2) of a cell's shape functions.

    They are the polynomials of the element's space that are 1 at one of its n nodes and 0 at the
    others.

    Args:
        corners: the cell's corners.
        nodes: (n, 2) coordinates of the nodes.
        at: reference coordinates.
    """
    powers = _powers(len(nodes), len(corners))
    reference = np.array([_reference(corners, node) for node in nodes])
    inverse = np.linalg.inv(_monomials(powers, reference))
    value = _monomials(powers, at[None])[0] @ inverse
    lowered = [np.maximum(powers - unit, 0) for unit in ([1, 0], [0, 1])]
    slopes = [powers[:, k] * _monomials(lowered[k], at[None])[0] for k in range(2)]
    _, jacobian = _map(corners, at)
    return value, (np.array(slopes) @ inverse).T @ np.linalg.inv(jacobian)


def _powers(nodes: int, corners: int) -> Ints:
    """Return the powers (n, 2) of the monomials that span an element's space."""
    degree = 1 if nodes == corners else 2
    every = np.indices((degree + 1, degree + 1)).reshape(2, -1).T
    return every[every.sum(axis=1) <= degree] if corners == 3 else every


def _monomials(powers: Ints, at: Array) -> Array:
    """Return the monomials (k, n) at k reference points."""
    return np.asarray(np.prod(at[:, None, :] ** powers, axis=2))
