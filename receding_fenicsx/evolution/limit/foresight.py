"""Drifts of the cycles to come, to first order, and how well they foresaw those that have come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.limit.drifts import OVERSHOT, Drifts
from receding_fenicsx.evolution.limit.frozen import NoLimit
from receding_fenicsx.interface.lcp import lemke

SURPRISE = 2.0
"""Error of the cycle before, over what a node still lacks, from which it may pass its limit."""

MAX_GUESSES = 50
"""Guesses which nodes slip in a cycle."""


def cycles_to_come(drifts: Drifts) -> Iterator[tuple[Array, Array]]:
    """Yield the drifts (2k,) after each cycle to come, and the margins (2k,) that they leave.

    In each cycle the drifts grow by slips s >= 0 that end where no margin is negative:

        m + R_0 s >= 0,  s . (m + R_0 s) = 0,   m = m_0 + sum over slips s' before of R_l s' ,

    m_0 being the margins without slips and R_l the response l cycles after a slip.

    Raises:
        NoLimit: the slips of a cycle were not found.
    """
    margins, M = drifts.margins, drifts.responses[-1]
    slips, memory = Slips(drifts.responses[0]), (drifts.responses[1:-1] - M).transpose(1, 0, 2)
    past, slipping = np.zeros(memory.shape[1:]), np.zeros(len(M), dtype=bool)
    remembered = memory[:, :, slipping].reshape(len(M), -1)
    y, left = drifts.begun.copy(), margins[-1].copy()
    for cycle in count():
        lasting = margins[min(cycle, len(margins) - 1)] - margins[-1]
        s = drifts.pace * slips.of(left + lasting + remembered @ past[:, slipping].ravel())
        if np.any(s[~slipping]):
            slipping = slipping | (s > 0.0)
            remembered = memory[:, :, slipping].reshape(len(M), -1)
        y += s
        left += M @ s
        past = np.vstack([s, past])[: len(past)]
        yield y, left


def errors_of(before: Drifts, now: Drifts) -> tuple[Array, Array]:
    """Return how far drifts (k,) were foreseen wrongly a cycle before, and what they still lack."""
    foreseen, _ = next(cycles_to_come(before))
    k = len(now.stiffness)
    then, made, limit = (y[:k] - y[k:] for y in (foreseen, now.begun, now.limit))
    return np.abs(made - then), np.abs(limit - made)


def error_of(before: Drifts, now: Drifts) -> float:
    """Return how far drifts were foreseen wrongly a cycle before, over what they still lack."""
    error, lacking = (float(of.max()) for of in errors_of(before, now))
    return error / lacking if lacking > 0.0 else 0.0


def slowed(before: Drifts, now: Drifts) -> Drifts:
    """Return drifts of which as small a part is made in each cycle as was made in the last."""
    foreseen, _ = next(cycles_to_come(before))
    slips, made = foreseen - before.begun, now.begun - before.begun
    pace = np.divide(made, slips, out=np.ones_like(slips), where=slips > 0.0)
    return replace(now, pace=np.clip(pace, 0.0, 1.0))


def is_as_foreseen(before: Drifts, now: Drifts, force: float) -> bool:
    """Return whether no node has slipped otherwise than foreseen by far more than it lacks now."""
    error, lacking = errors_of(before, now)
    return bool(np.all(now.stiffness * (error - SURPRISE * lacking) <= OVERSHOT * force))


class Slips:
    """Slips of a cycle: s >= 0 and m + R s >= 0 with s . (m + R s) = 0."""

    def __init__(self, R: Array) -> None:
        """Take the response of the margins to slips in the same cycle."""
        self.R = R
        self.active: NDArray[np.bool_] = np.zeros(len(R), dtype=bool)
        self._choose(self.active)

    def _choose(self, active: NDArray[np.bool_]) -> None:
        """Factor the response of the nodes that slip."""
        self.active, self._chosen = active, np.flatnonzero(active)
        self._columns = self.R[:, self._chosen]
        if len(self._chosen):
            self._factor = dgetrf(self._columns[self._chosen])

    def of(self, m: Array) -> Array:
        """Return the slips (k,) for the margins m without them.

        Raises:
            NoLimit: none were found.
        """
        for _ in range(MAX_GUESSES):
            s, left = np.zeros_like(m), m
            if len(self._chosen):
                lu, pivots, singular = self._factor
                if singular:
                    break
                slips = -dgetrs(lu, pivots, m[self._chosen])[0]
                s[self._chosen] = slips
                left = m + self._columns @ slips
            wanted = np.where(self.active, s > 0.0, left < 0.0)
            if np.array_equal(wanted, self.active):
                return s
            self._choose(wanted)
        found = lemke.solve(self.R, m, [np.ones(len(m))])
        if found is None:
            raise NoLimit("which nodes slip on the way to the limit is not decided")
        return found
