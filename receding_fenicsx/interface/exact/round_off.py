"""Round-off gathered along a leg: measured, removed, and its effect on displacements estimated.

Each event adds round-off to the quantities y, so that displacements and forces drift apart. Their
imbalance is measured from time to time and removed by one step of iterative refinement where it has
grown.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Sums
from receding_fenicsx.interface.exact.legs import Event, PathPoint
from receding_fenicsx.interface.exact.segments import EPSILON, Segments
from receding_fenicsx.interface.residual import ROUND_OFFS, limit_excuse, residual_at_rest
from receding_fenicsx.interface.system import ContactState

MEASURING_INTERVAL = 16
"""Events between two measurements of the imbalance at most; fewer while it grows fast."""

NODAL_IMBALANCE = 1e-13
"""Error of a nodal force, over the force scale, up to which an imbalance is never removed: summed
over 2N of them with random signs sqrt(2N) times as much."""

LARGE_AT_ENDS = 0.25
"""Part of the negligible imbalance from which it is removed at the end of a leg."""

FEWEST_SUMMED = 100
"""Forces for whose sum the tolerance allows at least."""

IMBALANCE_GROWTH = 2.0
"""Growth of the imbalance since the last refinement, as a factor, below which it is not removed."""

SIGN_PATTERNS = 8
"""Random sign patterns of round-off by which its effect on the displacements is estimated."""

ESTIMATED_STATES = 64
"""Last sets of states on a leg in which that effect is estimated."""

INHERITED_RESIDUAL = 2.0
"""Residual accepted over that of the leg's start, as a factor: stuck nodes keep its errors."""


class RoundOff:
    """Measures and removes the imbalance of a path between displacements and forces."""

    def __init__(self, segments: Segments, point: PathPoint, sums: Sums) -> None:
        """Start with nothing measured.

        Args:
            segments: of the condensed body.
            point: present point of the path; its y is corrected.
            sums: integrals along the leg, in which a correction does not count as slip.
        """
        self._segments, self._point, self._sums = segments, point, sums
        self._events, self._interval = 0, MEASURING_INTERVAL
        self._after_refinement = 0.0

    def imbalance(self) -> float:
        """Return the error between forces and displacements."""
        return self._segments.balance.error(self._point.y, self._point.load)

    def is_small(self) -> bool:
        """Return whether the imbalance need not be removed at the end of a leg."""
        return not self.imbalance() > LARGE_AT_ENDS * self._tolerance()

    def _tolerance(self) -> float:
        """Return the imbalance that does not matter."""
        return summed(self._segments.system.n, NODAL_IMBALANCE) * self._sums.force_scale

    def count_event(self) -> None:
        """Note an event; measure the imbalance when due.

        To be called in the new states: in the old ones a refinement would assign the round-off of
        all nodes on their limits to the one that has just reached its own.
        """
        self._events += 1
        if self._events >= self._interval:
            self.remove_if_grown()

    def _accepted(self) -> float:
        """Return the imbalance up to which none is removed."""
        return max(self._tolerance(), IMBALANCE_GROWTH * self._after_refinement)

    def remove_if_grown(self) -> None:
        """Remove the imbalance if it has grown; measure it the more often the faster it grows."""
        self._events = 0
        grown = self.imbalance() > self._accepted()
        interval = self._interval // 2 if grown else 2 * self._interval
        self._interval = min(max(interval, 1), MEASURING_INTERVAL)
        if grown:
            self.clear()

    def clear(self) -> None:
        """Remove the imbalance on the way; the correction does not count as slip."""
        point, self._events = self._point, 0
        self.remove()
        self._sums.restart(point.s, point.y, self._sums.state)

    def remove(self, steps: int = 4) -> ContactState:
        """Correct the displacements by iterative refinement; return the state.

        On soft springs a step may leave a large part of the error, that of the tableau's pivots.
        """
        refined = self.refined(self._point.s, self._point.y, steps)
        self._point.y[:] = self._segments.values(refined)
        self._after_refinement = self.imbalance()
        return refined

    def refined(self, s: float, y: Array, steps: int = 1) -> ContactState:
        """Return the state for quantities y (4N,) at s after iterative refinement.

        Fewer steps are taken where corrections become negligible or no longer smaller.
        """
        point, segments = self._point, self._segments
        n, now, last = segments.system.n, point.extrapolated(s, y), np.inf
        before = now
        for _ in range(steps):
            change = segments.tableau(point.state).correction(now.r)[: 2 * n]
            largest = float(np.abs(change * segments.weight[: 2 * n]).max())
            if largest >= last:
                return before
            before, last = now, largest
            now = point.with_displacements(s, now.u + change)
            if largest <= EPSILON * self._sums.force_scale:
                break
        return now


def summed(n: int, error: float) -> float:
    """Return the imbalance of n nodes whose forces have an error with random signs."""
    return error * sqrt(max(2 * n, FEWEST_SUMMED))


def displacement_uncertainty(
    segments: Segments,
    ends: tuple[ContactState, ContactState],
    events: Iterable[Event],
    force_scale: float,
) -> float:
    """Return the residual that round-off may leave in gaps and slips, over the force scale.

    Displacements are uncertain by the response of the body to round-off of the reactions: in a
    nearly singular body far more than the forces are. Stuck nodes keep the error of the start.

    Args:
        segments: of the condensed body.
        ends: states at the leg's start and end.
        events: changes of state on the leg.
        force_scale: largest nodal force of the history so far.
    """
    n, weight = segments.system.n, segments.weight
    reach: Array = np.abs(segments.system.K) @ np.max([np.abs(end.u) for end in ends], axis=0)
    signs = np.random.default_rng(0).choice([-EPSILON, EPSILON], (SIGN_PATTERNS, 2 * n))
    now = ends[0].state.copy()
    met = {now.tobytes(): now.copy()}
    for _, i, _, new in events:
        now[i] = new
        met[now.tobytes()] = now.copy()
    largest = 0.0
    for state in list(met.values())[-ESTIMATED_STATES:]:
        tableau = segments.tableau(state)
        for error in signs * reach:
            change = tableau.correction(error)[: 2 * n] * weight[: 2 * n]
            largest = max(largest, float(np.abs(change).max()))
    inherited = INHERITED_RESIDUAL * residual_at_rest(segments.system, ends[0], force_scale)
    excused = max(inherited, ROUND_OFFS * largest / force_scale)
    return limit_excuse(segments.system, excused, [end.u for end in ends], force_scale)
