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

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.unloading import stops_short
from receding_fenicsx.interface.law import SLIP_SIGN, State
from receding_fenicsx.interface.residual import largest_force, local_stiffness
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import REMAINING_LOAD, STEP_ON_LIMIT

if TYPE_CHECKING:
    from receding_fenicsx.interface.exact.loop import Loop
    from receding_fenicsx.interface.exact.walk import Walk


@dataclass(frozen=True)
class ExactPath:
    """The exact path through a part of a leg.

    Attributes:
        walk: at the place where the path ends, or at the end of the part.
        error: why it ends, None at the end of the part.
        at_rest: the part ends at complete unloading, just beyond the walk.
    """

    walk: Walk
    error: SolveError | None
    at_rest: bool

    @property
    def s(self) -> float:
        """Place on the leg up to which it leads."""
        return self.walk.s

    @property
    def end(self) -> ContactState:
        """State there."""
        return self.walk.here()

    def finish(self) -> Leg:
        """Return the path to the end of the part; raise SolveError where its residual is large."""
        return self.walk.finish(self.at_rest)


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
        self._stiffness = np.concatenate(local_stiffness(system))

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
