"""Quasi-static paths through a load step: where there is none the body jumps.

A finite step solves eqs. (4) to (12) at its end only. Where the path has ended on the way the
answer is another equilibrium, at a finite distance however small the step. Two checks:

* **Straight path.** If u, r and the loads change in proportion over the step and satisfy the
  contact law all along, they are a quasi-static path themselves. The law is linear in each set of
  states, so that both ends decide: a node that is open at the end has had no reaction at the start,
  a node that slips has been at its friction limit. Every step without change of state passes, at
  next to no cost.
* **Exact path.** Otherwise the path is followed through the step from event to event. Where it ends
  no rates satisfy the contact law. Where it goes on it must lead to the end of the step, but for a
  part of its length: the error of a step in time falls with its length, a jump does not.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.path import APEX
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import SLIP_SIGN, State
from receding_fenicsx.interface.residual import largest_force, local_stiffness
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem, Leg, reactions

ON_LIMIT = 1e-10
"""Distance from a limit, over the largest nodal force, that counts as none."""


@dataclass(frozen=True)
class Way:
    """The exact path through a part of a leg.

    Attributes:
        walk: stands where the path ends, or at the end of the part.
        error: why it ends, None at the end of the part.
        apex: the part ends at complete unloading of a body that lifts freely; the walk stands just
            before.
    """

    walk: Walk
    error: SolveError | None
    apex: bool

    @property
    def s(self) -> float:
        """Place on the leg up to which it goes."""
        return self.walk.s

    @property
    def end(self) -> ContactState:
        """State at its end."""
        system = self.walk.system
        n, y, load = system.n, self.walk.y, self.walk.load(self.walk.s)
        u = np.concatenate([y[:n], y[n : 2 * n] - system.g0])
        return ContactState(u, reactions(system, load, u), self.walk.state.copy())

    def finish(self) -> Leg:
        """Return the path to the end of the part; raise SolveError where its residual is large."""
        return self.walk.finish(self.apex)


class Continuation:
    """Looks for quasi-static paths through load steps; keeps the rates of known states.

    Attributes:
        system: the condensed body in 2N form.
        segments: rates in known sets of states.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Start with nothing remembered."""
        self.system, self.segments = system, Segments(system)
        self._stiffness = np.concatenate(local_stiffness(system))

    def size(self, change: Array) -> float:
        """Return the size of a change of displacement (2N,), as a nodal force."""
        return float(np.abs(self._stiffness * change).max(initial=0.0))

    def is_straight(self, start: ContactState, end: ContactState, force_scale: float) -> bool:
        """Return whether the straight way from start to end satisfies the contact law all along."""
        n, system, none = self.system.n, self.system, ON_LIMIT * force_scale
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

    def follow(
        self,
        start: ContactState,
        ends: tuple[Array, Array],
        part: tuple[float, float],
        force_scale: float,
        limit: Limit | None,
        samples: Iterable[float] = (),
    ) -> Way:
        """Follow the exact path through a part of a leg.

        Args:
            start: state at the start of the part.
            ends: (n_loads,) load factors at the start and at the end of the leg.
            part: s at the start and at the end of the part.
            force_scale: largest nodal force of the history so far.
            limit: where equilibrium ends on the leg.
            samples: places on the leg of states to keep.
        """
        scale = max(largest_force(self.system, load, start.r, force_scale) for load in ends)
        walk = Walk(self.segments, start, ends, scale, 0, False)
        walk.s = walk.progress_at = part[0]
        walk.sample_at = list(samples)
        walk.sums.go_on_from(walk.s, walk.y, walk.state)
        if limit is not None:
            walk.equilibrium_ends = limit.s
        # a free body without load has no single set of states
        unloaded = not np.any(walk.load(part[1])) and not np.any(self.system.g0)
        apex = unloaded and self.segments.lifts_freely
        try:
            walk.run(max(part[1] - APEX, part[0]) if apex else part[1])
            return Way(walk, None, apex)
        except SolveError as error:
            return Way(walk, error, apex)
