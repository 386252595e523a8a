"""Plane linear elasticity: stiffness and loads, and back from the contact to fields.

The matrix A is assembled for Young's modulus 1 (it then depends on the mesh's shape and on
Poisson's ratio only) and without boundary conditions: E A u are the nodal forces that hold the
displacements u.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.boundary import ContactNodes, find_contact
from receding_fenicsx.bulk.loads import add_load
from receding_fenicsx.bulk.meshing import BodyMesh
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CORNERS = {
    "triangle": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "quadrilateral": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
}
"""Reference vertices of a cell, in DOLFINx's order."""
STRESSES = ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear")
"""Names of the stresses; "max_shear" is the largest shear in the plane."""


@dataclass
class Bulk:
    """The discretised body.

    Attributes:
        scene: what it was built from.
        body: its mesh.
        space: displacements.
        stiffness: A, for Young's modulus 1, without boundary conditions.
        load_names: names of the loads.
        loads: nodal forces of each load with factor 1.
        fixed: degrees of freedom off the contact that symmetry and supports hold, this rank's own
            by their global numbers.
        contact: the contact nodes.
        seconds: time spent on "forms" (compiling or loading them) and on "assemble".
        interior: solver with contact and supports held, made when first asked for.
    """

    scene: Scene
    body: BodyMesh
    space: fem.FunctionSpace
    stiffness: PETSc.Mat
    load_names: tuple[str, ...]
    loads: list[PETSc.Vec]
    fixed: Ints
    contact: ContactNodes
    seconds: dict[str, float] = field(default_factory=dict)
    interior: PETSc.KSP | None = None

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.body.mesh.comm

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
        for thing in (self.stiffness, self.interior, *self.loads):
            if thing is not None:
                thing.destroy()
        self.interior, self.loads = None, []


@dataclass(frozen=True)
class Stresses:
    """Stresses of a displacement field, each by its name in ``STRESSES``.

    Attributes:
        cell: piecewise constant functions: the stress at each cell's midpoint.
        nodal: continuous functions of degree 1: averages over the cells around a vertex.
    """

    cell: dict[str, fem.Function]
    nodal: dict[str, fem.Function]


def build(scene: Scene, body: BodyMesh, half: bool) -> Bulk:
    """Assemble the body's stiffness and loads, and find its contact nodes and supports.

    Args:
        scene: the scene.
        body: its mesh.
        half: the mesh is the half x >= 0, held at u_x = 0 on x = 0.

    Returns:
        The discretised body.

    Raises:
        InputError: a material, load or support that cannot be modelled; on all ranks.
    """
    if half != body.half:
        raise InputError(
            "build: the mesh is of the other kind (half or whole body); make it with the same `half`"
        )
    clock = time.perf_counter()
    lame = lame_constants(scene)
    if scene.mesh.degree not in (1, 2):
        raise InputError(f"mesh.degree = {scene.mesh.degree} is not available; use 1 or 2")
    space = _dolfinx.vector_space(body.mesh, scene.mesh.degree)
    form = stiffness_form(space, *lame)
    seconds = {"forms": time.perf_counter() - clock}

    clock = time.perf_counter()
    stiffness = _dolfinx.assemble_matrix(form)
    contact, held = find_contact(scene, space, body)
    start, end = stiffness.getOwnershipRange()
    fixed = held[(held >= start) & (held < end)]
    names = tuple(dict.fromkeys(load.name for load in scene.loads))
    loads = []
    for name in names:
        vector = stiffness.createVecLeft()
        vector.set(0.0)
        for load in scene.loads:
            if load.name == name:
                add_load(vector, space, body, load)
        loads.append(vector)
    seconds["assemble"] = time.perf_counter() - clock
    return Bulk(scene, body, space, stiffness, names, loads, fixed, contact, seconds)


