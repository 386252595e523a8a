"""Discretised body: stiffness, loads, contact nodes, elimination of the interior (eq. 11).

With A = [[A_II, A_IC], [A_CI, A_CC]] for the interior I and the contact C, and Young's modulus 1,

    K = A_CC - A_CI A_II^-1 A_IC,    r*_k = A_CI A_II^-1 f_k,I - f_k,C.

MUMPS forms K during its Cholesky factorisation of A, on any number of ranks. A displacement or
stress at a point is g . u, with few degrees of freedom in g (`elasticity.point_values`), so that

    g . u = (g_C - A_CI z) . u_C + sum_k lambda_k z . f_k,I / E,    A_II z = g_I:

each value costs one solve, made once, and none for each instant.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx, schur
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.bulk.elasticity import Discretisation, Stresses, point_values, stresses
from receding_fenicsx.bulk.join_bodies import CondensedBody
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.schur import norm, symmetrise, turn
from receding_fenicsx.errors import SolveError
from receding_fenicsx.mpi import given, on_root


@dataclass
class Bulk(Discretisation):
    """The discretised body."""

    # A, for Young's modulus 1, without boundary conditions; with platens P^T A P
    stiffness: PETSc.Mat
    # (own rows, n_loads) nodal forces of each load with factor 1, with platens P^T f; for a
    # prescribed displacement d, a column of ``moved``, the equivalent forces -E A d
    loads: Array
    moved: Array
    # (n_loads,) -1 for forces, +1 for prescribed displacements, 0 for loads on other bodies
    sign: Array
    # degrees of freedom off the contact that symmetry, supports, prescribed displacements or
    # platens determine: global numbers, this rank's own
    fixed: Ints
    contact: ContactNodes  # the contact nodes
    driven: Array  # (n_loads, 2N) displacements [v; w] that loads prescribe at contact nodes
    ties: PETSc.Mat | None = None  # P, when there are platens: u = P u'
    interior: PETSc.PC | None = None  # factor of A_II, or of A with its Schur complement; made once

    @property
    def half(self) -> bool:
        """Whether only x >= 0 is modelled; always for an axisymmetric body."""
        return self.body.half

    @property
    def young(self) -> float:
        """Young's modulus."""
        return self.scene.material.young

    @property
    def dofs(self) -> int:
        """Number of displacement degrees of freedom."""
        return self.stiffness.getSize()[0]

    def condensed(self) -> CondensedBody | None:
        """Condense the body, turned to [t; n], on rank 0; collective."""
        size = len(self.contact.dofs)
        # MUMPS wants a degree of freedom beside those of its Schur complement
        found = factorise(self) if self.dofs > size else _contact_forces(self, np.eye(size))
        x = solve_interior(self, self.loads)
        force = times(self.stiffness, x) - self.loads
        moved, sign = self.young * self.moved, self.sign
        own = np.where(sign[:, None] > 0.0, moved.T @ force, self.loads.T @ (x + moved))
        compliance = self.comm.allreduce(own)
        # symmetric among forces and among displacements, antisymmetric between them
        compliance = 0.5 * (compliance + np.outer(sign, sign) * compliance.T)
        held = gather_contact(self, force)
        u = np.cos(1.0 + np.arange(size) ** 2)
        probe = _contact_forces(self, u[:, None])

        def checked() -> CondensedBody:
            contact, K = self.contact, given(found)
            if self.dofs == size:
                symmetrise(K)
            turn(K, contact.to_local)
            scale = norm(K)
            force = contact.to_local(given(probe)[:, 0])
            error = np.abs(K @ contact.to_local(u) - force).max() / (scale * np.abs(u).max())
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
            r_star = contact.to_local(given(held)).T.copy()
            more = contact.held, self.driven, contact.modes, contact.constraints
            return CondensedBody(K, r_star, compliance / self.young, sign, *more)

        return on_root(self.comm, checked)

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
        start, end = self.stiffness.getOwnershipRange()
        own, thermal = point_values(self, modelled, labels)
        own, blocks = own[:, start:end], []
        for first in range(0, len(thermal), 64):  # right-hand sides of one solve
            part = slice(first, first + 64)
            g = own[part].T.toarray()
            if self.ties is not None:
                g = times(self.ties, g, transposed=True)
            z = solve_interior(self, g)
            of_loads = self.comm.allreduce(z.T @ self.loads / self.young + g.T @ self.moved)
            of_contact = gather_contact(self, g - times(self.stiffness, z))
            if of_contact is not None:
                of_contact = self.contact.to_local(of_contact).T
                blocks.append(np.hstack([of_contact, of_loads + thermal[part]]))
        if self.comm.rank != 0:
            return None
        rows = np.vstack(blocks).reshape(len(points), 6, -1)
        if mirrored:
            # u_x and s_xy change their sign in the image
            near = POSITION_TOLERANCE * self.body.size
            sign = np.where(np.abs(points[:, 0]) <= near, 0.0, np.sign(points[:, 0]))
            rows[:, [0, 5]] *= sign[:, None, None]
        return rows

    def append_loads(self, names: tuple[str, ...], nodes: Ints, forces: Array) -> None:
        """Append loads with forces (n, 2, k) at nodes (n,)."""
        start, end = self.stiffness.getOwnershipRange()
        rows = (2 * nodes[:, None] + np.arange(2)).ravel()
        own = (rows >= start) & (rows < end)
        columns = np.zeros((end - start, len(names)))
        columns[rows[own] - start] = forces.reshape(-1, len(names))[own]
        if self.ties is not None:
            columns = times(self.ties, columns, transposed=True)
        self.load_names += names
        self.loads = np.hstack([self.loads, columns])
        self.moved = np.hstack([self.moved, 0.0 * columns])
        self.sign = np.append(self.sign, -np.ones(len(names)))
        self.driven = np.vstack([self.driven, np.zeros((len(names), self.driven.shape[1]))])

    def destroy(self) -> None:
        """Free PETSc's objects; on all ranks together."""
        for thing in (self.stiffness, self.interior, self.ties):
            if thing is not None:
                thing.destroy()
        self.interior, self.ties = None, None


