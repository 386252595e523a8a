"""Legs in equal load steps, each by the Gauss-Seidel method (section 2.1 of the paper).

No step may pass over a jump. Each accepted step either is a straight quasi-static path or ends near
the end of the exact path through it (:mod:`receding_fenicsx.interface.load_steps.steps`);
one that does neither is divided. Where its sweeps cycle or creep, the exact path through it is
taken; where they run out, that is an error. Where the exact path through a step ends, it is
followed to that place, and a vanishing step from there decides: if the displacements change by a
finite amount, the body jumps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.jumps import add_jump, check_jumps, find_jump
from receding_fenicsx.interface.exact.legs import LegProblem, unchanged
from receding_fenicsx.interface.exact.rest import carries_nothing, zero_crossing
from receding_fenicsx.interface.exact.segments import tied
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.law import BACKWARD, FORWARD, STICK
from receding_fenicsx.interface.load_steps.steps import StepTrials, seen_changes
from receding_fenicsx.interface.residual import relative_residual
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import JUMP_STEP


class GaussSeidelPath:
    """Follows legs in equal load steps."""

    def __init__(
        self,
        system: ContactSystem,
        options: GaussSeidelOptions,
        steps: int,
        on_jump: str = "stop",
    ) -> None:
        """Prepare for ``system`` in 2N form.

        Args:
            system: the condensed body, ``kind = "frictional"``.
            options: tolerances and accelerations.
            steps: load steps a leg.
            on_jump: "stop" where no quasi-static path continues, or pass the jump by one "static"
                problem.
        """
        self.system, self.options, self.steps, self.on_jump = system, options, steps, on_jump
        self._trials = StepTrials(system, options)

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg as :meth:`EventPath.trace_leg`, states stored at the ends of steps.

        Raises:
            NotConverged: a step's sweeps ran out.
            NoEquilibrium: no contact forces balance the loads.
            NoQuasiStaticContinuation: the path ends inside a step.
        """
        resting = start
        if carries_nothing(start, force_scale) and not np.any(ends[0]):
            resting = at_rest(self.system, start, ends[1])
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
        patient = replace(self.options, stalled_sweeps=self.options.max_sweeps)
        leg = solve_step(self.system, start, ends[1], patient, force_scale)
        leg.events = Changes.between(1.0, start.state, leg.end.state)
        leg.stops, leg.samples = [(1.0, leg.end.u)], [(1.0, leg.end)]
        return leg

    def _check_equilibrium(self, ends: tuple[Array, Array], s: float) -> None:
        """Raise NoEquilibrium where equilibrium ends before s."""
        limit = self._trials.exact.limit(*ends)
        if limit is not None and s > limit.s:
            raise NoEquilibrium(limit.text)

    def advance(self, problem: LegProblem, leg: Leg, s: float, s_end: float) -> Leg:
        """Advance by one load step from s to ``s_end``, in parts where it may contain a jump.

        ``leg`` is what has been followed so far of ``problem``; return what has been then.
        """
        self._check_equilibrium(problem.ends, s_end)
        targets, part, system = [s_end], 0.0, self.system
        for _ in range(300):
            found, reached = self._trials.attempt(problem, leg, s, targets[-1])
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
                jump = find_jump(self._trials.exact.segments, before, load, load)
                add_jump(leg, (s, reached), jump)
                slip, scale = (jump.end.u - before.u)[: system.n], leg.force_scale
                residual = relative_residual(system, jump.end, slip, system.local_stiffness, scale)
                leg.residual = max(leg.residual, residual)
            else:
                seen = seen_changes(found, before, reached, [s])
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
        raise SolveError(
            f"the load step before {system.load_text(problem.load(s_end))} was taken in "
            "300 parts without finding whether the contact jumps in it; use method events"
        )

    def _ties(self, leg: Leg, before: ContactState, s: float) -> list[Changes]:
        """Return nodes on limits at a step's end; stuck ones as near to theirs as new slip."""
        segments, n, end = self._trials.exact.segments, self.system.n, leg.end
        found = list[Changes]()
        if s < 1.0:  # the next leg begins with those at the end of this one
            on = segments.values(end)[n:] <= segments.limit[n:] * leg.force_scale
            found.append(tied(segments, np.array([s]), end.state[None], on[None]))
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
        walk, error, at_rest = self._trials.follow(problem, s_end)
        if error is not None:
            return None
        found = walk.finish(at_rest)
        at_start = leg.events.select(leg.events.s == 0.0)
        return replace(
            found,
            events=Changes.joined(
                at_start, seen_changes(found, problem.start, s_end, list(places))
            ),
            stops=[*found.stops, (s_end, found.end.u)],
            residual=max(leg.residual, found.residual),
            sweeps=leg.sweeps,
        )
