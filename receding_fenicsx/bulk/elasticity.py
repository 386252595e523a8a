"""Linear elasticity: stiffness and loads, and back from the contact to the displacement.

The matrix A is assembled for Young's modulus 1 (it then depends on the mesh's shape and on
Poisson's ratio only) and without boundary conditions: E A u are the nodal forces that hold the
displacements u. An axisymmetric body (x is r, y is z) is taken per radian.
"""

from __future__ import annotations

import time
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import Bulk, gather_contact, interior_solver, owned_contact
from receding_fenicsx.bulk.contact_nodes import find_contact
from receding_fenicsx.bulk.loads import add_load
from receding_fenicsx.bulk.material import lame_constants
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.platens import Prescribed, find_prescribed, find_ties, tie_matrix
from receding_fenicsx.bulk.stress import STRESSES, Stresses, stresses
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene

__all__ = [
    "STRESSES",
    "Bulk",
    "Stresses",
    "back_substitute",
    "build",
    "reactions",
    "stiffness_form",
    "stresses",
    "warm_up",
]

Array = NDArray[np.float64]


def build(scene: Scene, body: BodyMesh, half: bool) -> Bulk:
    """Assemble the body's stiffness and loads, and find its contact nodes and supports.

    Args:
        scene: the scene.
        body: its mesh.
        half: the mesh is the half x >= 0, held at u_x = 0 on x = 0; always so for an axisymmetric
            rectangle.

    Returns:
        The discretised body.

    Raises:
        InputError: a material, load or support that cannot be modelled; on all ranks.
    """
    if half != body.half:
        raise InputError("build: the mesh is that of the other kind (half or whole body)")
    clock = time.perf_counter()
    lame = lame_constants(scene.material)
    if scene.mesh.degree not in (1, 2):
        raise InputError(f"mesh.degree = {scene.mesh.degree} is not available; use 1 or 2")
    space = _dolfinx.vector_space(body.mesh, scene.mesh.degree)
    form = stiffness_form(space, *lame, scene.axisymmetric)
    seconds = {"forms": time.perf_counter() - clock}

    clock = time.perf_counter()
    stiffness = _dolfinx.assemble_matrix(form)
    ties = find_ties(scene, space, body)
    given = find_prescribed(scene, space, body, ties)
    contact, held = find_contact(scene, space, body, ties, given.values())
    start, end = stiffness.getOwnershipRange()
    fixed = held[(held >= start) & (held < end)]
    P = tie_matrix(stiffness, ties)
    if P is not None:
        tied = stiffness.PtAP(P)
        stiffness.destroy()
        stiffness = tied
    names = tuple(dict.fromkeys(load.name for load in scene.loads))
    loads = {name: stiffness.createVecLeft() for name in names}
    for vector in loads.values():
        vector.set(0.0)
    for load in scene.loads:
        if load.displacement is None:
            add_load(loads[load.name], space, body, scene, load)
            if P is not None:
                _tie_forces(P, loads[load.name])
    prescribed = {}
    for name, part in given.items():
        prescribed[name] = _vector(stiffness, part)
        stiffness.mult(prescribed[name], loads[name])
        loads[name].scale(-scene.material.young)
    seconds["assemble"] = time.perf_counter() - clock
    return Bulk(
        scene,
        body,
        space,
        stiffness,
        names,
        list(loads.values()),
        fixed,
        contact,
        prescribed=prescribed,
        ties=P,
        seconds=seconds,
    )


def _vector(stiffness: PETSc.Mat, prescribed: Prescribed) -> PETSc.Vec:
    """Return a prescribed displacement, zero elsewhere."""
    vector = stiffness.createVecRight()
    vector.set(0.0)
    start, end = stiffness.getOwnershipRange()
    own = (prescribed.dofs >= start) & (prescribed.dofs < end)
    vector.getArray()[prescribed.dofs[own] - start] = prescribed.values[own]
    return vector


def _tie_forces(P: PETSc.Mat, vector: PETSc.Vec) -> None:
    """Replace nodal forces f by P^T f."""
    force = vector.copy()
    P.multTranspose(force, vector)
    force.destroy()


def warm_up(comm: MPI.Comm, cell: str, degree: int, axisymmetric: bool = False) -> float:
    """Compile (or load from the cache) the forms for a cell and degree.

    Args:
        comm: communicator.
        cell: "triangle" or "quadrilateral".
        degree: degree of the displacement.
        axisymmetric: in cylindrical coordinates.

    Returns:
        Seconds that it took.
    """
    clock = time.perf_counter()
    corners = _dolfinx.REFERENCE_CORNERS[cell]
    n = len(corners)
    # a cell for each rank, given by rank 0
    count = 0 if comm.rank else comm.size
    shifted = [corners + np.array([2.0 * i, 0.0]) for i in range(count)]
    points = np.vstack([np.empty((0, 2)), *shifted])
    # the order around a cell is its own inverse
    around = np.array(_dolfinx.TENSOR_ORDER[cell], dtype=np.int64)
    cells = around + n * np.arange(count, dtype=np.int64)[:, None]
    space = _dolfinx.vector_space(_dolfinx.create_mesh(comm, cell, cells, points), degree)
    stiffness_form(space, 1.0, 1.0, axisymmetric)
    return time.perf_counter() - clock


