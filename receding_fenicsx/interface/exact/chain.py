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

from operator import attrgetter, is_

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Sums
from receding_fenicsx.interface.exact.legs import Course, PathPoint
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

SHORTEST, LONGEST = 8, 1024
"""Events replayed at once; up to twice as many as passed last from the same segment."""

WORTH_WHILE = 8
"""Events passed by a replay below which further ones are put off."""

KEPT_CHAINS = 8
"""Chains whose stacked rates are kept."""

MISSED = 4
"""Times that the last events of a chain may differ before it is made anew."""

LONGEST_PAUSE = 32
"""Events after which a replay is tried again at most."""

PASSED_BY_ROUND_OFF = 8.0
"""Round-offs of the force scale by which a falling quantity may pass its limit at an event."""


class Chain:
    """Segments that followed one another.

    Attributes:
        segments: k segments.
        following: what came of the event at the end of each.
        labels: (k,) quantities that reached their limits.
        triangle: (k, k) rate of quantity ``labels[i]`` in segment j.
        rows: (k, 4N + watched) rates; they and all below are made by :meth:`complete`.
        low: (m,) quantities that cease to fall at one of the events, but for those of ``labels``.
        fall: (k, m) their rates up to there.
        rates: rates of the integrals along the leg.
        changes: nodes, old and new states of all changes of state, in order.
        event_of: (number of changes,) the event of each.
        missed: times that not all of them were those that came last.
    """

    def __init__(self, segments: list[Segment], following: list[Following]) -> None:
        """Stack the rates."""
        self.segments, self.following, self.missed = segments, following, 0
        self.labels = np.array([step.label for step in following])
        self.rows = np.array([segment.q for segment in segments])
        self.triangle = self.rows[:, self.labels].T
        self.is_complete = False

    def complete(self, sums: Sums) -> None:
        """Make what the verification of its events needs."""
        k, n, following = len(self.labels), sums.system.n, self.following
        self.is_complete = True
        self.rows = sums.with_watched(self.rows)
        ends = self.rows[:, n:] < 0.0
        ends[:-1] &= ~ends[1:]
        ends[np.arange(k), self.labels - n] = False
        at, low = ends.nonzero()
        self.low = low + n
        self.fall = self.rows[:, self.low]
        self.fall *= np.arange(k)[:, None] <= at
        self.rates = sums.rates(self.rows)
        changes = [change for step in following for change in step.changes]
        self.changes = tuple(zip(*changes, strict=True))
        self.event_of = np.repeat(np.arange(k), [len(step.changes) for step in following])

    def holding(self, longest: int) -> int:
        """Return how many of its first events are those that came last; 0 to make it anew."""
        k, last = len(self.labels), map(attrgetter("last"), self.segments)
        held = _leading(np.fromiter(map(is_, last, self.following), bool, k))
        if held == k:
            can_grow = k < longest and self.following[-1].segment.last is not None
            return 0 if can_grow else k
        self.missed += 1
        return held if 2 * held >= k and self.missed < MISSED else 0

    def quantities(self, y: Array, h: Array, columns: NDArray[np.intp] | slice) -> Array:
        """Return some of the quantities y at the end of each segment of length h."""
        k = len(h)
        at = y[columns] + (h[:, None] * self.rows[:k, columns]).cumsum(axis=0)
        at[self.labels[:k, None] == np.arange(len(y))[columns]] = 0.0
        return at


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
        self._sums, self._round_off = sums, round_off
        n, scale = segments.system.n, point.problem.force_scale
        self.active, self._wait = not sums.check_all, 0
        n_watched = 0 if sums.watch is None else len(sums.watch.rows)
        self._passed = PASSED_BY_ROUND_OFF * EPSILON * scale / segments.weight
        # what has to stay above it: gap, A, B, then the watched quantities
        watched = np.full(n_watched, LIMIT_TOLERANCE * scale)
        self._floor = np.concatenate([np.full(n, -np.inf), -self._passed[n:], watched])
        self._lowest = np.concatenate([-LIMIT_TOLERANCE * scale / segments.weight, watched])

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
        self._adapt(segment, m, foreseen)
        if m == 0:
            return None
        point, sums, last = self._point, self._sums, chain.following[m - 1]
        places = point.s + h.cumsum()
        before = point.state if m == 1 else chain.following[m - 2].state
        sums.add_segments(h, places, point.y, chain.rates)
        if course.stops:
            self._note(chain, h, places, course)
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
        known, longest = self._segments.chains, min(2 * segment.reach, LONGEST)
        chain, holding = known.pop(id(segment), None), 0
        if chain is not None:
            holding = chain.holding(longest)
        if chain is None or not holding:
            segments: list[Segment] = []
            following: list[Following] = []
            now, step = segment, segment.last
            while step is not None and len(following) < max(longest, SHORTEST):
                segments.append(now)
                following.append(step)
                now = step.segment
                step = now.last
            holding = len(following)
            if holding < SHORTEST:
                return None, 0
            chain = Chain(segments, following)
        known[id(segment)] = chain
        if len(known) > KEPT_CHAINS:
            del known[next(iter(known))]
        return chain, holding

    def _adapt(self, segment: Segment, passed: int, foreseen: int) -> None:
        """Adapt the length of the next replay from here, and how long to wait for any other."""
        segment.reach, pace = passed, self._segments
        if passed < min(foreseen, WORTH_WHILE):
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
        m = 0 if singular else _leading(holds)
        if m == 0 or (m < WORTH_WHILE and not chain.is_complete):
            return h[:0], y
        if not chain.is_complete:
            chain.complete(self._sums)
        rows = chain.rows
        if self._sums.watch is not None:
            now = np.concatenate([point.displacements(y), point.load])
            y = np.concatenate([y, self._sums.watch.rows @ now])
        end = y + h[:m] @ rows[:m]
        end[labels[m - 1]] = 0.0
        within = self._within_limits(chain, h, m, (y, end))
        balanced = _leading(self._round_off.balanced(h[:within], chain.rates.imbalance))
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
        passed = low[y[low] + h @ chain.fall < floor[low]]
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
            if np.isin(passed, chain.segments[k].falling).any():
                return int(k)
        return m


def _leading(holds: NDArray[np.bool_]) -> int:
    """Return how many of the first entries hold."""
    return len(holds) if holds.all() else int(holds.argmin())
