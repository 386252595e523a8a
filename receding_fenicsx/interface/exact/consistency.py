"""Consistent states: those in which no node on a limit is driven across it.

At a reversal or after an event, nodes on a limit (friction limit, zero gap, zero pressure) may go
either way. Whether a set of states is right is seen from its rates:

1. All nodes whose rates violate their limit change state, after some rounds only the worst one.
2. When a set of states returns, linear complementarity decides the nodes on limits.
3. A free body that balances on its contact is moved to the middle of its play, and 2 is repeated.
4. Nodes count as on a limit up to the round-off of their reactions and the residual that is
   accepted, and 2 is repeated.
5. Nodes that seem to slip on without resistance stick, or those without force open, if that
   violates no limit.
6. Otherwise an error says which continuation is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.equilibrium import Limit, of_round_off
from receding_fenicsx.interface.exact.free_motions import middle
from receding_fenicsx.interface.exact.jumps import explain
from receding_fenicsx.interface.exact.legs import PathPoint
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.segments import EPSILON, Segment, Segments, States
from receding_fenicsx.interface.exact.tableau import A, B, V
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import EXHAUSTED, Undecided, solve_states
from receding_fenicsx.interface.tolerances import (
    ACCEPTED_RESIDUAL,
    END_TOLERANCE,
    ON_LIMIT,
    ROUND_OFFS,
)

SIMULTANEOUS_ROUNDS = 3
"""Rounds in which all violating nodes change state together; afterwards only the worst does."""

FindLimit = Callable[[Array, Array], Limit | None]
"""Where equilibrium ends on the leg between two load factors, None where it does not."""


class ConsistentStates:
    """Finds consistent states at the present point of a path."""

    def __init__(
        self,
        segments: Segments,
        point: PathPoint,
        on_limit: Array,
        find_limit: FindLimit,
    ) -> None:
        """Prepare for one point.

        Args:
            segments: rates in known sets of states.
            point: present point of the path; its states and quantities on limits are changed.
            on_limit: (4N,) distance from a limit up to which a node is on it.
            find_limit: called only where rates alone do not decide.
        """
        self.segments, self.point, self.on_limit = segments, point, on_limit
        self.find_limit = find_limit
        a, b = point.problem.ends
        self.direction = b - a

    def violations(self, segment: Segment) -> NDArray[np.intp]:
        """Return labels of quantities on their limit that are driven across it."""
        fall = segment.falling
        passed = fall[self.point.y[fall] <= self.on_limit[fall]]
        return np.concatenate([segment.reversed_nodes, passed])

    def error(
        self, states: States, nodes: NDArray[np.intp] | None = None, exhausted: bool = False
    ) -> SolveError:
        """Return the error for a path that ends at the present point.

        Without ``nodes`` all on a limit are named.
        """
        scale = self.point.problem.force_scale
        if nodes is None:
            nodes = undecided_nodes(self.segments, self.point.y, states, self.on_limit).nodes
        return explain(self.segments, self.point, states, scale, nodes, exhausted)

    def decide(self, before: States) -> Segment:
        """Bring the states to consistent ones where changing them one by one does not end.

        Raises:
            SolveError: there are no such states.
        """
        segments, point = self.segments, self.point
        # within round-off of the place where equilibrium ends
        limit = self.find_limit(*point.problem.ends)
        if limit is not None and point.s >= limit.s - 1e-9:
            raise self.error(before)
        segment, exhausted = self._pivoted(before)
        if segment is None and self._balance(before):
            point.state[:] = before
            with suppress(SingularExchange):  # the loads turn the body on
                segment = segments.at(point.state, self.direction)
            if segment is not None and len(self.violations(segment)):
                segment, exhausted = self._pivoted(before)
        if segment is None and self._widen_limits(before):
            point.state[:] = before
            segment, exhausted = self._pivoted(before)
        # where round-off alone says that a node slips on without resistance, it may rest, also one
        # that lands; nodes without force may leave the body free to move where no load drives it
        rests = np.where(before == SEPARATION, before, STICK)
        gap = slice(segments.system.n, 2 * segments.system.n)
        lands = np.where(point.y[gap] <= self.on_limit[gap], STICK, before)
        for state in (rests, lands, np.where(self._without_pressure(), SEPARATION, before)):
            if segment is None:
                point.state[:] = state
                with suppress(SingularExchange):
                    segment = self._floating(segments.at(point.state, self.direction))
                    segment = None if len(self.violations(segment)) else segment
        if segment is None:
            raise self.error(before, exhausted=exhausted)
        return segment

    def _floating(self, segment: Segment) -> Segment:
        """Return rates with the least motion that no force resists and that keeps gaps open.

        With c of the motions M it is the point nearest to 0 with the rates of gaps g + M c >= 0,
        from a problem of nonnegative least squares (Lawson & Hanson 1974, ch. 23).
        """
        segments, state, y = self.segments, self.point.state, self.point.y
        n, motions = len(state), segments.free_motions(state)
        gap, limit = y[n : 2 * n], self.on_limit[n : 2 * n]
        closing = (state == SEPARATION) & (gap <= limit)
        if not motions.shape[1] or not closing.any():
            return segment
        M, rate = motions[n:][closing], segment.q[n : 2 * n][closing]
        size = np.abs(rate).max() or 1.0
        E, target = np.vstack([M.T, -rate / size]), np.append(np.zeros(M.shape[1]), 1.0)
        left = E @ scipy.optimize.nnls(E, target)[0] - target
        if abs(left[-1]) <= END_TOLERANCE:  # no motion keeps them all open
            return segment
        q = segment.q.copy()
        q[: 2 * n] -= size * motions @ (left[:-1] / left[-1])
        return segments.segment(state, q, self.direction)

    def _without_pressure(self) -> NDArray[np.bool_]:
        """Return the nodes whose pressure is round-off, or the residual that is accepted."""
        segments, (A, B) = self.segments, self.point.y.reshape(4, -1)[2:]
        opening = np.where(segments.frictional, segments.friction.opening(np.ones(len(A))), 1.0)
        P = (A + np.where(segments.frictional, B, 0.0)) / opening
        none = ACCEPTED_RESIDUAL * self.point.problem.force_scale
        none = max(none, of_round_off(segments.system, self.point.load))
        return (segments.frictional | segments.smooth) & (P <= none)

    def _widen_limits(self, before: States) -> bool:
        """Count nodes as on a limit up to larger distances; return whether more of them are.

        Up to the round-off of the reactions, eps |K| |u|, which exceeds ``ON_LIMIT`` where a nearly
        singular body is displaced far, and up to the residual that is accepted: a body that wedges
        itself may hold round-off of the loads by a force at a small arm. And up to what is reached
        within round-off of the place: all forces of a body vanish together where its loads do.
        """
        system, segments, y = self.segments.system, self.segments, self.point.y
        n, u = system.n, np.abs(y[: 2 * system.n] - np.append(np.zeros(system.n), system.g0))
        Q, P = ROUND_OFFS * EPSILON * (np.abs(system.K) @ u).reshape(2, n)
        friction, gap = segments.friction, P / segments.weight[n : 2 * n]
        A = np.where(segments.frictional, Q + friction.forward * P, P)
        by_round_off = np.concatenate([np.zeros(n), gap, A, Q + friction.backward * P])
        by_residual = ACCEPTED_RESIDUAL / ON_LIMIT * segments.limit * self.point.problem.force_scale
        rates = np.zeros_like(y)
        with suppress(SingularExchange):
            rates = segments.at(before, self.direction).q
        by_place = END_TOLERANCE * np.abs(rates)
        wide = np.maximum.reduce([self.on_limit, by_round_off, by_residual, by_place])
        more = (y > self.on_limit) & (y <= wide)
        self.on_limit = wide
        return bool(np.any(more[n:]))

    def _pivoted(self, before: States) -> tuple[Segment | None, bool]:
        """Solve the linear complementarity problem of the rates of nodes on limits.

        Returns:
            The rates, None without a solution; and whether all sets of states were tried.
        """
        segments, system = self.segments, self.segments.system
        undecided, free = self.rate_problem(before)
        try:
            found = solve_states(system, self.direction @ system.r_star, undecided, free)
        except np.linalg.LinAlgError:
            return None, False
        if found is None:
            return None, 1 < undecided.sets <= EXHAUSTED
        self.point.state[:] = np.where(found > 0, found, before)
        try:
            segment = segments.at(self.point.state, self.direction)
        except SingularExchange:
            return None, False
        return (None if len(self.violations(segment)) else segment), False

    def rate_problem(self, before: States) -> tuple[Undecided, NDArray[np.intp]]:
        """Return the nodes on limits, and the degrees of freedom that move freely."""
        segments, system, n = self.segments, self.segments.system, self.segments.system.n
        undecided = undecided_nodes(segments, self.point.y, before, self.on_limit)
        free_v = np.flatnonzero(~system.held[:n] & ~segments.frictional)
        decided_open = (before == SEPARATION) & ~np.isin(np.arange(n), undecided.nodes)
        open_n = np.flatnonzero(decided_open & ~system.held[n:])
        open_t = np.flatnonzero(decided_open & segments.frictional)
        return undecided, np.concatenate([open_t, free_v, n + open_n])

    def _balance(self, before: States) -> bool:
        """Turn a body that balances on one node until nodes on both sides are equally far.

        The loads do not determine to which side it leans.

        Returns:
            Whether the body can turn so.
        """
        system, point = self.segments.system, self.point
        n, y = system.n, point.y
        motions = self.segments.free_motions(np.where(before == SEPARATION, before, STICK))
        open_ = (before == SEPARATION) & ~system.held[n:]
        turn = middle(motions, y[n : 2 * n], open_)
        if turn is None:
            return False
        y[: 2 * n] += turn
        y[n : 2 * n][~open_] = 0.0
        return True


def state_after(old: int, kinds: int, frictional: bool, slip: float) -> int:
    """Return the state of a node some of whose quantities are violated.

    Args:
        old: its state.
        kinds: 1 << kind of each of the quantities, added up.
        frictional: it has the full contact law.
        slip: rate of v with which it closes, 0 where it is taken to stick.
    """
    if not frictional:
        return SEPARATION if old == STICK else STICK
    if old == SEPARATION:
        return STICK if slip == 0.0 else FORWARD if slip > 0.0 else BACKWARD
    if old >= FORWARD:
        return STICK if kinds & 1 << V else SEPARATION
    if kinds == 1 << A:
        return FORWARD
    return BACKWARD if kinds == 1 << B else SEPARATION


def undecided_nodes(segments: Segments, y: Array, state: States, limit: Array) -> Undecided:
    """Return the nodes that sit on a limit, sorted by which limit."""
    n, frictional = segments.system.n, segments.frictional
    on = (y <= limit).reshape(4, n)
    contact = state != SEPARATION
    touching = np.where(contact, on[2] & (on[3] | ~frictional), on[1])
    F = frictional & contact & ~touching
    return Undecided(
        np.flatnonzero(F & ((state == FORWARD) | (on[2] & (state == STICK)))),
        np.flatnonzero(F & ((state == BACKWARD) | (on[3] & (state == STICK)))),
        np.flatnonzero(frictional & touching),
        np.flatnonzero(segments.smooth & touching),
    )
