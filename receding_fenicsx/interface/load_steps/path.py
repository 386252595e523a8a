"""Legs in equal load steps, each by the Gauss-Seidel method (section 2.1 of the paper).

No step may pass over a jump. Each accepted step either is a straight quasi-static path or ends near
the end of the exact path through it (:mod:`receding_fenicsx.interface.load_steps.continuation`);
one that does neither is divided. Where its sweeps cycle or creep, the exact path through it is
taken; where they run out, that is an error. Where the exact path through a step ends, it is
followed to that place, and a vanishing step from there decides: if the displacements change by a
finite amount, the body jumps.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from receding_fenicsx.errors import (
    NoEquilibrium,
    NoQuasiStaticContinuation,
    NotConverged,
    SolveError,
)
from receding_fenicsx.interface.equilibrium import Limit, furthest
from receding_fenicsx.interface.exact.path import APEX, JUMP_STEP, JUMPS, changes
from receding_fenicsx.interface.exact.rolling import at_rest
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.exact.walk import UNLOADED
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    Stalled,
    Step,
    solve_step,
)
from receding_fenicsx.interface.load_steps.continuation import ON_LIMIT, Continuation
from receding_fenicsx.interface.residual import local_stiffness, relative_residual
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem, Leg

VANISHING = 1e-9
"""Part of the leg that is not divided further: what changes there by a finite amount jumps."""

FINITE = 1e-5
"""Change of displacement, as a force over the largest nodal force, above which it is finite."""

APART = 0.5
"""Distance between the ends of a load step and of the exact way, over the length of the latter, up
to which it is the error of a step in time."""

DOUBT = 0.02
"""The same distance up to which no sweeps from a better guess are tried."""

PARTS = 300
"""Parts in which one load step is tried at most."""


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
            on_jump: "stop" where no quasi-static path leads on, or step over by one "static"
                problem.
        """
        self.system, self.options, self.steps, self.on_jump = system, options, steps, on_jump
        self.continuation = Continuation(system)
        self.limits: dict[tuple[bytes, bytes], Limit | None] = {}

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg; events are the changes of state seen at the ends of the steps.

        Args:
            start: state at the leg's start.
            ends: (n_loads,) load factors at its start and at its end.
            force_scale: largest nodal force of the history so far.
            samples: number of states to keep, at the ends of steps, the last one at s = 1.

        Returns:
            The traced leg.

        Raises:
            NotConverged: a step's sweeps ran out.
            NoEquilibrium: no contact forces balance the loads.
            NoQuasiStaticContinuation: the path ends inside a step.
        """
        laid = start
        unloaded = np.abs(start.r).max(initial=0.0) <= UNLOADED * force_scale
        if unloaded and not np.any(ends[0]):
            laid = at_rest(self.system, start, ends[1])
        leg = Leg(end=laid, dissipation=np.zeros(self.system.n), force_scale=force_scale)
        leg.events = changes(0.0, start.state, laid.state)
        kept = {round((j + 1) * self.steps / samples) for j in range(samples)}
        crossing = _unloaded(ends)
        s = 0.0
        for k in range(1, self.steps + 1):
            if crossing is not None and s < crossing < k / self.steps:
                # complete unloading undoes all slip: a step across it would count it as kept
                self._advance(leg, laid, ends, s, crossing)
                s = crossing
            self._advance(leg, laid, ends, s, k / self.steps)
            s = k / self.steps
            if k in kept:
                leg.samples.append((s, leg.end))
        return leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg in one step; slip is counted from ``start``."""
        leg = Leg(end=start, dissipation=np.zeros(self.system.n), force_scale=force_scale)
        self._equilibrium(ends, 1.0)
        patient = replace(self.options, stalled_sweeps=self.options.max_sweeps)
        step = solve_step(self.system, start, ends[1], patient, force_scale)
        leg.sweeps += step.sweeps
        self._take(leg, ends, (0.0, 1.0), step)
        leg.samples = [(1.0, leg.end)]
        return leg

    def _equilibrium(self, ends: tuple[Array, Array], s: float) -> Limit | None:
        """Return where equilibrium ends on a leg; raise where that is before ``s``."""
        key = ends[0].tobytes(), ends[1].tobytes()
        if key not in self.limits:
            self.limits[key] = furthest(self.system, *ends)
        limit = self.limits[key]
        if limit is not None and s > limit.s:
            raise NoEquilibrium(limit.text)
        return limit

    def _advance(
        self,
        leg: Leg,
        origin: ContactState,
        ends: tuple[Array, Array],
        s_start: float,
        s_end: float,
    ) -> None:
        """Advance by one step of a leg from ``origin``, in parts where a jump may lie in it."""
        limit = self._equilibrium(ends, s_end)
        s, targets = s_start, [s_end]
        for _ in range(PARTS):
            part = s, targets[-1]
            found, place = self._part(leg, ends, part, limit)
            if found is None:
                targets.append(place)
                continue
            if isinstance(found, SolveError):
                if self._lead_on(leg, origin, ends, s_end, limit):
                    return
                place = min(s + JUMP_STEP, s_end)
                self._jump(leg, ends, (s, place), found)
            else:
                self._take(leg, ends, (s, place), found)
            s, targets = place, [target for target in targets if target > place]
            if not targets:
                return
        raise SolveError(
            f"the load step before load factors {_load(ends, s_end).tolist()} was taken in {PARTS} "
            "parts without finding whether the contact jumps in it; use method events"
        )

    def _lead_on(
        self,
        leg: Leg,
        origin: ContactState,
        ends: tuple[Array, Array],
        s_end: float,
        limit: Limit | None,
    ) -> bool:
        """Take the exact way from the leg's start where that goes on; return whether it does.

        Then it is the error of the steps in time that has led to a jump, near complete unloading
        for one, where small forces decide.
        """
        if leg.jumps:
            return False
        kept = [s for s, _ in leg.samples]
        way = self.continuation.follow(origin, ends, (0.0, s_end), leg.force_scale, limit, kept)
        if way.error is not None:
            return False
        found = way.finish()
        leg.samples = found.samples
        laid = [event for event in leg.events if event[0] == 0.0]
        leg.events = laid + _seen(found, origin, s_end, kept)
        leg.dissipation, leg.work, leg.end = found.dissipation, found.work, found.end
        leg.residual = max(leg.residual, found.residual)
        return True

    def _solve(self, leg: Leg, load: Array, guess: ContactState | None = None) -> Step:
        step = solve_step(self.system, leg.end, load, self.options, leg.force_scale, guess)
        leg.sweeps += step.sweeps
        return step

    def _part(
        self,
        leg: Leg,
        ends: tuple[Array, Array],
        part: tuple[float, float],
        limit: Limit | None,
    ) -> tuple[Step | Leg | SolveError | None, float]:
        """Try a part of a load step.

        Returns:
            What follows a quasi-static path, and up to which place: a step, or the exact way to a
            jump and where the sweeps of no step lead to its end. The error that says why no path
            leads on from the start of the part. Or None, and the place up to which to try instead.
        """
        start, (s, s_to), load = leg.end, part, _load(ends, part[1])
        step = None
        with suppress(Stalled):  # the exact way takes over
            step = self._solve(leg, load)
        scale = leg.force_scale if step is None else step.force_scale
        if step is not None and self.continuation.is_straight(start, step.end, scale):
            return step, s_to
        way = self.continuation.follow(start, ends, part, scale, limit)
        is_tiny = s_to - s <= 1.5 * VANISHING
        if way.error is None:
            near = None if step is None else self._nearest(leg, load, way.end, step)
            if near is not None:
                return near, s_to
            if is_tiny or step is None:
                return way.finish(), s_to
            return None, 0.5 * (s + s_to)
        falls = isinstance(way.error, NoEquilibrium) and s == 0.0 and not np.any(ends[0])
        if step is not None and falls:  # a free body that touches nowhere yet falls on the plane
            return step, s_to
        if is_tiny:
            continues = step is not None and self._size(leg, step) <= FINITE
            return (step if continues else way.error), s_to
        if way.s - s > VANISHING:
            with suppress(SolveError):
                return way.walk.stop_here(), way.s
        return None, s + VANISHING

    def _size(self, leg: Leg, step: Step) -> float:
        """Return the change of displacement in a step, as a force over the force scale."""
        return self.continuation.size(step.end.u - leg.end.u) / step.force_scale

    def _nearest(self, leg: Leg, load: Array, exact: ContactState, step: Step) -> Step | None:
        """Return the step that ends nearest to the exact way, None where that is not near it.

        Where sweeps from the start of the step have not ended there, those from its end may.
        """
        length = self.continuation.size(exact.u - leg.end.u)

        def apart(step: Step) -> float:
            distance = self.continuation.size(step.end.u - exact.u)
            return distance / (length + ON_LIMIT * step.force_scale / APART)

        if apart(step) <= DOUBT:
            return step
        with suppress(NotConverged):
            step = min(step, self._solve(leg, load, exact), key=apart)
        return step if apart(step) <= APART else None

    def _take(
        self, leg: Leg, ends: tuple[Array, Array], part: tuple[float, float], found: Step | Leg
    ) -> None:
        """Add an accepted step, or an exact way, to the leg."""
        if isinstance(found, Leg):
            leg.work += found.work
        else:
            mean = 0.5 * (_load(ends, part[0]) + _load(ends, part[1]))
            leg.work += float(mean @ self.system.r_star @ (found.end.u - leg.end.u))
        leg.events += _seen(found, leg.end, part[1], [part[0]])
        leg.dissipation = leg.dissipation + found.dissipation
        leg.residual = max(leg.residual, found.residual)
        leg.force_scale = max(leg.force_scale, found.force_scale)
        leg.end = found.end

    def _jump(
        self, leg: Leg, ends: tuple[Array, Array], part: tuple[float, float], error: SolveError
    ) -> None:
        """Step over a place where no quasi-static path leads on, as the exact path does.

        What the jump releases, -(change of 1/2 u K u + sum lambda r* . change of u), is friction
        and motion together and is kept apart from the dissipation.
        """
        if self.on_jump != "static" or not isinstance(error, NoQuasiStaticContinuation):
            raise error
        load, system, start = _load(ends, part[1]), self.system, leg.end
        factors = ", ".join(f"{value:.9g}" for value in load)
        if len(leg.jumps) >= JUMPS:
            raise NoQuasiStaticContinuation(
                f"the contact has jumped {JUMPS} times on one leg and jumps again at load factors "
                f"[{factors}]; reduce the friction or the load range"
            )
        end = solve_static(self.continuation.segments, start, load)
        if end is None:
            raise NoQuasiStaticContinuation(
                f"no quasi-static continuation at load factors [{factors}], and no state was found "
                "to jump to; reduce the friction or the load range"
            )
        change = end.u - start.u
        stored = 0.5 * float(change @ system.K @ (end.u + start.u))
        work = float(load @ system.r_star @ change)
        leg.jumps.append((part[0], -stored - work))
        leg.work += work
        leg.events += changes(part[1], start.state, end.state)
        residual = relative_residual(
            system, end, change[: system.n], local_stiffness(system), leg.force_scale
        )
        leg.residual = max(leg.residual, residual)
        leg.end = end


