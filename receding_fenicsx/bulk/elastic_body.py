r"""Discretised body as a part of a stack: condensed stiffness, fields, and rows of probes.

A displacement or stress at a point is $g \cdot u$, with few degrees of freedom in $g$
(`point_values`). With the interior $I$, the contact $C$ and
$u_I = A_{II}^{-1} (\sum_k \lambda_k f_{k,I} / E - A_{IC} u_C)$,

$$g \cdot u = (g_C - A_{CI} z) \cdot u_C + \sum_k \lambda_k\, z \cdot f_{k,I} / E,
  \qquad A_{II}\, z = g_I ,$$

so that each value costs one solve, made once, and none for each instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import (
    Bulk,
    Elimination,
    Solve,
    back_substitute,
    eliminate_interior,
    gather_contact,
    interior_solver,
    load_sign,
    times,
)
from receding_fenicsx.bulk.join_bodies import CondensedBody
from receding_fenicsx.bulk.loads import thermal_strain
from receding_fenicsx.bulk.material import linear_stresses, stiffness_in, unit_stress
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.stress import Stresses, stresses
from receding_fenicsx.bulk.symmetric_matrix import norm, turn
from receding_fenicsx.errors import MeshMisfit, SolveError
from receding_fenicsx.mpi import given, on_all, on_root

CELL_TOLERANCE = 1e-9
"""Distance from a cell, over its size, up to which it touches a point."""


@dataclass
class ElasticBody(Bulk):
    """The discretised body, with what a stack asks of its bodies; see :class:`stack.Body`."""

    def condensed(self) -> CondensedBody | None:
        """Condense the body, on rank 0; collective.

        Raises:
            SolveError: the factorisation failed, or K does not keep the rigid motions or does not
                agree with a solve; on all ranks.
        """
        eliminated = eliminate_interior(self)
        return on_root(self.comm, lambda: self._checked(eliminated))

    def _checked(self, eliminated: Elimination) -> CondensedBody:
        """Turn to [t; n] components, check, and scale by Young's modulus; on rank 0."""
        contact, K = self.contact, given(eliminated.K)
        turn(K, contact.to_local)
        scale = norm(K)
        if eliminated.probe is not None:
            u, force = (contact.to_local(part) for part in eliminated.probe)
            error = np.abs(K @ u - force).max() / (scale * np.abs(u).max())
            if not error <= 1e-10:
                raise SolveError(
                    f"the condensed stiffness is off by {error:.1e} from a solve (at most "
                    "1e-10): move Poisson's ratio off its limit, or mend the mesh"
                )
        error = np.abs(K @ contact.null).max(initial=0.0) / scale
        if not error <= 1e-12:
            raise SolveError(
                f"the condensed stiffness resists a rigid motion by {error:.1e} of its size "
                "(at most 1e-12); check the mesh for degenerate cells"
            )
        K *= self.young
        none = np.zeros(len(contact.held))
        return CondensedBody(
            K=K,
            r_star=contact.to_local(given(eliminated.held)).T.copy(),
            compliance=eliminated.compliance / self.young,
            sign=load_sign(self),
            held=contact.held,
            driven=np.array([self.driven.get(name, none) for name in self.load_names]).reshape(
                -1, len(none)
            ),
            modes=contact.modes,
            constraints=contact.constraints,
        )

    def fields(self, load: Array | None, u: Array | None) -> tuple[fem.Function, Stresses]:
        """Return displacement (of degree 1) and stresses for rank 0's factors and u; collective."""
        displacement = back_substitute(self, load, u)
        linear = fem.Function(_dolfinx.vector_space(self.body.mesh, 1), name="displacement")
        linear.interpolate(displacement)
        linear.x.scatter_forward()
        factors = np.asarray(self.comm.bcast(load), float)
        return linear, stresses(self, displacement, factors)

    def value_rows(self, points: Array, labels: list[str]) -> Array | None:
        """Return rows (m, 6, 2N + own loads) of the values at points on rank 0; collective.

        Points in the half that is not modelled get the values of their mirror image; on the axis
        of symmetry u_x and s_xy are zero. A point outside the body is an error, by its label.
        """
        mirrored = self.body.half and not self.scene.axisymmetric
        modelled = np.column_stack([np.abs(points[:, 0]), points[:, 1]]) if mirrored else points
        solve = interior_solver(self)
        values = point_values(self, modelled, labels)
        count = 6 * len(points)
        blocks = [
            self._rows(solve, values, (first, min(first + 64, count)))
            for first in range(0, count, 64)  # right-hand sides of one solve
        ]
        if self.comm.rank != 0:
            return None
        rows = np.vstack([given(block) for block in blocks]).reshape(len(points), 6, -1)
        if mirrored:
            # u_x and s_xy change their sign in the image
            near = POSITION_TOLERANCE * self.body.size
            sign = np.where(np.abs(points[:, 0]) <= near, 0.0, np.sign(points[:, 0]))
            rows[:, [0, 5]] *= sign[:, None, None]
        return rows

    def _rows(self, solve: Solve, values: PointValues, rows: tuple[int, int]) -> Array | None:
        """Return some rows of the matrix (n, 2N + loads) on rank 0, None elsewhere."""
        start, end = self.stiffness.getOwnershipRange()
        first, last = rows
        own = (values.row >= first) & (values.row < last)
        own &= (values.dof >= start) & (values.dof < end)
        g = np.zeros((end - start, last - first))
        np.add.at(g, (values.dof[own] - start, values.row[own] - first), values.value[own])
        if self.ties is not None:
            full, result = self.stiffness.createVecLeft(), self.stiffness.createVecRight()
            for column in g.T:
                full.getArray()[:] = column
                self.ties.multTranspose(full, result)
                column[:] = result.getArray(readonly=True)
            full.destroy()
            result.destroy()
        z = solve(g)
        of_loads = np.zeros((last - first, len(self.loads)))
        for k, (name, load) in enumerate(zip(self.load_names, self.loads, strict=True)):
            of_loads[:, k] = z.T @ load.getArray(readonly=True) / self.young
            if name in self.prescribed:
                of_loads[:, k] += g.T @ self.prescribed[name].getArray(readonly=True)
        of_loads = self.comm.allreduce(of_loads) + values.of_loads[first:last]
        of_contact = gather_contact(self, g - times(self.stiffness, z))
        if of_contact is None:
            return None
        return np.hstack([self.contact.to_local(of_contact).T, of_loads])


