"""One part of a load step: accepted where a quasi-static path leads through it, else divided."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NotConverged, SolveError
from receding_fenicsx.interface.exact.first_loading import load_from_rest
from receding_fenicsx.interface.exact.unloading import is_at_rest, is_closed
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    Stalled,
    Step,
    solve_step,
)
from receding_fenicsx.interface.load_steps.continuation import Continuation
from receding_fenicsx.interface.load_steps.leg_in_steps import LegInSteps
from receding_fenicsx.interface.residual import is_carried_by_round_off
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import STEP_ON_LIMIT

SMALLEST_PART = 1e-9
"""Part of the leg that is not divided further: what changes there by a finite amount jumps."""

FINITE_CHANGE = 1e-5
"""Change of displacement, as a force over the largest nodal force, above which it is finite."""

STEP_ERROR = 0.5
"""Distance between the ends of a load step and of the exact path, over the length of the latter, up
to which it is the error of a step in time."""

SMALL_STEP_ERROR = 0.02
"""The same distance up to which sweeps from a better initial guess are not tried."""


@dataclass(frozen=True)
class Trial:
    """Result of a trial of one part of a load step.

    Attributes:
        found: a step or a piece of the exact path that is accepted; the error at which the path
            ends; None where the part has to be divided.
        s: place up to which ``found`` leads, or up to which to try next.
    """

    found: Step | Leg | SolveError | None
    s: float


class StepTrials:
    """Tries parts of load steps by Gauss-Seidel, and compares them with the exact path.

    Attributes:
        continuation: looks for quasi-static paths through the parts.
    """

    def __init__(self, system: ContactSystem, options: GaussSeidelOptions) -> None:
        """Prepare for ``system`` in 2N form."""
        self.system, self.options = system, options
        self.continuation = Continuation(system)

    def attempt(self, leg: LegInSteps, s: float, s_to: float) -> Trial:
        """Try the part of a load step from the state reached at s to ``s_to``.

        1. Solve the step by sweeps; accept it where the straight path to its end keeps the law.
        2. Otherwise follow the exact path. Where it leads through the part, accept a step that
           ends near it; without one take the exact path itself (sweeps stalled, or the part is the
           smallest) or halve the part.
        3. Where the exact path ends inside, take it up to there, and then try the smallest part:
           the path continues where the change of displacement is not finite.
        """
        load = leg.load(s_to)
        step = None
        with suppress(Stalled):  # the exact path takes over
            step = self._solve(leg, load)
        scale = leg.leg.force_scale if step is None else step.force_scale
        if step is not None and self.continuation.is_straight(leg.end, step.end, scale):
            return Trial(step, s_to)
        start = leg.rest(s, scale)
        path = self.continuation.follow(start, s_to, leg.limit)
        is_smallest = s_to - s <= 1.5 * SMALLEST_PART
        if path.error is None:
            # where nothing presses a free body sweeps may leave it anywhere off its plane
            allowed = SMALL_STEP_ERROR if path.at_rest else STEP_ERROR
            near = None if step is None else self._nearest(leg, load, path.end, step, allowed)
            if near is not None:
                return Trial(near, s_to)
            if is_smallest or step is None:
                return Trial(path.finish(), s_to)
            if path.at_rest:
                with suppress(SolveError):
                    return Trial(path.finish(), s_to)
            return Trial(None, 0.5 * (s + s_to))
        at_start = leg.problem.ends[0]
        unloaded = s == 0.0 and not np.any(at_start)
        segments = self.continuation.segments
        if unloaded and is_at_rest(self.system, at_start) and is_closed(segments, leg.end, scale):
            # from rest all grows in proportion to the load: one static problem
            first = replace(start, ends=(at_start, load), samples=())
            with suppress(SolveError):
                return Trial(load_from_rest(segments, first, leg.limit), s_to)
        if step is not None and unloaded and isinstance(path.error, NoEquilibrium):
            # a free body that touches nowhere yet falls on the plane
            return Trial(step, s_to)
        if is_smallest:
            if step is None:
                with suppress(NotConverged):
                    step = self._solve(leg, load, patient=True)
            if step is not None:
                change = self.continuation.size(step.end.u - leg.end.u) / step.force_scale
                return Trial(step if change <= FINITE_CHANGE else path.error, s_to)
            return Trial(path.error, s_to)
        if path.s - s > SMALLEST_PART:
            with suppress(SolveError):
                return Trial(path.walk.stop_here(), path.s)
        return Trial(None, s + SMALLEST_PART)

    def _solve(
        self,
        leg: LegInSteps,
        load: Array,
        guess: ContactState | None = None,
        patient: bool = False,
    ) -> Step:
        """Solve a part by sweeps, which may creep to the largest number of them if ``patient``."""
        scale, options = leg.leg.force_scale, self.options
        if patient:
            options = replace(options, stalled_sweeps=options.max_sweeps)
        step = solve_step(self.system, leg.end, load, options, scale, guess)
        leg.leg.sweeps += step.sweeps
        if is_carried_by_round_off(self.system, step.end.u, step.force_scale):
            raise Stalled("the sweeps moved the body off; only round-off balances the loads")
        return step

    def _nearest(
        self, leg: LegInSteps, load: Array, exact: ContactState, step: Step, allowed: float
    ) -> Step | None:
        """Return the step that ends nearest to the exact path, None where the error is too large.

        Where sweeps from the start of the step have not ended there, those from its end may.
        """
        length = self.continuation.size(exact.u - leg.end.u)

        def error(step: Step) -> float:
            distance = self.continuation.distance(step.end, exact)
            return distance / (length + STEP_ON_LIMIT * step.force_scale / STEP_ERROR)

        if error(step) <= SMALL_STEP_ERROR:
            return step
        with suppress(NotConverged):
            step = min(step, self._solve(leg, load, exact), key=error)
        return step if error(step) <= allowed else None
