"""Semismooth Newton on the complementarity of drifts and smallest margins over a cycle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen import ROUND_OFF, Frozen, NoLimit
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle, MovedCycle
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactState

MAX_STEPS = 20
"""Newton steps after which the search is given up."""

CONVERGED = 1e-12
"""Natural map over the largest nodal force below which it is zero."""

MAX_UNSETTLED = 12
"""Cycles with frozen nodes, after a Newton step, that may differ from each other."""

REPEATS = 1e-11
"""Change of the displacements in all cycles to come, over their largest, that is none."""


@dataclass(frozen=True)
class Margins:
    """Smallest margins A and B of frozen nodes over a cycle, (m,) each, and the stops of both."""

    A: Array
    B: Array
    at_A: Ints
    at_B: Ints

    def of(self, chosen: Ints) -> Margins:
        """Return those of some of the nodes, given by their numbers among these."""
        return Margins(self.A[chosen], self.B[chosen], self.at_A[chosen], self.at_B[chosen])


@dataclass(frozen=True)
class Solution:
    """Cycle on the way to the one that repeats itself and in which no shifted node would slip.

    Attributes:
        cycle: the cycle with frozen nodes; to first order where it does not repeat itself yet.
        shifts: (k,) drifts of the shifted nodes.
        steps: Newton steps.
        residual: natural map over the largest nodal force.
        settled: the cycle repeats itself, and the natural map is zero.
        active: (k,) 1 where the margin A vanishes after a drift forward, -1 where B does after one
            backward, 0 where the node stays.
        margins: smallest margins of all frozen nodes.
    """

    cycle: FrozenCycle
    shifts: Array
    steps: int
    residual: float
    settled: bool
    active: NDArray[np.int8]
    margins: Margins


def smallest_margins(frozen: Frozen, cycle: FrozenCycle, nodes: Ints) -> Margins:
    """Return the smallest margins of nodes over the stops of a cycle."""
    system, n = frozen.system, frozen.system.n
    rows = np.concatenate([nodes, n + nodes])
    load = np.array([stop.load for stop in cycle.stops])
    u = np.array([stop.u for stop in cycle.stops])
    # most nodes neither slip nor open: their displacements are those at the first stop
    moving = np.flatnonzero(np.any(u != u[0], axis=0))
    r = load @ frozen.segments.system.r_star[:, rows] + system.K[rows] @ u[0]
    r += (u[:, moving] - u[0, moving]) @ system.K[np.ix_(rows, moving)].T
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


def approach(
    frozen: Frozen, start: ContactState, guess: Array, near: ContactState | None = None
) -> Iterator[Solution]:
    """Yield cycles with shifts x of the nodes that can be shifted, until none of them would slip.

    With the smallest margins A and B of a node over the periodic cycle: x > 0 only where A = 0,
    x < 0 only where B = 0, and A, B >= 0. This is the zero of the natural map
    R = min(A, max(k x, -B)), k being the node's stiffness, found by Newton's method on its pieces.

    After a step a cycle differs from the periodic one by what the nodes have still to forget of
    their start. Once a periodic cycle has been met this is added to first order, to the margins
    and to the next start, in place of playing it.

    Args:
        frozen: the contact.
        start: state at the start of a cycle, no node shifted.
        guess: (k,) shifts to begin with.
        near: state with these shifts to begin with where the law allows it.

    Raises:
        NoLimit: it does not converge within the contact's budget of cycles.
        SolveError: a cycle with frozen nodes ends early.
    """
    moving = np.searchsorted(frozen.nodes, frozen.shifted)
    k = local_stiffness(frozen.system)[0][frozen.shifted]
    x, steps, unsettled, met = guess, 0, 0, False
    state = None if near is None else frozen.allowed(near)
    if state is None:
        state = frozen.shift(start, np.zeros_like(x), x)
    while steps <= MAX_STEPS and unsettled <= MAX_UNSETTLED:
        cycle = frozen.cycle(state, x)
        largest, change = (float(np.abs(u).max()) for u in (cycle.end.u, cycle.change))
        left = frozen.to_forget(cycle) if change > ROUND_OFF * largest else None
        repeats = (change if left is None else np.abs(left.S).max()) <= REPEATS * largest
        if not repeats and (left is None or not met):
            state, unsettled = cycle.end, unsettled + 1
            if left is not None:
                state = frozen.displaced(state, left.S[:, 0] - cycle.change, x)
            continue
        later = cycle if repeats or left is None else cycle.moved(left)
        every = smallest_margins(frozen, later, frozen.nodes)
        m = every.of(moving)
        inner = np.maximum(k * x, -m.B)
        R = np.minimum(m.A, inner)
        forward = m.A < inner
        backward = ~forward & (-m.B > k * x)
        active = forward.astype(np.int8) - backward.astype(np.int8)
        residual = float(np.abs(R).max(initial=0.0)) / frozen.force
        settled = repeats and residual <= CONVERGED
        yield Solution(cycle if repeats else later, x, steps, residual, settled, active, every)
        if settled:
            return
        met, steps, unsettled = True, steps + 1, 0
        at = np.where(active > 0, m.at_A, m.at_B)
        state, x = _stepped(frozen, cycle, x, (k, R, active, at), left)
    raise NoLimit("Newton's method did not converge")


def _stepped(
    frozen: Frozen,
    cycle: FrozenCycle,
    x: Array,
    pieces: tuple[Array, Array, NDArray[np.int8], Ints],
    left: MovedCycle | None,
) -> tuple[ContactState, Array]:
    """Return the start of the next cycle and its shifts.

    Args:
        frozen: the contact.
        cycle: the last one.
        x: its shifts.
        pieces: stiffnesses, natural map, its pieces, and the stops of the margins.
        left: what the cycle has still to forget.
    """
    (k, R, active, at), nodes = pieces, frozen.shifted
    moved = frozen.periodic_change(cycle)
    J, chosen = np.diag(k), np.flatnonzero(active)
    signs = active[chosen].astype(float)
    rows = margin_rows(frozen, cycle, nodes[chosen], signs, at[chosen])
    J[chosen] = signs[:, None] * rows.moved(moved, nodes)
    try:
        new = x - np.linalg.solve(J, R)
    except np.linalg.LinAlgError:
        raise NoLimit("the margins do not determine the drifts") from None
    new[active == 0] = 0.0
    # with what the nodes will forget of their start after the step
    u = moved.S @ (new - x)
    if left is not None:
        u += left.S[:, 0] - cycle.change
    state = frozen.displaced(cycle.end, u, new)
    return frozen.shift(cycle.end, x, new) if state is cycle.end else state, new
