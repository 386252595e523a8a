"""Leg that grows by accepted load steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.jumps import check_jumps, find_jump
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.gauss_seidel.sweeps import Step
from receding_fenicsx.interface.residual import local_stiffness, relative_residual
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg


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

    def add(self, found: Step | Leg, part: tuple[float, float]) -> None:
        """Add an accepted step, or a piece of the exact path, between two places."""
        leg = self.leg
        if isinstance(found, Leg):
            leg.work += found.work
            leg.ties = Changes.joined(leg.ties, found.ties)
        else:
            mean = 0.5 * (self.load(part[0]) + self.load(part[1]))
            leg.work += float(mean @ self.system.r_star @ (found.end.u - leg.end.u))
        seen = seen_changes(found, leg.end, part[1], [part[0]])
        leg.events = Changes.joined(leg.events, *seen)
        leg.dissipation = leg.dissipation + found.dissipation
        leg.residual = max(leg.residual, found.residual)
        leg.force_scale = max(leg.force_scale, found.force_scale)
        leg.end = found.end
        leg.stops.append((part[1], found.end.u))

    def replace(self, found: Leg, s: float) -> None:
        """Replace everything so far by the exact path from the start of the leg to s."""
        leg = self.leg
        leg.samples, leg.stops = found.samples, [*found.stops, (s, found.end.u)]
        at_start = leg.events.select(leg.events.s == 0.0)
        stops = [place for place, _ in found.samples]
        seen = seen_changes(found, self.problem.start, s, stops)
        leg.events = Changes.joined(at_start, *seen)
        leg.dissipation, leg.work, leg.end = found.dissipation, found.work, found.end
        leg.ties = found.ties
        leg.residual = max(leg.residual, found.residual)

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
        check_jumps(self.system, len(leg.jumps), load)
        jump = find_jump(segments, start, load, load)
        leg.jumps.append((part[0], jump.released))
        leg.work += jump.work
        jumped = Changes.between(part[1], start.state, jump.end.state)
        leg.events = Changes.joined(leg.events, jumped)
        slip = (jump.end.u - start.u)[: system.n]
        residual = relative_residual(
            system, jump.end, slip, local_stiffness(system), leg.force_scale
        )
        leg.residual = max(leg.residual, residual)
        leg.end = jump.end
        leg.stops.append((part[1], jump.end.u))


def seen_changes(
    found: Step | Leg, start: ContactState, s: float, stops: list[float]
) -> list[Changes]:
    """Return the changes of state of a step, at its end, or of the exact path, at their places.

    Args:
        found: step or exact path from ``start`` to ``s``.
        start: state at its start.
        s: its end.
        stops: places of its start or of stored states; a change there is moved just beyond.
    """
    state, passed = start.state.copy(), list[Changes]()
    if isinstance(found, Leg):
        at = found.events.s
        at = np.where(np.isin(at, stops), np.nextafter(at, 1.0), at)
        passed.append(replace(found.events, s=at))
        state[found.events.node] = found.events.new  # of several changes of a node the last
    return [*passed, Changes.between(s, state, found.end.state)]
