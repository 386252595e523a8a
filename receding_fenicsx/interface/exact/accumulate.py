"""Integrals along a leg: dissipation, work of the loads, and the residual at every event.

Between two stops a and b (events, ends) forces and displacements are linear, so that

    dissipation = -(Q_a + Q_b)/2 (v_b - v_a),
    work = sum_k (lambda_a + lambda_b)_k/2 r*_k . (u_b - u_a)

are exact. Stops are collected and added up many at once, to save time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.legs import PathPoint
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.residual import law_residual, reachable

EVENT_RESIDUAL = 1e-11
"""Largest residual of the contact law, freshly evaluated, that is accepted after any event."""

STOPS_AT_ONCE = 128
"""Stops after which they are added up: enough to spare calls, few enough to stay in the cache."""


class Sums:
    """Dissipation, work and residual of a leg under way.

    Attributes:
        dissipation: (N,) frictional dissipation.
        work: (n_loads,) integral of lambda_k r*_k . du.
        residual: largest residual at the stops where it was evaluated afresh, over ``force_scale``.
        start: (2N,) displacements at the leg's start.
        excess: largest amount by which a residual exceeded what is accepted there.
        force_scale: largest nodal force of the history so far.
        ties: nodes on limits at the stops, see :attr:`Leg.ties`, in parts.
    """

    def __init__(self, segments: Segments, point: PathPoint, check_all: bool) -> None:
        """Start at the beginning of a leg.

        Args:
            segments: rates in known sets of states.
            point: the start.
            check_all: evaluate the residual afresh at every stop.
        """
        n = segments.system.n
        self.segments, self.system, self.problem = segments, segments.system, point.problem
        self.force_scale, self.check_all = point.problem.force_scale, check_all
        self.stiffness = segments.stiffness
        self.gaps = bool(np.any(self.system.g0))
        self.dissipation, self.residual, self.excess = np.zeros(n), 0.0, 0.0
        self.work = np.zeros(len(self.system.r_star))
        self.start = point.y[: 2 * n] - np.concatenate([np.zeros(n), self.system.g0])
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


def tied(
    segments: Segments, places: Array, states: NDArray[np.int8], on: NDArray[np.bool_]
) -> Changes:
    """Return the ties of several instants, as changes to the state that a node may take as well.

    That is a direction of slip, or SEPARATION where it has neither gap nor pressure and may take
    any.

    Args:
        segments: of the condensed body.
        places: (k,) of the instants.
        states: (k, N) states.
        on: (k, 3N) gap, A and B that are within round-off of zero, B of nodes without friction too.
    """
    n, frictional = segments.system.n, segments.frictional
    gap, A, B = on[:, :n], on[:, n : 2 * n], on[:, 2 * n :]
    touches = np.where(states == SEPARATION, gap, A & B)
    near = touches | (A | B) & (states == STICK) & frictional
    near &= frictional | segments.smooth
    rows, nodes = near.nonzero()
    if not len(rows):
        return Changes.none()
    side = np.where(A[rows, nodes], FORWARD, BACKWARD)
    other = np.where(touches[rows, nodes], SEPARATION, side)
    return Changes(places[rows], nodes, states[rows, nodes], other.astype(np.int8))


def ties_at(segments: Segments, s: float, y: Array, state: States, force_scale: float) -> Changes:
    """Return the ties at one place, with quantities y (4N,) and states (N,), see :func:`tied`."""
    n = len(state)
    on = y[n:] <= segments.limit[n:] * force_scale
    return tied(segments, np.array([s]), state[None], on[None])
