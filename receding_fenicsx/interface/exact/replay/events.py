"""Replay of events that have followed one another before, many at once.

Each segment remembers the event that ended it last, and the segment after it. Along such a chain of
segments 0, 1, ... with rates q_0, q_1, ... and the labels j_0, j_1, ... of the quantities that
reach their limits, the lengths h_k of the segments follow from one triangular system,

    y_j(0) + sum_{k <= a} h_k q_k,j = 0   for j = j_a.

All else are sums over the segments too: the quantities y(a) = y(0) + sum_{k <= a} h_k q_k at event
a, the imbalance of displacements and forces there, dissipation and work. A quantity is lowest where
it ceases to fall. The product of h with one matrix, which is kept with the chain, tells whether all
quantities stay above their limits.

The path is linear in between. So the first events of the chain at which all h_k >= 0, no quantity
has passed its limit, no watched node has reached one, and forces and displacements balance are
events of the path, however they were foreseen. They are accepted, and the walk goes on from the
last one by itself.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtrtrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Sums
from receding_fenicsx.interface.exact.legs import Course, PathPoint
from receding_fenicsx.interface.exact.replay.chain import Chain, Chains, leading
from receding_fenicsx.interface.exact.round_off import RoundOff
from receding_fenicsx.interface.exact.segments import (
    EPSILON,
    LIMIT_TOLERANCE,
    Following,
    Segment,
    Segments,
)

START_OF_LEG = -1
"""Label under which a segment remembers what came of the start of a leg."""

WORTH_WHILE, LONGEST = 24, 1024
"""Events replayed at once: a chain of fewer is not made, and where fewer have held further replays
are put off; up to as many as held last on the leg, or twice as many as from the same segment."""

FEWEST = 12
"""Events to be passed together at least, once a chain is made: one by one takes less time."""

SHORTEST_PAUSE, LONGEST_PAUSE = 8, 256
"""Events after which a replay is tried again: at least, where the known chain is too short, and at
most."""

PASSED_BY_ROUND_OFF = 8.0
"""Round-offs of the force scale by which a falling quantity may pass its limit at an event."""


class Replay:
    """Replays chains of known segments along one leg.

    Attributes:
        active: whether to replay at all; not where every event is to be looked at by itself.
    """

    def __init__(
        self, segments: Segments, point: PathPoint, sums: Sums, round_off: RoundOff
    ) -> None:
        """Prepare for one leg.

        Args:
            segments: rates in known sets of states.
            point: present point of the path, which is moved on.
            sums: integrals along the leg.
            round_off: imbalance of displacements and forces.
        """
        self._segments, self._point = segments, point
        if segments.chains is None:
            segments.chains = Chains()
        self._chains: Chains = segments.chains
        self._sums, self._round_off = sums, round_off
        n, scale = segments.system.n, point.problem.force_scale
        self.active, self._wait, self._held = not sums.check_all, 0, 0
        n_watched = 0 if sums.watch is None else len(sums.watch.rows)
        self._passed = passed_by_round_off(segments, scale)
        self._floor = floors(segments, scale, n_watched)
        self._lowest = self._floor.copy()
        self._lowest[: 4 * n] = -LIMIT_TOLERANCE * scale / segments.weight
        self._on_limit = np.append(segments.limit * scale, np.full(n_watched, -np.inf))
        self._near = np.zeros(0, dtype=bool)

    def follow(self, segment: Segment, s_end: float, course: Course) -> Segment | None:
        """Pass all events of the known chain that hold, those at or beyond ``s_end`` left out.

        Args:
            segment: rates at the present point.
            s_end: place before which the events have to be.
            course: takes samples, events and stops.

        Returns:
            The rates after the last event passed; None where none was.
        """
        self._wait -= 1
        if self._wait > 0 or not self.active:
            return None
        chain, foreseen = self._foreseen(segment)
        if chain is None:
            return None
        h, y = self._verified(chain, foreseen, s_end)
        m = len(h)
        self._adapt(segment, m)
        if m == 0:
            return None
        point, sums, last = self._point, self._sums, chain.following[m - 1]
        places = point.s + h.cumsum()
        before = point.state if m == 1 else chain.following[m - 2].state
        sums.add_segments(h, places, point.y, chain.rates)
        if course.stops:
            self._note(chain, h, places, course)
        on_limit = self._on_limit[: len(point.y)]
        sums.ties += chain.ties(
            self._segments, point.y[None], h[None], on_limit, self._near[None], point.s
        )
        of = chain.event_of[: chain.event_of.searchsorted(m)]
        course.events += zip(places[of].tolist(), *chain.changes, strict=False)
        point.s, point.state, point.y[:] = float(places[-1]), last.state, y[: len(point.y)]
        # what has reached its limit and stays there is exactly zero
        reached = chain.labels[:m]
        point.y[reached[point.y[reached] <= self._passed[reached]]] = 0.0
        sums.restart(point.s, point.y, before)
        self._round_off.note_balanced()
        last.segment.reach = max(last.segment.reach, m)
        return last.segment

    def _foreseen(self, segment: Segment) -> tuple[Chain | None, int]:
        """Return the chain of segments that followed one another last, and how many still do.

        None if it is too short. One that no longer holds to its end is used some times more.
        """
        longest = min(max(2 * segment.reach, self._held), LONGEST)
        place = self._chains.find(segment)
        holding = 0 if place is None else place[0].holding(place[1], longest)
        if place is not None and holding >= WORTH_WHILE:
            chain, begin = place
            return (chain.part(begin) if begin else chain), holding
        longest = max(longest, WORTH_WHILE)
        steps: list[Following] = []
        step = segment.last
        while step is not None and len(steps) < longest:
            steps.append(step)
            step = step.segment.last
        if len(steps) < WORTH_WHILE:
            self._wait = max(len(steps), SHORTEST_PAUSE)
            return None, 0
        segments = [segment, *(step.segment for step in steps[:-1])]
        return Chain(segments, steps), len(steps)

    def _adapt(self, segment: Segment, passed: int) -> None:
        """Adapt the length of the next replay from here, and how long to wait for any other."""
        segment.reach, self._held, pace = passed, passed, self._segments
        if passed < WORTH_WHILE:
            self._wait = pace.pause = min(2 * pace.pause + 2, LONGEST_PAUSE)
        else:
            pace.pause //= 4

    def _note(self, chain: Chain, h: Array, places: Array, course: Course) -> None:
        """Note samples and stops; move the point to the event before the last sample."""
        point, m = self._point, len(h)
        y = chain.quantities(point.y, h, slice(len(point.y)))
        states = [point.state, *(step.state for step in chain.following[: m - 1])]
        s = places.tolist()
        course.stops += [(at, point.displacements(row)) for at, row in zip(s, y, strict=True)]
        while course.sample_at and course.sample_at[0] <= s[-1]:
            k = int(np.searchsorted(places, course.sample_at[0]))
            if k > 0:
                point.s, point.y[:], point.state = s[k - 1], y[k - 1], states[k]
            course.sample(point, chain.segments[k].q, s[k])

    def _verified(self, chain: Chain, foreseen: int, s_end: float) -> tuple[Array, Array]:
        """Verify the events of a chain up to the first one that does not hold.

        Returns:
            (m,) lengths of the segments up to these events, and all quantities at the last one.
        """
        point, labels = self._point, chain.labels
        y = point.y
        h, singular = dtrtrs(chain.triangle, -y[labels], lower=1)
        holds = (h >= 0.0) & (point.s + h.cumsum() < s_end)
        holds[foreseen:] = False
        m = 0 if singular else leading(holds)
        if m < FEWEST:
            return h[:0], y
        if not chain.is_complete:
            chain.complete(self._sums)
            self._chains.keep(chain)
        rows = chain.rows
        if self._sums.watch is not None:
            now = np.concatenate([point.displacements(y), point.load])
            y = np.concatenate([y, self._sums.watch.rows @ now])
        end = y + h[:m] @ rows[:m]
        end[labels[m - 1]] = 0.0
        within = self._within_limits(chain, h, m, (y, end))
        balanced = leading(self._round_off.balanced(h[:within], chain.rates.imbalance))
        if within and not balanced:
            self._round_off.remove_if_grown()
        if balanced < m:
            m = balanced
            end = y + h[:m] @ rows[:m]
        return h[:m], end

    def _within_limits(self, chain: Chain, h: Array, m: int, ends: tuple[Array, Array]) -> int:
        """Return how many of the first m events are reached before a quantity passes its limit.

        Args:
            chain: the chain.
            h: (k,) lengths of its segments; those beyond m are set to 0.
            m: number of events.
            ends: the quantities at the present point and at event m.
        """
        h[m:] = 0.0
        floor, low = self._floor, chain.low
        y, end = ends
        lowest = y[low] + h @ chain.fall
        self._near = lowest <= self._on_limit[low]
        passed = low[lowest < floor[low]]
        at_end = (end < floor).nonzero()[0]
        if not len(passed) + len(at_end):
            return m
        columns = np.union1d(passed, at_end)
        below = chain.quantities(y, h[:m], columns)
        for k in (below < floor[columns]).any(axis=1).nonzero()[0].tolist():
            passed = columns[below[k] < floor[columns]]
            if np.any(below[k] < self._lowest[columns]):
                return int(k)
            # what falls too slowly to count as falling may pass by as much as counts as on a limit
            falling = chain.segments[k].falling
            if (falling.take(falling.searchsorted(passed), mode="clip") == passed).any():
                return int(k)
        return m


def passed_by_round_off(segments: Segments, force_scale: float) -> Array:
    """Return (4N,) by how much each quantity may pass its limit by round-off."""
    return PASSED_BY_ROUND_OFF * EPSILON * force_scale / segments.weight


def floors(segments: Segments, force_scale: float, n_watched: int) -> Array:
    """Return what gap, A, B and the watched quantities have to stay above; (4N + watched,)."""
    passed, n = passed_by_round_off(segments, force_scale), segments.system.n
    passed[:n] = np.inf
    return np.concatenate([-passed, np.full(n_watched, LIMIT_TOLERANCE * force_scale)])
