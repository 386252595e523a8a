"""Path along one leg, from one change of state to the next."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import daxpy

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL, Sums
from receding_fenicsx.interface.exact.consistency import ConsistentStates, EquilibriumEnd
from receding_fenicsx.interface.exact.legs import (
    END_TOLERANCE,
    EVENTS_WITHOUT_PROGRESS,
    SIMULTANEOUS,
    Course,
    LegProblem,
    PathPoint,
    changed_nodes,
)
from receding_fenicsx.interface.exact.round_off import RoundOff, displacement_uncertainty
from receding_fenicsx.interface.exact.segments import Segment, Segments
from receding_fenicsx.interface.exact.unloading import (
    UNLOADING_EVENTS,
    UNLOADING_REFINEMENTS,
    UNLOADING_ROUND_OFF,
    displacements_at_rest,
    keeps_limits,
)
from receding_fenicsx.interface.residual import residual_at_rest
from receding_fenicsx.interface.system import ContactState, Leg


class Walk:
    """Path along one leg, under way.

    Attributes:
        point: present place, quantities and states.
        states: search for consistent states.
        sums: dissipation, work and residual so far.
        round_off: imbalance of displacements and forces.
        course: samples, events and stops so far.
    """

    def __init__(
        self,
        segments: Segments,
        problem: LegProblem,
        check_all: bool = False,
        equilibrium_ends: EquilibriumEnd = lambda ends: np.inf,
        accept_round_off: bool = True,
    ) -> None:
        """Start at the beginning of a leg.

        Args:
            segments: rates in known sets of states.
            problem: the leg; its force scale includes the held reactions at both ends.
            check_all: evaluate the residual afresh after every event.
            equilibrium_ends: place on the leg beyond which there is no equilibrium.
            accept_round_off: accept a residual that round-off of the displacements explains; not
                where only friction too low to be resolved holds them.
        """
        self.segments, self.system, self.problem = segments, segments.system, problem
        start = problem.start
        y = segments.values(start)
        self.point = PathPoint(problem, self.system, problem.s_start, y, start.state.copy())
        self.sums = Sums(segments, self.point, check_all)
        self.states = ConsistentStates(segments, self.point, self.sums, equilibrium_ends)
        self.round_off = RoundOff(segments, self.point, self.sums)
        self.course = Course(problem)
        self._accept_round_off = accept_round_off
        self._unloading = not np.any(problem.ends[1])
        self._progress_at, self._events_here = problem.s_start, 0

    def run(self, s_end: float) -> None:
        """Follow the path from event to event up to ``s_end``.

        Raises:
            SolveError: the path ends before.
        """
        point, y = self.point, self.point.y
        segment = self._consistent()
        looked_at = True
        while True:
            times = y[segment.falling] * segment.time
            k = int(times.argmin()) if len(times) else -1
            first = float(times[k]) if k >= 0 else np.inf
            if first < SIMULTANEOUS and not looked_at:
                segment, looked_at = self._consistent(), True
                continue
            last = first >= s_end - point.s - END_TOLERANCE
            if self._unloading and not last:
                unloaded = self._unloaded(segment, first, s_end)
                if unloaded is not None:
                    self._end_at(unloaded, segment, s_end)
                    return
            ds = s_end - point.s if last else max(first, 0.0)
            if self.course.sample_at:
                self.course.sample(point, segment.q, point.s + ds)
            self._advance(segment, ds)
            if last:
                point.s = s_end
                return
            if self.problem.samples:
                self.course.stops.append((point.s, point.displacements(y)))
            if ds <= SIMULTANEOUS:
                self._check_progress()
            segment, looked_at = self._event(int(segment.falling[k]), segment), True

    def _unloaded(self, segment: Segment, first: float, s_end: float) -> Array | None:
        """Return the (4N,) quantities at the end of unloading.

        None where the event just before, after ``first``, is more than round-off.
        """
        left = s_end - self.point.s
        if left - first > UNLOADING_EVENTS:
            return None
        y = self.point.y + left * segment.q
        if left - first <= UNLOADING_ROUND_OFF and keeps_limits(self.segments, self.sums, y):
            return y
        if np.any(self.problem.load(s_end)):
            return None
        # the round-off of large displacements before is no error at the end
        y = self.segments.margins(self.round_off.refined(s_end, y, UNLOADING_REFINEMENTS))
        return y if keeps_limits(self.segments, self.sums, y) else None

    def _end_at(self, y: Array, segment: Segment, s_end: float) -> None:
        """Move on to the end of unloading, where the quantities (4N,) are given."""
        self.course.sample(self.point, segment.q, float(np.nextafter(s_end, 0.0)))
        self.point.y[:], self.point.s = y, s_end
        self.course.sample(self.point, segment.q, s_end)
        self.sums.add_stop(s_end, self.point.y, self.point.state)

    def _advance(self, segment: Segment, ds: float) -> None:
        """Move on by ds."""
        point, y = self.point, self.point.y
        daxpy(segment.q, y, a=ds)  # in place, as y is contiguous
        point.s += ds
        self.sums.add_stop(point.s, y, point.state)

    def _event(self, label: int, segment: Segment) -> Segment:
        """Pass an event; return the rates after it."""
        point, states = self.point, self.states
        point.y[label] = 0.0
        before = point.state
        following = states.find(label, segment.q)
        self.course.add_events(point.s, changed_nodes(before, point.state))
        self.round_off.count_event()
        return following

    def _consistent(self) -> Segment:
        """Bring the states to consistent ones; return their rates."""
        before = self.point.state
        segment = self.states.find()
        self.course.add_events(self.point.s, changed_nodes(before, self.point.state))
        return segment

    def _check_progress(self) -> None:
        """Raise an error when events follow each other without end at one place of the leg."""
        point = self.point
        if point.s - self._progress_at > SIMULTANEOUS:
            self._progress_at, self._events_here = point.s, 0
        self._events_here += 1
        if self._events_here > EVENTS_WITHOUT_PROGRESS * self.system.n:
            raise self.states.error(point.state, np.zeros(0, dtype=np.intp))

    def stop_here(self) -> Leg:
        """Return the leg up to the place where the path ends, in the states on the way there.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        events, last = self.course.events, self.sums.state
        state = self.problem.start.state.copy()
        for _, i, _, new in events:
            state[i] = new
        while not np.array_equal(state, last):
            _, i, old, _ = events.pop()
            state[i] = old
        self.point.state = last.copy()
        return self.finish()

    def finish(self, at_rest: bool = False) -> Leg:
        """Return the leg, its reactions evaluated afresh and its residual checked.

        Round-off is removed where the tableau is near, and where it is not small.

        Args:
            at_rest: the leg ends at complete unloading, just beyond the present point.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        sums = self.sums
        sums.add_up(at_end=True)
        end = self._refined_end()
        last = self._residual(end)
        residual = max(sums.residual, last)
        if (sums.excess > 0.0 or self._exceeds(last, end)) and not self._explained(residual, end):
            raise SolveError(
                f"the exact path lost accuracy before load factors {self.point.load.tolist()}: "
                f"residual {residual:.1e} over {EVENT_RESIDUAL:.0e}; try the other solver method"
            )
        if at_rest:
            u = displacements_at_rest(self.segments, end)
            end = ContactState(u, np.zeros_like(u), end.state)
            self.course.samples += [(s, end) for s in self.course.sample_at]
        return Leg(
            end=end,
            dissipation=sums.dissipation,
            work=float(sums.work.sum()),
            residual=residual,
            force_scale=sums.force_scale,
            samples=self.course.samples,
            events=Changes.of(self.course.events),
            stops=self.course.stops,
            ties=Changes.joined(*sums.ties),
        )

    def _refined_end(self) -> ContactState:
        """Return the state at the present point, round-off removed where it matters."""
        loaded = np.any(self.point.load)
        if loaded and (self.segments.is_near(self.point.state) or not self.round_off.is_small()):
            return self.round_off.remove()
        end = self.point.contact_state()
        if self._exceeds(self._residual(end), end):
            end = self.round_off.remove()
            if loaded or self._exceeds(self._residual(end), end):
                return end
        if loaded:
            return end
        # unloaded: round-off of larger displacements before must not remain as slip
        return self.round_off.remove(UNLOADING_REFINEMENTS)

    def _residual(self, end: ContactState) -> float:
        """Return the residual at one instant."""
        scale = max(self.sums.force_scale, float(np.abs(end.r).max(initial=0.0)))
        self.sums.force_scale = scale
        return residual_at_rest(self.system, end, scale)

    def _exceeds(self, residual: float, end: ContactState) -> bool:
        """Return whether a residual is above what is accepted at one instant."""
        return residual > EVENT_RESIDUAL and residual > self.sums.accepted(end.u)

    def _explained(self, residual: float, end: ContactState) -> bool:
        """Return whether round-off of the displacements explains a residual."""
        if not self._accept_round_off:
            return False
        states = self.problem.start, end
        scale = self.sums.force_scale
        events = self.course.events
        return residual <= displacement_uncertainty(self.segments, states, events, scale)
