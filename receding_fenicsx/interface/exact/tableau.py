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

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dger
from scipy.linalg.lapack import dgetrf, dgetrs

from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import Array, ContactSystem

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
    (FORWARD, BACKWARD): ((B, A),),
    (BACKWARD, FORWARD): ((A, B),),
}
"""(output, input) pairs to exchange for each change of state of a frictional node."""

SMOOTH_EXCHANGES = {(STICK, SEPARATION): ((A, W),), (SEPARATION, STICK): ((W, A),)}
"""The same for a node without friction or held tangentially."""

PENDING = 32
"""Rank-one updates held back before they are put into the tableau by one matrix product."""

FEW = 16
"""Exchanges wanted at once up to which they are made one by one and held back."""

KEPT = 4
"""Tableaux kept from earlier ends of long ways between sets of states: a reversal comes back near
to where the last one in the same direction led."""

RENEWED = 10
"""Exchanges, in multiples of the tableau's size, after which it is made from scratch: round-off."""

SINGULAR = 1e-11
"""Pivot, over a typical stiffness or compliance, below which an exchange is singular."""


def limit_distances(
    f: Array,
    nodes: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    state: NDArray[np.int8],
    r: Array,
) -> tuple[Array, Array]:
    """Return A = Q + f P and B = f P - Q of all nodes, or their rates.

    At a slipping node one of them is zero and the other 2 f P: as a difference of Q and f P it
    would carry the round-off of Q, which a small f P does not bear. Both are zero at an open node,
    and at one that a support holds normally, which has no limit.

    Args:
        f: (N,) coefficients of friction.
        nodes: (N,) nodes with friction, and smooth ones, at which P stands in place of A.
        state: (N,) states.
        r: (2N,) reactions [Q; P], or their rates.
    """
    frictional, smooth = nodes
    Q, P = r[: len(f)], r[len(f) :]
    sliding = 2.0 * f * P
    distance_A = np.where(state == BACKWARD, sliding, Q + f * P)
    distance_B = np.where(state == FORWARD, sliding, f * P - Q)
    distance_A[state == FORWARD] = distance_B[state == BACKWARD] = 0.0
    contact = state != SEPARATION
    distance_A = np.where(smooth, P, np.where(frictional, distance_A, 0.0))
    return np.where(contact, distance_A, 0.0), np.where(contact & frictional, distance_B, 0.0)


class SingularExchange(Exception):
    """A change of state would leave a motion of the body without stiffness."""


