"""Discretised body: stiffness, loads, contact nodes, and the solver of the interior."""

from __future__ import annotations

from dataclasses import dataclass, field

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.scene.model import Scene


@dataclass
class Bulk:
    """The discretised body.

    Attributes:
        scene: what it was built from.
        body: its mesh.
        space: displacements.
        stiffness: A, for Young's modulus 1, without boundary conditions; with platens P^T A P.
        load_names: names of the loads.
        loads: nodal forces of each load with factor 1, with platens P^T f; for a prescribed
            displacement d the equivalent forces -E A d.
        fixed: degrees of freedom off the contact that symmetry, supports, prescribed displacements
            or platens determine: global numbers, this rank's own.
        contact: the contact nodes.
        prescribed: prescribed displacement d with factor 1, by the name of its load.
        ties: P, when there are platens: u = P u'.
        seconds: time spent on "forms" (compiling or loading them) and on "assemble".
        law: what turns shortenings of bolts into forces, on rank 0, once the body is ``condensed``.
        interior: solver with contact and supports held, made at its first use.
    """

    scene: Scene
    body: BodyMesh
    space: fem.FunctionSpace
    stiffness: PETSc.Mat
    load_names: tuple[str, ...]
    loads: list[PETSc.Vec]
    fixed: Ints
    contact: ContactNodes
    prescribed: dict[str, PETSc.Vec] = field(default_factory=dict)
    ties: PETSc.Mat | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    interior: PETSc.KSP | None = None
    law: tuple[Array, Array] | None = None
    condensed: bool = False

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.body.mesh.comm

    @property
    def parts(self) -> tuple[Bulk, ...]:
        """The modelled bodies: this one."""
        return (self,)

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

    def destroy(self) -> None:
        """Free PETSc's objects; on all ranks together."""
        parts = (self.stiffness, self.interior, self.ties, *self.loads, *self.prescribed.values())
        for thing in parts:
            if thing is not None:
                thing.destroy()
        self.interior, self.ties, self.loads, self.prescribed = None, None, [], {}


def constrained(bulk: Bulk, held: Ints) -> PETSc.Mat:
    """Return a copy of A with identity rows and columns for ``held`` (this rank's own)."""
    matrix = bulk.stiffness.copy()
    matrix.zeroRowsColumns(held.astype(PETSc.IntType), diag=1.0)
    return matrix


def interior_solver(bulk: Bulk) -> PETSc.KSP:
    """Return a factored solver for A with supports, symmetry and all contact nodes held."""
    matrix = constrained(bulk, np.concatenate([bulk.fixed, owned_contact(bulk)[0]]))
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(bulk.comm)
    solver.setOperators(matrix)
    solver.setType("preonly")
    pc = solver.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    solver.setUp()
    # petsc4py frees its objects only by destroy()
    pc.destroy()
    matrix.destroy()
    return solver


def owned_contact(bulk: Bulk) -> tuple[Ints, Ints]:
    """Return this rank's contact degrees of freedom (global) and their places in [u_x; u_y]."""
    start, end = bulk.stiffness.getOwnershipRange()
    dofs = bulk.contact.dofs
    places = np.flatnonzero((dofs >= start) & (dofs < end))
    return dofs[places], places


def gather_contact(bulk: Bulk, rows: Array) -> Array | None:
    """Gather the contact rows of (owned rows, n) values on rank 0 as (2N, n), [u_x; u_y]."""
    dofs, places = owned_contact(bulk)
    start = bulk.stiffness.getOwnershipRange()[0]
    parts = bulk.comm.gather((places, rows[dofs - start]), root=0)
    if parts is None:
        return None
    gathered = np.zeros((len(bulk.contact.dofs), rows.shape[1]))
    for where, part in parts:
        gathered[where] = part
    return gathered
