"""Assembly of the elastic stiffness matrix and the nodal forces of the loads.

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

from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import Bulk, times
from receding_fenicsx.bulk.closures import add_springs
from receding_fenicsx.bulk.contact_nodes import find_contact
from receding_fenicsx.bulk.loads import nodal_forces
from receding_fenicsx.bulk.material import lame_constants, stiffness_in
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.scene.model import Scene


def build(scene: Scene, body: BodyMesh) -> Bulk:
    """Assemble the body's stiffness and loads, and find its contact nodes and supports; collective.

    Args:
        scene: the scene of this body alone.
        body: its mesh; a half body is held at u_x = 0 on x = 0.
    """
    clock = time.perf_counter()
    space = _dolfinx.vector_space(body.mesh, scene.mesh.degree)
    if body.materials is None and scene.material.young_2 is None:
        form = stiffness_form(space, *lame_constants(scene.material), scene.axisymmetric)
    else:
        C = stiffness_in(scene, body) / scene.material.young
        form = general_form(space, _dolfinx.cell_tensor(body.mesh, C), scene.axisymmetric)
    seconds = {"forms": time.perf_counter() - clock}

    clock = time.perf_counter()
    stiffness = _dolfinx.assemble_matrix(form)
    resisted = add_springs(stiffness, space, body, scene)
    stiffness.assemble()
    contact, constraints = find_contact(scene, space, body, resisted)
    P = constraints.matrix(stiffness)
    names = tuple(dict.fromkeys(load.name for load in scene.applied))
    start, end = stiffness.getOwnershipRange()
    loads, moved = np.zeros((2, end - start, len(names)))
    total = stiffness.createVecLeft()
    for name, column in zip(names, loads.T, strict=True):
        total.set(0.0)
        for load in scene.applied:
            # the forces of a mode are known once the contact is
            if load.name == name and load.displacement is None and load.mode is None:
                nodes, forces = nodal_forces(space, body, scene, load)
                rows = (2 * nodes[:, :, None] + np.arange(2)).astype(PETSc.IntType)
                total.setValues(rows.ravel(), forces.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
                total.assemble()
        column[:] = total.getArray(readonly=True)
    total.destroy()
    if P is not None:
        untied, stiffness = stiffness, stiffness.PtAP(P)
        untied.destroy()
        loads = times(P, loads, transposed=True)
    driven = np.zeros((len(names), 2 * len(contact.node)))
    own = (constraints.given >= start) & (constraints.given < end)
    _, at, on = np.intersect1d(constraints.given, contact.dofs, return_indices=True)
    for name, values in constraints.prescribed.items():
        k = names.index(name)
        moved[constraints.given[own] - start, k] = values[own]
        driven[k, on] = values[at]
    pushed = [names.index(name) for name in constraints.prescribed]
    if pushed:
        loads[:, pushed] = -scene.material.young * times(stiffness, moved[:, pushed])
    off = np.union1d(np.setdiff1d(constraints.given, contact.dofs), constraints.slaves)
    seconds["assemble"] = time.perf_counter() - clock
    return Bulk(
        scene,
        body,
        space,
        names,
        stiffness=stiffness,
        loads=loads,
        moved=moved,
        sign=np.where(np.isin(np.arange(len(names)), pushed), 1.0, -1.0),
        fixed=off[(off >= start) & (off < end)],
        contact=contact,
        driven=contact.to_local(driven.T).T,
        ties=P,
        seconds=seconds,
    )


def warm_up(comm: MPI.Comm, cell: str, degree: int, axisymmetric: bool = False) -> float:
    """Compile or load the forms for a cell and degree; return the seconds that it took."""
    clock = time.perf_counter()
    corners = _dolfinx.reference_corners(cell)
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


def general_form(space: fem.FunctionSpace, C: fem.Function, axisymmetric: bool) -> Any:
    """Compile a(u, v) = integral of C e(u) . e(v), e = [exx, eyy, ezz, 2 exy], times r if round.

    C is (4, 4) in each cell; an axisymmetric body has the hoop strain ezz = u_r / r.
    """
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    r = ufl.SpatialCoordinate(space.mesh)[0]
    degree = len(space.dofmap.dof_layout.entity_closure_dofs(1, 0)) - 1
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 2} if axisymmetric else {})

    def e(u: Any) -> Any:
        """Return the strains of a displacement field."""
        grad = ufl.grad(u)
        hoop = u[0] / r if axisymmetric else 0.0 * u[0]
        return ufl.as_vector([grad[0, 0], grad[1, 1], hoop, grad[0, 1] + grad[1, 0]])

    density = ufl.inner(ufl.dot(C, e(u)), e(v))
    return _dolfinx.compile_form((r * density if axisymmetric else density) * dx)