def factorise(bulk: Bulk) -> Array | None:
    """Factorise A_II; return K (2N, 2N) of [x; y] for E = 1 on rank 0; collective."""
    if bulk.interior is not None:
        bulk.interior.destroy()
    matrix = bulk.stiffness.copy()
    matrix.zeroRowsColumns(bulk.fixed.astype(PETSc.IntType), diag=1.0)
    bulk.interior, K = schur.factorise(matrix, bulk.contact.dofs)
    # petsc4py frees its objects only by destroy()
    matrix.destroy()
    return K


def solve_interior(bulk: Bulk, columns: Array) -> Array:
    """Solve A_II x_I = b_I for the columns of b, each rank giving its own rows; 0 elsewhere.

    A_II is factorised first, if condensing has not done so; collective.
    """
    # MUMPS wants one right-hand side at least
    if bulk.dofs == len(bulk.contact.dofs) or not columns.shape[1]:
        return np.zeros_like(columns)
    if bulk.interior is None:
        factorise(bulk)
    off = np.concatenate(
        [bulk.fixed - bulk.stiffness.getOwnershipRange()[0], owned_contact(bulk)[0]]
    )
    rhs = _dense(bulk.stiffness, columns)
    rhs.getDenseArray()[off] = 0.0
    rhs.assemble()
    x = rhs.duplicate()
    x.assemble()
    factor = given(bulk.interior).getFactorMatrix()
    factor.matSolve(rhs, x)
    solution = np.array(x.getDenseArray(readonly=True))
    solution[off] = 0.0
    for thing in (factor, rhs, x):
        thing.destroy()
    return solution


def owned_contact(bulk: Bulk) -> tuple[Ints, Ints]:
    """Return this rank's rows of contact degrees of freedom and their places in [u_x; u_y]."""
    start, end = bulk.stiffness.getOwnershipRange()
    dofs = bulk.contact.dofs
    places = np.flatnonzero((dofs >= start) & (dofs < end))
    return dofs[places] - start, places


def gather_contact(bulk: Bulk, rows: Array) -> Array | None:
    """Gather the contact rows of (owned rows, n) values on rank 0 as (2N, n), [u_x; u_y]."""
    own, places = owned_contact(bulk)
    parts = bulk.comm.gather((places, rows[own]), root=0)
    if parts is None:
        return None
    gathered = np.zeros((len(bulk.contact.dofs), rows.shape[1]))
    for where, part in parts:
        gathered[where] = part
    return gathered


def _contact_forces(bulk: Bulk, u: Array) -> Array | None:
    """Return K u (2N, n; rank 0) by solves."""
    rows, places = owned_contact(bulk)
    x = np.zeros((len(bulk.loads), u.shape[1]))
    x[rows] = u[places]
    force = times(bulk.stiffness, x)
    return gather_contact(bulk, force - times(bulk.stiffness, solve_interior(bulk, force)))


def times(matrix: PETSc.Mat, columns: Array, transposed: bool = False) -> Array:
    """Multiply a matrix by columns, each rank giving and getting its own rows."""
    if not columns.shape[1]:
        return columns
    right = _dense(matrix, columns)
    left = (matrix.transposeMatMult if transposed else matrix.matMult)(right)
    product = np.array(left.getDenseArray(readonly=True))
    left.destroy()
    right.destroy()
    return product


def _dense(matrix: PETSc.Mat, columns: Array) -> PETSc.Mat:
    """Return columns, each rank giving its own rows, as a PETSc matrix."""
    sizes = (matrix.getSizes()[0], (None, columns.shape[1]))
    dense = PETSc.Mat().createDense(sizes, comm=matrix.comm)
    dense.setUp()
    dense.getDenseArray()[:] = columns
    dense.assemble()
    return dense


def back_substitute(bulk: Bulk, load: Array | None, u: Array | None) -> fem.Function:
    """Return the displacement field for load factors and contact displacements, ghosts up to date.

    With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C; prescribed
    displacements are added, and platens take their nodes along. Of ``load`` and ``u`` (2N,) only
    rank 0's are used.
    """
    factors, contact = (np.asarray(x, float)[:, None] for x in bulk.comm.bcast((load, u), root=0))
    rows, places = owned_contact(bulk)
    held = np.zeros((len(bulk.loads), 1))
    held[rows] = bulk.contact.to_global(contact)[places]
    forces = bulk.loads @ factors / bulk.young - times(bulk.stiffness, held)
    moved = solve_interior(bulk, forces) + held + bulk.moved @ factors
    if bulk.ties is not None:
        moved = times(bulk.ties, moved)
    displacement = fem.Function(bulk.space, name="displacement")
    _dolfinx.owned_values(displacement)[:] = moved[:, 0]
    displacement.x.scatter_forward()
    return displacement
