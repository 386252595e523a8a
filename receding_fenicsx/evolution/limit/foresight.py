"""Drifts of the cycles to come, to first order, and how well they foresaw those that have come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.limit.drifts import OVERSHOT, Drifts
from receding_fenicsx.evolution.limit.frozen import NoLimit
from receding_fenicsx.interface.exact.pivot_matrix import PivotData, PivotMatrix
from receding_fenicsx.interface.lcp import lemke

SURPRISE = 2.0
"""Error of the cycle before, over what a node still lacks, from which it may pass its limit."""

MAX_GUESSES = 50
"""Guesses which nodes slip in a cycle."""

FEW = 16
"""Nodes that begin or cease to slip up to which the response of the others is made use of."""

ROUND_OFF = 1e-11
"""Margin left where nodes slip, over the largest without slips, above which their response is made
anew."""


def cycles_to_come(drifts: Drifts) -> Iterator[tuple[Array, Array]]:
    """Yield the drifts (2k,) after each cycle to come, and the margins (2k,) that they leave.

    In each cycle the drifts grow by slips s >= 0 that end where no margin is negative:

        m + R_0 s >= 0,  s . (m + R_0 s) = 0,   m = m_0 + sum over slips s' before of R_l s' ,

    m_0 being the margins without slips and R_l the response l cycles after a slip.

    Raises:
        NoLimit: the slips of a cycle were not found.
    """
    margins, M = drifts.margins, drifts.responses[-1]
    slips, memory = Slips(drifts.responses[0], drifts.limit > 0.0), drifts.responses[1:-1] - M
    past, y, left = np.zeros(memory.shape[::2]), drifts.begun.copy(), margins[-1].copy()
    among, remembered = np.zeros(0, dtype=np.intp), np.zeros((len(M), 0))
    for cycle in count():
        fading = margins[min(cycle, len(margins) - 1)] - margins[-1]
        s = drifts.pace * slips.of(left + fading + remembered @ past[:, among].ravel())
        if among is not slips.among:
            among = slips.among
            remembered = memory[:, :, among].transpose(1, 0, 2).reshape(len(M), -1)
            lasting = M[:, among]
        y += s
        left += lasting @ s[among]
        past = np.vstack([s, past])[: len(past)]
        yield y, left


class Expected(NamedTuple):
    """Drifts (2k,) that a cycle was expected to lead to.

    Attributes:
        begun: those at its start.
        after: those foreseen for its end.
    """

    begun: Array
    after: Array


def expect(before: Drifts) -> Expected:
    """Return the drifts expected a cycle later; NoLimit where its slips are not found."""
    return Expected(before.begun, next(cycles_to_come(before))[0])


def errors_of(expected: Expected, now: Drifts) -> tuple[Array, Array]:
    """Return how far drifts (k,) were foreseen wrongly a cycle before, and what they still lack."""
    k = len(now.stiffness)
    then, made, limit = (y[:k] - y[k:] for y in (expected.after, now.begun, now.limit))
    return np.abs(made - then), np.abs(limit - made)


def error_of(expected: Expected, now: Drifts) -> float:
    """Return how far drifts were foreseen wrongly a cycle before, over what they still lack."""
    error, lacking = (float(of.max()) for of in errors_of(expected, now))
    return error / lacking if lacking > 0.0 else 0.0


def slowed(expected: Expected, now: Drifts) -> Drifts:
    """Return drifts of which as small a part is made in each cycle as was made in the last."""
    slips, made = expected.after - expected.begun, now.begun - expected.begun
    pace = np.divide(made, slips, out=np.ones_like(slips), where=slips > 0.0)
    return replace(now, pace=np.clip(pace, 0.0, 1.0))


def is_as_foreseen(expected: Expected, now: Drifts, force: float) -> bool:
    """Return whether no node has slipped otherwise than foreseen by far more than it lacks now."""
    error, lacking = errors_of(expected, now)
    return bool(np.all(now.stiffness * (error - SURPRISE * lacking) <= OVERSHOT * force))


class Slips:
    """Slips of a cycle: s >= 0 and m + R s >= 0 with s . (m + R s) = 0.

    Attributes:
        among: (j,) numbers of those that are expected to slip, or have slipped.
    """

    def __init__(self, R: Array, expected: NDArray[np.bool_]) -> None:
        """Take the response of the margins to slips in the same cycle, and which are expected."""
        self._unit, self._R = float(np.abs(np.diagonal(R)).max(initial=0.0)) or 1.0, R
        self._active = np.zeros(len(R), dtype=bool)
        self._begin(expected)

    def _begin(self, among: NDArray[np.bool_]) -> None:
        """Make the map from slips to margins among some, none of which slips yet."""
        self.among, k = np.flatnonzero(among), len(among)
        self._columns = self._R.take(self.among, axis=1)
        T = self._columns[self.among] / self._unit
        self._map = PivotMatrix(PivotData(T, self.among, k + self.among), 2 * k)

    def _choose(self, wanted: NDArray[np.bool_]) -> bool:
        """Make the margins of those that slip the inputs; return whether that is regular.

        None slips where it is not. The map is made anew where many change, or none.
        """
        k, changed = len(wanted), np.flatnonzero(wanted != self._active)
        known = np.isin(np.flatnonzero(wanted), self.among).all()
        before, self._active = self._active, wanted
        if known and 0 < len(changed) <= FEW:
            slipped = k * before[changed]
            outputs, inputs = (changed + slipped).tolist(), (changed + k - slipped).tolist()
            if all(map(self._map.exchange, outputs, inputs)):
                return True
        may = wanted.copy()
        may[self.among] = True
        self._begin(may)
        slipping = np.flatnonzero(wanted)
        if not len(slipping) or self._map.exchange_many(slipping, k + slipping):
            return True
        self._active = np.zeros(k, dtype=bool)
        return False

    def of(self, m: Array) -> Array:
        """Return the slips (k,) for the margins m without them.

        Raises:
            NoLimit: none were found.
        """
        for _ in range(MAX_GUESSES):
            slipping, s = np.flatnonzero(self._active), np.zeros_like(m)
            made = self._map.response(slipping, -m[slipping] / self._unit)
            s[self.among] = np.where(self._active[self.among], made, 0.0)
            left = m + self._columns @ s[self.among]
            wanted = np.where(self._active, s > 0.0, left < 0.0)
            off = np.abs(left[slipping]).max(initial=0.0)
            if np.array_equal(wanted, self._active) and off <= ROUND_OFF * np.abs(m).max():
                return s
            if not self._choose(wanted):
                break
        found = lemke.solve(self._R, m, [np.ones(len(m))])
        if found is None:
            raise NoLimit("which nodes slip on the way to the limit is not decided")
        return found
