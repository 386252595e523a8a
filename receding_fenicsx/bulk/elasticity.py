"""Elastic constants, assembly of the stiffness matrix, stresses in cells, at vertices and points.

The matrix A is assembled for Young's modulus 1 (it then depends on the mesh's shape and on
Poisson's ratio only) and without boundary conditions: E A u are the nodal forces that hold the
displacements u. An axisymmetric body (x is r, y is z) is taken per radian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from scipy import sparse

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.mpi import given, on_all
from receding_fenicsx.scene.model import Load, Material, Scene
from receding_fenicsx.scene.profiles import evaluate_checked


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
    """Return the stresses of strains (..., 4); of (cells, ..., 4) if C is (cells, 4, 4)."""
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
    return _dolfinx.assemble_matrix((r * density if axisymmetric else density) * dx)


def warm_up() -> None:
    """Assemble the stiffness of a triangle, compile its form: a test of an installation."""
    corners = _dolfinx.reference_corners("triangle")
    mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "triangle", np.arange(3)[None], corners)
    C = stiffness_of(Material())
    stiffness_matrix(_dolfinx.vector_space(mesh, 1), C, axisymmetric=False).destroy()


# -- stresses -------------------------------------------------------------------------------------

STRESSES = ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear")
"""Names of the stresses; "max_shear" is the largest shear in the plane. In an axisymmetric body
"x" is r, "y" is z and "szz" the hoop stress."""


@dataclass
class Discretisation:
    """Scene of one body, its mesh, space of displacements, and names of its loads."""

    scene: Scene
    body: BodyMesh
    space: fem.FunctionSpace
    load_names: tuple[str, ...]

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.body.mesh.comm


@dataclass(frozen=True)
class Stresses:
    """Stresses of a displacement field, each by its name in ``STRESSES``."""

    # piecewise constant functions: the stress at each cell's midpoint
    cell: dict[str, fem.Function]
    # continuous functions of degree 1: averages over the cells around a vertex
    nodal: dict[str, fem.Function]


def thermal_strain(scene: Scene, load_names: tuple[str, ...], points: Array) -> Array:
    """Return the thermal strain (..., n_loads) of each load with factor 1 at points (..., 2)."""
    strain = np.zeros((*points.shape[:-1], len(load_names)))
    for load in scene.loads:
        if load.thermal_strain is not None:
            strain[..., load_names.index(load.name)] += strain_of(load, points)
    return strain


def strain_of(load: Load, points: Array) -> Array:
    """Return the thermal strain (...) of one load at points (..., 2)."""
    assert load.thermal_strain is not None
    x, y = np.moveaxis(points, -1, 0)
    return evaluate_checked(load.thermal_strain, x, y, f"{load.label} thermal_strain")


def _strains(bulk: Discretisation, gradient: Array, u_x: Array, r: Array | float) -> Array:
    """Return (..., [exx, eyy, ezz, 2 exy]) from du_i/dx_j (..., 2, 2), with u_x and x (...).

    In an axisymmetric body ezz is the hoop strain u_r / r, on the axis du_r/dr; else it is 0.
    """
    xx, yy = gradient[..., 0, 0], gradient[..., 1, 1]
    hoop = np.zeros_like(xx)
    if bulk.scene.axisymmetric:
        on_axis = np.abs(r) <= POSITION_TOLERANCE * bulk.body.size
        hoop = np.where(on_axis, xx, u_x / np.where(on_axis, 1.0, r))
    return np.stack([xx, yy, hoop, gradient[..., 0, 1] + gradient[..., 1, 0]], axis=-1)


def stresses(
    bulk: Discretisation, displacement: fem.Function, load: Array | None = None
) -> Stresses:
    """Return the stresses of a displacement field, at midpoints of cells and averaged at vertices.

    The load factors, on every rank, are needed where the body has a thermal strain.
    """
    cell, degree = bulk.body.cell, bulk.scene.mesh.degree
    vertices = _dolfinx.reference_corners(cell)
    at = np.vstack([vertices, vertices.mean(axis=0)])
    shape, slopes = _dolfinx.tabulated(cell, degree, at)
    points, jacobian = _dolfinx.mapped(cell, _dolfinx.cell_corners(bulk.body.mesh), at)
    u = displacement.x.array.reshape(-1, 2)[_dolfinx.cell_dofs(bulk.space)[: len(points)]]
    gradient = np.einsum("kqn,cni->cqik", slopes, u) @ np.linalg.inv(jacobian)
    strain = _strains(bulk, gradient, (shape @ u)[..., 0], points[..., 0])
    if any(part.thermal_strain is not None for part in bulk.scene.loads):
        # at order 1 that of the midpoint, the last one
        places = points[:, -1:] if degree == 1 else points
        thermal = thermal_strain(bulk.scene, bulk.load_names, places) @ given(load)
        strain = strain - thermal[..., None] * free_strain(bulk.scene.material)
    constant = _dolfinx.scalar_space(bulk.body.mesh, "DG", 0)
    linear = _dolfinx.scalar_space(bulk.body.mesh, "Lagrange", 1)
    cell_dofs = _dolfinx.cell_dofs(constant)[: len(points), 0]
    vertex_dofs = _dolfinx.cell_dofs(linear)[: len(points)]
    count = _dolfinx.sum_at_nodes(linear, vertex_dofs, np.ones(vertex_dofs.shape)).x.array
    in_cells, at_vertices = {}, {}
    components = np.moveaxis(linear_stresses(stiffness_in(bulk.scene, bulk.body), strain), -1, 0)
    for name, value in named_stresses(*components).items():
        in_cells[name] = fem.Function(constant, name=name)
        in_cells[name].x.array[cell_dofs] = value[:, -1]
        in_cells[name].x.scatter_forward()
        at_vertices[name] = _dolfinx.sum_at_nodes(linear, vertex_dofs, value[:, :-1], name)
        at_vertices[name].x.array[:] /= count
    return Stresses(in_cells, at_vertices)


def named_stresses(sxx: Array, syy: Array, szz: Array, sxy: Array) -> dict[str, Array]:
    """Return each stress of ``STRESSES`` from the components."""
    pairs = (sxx - syy) ** 2 + (syy - szz) ** 2 + (szz - sxx) ** 2
    von_mises = np.sqrt(0.5 * pairs + 3.0 * sxy**2)
    max_shear = np.hypot(0.5 * (sxx - syy), sxy)
    return dict(zip(STRESSES, (sxx, syy, szz, sxy, von_mises, max_shear), strict=True))


def point_values(
    bulk: Discretisation, points: Array, labels: list[str]
) -> tuple[sparse.csr_matrix, Array]:
    """Return rows of [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points (m, 2); collective.

    The rows are (6m, freedoms) and (6m, n_loads), the latter for the stress that a thermal strain
    takes away. Stresses jump from cell to cell: a point on several cells gets the mean over them. A
    point in no cell is an error, by its label.
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
    row = np.concatenate([np.repeat(6 * i + np.arange(6), len(dofs)) for i, dofs, _, _ in every])
    dof = np.concatenate([np.tile(dofs, 6) for _, dofs, _, _ in every])
    value = np.concatenate([value.ravel() / count[i] for i, _, value, _ in every])
    of_loads = np.zeros((len(points), 6, len(bulk.load_names)))
    for i, _, _, stress in every:
        of_loads[i, 2:] -= stress / count[i]
    shape = 6 * len(points), 2 * bulk.space.dofmap.index_map.size_global
    return sparse.csr_matrix((value, (row, dof)), shape), of_loads.reshape(6 * len(points), -1)


def _in_own_cells(bulk: Discretisation, points: Array) -> list[tuple[int, Ints, Array, Array]]:
    """Return point, dofs, values (6, dofs) and thermal stresses of this rank's cells at points."""
    corners = _dolfinx.cell_corners(bulk.body.mesh)
    numbers = _dolfinx.global_nodes(bulk.space, _dolfinx.cell_dofs(bulk.space)[: len(corners)])
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = 1e-9 * (high - low).max(axis=1, initial=0.0)[:, None]  # as in ``reference``
    kind, degree = bulk.body.cell, bulk.scene.mesh.degree
    midpoint = _dolfinx.reference_corners(kind).mean(axis=0)
    stiffness = stiffness_in(bulk.scene, bulk.body)
    found = []
    for i, point in enumerate(points):
        near = np.all((point >= low - slack) & (point <= high + slack), axis=1)
        for cell in np.flatnonzero(near):
            at = reference(kind, corners[cell], point)
            if at is None:
                continue
            shape, slopes = (part[..., 0, :] for part in _dolfinx.tabulated(kind, degree, at[None]))
            places, jacobian = _dolfinx.mapped(kind, corners[cell], np.stack([at, midpoint]))
            # what each degree of freedom (n, 2) causes
            gradient = np.einsum("ai,nk->naik", np.eye(2), slopes.T @ np.linalg.inv(jacobian[0]))
            strain = _strains(bulk, gradient, np.outer(shape, [1.0, 0.0]), point[0])
            C = stiffness if stiffness.ndim == 2 else stiffness[cell]
            n = len(shape)
            values = np.zeros((6, 2 * n))
            values[0, ::2], values[1, 1::2] = shape, shape
            values[2:] = linear_stresses(C, strain).reshape(2 * n, 4).T
            where = point if degree > 1 else places[1]
            thermal = thermal_strain(bulk.scene, bulk.load_names, where)
            stress = np.outer(linear_stresses(C, free_strain(bulk.scene.material)), thermal)
            dofs = (2 * numbers[cell][:, None] + np.arange(2)).ravel()
            found.append((i, dofs, values, stress))
    return found


def reference(cell: str, corners: Array, point: Array) -> Array | None:
    """Return the reference coordinates of a point in a cell or on its boundary to round-off."""
    at = np.full(2, 0.5)
    # Newton's method; the map of a triangle is linear
    for _ in range(1 if cell == "triangle" else 20):
        (place,), (jacobian,) = _dolfinx.mapped(cell, corners, at[None])
        if np.linalg.det(jacobian) == 0.0:
            return None
        at = at + np.linalg.solve(jacobian, point - place)
    off = _dolfinx.mapped(cell, corners, at[None])[0][0] - point
    far = at.sum() if cell == "triangle" else at.max()
    outside = max(np.abs(off).max() / np.ptp(corners, axis=0).max(), -at.min(), far - 1.0)
    return at if outside <= 1e-9 else None  # over the size of the cell
