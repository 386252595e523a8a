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
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.equilibrium import Limit, furthest
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.rest import carries_nothing, zero_crossing
from receding_fenicsx.interface.exact.segments import tied
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.law import BACKWARD, FORWARD, STICK
from receding_fenicsx.interface.load_steps.steps import LegInSteps, StepTrials
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
        self._limits: dict[tuple[bytes, bytes], Limit | None] = {}

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg; events are the changes of state seen at the ends of the steps.

        Args:
            start: state at the leg's start.
            ends: (n_loads,) load factors at its start and at its end.
            force_scale: largest nodal force of the history so far.
            samples: number of states to store, at the ends of steps, the last one at s = 1.

        Returns:
            The traced leg.

        Raises:
            NotConverged: a step's sweeps ran out.
            NoEquilibrium: no contact forces balance the loads.
            NoQuasiStaticContinuation: the path ends inside a step.
        """
        resting = start
        if carries_nothing(start, force_scale) and not np.any(ends[0]):
            resting = at_rest(self.system, start, ends[1])
        now = self.begin(LegProblem(resting, ends, force_scale))
        now.leg.events = Changes.between(0.0, start.state, resting.state)
        now.leg.stops = [(0.0, resting.u)]
        stored = {round((j + 1) * self.steps / samples) for j in range(samples)}
        crossing = zero_crossing(ends)
        s = 0.0
        for k in range(1, self.steps + 1):
            s_end = k / self.steps
            if crossing is not None and s < crossing < s_end:
                # complete unloading undoes all slip: a step across it would keep that
                self.advance(now, s, crossing)
                s = crossing
            self.advance(now, s, s_end)
            s = s_end
            if k in stored:
                now.leg.samples.append((s, now.end))
        return now.leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg in one step; slip is counted from ``start``."""
        now = self.begin(LegProblem(start, ends, force_scale))
        now.check_equilibrium(1.0)
        patient = replace(self.options, stalled_sweeps=self.options.max_sweeps)
        step = solve_step(self.system, start, ends[1], patient, force_scale)
        now.leg.sweeps += step.sweeps
        now.add(step, (0.0, 1.0))
        now.leg.samples = [(1.0, now.end)]
        return now.leg

    def begin(self, problem: LegProblem) -> LegInSteps:
        """Return a leg on which nothing has been followed yet."""
        a, b = problem.ends
        key = a.tobytes(), b.tobytes()
        if key not in self._limits:
            self._limits[key] = furthest(self.system, a, b)
        return LegInSteps(self.system, problem, self._limits[key])

    def advance(self, now: LegInSteps, s: float, s_end: float) -> None:
        """Advance by one load step from s to ``s_end``, in parts where it may contain a jump."""
        now.check_equilibrium(s_end)
        targets, part = [s_end], 0.0
        for _ in range(300):
            trial = self._trials.attempt(now, s, targets[-1])
            if trial.found is None:
                last = s + part  # as long a part as the one before
                targets.append(max(trial.s, last) if last < targets[-1] else trial.s)
                part = 0.0
                continue
            reached = trial.s
            if isinstance(trial.found, SolveError):
                if self._take_exact_path(now, s_end):
                    return
                reached = min(s + JUMP_STEP, s_end)
                segments = self._trials.continuation.segments
                now.add_jump(segments, (s, reached), self.on_jump, trial.found)
            else:
                before = now.end
                now.add(trial.found, (s, reached))
                ties = self._ties(now, before, reached)
                now.leg.ties = Changes.joined(now.leg.ties, *ties)
            part = reached - s
            s, targets = reached, [target for target in targets if target > reached]
            if not targets:
                return
            if targets[-1] - s > 10.0 * part:
                targets.append(s + 10.0 * part)  # grow gradually
        raise SolveError(
            f"the load step before {self.system.load_text(now.load(s_end))} was taken in "
            "300 parts without finding whether the contact jumps in it; use method events"
        )

    def _ties(self, now: LegInSteps, before: ContactState, s: float) -> list[Changes]:
        """Return nodes on limits at a step's end; stuck ones as near to theirs as new slip."""
        segments, n, end = self._trials.continuation.segments, self.system.n, now.end
        found = list[Changes]()
        if s < 1.0:  # the next leg begins with those at the end of this one
            on = segments.values(end)[n:] <= segments.limit[n:] * now.leg.force_scale
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

    def _take_exact_path(self, now: LegInSteps, s_end: float) -> bool:
        """Take the exact path from the leg's start where it continues; return whether it does."""
        if now.leg.jumps:
            return False
        problem = replace(
            now.problem,
            force_scale=now.leg.force_scale,
            samples=tuple(s for s, _ in now.leg.samples),
        )
        path = self._trials.continuation.follow(problem, s_end, now.limit)
        if path.error is not None:
            return False
        now.replace(path.walk.finish(path.at_rest), s_end)
        return True
