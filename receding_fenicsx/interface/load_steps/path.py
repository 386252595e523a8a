"""Legs in equal load steps, each by the Gauss-Seidel method and compared with the exact path."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import (
    NoEquilibrium,
    NoQuasiStaticContinuation,
    NotConverged,
    SolveError,
)
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.jumps import add_jump, check_jumps, find_jump
from receding_fenicsx.interface.exact.legs import LegProblem, unchanged
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.rest import (
    is_at_rest,
    is_closed,
    stops_short,
    zero_crossing,
)
from receding_fenicsx.interface.exact.segments import tied
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, Stalled, solve_step
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.residual import (
    is_carried_by_round_off,
    largest_force,
    relative_residual,
)
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import JUMP_STEP, REMAINING_LOAD, STEP_ON_LIMIT

if TYPE_CHECKING:
    from receding_fenicsx.interface.exact.walk import Walk

SMALLEST_PART = 1e-9
"""Part of the leg that is not divided further: what changes there by a finite amount jumps."""

STEP_ERROR = 0.5
"""Distance between the ends of a load step and of the exact path, over the length of the latter, up
to which it is the error of a step in time."""

NEAR = 0.02
"""The same distance up to which a step needs no better initial guess."""


class GaussSeidelPath:
    """Follows legs in equal load steps.

    Attributes:
        exact: follows the exact path through parts of steps.
    """

    def __init__(
        self,
        system: ContactSystem,
        options: GaussSeidelOptions,
        steps: int,
        on_jump: str = "stop",
    ) -> None:
        """Prepare for ``system`` of ``kind = "frictional"``.

        ``steps`` are load steps a leg. Where no quasi-static path continues, ``on_jump`` says
        whether to "stop" or to pass the jump by one "static" problem.
        """
        self.system, self.options, self.steps, self.on_jump = system, options, steps, on_jump
        self.exact = EventPath(system)
        self._stiffness = np.concatenate(system.local_stiffness)

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg as :meth:`EventPath.trace_leg`, states stored at the ends of steps.

        NotConverged: a step's sweeps ran out.
        """
        resting = at_rest(self.system, start, ends, force_scale)
        problem = LegProblem(resting, ends, force_scale)
        leg = unchanged(problem)
        leg.events = Changes.between(0.0, start.state, resting.state)
        leg.stops = [(0.0, resting.u)]
        stored = {round((j + 1) * self.steps / samples) / self.steps for j in range(samples)}
        targets = {k / self.steps for k in range(1, self.steps + 1)}
        s = 0.0
        # complete unloading undoes all slip: a step across it would keep that
        for s_end in sorted(targets | {zero_crossing(self.system, ends) or 1.0}):
            leg = self.advance(problem, leg, s, s_end)
            s = s_end
            if s in stored:
                leg.samples.append((s, leg.end))
        return leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg in one step; slip is counted from ``start``."""
        self._check_equilibrium(ends, 1.0)
        leg = solve_step(self.system, start, ends[1], self.options, force_scale, patient=True)
        leg.events = Changes.between(1.0, start.state, leg.end.state)
        leg.stops, leg.samples = [(1.0, leg.end.u)], [(1.0, leg.end)]
        return leg

    def _check_equilibrium(self, ends: tuple[Array, Array], s: float) -> None:
        """Raise NoEquilibrium where equilibrium ends before s."""
        limit = self.exact.limit(*ends)
        if limit is not None and s > limit.s:
            raise NoEquilibrium(limit.text)

    def advance(self, problem: LegProblem, leg: Leg, s: float, s_end: float) -> Leg:
        """Advance by one load step from s to ``s_end``, in parts where it may contain a jump.

        ``leg`` is what has been followed so far of ``problem``; return what has been then.
        """
        self._check_equilibrium(problem.ends, s_end)
        targets, part, system = [s_end], 0.0, self.system
        for _ in range(300):
            found, reached = self.attempt(problem, leg, s, targets[-1])
            if found is None:
                last = s + part  # as long a part as the one before
                targets.append(max(reached, last) if last < targets[-1] else reached)
                part = 0.0
                continue
            before = leg.end
            if isinstance(found, SolveError):
                exact = self._exact_path(problem, leg, s_end)
                if exact is not None:
                    return exact
                if self.on_jump != "static" or not isinstance(found, NoQuasiStaticContinuation):
                    raise found
                reached = min(s + JUMP_STEP, s_end)
                load = problem.load(reached)
                check_jumps(system, len(leg.jumps), load)
                jump = find_jump(self.exact.segments, before, load, load)
                add_jump(leg, (s, reached), jump)
                slip, scale = (jump.end.u - before.u)[: system.n], leg.force_scale
                residual = relative_residual(system, jump.end, slip, system.local_stiffness, scale)
                leg.residual = max(leg.residual, residual)
            else:
                seen = _seen_changes(found, before, reached, [s])
                stops = [(reached, found.end.u)]
                # sweeps are counted where they are spent, also those of steps not accepted
                leg.add(replace(found, events=seen, stops=stops, samples=[], sweeps=0))
                leg.ties = Changes.joined(leg.ties, *self._ties(leg, before, reached))
            part = reached - s
            s, targets = reached, [target for target in targets if target > reached]
            if not targets:
                return leg
            if targets[-1] - s > 10.0 * part:
                targets.append(s + 10.0 * part)  # grow gradually
        # sweeps may keep to another one of several continuations
        exact = self._exact_path(problem, leg, s_end)
        if exact is not None:
            return exact
        raise SolveError(
            f"the load step before {system.load_text(problem.load(s_end))} was taken in "
            "300 parts without finding whether the contact jumps in it; use method events"
        )

    def attempt(
        self, problem: LegProblem, leg: Leg, s: float, s_to: float
    ) -> tuple[Leg | SolveError | None, float]:
        """Try the part of a load step from the state reached at s to ``s_to``.

        Returned are what is accepted and the place up to which it leads, the error at which the
        path ends, or None and the place up to which to try next.
        """
        step, part = None, (problem.load(s), problem.load(s_to))
        with suppress(Stalled):  # the exact path takes over
            step = self._solve(leg, part)
        scale = leg.force_scale if step is None else step.force_scale
        if step is not None and self._is_straight(leg.end, step.end, scale):
            return step, s_to
        start = replace(problem, start=leg.end, force_scale=scale, s_start=s)
        walk, error, at_rest = self._walk(start, s_to)
        is_smallest = s_to - s <= 1.5 * SMALLEST_PART
        if error is None:
            if at_rest:
                with suppress(SolveError):
                    return walk.finish(at_rest), s_to
            # where nothing presses a free body sweeps may leave it anywhere off its plane
            allowed = NEAR if at_rest else STEP_ERROR
            near = step and self._nearest(leg, part, walk.here(), step, allowed)
            if near is None and (is_smallest or step is None):
                return walk.finish(at_rest), s_to
            return near, s_to if near else 0.5 * (s + s_to)
        segments = self.exact.segments
        if s == 0.0 and is_at_rest(self.system, part[0]) and is_closed(segments, leg.end, scale):
            # from rest all grows in proportion to the load: one static problem
            with suppress(SolveError):
                return self.exact.static_leg(leg.end, part, scale), s_to
        if is_smallest:
            if step is None:
                with suppress(NotConverged):
                    step = self._solve(leg, part, patient=True)
            if step is not None:
                change = self._size(step.end.u - leg.end.u) / step.force_scale
                # finite is a change, as a force over the largest nodal force, of more than
                return step if change <= 1e-5 else error, s_to
            return error, s_to
        if walk.s - s > SMALLEST_PART:
            with suppress(SolveError):
                return walk.stop_here(), walk.s
        return None, s + SMALLEST_PART

    def _walk(self, problem: LegProblem, s_end: float) -> tuple[Walk, SolveError | None, bool]:
        """Follow the exact path through a part of a leg.

        Returned are the walk at the place where the path ends or the part does, why the path ends,
        and whether the part ends at complete unloading, just beyond the walk.
        """
        ends, start = np.array(problem.ends), problem.start
        scale = largest_force(self.system, ends, start.r, problem.force_scale)
        walk = self.exact.walk(replace(problem, force_scale=scale))
        short = stops_short(self.exact.segments, problem.load(s_end))
        try:
            walk.run(max(s_end - REMAINING_LOAD, problem.s_start) if short else s_end)
        except SolveError as error:
            return walk, error, short
        return walk, None, short

    def _size(self, change: Array) -> float:
        """Return the size of a change of displacement (2N,), as a nodal force."""
        return float(np.abs(self._stiffness * change).max(initial=0.0))

    def _is_straight(self, start: ContactState, end: ContactState, force_scale: float) -> bool:
        """Return whether the straight path from start to end keeps the contact law throughout.

        The law is linear in each set of states, so that both ends decide: a node that is open at
        the end has had no reaction at the start, one that slips has been at its friction limit.
        """
        n, system, none = self.system.n, self.system, STEP_ON_LIMIT * force_scale
        frictional, normal = self.exact.segments.frictional, ~system.held[n:]
        open_ = end.state == SEPARATION
        rubs = frictional & ~open_
        sign, coefficient = SLIP_SIGN[end.state], system.friction.at_slip(end.state)
        slip = self._stiffness[:n] * (end.v - start.v)
        gap = self._stiffness[n:] * (system.g0 + start.w)
        off_limit = np.where(sign == 0.0, np.abs(slip), np.abs(start.Q + coefficient * start.P))
        passed = [
            np.abs(start.P[normal & open_]),
            np.abs(start.Q[frictional & open_]),
            gap[normal & ~open_],
            off_limit[rubs],
            -(sign * slip)[rubs],
        ]
        return bool(np.concatenate(passed).max(initial=0.0) <= none)

    def _solve(
        self,
        leg: Leg,
        part: tuple[Array, Array],
        guess: ContactState | None = None,
        patient: bool = False,
    ) -> Leg:
        """Solve a part by sweeps, which may creep to the largest number of them if ``patient``."""
        scale = leg.force_scale
        step = solve_step(self.system, leg.end, part[1], self.options, scale, guess, patient)
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
        length = self._size(exact.u - leg.end.u)
        # how far a body drifts along the motions that its states leave free is not determined
        free = self.exact.segments.free_motions(exact.state)

        def error(step: Leg) -> float:
            change = step.end.u - exact.u
            distance = self._size(change - free @ (free.T @ change))
            return distance / (length + STEP_ON_LIMIT * step.force_scale / STEP_ERROR)

        if error(step) > NEAR:
            # sweeps from a better initial guess may end nearer
            with suppress(NotConverged):
                step = min(step, self._solve(leg, part, exact), key=error)
        return step if error(step) <= allowed else None

    def _ties(self, leg: Leg, before: ContactState, s: float) -> list[Changes]:
        """Return nodes on limits at a step's end; stuck ones as near to theirs as new slip."""
        segments, n, end = self.exact.segments, self.system.n, leg.end
        found = list[Changes]()
        if s < 1.0:  # the next leg begins with those at the end of this one
            on = segments.values(end)[n:] <= segments.limit[n:] * leg.force_scale
            found.append(tied(segments, s, end.state, on))
        A, B = segments.values(before)[2 * n :].reshape(2, -1)
        stuck = segments.frictional & (before.state == STICK)
        begun = stuck & ((end.state == FORWARD) | (end.state == BACKWARD))
        reach = np.where(end.state == FORWARD, A, B)[begun].max(initial=0.0)
        # a step does not resolve smaller differences of distances
        stuck &= (end.state == STICK) & (np.minimum(A, B) <= reach * (1.0 + 1e-6))
        if begun.any():
            side = np.where(A < B, FORWARD, BACKWARD)
            other = np.where(stuck, side, before.state).astype(np.int8)
            found.append(Changes.between(s, before.state, other))
        return found

    def _exact_path(self, problem: LegProblem, leg: Leg, s_end: float) -> Leg | None:
        """Return the exact path from the leg's start to ``s_end``, None where it does not lead."""
        if leg.jumps:
            return None
        places = tuple(s for s, _ in leg.samples)
        problem = replace(problem, force_scale=leg.force_scale, samples=places)
        walk, error, at_rest = self._walk(problem, s_end)
        if error is not None:
            return None
        found = walk.finish(at_rest)
        at_start = leg.events.select(leg.events.s == 0.0)
        return replace(
            found,
            events=Changes.joined(
                at_start, _seen_changes(found, problem.start, s_end, list(places))
            ),
            stops=[*found.stops, (s_end, found.end.u)],
            residual=max(leg.residual, found.residual),
            sweeps=leg.sweeps,
        )


def _seen_changes(found: Leg, start: ContactState, s: float, stops: list[float]) -> Changes:
    """Return the changes of state of a step to s, at its end, or of the exact path, where they are.

    ``stops`` are the places of its start or of stored states; a change there is moved just beyond.
    """
    state, at = start.state.copy(), found.events.s
    passed = replace(found.events, s=np.where(np.isin(at, stops), np.nextafter(at, 1.0), at))
    state[found.events.node] = found.events.new  # of several changes of a node the last
    return Changes.joined(passed, Changes.between(s, state, found.end.state))
