"""Linear map whose inputs and outputs can be exchanged (principal pivoting).

The map is outputs = T [inputs, loads]: the last columns of T, those of the loads, are never
exchanged. To exchange output i with input j, solve row i for input j and insert the result into the
other rows: with the column C = T[:, j], the row R = T[i, :] and the pivot D = T[i, j], the new
matrix is

    T - (C + e_i) (R - e_j) / D,

a rank-one update. Updates are collected (:func:`~receding_fenicsx.interface.exact.kernel.exchanged`
makes them) and applied by one matrix product.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf, dgetrs

from receding_fenicsx.arrays import Array, Ints

SINGULAR_PIVOT = 1e-11
"""Pivot, over a typical stiffness or compliance, up to which an exchange is singular."""

SINGULAR_ON_SPRINGS = 1e-14
"""The same where free rigid motions are pinned: soft springs may hold the body against others."""


class SingularExchange(Exception):
    """A change of state would leave a motion of the body without stiffness."""


class Matrix(NamedTuple):
    """Outputs = (T + U^T V) [inputs, loads], its updates U^T V pending; changed in place."""

    T: Array  # (m, k + n_loads)
    # U, V: (p, m) and (p, k + n_loads), of which ``counts[0]`` rows are in use
    U: Array
    V: Array
    counts: Ints  # numbers of pending updates and of exchanges, and whether ``rate`` is up to date
    rate: Array  # (m,) rates of the outputs along the leg
    # row_label, column_label: labels of the m outputs and of the k inputs; those that stay inputs
    # may be left out
    row_label: Ints
    column_label: Ints
    # row_of, column_of: where each label is, -1 where the label has no row or column
    row_of: Ints
    column_of: Ints
    state: NDArray[np.int8]  # (N,) states of the nodes
    unit: float  # by which displacements are multiplied
    singular: float  # smallest pivot
    oldest: int  # exchanges after which it is to be made anew


def exchange(matrix: Matrix, outputs: Ints, inputs: Ints) -> bool:
    """Exchange outputs with as many inputs, given by their labels; False where that is singular.

    With the pivot block D where their rows R and columns C meet, the blocks become D^-1, -D^-1 R
    (the other columns), C D^-1 (the other rows) and T - C D^-1 R (the rest).
    """
    i, j, e = matrix.row_of[outputs], matrix.column_of[inputs], len(outputs)
    if np.any(j < 0):
        return False
    apply_pending(matrix)
    T = matrix.T
    R, C = T[i], T.take(j, axis=1)
    lu, piv, _ = dgetrf(R[:, j])
    size = np.abs(lu.diagonal())
    if size.min() <= matrix.singular * max(1.0, size.max()):
        return False
    inverse = dgetrs(lu, piv, np.eye(e))[0]
    R = inverse @ R
    # T is row-major: its transpose is what BLAS sees as a column-major matrix
    dgemm(-1.0, R.T, C, beta=1.0, c=T.T, trans_b=1, overwrite_c=1)
    T[i], T[:, j] = -R, C @ inverse
    T[np.ix_(i, j)] = inverse
    matrix.row_label[i], matrix.column_label[j] = inputs, outputs
    matrix.row_of[outputs] = matrix.column_of[inputs] = -1
    matrix.row_of[inputs], matrix.column_of[outputs] = i, j
    matrix.counts[1] += e
    return True


def outputs_of(matrix: Matrix, x: Array) -> Array:
    """Return the outputs (m,) of inputs and loads x (k + n_loads,)."""
    k = matrix.counts[0]
    outputs: Array = matrix.T @ x + matrix.U[:k].T @ (matrix.V[:k] @ x)
    return outputs


def apply_pending(matrix: Matrix) -> None:
    """Apply the pending updates."""
    k = matrix.counts[0]
    if k:
        # T is row-major: its transpose is what BLAS sees as a column-major matrix
        V_t, U = matrix.V[:k].T, matrix.U[:k].T
        dgemm(1.0, V_t, U, beta=1.0, c=matrix.T.T, trans_b=1, overwrite_c=1)
        matrix.counts[0] = 0
