"""Search for a quasi-static path through a load step; without one the body jumps.

A finite step solves eqs. (4) to (12) at its end only. Where the path has ended on the way the
answer is another equilibrium, at a finite distance however small the step. Two checks:

* **Straight path.** If u, r and the loads change in proportion over the step and satisfy the
  contact law throughout, they are a quasi-static path themselves. The law is linear in each set of
  states, so that both ends decide: a node that is open at the end has had no reaction at the start,
  a node that slips has been at its friction limit. Every step without change of state passes, at
  hardly any cost.
* **Exact path.** Otherwise the path is followed through the step from event to event. Where it ends
  no rates satisfy the contact law. Where it goes on it must lead to the end of the step, but for a
  part of its length: the error of a step in time falls with its length, a jump does not.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NotConverged, SolveError
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.rest import is_at_rest, is_closed, stops_short
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, Stalled, solve_step
from receding_fenicsx.interface.law import SLIP_SIGN, State
from receding_fenicsx.interface.residual import is_carried_by_round_off, largest_force
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import REMAINING_LOAD, STEP_ON_LIMIT

if TYPE_CHECKING:
    from receding_fenicsx.interface.exact.walk import Walk

SMALLEST_PART = 1e-9
"""Part of the leg that is not divided further: what changes there by a finite amount jumps."""

STEP_ERROR = 0.5
"""Distance between the ends of a load step and of the exact path, over the length of the latter, up
to which it is the error of a step in time."""

NEAR = 0.02
"""The same distance up to which a step needs no better initial guess."""


class Trial(NamedTuple):
    """Result of a trial of one part of a load step."""

    # a step or a piece of the exact path that is accepted; the error at which the path ends; None
    # where the part has to be divided
    found: Leg | SolveError | None
    s: float  # place up to which ``found`` leads, or up to which to try next


class StepTrials:
    """Tries parts of load steps by Gauss-Seidel, and compares them with the exact path.

    Attributes:
        exact: follows the exact path through the parts.
    """

    def __init__(self, system: ContactSystem, options: GaussSeidelOptions) -> None:
        """Prepare for ``system`` in 2N form."""
        self.system, self.options, self.exact = system, options, EventPath(system)
        self._stiffness = np.concatenate(system.local_stiffness)

    def attempt(self, problem: LegProblem, leg: Leg, s: float, s_to: float) -> Trial:
        """Try the part of a load step from the state reached at s to ``s_to``.

        1. Solve the step by sweeps; accept it where the straight path to its end keeps the law.
        2. Otherwise follow the exact path. Where it leads through the part to a complete unloading,
           take it. Else accept a step that ends near it; without one take the exact path itself
           (sweeps stalled, or the part is the smallest) or halve the part.
        3. Where the exact path ends inside, take it up to there, and then try the smallest part:
           the path continues where the change of displacement is not finite.
        """
        step, part = None, (problem.load(s), problem.load(s_to))
        with suppress(Stalled):  # the exact path takes over
            step = self._solve(leg, part)
        scale = leg.force_scale if step is None else step.force_scale
        if step is not None and self.is_straight(leg.end, step.end, scale):
            return Trial(step, s_to)
        start = replace(problem, start=leg.end, force_scale=scale, s_start=s)
        walk, error, at_rest = self.follow(start, s_to)
        is_smallest = s_to - s <= 1.5 * SMALLEST_PART
        if error is None:
            if at_rest:
                with suppress(SolveError):
                    return Trial(walk.finish(at_rest), s_to)
            # where nothing presses a free body sweeps may leave it anywhere off its plane
            allowed = NEAR if at_rest else STEP_ERROR
            near = step and self._nearest(leg, part, walk.here(), step, allowed)
            if near is None and (is_smallest or step is None):
                return Trial(walk.finish(at_rest), s_to)
            return Trial(near, s_to if near else 0.5 * (s + s_to))
        unloaded, segments = s == 0.0 and not np.any(part[0]), self.exact.segments
        if unloaded and is_at_rest(self.system, part[0]) and is_closed(segments, leg.end, scale):
            # from rest all grows in proportion to the load: one static problem
            with suppress(SolveError):
                return Trial(self.exact.static_leg(leg.end, part, scale), s_to)
        if step is not None and unloaded and isinstance(error, NoEquilibrium):
            # a free body that touches nowhere yet falls on the plane
            return Trial(step, s_to)
        if is_smallest:
            if step is None:
                with suppress(NotConverged):
                    step = self._solve(leg, part, patient=True)
            if step is not None:
                change = self.size(step.end.u - leg.end.u) / step.force_scale
                # finite is a change, as a force over the largest nodal force, of more than
                return Trial(step if change <= 1e-5 else error, s_to)
            return Trial(error, s_to)
        if walk.s - s > SMALLEST_PART:
            with suppress(SolveError):
                return Trial(walk.stop_here(), walk.s)
        return Trial(None, s + SMALLEST_PART)

    def follow(self, problem: LegProblem, s_end: float) -> tuple[Walk, SolveError | None, bool]:
        """Follow the exact path through a part of a leg.

        Returns:
            The walk at the place where the path ends or the part does, why the path ends, and
            whether the part ends at complete unloading, just beyond the walk.
        """
        scale = problem.force_scale
        for load in problem.ends:
            scale = largest_force(self.system, load, problem.start.r, scale)
        walk = self.exact.walk(replace(problem, force_scale=scale))
        short = stops_short(self.exact.segments, problem.load(s_end))
        try:
            walk.run(max(s_end - REMAINING_LOAD, problem.s_start) if short else s_end)
        except SolveError as error:
            return walk, error, short
        return walk, None, short

    def size(self, change: Array) -> float:
        """Return the size of a change of displacement (2N,), as a nodal force."""
        return float(np.abs(self._stiffness * change).max(initial=0.0))

    def is_straight(self, start: ContactState, end: ContactState, force_scale: float) -> bool:
        """Return whether the straight path from start to end keeps the contact law throughout."""
        n, system, none = self.system.n, self.system, STEP_ON_LIMIT * force_scale
        frictional, normal = self.exact.segments.frictional, ~system.held[n:]
        open_ = end.state == State.SEPARATION
        contact, rubs = normal & ~open_, frictional & ~open_
        if np.any(np.abs(start.P[normal & open_]) > none):
            return False
        if np.any(np.abs(start.Q[frictional & open_]) > none):
            return False
        if np.any((self._stiffness[n:] * (system.g0 + start.w))[contact] > none):
            return False
        sign, coefficient = SLIP_SIGN[end.state], system.friction.at_slip(end.state)
        slip = self._stiffness[:n] * (end.v - start.v)
        off_limit = np.where(sign == 0.0, np.abs(slip), np.abs(start.Q + coefficient * start.P))
        return bool(np.all(off_limit[rubs] <= none) and np.all((sign * slip)[rubs] >= -none))

    def _solve(
        self,
        leg: Leg,
        part: tuple[Array, Array],
        guess: ContactState | None = None,
        patient: bool = False,
    ) -> Leg:
        """Solve a part by sweeps, which may creep to the largest number of them if ``patient``."""
        scale, options = leg.force_scale, self.options
        if patient:
            options = replace(options, stalled_sweeps=options.max_sweeps)
        step = solve_step(self.system, leg.end, part[1], options, scale, guess)
        mean = 0.5 * (part[0] + part[1])
        step.work = float(mean @ self.system.r_star @ (step.end.u - leg.end.u))
        leg.sweeps += step.sweeps
        if is_carried_by_round_off(self.system, step.end.u, step.force_scale):
            raise Stalled("the sweeps moved the body off; only round-off balances the loads")
        return step

    def _nearest(
        self,
        leg: Leg,
        part: tuple[Array, Array],
        exact: ContactState,
        step: Leg,
        allowed: float,
    ) -> Leg | None:
        """Return the step that ends nearest to the exact path, None if the error is too large."""
        length = self.size(exact.u - leg.end.u)
        # how far a body drifts along the motions that its states leave free is not determined
        free = self.exact.segments.free_motions(exact.state)

        def error(step: Leg) -> float:
            change = step.end.u - exact.u
            distance = self.size(change - free @ (free.T @ change))
            return distance / (length + STEP_ON_LIMIT * step.force_scale / STEP_ERROR)

        if error(step) > NEAR:
            # sweeps from a better initial guess may end nearer
            with suppress(NotConverged):
                step = min(step, self._solve(leg, part, exact), key=error)
        return step if error(step) <= allowed else None


def seen_changes(found: Leg, start: ContactState, s: float, stops: list[float]) -> Changes:
    """Return the changes of state of a step, at its end, or of the exact path, at their places.

    Args:
        found: step or exact path from ``start`` to ``s``.
        start: state at its start.
        s: its end.
        stops: places of its start or of stored states; a change there is moved just beyond.
    """
    state, at = start.state.copy(), found.events.s
    passed = replace(found.events, s=np.where(np.isin(at, stops), np.nextafter(at, 1.0), at))
    state[found.events.node] = found.events.new  # of several changes of a node the last
    return Changes.joined(passed, Changes.between(s, state, found.end.state))