def _load(ends: tuple[Array, Array], s: float) -> Array:
    """Return the load factors at a place of a leg."""
    return ends[1] if s == 1.0 else (1.0 - s) * ends[0] + s * ends[1]


def _seen(
    found: Step | Leg, start: ContactState, s: float, stops: list[float]
) -> list[tuple[float, int, int, int]]:
    """Return the changes of state of a step, of an exact way where they are.

    Args:
        found: what leads on from ``start`` to ``s``.
        start: state at its start.
        s: its end.
        stops: its start or the samples inside; what changes right there follows upon them.
    """
    passed = []
    if isinstance(found, Leg):
        passed = [
            (np.nextafter(e[0], 1.0) if e[0] in stops else e[0], *e[1:]) for e in found.events
        ]
    state = start.state.copy()
    for _, node, _, new in passed:
        state[node] = new
    return [*passed, *changes(s, state, found.end.state)]


def _unloaded(ends: tuple[Array, Array]) -> float | None:
    """Return the place inside a leg at which all loads vanish, None where there is none."""
    start, way = ends[0], ends[1] - ends[0]
    if not np.any(way):
        return None
    s = -float(start @ way) / float(way @ way)
    inside = 0.0 < s < 1.0 and np.abs(start + s * way).max() <= APEX * np.abs(start).max()
    return s if inside else None
