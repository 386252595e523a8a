"""Path along one leg, from one change of state to the next.

The loop (:mod:`~receding_fenicsx.interface.exact.kernel`) goes on by itself as long as it can; what
it asks for is answered here: rates in states that leave motions free, states that cycle, a choice
among several continuations, round-off that has grown, the last events before a complete unloading.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.exact import kernel, kernel_data
from receding_fenicsx.interface.exact.balance import summed
from receding_fenicsx.interface.exact.consistency import ConsistentStates, FindLimit
from receding_fenicsx.interface.exact.jumps import lost_by_loose_motion
from receding_fenicsx.interface.exact.legs import LegProblem, PathPoint
from receding_fenicsx.interface.exact.loop import Loop
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.rest import (
    UNLOADING_EVENTS,
    UNLOADING_REFINEMENTS,
    displacements_at_rest,
    keeps_limits,
)
from receding_fenicsx.interface.exact.segments import EPSILON, Segment, Segments, States, ties_at
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.residual import limit_excuse, reachable, residual_at_rest
from receding_fenicsx.interface.system import Changes, ContactState, Leg, reactions
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL, ROUND_OFFS, UNLOADING_ROUND_OFF


class Walk:
    """Path along one leg, under way.

    Attributes:
        problem: the leg.
        path: what has been followed so far.
        residual: largest residual so far of states evaluated afresh, over the force scale.
    """

    def __init__(
        self,
        loop: Loop,
        problem: LegProblem,
        find_limit: FindLimit = lambda a, b: None,
        accept_round_off: bool = True,
        traced: bool = False,
    ) -> None:
        """Start at the beginning of a leg.

        Args:
            loop: the compiled loop of the contact.
            problem: the leg; its force scale includes the held reactions at both ends.
            find_limit: where equilibrium ends on a leg.
            accept_round_off: accept a residual that round-off of the displacements explains; not
                where only friction too low to be resolved holds them.
            traced: keep all stops of the path.
        """
        self.loop, self.segments, self.system = loop, loop.segments, loop.system
        self.problem, self.force_scale = problem, problem.force_scale
        self.path = loop.path(problem, traced)
        self.residual, self._excess = 0.0, False
        self._find_limit, self._accept_round_off = find_limit, accept_round_off

    @property
    def s(self) -> float:
        """Place on the leg."""
        return float(self.path.place[0])

    @property
    def point(self) -> PathPoint:
        """Present place; its quantities are the path's, its states a copy."""
        return PathPoint(self.problem, self.s, self.path.y, self.path.state.copy())

    def run(self, s_end: float) -> None:
        """Follow the path from event to event up to ``s_end``.

        Raises:
            SolveError: the path ends before.
        """
        try:
            self._run(s_end)
        except SingularExchange as error:
            raise lost_by_loose_motion(self.system, self.problem.ends[1]) from error

    def _run(self, s_end: float) -> None:
        way = self.loop.way(self.problem, s_end)
        if not self.problem.ends[1].any():
            way = way._replace(unloading=UNLOADING_EVENTS)
        while True:
            try:
                request = self.loop.advance(way, self.path)
                if request == kernel.RATES:
                    self.loop.ask(way, self.path)
            except SingularExchange:
                request = kernel.UNDECIDED
            if request == kernel.DONE:
                return
            if request == kernel.ROOM:
                self.path = self.loop.enlarged(self.path)
            elif request == kernel.BALANCE:
                self._balanced()
            elif request == kernel.UNDECIDED:
                way = self._decided(way)
            elif request == kernel.CHOICE:
                self._choose(way)
            elif request == kernel.UNLOADING:
                self.path.counts[kernel_data.ASKED] = 1
                y = self._unloaded(way)
                if y is not None:
                    self._end_at(y, way)
                    return
            elif request == kernel.ENDLESS:
                states = self._states_at(self._before(), way)
                raise states.error(self.path.state, np.zeros(0, dtype=np.intp))

    def _before(self) -> States:
        """Return the (N,) states on the way to the present instant."""
        count, before = self.path.counts, self.path.state.copy()
        now = self.path.event[count[kernel_data.FIRST] : count[kernel_data.EVENTS]]
        before[now[:, 0]] = now[:, 1]
        return before

    def _states_at(self, state: States, way: kernel_data.Way) -> ConsistentStates:
        """Return the search for consistent states at the present point, in given states."""
        point = replace(self.point, state=state.copy())
        return ConsistentStates(self.segments, point, way.on_limit, self._find_limit)

    def _set(self, before: States, state: States) -> None:
        """Put states in place of those at the present instant."""
        count, path = self.path.counts, self.path
        changed = Changes.between(self.s, before, state)
        first, last = count[kernel_data.FIRST], count[kernel_data.FIRST] + len(changed)
        path.event_at[first:last] = self.s
        path.event[first:last] = np.stack([changed.node, changed.old, changed.new], axis=1)
        count[kernel_data.EVENTS] = last
        path.state[:] = state
        # nodes that were tried in other states are on limits, also those that keep their own
        for tie in ties_at(self.segments, self.s, path.y, before, self.force_scale):
            k = count[kernel_data.TIES]
            path.tie_at[k], path.tie[k] = tie[0], tie[1:]
            count[kernel_data.TIES] += 1

    def _decided(self, way: kernel_data.Way) -> kernel_data.Way:
        """Decide the states at the present point; return the leg with its limits, maybe wider."""
        before = self._before()
        states = self._states_at(before, way)
        segment = states.decide(before)
        self._give(way, before, states.point.state, segment)
        return way._replace(on_limit=np.where(way.on_limit < 0.0, -1.0, states.on_limit))

    def _give(self, way: kernel_data.Way, before: States, state: States, segment: Segment) -> None:
        """Give states and rates with which to go on from here."""
        self._set(before, state)
        path, opened = self.path, np.tile(state == SEPARATION, 2)
        path.y[2 * len(state) :][opened] = 0.0
        path.imbalance[:] = self.segments.balance.errors(path.y, self.problem.load(self.s))
        entry = self.loop.fill(way, path, segment.q)
        path.counts[kernel_data.GIVEN] = entry + 1

    def _choose(self, way: kernel_data.Way) -> None:
        """Let the chooser take one of the continuations."""
        chooser, before, path = self.problem.chooser, self._before(), self.path
        path.counts[kernel_data.CHOSEN] = 1
        assert chooser is not None
        states = self._states_at(path.state, way)
        q = self.loop.memory.rates[path.counts[kernel_data.ENTRY]].copy()
        segment = self.segments.segment(states.point.state, q, way.direction)
        chosen = chooser.choose(states, before, segment)
        if chosen is not segment:
            self._give(way, before, states.point.state, chosen)

    def _balanced(self) -> None:
        """Remove the imbalance of forces and displacements."""
        path, load, (a, b) = self.path, self.problem.load(self.s), self.problem.ends
        self._check(path.imbalance)
        # a node keeps the forces with which it lands: at an event those on the way there balance,
        # but where the path is almost at a standstill, or a node opens before its forces are zero
        hit, worst = int(path.counts[kernel_data.HIT]), np.abs(path.imbalance).max()
        opened = np.tile(path.state == SEPARATION, 2)
        for state in (path.state,) if hit < 0 else (self._before(), path.state):
            y = self.segments.values(self._refined(self._at(path.y, load, state), load))
            if state is not path.state:
                with suppress(SingularExchange):
                    q = self.segments.at(state, b - a).q
                    if q[hit] < 0.0:
                        y -= y[hit] / q[hit] * q
                y[hit] = 0.0
                y[2 * self.system.n :][opened] = 0.0
            imbalance = self.segments.balance.errors(y, load)
            if np.abs(imbalance).max() <= 0.5 * worst:
                break
        path.y[:], path.imbalance[:] = y, imbalance
        # it is removed again where it has doubled
        path.place[3] = max(path.place[3], 2.0 * float(np.abs(path.imbalance).max()))
        path.place[4] = kernel.reach(path.y, self.segments.weight)

    def _check(self, imbalance: Array) -> None:
        """Note the residual of the present point where forces and displacements do not balance."""
        if np.abs(imbalance).max() > summed(self.system.n, ACCEPTED_RESIDUAL) * self.force_scale:
            self._note(self.here())

    def _unloaded(self, way: kernel_data.Way) -> Array | None:
        """Return the (4N,) quantities at the end of unloading.

        None where the event just before is more than round-off.
        """
        path, left = self.path, way.end - self.s
        y = path.y + left * self.loop.memory.rates[path.counts[kernel_data.ENTRY]]
        start = self.problem.start.u
        if left - path.place[2] <= UNLOADING_ROUND_OFF and keeps_limits(
            self.segments, start, y, self.force_scale
        ):
            return y
        if np.any(self.problem.load(way.end)):
            return None
        # the round-off of large displacements before is no error at the end
        load = self.problem.load(way.end)
        end = self._refined(self._at(y, load), load, UNLOADING_REFINEMENTS)
        y = self.segments.margins(end)
        return y if keeps_limits(self.segments, start, y, self.force_scale) else None

    def _end_at(self, y: Array, way: kernel_data.Way) -> None:
        """Move on to the end of unloading, where the quantities (4N,) are given."""
        loop, path, end = self.loop, self.path, way.end
        entry = int(path.counts[kernel_data.ENTRY])
        kernel.sampled(loop.memory, way, path, entry, float(np.nextafter(end, 0.0)))
        kernel.advanced(loop.contact, loop.memory, way, path, entry, end - self.s)
        path.y[:], path.place[0] = y, end
        kernel.sampled(loop.memory, way, path, entry, end)

    def _at(self, y: Array, load: Array, state: States | None = None) -> ContactState:
        """Return the state for quantities y (4N,) and a load, reactions evaluated afresh."""
        u, state = self.displacements(y), self.path.state if state is None else state
        return ContactState(u, reactions(self.system, load, u), state.copy())

    def _refined(self, state: ContactState, load: Array, steps: int = 0) -> ContactState:
        """Return a state after iterative refinement.

        So many steps, or 0 for as many as bring the forces that vanish to round-off; fewer where
        corrections become negligible or no longer smaller: they are round-off of a soft direction
        then. After a complete unloading round-off of larger displacements before must not remain as
        slip.
        """
        n, weight, last = self.system.n, self.segments.weight, np.inf
        active, before = self.loop.sets.of(state.state), (np.inf, state)
        # on soft springs one step leaves a large part of the error, that of the pivots
        for _ in range(steps or 4):
            wrong = active.forces(state)
            error = float(np.abs(wrong).max(initial=0.0))
            # smaller errors of nodal forces are never removed
            if not steps and error <= 1e-13 * self.force_scale:
                break
            change = self._correction(state, wrong)
            largest = float(np.abs(change * weight[: 2 * n]).max())
            if largest >= last:
                return state if error < before[0] else before[1]
            before, last, u = (error, state), largest, state.u + change
            state = ContactState(u, reactions(self.system, load, u), state.state)
            if largest <= EPSILON * self.force_scale:
                break
        return state

    def _correction(self, state: ContactState, wrong: Array) -> Array:
        """Return the change (2N,) of displacements that brings forces which vanish back to zero."""
        segments, none = self.segments, np.zeros_like(state.u)
        if not segments.is_loose and not segments.is_near(state.state):
            with suppress(SingularExchange):
                return self.loop.sets.correction(state.state, wrong)
        with suppress(SingularExchange):
            return segments.tableau(state.state).correction(state.r)[: len(none)]
        return none

    def here(self) -> ContactState:
        """Return the state at the present point, reactions evaluated afresh."""
        return self._at(self.path.y, self.point.load)

    def stop_here(self) -> Leg:
        """Return the leg up to the place where the path ends, in the states on the way there.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        before = self._before()
        self._set(before, before)
        return self.finish()

    def finish(self, at_rest: bool = False) -> Leg:
        """Return the leg, its reactions evaluated afresh and its residual checked.

        ``at_rest``: it ends at complete unloading, just beyond the present point.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        path, problem = self.path, self.problem
        load = problem.load(self.s)
        y, balance = path.y, self.segments.balance
        imbalance = balance.errors(y, load)
        self._check(imbalance)
        reached = self._at(y, load)
        end = self._refined(reached, load, 0 if load.any() else UNLOADING_REFINEMENTS)
        self._note(end)
        leg = self._leg(end)
        if self._excess and not self._explained(leg):
            raise SolveError(
                f"the exact path lost accuracy before {self.segments.system.load_text(load)}: "
                f"residual {self.residual:.1e} over {ACCEPTED_RESIDUAL:.0e}; "
                "try the other solver method"
            )
        if at_rest:
            u = displacements_at_rest(self.segments, end)
            leg.end = ContactState(u, np.zeros_like(u), end.state)
            leg.samples += [(s, leg.end) for s in problem.samples[len(leg.samples) :]]
        else:
            if end is not reached:
                y = self.segments.values(end)
                imbalance = balance.errors(y, load)
            self.loop.last = end, y, imbalance
        return leg

    def _note(self, state: ContactState) -> None:
        """Note the residual of a state."""
        scale = max(self.force_scale, float(np.abs(state.r).max(initial=0.0)))
        self.force_scale = scale
        residual = residual_at_rest(self.system, state, scale)
        self.residual = max(self.residual, residual)
        if residual > ACCEPTED_RESIDUAL:
            places = self.problem.start.u, state.u
            accepted = max(reachable(self.system, u, scale) for u in places)
            self._excess |= residual > accepted

    def _explained(self, leg: Leg) -> bool:
        """Return whether round-off of the displacements explains the residual."""
        if not self._accept_round_off:
            return False
        states = self.problem.start, leg.end
        return self.residual <= _displacement_uncertainty(
            self.segments, states, leg.events, self.force_scale
        )

    def _leg(self, end: ContactState) -> Leg:
        """Return what has been followed."""
        path, problem = self.path, self.problem
        counts = path.counts.tolist()
        events, ties = counts[kernel_data.EVENTS], counts[kernel_data.TIES]
        stops, samples = counts[kernel_data.STOPS], counts[kernel_data.SAMPLES]
        sampled = zip(problem.samples[:samples], path.sample, path.sample_state, strict=False)
        made = []
        if problem.samples:
            made = [(problem.s_start, problem.start.u)] + [
                (s, self.displacements(y))
                for s, y in zip(path.stop_at[:stops].tolist(), path.stop[:stops], strict=True)
            ]
        return Leg(
            end=end,
            dissipation=path.dissipation,
            work=float(path.work.sum()),
            residual=self.residual,
            force_scale=self.force_scale,
            samples=[(s, self._at(y, problem.load(s), state)) for s, y, state in sampled],
            events=_changes(path.event_at[:events], path.event[:events]),
            stops=made,
            ties=_changes(path.tie_at[:ties], path.tie[:ties]),
        )

    def displacements(self, y: Array) -> Array:
        """Return the displacements (2N,) that belong to quantities y (4N,)."""
        n = self.system.n
        return np.concatenate([y[:n], y[n : 2 * n] - self.system.g0])

    def stops(self) -> list[tuple[float, Array, Array, int, States]]:
        """Return the events and the end of a path that is traced.

        Of each its place, displacements (2N,), rates (4N,) on the way there, the quantity that has
        reached its limit, -1 at the end, and the (N,) states on the way there.
        """
        path, count = self.path, self.path.counts[kernel_data.STOPS]
        columns = path.stop_at, path.stop, path.stop_rate, path.stop_label, path.stop_state
        return [
            (float(s), self.displacements(y), q.copy(), int(label), state.copy())
            for s, y, q, label, state in zip(*(part[:count] for part in columns), strict=True)
        ]


