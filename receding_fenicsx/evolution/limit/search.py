"""Search for the limit between the cycles of a history, and check of the cycle found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count, pairwise

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.instants import (
    FinishedCycle,
    Instant,
    end_of,
    instant,
    steady_watch,
)
from receding_fenicsx.evolution.limit.tail import NoLimit, Tail, follow, trace
from receding_fenicsx.evolution.problem import Problem
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Limit, Steady
from receding_fenicsx.evolution.run_state import Position, RunState
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.rest import carries_nothing, zero_crossing
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import STICK
from receding_fenicsx.interface.measures.steady import (
    CYCLIC_SLIP,
    RATCHETTING,
    SHAKEDOWN,
    SteadyWatch,
)
from receding_fenicsx.interface.system import ContactState, frictional_form, reactions
from receding_fenicsx.interface.tolerances import LIMIT_CYCLE_TOLERANCE

Progress = Callable[[int, int, str], None]
"""Called as progress(cycle, cycles, message) after every cycle, and in searches for the limit."""

FIRST_SEARCH = 2
"""Cycle after which the limit is searched for first; then after 3, 4, 6, 8, 12, ... of them."""

MAX_PLAYED = 2000
"""Cycles that one search may play. Most searches play one, few more than fifty; the last one goes
on with the history where that has ended without a limit."""

MAX_CHECKS = 10
"""Cycles played from the one that was found until the states at start and end are the same, which
round-off may tell; load steps come to a cycle of their own."""


class LimitSearch:
    """Searches for the limit between the cycles of a history.

    What it does follows from the cycle's number and the cycles before alone, so that a resumed run
    repeats it. ``limit`` is what has been found so far, ``steady`` the steady state, None before;
    ``searched`` counts the cycles that all searches have played, those that failed too.
    """

    def __init__(self, problem: Problem, cycles: list[FinishedCycle]) -> None:
        """Repeat the searches that a run made before it was resumed after some cycles."""
        self.problem = problem
        self._tolerance = problem.solver.steady_tolerance or LIMIT_CYCLE_TOLERANCE
        self.limit = Limit(False, -1, 0, np.nan, -1, "the search has not begun")
        self.steady: Steady | None = None
        self.searched = self._allowed = 0
        self._tell: Callable[[str], None] | None = None
        if problem.system.has_branches:
            why = "with a shear limit or a cohesion cycles are played until they repeat themselves"
            self.limit.reason = why
            return
        self._model = replace(frictional_form(problem.system), probes=None)
        self._exact, self._segments = EventPath(self._model), Segments(self._model)
        for number in filter(self.is_due, range(len(cycles))):
            before = self.limit
            if self.found(cycles[:number], None):  # a history that began without searches
                self.limit, self.steady = before, None

    def is_due(self, number: int) -> bool:
        """Return whether the limit is searched for before a cycle is played."""
        # the map of a tail is that of cones: other laws are played on
        if self.problem.system.has_branches or number <= FIRST_SEARCH:
            return False
        return number == self.problem.history.cycles or is_step(number - 1)

    def found(self, cycles: list[FinishedCycle], progress: Progress | None) -> bool:
        """Search for the cycle that repeats itself; add it to the finished ones if it was found."""
        at = len(cycles) - 1, self.problem.history.cycles
        self._tell = None if progress is None else partial(progress, *at)
        try:
            cycle = self._cycle(cycles)
        except (NoLimit, SolveError) as error:
            reason = str(error) if isinstance(error, NoLimit) else "a cycle searched ends early"
            self.limit = replace(self.limit, reason=reason)
            return False
        self.limit = replace(self.limit, cycles_played=len(cycles) - 1 + self.searched)
        cycles.append(cycle)
        if progress is not None:
            progress(at[0] + 1, at[1], "limit found")
        return True

    def _cycle(self, cycles: list[FinishedCycle]) -> FinishedCycle:
        """Return the cycle that repeats itself, played and checked."""
        number, in_steps = len(cycles), self.problem.solver.method != "events"
        force, self._allowed = cycles[-1].totals.force_scale, self.searched + MAX_PLAYED
        if in_steps or number == self.problem.history.cycles:
            start = cycles[-1].corners[-1].state
            tail = self._later_tail(start, force, 1 if in_steps else number)
        else:
            tail = self._tail(cycles[-2].corners[-1].state, force)
        trial = RunState(self.problem, cycles)
        begin, cycle = self._played(trial, tail)
        ends = [begin, cycle.corners[-1]]
        if tail.walks or in_steps:
            self.searched += 1
            ends += trial.trace_cycle(number).corners[-1:]
        watch = self._watch(ends, cycle)
        # one cycle does not tell a drift that stays from one that decays
        if watch.kind not in ((RATCHETTING,) if tail.walks else (SHAKEDOWN, CYCLIC_SLIP)):
            raise NoLimit(
                f"the cycle that was found changes its forces by {watch.change[0]:.1e} and "
                f"displacements by {np.abs(cycle.slip).max():.1e}"
            )
        why = (
            "load steps play a cycle of their own from the limit of the exact path"
            if in_steps
            else "the cycles played last go on in the same order of events and come to this one"
        )
        self.limit = Limit(True, number, -1, watch.change[0], -1 if in_steps else 1, why, True)
        change = np.append(np.array(trial.steady.change), watch.change[0])
        self.steady = Steady(True, number, watch.kind, watch.period, change)
        return cycle

    def _tail(self, start: ContactState, force: float) -> Tail:
        """Return the limit of the exact path from the start of a cycle on.

        Cycles to come in which releases have another order than in this one are played.
        """
        loop = self.problem.history.loop
        if carries_nothing(self._model, start, loop[0], force) or any(
            zero_crossing(self._model, leg) for leg in pairwise(loop)
        ):
            raise NoLimit("the contact is unloaded in the cycle, and begins anew")
        self.searched += 1
        cycle = trace(self._segments, start, loop, force)
        tolerance = self._tolerance * force
        tail = follow(cycle, force, tolerance)
        k = np.concatenate(self._model.local_stiffness)
        for u, after in tail.others:
            state = ContactState(u, reactions(self._model, loop[0], u), cycle.end.state)
            end = self._exact_cycle(state, force)
            if np.any(k * np.abs(end.u - after) > tolerance):
                raise NoLimit("events will come in another order")
        return tail

    def _exact_cycle(self, state: ContactState, force: float) -> ContactState:
        """Return the end of a cycle of the exact path; raise NoLimit where too many are played."""
        if self.searched >= self._allowed:
            raise NoLimit(f"a search plays {MAX_PLAYED} cycles at most")
        self.searched += 1
        if self._tell is not None:
            self._tell(f"{self.searched} more in searches for the limit")
        for leg in pairwise(self.problem.history.loop):
            state = self._exact.trace_leg(state, leg, force).end
        return state

    def _later_tail(self, state: ContactState, force: float, played: int) -> Tail:
        """Return the limit of the exact path that goes on where the history is.

        Load steps come to one near it; other histories have played so many cycles.
        """
        for number in count(played):
            before, state = state, self._exact_cycle(state, force)
            if is_step(number):
                try:
                    tail = self._tail(before, force)
                except NoLimit:
                    continue
                if tail.walks and self.problem.solver.method != "events":
                    raise NoLimit("a body that may walk is played plainly in load steps")
                return tail
        raise AssertionError

    def _played(self, trial: RunState, tail: Tail) -> tuple[Instant, FinishedCycle]:
        """Play cycles from the limit until one ends as it begins; return its start and itself.

        Load steps come to the cycle of their own, which is near that of the exact path.
        """
        problem, number, start = self.problem, len(trial.cycles), trial.position
        in_steps = problem.solver.method != "events"
        bound = self._tolerance * start.totals.force_scale
        state = ContactState(tail.u, reactions(self._model, start.load, tail.u), tail.state)
        for check in range(MAX_CHECKS):
            if check < MAX_CHECKS // 2:  # round-off alone tells whether they slip
                stuck = np.where(tail.drifting, STICK, state.state).astype(np.int8)
                state = replace(state, state=stuck)
            self.searched += 1
            trial.position = Position(state, start.load, start.totals)
            begin = instant(problem.system, (number, 0, 0.0), start.load, state)
            cycle = trial.trace_cycle(number, problem.output.cycles is None)
            end = trial.position.state
            change = np.abs(end.r - state.r).max() if in_steps else 0.0
            if change <= bound and np.array_equal(state.state, end.state):
                return begin, cycle
            # a node that just reaches its limit at the end begins the next cycle in slip
            state = end
        raise NoLimit("the cycle that was found does not end as it begins")

    def tell(self, record: Record) -> None:
        """Add the limit to the record, and its steady state where the search has found it."""
        last = len(record.cycles.dissipation)
        if self.steady is not None:
            record.steady = self.steady
        elif record.steady.reached:
            each = "the cycles" if record.steady.period == 1 else "pairs of cycles"
            why = f"{each} repeated themselves as they were played"
            self.limit = Limit(True, last, last + self.searched, np.nan, -1, why)
        else:
            why = f"{self.limit.reason}; raise [history] cycles"
            self.limit = replace(self.limit, cycles_played=last + self.searched, reason=why)
        record.limit = self.limit

    def _watch(self, ends: list[Instant], cycle: FinishedCycle) -> SteadyWatch:
        """Return the watch that has seen the cycle and the next, or its changes once more.

        ``ends`` are its start, its end, and that of the next where this was played.
        """
        problem, (begin, end) = self.problem, ends[:2]
        r, v, seen = begin.state.r, begin.v, [(i.state.r, i.v) for i in ends]
        if len(seen) == 2:
            gain = end.v - v
            # slip that the cycle found adds, over the largest displacement, that is an error of the
            # drifts
            gain[np.abs(gain) <= 1e-10 * np.abs(end.state.u).max()] = 0.0
            seen = [(r + k * (end.state.r - r), v + k * gain) for k in range(3)]
        watch = steady_watch(problem.system, problem.solver, ())
        for r, v in seen:
            watch.add(end_of(cycle)._replace(r=r, v=v))
        return watch


def is_step(number: int) -> bool:
    """Return whether a number is one of 1, 2, 3, 4, 6, 8, 12, 16, 24, ..."""
    return number % (1 << max(0, number.bit_length() - 2)) == 0