def stiffness_form(
    space: fem.FunctionSpace, lam: float, mu: float, axisymmetric: bool = False
) -> Any:
    """Compile a(u, v) = integral of σ(u) : ε(v), axisymmetric with the hoop strain u_r/r, times r.

    The hoop strain has no polynomial; quadrature that is exact for the polynomial parts leaves the
    patch test exact, and its points lie off the axis.
    """
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    λ, μ = fem.Constant(space.mesh, lam), fem.Constant(space.mesh, mu)

    def ε(u: Any) -> Any:
        """Return the strain ε of a displacement field."""
        return ufl.sym(ufl.grad(u))

    def σ(u: Any) -> Any:
        """Return the stress σ of a displacement field."""
        return λ * ufl.div(u) * ufl.Identity(2) + 2 * μ * ε(u)

    if not axisymmetric:
        return _dolfinx.compile_form(ufl.inner(σ(u), ε(v)) * ufl.dx)

    r = ufl.SpatialCoordinate(space.mesh)[0]
    degree = len(space.dofmap.dof_layout.entity_closure_dofs(1, 0)) - 1
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 2})
    hoop_u, hoop_v = u[0] / r, v[0] / r
    dilation_u, dilation_v = ufl.div(u) + hoop_u, ufl.div(v) + hoop_v
    shear = 2 * μ * (ufl.inner(ε(u), ε(v)) + hoop_u * hoop_v)
    return _dolfinx.compile_form((λ * dilation_u * dilation_v + shear) * r * dx)


def back_substitute(bulk: Bulk, load: Array | None, u: Array | None) -> fem.Function:
    """Return the displacement field for load factors and contact displacements.

    With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C; prescribed
    displacements are added, and platens take their nodes along.

    Args:
        bulk: the body.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) contact displacements [v; w]; only rank 0's are used.

    Returns:
        The displacement, ghosts up to date.
    """
    factors, contact = bulk.comm.bcast((load, u), root=0)
    if bulk.interior is None:
        bulk.interior = interior_solver(bulk)
    held, solution = bulk.stiffness.createVecRight(), bulk.stiffness.createVecRight()
    held.set(0.0)
    start = bulk.stiffness.getOwnershipRange()[0]
    dofs, places = owned_contact(bulk)
    held.getArray()[dofs - start] = bulk.contact.to_global(np.asarray(contact, float))[places]
    rhs = bulk.stiffness.createVecLeft()
    bulk.stiffness.mult(held, rhs)
    rhs.scale(-1.0)
    for factor, vector in zip(np.asarray(factors, float), bulk.loads, strict=True):
        rhs.axpy(factor / bulk.young, vector)
    rhs.getArray()[np.concatenate([bulk.fixed, dofs]) - start] = 0.0
    bulk.interior.solve(rhs, solution)
    solution.axpy(1.0, held)
    for name, factor in zip(bulk.load_names, np.asarray(factors, float), strict=True):
        if name in bulk.prescribed:
            solution.axpy(factor, bulk.prescribed[name])
    if bulk.ties is not None:
        solution.copy(held)
        bulk.ties.mult(held, solution)
    displacement = fem.Function(bulk.space, name="displacement")
    _dolfinx.owned_values(displacement)[:] = solution.getArray(readonly=True)
    displacement.x.scatter_forward()
    for vector in (held, rhs, solution):
        vector.destroy()
    return displacement


def reactions(bulk: Bulk, load: Array | None, displacement: fem.Function) -> Array | None:
    """Return the contact reactions [Q; P] of a displacement field.

    They are the nodal forces E A u less the loads: an independent check of
    r = sum lambda r* + K u.

    Args:
        bulk: the body.
        load: (n_loads,) load factors; only rank 0's are used.
        displacement: field in the body's space.

    Returns:
        (2N,) reactions on rank 0, None elsewhere.
    """
    factors = bulk.comm.bcast(load, root=0)
    vector, force = bulk.stiffness.createVecRight(), bulk.stiffness.createVecLeft()
    vector.getArray()[:] = _dolfinx.owned_values(displacement)
    bulk.stiffness.mult(vector, force)
    force.scale(bulk.young)
    for name, factor, nodal in zip(
        bulk.load_names, np.asarray(factors, float), bulk.loads, strict=True
    ):
        # a prescribed displacement is in the field already
        if name not in bulk.prescribed:
            force.axpy(-factor, nodal)
    gathered = gather_contact(bulk, force.getArray(readonly=True)[:, None])
    vector.destroy()
    force.destroy()
    return None if gathered is None else bulk.contact.to_local(gathered[:, 0])