def warm_up(comm: MPI.Comm, cell: str, degree: int) -> float:
    """Compile (or load from the cache) the forms for a cell and degree; return the seconds it took."""
    clock = time.perf_counter()
    around = [0, 1, 2] if cell == "triangle" else [0, 1, 3, 2]
    # one cell a rank: meshes with fewer cells than ranks cannot be partitioned everywhere
    one = 0 if comm.rank else comm.size
    points = np.concatenate(
        [CORNERS[cell] + [2.0 * i, 0.0] for i in range(one)] or [np.empty((0, 2))]
    )
    cells = np.array([np.add(around, len(around) * i) for i in range(one)], dtype=np.int64).reshape(
        -1, len(around)
    )
    space = _dolfinx.vector_space(_dolfinx.create_mesh(comm, cell, cells, points), degree)
    stiffness_form(space, 1.0, 1.0)
    return time.perf_counter() - clock


def lame_constants(scene: Scene) -> tuple[float, float]:
    """Return Lame's lambda and mu for E = 1; in plane stress, lambda as it acts in the plane."""
    material = scene.material
    nu = material.poisson
    if not material.young > 0.0:
        raise InputError(f"material.young = {material.young:g} must be positive")
    if not -1.0 < nu < 0.5:
        raise InputError(f"material.poisson = {nu:g} must lie between -1 and 0.5")
    mu = 0.5 / (1.0 + nu)
    if material.kinematics == "plane strain":
        return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), mu
    if material.kinematics == "plane stress":
        return nu / (1.0 - nu**2), mu
    raise InputError(
        f'material.kinematics = \'{material.kinematics}\' is not available; use "plane strain" or "plane stress"'
    )


