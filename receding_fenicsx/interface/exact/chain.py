"""Replay of events that have followed one another before, many at once.

Each segment remembers the event that ended it last, and the segment after it. Along such a chain of
segments 0, 1, ... with rates q_0, q_1, ... and the labels j_0, j_1, ... of the quantities that
reach their limits, the lengths h_k of the segments follow from one triangular system,

    y_j(0) + sum_{k <= a} h_k q_k,j = 0   for j = j_a,

and the quantities at all events from one cumulative sum, y(a) = y(0) + sum_{k <= a} h_k q_k.

The path is linear in between. So the first events of the chain at which all h_k >= 0, no quantity
has passed its limit, no watched node has reached one, and forces and displacements balance are
events of the path, however they were foreseen. They are accepted, and the walk goes on from the
last one by itself.
"""

from __future__ import annotations

from itertools import pairwise
from operator import is_

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Sums, Watch
from receding_fenicsx.interface.exact.legs import Course, PathPoint
from receding_fenicsx.interface.exact.round_off import RoundOff
from receding_fenicsx.interface.exact.segments import (
    EPSILON,
    LIMIT_TOLERANCE,
    Following,
    Segment,
    Segments,
    States,
)

START_OF_LEG = -1
"""Label under which a segment remembers what came of the start of a leg."""

SHORTEST, LONGEST = 8, 256
"""Events replayed at once: fewer after a replay that ended early, more after a whole one."""

WORTH_WHILE = 8
"""Events passed by a replay below which further ones are put off."""

KEPT_CHAINS = 8
"""Chains whose stacked rates are kept."""

LONGEST_PAUSE = 32
"""Events after which a replay is tried again at most."""

PASSED_BY_ROUND_OFF = 8.0
"""Round-offs of the force scale by which a falling quantity may pass its limit at an event."""


class Chain:
    """Segments that followed one another last.

    Attributes:
        segments: k segments.
        following: what came of the event at the end of each.
        labels: (k,) quantities that reached their limits.
        rows: (k, 4N + watched) rates.
        changes: (node, old, new) of all changes of state, in order.
        event_of: (number of changes,) the event of each.
    """

    def __init__(self, segments: list[Segment], following: list[Following]) -> None:
        """Stack the rates."""
        self.segments, self.following = segments, following
        self.labels = np.array([step.label for step in following])
        self.rows = np.concatenate([segment.row for segment in segments])
        self.rows = self.rows.reshape(len(segments), -1)
        self.changes = [change for step in following for change in step.changes]
        self.event_of = np.repeat(
            np.arange(len(following)), [len(step.changes) for step in following]
        )

    def matches(self, following: list[Following]) -> bool:
        """Return whether this is the chain of the given events."""
        known = self.following
        return len(known) == len(following) and all(map(is_, known, following))


