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
from receding_fenicsx.errors import (
    NoEquilibrium,
    NoQuasiStaticContinuation,
    NotConverged,
    SolveError,
)
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.jumps import add_jump, check_jumps, find_jump
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.rest import is_at_rest, is_closed, load_from_rest, stops_short
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    Stalled,
    solve_step,
)
from receding_fenicsx.interface.law import SLIP_SIGN, State
from receding_fenicsx.interface.residual import (
    is_carried_by_round_off,
    largest_force,
    relative_residual,
)
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import REMAINING_LOAD, STEP_ON_LIMIT

if TYPE_CHECKING:
    from receding_fenicsx.interface.exact.loop import Loop
    from receding_fenicsx.interface.exact.walk import Walk


class ExactPath(NamedTuple):
    """The exact path through a part of a leg."""

    walk: Walk  # at the place where the path ends, or at the end of the part
    error: SolveError | None  # why it ends, None at the end of the part
    at_rest: bool  # the part ends at complete unloading, just beyond the walk


class Continuation:
    """Looks for quasi-static paths through load steps; keeps the rates of known states.

    Attributes:
        system: the condensed body in 2N form.
        segments: rates in known sets of states.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Start with nothing remembered."""
        self.system, self.segments = system, Segments(system)
        self._loop: Loop | None = None
        self._stiffness = np.concatenate(system.local_stiffness)

    def size(self, change: Array) -> float:
        """Return the size of a change of displacement (2N,), as a nodal force."""
        return float(np.abs(self._stiffness * change).max(initial=0.0))

    def distance(self, end: ContactState, exact: ContactState) -> float:
        """Return the distance of two ends as a nodal force.

        How far a body drifts along the rigid motions that its states leave free is not determined.
        """
        change, free = end.u - exact.u, self.segments.free_motions(exact.state)
        return self.size(change - free @ (free.T @ change))

    def is_straight(self, start: ContactState, end: ContactState, force_scale: float) -> bool:
        """Return whether the straight path from start to end keeps the contact law throughout."""
        n, system, none = self.system.n, self.system, STEP_ON_LIMIT * force_scale
        frictional, normal = self.segments.frictional, ~system.held[n:]
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

    def follow(self, problem: LegProblem, s_end: float, limit: Limit | None) -> ExactPath:
        """Follow the exact path through a part of a leg.

        Args:
            problem: the leg, from the state at the start of the part.
            s_end: place on the leg where the part ends.
            limit: where equilibrium ends on the leg.
        """
        # loads Numba, which takes longer than all the rest
        from receding_fenicsx.interface.exact.compilation import loop_of
        from receding_fenicsx.interface.exact.walk import Walk

        self._loop = loop = self._loop or loop_of(self.segments)
        start, ends = problem.start, problem.ends
        scale = problem.force_scale
        scale = max(largest_force(self.system, load, start.r, scale) for load in ends)
        s_limit = np.inf if limit is None else limit.s
        problem = replace(problem, force_scale=scale)
        walk = Walk(loop, problem, lambda ends: s_limit)
        short = stops_short(self.segments, problem.load(s_end))
        try:
            walk.run(max(s_end - REMAINING_LOAD, problem.s_start) if short else s_end)
            return ExactPath(walk, None, short)
        except SolveError as error:
            return ExactPath(walk, error, short)


class LegInSteps:
    """Leg under way in load steps.

    Attributes:
        system: the condensed body in 2N form.
        problem: the leg, from the state at its start.
        limit: where equilibrium ends on the leg, None where it does not.
        leg: what has been followed so far.
    """

    def __init__(self, system: ContactSystem, problem: LegProblem, limit: Limit | None) -> None:
        """Start at the beginning of a leg."""
        self.system, self.problem, self.limit = system, problem, limit
        self.leg = Leg(
            end=problem.start,
            dissipation=np.zeros(system.n),
            force_scale=problem.force_scale,
        )

    @property
    def end(self) -> ContactState:
        """State reached so far."""
        return self.leg.end

    def load(self, s: float) -> Array:
        """Return the (n_loads,) load factors at s."""
        return self.problem.load(s)

    def rest(self, s: float, force_scale: float) -> LegProblem:
        """Return the exact path's problem from the state reached, at s."""
        return LegProblem(self.end, self.problem.ends, force_scale, s_start=s)

    def check_equilibrium(self, s: float) -> None:
        """Raise NoEquilibrium where equilibrium ends before s."""
        if self.limit is not None and s > self.limit.s:
            raise NoEquilibrium(self.limit.text)

    def add(self, found: Leg, part: tuple[float, float]) -> None:
        """Add an accepted step, or a piece of the exact path, between two places."""
        seen = Changes.joined(*seen_changes(found, self.leg.end, part[1], [part[0]]))
        stops = [(part[1], found.end.u)]
        # sweeps are counted where they are spent, also those of steps that are not accepted
        self.leg.add(replace(found, events=seen, stops=stops, samples=[], sweeps=0))

    def replace(self, found: Leg, s: float) -> None:
        """Replace everything so far by the exact path from the start of the leg to s."""
        leg = self.leg
        at_start = leg.events.select(leg.events.s == 0.0)
        seen = seen_changes(found, self.problem.start, s, [place for place, _ in found.samples])
        self.leg = replace(
            found,
            events=Changes.joined(at_start, *seen),
            stops=[*found.stops, (s, found.end.u)],
            residual=max(leg.residual, found.residual),
            sweeps=leg.sweeps,
        )

    def add_jump(
        self, segments: Segments, part: tuple[float, float], on_jump: str, error: SolveError
    ) -> None:
        """Pass a jump, as the exact path does.

        Args:
            segments: of the condensed body.
            part: places of the jump and of the state after it.
            on_jump: "stop" raises ``error``, "static" passes the jump.
            error: why the path ends.
        """
        if on_jump != "static" or not isinstance(error, NoQuasiStaticContinuation):
            raise error
        leg, system, load, start = self.leg, self.system, self.load(part[1]), self.end
        check_jumps(system, len(leg.jumps), load)
        add_jump(leg, part, find_jump(segments, start, load, load))
        slip = (leg.end.u - start.u)[: system.n]
        residual = relative_residual(system, leg.end, slip, system.local_stiffness, leg.force_scale)
        leg.residual = max(leg.residual, residual)


