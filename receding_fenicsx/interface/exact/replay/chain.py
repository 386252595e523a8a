"""Chains of segments that have followed one another, their rates stacked."""

from __future__ import annotations

from collections import deque
from copy import copy
from operator import attrgetter, is_

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.accumulate import Rates, Sums
from receding_fenicsx.interface.exact.segments import Following, Segment, Segments
from receding_fenicsx.interface.exact.ties import tied

KEPT_CHAINS = 8
"""Chains that are kept."""

MISSED = 4
"""Times that the last events of a chain may differ before it is made anew."""


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
        """Stack the rates of the quantities that reach their limits."""
        self.segments, self.following, self.missed = segments, following, 0
        self.labels = np.array([step.label for step in following])
        self.triangle = np.array([segment.q[self.labels] for segment in segments]).T
        self.is_complete = False

    def complete(self, sums: Sums) -> None:
        """Make what the verification of its events needs."""
        k, n, following = len(self.labels), sums.system.n, self.following
        self.is_complete = True
        self.rows, self.rates = sums.rates(self.segments)
        ends = self.rows[:, n:] < 0.0
        ends[:-1] &= ~ends[1:]
        ends[np.arange(k), self.labels - n] = False
        # nonzero takes far less time on a flat array
        at, low = np.divmod(ends.ravel().nonzero()[0], ends.shape[1])
        self.low = low + n
        self.fall = self.rows[:, self.low]
        np.copyto(self.fall, 0.0, where=np.arange(k)[:, None] > at)
        changes = [change for step in following for change in step.changes]
        self.changes = tuple(zip(*changes, strict=True))
        self.event_of = np.repeat(np.arange(k), [len(step.changes) for step in following])

    def holding(self, begin: int, longest: int) -> int:
        """Return how many of its events from ``begin`` on are those that came last.

        0 to make it anew.
        """
        following, last = self.following[begin:], map(attrgetter("last"), self.segments[begin:])
        k = len(following)
        held = leading(np.fromiter(map(is_, last, following), bool, k))
        if held == k:
            can_grow = k < longest and following[-1].segment.last is not None
            return 0 if can_grow else k
        self.missed += 1
        return held if 2 * held >= k and self.missed < MISSED else 0

    def part(self, begin: int) -> Chain:
        """Return the part behind its first events."""
        one = copy(self)
        one.segments, one.following = self.segments[begin:], self.following[begin:]
        one.labels, one.rows = self.labels[begin:], self.rows[begin:]
        one.triangle, one.fall = self.triangle[begin:, begin:], self.fall[begin:]
        one.rates = Rates(*(rate[begin:] for rate in self.rates))
        first = int(self.event_of.searchsorted(begin))
        one.changes = tuple(part[first:] for part in self.changes)
        one.event_of = self.event_of[first:] - begin
        return one

    def quantities(self, y: Array, h: Array, columns: NDArray[np.intp] | slice) -> Array:
        """Return some of the quantities y at the end of each segment of length h."""
        k = len(h)
        at = y[columns] + (h[:, None] * self.rows[:k, columns]).cumsum(axis=0)
        at[self.labels[:k, None] == np.arange(len(y))[columns]] = 0.0
        return at

    def ties(
        self,
        segments: Segments,
        y: Array,
        h: Array,
        on_limit: Array,
        near: NDArray[np.bool_],
        s: float = 0.0,
    ) -> list[Changes]:
        """Return the ties at the events of several passages.

        Args:
            segments: of the contact.
            y: (c, 4N) quantities at the start.
            h: (c, m) lengths of the segments passed.
            on_limit: (4N,) distance from a limit up to which a node sits on it.
            near: (c, m) whether the quantities ``low`` come that near before they rise.
            s: place of the start.
        """
        n, begin = segments.system.n, self.following[0].state.copy()
        for i, old, _ in self.following[0].changes:
            begin[i] = old
        # what does not leave its limit
        stays = (y + h[:, :1] * self.segments[0].q <= on_limit)[:, n:]
        stays[:, self.labels[0] - n] = False
        nodes = [set((self.low[row] % n).tolist()) for row in near]
        passages = np.arange(len(y), dtype=float)
        for c, i, *_ in tied(segments, passages, np.broadcast_to(begin, (len(y), n)), stays):
            nodes[int(c)].add(i)
        found = list[Changes]()
        for c, chosen in enumerate(nodes):
            if not chosen:
                found.append(Changes.none())
                continue
            columns = np.add.outer(n * np.arange(1, 4), sorted(chosen)).ravel()
            on = np.zeros((h.shape[1], 3 * n), dtype=bool)
            on[:, columns - n] = self.quantities(y[c], h[c], columns) <= on_limit[columns]
            states = [begin, *(step.state for step in self.following[: len(on) - 1])]
            found.append(tied(segments, s + h[c].cumsum(), np.array(states), on))
        return found


class Chains:
    """The chains made last, found by any of their segments."""

    def __init__(self) -> None:
        """Keep none."""
        self._places: dict[int, tuple[Chain, int]] = {}
        self._kept: deque[Chain] = deque()

    def find(self, segment: Segment) -> tuple[Chain, int] | None:
        """Return the chain made last that holds a segment, and where in it."""
        return self._places.get(id(segment))

    def keep(self, chain: Chain) -> None:
        """Keep a chain, and forget the oldest one."""
        self._places.update({id(one): (chain, k) for k, one in enumerate(chain.segments)})
        self._kept.append(chain)
        if len(self._kept) > KEPT_CHAINS:
            oldest = self._kept.popleft()
            for one in oldest.segments:
                place = self.find(one)
                if place is not None and place[0] is oldest:
                    del self._places[id(one)]


def leading(holds: NDArray[np.bool_]) -> int:
    """Return how many of the first entries hold."""
    return len(holds) if holds.all() else int(holds.argmin())
