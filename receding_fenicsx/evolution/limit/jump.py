"""Jump from the cycles played so far to the cycle that repeats itself, and check that it does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.cycle_data import LIMIT_TOLERANCE, FinishedCycle
from receding_fenicsx.evolution.instants import Instant, instant
from receding_fenicsx.evolution.limit.frozen import NoLimit
from receding_fenicsx.evolution.limit.search import find_limit
from receding_fenicsx.evolution.limit.uniqueness import is_unique
from receding_fenicsx.evolution.problem import Problem
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Limit, Steady
from receding_fenicsx.evolution.run_state import Position, RunState
from receding_fenicsx.interface.measures.steady import CYCLIC_SLIP, SHAKEDOWN, SteadyWatch
from receding_fenicsx.interface.system import typical_stiffness

Progress = Callable[[int, int, str], None]
"""Called as progress(cycle, cycles, message) after every cycle."""

FIRST_SEARCH = 3
"""Cycle after which the limit is searched for first; then after twice as many, and so on."""

MAX_CHECKS = 3
"""Cycles played from the one that was found until the states at start and end are the same."""


class LimitSearch:
    """Searches for the limit between the cycles of a history.

    What it does follows from the cycle's number and the cycles before alone, so that a resumed run
    repeats it.

    Attributes:
        limit: what has been found so far.
        steady: the steady state that was found, None before.
    """

    def __init__(self, problem: Problem) -> None:
        """Start with nothing found."""
        self.problem = problem
        self.limit = Limit(False, -1, 0, 0, np.nan, -1, "the search has not begun")
        self.steady: Steady | None = None
        self._last = 0

    def is_due(self, number: int) -> bool:
        """Return whether the limit is searched for before a cycle is played."""
        doublings, rest = divmod(number - 1, FIRST_SEARCH)
        return number > 1 and rest == 0 and doublings.bit_count() == 1

    def found(self, cycles: list[FinishedCycle], progress: Progress | None) -> bool:
        """Search for the cycle that repeats itself; add it to the finished ones if it was found."""
        self._last = len(cycles)
        try:
            cycle = self._cycle(cycles)
        except (NoLimit, SolveError) as error:
            self.limit = replace(self.limit, reason=str(error))
            return False
        cycles.append(cycle)
        if progress is not None:
            progress(len(cycles) - 1, self.problem.history.cycles, in_words(self.limit))
        return True

    def _cycle(self, cycles: list[FinishedCycle]) -> FinishedCycle:
        """Return the cycle that repeats itself, played and checked.

        Raises:
            NoLimit: none was found.
            SolveError: its path ends early.
        """
        problem, number = self.problem, len(cycles)
        if problem.solver.method != "events":
            raise NoLimit('the search needs [solver] method = "events"')
        if problem.chooser is not None:
            raise NoLimit('the search needs [solver] branch = "first"')
        trial = RunState(problem, cycles)
        start, loop = trial.position, problem.history.loop
        force, budget = start.totals.force_scale, problem.history.cycles - number
        found = find_limit(trial.model, trial.solver, start.state, loop, force, budget)
        state = found.state
        for played in range(1, MAX_CHECKS + 1):
            trial.position = Position(state, start.load, start.totals)
            begin = instant(problem.system, (number, 0, 0.0), start.load, state)
            cycle = trial.trace_cycle(number, problem.output.cycles is None)
            end = trial.position.state
            if np.array_equal(state.state, end.state):
                break
            # a node that just reaches its limit at the end begins the next cycle in slip
            state = end
        else:
            raise NoLimit("the cycle that was found does not end in the states it begins in")
        watch = self._watch(begin, cycles, cycle)
        # one cycle does not tell a drift that stays from one that decays
        if watch.kind not in (SHAKEDOWN, CYCLIC_SLIP):
            raise NoLimit(
                f"the cycle that was found changes its forces by {watch.change[0]:.1e} and "
                f"displacements by {np.abs(cycle.slip).max():.1e}"
            )
        unique, why = is_unique(found)
        self.limit = Limit(
            reached=True,
            cycle=number,
            cycles_played=number - 1 + found.cycles + played,
            newton_steps=found.steps,
            residual=max(watch.change[0], found.residual),
            unique=unique,
            reason=why,
            jumped=True,
        )
        change = np.append(np.array(trial.steady.change), watch.change[0])
        self.steady = Steady(True, number, watch.kind, watch.period, change)
        return cycle

    def tell(self, record: Record, cycles: list[FinishedCycle]) -> None:
        """Add the limit to the record, and its steady state where the search has found it."""
        last = len(record.cycles.dissipation)
        if self.steady is not None:
            record.steady = self.steady
        elif record.steady.reached:
            why = "the cycles repeated themselves as they were played"
            self.limit = Limit(True, last, last, 0, float("nan"), -1, why)
        else:
            self._repeat_last(cycles)
            why = f"{self.limit.reason}; raise [history] cycles"
            self.limit = replace(self.limit, cycles_played=last, reason=why)
        record.limit = self.limit

    def _repeat_last(self, cycles: list[FinishedCycle]) -> None:
        """Repeat the last search where it was made before the run was resumed: for its reason."""
        last = max((n for n in range(len(cycles)) if self.is_due(n)), default=0)
        if last > self._last:
            before = self.limit
            if self.found(cycles[:last], None):  # a history that began without a search
                self.limit, self.steady = before, None

    def _watch(
        self, begin: Instant, cycles: list[FinishedCycle], cycle: FinishedCycle
    ) -> SteadyWatch:
        """Return the watch that has seen the cycle, and its changes once more."""
        problem, end = self.problem, cycle.corners[-1]
        r, v = begin.state.r, begin.v
        watch = SteadyWatch(
            problem.solver.steady_tolerance or LIMIT_TOLERANCE, typical_stiffness(problem.system)
        )
        watch.start(r, v)
        D, first = float(cycle.dissipation.sum()), float(cycles[1].dissipation.sum())
        for k in (1.0, 2.0):
            again = r + k * (end.state.r - r), v + k * (end.v - v)
            watch.add(*again, cycle.slip_range, D, first, cycle.totals.force_scale)
        return watch


def in_words(limit: Limit) -> str:
    """Return what was found, for the progress."""
    return f"limit found by {limit.newton_steps} Newton steps, residual {limit.residual:.1e}"
