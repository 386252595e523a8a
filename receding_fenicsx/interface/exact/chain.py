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

from dataclasses import dataclass
from itertools import pairwise

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

LONGEST_PAUSE = 32
"""Events after which a replay is tried again at most."""

PASSED_BY_ROUND_OFF = 8.0
"""Round-offs of the force scale by which a falling quantity may pass its limit at an event."""


@dataclass(frozen=True)
class Stretch:
    """Verified events of a chain.

    Attributes:
        s: (m,) places of the events.
        y: (m, 4N) quantities there.
        segments: m segments that lead to them.
        following: what came of each event.
    """

    s: Array
    y: Array
    segments: list[Segment]
    following: list[Following]


class Replay:
    """Replays chains of known segments along one leg."""

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
        self._wait = 0
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
        segments, point = self._segments, self._point
        self._wait -= 1
        if self._wait > 0:
            return None
        chain, following = _foreseen(segment, segments.pace.longest)
        if len(chain) < SHORTEST:
            return None
        passed = self._verified(chain, following, s_end)
        m = len(passed.s)
        self._adapt(m, len(chain))
        if m == 0:
            return None
        states = [point.state, *(step.state for step in passed.following)]
        self._note(passed, states, course)
        self._sums.add_stops(passed.s, passed.y, states[:-1], verified=True)
        last = passed.following[-1]
        point.s, point.state, point.y[:] = float(passed.s[-1]), last.state, passed.y[-1]
        # what has reached its limit and stays there is exactly zero
        reached = np.array([step.label for step in passed.following])
        zero = point.y[reached] <= self._passed[reached]
        point.y[reached[zero]] = 0.0
        self._round_off.note_balanced()
        return last.segment

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

    def _note(self, passed: Stretch, states: list[States], course: Course) -> None:
        """Note events, samples and stops; move the point to the event before the last sample."""
        point, s = self._point, passed.s.tolist()
        course.events += [
            (at, *change)
            for at, step in zip(s, passed.following, strict=True)
            for change in step.changes
        ]
        if course.stops:
            course.stops += [
                (at, point.displacements(y)) for at, y in zip(s, passed.y, strict=True)
            ]
        while course.sample_at and course.sample_at[0] <= s[-1]:
            k = int(np.searchsorted(passed.s, course.sample_at[0]))
            if k > 0:
                point.s, point.y[:], point.state = s[k - 1], passed.y[k - 1], states[k]
            course.sample(point, passed.segments[k].q, s[k])

    def _verified(self, chain: list[Segment], following: list[Following], s_end: float) -> Stretch:
        """Return the events of a chain up to the first one that does not hold."""
        point = self._point
        self._complete(chain)
        labels = np.array([step.label for step in following])
        rows = np.concatenate([segment.row for segment in chain]).reshape(len(chain), -1)
        h, singular = dtrtrs(rows[:, labels], -point.y[labels], trans=1)
        m = 0
        if not singular:
            s = point.s + h.cumsum()
            m = _leading((h >= 0.0) & (s < s_end))
        if m:
            y = self._summed(h[:m], rows[:m], labels[:m])
            m = self._within_limits(y, chain)
        if m:
            y = y[:m, : 4 * len(point.state)]
            m = _leading(self._round_off.balanced(s[:m], y))
            if m == 0:
                self._round_off.remove_if_grown()
        if not m:
            return Stretch(np.zeros(0), np.zeros((0, 0)), [], [])
        return Stretch(s[:m], y[:m], chain[:m], following[:m])

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
        """Return all quantities at the events, the watched ones last."""
        point = self._point
        y = h[:, None] * rows
        y[0, : len(point.y)] += point.y
        if self._watch is not None:
            now = np.concatenate([point.displacements(point.y), point.load])
            y[0, len(point.y) :] += self._watch.rows @ now
        for before, row in pairwise(y):
            row += before
        y[np.arange(len(y)), labels] = 0.0
        return y

    def _within_limits(self, y: Array, chain: list[Segment]) -> int:
        """Return how many events are reached before a quantity has passed its limit."""
        n = len(self._point.state)
        low = y[:, n:] < self._floor
        for k in np.flatnonzero(low.any(axis=1)).tolist():
            passed = np.flatnonzero(low[k])
            if passed[-1] >= 3 * n or np.any(y[k, n + passed] < self._lowest[passed]):
                return k
            # what falls too slowly to count as falling may pass by as much as counts as on a limit
            if np.isin(n + passed, chain[k].falling).any():
                return k
        return len(y)


def _foreseen(segment: Segment, longest: int) -> tuple[list[Segment], list[Following]]:
    """Return the chain of segments that followed one another last, and what came of each."""
    chain: list[Segment] = []
    following: list[Following] = []
    step = segment.last
    while step is not None and len(chain) < longest:
        chain.append(segment)
        following.append(step)
        segment = step.segment
        step = segment.last
    return chain, following


def _leading(holds: NDArray[np.bool_]) -> int:
    """Return how many of the first entries hold."""
    return len(holds) if holds.all() else int(holds.argmin())
