"""The contact law of many nodes at once: linear complementarity, and search of all sets of states.

With the slip split into v = z+ - z- and the gap g, Coulomb's and Signorini's conditions at a node
are

    A = Q + f_forward P >= 0  with  z+,  B = f_backward P - Q >= 0  with  z-,  P >= 0  with  g,

each pair complementary (A. Klarbring, 1986). A node that is known to be in contact on one side of
the friction cone keeps one pair. The unknowns may be rates (of nodes on a limit) or the whole
displacements of the static problem of a first load.

Every set of states makes the law a linear system, whose answer is a solution if it keeps the
inequalities of section 2 of Ahn & Barber (2008).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, Friction
from receding_fenicsx.interface.lcp.lemke import covers, solve
from receding_fenicsx.interface.system import ContactSystem, pinned_stiffness
from receding_fenicsx.interface.tolerances import NO_STIFFNESS, ROUND_OFFS

EXHAUSTED = 2**16
"""Largest number of sets of states that is gone through: eight nodes with all four states."""

BATCH = 4096
"""Sets of states solved at once."""

Indices = NDArray[np.intp]
Choices = list[tuple[int, ...]]


@dataclass(frozen=True)
class Undecided:
    """Nodes whose state the problem has to find; every other node keeps its own."""

    forward: Indices  # nodes in contact at A = 0: stick or forward slip
    backward: Indices  # nodes in contact at B = 0: stick or backward slip
    touching: Indices  # nodes with neither gap nor pressure: any state
    smooth: Indices  # nodes without friction or held tangentially, neither gap nor pressure

    @property
    def nodes(self) -> Indices:
        """All of them, sorted."""
        return np.sort(np.concatenate([self.forward, self.backward, self.touching, self.smooth]))

    @property
    def sets(self) -> int:
        """Number of sets of states that they may take."""
        return int(2 ** (len(self.nodes) + len(self.touching)))


def choices(undecided: Undecided) -> dict[int, tuple[int, ...]]:
    """Return the states that each undecided node may take."""
    may = dict.fromkeys(undecided.forward.tolist(), (STICK, FORWARD))
    may |= dict.fromkeys(undecided.backward.tolist(), (STICK, BACKWARD))
    may |= dict.fromkeys(undecided.touching.tolist(), (STICK, SEPARATION, FORWARD, BACKWARD))
    return may | dict.fromkeys(undecided.smooth.tolist(), (STICK, SEPARATION))


def batches(choices: Choices) -> Iterator[NDArray[np.int8]]:
    """Yield all sets of states, (k, m) with k up to ``BATCH`` at once."""
    every = product(*choices)
    while batch := list(islice(every, BATCH)):
        yield np.array(batch, dtype=np.int8)


class Problem(NamedTuple):
    """Rate problem x = S u + s of m undecided nodes: forward, backward, touching, smooth ones."""

    system: ContactSystem
    nodes: Indices  # (m,)
    may: Choices  # (m,) states that each may take
    smooth: NDArray[np.bool_]  # (m,) nodes that know only contact (stick) and separation
    friction: Friction  # (m,)
    # (2m, 2m), (2m,): stiffness and reactions condensed of the open freedoms, order [v; w]; the
    # tangential freedom of a smooth node is kept still
    S: Array
    s: Array

    @classmethod
    def of(
        cls, system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
    ) -> Problem:
        """Condense a problem; the arguments are those of :func:`solve_states`."""
        may, K = choices(undecided), system.K
        nodes, m = np.array(list(may), dtype=np.intp), len(may)
        rows = np.concatenate([nodes, system.n + nodes])
        S, s, carried = K[np.ix_(rows, rows)], r0[rows], np.abs(r0)
        if len(open_dofs):
            coupling, stiffness = K[np.ix_(open_dofs, rows)], pinned_stiffness(system, open_dofs)
            factor = sla.cho_factor(stiffness)
            moved = sla.cho_solve(factor, r0[open_dofs])
            S = S - coupling.T @ sla.cho_solve(factor, coupling)
            s = s - coupling.T @ moved
            carried = np.append(carried, np.abs(stiffness) @ np.abs(moved))
        # where loads have no effect, the round-off of what is summed and, by the factor, carried
        round_off = (ROUND_OFFS + len(open_dofs)) * np.finfo(float).eps
        s[np.abs(s) <= round_off * float(carried.max(initial=0.0))] = 0.0
        smooth = np.arange(m) >= m - len(undecided.smooth)
        still = np.flatnonzero(smooth)
        S[still], S[:, still], s[still] = 0.0, 0.0, 0.0
        S[still, still] = 1.0
        return cls(system, nodes, list(may.values()), smooth, system.friction[nodes], S, s)

    def may_be(self, state: int) -> NDArray[np.bool_]:
        """Return the (m,) nodes that may take a state."""
        return np.array([state in states for states in self.may], dtype=bool)

    def whole(self, states: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return (..., N) states, 0 at nodes that are not undecided, from (..., m)."""
        every = np.zeros((*states.shape[:-1], self.system.n), dtype=np.int8)
        every[..., self.nodes] = states
        return every

    def solutions(
        self, states: NDArray[np.int8]
    ) -> tuple[NDArray[np.int8], Array, NDArray[np.bool_]]:
        """Return those of (k, m) sets of states that are solutions, and their (j, 2m) changes u.

        A node that may not separate keeps its pressure, and one that may slip in one direction only
        is at that limit of friction. The third value tells which sets leave a motion without
        stiffness: u is one of many.
        """
        m, (*_, smooth, friction, S, s) = len(self.nodes), self
        S_t, S_n, s_t, s_n = S[:m], S[m:], s[:m], s[m:]
        A, B = friction[:, None].margins(S_t, S_n)
        a, b = friction.margins(s_t, s_n)
        stick, forward, backward, open_ = (
            states == state for state in (STICK, FORWARD, BACKWARD, SEPARATION)
        )
        eye = np.eye(2 * m)
        pick = [mask[:, :, None] for mask in (forward, backward, open_)]
        rows_t = np.where(pick[0], A, np.where(pick[1], B, np.where(pick[2], S_t, eye[:m])))
        right_t = np.where(forward, -a, np.where(backward, -b, np.where(open_, -s_t, 0.0)))
        rows_n, right_n = np.where(pick[2], S_n, eye[m:]), np.where(open_, -s_n, 0.0)
        rows_t = np.where(smooth[:, None], eye[:m], rows_t)
        right_t = np.where(smooth, 0.0, right_t)
        matrix = np.concatenate([rows_t, rows_n], axis=1)
        right = np.concatenate([right_t, right_n], axis=1)[:, :, None]
        norm = np.linalg.norm(matrix, axis=2, keepdims=True)
        norm[norm == 0.0] = 1.0
        # sets that may leave a motion without stiffness: least squares, checked below like all.
        # Rows of length 1 have det < 2 times the least singular value, however many there are
        loose = np.abs(np.linalg.det(matrix / norm)) <= 1e-9
        u = np.zeros(right.shape[:2])
        u[~loose] = np.linalg.solve(matrix[~loose], right[~loose])[:, :, 0]
        for k in np.flatnonzero(loose):
            rows, values = matrix[k] / norm[k], (right[k] / norm[k])[:, 0]
            u[k], _, rank, _ = np.linalg.lstsq(rows, values, rcond=NO_STIFFNESS)
            loose[k] = rank < 2 * m
        x = u @ S.T + s
        balance = np.abs(np.einsum("kij,kj->ki", matrix, u) - right[:, :, 0]).max(axis=1)
        v, w, Q, P = u[:, :m], u[:, m:], x[:, :m], x[:, m:]
        # violation of an inequality, over the largest term of its kind, that is accepted
        force = np.maximum(np.abs(x).max(axis=1), np.abs(s).max())[:, None] * 1e-9
        way = np.abs(u).max(axis=1)[:, None] * 1e-9
        can_open, can_forward, can_backward = map(self.may_be, (SEPARATION, FORWARD, BACKWARD))
        on_A, on_B = (can_forward | can_open) & ~smooth, (can_backward | can_open) & ~smooth
        margin_A, margin_B = friction.margins(Q, P)
        good = ~(stick & on_A) | (margin_A >= -force)
        good &= ~(stick & on_B) | (margin_B >= -force)
        good &= ~(~open_ & can_open) | (P >= -force)
        good &= ~forward | (v >= -way)
        good &= ~backward | (v <= way)
        good &= ~open_ | (w >= -way)
        solved = np.flatnonzero(good.all(axis=1) & (balance <= force[:, 0]))
        return states[solved], u[solved], loose[solved]

    def by_covers(self) -> Iterator[NDArray[np.int8]]:
        """Yield (m,) states by Lemke's method for each covering vector that leads to some.

        These are added pressures in the middle of the friction cone, which keep A + B = (f_forward
        + f_backward) P, so that every point of Lemke's path is a frictional contact too; vectors
        without that property end on rays where a solution exists. Answers may be alike.
        """
        m, smooth, friction = len(self.nodes), self.smooth, self.friction
        v, w = np.eye(2 * m)[:m], np.eye(2 * m)[m:]
        A, B = friction[:, None].margins(v, w)
        can_open = self.may_be(SEPARATION)
        one_way, rubs = ~can_open, can_open & ~smooth
        forward, backward = (one_way & self.may_be(state) for state in (FORWARD, BACKWARD))
        # u = C z of slip and reversed slip z+, z- and gaps, and y = T x of A, B and P
        C = np.concatenate([v[forward], -v[backward], v[rubs], -v[rubs], w[can_open]]).T
        T = np.concatenate([A[forward], B[backward], A[rubs], B[rubs], w[can_open]])
        M, q = T @ self.S @ C, T @ self.s
        middle = np.where(smooth, 0.0, 0.5 * (friction.backward - friction.forward))
        stiffness = self.system.largest_stiffness
        for pressing in covers(2 * m - np.count_nonzero(smooth)):
            P = pressing[-m:]
            z = solve(M, q, T @ np.append(middle * P, P))
            if z is None:
                continue
            u = C @ np.maximum(z, 0.0)
            x = self.S @ u + self.s
            # part of the largest variable below which a complementary variable counts as zero
            small = 1e-12 * max(float(np.abs(z).max(initial=0.0)), float(np.finfo(float).tiny))
            force = max(1e-12 * float(np.abs(T @ x).max(initial=0.0)), stiffness * small)
            slip = np.where(u[:m] > small, FORWARD, np.where(u[:m] < -small, BACKWARD, STICK))
            opens = can_open & ((u[m:] > small) | (x[m:] <= force))
            yield np.where(opens, SEPARATION, slip).astype(np.int8)


def solve_states(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> NDArray[np.int8] | None:
    """Find the (N,) states of the undecided nodes, 0 elsewhere; None when no solution was found.

    r0 (2N,) are reactions, or their rates, with no further displacement; ``open_dofs`` are those of
    the 2N freedoms that move freely at zero reaction.
    """
    problem, unsure = Problem.of(system, r0, undecided, open_dofs), None
    if not problem.may:
        return np.zeros(system.n, dtype=np.int8)
    for found in problem.by_covers():
        if len(problem.solutions(found[None])[0]):
            return problem.whole(found)
        # round-off of pivots without stiffness, or a motion that only its bounds determine
        unsure = problem.whole(found) if unsure is None else unsure
    if undecided.sets <= (EXHAUSTED if unsure is None else BATCH):
        for sets in batches(problem.may):
            solved, *_ = problem.solutions(sets)
            if len(solved):
                return problem.whole(solved[0])
    return unsure
