"""Linear map whose inputs and outputs can be exchanged (principal pivoting).

The map is outputs = T [inputs, loads]: the last columns of T, those of the loads, are never
exchanged. To exchange output i with input j, solve row i for input j and insert the result into the
other rows: with the column C = T[:, j], the row R = T[i, :] and the pivot D = T[i, j], the new
matrix is

    T - (C + e_i) (R - e_j) / D,

a rank-one update. Updates are collected and applied by one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf, dgetrs

from receding_fenicsx.arrays import Array, Ints

MAX_PENDING = 32
"""Rank-one updates of T that are collected before they are applied."""

SINGULAR_PIVOT = 1e-11
"""Pivot, over a typical stiffness or compliance, up to which an exchange is singular."""

SINGULAR_ON_SPRINGS = 1e-14
"""The same where free rigid motions are pinned: soft springs may hold the body against others."""


class SingularExchange(Exception):
    """A change of state would leave a motion of the body without stiffness."""


@dataclass(frozen=True)
class PivotData:
    """Matrices and labels of a :class:`PivotMatrix`."""

    # (m, k + n_loads) outputs from inputs and unit loads; those that stay inputs may be left out
    T: Array
    row_label: Ints  # (m,) label of each output
    column_label: Ints  # (k,) label of each input
    age: int = 0  # exchanges since the matrix was made from scratch

    def without(self, inputs: Ints) -> PivotData:
        """Return the same without the columns of some inputs."""
        if not len(inputs):
            return self
        kept = ~np.isin(self.column_label, inputs)
        loads = np.ones(self.T.shape[1] - len(kept), dtype=bool)
        T = np.ascontiguousarray(self.T[:, np.append(kept, loads)])
        return replace(self, T=T, column_label=self.column_label[kept])


class PivotMatrix:
    """Outputs = T [inputs, loads], with rank-one updates of T pending.

    Attributes:
        T: (m, k + n_loads) outputs from inputs and unit loads, without the pending updates.
        row_label: (m,) label of each output.
        row_of, column_of: row or column of each label, -1 where the label has none.
        age: exchanges since the matrix was made from scratch.
    """

    def __init__(self, data: PivotData, n_labels: int, singular: float = SINGULAR_PIVOT) -> None:
        """Take over ``data``, whose labels are below ``n_labels``; see ``SINGULAR_PIVOT``."""
        m, k = data.T.shape
        self.singular = singular
        self.T = np.empty((m, k))
        self._flat = self.T.ravel()
        self.U, self.V = np.zeros((m, MAX_PENDING), order="F"), np.zeros((MAX_PENDING, k))
        self.pending = 0
        self.row_of = np.full(n_labels, -1, dtype=np.intp)
        self.column_of = np.full(n_labels, -1, dtype=np.intp)
        self.restore(data)

    def restore(self, data: PivotData) -> None:
        """Replace everything by a copy of ``data``."""
        np.copyto(self.T, data.T)
        self.row_label, self.column_label = data.row_label.copy(), data.column_label.copy()
        self.age = data.age
        self.pending = 0
        self.row_of[:] = self.column_of[:] = -1
        self.row_of[self.row_label] = np.arange(len(self.row_label))
        self.column_of[self.column_label] = np.arange(len(self.column_label))

    def exchange(self, outputs: Ints, inputs: Ints) -> bool:
        """Exchange outputs with as many inputs, given by their labels.

        With the pivot block D where their rows R and columns C meet, the blocks become D^-1, -D^-1
        R (the other columns), C D^-1 (the other rows) and T - C D^-1 R (the rest).
        """
        i, j, e = self.row_of[outputs], self.column_of[inputs], len(outputs)
        if np.any(j < 0):
            return False
        self.apply_pending()
        T = self.T
        R, C = T[i], T.take(j, axis=1)
        lu, piv, _ = dgetrf(R[:, j])
        size = np.abs(lu.diagonal())
        if size.min() <= self.singular * max(1.0, size.max()):
            return False
        inverse = dgetrs(lu, piv, np.eye(e))[0]
        # the blocks of T are made apart where many are exchanged
        if e <= 0.3 * min(T.shape):
            R = inverse @ R
            # T is row-major: its transpose is what BLAS sees as a column-major matrix
            dgemm(-1.0, R.T, C, beta=1.0, c=T.T, trans_b=1, overwrite_c=1)
            T[i], T[:, j] = -R, C @ inverse
            T[np.ix_(i, j)] = inverse
        else:
            other, kept = np.delete(np.arange(len(T)), i), np.delete(np.arange(T.shape[1]), j)
            # whole rows are moved in less time than single entries
            rest, C, change = T[other], C.take(other, axis=0), inverse @ R.take(kept, axis=1)
            R[:, kept], R[:, j] = -change, inverse
            rest[:, kept], rest[:, j] = rest.take(kept, axis=1) - C @ change, C @ inverse
            T[i], T[other] = R, rest
        self.row_label[i], self.column_label[j] = inputs, outputs
        self.row_of[outputs] = self.column_of[inputs] = -1
        self.row_of[inputs], self.column_of[outputs] = i, j
        self.age += e
        return True

    def of_loads(self, loads: Array) -> Array:
        """Return the outputs (m,) from loads (n_loads,)."""
        k, pending = len(self.column_label), self.pending
        out: Array = self.T[:, k:].dot(loads)
        if pending:
            out += self.U[:, :pending].dot(self.V[:pending, k:].dot(loads))
        return out

    def response(self, inputs: Ints, change: Array) -> Array:
        """Return the change (m,) of the outputs when the labelled inputs change, or several."""
        columns, k = self.column_of[inputs], self.pending
        if change.ndim > 1:
            small: Array = self.V[:k].take(columns, axis=1) @ change
            return self.T.take(columns, axis=1) @ change + self.U[:, :k] @ small
        x = np.zeros(self.T.shape[1])
        x[columns] = change
        return self.T @ x + self.U[:, :k] @ (self.V[:k] @ x)

    def apply_pending(self) -> None:
        """Apply the pending updates."""
        k = self.pending
        if k:
            # T is row-major: its transpose is what BLAS sees as a column-major matrix
            V_t, U = self.V[:k].T, self.U[:, :k]
            dgemm(1.0, V_t, U, beta=1.0, c=self.T.T, trans_b=1, overwrite_c=1)
            self.pending = 0
