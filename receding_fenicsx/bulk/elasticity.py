"""Elastic constants of the plane and axisymmetric problems; assembly of the stiffness matrix.

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

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.scene.model import Material, Scene


def stiffness_of(material: Material) -> Array:
    """Return C (4, 4) in [sxx, syy, szz, sxy] = C [exx, eyy, ezz, 2 exy].

    In plane stress szz and ezz are left out, and Lame's lambda / E, nu / ((1 + nu)(1 - 2 nu)), is
    nu / (1 - nu^2). An orthotropic material has along its directions 1 and 2 the compliances
    1 / E_1, 1 / E_2, -nu_12 / E_1 and 1 / G_12.
    """
    plane, nu = material.kinematics == "plane stress", material.poisson
    C = np.zeros((4, 4))
    if material.young_2 is None or material.shear is None:
        mu = 0.5 / (1.0 + nu)
        lam = nu / (1.0 - nu**2) if plane else nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        C[:3, :3] = lam + 2.0 * mu * np.eye(3)
        C[3, 3] = mu
        C *= material.young
        if plane:
            C[2], C[:, 2] = 0.0, 0.0
        return C
    across = -nu / material.young
    soft = np.array([[1.0 / material.young, across], [across, 1.0 / material.young_2]])
    Q = np.zeros((3, 3))
    Q[:2, :2], Q[2, 2] = np.linalg.inv(soft), material.shear
    c, s = np.cos(np.radians(material.angle)), np.sin(np.radians(material.angle))
    # strains [11, 22, 2 12] from [xx, yy, 2 xy]
    turn = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    C[np.ix_([0, 1, 3], [0, 1, 3])] = turn.T @ Q @ turn
    return C


def stiffness_in(scene: Scene, body: BodyMesh) -> Array:
    """Return C (4, 4) of a body of one material, (owned cells, 4, 4) of one with several."""
    if body.materials is None:
        return stiffness_of(scene.material)
    return np.array([stiffness_of(material) for material in scene.materials])[body.materials]


def linear_stresses(C: Array, strain: Array) -> Array:
    """Return (..., [sxx, syy, szz, sxy]) from strains (..., [exx, eyy, ezz, 2 exy]).

    C is (4, 4), or (cells, 4, 4) for strains (cells, ..., 4).
    """
    if C.ndim == 2:
        return strain @ C.T
    return np.asarray(np.einsum("cij,c...j->c...i", C, strain))


def free_strain(material: Material) -> Array:
    """Return [exx, eyy, ezz, 2 exy] of a unit thermal strain.

    In plane stress the strain along z is free and does not enter. In plane strain and axisymmetric
    it does: in plane strain the stress then has the factor 1 + nu of its free strain in the plane.
    """
    return np.array([1.0, 1.0, float(material.kinematics != "plane stress"), 0.0])


def stiffness_matrix(space: fem.FunctionSpace, C: Array, axisymmetric: bool) -> PETSc.Mat:
    """Assemble a(u, v) = integral of C e(u) . e(v), axisymmetric times r; collective.

    The strains are e = [exx, eyy, ezz, 2 exy], C is (4, 4), or (owned cells, 4, 4). The hoop strain
    ezz = u_r / r has no polynomial; quadrature that is exact for the polynomial parts leaves the
    patch test exact, and its points lie off the axis.
    """
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    r = ufl.SpatialCoordinate(space.mesh)[0]
    if C.ndim == 2:
        # compiled without the products that vanish, unless shear is coupled
        c, coupled, n = fem.Constant(space.mesh, C), np.any(C[:3, 3]), range(4)
        used = [[c[i, j] if coupled or (i < 3) == (j < 3) else 0.0 for j in n] for i in n]
        stiffness = ufl.as_matrix(used)
    else:
        stiffness = _dolfinx.cell_tensor(space.mesh, C)

    def e(u: Any) -> Any:
        """Return the strains of a displacement field."""
        grad = ufl.grad(u)
        hoop = u[0] / r if axisymmetric else 0.0 * u[0]
        return ufl.as_vector([grad[0, 0], grad[1, 1], hoop, grad[0, 1] + grad[1, 0]])

    density = ufl.inner(ufl.dot(stiffness, e(u)), e(v))
    degree = len(space.dofmap.dof_layout.entity_closure_dofs(1, 0)) - 1
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 2} if axisymmetric else {})
    form = _dolfinx.compile_form((r * density if axisymmetric else density) * dx)
    return _dolfinx.assemble_matrix(form)


def warm_up() -> None:
    """Assemble the stiffness of a triangle, compile its form: a test of an installation."""
    corners = _dolfinx.reference_corners("triangle")
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "triangle", np.arange(3)[None], corners)
    C = stiffness_of(Material())
    stiffness_matrix(_dolfinx.vector_space(mesh, 1), C, axisymmetric=False).destroy()