class Replay:
    """Replays chains of known segments along one leg.

    Attributes:
        active: whether to replay at all; not where every event is to be passed by itself.
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
        a, b = point.problem.ends
        self._direction = b - a
        self._watch: Watch | None = sums.watch
        self.active, self._wait = True, 0
        n_watched = 0 if sums.watch is None else len(sums.watch.rows)
        self._passed = PASSED_BY_ROUND_OFF * EPSILON * scale / segments.weight
        # what has to stay above it: gap, A, B, then the watched quantities
        self._floor = np.concatenate(
            [-self._passed[n:], np.full(n_watched, LIMIT_TOLERANCE * scale)]
        )
        self._lowest = -LIMIT_TOLERANCE * scale / segments.weight[n:]

    def follow(self, segment: Segment, s_end: float, course: Course) -> Segment | None:
        """Pass all events of the known chain that hold, those at or beyond ``s_end`` left out.

        Args:
            segment: rates at the present point.
            s_end: place before which the events have to be.
            course: takes samples, events and stops.

        Returns:
            The rates after the last event passed; None where none was.
        """
        point = self._point
        self._wait -= 1
        if self._wait > 0 or not self.active:
            return None
        chain = self._foreseen(segment)
        if chain is None:
            return None
        s, y = self._verified(chain, s_end)
        m = len(s)
        self._adapt(m, len(chain.labels))
        if m == 0:
            return None
        last = chain.following[m - 1]
        states = [point.state, *(step.state for step in chain.following[:m])]
        stops = np.concatenate([[point.s], s])
        self._note(chain, s, y[1:], states, course)
        self._sums.add_verified(stops, y, states[:-1])
        point.s, point.state, point.y[:] = float(s[-1]), last.state, y[-1]
        # what has reached its limit and stays there is exactly zero
        reached = chain.labels[:m]
        point.y[reached[point.y[reached] <= self._passed[reached]]] = 0.0
        self._round_off.note_balanced()
        return last.segment

    def _foreseen(self, segment: Segment) -> Chain | None:
        """Return the chain of segments that followed one another last; None if it is too short."""
        longest, known = self._segments.pace.longest, self._segments.chains
        start, step, segments = segment, segment.last, []
        following: list[Following] = []
        while step is not None and len(following) < longest:
            segments.append(segment)
            following.append(step)
            segment = step.segment
            step = segment.last
        if len(following) < SHORTEST:
            return None
        chain = known.pop(id(start), None)
        if chain is None or not chain.matches(following):
            self._complete(segments)
            chain = Chain(segments, following)
        known[id(start)] = chain
        if len(known) > KEPT_CHAINS:
            del known[next(iter(known))]
        return chain

    def _adapt(self, passed: int, foreseen: int) -> None:
        """Adapt the length of the next replay, and how long to wait for it."""
        pace = self._segments.pace
        if passed == foreseen:
            pace.longest = min(2 * pace.longest, LONGEST)
        else:
            pace.longest = min(max(pace.longest // 4, 2 * passed, SHORTEST), LONGEST)
        if passed < min(foreseen, WORTH_WHILE):
            self._wait = pace.pause = min(2 * pace.pause + 2, LONGEST_PAUSE)
        else:
            pace.pause //= 4

    def _note(
        self, chain: Chain, places: Array, y: Array, states: list[States], course: Course
    ) -> None:
        """Note events, samples and stops; move the point to the event before the last sample."""
        point, s, of = self._point, places.tolist(), chain.event_of
        of = of[: np.searchsorted(of, len(s))]
        made = zip(places[of].tolist(), chain.changes, strict=False)
        course.events += [(at, *change) for at, change in made]
        if course.stops:
            course.stops += [(at, point.displacements(row)) for at, row in zip(s, y, strict=True)]
        while course.sample_at and course.sample_at[0] <= s[-1]:
            k = int(np.searchsorted(places, course.sample_at[0]))
            if k > 0:
                point.s, point.y[:], point.state = s[k - 1], y[k - 1], states[k]
            course.sample(point, chain.segments[k].q, s[k])

    def _verified(self, chain: Chain, s_end: float) -> tuple[Array, Array]:
        """Return the events of a chain up to the first one that does not hold.

        Returns:
            (m,) places of the events, and (m + 1, 4N) quantities at the present point and at them.
        """
        point, rows, labels = self._point, chain.rows, chain.labels
        s, y = np.zeros(0), point.y[None]
        h, singular = dtrtrs(rows[:, labels], -point.y[labels], trans=1)
        if singular:
            return s, y
        places = point.s + h.cumsum()
        m = _leading((h >= 0.0) & (places < s_end))
        if m == 0:
            return s, y
        y = self._summed(h[:m], rows[:m], labels[:m])
        m = self._within_limits(y[1:], chain)
        s, y = places[:m], y[: m + 1, : 4 * len(point.state)]
        if m == 0:
            return s, y
        m = _leading(self._round_off.balanced(s, y[1:]))
        if m == 0:
            self._round_off.remove_if_grown()
        return s[:m], y[: m + 1]

    def _complete(self, chain: list[Segment]) -> None:
        """Add the rates of the watched quantities to the segments that lack them."""
        new = list({id(segment): segment for segment in chain if segment.row is None}.values())
        if not new:
            return
        rows = np.array([segment.q for segment in new])
        if self._watch is not None:
            loads = np.broadcast_to(self._direction, (len(new), len(self._direction)))
            rates = np.hstack([rows[:, : 2 * len(self._point.state)], loads])
            rows = np.hstack([rows, rates @ self._watch.rows.T])
        for segment, row in zip(new, rows, strict=True):
            segment.row = row.copy()

    def _summed(self, h: Array, rows: Array, labels: Array) -> Array:
        """Return all quantities at the present point and at the events, the watched ones last."""
        point = self._point
        y = np.empty((len(h) + 1, rows.shape[1]))
        y[0, : len(point.y)] = point.y
        if self._watch is not None:
            now = np.concatenate([point.displacements(point.y), point.load])
            y[0, len(point.y) :] = self._watch.rows @ now
        np.multiply(h[:, None], rows, out=y[1:])
        for before, row in pairwise(y):
            row += before
        y[np.arange(1, len(y)), labels] = 0.0
        return y

    def _within_limits(self, y: Array, chain: Chain) -> int:
        """Return how many events are reached before a quantity has passed its limit."""
        n = len(self._point.state)
        low = y[:, n:] < self._floor
        for k in np.flatnonzero(low.any(axis=1)).tolist():
            passed = np.flatnonzero(low[k])
            if passed[-1] >= 3 * n or np.any(y[k, n + passed] < self._lowest[passed]):
                return k
            # what falls too slowly to count as falling may pass by as much as counts as on a limit
            if np.isin(n + passed, chain.segments[k].falling).any():
                return k
        return len(y)


def _leading(holds: NDArray[np.bool_]) -> int:
    """Return how many of the first entries hold."""
    return len(holds) if holds.all() else int(holds.argmin())
