"""Legs in equal load steps, each by the Gauss-Seidel method (section 2.1 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.errors import NoEquilibrium, NotConverged
from receding_fenicsx.interface.contact import Array, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.gauss_seidel import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.limits import furthest


@dataclass(frozen=True)
class GaussSeidelPath:
    """Follows legs in equal load steps.

    Attributes:
        system: the condensed body, ``kind = "frictional"``.
        options: tolerances and accelerations.
        steps: load steps a leg.
    """

    system: ContactSystem
    options: GaussSeidelOptions
    steps: int

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
            NoEquilibrium: they did because no contact forces balance the loads.
        """
        return self._steps(start, ends, force_scale, samples, self.steps)

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg in one step; slip is counted from ``start``."""
        return self._steps(start, ends, force_scale, 1, 1)

    def _steps(
        self,
        start: ContactState,
        ends: tuple[Array, Array],
        force_scale: float,
        samples: int,
        steps: int,
    ) -> Leg:
        system = self.system
        leg = Leg(end=start, dissipation=np.zeros(system.n), force_scale=force_scale)
        kept = {round((j + 1) * steps / samples) for j in range(samples)}
        load = ends[0]
        for k in range(1, steps + 1):
            s = k / steps
            next_load = ends[1] if k == steps else (1.0 - s) * ends[0] + s * ends[1]
            try:
                step = solve_step(system, leg.end, next_load, self.options, leg.force_scale)
            except NotConverged as error:
                limit = furthest(system, *ends)
                if limit is None or limit.s > s:
                    raise
                raise NoEquilibrium(limit.text) from error
            leg.work += float(0.5 * (load + next_load) @ system.r_star @ (step.end.u - leg.end.u))
            leg.events += [
                (s, int(i), int(leg.end.state[i]), int(step.end.state[i]))
                for i in np.flatnonzero(leg.end.state != step.end.state)
            ]
            leg.dissipation = leg.dissipation + step.dissipation
            leg.residual = max(leg.residual, step.residual)
            leg.sweeps += step.sweeps
            leg.force_scale = step.force_scale
            if k in kept:
                leg.samples.append((s, step.end))
            leg.end, load = step.end, next_load
        return leg
