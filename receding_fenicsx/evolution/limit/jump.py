"""Jump from the cycles played so far to the cycle that repeats itself, and check that it does."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.cycle_data import LIMIT_TOLERANCE, FinishedCycle, end_of, new_watch
from receding_fenicsx.evolution.instants import Instant, instant
from receding_fenicsx.evolution.limit.drifts import OVERSHOT, derivatives, has_settled
from receding_fenicsx.evolution.limit.frozen import Budget, NoLimit
from receding_fenicsx.evolution.limit.search import Candidate, find_limit
from receding_fenicsx.evolution.limit.uniqueness import NOT_EXAMINED, YES, is_unique
from receding_fenicsx.evolution.limit.walking import find_walk, may_walk, walking_motions
from receding_fenicsx.evolution.problem import Problem
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Limit, Steady
from receding_fenicsx.evolution.run_state import Position, RunState
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.measures.steady import (
    CYCLIC_SLIP,
    RATCHETTING,
    SHAKEDOWN,
    SteadyWatch,
)
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactState

Progress = Callable[[int, int, str], None]
"""Called as progress(cycle, cycles, message) after every cycle."""

FIRST_SEARCH = 2
"""Cycle after which the limit is searched for first; then after twice as many, and so on."""

MAX_CYCLES = 40
"""Cycles after which a search is given up; those that succeed mostly play a dozen."""

MAX_CHECKS = 10
"""Cycles played from the one that was found until the states at start and end are the same, which
round-off may tell; load steps come to a cycle of their own."""

NO_GAIN = 1e-10
"""Slip that the cycle found adds, over the largest displacement, that is an error of the drifts."""

MORE = 10
"""A limit that was found is judged again after a tenth more cycles."""

IN_STEPS = "load steps play a cycle of their own from the limit of the exact path"
"""What is said of the limit of load steps."""

IN_WALKS = "whether the body may walk otherwise is not examined"
"""What is said of the limit of a body that walks."""


class LimitSearch:
    """Searches for the limit between the cycles of a history.

    What it does follows from the cycle's number and the cycles before alone, so that a resumed run
    repeats it.

    Attributes:
        limit: what has been found so far.
        steady: the steady state that was found, None before.
        searched: cycles that all searches have played, those that failed too.
    """

    def __init__(self, problem: Problem, cycles: list[FinishedCycle]) -> None:
        """Repeat the searches that a run made before it was resumed after some cycles."""
        self.problem = problem
        self.limit = Limit(False, -1, 0, 0, np.nan, -1, "the search has not begun")
        self.steady: Steady | None = None
        self.searched = 0
        self._waiting: Candidate | None = None
        self._judged_again = 0
        for number in filter(self.is_due, range(len(cycles))):
            before = self.limit
            if self.found(cycles[:number], None):  # a history that began without searches
                self.limit, self.steady = before, None

    def is_due(self, number: int) -> bool:
        """Return whether the limit is searched for, or judged again, before a cycle is played."""
        doublings, rest = divmod(number - 1, FIRST_SEARCH)
        due = number > 1 and rest == 0 and doublings.bit_count() == 1
        return due or (self._waiting is not None and number >= self._judged_again)

    def found(self, cycles: list[FinishedCycle], progress: Progress | None) -> bool:
        """Search for the cycle that repeats itself; add it to the finished ones if it was found."""
        budget = Budget(min(MAX_CYCLES, self.problem.history.cycles - len(cycles)))
        try:
            cycle = self._cycle(cycles, budget)
        except (NoLimit, SolveError) as error:
            self.limit = replace(self.limit, reason=str(error))
            return False
        finally:
            self.searched += budget.played
        self.limit = replace(self.limit, cycles_played=len(cycles) - 1 + self.searched)
        cycles.append(cycle)
        if progress is not None:
            progress(len(cycles) - 1, self.problem.history.cycles, "limit found")
        return True

    def _cycle(self, cycles: list[FinishedCycle], budget: Budget) -> FinishedCycle:
        """Return the cycle that repeats itself, played and checked.

        Raises:
            NoLimit: none was found.
            SolveError: its path ends early.
        """
        number, in_steps = len(cycles), self.problem.solver.method != "events"
        trial = RunState(self.problem, cycles)
        found = self._waiting or self._candidate(trial, budget)
        if found.moved is not None:
            self._judge(found, trial, budget)
        begin, cycle = self._played(trial, found.state, budget)
        ends = [begin, cycle.corners[-1]]
        walks = found.found is None
        if walks or in_steps:
            budget.played += 1
            ends += trial.trace_cycle(number).corners[-1:]
        watch = self._watch(ends, cycle)
        # one cycle does not tell a drift that stays from one that decays
        if watch.kind not in ((RATCHETTING,) if walks else (SHAKEDOWN, CYCLIC_SLIP)):
            raise NoLimit(
                f"the cycle that was found changes its forces by {watch.change[0]:.1e} and "
                f"displacements by {np.abs(cycle.slip).max():.1e}"
            )
        unique, why = YES, "no node drifts"
        if in_steps or walks:
            unique, why = NOT_EXAMINED, IN_STEPS if in_steps else IN_WALKS
        elif found.found is not None and found.moved is not None:
            nodes = found.found[0].shifted
            M = derivatives(*found.found, found.moved)
            unique, why = is_unique(M, local_stiffness(trial.model)[0][nodes])
        self.limit = Limit(
            reached=True,
            cycle=number,
            cycles_played=-1,
            newton_steps=found.steps,
            residual=max(watch.change[0], found.residual),
            unique=unique,
            reason=why,
            jumped=True,
        )
        change = np.append(np.array(trial.steady.change), watch.change[0])
        self.steady = Steady(True, number, watch.kind, watch.period, change)
        return cycle

    def _judge(self, found: Candidate, trial: RunState, budget: Budget) -> None:
        """Raise NoLimit unless the nodes come to a limit without slipping beyond it.

        A limit is kept until that is known. Load steps drift to a limit of their own: the exact
        path is followed from where they are.
        """
        assert found.found is not None
        frozen, solution = found.found
        least = OVERSHOT * frozen.force / local_stiffness(trial.model)[0]
        least += self.problem.solver.overshoot * np.abs(solution.shifts).max(initial=0.0)

        def come(ends: list[ContactState]) -> bool:
            lacking = found.lacking(ends[-4:])
            if np.any((lacking[-1] < -least)[frozen.shifted]):
                raise NoLimit("some node has slipped beyond the limit that was found")
            return has_settled(lacking, least)

        self._waiting, number = None, len(trial.cycles)
        if self.problem.solver.method == "events":
            if not come([cycle.corners[-1].state for cycle in trial.cycles[-4:]]):
                self._waiting, self._judged_again = found, number + max(1, number // MORE)
                raise NoLimit("whether nodes come to the limit that was found is not known yet")
            return
        path, ends = EventPath(trial.model), [trial.position.state]
        while len(ends) < 4 or not come(ends):
            budget.take()
            state = ends[-1]
            for leg in pairwise(frozen.loop):
                state = path.trace_leg(state, leg, frozen.force, 1).end
            ends.append(state)

    def _played(
        self, trial: RunState, state: ContactState, budget: Budget
    ) -> tuple[Instant, FinishedCycle]:
        """Play cycles from a state until one ends as it begins; return its start and itself.

        Load steps come to the cycle of their own, which is near that of the exact path.
        """
        problem, number, start = self.problem, len(trial.cycles), trial.position
        in_steps = problem.solver.method != "events"
        bound = (problem.solver.steady_tolerance or LIMIT_TOLERANCE) * start.totals.force_scale
        for _ in range(MAX_CHECKS):
            budget.played += 1
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

    def _candidate(self, trial: RunState, budget: Budget) -> Candidate:
        """Return a state whose cycle should repeat itself, first one of a body that walks."""
        start, before = trial.position, trial.cycles[-2].corners[-1].state
        model, loop, force = trial.model, self.problem.history.loop, start.totals.force_scale
        if may_walk(walking_motions(model), before, start.state):
            if self.problem.solver.method != "events":
                raise NoLimit("a body that may walk is played plainly in load steps")
            with suppress(NoLimit):
                return find_walk(model, start.state, loop, force, budget)
        exact = trial.solver
        if not isinstance(exact, EventPath) or self.problem.chooser is not None:
            exact = EventPath(model, on_jump=self.problem.solver.on_jump)
        # the trial's solver plays the cycle that is found, too: it will know most of its states
        corners = [trial.cycles[-2].corners[-1], *trial.cycles[-1].corners]
        states = np.array([corner.state.state for corner in corners])
        slips = np.ptp([corner.v for corner in corners], axis=0) > 0.0
        open_ = states == SEPARATION
        changing = np.any(states != states[0], axis=0) | (slips & ~open_.all(axis=0))
        exact.expect(loop, changing, open_.any(axis=0) & changing)
        return find_limit(model, exact, start.state, loop, force, budget)

    def tell(self, record: Record) -> None:
        """Add the limit to the record, and its steady state where the search has found it."""
        last = len(record.cycles.dissipation)
        if self.steady is not None:
            record.steady = self.steady
        elif record.steady.reached:
            each = "the cycles" if record.steady.period == 1 else "pairs of cycles"
            why = f"{each} repeated themselves as they were played"
            self.limit = Limit(True, last, last + self.searched, 0, float("nan"), -1, why)
        else:
            why = f"{self.limit.reason}; raise [history] cycles"
            self.limit = replace(self.limit, cycles_played=last + self.searched, reason=why)
        record.limit = self.limit

    def _watch(self, ends: list[Instant], cycle: FinishedCycle) -> SteadyWatch:
        """Return the watch that has seen the cycle and the next, or its changes once more.

        The ends are its start, its end, and that of the next where this was played.
        """
        problem, (begin, end) = self.problem, ends[:2]
        r, v, seen = begin.state.r, begin.v, [(i.state.r, i.v) for i in ends]
        if len(seen) == 2:
            gain = end.v - v
            gain[np.abs(gain) <= NO_GAIN * np.abs(end.state.u).max()] = 0.0
            seen = [(r + k * (end.state.r - r), v + k * gain) for k in range(3)]
        watch = new_watch(problem.system, problem.solver.steady_tolerance or LIMIT_TOLERANCE)
        for r, v in seen:
            watch.add(end_of(cycle)._replace(r=r, v=v))
        return watch
