"""Limit of infinitely many cycles against plain playing, closed forms and bad input."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from models import block_system
from problems import limited, play, problem
from replay import replay
from small import cyclic

from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.limit import search, tail
from receding_fenicsx.output.report.run import limit_rows
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


def test_the_limit_is_that_of_many_plain_cycles() -> None:
    block, told = block_system(40, 20), list[tuple[int, int, str]]()
    limit = evolve(block, cyclic(200), until="limit", progress=lambda *step: told.append(step))
    plain = evolve(block, cyclic(400))
    assert limit.limit is not None and limit.limit.reached and limit.limit.jumped
    D, last = limit.cycles.dissipation, plain.cycles.dissipation
    assert told[-1] == (len(D), 200, "limit found")
    assert len(limit.steady.change) == len(D) and limit.steady.change[-1] == limit.limit.residual
    # its cycle is sampled as the last one is, unless others are asked for
    assert {0, 1, 2, len(D)} <= set(limit.samples.cycle.tolist())
    first = evolve(block, cyclic(200), None, OutputOptions(cycles=(1,)), until="limit")
    assert set(first.samples.cycle.tolist()) == {1} and len(first.cycles.dissipation) == len(D)
    # those of the history before the jump, and at least one of a search
    assert len(D) <= limit.limit.cycles_played <= 40 and limit.limit.unique == 1
    assert abs(D[-1] / last[-1] - 1.0) < 1e-8
    v, w = limit.turning_points.v[-1], plain.turning_points.v[-1]
    assert np.abs(v - w).max() < 1e-7 * np.abs(w).max()
    # the cycles before the jump are those of the history
    assert np.array_equal(D[:2], last[:2])
    assert np.array_equal(limit.turning_points.v[:5], plain.turning_points.v[:5])
    assert limit.steady.reached and limit.steady.kind == plain.steady.kind == "cyclic slip"


def test_a_search_that_fails_goes_on_playing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tail, "MAX_CYCLES", 2)
    monkeypatch.setattr(search, "MAX_PLAYED", 2)
    small, told = block_system(12, 6), list[tuple[int, int, str]]()
    record = evolve(small, cyclic(8), until="limit", progress=lambda *step: told.append(step))
    plain = evolve(small, cyclic(8))
    assert record.limit is not None and not record.limit.reached
    assert "a search plays 2 cycles at most" in record.limit.reason
    assert "raise [history] cycles" in record.limit.reason
    # each of the searches after cycles 2, 3, 4 and 6 plays one, the last one two
    assert record.limit.cycles_played == 8 + 4 + 2
    # the last one goes on with the history by a cycle before it gives up
    assert [step[:2] for step in told if "search" in step[2]] == [(7, 8)]
    assert np.array_equal(record.cycles.dissipation, plain.cycles.dissipation)
    assert "not reached" in limit_rows(summarise(record))[0][1]


def test_load_steps_from_the_exact_limit_repeat_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    small = block_system(16, 8)
    steps = SolverOptions(method="gauss-seidel", steps_per_leg=10)
    record = evolve(small, cyclic(200), steps, until="limit")
    plain = evolve(small, cyclic(200), replace(steps, steady_tolerance=1e-10), until="steady")
    exact = evolve(small, cyclic(200), until="limit")
    assert record.limit is not None and record.limit.reached and record.limit.jumped
    assert record.limit.cycles_played < 20 < plain.steady.cycle
    assert record.limit.residual < 1e-10 and "load steps" in record.limit.reason
    assert record.steady.kind == plain.steady.kind == "cyclic slip"
    D, own, path = (r.cycles.dissipation[-1] for r in (record, plain, exact))
    # nearer to the cycle that plain steps come to than steps are to the exact path
    assert abs(D - own) < 0.2 * abs(own - path) and abs(own - path) < 0.05 * path
    # the cycle does not drift, under the laws at every step
    assert np.abs(record.cycles.slip_increment[-1]).max() < 1e-10
    assert record.residual_max < 1e-9 and record.limit.unique == -1
    # the next cycle is played too: where it is another one, that is no limit
    played = search.LimitSearch._played

    def drifting(self: search.LimitSearch, trial: Any, tail: Any) -> Any:
        begin, cycle = played(self, trial, tail)
        end = cycle.corners[-1]
        away = end._replace(state=replace(end.state, r=2.0 * end.state.r))
        monkeypatch.setattr(trial, "trace_cycle", lambda number: SimpleNamespace(corners=[away]))
        return begin, cycle

    monkeypatch.setattr(search.LimitSearch, "_played", drifting)
    lost = evolve(small, cyclic(8), steps, until="limit").limit
    assert lost is not None and not lost.reached and "changes its forces" in lost.reason


def test_no_limit_of_random_problems_breaks_a_law(monkeypatch: pytest.MonkeyPatch) -> None:
    # small problems repeat themselves soon: the search begins at once, before they do
    monkeypatch.setattr(search, "FIRST_SEARCH", 1)
    found = 0
    # in the last a node that only reaches its limit at the end begins the cycle in slip
    for number in (*range(25), 760223):
        p = limited(problem(number))
        try:
            record = play(p)
        except (SolveError, InputError):
            continue
        jumped = record.limit is not None and record.limit.jumped
        found += jumped
        assert replay(p.system, p.history, record).found == [], number
    assert found > 5 and jumped


def test_a_node_that_would_slip_back_has_no_limit_by_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # this history and the search from its first cycle lead to different steady cycles
    monkeypatch.setattr(search, "FIRST_SEARCH", 1)
    p = limited(problem(213))
    record, plain = play(p), evolve(p.system, replace(p.history, until_limit=False), p.solver)
    assert record.limit is not None and record.limit.reached
    assert np.isclose(record.cycles.dissipation[-1], plain.cycles.dissipation[-1], rtol=1e-9)
    # one whose first search has failed, by a cycle more, before it repeats itself
    other = play(limited(problem(79))).limit
    assert other is not None and (other.cycle, other.cycles_played, other.unique) == (2, 3, -1)
    assert "the cycles repeated themselves as they were played" in other.reason