@dataclass(frozen=True)
class PointValues:
    """Values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points as sparse rows; alike on every rank.

    Attributes:
        row: (k,) row of each entry, 6 times the point's number plus the component's.
        dof: (k,) global degree of freedom.
        value: (k,) coefficient.
        of_loads: (6m, n_loads) part of each load with factor 1 beside the displacements: the stress
            that a thermal strain takes away.
    """

    row: Ints
    dof: Ints
    value: Array
    of_loads: Array


def point_values(bulk: Bulk, points: Array, labels: list[str]) -> PointValues:
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


def _in_own_cells(bulk: Bulk, points: Array) -> list[tuple[int, Ints, Array, Array]]:
    """Return point, dofs, values (6, dofs) and thermal stresses of this rank's cells at points."""
    mesh, dofmap = bulk.body.mesh, bulk.space.dofmap
    owned = mesh.topology.index_map(2).size_local
    corners = mesh.geometry.x[_dolfinx.cell_nodes(mesh)[:owned], :2]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = CELL_TOLERANCE * (high - low).max(axis=1, initial=0.0)[:, None]
    cell_type, degree = bulk.body.cell, bulk.scene.mesh.degree
    midpoint = _dolfinx.REFERENCE_CORNERS[cell_type].mean(axis=0)
    stiffness = stiffness_in(bulk.scene, bulk.body)
    found = []
    for i, point in enumerate(points):
        near = np.all((point >= low - slack) & (point <= high + slack), axis=1)
        for cell in np.flatnonzero(near):
            at = reference(cell_type, corners[cell], point)
            if not touches(cell_type, at):
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


def _values(bulk: Bulk, C: Array, shape: Array, gradient: Array, point: Array) -> Array:
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


def reference(cell: str, corners: Array, point: Array) -> Array:
    """Return the reference coordinates of a point of a cell; NaN where there are none."""
    at = np.full(2, 0.5)
    # Newton's method; the map of a triangle is linear
    for _ in range(1 if cell == "triangle" else 20):
        place, jacobian = mapped(cell, corners, at)
        if np.linalg.det(jacobian) == 0.0:
            return np.full(2, np.nan)
        at = at + np.linalg.solve(jacobian, point - place)
    off = np.abs(mapped(cell, corners, at)[0] - point).max()
    return at if off <= CELL_TOLERANCE * np.ptp(corners, axis=0).max() else np.full(2, np.nan)


def touches(cell: str, at: Array) -> bool:
    """Return whether reference coordinates lie in a cell, or on its boundary up to round-off."""
    inside = at.min() >= -CELL_TOLERANCE
    far = at.sum() if cell == "triangle" else at.max()
    return bool(inside and far <= 1.0 + CELL_TOLERANCE)


def shape_functions(cell: str, degree: int, corners: Array, at: Array) -> tuple[Array, Array]:
    """Return values (n,) and gradients (n, 2) of a cell's shape functions at a reference point."""
    value, slopes = _dolfinx.tabulated(cell, degree, at[None])
    return value[0], slopes[:, 0].T @ np.linalg.inv(mapped(cell, corners, at)[1])
