"""Static condensation of the body onto its contact nodes (eqs. 11 and 12).

With the contact C and the interior I, and forces r of the plane on the body,

    K = A_CC - A_CI A_II^-1 A_IC,    r*_k = A_CI A_II^-1 f_k,I - f_k,C.

MUMPS forms K during its Cholesky factorisation of A (route "schur"), on any number of ranks.
petsc4py does not wrap that part of PETSc, so its C functions are called through ctypes. Route
"solve" needs nothing but a factorisation of A_II and is slower: a fallback and a check. There is
no ordering to choose: with a Schur complement MUMPS 5.5 takes minimum degree whatever it is told.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.bulk.body import (
    Bulk,
    constrained,
    gather_contact,
    interior_solver,
    owned_contact,
)
from receding_fenicsx.errors import InputError, SolveError, on_root
from receding_fenicsx.interface.contact import ContactSystem
from receding_fenicsx.scene import evaluate
from receding_fenicsx.scene_file import to_toml

Array = NDArray[np.float64]

RIGID_TOLERANCE = 1e-12
"""Largest force of a rigid motion over the largest row sum of |K|."""
PROBE_TOLERANCE = 1e-10
"""Largest error of K times a probe, found by a solve, over the largest row sum of |K|."""
BLOCK = 64
"""Right-hand sides solved for together."""


def condense(bulk: Bulk, route: str = "schur") -> ContactSystem | None:
    """Condense the body to its contact nodes.

    Args:
        bulk: the discretised body.
        route: "schur" or "solve".

    Returns:
        The condensed system on rank 0, None on the others.

    Raises:
        SolveError: the factorisation failed, or K does not keep the rigid motions or does not agree
            with a solve; on all ranks.
    """
    if route not in ("schur", "solve"):
        raise InputError(f'route = \'{route}\' is unknown; use "schur" or "solve"')
    condensed = _by_schur(bulk) if route == "schur" else _by_solves(bulk)
    return on_root(bulk.comm, lambda: _system(bulk, condensed))


@dataclass(frozen=True)
class Condensed:
    """What a route gives, in [x; y] components and for E = 1; arrays of the contact on rank 0 only.

    Attributes:
        K: (2N, 2N) stiffness.
        held: (2N, n_loads) reactions r* to the loads, all contact nodes held.
        compliance: (n_loads, n_loads) displacement of load k under load l, contact nodes held.
        probe: contact displacements u and the forces K u, found by a solve.
    """

    K: Array | None
    held: Array | None
    compliance: Array
    probe: tuple[Array, Array] | None = None


def _system(bulk: Bulk, condensed: Condensed) -> ContactSystem:
    """Turn components, check, scale by Young's modulus, add the contact's data; on rank 0."""
    contact = bulk.contact
    assert condensed.K is not None and condensed.held is not None
    K = contact.to_local(contact.to_local(condensed.K).T)
    K = 0.5 * (K + K.T)
    scale = np.abs(K).sum(axis=1).max()
    if condensed.probe is not None:
        u, force = (contact.to_local(part) for part in condensed.probe)
        error = np.abs(K @ u - force).max() / (scale * np.abs(u).max())
        if not error <= PROBE_TOLERANCE:
            raise SolveError(
                f'the condensed stiffness is off by {error:.1e} from a solve; use route "solve"'
            )
    error = np.abs(K @ contact.null).max(initial=0.0) / scale
    if not error <= RIGID_TOLERANCE:
        raise SolveError(
            f"the condensed stiffness resists a rigid motion by {error:.1e} of its size "
            f"(at most {RIGID_TOLERANCE:g}); check the mesh for degenerate cells"
        )
    description = bulk.scene.contacts[0]
    f, g0 = evaluate(description.friction, contact.x), evaluate(description.initial_gap, contact.x)
    for key, values in (("friction", f), ("initial_gap", g0)):
        if np.any(values < 0.0):
            i = int(np.argmin(values))
            raise InputError(
                f"contact.{key} is {values[i]:g} at x = {contact.x[i]:g}; it must not be negative"
            )
    return ContactSystem(
        x=contact.x,
        points=contact.points,
        weight=contact.weight,
        K=bulk.young * K,
        r_star=contact.to_local(condensed.held).T.copy(),
        load_names=bulk.load_names,
        f=f,
        g0=g0,
        held=contact.held,
        rigid=contact.rigid,
        half=bulk.body.half and not bulk.scene.axisymmetric,
        axisymmetric=bulk.scene.axisymmetric,
        load_compliance=condensed.compliance / bulk.young,
        load_sign=-np.ones(len(bulk.loads)),
        scene_toml=to_toml(bulk.scene),
    )


def _held_response(bulk: Bulk, solve: Any) -> tuple[Array | None, Array]:
    """Return the loads' reactions (2N, n_loads; rank 0) and compliance, all contact nodes held.

    Args:
        bulk: the body.
        solve: function (rhs, x) that solves A_II x_I = rhs_I, with x_C = 0.
    """
    n = len(bulk.loads)
    start = bulk.stiffness.getOwnershipRange()[0]
    off = np.concatenate([bulk.fixed, owned_contact(bulk)[0]]) - start
    rhs, x, force = (bulk.stiffness.createVecLeft() for _ in range(3))
    rows = np.zeros((rhs.getLocalSize(), n))
    compliance = np.zeros((n, n))
    for k, load in enumerate(bulk.loads):
        load.copy(rhs)
        rhs.getArray()[off] = 0.0
        solve(rhs, x)
        bulk.stiffness.mult(x, force)
        force.axpy(-1.0, load)
        rows[:, k] = force.getArray(readonly=True)
        compliance[:, k] = [other.dot(x) for other in bulk.loads]
    for vector in (rhs, x, force):
        vector.destroy()
    return gather_contact(bulk, rows), 0.5 * (compliance + compliance.T)


def _by_schur(bulk: Bulk) -> Condensed:
    """Condense by the Schur complement that MUMPS makes."""
    supported = bulk.comm.allreduce(len(bulk.fixed)) > 0
    matrix = constrained(bulk, bulk.fixed) if supported else bulk.stiffness
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    pc = PETSc.PC().create(bulk.comm)
    pc.setOperators(matrix)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    # MUMPS in PETSc wants all of them on rank 0
    indices = bulk.contact.dofs if bulk.comm.rank == 0 else np.empty(0)
    where = PETSc.IS().createGeneral(indices.astype(PETSc.IntType), comm=bulk.comm)
    _call("MatFactorSetSchurIS", factor.handle, where.handle)
    failure: PETSc.Error | None = None
    try:
        pc.setUp()
    except PETSc.Error as caught:
        failure = caught
    if failure is not None or factor.getMumpsInfog(1) < 0:
        raise SolveError(
            f"MUMPS could not factorise the stiffness (INFOG(1) = {factor.getMumpsInfog(1)}, "
            f"INFOG(2) = {factor.getMumpsInfog(2)}); check the supports and the memory"
        ) from failure
    K = on_root(bulk.comm, lambda: _schur_complement(factor, len(indices), bulk.comm.size))
    factor.setMumpsIcntl(26, 0)  # solve with A_II alone
    held, compliance = _held_response(bulk, factor.solve)
    probe = _probe(bulk, matrix, factor.solve)
    for thing in (where, factor, pc, *([matrix] if supported else [])):
        thing.destroy()
    return Condensed(K, held, compliance, probe)


def _probe(bulk: Bulk, matrix: PETSc.Mat, solve: Any) -> tuple[Array, Array] | None:
    """Return contact displacements u and the forces K u by a solve, [x; y], on rank 0."""
    start = matrix.getOwnershipRange()[0]
    dofs, places = owned_contact(bulk)
    u = np.cos(1.0 + np.arange(len(bulk.contact.dofs)) ** 2)
    x, rhs, inner = (matrix.createVecLeft() for _ in range(3))
    x.set(0.0)
    x.getArray()[dofs - start] = u[places]
    matrix.mult(x, rhs)
    rhs.getArray()[dofs - start] = 0.0
    solve(rhs, inner)
    x.axpy(-1.0, inner)
    matrix.mult(x, rhs)
    force = gather_contact(bulk, rhs.getArray(readonly=True)[:, None])
    for vector in (x, rhs, inner):
        vector.destroy()
    return None if force is None else (u, force[:, 0])


def _by_solves(bulk: Bulk) -> Condensed:
    """Condense by solves with A_II for blocks of right-hand sides."""
    solver = interior_solver(bulk)
    pc = solver.getPC()
    factor = pc.getFactorMatrix()
    start = bulk.stiffness.getOwnershipRange()[0]
    dofs, places = owned_contact(bulk)
    off = np.concatenate([bulk.fixed, dofs]) - start
    size = len(bulk.contact.dofs)
    K = np.zeros((size, size))
    sizes = bulk.stiffness.getSizes()[0]
    for first in range(0, size, BLOCK):
        columns = np.arange(first, min(first + BLOCK, size))
        unit = PETSc.Mat().createDense((sizes, len(columns)), comm=bulk.comm)
        unit.setUp()
        inside = (places >= columns[0]) & (places <= columns[-1])
        unit.getDenseArray()[dofs[inside] - start, places[inside] - first] = 1.0
        unit.assemble()
        force = bulk.stiffness.matMult(unit)
        direct = force.getDenseArray().copy()
        rhs = force.duplicate(copy=True)
        rhs.getDenseArray()[off] = 0.0
        rhs.assemble()
        inner = rhs.duplicate()
        inner.assemble()
        factor.matSolve(rhs, inner)
        back = bulk.stiffness.matMult(inner)
        gathered = gather_contact(bulk, direct - back.getDenseArray())
        if gathered is not None:
            K[:, columns] = gathered
        for thing in (unit, force, rhs, inner, back):
            thing.destroy()
    held, compliance = _held_response(bulk, solver.solve)
    for thing in (factor, pc, solver):
        thing.destroy()
    return Condensed(K, held, compliance)


@cache
def _library() -> ctypes.CDLL:
    """Return libpetsc, reached through petsc4py's module, with the functions used here declared."""
    library = ctypes.CDLL(PETSc.__file__)
    pointer = ctypes.c_void_p
    for name, arguments in {
        "MatFactorSetSchurIS": [pointer, pointer],
        "MatFactorGetSchurComplement": [
            pointer,
            ctypes.POINTER(pointer),
            ctypes.POINTER(ctypes.c_int),
        ],
        "MatFactorRestoreSchurComplement": [pointer, ctypes.POINTER(pointer), ctypes.c_int],
        "MatDenseGetArrayRead": [pointer, ctypes.POINTER(ctypes.POINTER(ctypes.c_double))],
        "MatDenseRestoreArrayRead": [pointer, ctypes.POINTER(ctypes.POINTER(ctypes.c_double))],
    }.items():
        function = getattr(library, name)
        function.argtypes = arguments
        function.restype = ctypes.c_int
    return library


def _call(name: str, *arguments: Any) -> None:
    """Call a function of PETSc and raise when it reports an error."""
    code = getattr(_library(), name)(*arguments)
    if code:
        raise SolveError(f'PETSc\'s {name} failed with code {code}; use the route "solve"')


def _schur_complement(factor: PETSc.Mat, size: int, ranks: int) -> Array:
    """Copy the Schur complement out of a factor; MUMPS fills one triangle of it only."""
    matrix, status = ctypes.c_void_p(), ctypes.c_int()
    values = ctypes.POINTER(ctypes.c_double)()
    _call("MatFactorGetSchurComplement", factor.handle, ctypes.byref(matrix), ctypes.byref(status))
    _call("MatDenseGetArrayRead", matrix, ctypes.byref(values))
    by_column = np.ctypeslib.as_array(values, (size, size)).T.copy()
    _call("MatDenseRestoreArrayRead", matrix, ctypes.byref(values))
    _call("MatFactorRestoreSchurComplement", factor.handle, ctypes.byref(matrix), status)
    # measured, not documented: the lower triangle on one rank, the upper one on more
    triangle = np.tril(by_column) if ranks == 1 else np.triu(by_column)
    return triangle + triangle.T - np.diag(np.diagonal(triangle))