def seen_changes(found: Leg, start: ContactState, s: float, stops: list[float]) -> list[Changes]:
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
    return [passed, Changes.between(s, state, found.end.state)]


SMALLEST_PART = 1e-9
"""Part of the leg that is not divided further: what changes there by a finite amount jumps."""

STEP_ERROR = 0.5
"""Distance between the ends of a load step and of the exact path, over the length of the latter, up
to which it is the error of a step in time."""

SMALL_STEP_ERROR = 0.02
"""The same distance up to which sweeps from a better initial guess are not tried."""


class Trial(NamedTuple):
    """Result of a trial of one part of a load step."""

    # a step or a piece of the exact path that is accepted; the error at which the path ends; None
    # where the part has to be divided
    found: Leg | SolveError | None
    s: float  # place up to which ``found`` leads, or up to which to try next


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
            step = self._solve(leg, s, s_to)
        scale = leg.leg.force_scale if step is None else step.force_scale
        if step is not None and self.continuation.is_straight(leg.end, step.end, scale):
            return Trial(step, s_to)
        start = leg.rest(s, scale)
        path = self.continuation.follow(start, s_to, leg.limit)
        is_smallest = s_to - s <= 1.5 * SMALLEST_PART
        if path.error is None:
            # where nothing presses a free body sweeps may leave it anywhere off its plane
            allowed = SMALL_STEP_ERROR if path.at_rest else STEP_ERROR
            near = (
                None
                if step is None
                else self._nearest(leg, (s, s_to), path.walk.here(), step, allowed)
            )
            if near is not None:
                return Trial(near, s_to)
            if is_smallest or step is None:
                return Trial(path.walk.finish(path.at_rest), s_to)
            if path.at_rest:
                with suppress(SolveError):
                    return Trial(path.walk.finish(path.at_rest), s_to)
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
                    step = self._solve(leg, s, s_to, patient=True)
            if step is not None:
                change = self.continuation.size(step.end.u - leg.end.u) / step.force_scale
                # finite is a change, as a force over the largest nodal force, of more than
                return Trial(step if change <= 1e-5 else path.error, s_to)
            return Trial(path.error, s_to)
        if path.walk.s - s > SMALLEST_PART:
            with suppress(SolveError):
                return Trial(path.walk.stop_here(), path.walk.s)
        return Trial(None, s + SMALLEST_PART)

    def _solve(
        self,
        leg: LegInSteps,
        s: float,
        s_to: float,
        guess: ContactState | None = None,
        patient: bool = False,
    ) -> Leg:
        """Solve a part by sweeps, which may creep to the largest number of them if ``patient``."""
        scale, options = leg.leg.force_scale, self.options
        if patient:
            options = replace(options, stalled_sweeps=options.max_sweeps)
        step = solve_step(self.system, leg.end, leg.load(s_to), options, scale, guess)
        mean = 0.5 * (leg.load(s) + leg.load(s_to))
        step.work = float(mean @ self.system.r_star @ (step.end.u - leg.end.u))
        leg.leg.sweeps += step.sweeps
        if is_carried_by_round_off(self.system, step.end.u, step.force_scale):
            raise Stalled("the sweeps moved the body off; only round-off balances the loads")
        return step

    def _nearest(
        self,
        leg: LegInSteps,
        part: tuple[float, float],
        exact: ContactState,
        step: Leg,
        allowed: float,
    ) -> Leg | None:
        """Return the step that ends nearest to the exact path, None if the error is too large."""
        length = self.continuation.size(exact.u - leg.end.u)

        def error(step: Leg) -> float:
            distance = self.continuation.distance(step.end, exact)
            return distance / (length + STEP_ON_LIMIT * step.force_scale / STEP_ERROR)

        if error(step) <= SMALL_STEP_ERROR:
            return step
        with suppress(NotConverged):
            step = min(step, self._solve(leg, *part, exact), key=error)
        return step if error(step) <= allowed else None
