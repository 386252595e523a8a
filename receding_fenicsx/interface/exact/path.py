"""Exact evolution along straight legs of the load path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.equilibrium import Limit, furthest, is_balanced
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.jumps import add_jump, check_jumps, find_jump, no_state_beyond
from receding_fenicsx.interface.exact.legs import (
    Chooser,
    LegProblem,
    evenly_spaced,
    unchanged,
)
from receding_fenicsx.interface.exact.rest import (
    carries_nothing,
    is_at_rest,
    is_closed,
    load_from_rest,
    stops_short,
    zero_crossing,
)
from receding_fenicsx.interface.exact.segments import Segments, ties_at
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.residual import largest_force
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import JUMP_STEP, REMAINING_LOAD

if TYPE_CHECKING:
    from receding_fenicsx.interface.exact.loop import Loop
    from receding_fenicsx.interface.exact.walk import Walk

LOW_FRICTION = 1e-5
"""Coefficient of friction below which a path that ends may have been lost in round-off of f P."""


class EventPath:
    """Follows legs exactly; keeps the tableau and the rates of known states from leg to leg.

    Attributes:
        segments: rates of the whole contact.
    """

    def __init__(
        self,
        system: ContactSystem,
        on_jump: str = "stop",
        chooser: Chooser | None = None,
    ) -> None:
        """Prepare for ``system`` in 2N form.

        Args:
            system: the condensed body, ``kind = "frictional"``.
            on_jump: "stop" where no quasi-static path continues, or pass the jump by one "static"
                problem.
            chooser: chooses among several continuations; None takes the first one found.
        """
        self.system, self.on_jump = system, on_jump
        self.chooser = chooser
        self.segments = Segments(system)
        self._loop: Loop | None = None
        self._low_friction_node = _low_friction_node(self.segments)
        self._changed, self._opened = np.zeros((2, system.n), dtype=bool)
        self._directions: set[bytes] = set()  # of the legs followed
        self._limits: dict[tuple[bytes, bytes], Limit | None] = {}

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg from its start to its end.

        Args:
            start: state at the start.
            ends: (n_loads,) load factors at the start and at the end.
            force_scale: largest nodal force of the history so far.
            samples: number of evenly spaced states to store, the last one at s = 1; 0 for none.

        Returns:
            The traced leg.

        Raises:
            NoEquilibrium: lift-off or gross sliding, with the load factor where it happens.
            NoQuasiStaticContinuation: the rate problem has no solution.
            SolveError: the residual of the contact law is above its tolerance.
        """
        places = evenly_spaced(samples)
        leg = self.trace(LegProblem(start, ends, force_scale, places, chooser=self.chooser))
        if leg.samples:
            # the end is refined, what is extrapolated to it is not
            leg.samples[-1] = (places[-1], leg.end)
        return leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg: a static problem with slip counted from ``start``."""
        return self._from_rest(LegProblem(start, ends, force_scale, chooser=self.chooser))

    def trace(self, problem: LegProblem) -> Leg:
        """Follow a leg, or a piece of one, which may start or end unloaded."""
        start, (a, b) = problem.start, problem.ends
        change, r_star = b - a, self.system.r_star
        # held reactions that cancel but for round-off change nothing
        if problem.way not in self._directions and (
            np.abs(change @ r_star).max() <= 1e-13 * (np.abs(change) @ np.abs(r_star)).max()
        ):
            y, scale = self.segments.values(start), problem.force_scale
            leg = unchanged(problem)
            leg.ties = ties_at(self.segments, 0.0, y, start.state, scale)
            return leg
        scale = problem.force_scale
        if is_at_rest(self.system, a) and carries_nothing(self.system, start, a, scale):
            if is_closed(self.segments, start, scale):
                return self._from_rest(problem)
        resting = at_rest(self.system, start, (a, b), scale)
        if resting is not start:
            problem = problem.piece(resting, (a, b), scale, (0.0, 1.0))
        s0 = zero_crossing(self.system, problem.ends)
        if s0 is None:
            leg = self._pressed_leg(problem)
        else:
            zero = np.zeros_like(a)
            first = self.trace(problem.piece(resting, (a, zero), scale, (0.0, s0)))
            second = self.trace(problem.piece(first.end, (zero, b), first.force_scale, (s0, 1.0)))
            leg = first.placed(s0)
            leg.add(second.placed(1.0 - s0, s0))
        if resting is not start:
            turned = Changes.between(0.0, start.state, resting.state)
            leg.events = Changes.joined(turned, leg.events)
            leg.stops = [(0.0, resting.u), *leg.stops]
        return leg

    def _from_rest(self, problem: LegProblem) -> Leg:
        """Follow a leg from rest, or jump to its end, by one static problem."""
        load = problem.ends[1]
        return load_from_rest(self.segments, problem, self.limit(np.zeros_like(load), load))

    def _pressed_leg(self, problem: LegProblem) -> Leg:
        """Follow a leg on which forces act from its start; explain why one ends early."""
        (a, b), start = problem.ends, problem.start
        scale = largest_force(self.system, np.array([a, b]), start.r, problem.force_scale)
        if scale > problem.force_scale:
            problem = problem.piece(start, (a, b), scale, (0.0, 1.0))
        try:
            leg = self._walk(problem)
        except SolveError as error:
            limit, node = self.limit(a, b), self._low_friction_node
            if isinstance(error, NoEquilibrium) and (limit is not None or node is None):
                raise
            if limit is not None:
                raise NoEquilibrium(limit.text) from error
            if node is None:
                raise
            f = float(self.system.friction.mean[node])
            raise SolveError(
                f"the exact path is lost on the way to {self.system.load_text(b)}: the friction "
                f"f = {f:.2g} of node {node} is so small that its limit cannot be told from "
                f"round-off; make it 0, or {LOW_FRICTION:.0e} at least"
            ) from error
        if not is_balanced(self.system, b, leg.end):
            limit = self.limit(a, b)
            if limit is not None and limit.s < 1.0 - 1e-7:
                # round-off of a vanishing stiffness has carried the loads
                raise NoEquilibrium(limit.text)
        return leg

    def walk(self, problem: LegProblem) -> Walk:
        """Return a walk that stands at the start of a leg or at a place on it."""
        # loads Numba, which takes longer than all the rest
        from receding_fenicsx.interface.exact.compilation import loop_of
        from receding_fenicsx.interface.exact.walk import Walk

        self._loop = loop = self._loop or loop_of(self.segments)
        return Walk(loop, problem, self.limit, self._low_friction_node is None)

    def _walk(self, problem: LegProblem) -> Leg:
        """Follow one leg from event to event."""
        walk, resolved = self.walk(problem), self._low_friction_node is None
        if problem.way in self._directions and not self.segments.is_loose:
            walk.loop.leave_out(problem.start.state, self._changed, self._opened)
        short = stops_short(self.segments, problem.ends[1])
        try:
            walk.run(1.0 - REMAINING_LOAD if short else 1.0)
        except NoQuasiStaticContinuation:
            if self.on_jump != "static" or not resolved:
                raise
            return self._jump(walk, problem)
        leg = walk.finish(at_rest=short)
        self._remember(problem.way, leg)
        return leg

    def _jump(self, walk: Walk, problem: LegProblem) -> Leg:
        """Pass the jump at which a walk has ended, and follow the rest of the leg."""
        place = walk.point.load
        check_jumps(self.system, problem.jumps, place)
        leg = walk.stop_here()
        s = walk.s + JUMP_STEP
        if s >= 1.0:
            raise no_state_beyond(self.system, place)
        load = problem.load(s)
        leg.stops.append((walk.s, leg.end.u))
        jump = find_jump(self.segments, leg.end, load, place)
        add_jump(leg, (walk.s, s), jump, problem.samples)
        ends = load, problem.ends[1]
        rest = self.trace(problem.piece(leg.end, ends, leg.force_scale, (s, 1.0), jumps=1))
        leg.add(rest.placed(1.0 - s, s))
        self._remember(problem.way, leg)
        return leg

    def _remember(self, way: bytes, leg: Leg) -> None:
        """Remember which nodes changed state on a leg in a direction, given by its key."""
        self._directions.add(way)
        events = leg.events
        self._changed[events.node] = True
        self._opened[events.node[(events.old == SEPARATION) | (events.new == SEPARATION)]] = True

    def limit(self, a: Array, b: Array) -> Limit | None:
        """Return where equilibrium ends on a leg, None where it does not."""
        key = a.tobytes(), b.tobytes()
        if key not in self._limits:
            self._limits[key] = furthest(self.system, a, b)
        return self._limits[key]


def _low_friction_node(segments: Segments) -> int | None:
    """Return the node with the least friction above zero where that is low, else None."""
    nodes, f = np.flatnonzero(segments.frictional), segments.system.friction.mean
    if not len(nodes):
        return None
    node = int(nodes[np.argmin(f[nodes])])
    return node if f[node] < LOW_FRICTION else None
