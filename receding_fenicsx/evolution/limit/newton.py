"""Semismooth Newton on the complementarity of drifts and smallest margins over a cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen import Frozen, FrozenCycle, MovedCycle, NoLimit
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactState, reactions

MAX_STEPS = 20
"""Newton steps after which the search is given up."""

CONVERGED = 1e-13
"""Natural map over the largest nodal force below which it is zero."""

MAX_FROZEN_CYCLES = 12
"""Cycles with frozen nodes, after a Newton step, that may differ from each other."""

REPEATS = 1e-13
"""Change of the displacements over a cycle with frozen nodes, over their largest, that is none."""

ROUND_OFF = 1e-12
"""The same up to which a change that does not become smaller is round-off."""

UNEVEN = 0.1
"""Part of a change by which it may differ from one that is geometric."""


@dataclass(frozen=True)
class Margins:
    """Smallest margins A and B of frozen nodes over a cycle, (m,) each, and the stops of both."""

    A: Array
    B: Array
    at_A: Ints
    at_B: Ints


@dataclass(frozen=True)
class Solution:
    """Cycle in which no frozen node would slip.

    Attributes:
        cycle: the cycle with frozen nodes.
        shifts: (k,) drifts of the shifted nodes.
        steps: Newton steps.
        residual: natural map over the largest nodal force.
        active: (k,) 1 where the margin A vanishes after a drift forward, -1 where B does after one
            backward, 0 where the node stays.
        margins: smallest margins of the shifted nodes.
    """

    cycle: FrozenCycle
    shifts: Array
    steps: int
    residual: float
    active: NDArray[np.int8]
    margins: Margins


def smallest_margins(frozen: Frozen, cycle: FrozenCycle, nodes: Ints) -> Margins:
    """Return the smallest margins of nodes over the stops of a cycle."""
    system, n = frozen.system, frozen.system.n
    rows = np.concatenate([nodes, n + nodes])
    load = np.array([stop.load for stop in cycle.stops])
    u = np.array([stop.u for stop in cycle.stops])
    r = load @ frozen.segments.system.r_star[:, rows] + u @ system.K[rows].T
    A, B = system.friction[nodes].margins(r[:, : len(nodes)], r[:, len(nodes) :])
    return Margins(A.min(axis=0), B.min(axis=0), A.argmin(axis=0), B.argmin(axis=0))


class MarginRows(NamedTuple):
    """Margins of nodes, each at one stop of a cycle, as linear functions of what moves there.

    Attributes:
        at: (m,) the stop of each.
        of_u: (m, 2N) factors of the displacements.
        of_events: (m, E) factors of the moved events.
    """

    at: Ints
    of_u: Array
    of_events: Array

    def moved(self, moved: MovedCycle, shifted: Ints) -> Array:
        """Return the derivatives (m, k) of the margins in the shifts of nodes (k,)."""
        return self.of_u @ moved.S + self.of_events @ moved.ds + self.of_u[:, shifted]


def margin_rows(
    frozen: Frozen, cycle: FrozenCycle, nodes: Ints, signs: Array, at: Ints
) -> MarginRows:
    """Return how margins of nodes at stops of a cycle change.

    At stop j of a node with the row a of its margin in r = ... + K u,

        dm = a . (S + sum over events e before j of change_e ds_e) + m'_j ds_j + a_shifted ,

    m'_j being the rate of the margin on the way there.

    Args:
        frozen: the contact.
        cycle: the cycle.
        nodes: (m,) the nodes.
        signs: (m,) 1 for the margin A, -1 for B.
        at: (m,) the stop of each.
    """
    system, n, events = frozen.system, frozen.system.n, cycle.events
    f = np.where(signs > 0.0, system.friction.forward[nodes], system.friction.backward[nodes])

    def of(r: Array) -> Array:
        return signs[:, None] * r[nodes] + f[:, None] * r[n + nodes]

    a, r_star = of(system.K), frozen.segments.system.r_star
    weights = np.where(events.at < at[:, None], a @ events.change[:, : 2 * n].T, 0.0)
    q = np.array([cycle.stops[j].q[: 2 * n] for j in at]).reshape(len(at), 2 * n)
    way = np.array([cycle.stops[j].way for j in at]).reshape(len(at), len(r_star))
    own, event = np.nonzero((at[:, None] == events.at) & events.moves)
    rate = (a * q).sum(axis=1) + (of(r_star.T) * way).sum(axis=1)
    weights[own, event] = rate[own]
    return MarginRows(at, a, weights)


def solve(frozen: Frozen, start: ContactState, guess: Array) -> Solution:
    """Find shifts x of the nodes that can be shifted so that none of them would slip.

    With the smallest margins A and B of a node over the periodic cycle: x > 0 only where A = 0,
    x < 0 only where B = 0, and A, B >= 0. This is the zero of the natural map
    R = min(A, max(k x, -B)), k being the node's stiffness, found by Newton's method on its pieces.

    Args:
        frozen: the contact.
        start: state at the start of a cycle, no node shifted.
        guess: (k,) shifts to begin with.

    Raises:
        NoLimit: it does not converge within the contact's budget of cycles.
        SolveError: a cycle with frozen nodes ends early.
    """
    nodes = frozen.shifted
    k = local_stiffness(frozen.system)[0][nodes]
    x, state = guess, start
    if np.any(x):
        state = frozen.shift(start, np.zeros_like(x), x)
    for step in range(MAX_STEPS):
        cycle = _repeating(frozen, state, x)
        m = smallest_margins(frozen, cycle, nodes)
        inner = np.maximum(k * x, -m.B)
        R = np.minimum(m.A, inner)
        forward = m.A < inner
        backward = ~forward & (-m.B > k * x)
        active = forward.astype(np.int8) - backward.astype(np.int8)
        residual = float(np.abs(R).max(initial=0.0)) / frozen.force
        if residual <= CONVERGED:
            return Solution(cycle, x, step, residual, active, m)
        moved = frozen.periodic_change(cycle)
        J, chosen = np.diag(k), np.flatnonzero(active)
        signs = active[chosen].astype(float)
        at = np.where(forward, m.at_A, m.at_B)[chosen]
        rows = margin_rows(frozen, cycle, nodes[chosen], signs, at)
        J[chosen] = signs[:, None] * rows.moved(moved, nodes)
        try:
            new = x - np.linalg.solve(J, R)
        except np.linalg.LinAlgError:
            raise NoLimit("the margins do not determine the drifts") from None
        new[active == 0] = 0.0
        state, x = frozen.shift(cycle.end, x, new), new
    raise NoLimit(f"{MAX_STEPS} Newton steps did not converge")


def _repeating(frozen: Frozen, state: ContactState, x: Array) -> FrozenCycle:
    """Return the cycle with given shifts that repeats itself.

    Where the change of the displacements shrinks by one factor c from cycle to cycle, all that is
    still to come, c / (1 - c) times the last one, is added at once.
    """
    before, load = np.zeros_like(state.u), np.append(frozen.loop[0], x)
    for _ in range(MAX_FROZEN_CYCLES):
        cycle = frozen.cycle(state, x)
        state, change = cycle.end, cycle.end.u - cycle.start.u
        size, last, largest = (float(np.abs(u).max()) for u in (change, before, state.u))
        if size <= REPEATS * largest or (0.5 * last <= size <= ROUND_OFF * largest and last > 0.0):
            return cycle
        c = float(change @ before) / float(before @ before) if last else 0.0
        uneven = np.linalg.norm(change - c * before) > UNEVEN * np.linalg.norm(change)
        before = change
        if 0.0 < c < 1.0 and not uneven and np.array_equal(cycle.start.state, state.state):
            u = state.u + c / (1.0 - c) * change
            state = ContactState(u, reactions(frozen.segments.system, load, u), state.state)
            before = np.zeros_like(u)
    raise NoLimit(f"{MAX_FROZEN_CYCLES} cycles with frozen nodes did not repeat themselves")
