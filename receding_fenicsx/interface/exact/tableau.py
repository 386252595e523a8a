"""Rates of a contact in given states: a tableau that follows each change of state by pivots.

Each frictional node has four quantities, v, w, A = Q + f_forward P and B = f_backward P - Q. In
every state two of them are inputs with zero rate and two are outputs:

    state            inputs   outputs (and what keeps the state)
    stick            v, w     A >= 0, B >= 0
    forward slip     A, w     rate of v >= 0, B >= 0
    backward slip    B, w     A >= 0, rate of v <= 0
    separation       A, B     v, gap >= 0

so a change of state exchanges one input with one output (stick to separation: two of each), a
rank-one update of the matrix that maps inputs to outputs
(:mod:`receding_fenicsx.interface.exact.pivot_matrix`). A node without friction, or held
tangentially, has the one pair w, P (stored in place of A). The columns of the loads give the rates
along any leg.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact import pivot_matrix
from receding_fenicsx.interface.exact.pivot_matrix import SINGULAR_PIVOT, Matrix, SingularExchange
from receding_fenicsx.interface.law import (
    BACKWARD,
    FORWARD,
    SEPARATION,
    STICK,
    margin_slopes,
    margins_at,
)
from receding_fenicsx.interface.system import ContactSystem

V, W, A, B, REACTION = range(5)
"""Kinds of quantity; REACTION is Q of a node without friction, an input for good."""

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
    (FORWARD, BACKWARD): ((B, A),),
    (BACKWARD, FORWARD): ((A, B),),
}
"""(output, input) pairs to exchange for each change of state of a frictional node."""

SMOOTH_EXCHANGES: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {
    (STICK, SEPARATION): ((A, W),),
    (SEPARATION, STICK): ((W, A),),
}
"""The same for a node without friction or held tangentially."""

MAX_PENDING = 32
"""Rank-one updates that are collected before they are applied."""


def _kinds() -> Ints:
    """Return kinds (output, input, output, input) by the law, the old and the new state."""
    kinds = np.full((3, 5, 5, 4), -1)
    for law, table in enumerate((SMOOTH_EXCHANGES, EXCHANGES)):
        for (old, new), pairs in table.items():
            kinds[law, old, new, : 2 * len(pairs)] = np.ravel(pairs)
    return kinds


KINDS = _kinds()
"""Kinds to exchange, -1 for none, of smooth nodes, frictional ones, and those without a limit."""


class Tableau:
    """Maps the rates of inputs and loads to the rates of outputs, for the present states.

    Quantities carry labels kind * N + node with kind V, W, A, B or REACTION.

    Attributes:
        matrix: the map and the present states.
    """

    def __init__(
        self,
        system: ContactSystem,
        state: NDArray[np.int8],
        singular: float = SINGULAR_PIVOT,
    ) -> None:
        """Make the tableau of ``system`` (2N form) for the given states.

        Args:
            system: the condensed body.
            state: (N,) states.
            singular: smallest pivot.

        Raises:
            SingularExchange: the body has a motion without stiffness in these states.
        """
        n = system.n
        self.system = system
        loose = ~system.held[:n]
        normal = ~system.held[n:]
        self.frictional = loose & normal & system.friction.present
        self.smooth = normal & ~self.frictional
        self.free_v = loose & ~self.frictional
        self._law = np.where(self.frictional, 1, np.where(self.smooth, 0, 2))
        # pivots are compared with 1: displacements are multiplied by a typical stiffness, a power
        # of two, so that the unit of the stiffness changes no digit
        diagonal = np.abs(np.diagonal(system.K))
        typical = np.median(diagonal[diagonal > 0.0]) if np.any(diagonal) else 1.0
        self._unit = 2.0 ** int(np.frexp(typical)[1])
        self._left_out = np.zeros(0, dtype=np.intp)
        self._all_stuck = self._with_all_stuck(system.r_star.T)
        self._singular = singular
        self.build(state)

    def _with_all_stuck(self, r_star: Array) -> tuple[Array, Ints, Ints]:
        """Return T with all nodes stuck, the stiffness itself, and labels of rows and columns."""
        n, system, nodes = self.system.n, self.system, np.arange(self.system.n)
        F, S, Z = nodes[self.frictional], nodes[self.smooth], nodes[self.free_v]
        dofs = np.concatenate([F, n + F, n + S, Z])

        def forces(of_u: Array) -> Array:
            margins = system.friction[F, None].margins(of_u[F], of_u[n + F])
            return np.vstack([*margins, of_u[n + S], of_u[Z]])

        of_u = system.K.take(dofs, axis=1)
        of_u *= 1.0 / self._unit  # a power of two
        row_label = np.concatenate([A * n + F, B * n + F, A * n + S, REACTION * n + Z])
        column_label = np.concatenate([V * n + F, W * n + F, W * n + S, V * n + Z])
        return np.hstack([forces(of_u), forces(r_star)]), row_label, column_label

    def build(self, state: NDArray[np.int8]) -> None:
        """Make the tableau for ``state`` from scratch, by one block pivot.

        Raises:
            SingularExchange: the body has a motion without stiffness in these states; the tableau
                is of no use then.
        """
        n = len(state)
        stuck = np.full(n, STICK, dtype=np.int8)
        outputs, inputs = self._exchanges(stuck, state)
        # Q = 0 of a frictionless node is an input for good
        Z = np.flatnonzero(self.free_v)
        outputs, inputs = np.append(outputs, REACTION * n + Z), np.append(inputs, V * n + Z)
        if np.isin(inputs, self._left_out).any():
            self._left_out = self._left_out[:0]
        T, row_label, column_label = self._all_stuck
        kept = ~np.isin(column_label, self._left_out)
        T = T[:, np.append(kept, np.ones(T.shape[1] - len(kept), dtype=bool))]
        m, k = T.shape
        row_of, column_of = np.full((2, 5 * n), -1)
        row_of[row_label], column_of[column_label[kept]] = np.arange(m), np.arange(kept.sum())
        self.matrix = Matrix(
            T=np.ascontiguousarray(T),
            U=np.zeros((MAX_PENDING, m)),
            V=np.zeros((MAX_PENDING, k)),
            counts=np.zeros(3, dtype=np.intp),
            rate=np.empty(m),
            row_label=row_label.copy(),
            column_label=column_label[kept],
            row_of=row_of,
            column_of=column_of,
            state=state.astype(np.int8),
            unit=self._unit,
            singular=self._singular,
            oldest=10 * m,  # then round-off has gathered
        )
        if len(outputs) and not pivot_matrix.exchange(self.matrix, outputs, inputs):
            raise SingularExchange
        self.matrix.counts[1] = 0

    @property
    def state(self) -> NDArray[np.int8]:
        """(N,) present states."""
        return self.matrix.state

    @property
    def left_out(self) -> int:
        """Number of inputs whose columns are left out."""
        return len(self._left_out)

    def leave_out(self, state: NDArray[np.int8], inputs: NDArray[np.intp]) -> None:
        """Make the tableau for ``state`` without the columns of some displacements.

        They stay inputs as long as their nodes stick; when one is to be exchanged after all, the
        tableau is made anew with all columns.
        """
        self._left_out = inputs
        self.build(state)

    def _exchanges(self, old: NDArray[np.int8], new: NDArray[np.int8]) -> tuple[Ints, Ints]:
        """Return the labels of outputs and inputs to exchange where nodes change their states."""
        node = (old != new).nonzero()[0]
        kinds = KINDS[self._law[node], old[node], new[node]]
        pairs = (kinds * len(old) + node[:, None])[kinds >= 0].reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def move_to(self, state: NDArray[np.int8]) -> None:
        """Exchange what differs between the present and the wanted states.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        outputs, inputs = self._exchanges(self.state, state)
        matrix = self.matrix
        if matrix.counts[1] > matrix.oldest or (
            len(outputs) and not pivot_matrix.exchange(matrix, outputs, inputs)
        ):
            self.build(state)
        else:
            matrix.state[:] = state

    def rates(self, direction: Array) -> Array:
        """Return the rates of v, gap, A and B along a leg."""
        matrix, n = self.matrix, len(self.state)
        rates, x = np.zeros(4 * n), np.zeros(matrix.T.shape[1])
        x[len(matrix.column_label) :] = direction
        rates[matrix.row_label] = pivot_matrix.outputs_of(matrix, x)
        rates[: 2 * n] /= self._unit
        return rates

    def refined(self, rates: Array, direction: Array) -> Array:
        """Return rates after one step of iterative refinement, reactions evaluated afresh."""
        n, system, force = self.system.n, self.system, direction @ self.system.r_star
        u = rates[: 2 * n] + self.correction(force + system.K @ rates[: 2 * n])[: 2 * n]
        slopes = margin_slopes(system.friction, (self.frictional, self.smooth), self.state)
        return np.concatenate([u, *margins_at(slopes, force + system.K @ u)])

    def correction(self, r: Array) -> Array:
        """Return the change of every quantity that brings every input back to zero.

        Of reactions (2N,), or their rates, in the present states: (5N,) changes by label, those of
        the displacements first.
        """
        n, state = self.system.n, self.state
        Q, P, friction = r[:n], r[n:], self.system.friction
        open_ = state == SEPARATION
        nodes = (
            np.flatnonzero(self.frictional & (open_ | (state == FORWARD))),
            np.flatnonzero(self.frictional & (open_ | (state == BACKWARD))),
            np.flatnonzero(self.smooth & open_),
            np.flatnonzero(self.free_v),
        )
        quantities = (*friction.margins(Q, P), P, Q)
        labels = np.concatenate(
            [kind * n + i for kind, i in zip((A, B, A, REACTION), nodes, strict=True)]
        )
        change = [-quantity[i] for quantity, i in zip(quantities, nodes, strict=True)]
        out, x = np.zeros(5 * n), np.zeros(self.matrix.T.shape[1])
        out[labels] = x[self.matrix.column_of[labels]] = np.concatenate(change)
        out[self.matrix.row_label] = pivot_matrix.outputs_of(self.matrix, x)
        out[: 2 * n] /= self._unit
        return out