@dataclass(frozen=True)
class _Kept:
    """Copy of a tableau as it stood in one set of states."""

    state: NDArray[np.int8]
    T: Array
    load_rates: Array
    row_label: NDArray[np.intp]
    column_label: NDArray[np.intp]
    age: int


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
        m = len(dofs)
        self._U, self._V = np.zeros((m, PENDING), order="F"), np.zeros((PENDING, m))
        self.pivots = self.rebuilds = 0
        self._kept: deque[_Kept] = deque(maxlen=KEPT)
        # with all nodes stuck the tableau is the stiffness itself, free of round-off
        self._all_stuck = None
        if not len(Z):
            still = np.full(n, STICK, dtype=np.int8)
            labels = self._stuck_rows, self._stuck_columns
            self._all_stuck = _Kept(still, self._stuck, self._stuck_loads, *labels, age=0)
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
            T, G = self._block_pivot(T, G, rows, columns)
            swapped = self.row_label[rows].copy()
            self.row_label[rows] = self.column_label[columns]
            self.column_label[columns] = swapped
        self._T, self.load_rates = np.ascontiguousarray(T), np.asfortranarray(G)
        self._age = 0
        self._stand_in(state)
        self._kept.clear()
        self.rebuilds += 1

    def _stand_in(self, state: NDArray[np.int8]) -> None:
        """Note where each label stands in a tableau that was taken over as a whole."""
        n = self.system.n
        self._held_back = 0
        self._row_of = np.full(5 * n, -1, dtype=np.intp)
        self._column_of = np.full(5 * n, -1, dtype=np.intp)
        self._row_of[self.row_label] = np.arange(len(self.row_label))
        self._column_of[self.column_label] = np.arange(len(self.column_label))
        self.state = state.copy()

    def _keep(self) -> None:
        """Keep a copy of the tableau, in place of one in the same direction if there is one."""
        self._flush()
        copy = _Kept(
            self.state.copy(),
            self._T.copy(),
            self.load_rates.copy(order="F"),
            self.row_label.copy(),
            self.column_label.copy(),
            self._age,
        )
        self._kept.append(copy)

    def _apart(self, one: NDArray[np.int8], other: NDArray[np.int8]) -> NDArray[np.intp]:
        """Return the nodes that are in different states, those without any limit left out."""
        return np.flatnonzero((one != other) & (self.frictional | self.smooth))

    def _start_nearer(self, state: NDArray[np.int8], way: int) -> bool:
        """Go on from a kept tableau if it has fewer than ``way`` nodes in other states."""
        candidates = [*self._kept, self._all_stuck] if self._all_stuck else self._kept
        ways = [len(self._apart(state, kept.state)) for kept in candidates]
        if min(ways, default=way) >= way:
            return False
        nearest = candidates[ways.index(min(ways))]
        np.copyto(self._T, nearest.T)
        self.load_rates = nearest.load_rates.copy(order="F")
        self.row_label = nearest.row_label.copy()
        self.column_label = nearest.column_label.copy()
        self._age = nearest.age
        self._stand_in(nearest.state)
        return True

    def _block_pivot(
        self,
        T: Array,
        G: Array,
        rows: NDArray[np.intp],
        columns: NDArray[np.intp],
    ) -> tuple[Array, Array]:
        """Exchange many outputs with as many inputs at once."""
        block = T[np.ix_(rows, columns)]
        lu, piv, _ = dgetrf(block)
        size = np.abs(np.diagonal(lu))
        if size.min() <= SINGULAR * max(1.0, size.max()):
            raise SingularExchange
        other = np.setdiff1d(np.arange(len(T)), rows)
        kept = np.setdiff1d(np.arange(len(T)), columns)
        inverse = dgetrs(lu, piv, np.eye(len(rows)))[0]
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
        outputs: list[int] = []
        inputs: list[int] = []
        n = len(state)
        changing = self._apart(state, self.state)
        way = len(changing)
        if way > FEW and self._start_nearer(state, way):
            changing = self._apart(state, self.state)
        for i in changing.tolist():
            table = EXCHANGES if self.frictional[i] else SMOOTH_EXCHANGES
            for out, into in table[int(self.state[i]), int(state[i])]:
                outputs.append(out * n + i)
                inputs.append(into * n + i)
        if self._age > RENEWED * len(self._T):
            done = False
        elif len(outputs) > FEW:
            done = self._exchange_many(np.array(outputs), np.array(inputs))
        else:
            done = all(map(self._exchange, outputs, inputs))
        if done:
            self.state = state.copy()
            if way > FEW:
                self._keep()
        else:
            # exchanges one by one may pass singular states on the way to regular ones
            self.build(state)

    def _exchange(self, out: int, into: int) -> bool:
        """Make output ``out`` an input and input ``into`` an output; False if that is singular.

        With the row R, the column C and the pivot D where they meet the tableau changes by
        - (C + one in the row) (R - one in the column) / D, which is held back.
        """
        i, j, k = self._row_of[out], self._column_of[into], self._held_back
        if k == PENDING:
            self._flush()
            k = 0
        U, V_ = self._U, self._V
        R, C = V_[k], U[:, k]
        R[:] = self._T[i]
        C[:] = self._T[:, j]
        if k:
            R += U[i, :k].dot(V_[:k])
            C += U[:, :k].dot(V_[:k, j])
        D = R[j]
        if -SINGULAR <= D <= SINGULAR:
            return False
        C[i] += 1.0
        R[j] -= 1.0
        C *= -1.0 / D
        G = self.load_rates
        dger(1.0, C, G[i], a=G, overwrite_a=1)
        self._held_back = k + 1
        self.row_label[i], self.column_label[j] = into, out
        self._row_of[into], self._row_of[out] = i, -1
        self._column_of[out], self._column_of[into] = j, -1
        self.pivots += 1
        self._age += 1
        return True

    def _exchange_many(self, outputs: NDArray[np.intp], inputs: NDArray[np.intp]) -> bool:
        """Exchange many outputs with as many inputs at once; False if that is singular."""
        i, j, e = self._row_of[outputs], self._column_of[inputs], len(outputs)
        self._flush()
        T, G = self._T, self.load_rates
        R, C = T[i], T[:, j]
        lu, piv, _ = dgetrf(R[:, j])
        if np.abs(lu.diagonal()).min() <= SINGULAR:
            return False
        inverse = dgetrs(lu, piv, np.eye(e))[0]
        R, C, loads = inverse @ R, C @ inverse, inverse @ G[i]
        # T is row-major: its transpose is what BLAS sees as a column-major matrix
        dgemm(-1.0, T[i].T, C, beta=1.0, c=T.T, trans_b=1, overwrite_c=1)
        T[i], T[:, j] = -R, C
        T[np.ix_(i, j)] = inverse
        G -= C @ G[i]
        G[i] = -loads
        self.row_label[i], self.column_label[j] = inputs, outputs
        self._row_of[outputs] = self._column_of[inputs] = -1
        self._row_of[inputs], self._column_of[outputs] = i, j
        self.pivots += e
        self._age += e
        return True

    def _flush(self) -> None:
        """Put the held-back updates into the tableau."""
        k = self._held_back
        if k:
            # T is row-major: its transpose is what BLAS sees as a column-major matrix
            V_t, U = self._V[:k].T, self._U[:, :k]
            dgemm(1.0, V_t, U, beta=1.0, c=self._T.T, trans_b=1, overwrite_c=1)
            self._held_back = 0

    def rates(self, direction: Array) -> Array:
        """Return the rates of v, gap, A and B along a leg.

        Args:
            direction: (n_loads,) change of the load factors.

        Returns:
            (4N,) rates by label; zero for the inputs.
        """
        n = len(self.state)
        rates = np.zeros(4 * n)
        rates[self.row_label] = self.load_rates.dot(direction)
        rates[: 2 * n] *= 1.0 / self._unit  # a power of two
        return rates

    def refined(self, rates: Array, direction: Array) -> Array:
        """Return rates after one step of iterative refinement, reactions evaluated afresh."""
        n, system = self.system.n, self.system
        dr = direction @ system.r_star + system.K @ rates[: 2 * n]
        change = self.correction(dr)[: 4 * n].reshape(4, n)
        forward, backward = limit_distances(
            system.f, (self.frictional, self.smooth), self.state, dr
        )
        # at a slipping node the sum of both is what changes 2 f P
        sliding = change[A] + change[B]
        open_ = self.state == SEPARATION
        forward += np.where(self.state == BACKWARD, sliding, change[A])
        backward += np.where(self.state == FORWARD, sliding, change[B])
        forward[open_ | (self.state == FORWARD)] = 0.0
        backward[open_ | (self.state == BACKWARD)] = 0.0
        return np.concatenate([rates[: 2 * n] + change[:A].ravel(), forward, backward])

    def response(self, labels: NDArray[np.intp], change: Array) -> Array:
        """Return the change of every quantity when forces among the inputs change.

        Args:
            labels: labels of the changed inputs, not V or W.
            change: (k,) their changes.

        Returns:
            (5N,) changes by label.
        """
        out = np.zeros(5 * self.system.n)
        x = np.zeros(self._T.shape[1])
        x[self._column_of[labels]] = change
        k = self._held_back
        out[self.row_label] = self._T @ x + self._U[:, :k] @ (self._V[:k] @ x)
        out[: 2 * self.system.n] /= self._unit
        out[labels] = change
        return out

    def correction(self, r: Array) -> Array:
        """Return the change of every quantity that brings every input back to zero.

        Args:
            r: (2N,) reactions, or rates of reaction, in the present states.

        Returns:
            (5N,) changes by label; the first 2N are those of the displacements.
        """
        n, state, f = self.system.n, self.state, self.system.f
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
        return self.response(np.concatenate(labels), np.concatenate(change))
