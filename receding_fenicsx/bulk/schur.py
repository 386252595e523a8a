"""Schur complement of a symmetric matrix by MUMPS's Cholesky factorisation.

petsc4py does not wrap this part of PETSc, so its C functions are called through ctypes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import SolveError
from receding_fenicsx.mpi import on_root


def factorise(
    matrix: PETSc.Mat, contact: Ints, workspace: int = 20
) -> tuple[PETSc.PC, Array | None]:
    """Factorise the block A_II of a symmetric positive definite matrix; collective.

    The variables C of the other block are ``contact``, alike on every rank; MUMPS enlarges the
    workspace that it expects to need by a percentage. Returned are the preconditioner that holds
    the factor (solutions are zero or garbage on C), and A_CC - A_CI A_II^-1 A_IC on rank 0.
    """
    comm: MPI.Comm = matrix.comm.tompi4py()
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    pc = PETSc.PC().create(comm)
    pc.setOperators(matrix)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    # PETSc wants all of them on rank 0
    indices = contact if comm.rank == 0 else contact[:0]
    where = PETSc.IS().createGeneral(indices.astype(PETSc.IntType), comm=comm)
    _call("MatFactorSetSchurIS", factor.handle, where.handle)
    # minimum degree, which MUMPS 5.5 always uses with a Schur complement. MUMPS 5.8 would choose
    # METIS: 1.5 times as long for uniform squares (641 nodes), as long for graded triangles
    ordering, enlarge, schur, schur_solve = 7, 14, 19, 26  # numbers of MUMPS's controls
    factor.setMumpsIcntl(ordering, 0)
    factor.setMumpsIcntl(enlarge, workspace)
    failure: PETSc.Error | None = None
    try:
        pc.setUp()
    except PETSc.Error as caught:
        failure = caught
    # too small a workspace, as for few variables beside many of the complement
    if factor.getMumpsInfog(1) in (-8, -9) and workspace < 1000:
        for thing in (where, factor, pc):
            thing.destroy()
        return factorise(matrix, contact, 5 * workspace)
    if failure is not None or factor.getMumpsInfog(1) < 0:
        raise SolveError(
            f"MUMPS could not factorise the stiffness (INFOG(1) = {factor.getMumpsInfog(1)}, "
            f"INFOG(2) = {factor.getMumpsInfog(2)}); check the supports and the memory"
        ) from failure
    complement = on_root(comm, lambda: _complement(factor, len(contact), comm.size))
    factor.setMumpsIcntl(schur_solve, 0)
    # PETSc refuses solves on several ranks while a Schur complement is requested; MUMPS reads the
    # parameter only when it analyses the matrix
    factor.setMumpsIcntl(schur, 0)
    where.destroy()
    factor.destroy()
    return pc, complement


def _complement(factor: PETSc.Mat, size: int, ranks: int) -> Array:
    """Copy the Schur complement out of a factor; MUMPS fills one triangle of it."""
    matrix, status = ctypes.c_void_p(), ctypes.c_int()
    values = ctypes.POINTER(ctypes.c_double)()
    _call("MatFactorGetSchurComplement", factor.handle, ctypes.byref(matrix), ctypes.byref(status))
    _call("MatDenseGetArrayRead", matrix, ctypes.byref(values))
    # column by column in memory, so this is the transposed matrix
    complement = np.ctypeslib.as_array(values, (size, size)).copy()
    _call("MatDenseRestoreArrayRead", matrix, ctypes.byref(values))
    _call("MatFactorRestoreSchurComplement", factor.handle, ctypes.byref(matrix), status)
    # MUMPS fills the upper triangle of the transposed matrix on one rank, the lower one on
    # several: measured, not documented
    filled = complement if ranks == 1 else complement.T
    for row in range(size):
        filled[row + 1 :, row] = filled[row, row + 1 :]
    return complement


def _call(name: str, *arguments: Any) -> None:
    """Call a function of libpetsc, reached through petsc4py's module; its errors are raised."""
    handles = (ctypes.c_void_p(a) if isinstance(a, int) else a for a in arguments)
    code = getattr(ctypes.CDLL(PETSc.__file__), name)(*handles)
    if code:
        raise SolveError(f"PETSc's {name} failed with code {code}; report it")


# -- large symmetric matrices in place, part by part, without a second matrix ----------------------


def _parts(size: int) -> Iterator[slice]:
    return (slice(first, first + 128) for first in range(0, size, 128))


def symmetrise(K: Array) -> None:
    """Make a square matrix symmetric to the last bit, in place: the mean of both triangles."""
    for part in _parts(len(K)):
        rest = slice(part.start, None)
        mean = 0.5 * (K[part, rest] + K[rest, part].T)
        K[part, rest], K[rest, part] = mean, mean.T


def turn(K: Array, to_local: Callable[[Array], Array]) -> None:
    """Replace a symmetric K by R K R^T to the last bit; ``to_local`` returns R times a matrix."""
    # no work where the rotation is the identity
    pattern = np.cos(1.0 + np.arange(len(K)) ** 2)
    if np.array_equal(to_local(pattern), pattern):
        return
    for part in _parts(len(K)):
        K[:, part] = to_local(K[:, part])
    for part in _parts(len(K)):
        K[part] = to_local(K[part].T).T
    symmetrise(K)


def norm(K: Array) -> float:
    """Return the largest row sum of |K|."""
    return max((float(np.abs(K[part]).sum(axis=1).max()) for part in _parts(len(K))), default=0.0)
