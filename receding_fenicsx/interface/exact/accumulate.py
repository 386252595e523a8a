"""Integrals along a leg: dissipation, work of the loads, and the residual at every event.

Between two stops a and b (events, ends) forces and displacements are linear, so that

    dissipation = -(Q_a + Q_b)/2 (v_b - v_a),
    work = sum_k (lambda_a + lambda_b)_k/2 r*_k . (u_b - u_a)

are exact. Stops are collected and added up many at once, to save time.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.balance import RANDOM_SUMS
from receding_fenicsx.interface.exact.legs import PathPoint
from receding_fenicsx.interface.exact.segments import Segment, Segments, States
from receding_fenicsx.interface.exact.ties import tied
from receding_fenicsx.interface.law import FORWARD
from receding_fenicsx.interface.residual import law_residual, reachable

EVENT_RESIDUAL = 1e-11
"""Largest residual of the contact law, freshly evaluated, that is accepted after any event."""

STOPS_AT_ONCE = 128
"""Stops after which they are added up: enough to spare calls, few enough to stay in the cache."""


class Watch(NamedTuple):
    """Quantities outside the contact of a path that have to stay positive.

    Attributes:
        rows: (k, 2N + n_loads) the quantities, as forces, from displacements and load factors.
        reached: returns nodes to report, from displacements (k, 2N), load factors (k, n_loads) and
            the force scale.
    """

    rows: Array
    reached: Callable[[Array, Array, float], NDArray[np.intp]]


class Rates(NamedTuple):
    """Rates of what is summed along k segments.

    Attributes:
        slip: (k, N) of v.
        resisting: (k, N) of -Q at nodes with friction, 0 at others.
        stroke: (k, n_loads) of r*_k . u.
        imbalance: (k, sums) of the sums of :class:`BalanceCheck`.
    """

    slip: Array
    resisting: Array
    stroke: Array
    imbalance: Array


def sum_rows(rows: Array) -> None:
    """Add to each row all rows before it, in less time than ``cumsum`` takes."""
    for before, row in pairwise(rows):
        np.add(row, before, out=row)


class Sums:
    """Dissipation, work and residual of a leg under way.

    Attributes:
        dissipation: (N,) frictional dissipation.
        work: (n_loads,) integral of lambda_k r*_k . du.
        residual: largest residual at the stops where it was evaluated afresh, over ``force_scale``.
        start: (2N,) displacements at the leg's start.
        excess: largest amount by which a residual exceeded what is accepted there.
        force_scale: largest nodal force of the history so far.
        watched: nodes that ``watch`` has reported.
        ties: nodes on limits at the stops, see :attr:`Leg.ties`, in parts.
    """

    def __init__(
        self, segments: Segments, point: PathPoint, check_all: bool, watch: Watch | None
    ) -> None:
        """Start at the beginning of a leg.

        Args:
            segments: rates in known sets of states.
            point: the start.
            check_all: evaluate the residual afresh at every stop.
            watch: looks at every stop.
        """
        n = segments.system.n
        self.segments, self.system, self.problem = segments, segments.system, point.problem
        self.force_scale, self.check_all, self.watch = point.problem.force_scale, check_all, watch
        self.stiffness = segments.stiffness
        self.gaps = bool(np.any(self.system.g0))
        self.dissipation, self.residual, self.excess = np.zeros(n), 0.0, 0.0
        self.work = np.zeros(len(self.system.r_star))
        self.start = point.y[: 2 * n] - np.concatenate([np.zeros(n), self.system.g0])
        self.watched = np.zeros(0, dtype=np.intp)
        self.ties = list[Changes]()
        self._y = np.empty((STOPS_AT_ONCE + 1, 4 * n))
        self._begin(point.s, point.y, point.state)

    @property
    def state(self) -> States:
        """(N,) states on the way to the last stop."""
        return self._states[-1]

    def _begin(self, s: float, y: Array, state: States) -> None:
        """Start with one stop."""
        self._y[0] = y
        self._places, self._states, self._breaks = [s], [state], list[int]()

    def restart(self, s: float, y: Array, state: States) -> None:
        """Continue from another point, with quantities y (4N,) and states.

        What lies between the last stop and there is not added up.
        """
        if len(self._places) == 1:
            self._begin(s, y, state)
        else:
            self._breaks.append(len(self._places) - 1)
            self.add_stop(s, y, state)

    def add_stop(self, s: float, y: Array, state: States) -> None:
        """Record a stop: its place, the quantities y (4N,), the states on the way there."""
        places = self._places
        self._y[len(places)] = y
        places.append(s)
        self._states.append(state)
        if len(places) == len(self._y):
            self.add_up()

    def rates(self, segments: list[Segment]) -> tuple[Array, Rates]:
        """Return the rates of the quantities, and of the integrals, along k segments.

        What is watched and the imbalance are computed once and kept.

        Returns:
            (k, 4N + watched) rates of y and of the watched quantities, and those of the integrals.
        """
        n, (a, b) = self.system.n, self.problem.ends
        new = [segment for segment in segments if segment.checked is None]
        if new:
            q = np.array([segment.q for segment in new])
            made = self.segments.balance.errors(q, b - a, of_rates=True)
            if self.watch is not None:
                on_u, on_load = self.watch.rows[:, : 2 * n], self.watch.rows[:, 2 * n :]
                made = np.hstack([q[:, : 2 * n] @ on_u.T + on_load @ (b - a), made])
            for segment, row in zip(new, made, strict=True):
                segment.checked = row
        checked = np.array([segment.checked for segment in segments], dtype=float)
        table = np.empty((len(segments), 4 * n + checked.shape[1]))
        y, table[:, 4 * n :] = table[:, : 4 * n], checked
        y[:] = np.array([segment.q for segment in segments])
        rows, imbalance = table[:, :-RANDOM_SUMS], table[:, -RANDOM_SUMS:]
        stroke = y[:, : 2 * n] @ self.system.r_star.T
        return rows, Rates(y[:, :n], self._resisting(y), stroke, imbalance)

    def add_segments(self, h: Array, s: Array, y: Array, rates: Rates) -> None:
        """Add segments at whose ends nothing is suspected, nor any watched quantity near its limit.

        The last stop is to be restarted from their end.

        Args:
            h: (m,) their lengths, from the last stop.
            s: (m,) places of their ends.
            y: (4N,) quantities at the last stop.
            rates: of m segments or more.
        """
        m, (a, b) = len(h), self.problem.ends
        middle = h[:, None] * rates.resisting[:m]
        half = 0.5 * middle
        sum_rows(middle)
        middle -= half
        middle += self._resisting(y)
        middle *= rates.slip[:m]
        self.dissipation += h @ middle
        middle_load = a + (s - 0.5 * h)[:, None] * (b - a)
        self.work += h @ (rates.stroke[:m] * middle_load)

    def add_up(self, at_end: bool = False) -> None:
        """Add up the stops since the last time, and check their residuals.

        Args:
            at_end: the last stop is the leg's end, which is checked once its round-off is removed.
        """
        if len(self._places) == 1:  # nothing new
            return
        y = self._y[: len(self._places)]
        limit = self.segments.limit[self.system.n :] * self.problem.force_scale
        on = y[:-1, self.system.n :] <= limit
        places = np.array(self._places)
        self.ties.append(tied(self.segments, places, np.array(self._states[:-1]), on))
        u, load, slip = self._integrate(places[:, None], y)
        if self.watch is not None:
            reported = self.watch.reached(u[1:], load[1:], self.force_scale)
            if len(reported):
                self.watched = np.union1d(self.watched, reported)
        if at_end:
            y, u, load, slip = y[:-1], u[:-1], load[:-1], slip[:-1]
        if len(slip) and (self.check_all or self._suspected_error(y, load) > EVENT_RESIDUAL):
            self._check(u[1:], load[1:], slip, np.array(self._states[1 : len(u)]))
        self._begin(self._places[-1], self._y[len(self._places) - 1], self._states[-1])

    def _integrate(self, s: Array, y: Array) -> tuple[Array, Array, Array]:
        """Add dissipation and work between stops; return displacements, loads and slips there."""
        n, (a, b) = self.system.n, self.problem.ends
        u, load = y[:, : 2 * n], (1.0 - s) * a + s * b
        if self.gaps:
            u = u - np.concatenate([np.zeros(n), self.system.g0])
        slip = u[1:, :n] - u[:-1, :n]
        slip[self._breaks] = 0.0
        resisting = self._resisting(y)
        self.dissipation += 0.5 * np.einsum("ij,ij->j", resisting[1:] + resisting[:-1], slip)
        stroke = u @ self.system.r_star.T
        stroke = stroke[1:] - stroke[:-1]
        stroke[self._breaks] = 0.0
        self.work += (0.5 * (load[1:] + load[:-1]) * stroke).sum(axis=0)
        return u, load, slip

    def _resisting(self, y: Array) -> Array:
        """Return -Q = b B - a A from quantities y (4N,) or (k, 4N); 0 at nodes without friction."""
        n, (of_A, of_B) = self.system.n, self.segments.shares
        return y[..., 3 * n :] * of_B - y[..., 2 * n : 3 * n] * of_A

    def accepted(self, u: Array) -> float:
        """Return the residual that is accepted at displacements u, over the force scale so far.

        Forces at the start of a leg may be small against those of its end, and displacements at the
        end small against those of the start, whose round-off remains in them.
        """
        accepted = (reachable(self.system, at, self.force_scale) for at in (self.start, u))
        return max(EVENT_RESIDUAL, *accepted)

    def _suspected_error(self, y: Array, load: Array) -> float:
        """Return the largest error over all stops, over the force scale, at little cost.

        It is the amount by which a limit is passed, or by which Q and P do not belong to u.
        """
        n = self.system.n
        passed = -float((y[1:, n:].min(axis=0) * self.segments.weight[n:]).min())
        return max(passed, self.segments.balance.error(y, load)) / self.force_scale

    def _check(self, u: Array, load: Array, slip: Array, states: NDArray[np.int8]) -> None:
        """Evaluate the residual afresh at several stops, with the slip of the segment before."""
        r = load @ self.system.r_star + u @ self.system.K
        moved = np.where(states >= FORWARD, slip, 0.0)
        self.force_scale = max(self.force_scale, float(np.abs(r).max()))
        residuals = law_residual(self.system, r, u, moved, self.stiffness).max(axis=1)
        residuals /= self.force_scale
        self.residual = max(self.residual, float(residuals.max()))
        for k in np.flatnonzero(residuals > EVENT_RESIDUAL):
            self.excess = max(self.excess, float(residuals[k]) - self.accepted(u[k]))
