r"""One cycle traced from event to event, and all cycles to come that have its events.

Let $u_n$ be the displacements at the start of cycle $n$ and $\delta_n = u_{n+1} - u_n$. As long as
the order of the events is kept, their places $s_n$ and the displacements are affine in $u_n$:

$$T\, (s_{n+1} - s_n) = -l_n , \qquad \delta_{n+1} = \delta_n + W^\mathsf{T} (s_{n+1} - s_n) ,
  \qquad l_{n+1} = l_n + C\, (s_{n+1} - s_n) ,$$

with the changes $l_n$ of the quantities that reach zero at the events, the triangle $T$ of
:class:`MovingEvents`, and the changes $W$ of all rates at
the events ($C$: of those quantities). With what the places still move, $\tau_n = s_\infty - s_n$,
and the sum of this over all cycles to come, $\Theta_n = \tau_n + \tau_{n+1} + \dots$,

$$u_\infty = u_n - W^\mathsf{T} \Theta_n , \qquad
  y_j(n) = y_j(\infty) + W^\mathsf{T} \Theta_n - \sum_{e < j} W_e \tau_{n,e} - q_j \tau_{n,j}$$

are the limit and the quantities at stop $j$, both less the walk $\delta_\infty$, a rigid motion
that changes no force. The cycles to come are these if in all of them

* the places of the events of each leg stay sorted between its ends,
* nodes that begin to slip have slipped on when the run of releases ends (see below),
* all gaps and margins stay at least zero at all stops, and what becomes zero at an event together
  with another quantity stays zero there: between stops all is linear, and the rates belong to the
  states.

Releases, by which one node begins to slip or opens, may come in another order: as long as no node
sticks between them the displacements after them are the same. There the states on the way are not
known; one cycle of each such order is returned to be played.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.system import ContactState

MAX_CYCLES = 3000
"""Cycles within which those to come must reach their limit."""


class NoLimit(Exception):
    """No limit was found; the text says why."""


class Tail(NamedTuple):
    """Limit to which the cycles come."""

    u: Array  # (2N,) displacements at the start of the limit cycle
    state: NDArray[np.int8]  # (N,) states at the start and end of the last cycle
    walks: bool  # each cycle adds a rigid motion
    # (N,) nodes that slip at the start of the last cycle, and nowhere in the limit
    drifting: NDArray[np.bool_]
    # displacements at the start and end of cycles whose releases have another order
    others: list[tuple[Array, Array]]


def follow(cycle: TracedCycle, force: float, tolerance: float) -> Tail:
    """Follow the cycles that come after one to their limit.

    ``tolerance`` is the force by which the order of events, gaps and margins may be missed.
    NoLimit: the events come in another order in some cycle, or there is no limit.
    """
    if not np.array_equal(cycle.start.state, cycle.end.state):
        raise NoLimit("nodes end the last cycle in other states than they began it")
    segments, system, events = cycle.segments, cycle.segments.system, cycle.events
    n, labels, on_u = system.n, events.label, events.change[:, : 2 * system.n].T
    delta = cycle.end.u - cycle.start.u
    low = quantities(segments, delta, system.K @ delta)[labels]
    weight, on_low = segments.weight[labels], np.ascontiguousarray(events.change[:, labels].T)
    place = np.array([stop.leg + stop.s for stop in cycle.stops])
    rate = np.array([(np.abs(stop.q) * segments.weight).max() for stop in cycle.stops])
    rate = np.maximum(rate, np.append(rate[1:], rate[-1]))  # on both sides
    ends = np.flatnonzero(~cycle.releases)

    def misplaced(place: Array) -> float:
        """Return the largest force by which stops (..., J) are beyond those that end their runs."""
        end = place[..., ends]
        begin = np.concatenate([np.zeros_like(end[..., :1]), end[..., :-1]], axis=-1)
        over = np.maximum(place - end[..., cycle.runs], begin[..., cycle.runs] - place)
        return float((over * rate).max())

    moves, moved, ratio, largest = list[Array](), place.copy(), 0.0, np.inf
    # change of what a cycle changes, over the largest nodal force, below which it goes on as it is
    while largest > 1e-16 * force:
        if len(moves) == MAX_CYCLES:
            raise NoLimit(f"the cycles do not come to a limit within {MAX_CYCLES} further ones")
        ds = -low
        if len(low):
            ds = sla.solve_triangular(events.triangle, ds, lower=True, check_finite=False)
        moves.append(ds)
        moved[events.at] += ds
        if misplaced(moved) > tolerance:
            raise NoLimit("events will come in another order")
        change = on_low @ ds
        low += change
        before, largest = largest, float((weight * np.abs(change)).max(initial=0.0))
        ratio = largest / before if before else 0.0
    # change from cycle to cycle, over the largest nodal force, that is none if it goes on as it is
    if (weight * np.abs(low)).max(initial=0.0) > 1e-12 * force:
        raise NoLimit("what a cycle changes does not tend to zero")
    # what goes on is round-off, once what decays at the end is taken from it
    decay = (moves[-1] - moves[-2]) * ratio / (1.0 - ratio) if 0.0 < ratio < 1.0 else 0.0
    still = (np.array(moves) - (moves[-1] + decay))[::-1].cumsum(axis=0)[::-1]  # tau
    summed = still[::-1].cumsum(axis=0)[::-1]  # Theta
    limit, walk = cycle.start.u - on_u @ summed[0], delta + on_u @ still[0]
    k = np.concatenate(system.local_stiffness)
    walks = bool(np.any(k * np.abs(walk) > tolerance))
    if walks and np.abs(system.K @ walk).max() > tolerance:
        raise NoLimit("the displacements of a cycle do not tend to zero")
    places = np.tile(place, (len(still), 1))
    places[:, events.at] += still[0] - still
    if (cycle.slips_of_runs(still[0] - still) < -tolerance).any():
        raise NoLimit("a node will not begin to slip")
    _check_quantities(cycle, still, summed, tolerance)
    v = np.array([stop.u[:n] for stop in cycle.stops])
    q = np.array([stop.q[:n] for stop in cycle.stops])
    v += _moved(events.at, summed[-1], still[0], events.change[:, :n], q)
    slips = k[:n] * np.ptp(v, axis=0) > tolerance
    rounded = np.round(places * (rate.max() / tolerance))
    _, first = np.unique(rounded.argsort(axis=1, kind="stable"), axis=0, return_index=True)
    others = [
        (limit + on_u @ summed[m], limit + on_u @ summed[m + 1] + walk)
        for m in sorted(first.tolist())
        if 0 < m < len(still) - 1
    ]
    state = cycle.end.state
    return Tail(limit, state, walks, (SLIP_SIGN[state] != 0.0) & ~slips, others)


def _check_quantities(cycle: TracedCycle, still: Array, summed: Array, tolerance: float) -> None:
    """Raise NoLimit where a gap or margin falls below zero at a stop in some cycle to come."""
    # those between two cycles differ from the chord by little: they are looked at near zero only
    events, n = cycle.events, cycle.segments.system.n
    weight = cycle.segments.weight[n:]
    W, q = events.change[:, n:] * weight, np.array([stop.q[n:] for stop in cycle.stops]) * weight
    y0, unlimited, zero = cycle.values()[:, n:] * weight, *cycle.unlimited_and_zero()

    def at(m: int) -> Array:
        y = y0 + _moved(events.at, summed[m] - summed[0], still[0] - still[m], W, q)
        y[unlimited] = 0.0
        y[zero] = -np.abs(y[zero])
        if y.min() < -tolerance:
            raise NoLimit("another node will come to its limit")
        return y

    last = len(still) - 1
    todo = [(0, last, at(0), at(last))]
    while todo:
        a, b, *ends = todo.pop()
        if b - a < 2:
            continue
        x = np.hstack([summed[a : b + 1], still[a : b + 1]])
        chord, x = x[0] - x[-1], x - x[-1]
        part = np.clip(x @ chord / max(chord @ chord, np.finfo(float).tiny), 0.0, 1.0)
        total, by = np.split(np.abs(x - part[:, None] * chord).max(axis=0), 2)
        least = np.minimum(*ends) - _moved(events.at, total, by, np.abs(W), np.abs(q))
        if np.any((least < -tolerance) & ~unlimited & ~zero):
            m = (a + b) // 2
            middle = at(m)
            todo += [(a, m, ends[0], middle), (m, b, middle, ends[1])]


def _moved(at: Ints, total: Array, by: Array, W: Array, q: Array) -> Array:
    """Return (J, m) what quantities at the stops change where the (E,) events move."""
    steps = np.zeros_like(q)
    steps[at + 1] = W * by[:, None]
    y: Array = steps.cumsum(axis=0) + total @ W
    y[at] += q[at] * by[:, None]
    return y


class Stop(NamedTuple):
    """Event or corner of a cycle."""

    leg: int  # leg of the cycle
    s: float  # place on it
    load: Array  # (n_loads,) load factors
    u: Array  # (2N,) displacements
    q: Array  # (4N,) rates of y = [v, gap, A, B] on the way there, over the leg
    label: int  # quantity that reached its limit, -1 at a corner
    state: NDArray[np.int8]  # (N,) states on the way there


class MovingEvents(NamedTuple):
    """How the events of a cycle move where the cycle starts from other displacements."""

    at: Ints  # (E,) number of the stop of each
    label: Ints  # (E,) quantity that reaches zero there
    change: Array  # (E, 4N) rates of all quantities before it less those after it
    triangle: Array  # (E, E) rate of each quantity at its own event, its changes at those before


@dataclass(frozen=True)
class TracedCycle:
    """One cycle, event by event."""

    start: ContactState
    end: ContactState
    stops: list[Stop]  # its events and corners
    segments: Segments  # makes the rates

    @cached_property
    def events(self) -> MovingEvents:
        """How its events move: the triangular system of :mod:`receding_fenicsx.evolution.limit`."""
        at = np.array([j for j, stop in enumerate(self.stops) if stop.label >= 0], dtype=np.intp)
        label = np.array([self.stops[j].label for j in at], dtype=np.intp)
        q = np.array([stop.q for stop in self.stops])
        change = q[at] - q[at + 1]
        triangle = np.tril(change[:, label].T, -1)
        np.fill_diagonal(triangle, q[at, label])
        return MovingEvents(at, label, change, triangle)

    def values(self) -> Array:
        """Return the quantities (J, 4N) at its stops, from displacements and loads."""
        u, load = (np.array([getattr(stop, name) for stop in self.stops]) for name in ("u", "load"))
        system = self.segments.system
        y = quantities(self.segments, u, load @ system.r_star + u @ system.K.T)
        y[:, system.n : 2 * system.n] += system.g0
        return y

    @cached_property
    def _changes(self) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """States (J, N) on the way to the stops and after them; the same after the last one."""
        states = np.array([stop.state for stop in self.stops])
        return states, np.vstack([states[1:], states[-1:]])

    @cached_property
    def releases(self) -> NDArray[np.bool_]:
        """Stops (J,) at which one node begins to slip or opens, and no other one changes."""
        old, new = self._changes
        held = (old == SEPARATION) | (new == STICK) | (SLIP_SIGN[old] * SLIP_SIGN[new] < 0.0)
        events = np.array([stop.label >= 0 for stop in self.stops])
        one = np.count_nonzero(old != new, axis=1) == 1
        releases: NDArray[np.bool_] = events & one & ~np.any((old != new) & held, axis=1)
        return releases

    @cached_property
    def runs(self) -> Ints:
        """Number (J,) of each stop's run of releases, the stop that ends the run included."""
        return np.append(0, np.cumsum(~self.releases)[:-1])

    def slips_of_runs(self, by: Array) -> Array:
        """Return the slips (k, R) of nodes released in runs, in their direction, as forces.

        They are those from the release to the end of the run, which no order of the releases
        changes, where the events move by (k, E).
        """
        n, events = self.segments.system.n, self.events
        begins = np.flatnonzero(self.releases)
        ends = np.flatnonzero(~self.releases)[self.runs[begins]]
        node = np.array([self.stops[j].label % n for j in begins], dtype=np.intp)
        q, u = (np.array([getattr(stop, name) for stop in self.stops]) for name in ("q", "u"))
        after = (events.at[:, None] >= begins) & (events.at[:, None] < ends)
        moves = np.where(after, events.change[:, node], 0.0)
        moves += np.where(events.at[:, None] == ends, q[ends, node], 0.0)
        # of one that opens in the run the gap is looked at
        sign = SLIP_SIGN[self._changes[0][ends, node]] * self.segments.weight[node]
        slips: Array = sign * (u[ends, node] - u[begins, node] + by @ moves)
        return slips

    def unlimited_and_zero(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which gaps and margins (J, 3N) need not stay above zero at a stop, and may not.

        Those that the states keep at zero do so, and nodes released in a run are on either side in
        it. Where several quantities reach zero at once all but the first one have to stay there.
        """
        rubs, smooth = self.segments.frictional, self.segments.smooth
        fixed = []
        for states in self._changes:
            contact = states != SEPARATION
            A, B = (rubs & (~contact | (states == slip)) for slip in (FORWARD, BACKWARD))
            gap, A = contact & (rubs | smooth), A | (smooth & ~contact)
            fixed.append(np.concatenate([gap, A, B], axis=1))
        zero = fixed[1] & ~fixed[0]
        at, label = self.events.at, self.events.label
        zero[at, label - self.segments.system.n] = False
        old, new = self._changes
        released = np.zeros((self.runs[-1] + 1, old.shape[1]), dtype=bool)
        np.logical_or.at(released, self.runs, (old != new) & self.releases[:, None])
        loose = np.tile(released[self.runs] & self.releases[:, None], 3)
        return fixed[0] | loose | ~np.tile(rubs | smooth, 3), zero & ~loose


def quantities(segments: Segments, u: Array, r: Array) -> Array:
    """Return [v, gap, A, B] (..., 4N) of displacements and reactions (..., 2N) without gaps."""
    n, friction = segments.system.n, segments.friction
    A, B = friction.margins(r[..., :n], r[..., n:])
    A = np.where(segments.smooth, r[..., n:], np.where(segments.frictional, A, 0.0))
    return np.concatenate([u, A, np.where(segments.frictional, B, 0.0)], axis=-1)


def trace(segments: Segments, start: ContactState, loop: Array, force: float) -> TracedCycle:
    """Trace one cycle of load factors (m + 1, n_loads); SolveError: the path ends."""
    # loads Numba, which takes longer than all the rest
    from receding_fenicsx.interface.exact.compilation import loop_of
    from receding_fenicsx.interface.exact.walk import Walk

    state, stops, follows = start, list[Stop](), loop_of(segments)
    for k, ends in enumerate(pairwise(loop)):
        problem = LegProblem(state, ends, force)
        walk = Walk(follows, problem, traced=True)
        walk.run(1.0)
        state = walk.finish().end
        for s, u, q, label, on_the_way in walk.stops():
            stops.append(Stop(k, s, problem.load(s), u, q, label, on_the_way))
    return TracedCycle(start, state, stops, segments)
