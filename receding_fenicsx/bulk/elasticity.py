"""Assembly of the elastic stiffness matrix and the nodal forces of the loads.

The matrix A is assembled for Young's modulus 1 (it then depends on the mesh's shape and on
Poisson's ratio only) and without boundary conditions: E A u are the nodal forces that hold the
displacements u. An axisymmetric body (x is r, y is z) is taken per radian.
"""

from __future__ import annotations

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


def build(scene: Scene, body: BodyMesh, names: tuple[str, ...] | None = None) -> Bulk:
    """Assemble the body's stiffness and loads, and find its contact nodes and supports; collective.

    ``scene`` is that of this body alone, ``names`` those of the loads on all bodies. A half body is
    held at u_x = 0 on x = 0.
    """
    names = scene.load_names if names is None else names
    space = _dolfinx.vector_space(body.mesh, scene.mesh.degree)
    if body.materials is None and scene.material.young_2 is None:
        form = stiffness_form(space, *lame_constants(scene.material), scene.axisymmetric)
    else:
        C = stiffness_in(scene, body) / scene.material.young
        form = general_form(space, _dolfinx.cell_tensor(body.mesh, C), scene.axisymmetric)
    stiffness = _dolfinx.assemble_matrix(form)
    resisted = add_springs(stiffness, space, body, scene)
    stiffness.assemble()
    contact, constraints = find_contact(scene, space, body, resisted)
    P = constraints.matrix(stiffness)
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
    acting = [load.name for load in scene.applied]
    off = np.union1d(np.setdiff1d(constraints.given, contact.dofs), constraints.slaves)
    return Bulk(
        scene,
        body,
        space,
        names,
        stiffness=stiffness,
        loads=loads,
        moved=moved,
        sign=np.where(np.isin(np.arange(len(names)), pushed), 1.0, -1.0 * np.isin(names, acting)),
        fixed=off[(off >= start) & (off < end)],
        contact=contact,
        driven=contact.to_local(driven.T).T,
        ties=P,
    )


def warm_up() -> None:
    """Compile the form of linear triangles, or load it: a test of an installation."""
    corners = _dolfinx.reference_corners("triangle")
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "triangle", np.arange(3)[None], corners)
    stiffness_form(_dolfinx.vector_space(mesh, 1), 1.0, 1.0)


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
