"""What adds up along a leg: dissipation, work of the loads, and the residual at every event.

Between two stops (events, ends) forces and displacements are linear, so that the mean force counts.
Stops are collected and summed up many at once, to save time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.law import FORWARD
from receding_fenicsx.interface.residual import law_residual, local_stiffness, reachable
from receding_fenicsx.interface.system import Array

EVENT_RESIDUAL = 1e-11
"""Largest residual of the contact law, freshly evaluated, that is accepted after any event."""

STOPS = 512
"""Stops after which they are summed up."""

Watch = Callable[[Array, Array, float], NDArray[np.intp]]
"""Looks at displacements (k, 2N) and load factors (k, n_loads) for a force scale."""


class Sums:
    """Dissipation, work and residual of a leg under way.

    Attributes:
        dissipation: (N,) frictional dissipation.
        work: (n_loads,) integral of lambda_k r*_k . du.
        residual: largest residual at the stops that were looked at afresh, over ``force_scale``.
        start: (2N,) displacements at the leg's start.
        excess: by how much a residual was above what is accepted there.
        force_scale: largest nodal force of the history so far.
        found: what ``watch`` has found.
    """

    def __init__(
        self,
        segments: Segments,
        ends: tuple[Array, Array],
        force_scale: float,
        start: tuple[float, Array, States],
        check_all: bool,
        watch: Watch | None,
    ) -> None:
        """Stand at the start of a leg.

        Args:
            segments: rates in known sets of states.
            ends: (n_loads,) load factors at the leg's start and end.
            force_scale: largest nodal force of the history so far.
            start: place on the leg, quantities y and states.
            check_all: evaluate the residual afresh at every stop.
            watch: looks at every stop.
        """
        n = segments.system.n
        self.segments, self.system, self.ends = segments, segments.system, ends
        self.force_scale, self.check_all, self.watch = force_scale, check_all, watch
        self.stiffness = local_stiffness(self.system)
        self.gaps = bool(np.any(self.system.g0))
        self.dissipation, self.work, self.residual = np.zeros(n), np.zeros(len(ends[0])), 0.0
        self.start = start[1][: 2 * n] - np.concatenate([np.zeros(n), self.system.g0])
        self.excess, self.found = 0.0, np.zeros(0, dtype=np.intp)
        self.go_on_from(*start)

    @property
    def state(self) -> States:
        """(N,) states on the way to the last stop."""
        return self._stops[-1][2]

    def go_on_from(self, s: float, y: Array, state: States) -> None:
        """Begin a sum at a place of the leg, from quantities y (4N,) and states."""
        self._stops = [(s, y.copy(), state)]

    def pass_stop(self, s: float, y: Array, state: States) -> None:
        """Take note of a stop: its place, the quantities y (4N,), the states on the way there."""
        self._stops.append((s, y.copy(), state))
        if len(self._stops) > STOPS:
            self.add_up()

    def add_up(self) -> None:
        """Add what the stops since the last sum bring, and check their residuals."""
        if len(self._stops) == 1:  # the leg ended where the last sum did
            return
        n, system, (a, b) = self.system.n, self.system, self.ends
        s = np.array([stop[0] for stop in self._stops])[:, None]
        y = np.concatenate([stop[1] for stop in self._stops]).reshape(-1, 4 * n)
        u, load = y[:, : 2 * n], (1.0 - s) * a + s * b
        if self.gaps:
            u = u - np.concatenate([np.zeros(n), system.g0])
        a, b = system.friction.shares
        twice_Q = 2.0 * a * y[:, 2 * n : 3 * n] - 2.0 * b * y[:, 3 * n :]
        slip = u[1:, :n] - u[:-1, :n]
        dissipation = -0.25 * np.einsum("ij,ij->j", twice_Q[1:] + twice_Q[:-1], slip)
        self.dissipation += np.where(self.segments.frictional, dissipation, 0.0)
        stroke = np.diff(u @ system.r_star.T, axis=0)
        self.work += (0.5 * (load[1:] + load[:-1]) * stroke).sum(axis=0)
        if self.watch is not None:
            found = self.watch(u[1:], load[1:], self.force_scale)
            self.found = np.union1d(self.found, found)
        if self.check_all or self._doubt(y, load) > EVENT_RESIDUAL:
            states = np.array([stop[2] for stop in self._stops[1:]])
            self._check(u[1:], load[1:], slip, states)
        self._stops = self._stops[-1:]

    def accepted(self, u: Array) -> float:
        """Return the residual that is accepted at displacements u, over the force scale so far.

        Forces may be small at the beginning of a leg beside those of its end, and displacements at
        the end beside those of the beginning, whose round-off is carried along.
        """
        excused = (reachable(self.system, at, self.force_scale) for at in (self.start, u))
        return max(EVENT_RESIDUAL, *excused)

    def _doubt(self, y: Array, load: Array) -> float:
        """Return by how much, over all stops, a limit is passed, or Q and P do not belong to u.

        Both relative to the force scale.
        """
        n = self.system.n
        passed = -float((y[1:, n:].min(axis=0) * self.segments.weight[n:]).min())
        return max(passed, self.segments.imbalance(y, load)) / self.force_scale

    def _check(self, u: Array, load: Array, slip: Array, states: NDArray[np.int8]) -> None:
        """Evaluate the residual afresh at several stops, slip being that of the piece before."""
        r = load @ self.system.r_star + u @ self.system.K
        moved = np.where(states >= FORWARD, slip, 0.0)
        self.force_scale = max(self.force_scale, float(np.abs(r).max()))
        residuals = law_residual(self.system, r, u, moved, self.stiffness).max(axis=1)
        residuals /= self.force_scale
        self.residual = max(self.residual, float(residuals.max()))
        for k in np.flatnonzero(residuals > EVENT_RESIDUAL):
            self.excess = max(self.excess, float(residuals[k]) - self.accepted(u[k]))