def stiffness_form(space: fem.FunctionSpace, lam: float, mu: float) -> Any:
    """Compile a(u, v) = integral of σ(u) : ε(v)."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    λ, μ = fem.Constant(space.mesh, lam), fem.Constant(space.mesh, mu)

    def ε(u: Any) -> Any:
        """Return the strain ε of a displacement field."""
        return ufl.sym(ufl.grad(u))

    def σ(u: Any) -> Any:
        """Return the stress σ of a displacement field."""
        return λ * ufl.div(u) * ufl.Identity(2) + 2 * μ * ε(u)

    return _dolfinx.compile_form(ufl.inner(σ(u), ε(v)) * ufl.dx)


def back_substitute(bulk: Bulk, load: Array | None, u: Array | None) -> fem.Function:
    """Return the displacement field for load factors and contact displacements.

    With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C.

    Args:
        bulk: the body.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) contact displacements [v; w]; only rank 0's are used.

    Returns:
        The displacement, ghosts up to date.
    """
    load, u = bulk.comm.bcast((load, u), root=0)
    if bulk.interior is None:
        bulk.interior = interior_solver(bulk)
    held = bulk.stiffness.createVecRight()
    held.set(0.0)
    rhs = bulk.stiffness.createVecLeft()
    solution = bulk.stiffness.createVecRight()
    start = bulk.stiffness.getOwnershipRange()[0]
    dofs, places = owned_contact(bulk)
    held.getArray()[dofs - start] = bulk.contact.to_global(np.asarray(u, dtype=float))[places]
    bulk.stiffness.mult(held, rhs)
    rhs.scale(-1.0)
    for factor, vector in zip(np.asarray(load, dtype=float), bulk.loads, strict=True):
        rhs.axpy(factor / bulk.young, vector)
    rhs.getArray()[np.concatenate([bulk.fixed, dofs]) - start] = 0.0
    bulk.interior.solve(rhs, solution)
    solution.axpy(1.0, held)
    displacement = fem.Function(bulk.space, name="displacement")
    _dolfinx.owned_values(displacement)[:] = solution.getArray(readonly=True)
    displacement.x.scatter_forward()
    for vector in (held, rhs, solution):
        vector.destroy()
    return displacement


def reactions(bulk: Bulk, load: Array | None, displacement: fem.Function) -> Array | None:
    """Return the contact reactions [Q; P] of a displacement field on rank 0, None elsewhere.

    They are the nodal forces E A u less the loads: an independent check of r = sum lambda r* + K u.
    """
    load = bulk.comm.bcast(load, root=0)
    vector = bulk.stiffness.createVecRight()
    vector.getArray()[:] = _dolfinx.owned_values(displacement)
    force = bulk.stiffness.createVecLeft()
    bulk.stiffness.mult(vector, force)
    force.scale(bulk.young)
    for factor, nodal in zip(np.asarray(load, dtype=float), bulk.loads, strict=True):
        force.axpy(-factor, nodal)
    gathered = gather_contact(bulk, force.getArray(readonly=True)[:, None])
    vector.destroy()
    force.destroy()
    return None if gathered is None else bulk.contact.to_local(gathered[:, 0])


def stresses(bulk: Bulk, displacement: fem.Function) -> Stresses:
    """Return the stresses of a displacement field, at the midpoints of cells and averaged at vertices."""
    corners = CORNERS[bulk.body.cell]
    points = np.vstack([corners, corners.mean(axis=0)])
    gradient = _dolfinx.evaluate_in_cells(ufl.grad(displacement), points, bulk.space)
    constant = _dolfinx.scalar_space(bulk.body.mesh, "DG", 0)
    linear = _dolfinx.scalar_space(bulk.body.mesh, "Lagrange", 1)
    cells = range(len(gradient))
    cell_dofs = np.array([constant.dofmap.cell_dofs(c)[0] for c in cells], dtype=np.int32)
    vertex_dofs = np.array([linear.dofmap.cell_dofs(c) for c in cells], dtype=np.int32).reshape(
        -1, len(corners)
    )
    count = _sum_at_vertices(linear, vertex_dofs, np.ones(vertex_dofs.shape))
    in_cells, at_vertices = {}, {}
    for name, value in _components(bulk, gradient).items():
        in_cells[name] = fem.Function(constant, name=name)
        in_cells[name].x.array[cell_dofs] = value[:, -1]
        at_vertices[name] = fem.Function(linear, name=name)
        _dolfinx.owned_values(at_vertices[name])[:] = (
            _sum_at_vertices(linear, vertex_dofs, value[:, :-1]) / count
        )
        in_cells[name].x.scatter_forward()
        at_vertices[name].x.scatter_forward()
    return Stresses(in_cells, at_vertices)


def _components(bulk: Bulk, gradient: Array) -> dict[str, Array]:
    """Return each stress of ``STRESSES`` from displacement gradients (..., [xx, xy, yx, yy])."""
    material = bulk.scene.material
    lam, mu = (material.young * constant for constant in lame_constants(bulk.scene))
    exx, eyy = gradient[..., 0], gradient[..., 3]
    sxx = lam * (exx + eyy) + 2.0 * mu * exx
    syy = lam * (exx + eyy) + 2.0 * mu * eyy
    sxy = mu * (gradient[..., 1] + gradient[..., 2])
    szz = (
        material.poisson * (sxx + syy)
        if material.kinematics == "plane strain"
        else np.zeros_like(sxx)
    )
    pairs = (sxx - syy) ** 2 + (syy - szz) ** 2 + (szz - sxx) ** 2
    von_mises = np.sqrt(0.5 * pairs + 3.0 * sxy**2)
    max_shear = np.hypot(0.5 * (sxx - syy), sxy)
    return dict(zip(STRESSES, (sxx, syy, szz, sxy, von_mises, max_shear), strict=True))


def _sum_at_vertices(space: fem.FunctionSpace, local: NDArray[np.int32], values: Array) -> Array:
    """Sum values given cell by cell, over all ranks' cells, at this rank's own vertices."""
    index_map = space.dofmap.index_map
    total = PETSc.Vec().createMPI(
        (index_map.size_local, index_map.size_global), comm=space.mesh.comm
    )
    numbers = index_map.local_to_global(local.ravel()).astype(PETSc.IntType)
    total.setValues(numbers, values.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
    total.assemble()
    result = total.getArray().copy()
    total.destroy()
    return result


def interior_solver(bulk: Bulk) -> PETSc.KSP:
    """Return a factored solver for A with supports, symmetry and all contact nodes held."""
    matrix = constrained(bulk, np.concatenate([bulk.fixed, owned_contact(bulk)[0]]))
    solver = PETSc.KSP().create(bulk.comm)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    solver.setUp()
    matrix.destroy()
    return solver


def constrained(bulk: Bulk, held: Ints) -> PETSc.Mat:
    """Return a copy of A with the rows and columns of ``held`` (this rank's) replaced by the identity's."""
    matrix = bulk.stiffness.copy()
    matrix.zeroRowsColumns(held.astype(PETSc.IntType), diag=1.0)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    return matrix


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
