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

ICNTL_ORDERING, ICNTL_WORKSPACE, ICNTL_SCHUR, ICNTL_SCHUR_SOLVE = 7, 14, 19, 26
"""Numbers of MUMPS's control parameters."""


def factorise(
    matrix: PETSc.Mat, contact: Ints, workspace: int = 20
) -> tuple[PETSc.PC, Array | None]:
    """Factorise the block A_II of a symmetric positive definite matrix; collective.

    Args:
        matrix: the matrix A = [[A_II, A_IC], [A_CI, A_CC]].
        contact: the variables C, alike on every rank.
        workspace: percentage by which MUMPS enlarges the workspace that it expects to need.

    Returns:
        The preconditioner that holds the factor of A_II (solutions are zero or garbage on C), and
        the Schur complement A_CC - A_CI A_II^-1 A_IC on rank 0.

    Raises:
        SolveError: MUMPS could not factorise; on all ranks.
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
    factor.setMumpsIcntl(ICNTL_ORDERING, 0)
    factor.setMumpsIcntl(ICNTL_WORKSPACE, workspace)
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
    factor.setMumpsIcntl(ICNTL_SCHUR_SOLVE, 0)
    # PETSc refuses solves on several ranks while a Schur complement is requested; MUMPS reads the
    # parameter only when it analyses the matrix
    factor.setMumpsIcntl(ICNTL_SCHUR, 0)
    where.destroy()
    factor.destroy()
    return pc, complement


def _complement(factor: PETSc.Mat, size: int, ranks: int) -> Array:
    """Copy the Schur complement out of a factor; MUMPS fills one triangle of it only."""
    matrix, status = ctypes.c_void_p(), ctypes.c_int()
    values = ctypes.POINTER(ctypes.c_double)()
    _call("MatFactorGetSchurComplement", factor.handle, ctypes.byref(matrix), ctypes.byref(status))
    _call("MatDenseGetArrayRead", matrix, ctypes.byref(values))
    # column by column in memory, so this is the transposed matrix
    complement = np.ctypeslib.as_array(values, (size, size)).copy()
    _call("MatDenseRestoreArrayRead", matrix, ctypes.byref(values))
    _call("MatFactorRestoreSchurComplement", factor.handle, ctypes.byref(matrix), status)
    symmetrise(complement, _triangle(ranks))
    return complement


def _triangle(ranks: int) -> str:
    """Return which triangle of the transposed complement is filled: measured, not documented."""
    return "upper" if ranks == 1 else "lower"


def _call(name: str, *arguments: Any) -> None:
    """Call a function of libpetsc, reached through petsc4py's module; its errors are raised."""
    handles = (ctypes.c_void_p(a) if isinstance(a, int) else a for a in arguments)
    code = getattr(ctypes.CDLL(PETSc.__file__), name)(*handles)
    if code:
        raise SolveError(f"PETSc's {name} failed with code {code}; report it")


# -- large symmetric matrices in place, tile by tile, without a second matrix ----------------------


def _slices(size: int) -> Iterator[slice]:
    # two tiles of 128 by 128 fit into a core's cache
    return (slice(first, min(first + 128, size)) for first in range(0, size, 128))


def symmetrise(K: Array, triangle: str | None = None) -> None:
    """Make a square matrix symmetric to the last bit, in place.

    ``triangle`` "lower" or "upper" replaces the other one; None takes the mean of both.
    """
    for rows in _slices(len(K)):
        for columns in _slices(rows.stop):
            below, above = K[rows, columns], K[columns, rows].T
            if triangle is None:
                tile = 0.5 * (below + above)
            elif rows == columns:
                tile = _mirrored(below, triangle)
            else:
                tile = (below if triangle == "lower" else above).copy()
            K[rows, columns] = tile
            K[columns, rows] = tile.T


def _mirrored(tile: Array, triangle: str) -> Array:
    part: Array = np.tril(tile) if triangle == "lower" else np.triu(tile)
    return part + part.T - np.diag(np.diagonal(part))


def turn(K: Array, to_local: Callable[[Array], Array]) -> None:
    """Replace a symmetric K by R K R^T to the last bit; ``to_local`` returns R times a matrix."""
    # no work where the rotation is the identity
    pattern = np.cos(1.0 + np.arange(len(K)) ** 2)
    if np.array_equal(to_local(pattern), pattern):
        return
    for part in _slices(len(K)):
        K[:, part] = to_local(K[:, part])
    for part in _slices(len(K)):
        K[part] = to_local(K[part].T).T
    symmetrise(K)


def norm(K: Array) -> float:
    """Return the largest row sum of |K|."""
    return max((float(np.abs(K[rows]).sum(axis=1).max()) for rows in _slices(len(K))), default=0.0)
