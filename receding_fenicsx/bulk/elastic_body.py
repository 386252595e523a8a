r"""Discretised body as a part of a stack: condensed stiffness, fields, and rows of probes.

A displacement or stress at a point is $g \cdot u$, with few degrees of freedom in $g$
(`probes.point_values`). With the interior $I$, the contact $C$ and
$u_I = A_{II}^{-1} (\sum_k \lambda_k f_{k,I} / E - A_{IC} u_C)$,

$$g \cdot u = (g_C - A_{CI} z) \cdot u_C + \sum_k \lambda_k\, z \cdot f_{k,I} / E,
  \qquad A_{II}\, z = g_I ,$$

so that each value costs one solve, made once, and none for each instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import (
    BLOCK_COLUMNS,
    Bulk,
    Elimination,
    Solve,
    back_substitute,
    block_solver,
    eliminate_interior,
    gather_contact,
    interior_solver,
    load_sign,
    times,
)
from receding_fenicsx.bulk.join_bodies import CondensedBody
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.probes import PointValues, point_values
from receding_fenicsx.bulk.stress import Stresses, stresses
from receding_fenicsx.bulk.symmetric_matrix import norm, turn
from receding_fenicsx.errors import SolveError
from receding_fenicsx.mpi import given, on_root


@dataclass
class ElasticBody(Bulk):
    """The discretised body, with what a stack asks of its bodies; see :class:`stack.Body`."""

    def condensed(self, route: str = "schur") -> CondensedBody | None:
        """Condense the body by the route "schur" or "solve"; on rank 0, None on the others.

        Raises:
            SolveError: the factorisation failed, or K does not keep the rigid motions or does not
                agree with a solve; on all ranks.
        """
        eliminated = eliminate_interior(self, route)
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
        """Return displacement (in the space of degree 1) and stresses; collective.

        Args:
            load: (n_loads,) factors of the body's loads; only rank 0's are used.
            u: (2N,) contact displacements [v; w]; only rank 0's are used.
        """
        displacement = back_substitute(self, load, u)
        linear = fem.Function(_dolfinx.vector_space(self.body.mesh, 1), name="displacement")
        linear.interpolate(displacement)
        linear.x.scatter_forward()
        factors = np.asarray(self.comm.bcast(load), float)
        return linear, stresses(self, displacement, factors)

    def value_rows(self, points: Array, labels: list[str]) -> Array | None:
        """Return rows (m, 6, 2N + own loads) of the values at points on rank 0; collective.

        Points in the half that is not modelled get the values of their mirror image; on the axis
        of symmetry u_x and s_xy are zero.

        Args:
            points: (m, 2) points of the whole body.
            labels: (m,) names of the points in messages.

        Raises:
            InputError: a point lies outside the body; on all ranks.
        """
        mirrored = self.body.half and not self.scene.axisymmetric
        modelled = np.column_stack([np.abs(points[:, 0]), points[:, 1]]) if mirrored else points
        if self.interior is None:
            self.interior = interior_solver(self)
        pc = self.interior.getPC()
        factor = pc.getFactorMatrix()
        solve = block_solver(self, factor)
        values = point_values(self, modelled, labels)
        count = 6 * len(points)
        blocks = [
            self._rows(solve, values, (first, min(first + BLOCK_COLUMNS, count)))
            for first in range(0, count, BLOCK_COLUMNS)
        ]
        for thing in (factor, pc):
            thing.destroy()
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