def _changes(at: Array, what: NDArray[np.int64]) -> Changes:
    """Return changes given by places (k,) and (k, 3) nodes, old and new states, as copies."""
    if not len(at):
        return Changes.none()
    states = what[:, 1:].astype(np.int8)
    return Changes(at.copy(), what[:, 0].copy(), states[:, 0], states[:, 1])


def _displacement_uncertainty(
    segments: Segments,
    ends: tuple[ContactState, ContactState],
    events: Changes,
    force_scale: float,
) -> float:
    """Return the residual that round-off may leave in gaps and slips, over the force scale.

    Displacements respond to round-off of the reactions, in a nearly singular body far more than the
    forces: measured by random signs of it in the last sets of states of the leg. Stuck nodes keep
    the error of the start.
    """
    n, weight = segments.system.n, segments.weight
    reach: Array = np.abs(segments.system.K) @ np.max([np.abs(end.u) for end in ends], axis=0)
    signs = np.random.default_rng(0).choice([-EPSILON, EPSILON], (8, 2 * n))
    now = ends[0].state.copy()
    met = {now.tobytes(): now.copy()}
    for _, i, _, new in events:
        now[i] = new
        met[now.tobytes()] = now.copy()
    largest = 0.0
    for state in list(met.values())[-64:]:
        with suppress(SingularExchange):  # a motion without stiffness excuses nothing
            tableau = segments.tableau(state)
            for error in signs * reach:
                change = tableau.correction(error)[: 2 * n] * weight[: 2 * n]
                largest = max(largest, float(np.abs(change).max()))
    inherited = 2.0 * residual_at_rest(segments.system, ends[0], force_scale)
    excused = max(inherited, ROUND_OFFS * largest / force_scale)
    return limit_excuse(segments.system, excused, [end.u for end in ends], force_scale)
