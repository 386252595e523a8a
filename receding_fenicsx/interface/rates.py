"""Rates of a contact whose states are given: a tableau that follows each change of state by pivots.

Each frictional node has four quantities, v, w, A = Q + f P and B = f P - Q. In every state two of
them are inputs with zero rate and two are outputs:

    state            inputs   outputs (and what keeps the state)
    stick            v, w     A >= 0, B >= 0
    forward slip     A, w     rate of v >= 0, B >= 0
    backward slip    B, w     A >= 0, rate of v <= 0
    separation       A, B     v, gap >= 0

so a change of state exchanges one input with one output (stick to separation: two of each), a
rank-one update of the tableau that maps inputs to outputs. A node without friction, or held
tangentially, has the one pair w, P (kept in place of A). The columns of the loads give the rates
along any leg.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf

from receding_fenicsx.interface.contact import Array, ContactSystem, State

V, W, A, B, REACTION = range(5)
"""Kinds of quantity; REACTION is Q of a node without friction, an input for good."""
STICK, SEPARATION = int(State.STICK), int(State.SEPARATION)
FORWARD, BACKWARD = int(State.FORWARD_SLIP), int(State.BACKWARD_SLIP)

EXCHANGES: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {
    (STICK, FORWARD): ((A, V),),
    (FORWARD, STICK): ((V, A),),
    (STICK, BACKWARD): ((B, V),),
    (BACKWARD, STICK): ((V, B),),
    (FORWARD, SEPARATION): ((B, W),),
    (SEPARATION, FORWARD): ((W, B),),
    (BACKWARD, SEPARATION): ((A, W),),
    (SEPARATION, BACKWARD): ((W, A),),
    (STICK, SEPARATION): ((A, V), (B, W)),
    (SEPARATION, STICK): ((W, B), (V, A)),
    (FORWARD, BACKWARD): ((V, A), (B, V)),
    (BACKWARD, FORWARD): ((V, B), (A, V)),
}
"""(output, input) pairs to exchange for each change of state of a frictional node."""

SMOOTH_EXCHANGES = {(STICK, SEPARATION): ((A, W),), (SEPARATION, STICK): ((W, A),)}
"""The same for a node without friction or held tangentially."""

PENDING = 32
"""Rank-one updates held back before they are put into the tableau by one matrix product."""

SINGULAR = 1e-11
"""Pivot over the local stiffness (or compliance) below which the exchange is singular."""


class SingularExchange(Exception):
    """A change of state would leave a motion of the body without stiffness."""

    def __init__(self, node: int, state: int) -> None:
        """Remember the node and the state that it cannot take."""
        super().__init__(node, state)
        self.node, self.state = node, state


class Tableau:
    """Maps the rates of inputs and loads to the rates of outputs, for the present states.

    Quantities carry labels kind * N + node with kind V, W, A or B. Rows stand for outputs, columns
    for inputs.

    Attributes:
        state: (N,) present states.
        load_rates: (m, n_loads) rates of the outputs under unit load rates, displacements in units
            of their own.
        row_label: (m,) label of each output.
        pivots: exchanges done so far.
        rebuilds: times that the tableau was made from scratch.
    """

    def __init__(self, system: ContactSystem, state: NDArray[np.int8]) -> None:
        """Make the tableau of ``system`` (2N form) for the given states."""
        n = system.n
        self.system = system
        nodes = np.arange(n)
        loose = ~system.held[:n]
        normal = ~system.held[n:]
        self.frictional = loose & normal & (system.f > 0.0)
        self.smooth = normal & ~self.frictional
        self.free_v = loose & ~self.frictional
        F, S, Z = nodes[self.frictional], nodes[self.smooth], nodes[self.free_v]
        f = system.f[F, None]
        # exchanges mix pivots with ones: displacements are counted in force over a typical
        # stiffness, a power of two, so that the unit of the stiffness changes no digit
        diagonal = np.abs(np.diagonal(system.K))
        typical = np.median(diagonal[diagonal > 0.0]) if np.any(diagonal) else 1.0
        self._unit = 2.0 ** int(np.frexp(typical)[1])
        wide = np.hstack([system.K / self._unit, system.r_star.T])
        force = np.vstack(
            [
                wide[F] + f * wide[n + F],
                f * wide[n + F] - wide[F],
                wide[n + S],
                wide[Z],
            ]
        )
        dofs = np.concatenate([F, n + F, n + S, Z])
        self._stuck = np.ascontiguousarray(force[:, dofs])
        self._stuck_loads = np.ascontiguousarray(force[:, 2 * n :])
        self._stuck_columns = np.concatenate([V * n + F, W * n + F, W * n + S, V * n + Z])
        # the reaction of a frictionless node's tangential freedom is an input for good
        self._stuck_rows = np.concatenate([A * n + F, B * n + F, A * n + S, REACTION * n + Z])
        self._weight = diagonal / self._unit
        m = len(dofs)
        self._U, self._V = np.zeros((m, PENDING), order="F"), np.zeros((PENDING, m))
        self.pivots = self.rebuilds = 0
        self.build(state)

    def build(self, state: NDArray[np.int8]) -> None:
        """Make the tableau for ``state`` from scratch, by one block pivot.

        Raises:
            SingularExchange: the body has a motion without stiffness in these states.
        """
        n = self.system.n
        outputs: list[int] = []
        inputs: list[int] = []
        for i in np.flatnonzero(self.frictional | self.smooth):
            table = EXCHANGES if self.frictional[i] else SMOOTH_EXCHANGES
            for out, into in table.get((STICK, int(state[i])), ()):
                outputs.append(out * n + int(i))
                inputs.append(into * n + int(i))
        Z = np.flatnonzero(self.free_v)
        row_of = {int(label): k for k, label in enumerate(self._stuck_rows)}
        column_of = {int(label): k for k, label in enumerate(self._stuck_columns)}
        rows = np.array(
            [row_of[label] for label in outputs] + [row_of[REACTION * n + int(z)] for z in Z], int
        )
        columns = np.array(
            [column_of[label] for label in inputs] + [column_of[V * n + int(z)] for z in Z], int
        )
        T = self._stuck.copy()
        G = self._stuck_loads.copy()
        self.row_label, self.column_label = self._stuck_rows.copy(), self._stuck_columns.copy()
        if len(rows):
            T, G = self._block_pivot(T, G, rows, columns, state)
            swapped = self.row_label[rows].copy()
            self.row_label[rows] = self.column_label[columns]
            self.column_label[columns] = swapped
        self._T, self.load_rates = np.ascontiguousarray(T), G
        self._held_back = 0
        self._row_of = np.full(5 * n, -1, dtype=np.intp)
        self._column_of = np.full(5 * n, -1, dtype=np.intp)
        self._row_of[self.row_label] = np.arange(len(self.row_label))
        self._column_of[self.column_label] = np.arange(len(self.column_label))
        self.state = state.copy()
        self.rebuilds += 1

    def _block_pivot(
        self,
        T: Array,
        G: Array,
        rows: NDArray[np.intp],
        columns: NDArray[np.intp],
        state: NDArray[np.int8],
    ) -> tuple[Array, Array]:
        """Exchange many outputs with as many inputs at once."""
        block = T[np.ix_(rows, columns)]
        lu, piv, _ = dgetrf(block)
        size = np.abs(np.diagonal(lu))
        if size.min() <= SINGULAR * size.max():
            raise SingularExchange(-1, int(np.bincount(state).argmax()))
        other = np.setdiff1d(np.arange(len(T)), rows)
        kept = np.setdiff1d(np.arange(len(T)), columns)
        inverse = sla.lu_solve((lu, piv), np.eye(len(rows)))
        right = inverse @ T[np.ix_(rows, kept)]
        right_G = inverse @ G[rows]
        new, new_G = np.empty_like(T), np.empty_like(G)
        coupling = T[np.ix_(other, columns)]
        new[np.ix_(rows, columns)] = inverse
        new[np.ix_(rows, kept)] = -right
        new[np.ix_(other, columns)] = coupling @ inverse
        new[np.ix_(other, kept)] = T[np.ix_(other, kept)] - coupling @ right
        new_G[rows] = -right_G
        new_G[other] = G[other] - coupling @ right_G
        return new, new_G

    def move_to(self, state: NDArray[np.int8]) -> None:
        """Exchange what differs between the present and the wanted states.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        try:
            for i in np.flatnonzero(state != self.state).tolist():
                self._change(i, int(state[i]))
        except SingularExchange:
            # the order of exchanges may pass a singular set of states on the way to a regular one
            self.build(state)

    def _change(self, i: int, new: int) -> None:
        n, old = self.system.n, int(self.state[i])
        table = EXCHANGES if self.frictional[i] else SMOOTH_EXCHANGES
        for out, into in table[old, new]:
            if not self._exchange(out * n + i, into * n + i):
                raise SingularExchange(i, new)
        self.state[i] = new

    def _exchange(self, out: int, into: int) -> bool:
        """Make output ``out`` an input and input ``into`` an output; False if that is singular."""
        i, j, k = self._row_of[out], self._column_of[into], self._held_back
        U, V_ = self._U, self._V
        row, column = self._T[i].copy(), self._T[:, j].copy()
        if k:
            row += U[i, :k] @ V_[:k]
            column += U[:, :k] @ V_[:k, j]
        pivot = row[j]
        # of the two quantities exchanged one is a displacement; its label is its place in K
        n = self.system.n
        reference = self._weight[into] if into < 2 * n else 1.0 / self._weight[out]
        if abs(pivot) <= SINGULAR * reference:
            return False
        column[i] += 1.0
        row[j] -= 1.0
        column /= -pivot
        self.load_rates += np.outer(column, self.load_rates[i])
        U[:, k], V_[k] = column, row
        self._held_back = k + 1
        self.row_label[i], self.column_label[j] = into, out
        self._row_of[into], self._row_of[out] = i, -1
        self._column_of[out], self._column_of[into] = j, -1
        self.pivots += 1
        if self._held_back == PENDING:
            self._flush()
        return True

    def _flush(self) -> None:
        """Put the held-back updates into the tableau."""
        k = self._held_back
        if k:
            # T is row-major: its transpose is what BLAS sees as a column-major matrix
            V_t, U = self._V[:k].T, self._U[:, :k]
            dgemm(1.0, V_t, U, beta=1.0, c=self._T.T, trans_b=1, overwrite_c=1)
            self._held_back = 0

    def rates(self) -> Array:
        """Return (5N, n_loads) rates of every labelled quantity under unit load rates."""
        rates = np.zeros((5 * self.system.n, self.load_rates.shape[1]))
        rates[self.row_label] = self.load_rates
        rates[: 2 * self.system.n] /= self._unit
        return rates

    def response(self, labels: NDArray[np.intp], change: Array) -> Array:
        """Return the change of every output when forces among the inputs change by a finite amount.

        Args:
            labels: labels of the changed inputs, not V or W.
            change: their changes, (k,) or (k, c) for c cases at once.

        Returns:
            (5N,) or (5N, c).
        """
        self._flush()
        out = np.zeros((5 * self.system.n, *change.shape[1:]))
        x = np.zeros((self._T.shape[1], *change.shape[1:]))
        x[self._column_of[labels]] = change
        out[self.row_label] = self._T @ x
        out[: 2 * self.system.n] /= self._unit
        return out

    def correction(self, r: Array) -> Array:
        """Return the change of displacement that brings every input back to zero.

        Args:
            r: (2N,) reactions, or (2N, k) rates of reaction, in the present states.

        Returns:
            (2N,) or (2N, k) change of displacement.
        """
        n, state = self.system.n, self.state
        f = self.system.f if r.ndim == 1 else self.system.f[:, None]
        Q, P = r[:n], r[n:]
        open_ = state == SEPARATION
        nodes = (
            np.flatnonzero(self.frictional & (open_ | (state == FORWARD))),
            np.flatnonzero(self.frictional & (open_ | (state == BACKWARD))),
            np.flatnonzero(self.smooth & open_),
            np.flatnonzero(self.free_v),
        )
        quantities = (Q + f * P, f * P - Q, P, Q)
        labels = [kind * n + i for kind, i in zip((A, B, A, REACTION), nodes, strict=True)]
        change = [-quantity[i] for quantity, i in zip(quantities, nodes, strict=True)]
        return self.response(np.concatenate(labels), np.concatenate(change))[: 2 * n]

    def refined_rates(self) -> Array:
        """Return :meth:`rates` after one step of iterative refinement."""
        n, system, state = self.system.n, self.system, self.state
        rates = self.rates()
        du = rates[: 2 * n]
        du += self.correction(system.r_star.T + system.K @ du)
        dr = system.r_star.T + system.K @ du
        f = system.f[:, None]
        contact = (state != SEPARATION)[:, None]
        forward = np.where(self.smooth[:, None], dr[n:], dr[:n] + f * dr[n:])
        outputs_A = contact & (state != FORWARD)[:, None]
        outputs_B = contact & (self.frictional & (state != BACKWARD))[:, None]
        rates[A * n : B * n] = np.where(outputs_A, forward, 0.0)
        rates[B * n : REACTION * n] = np.where(outputs_B, f * dr[n:] - dr[:n], 0.0)
        return rates
