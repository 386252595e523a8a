"""Limit of infinitely many cycles against plain playing, closed forms and bad input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import block_system
from problems import limited, play, problem
from replay import replay
from small import cyclic, small_system, table

from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import continue_history, evolve
from receding_fenicsx.evolution.journal import Journal, JournalFile
from receding_fenicsx.evolution.limit import search, tail
from receding_fenicsx.evolution.problem import problem_of_history
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.replay import state_at
from receding_fenicsx.output.report.cycles import limit_rows
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.scene.history import ended_by, history_from_scene
from receding_fenicsx.scene.model import HistoryOptions, Load, Scene, SolverOptions
from receding_fenicsx.store.hdf5 import read_record, write_record

pytestmark = pytest.mark.one_rank

BLOCK = block_system(40, 20)


@pytest.fixture(scope="module")
def limit() -> Record:
    return evolve(BLOCK, cyclic(200), until="limit")


def test_the_limit_is_that_of_many_plain_cycles(limit: Record) -> None:
    plain = evolve(BLOCK, cyclic(400))
    assert limit.limit is not None and limit.limit.reached and limit.limit.jumped
    assert limit.limit.cycles_played <= 40 and limit.limit.unique == 1
    D, last = limit.cycles.dissipation, plain.cycles.dissipation
    assert abs(D[-1] / last[-1] - 1.0) < 1e-8
    v, w = limit.turning_points.v[-1], plain.turning_points.v[-1]
    assert np.abs(v - w).max() < 1e-7 * np.abs(w).max()
    # the cycles before the jump are those of the history
    assert np.array_equal(D[:2], last[:2])
    assert np.array_equal(limit.turning_points.v[:5], plain.turning_points.v[:5])
    assert limit.steady.reached and limit.steady.kind == plain.steady.kind == "cyclic slip"


def test_an_instant_of_the_limit_cycle_is_replayed_from_its_own_end(limit: Record) -> None:
    n, samples = len(limit.cycles.dissipation), limit.samples
    row = int(np.flatnonzero((samples.cycle == n) & (samples.leg == 0))[20])
    at = state_at(limit, BLOCK, cyclic(200), SolverOptions(), (n, 0, float(samples.s[row])))
    half = samples.v.shape[1] - BLOCK.n
    assert np.abs(at.v - samples.v[row, half:]).max() < 1e-10 * np.abs(at.v).max()


def test_record_and_summary_hold_the_limit(limit: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "record.h5", limit)
    assert read_record(tmp_path / "record.h5").limit == limit.limit
    summary = summarise(limit)
    D = limit.cycles.dissipation
    assert summary["limit"]["dissipation_ratio"] == D[-1] / D[0]
    assert summary["limit"]["reached"] is True and summary["limit"]["unique"] is True
    assert "found by" in limit_rows(summary)[0][1]
    assert "limit" not in summarise(evolve(BLOCK, cyclic(2)))


def test_one_spring_has_its_limit_in_closed_form() -> None:
    # spring 2 pressed by 1 and pulled between -0.5 and 0.5, f = 0.3: D = 4 f (pull - f) / 2
    system = small_system([[2.0, 0.0], [0.0, 1.0]], {"press": [0, 1], "pull": [-1, 0]}, 0.3)
    history = table(system, [[0, 0], [1, 0], [1, 0.5]], [[1, 0.5], [1, -0.5], [1, 0.5]], 50)
    record = evolve(system, history, until="limit")
    assert record.limit is not None and record.limit.reached
    assert np.isclose(record.cycles.dissipation[-1], 4 * 0.3 * 0.2 / 2, rtol=1e-12)


def test_a_search_that_fails_goes_on_playing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tail, "MAX_CYCLES", 2)
    monkeypatch.setattr(search, "MAX_PLAYED", 2)
    small = block_system(12, 6)
    record, plain = evolve(small, cyclic(8), until="limit"), evolve(small, cyclic(8))
    assert record.limit is not None and not record.limit.reached
    assert "a search plays 2 cycles at most" in record.limit.reason
    assert "raise [history] cycles" in record.limit.reason
    # each of the searches after cycles 2, 3, 4 and 6 plays one, the last one two
    assert record.limit.cycles_played == 8 + 4 + 2
    assert np.array_equal(record.cycles.dissipation, plain.cycles.dissipation)
    assert "not reached" in limit_rows(summarise(record))[0][1]


def test_load_steps_from_the_exact_limit_repeat_themselves() -> None:
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
    assert record.residual_max < 1e-9


def test_bad_input_is_refused_in_one_line() -> None:
    scene = Scene(loads=(Load("p0", "top", pressure=1.0),))
    for options, words in (
        (HistoryOptions(kind="monotonic", until="limit"), "needs cycles"),
        (HistoryOptions(cycles=4, until="limit"), "raise cycles"),
        (HistoryOptions(until="lmit"), 'use "steady", "limit"'),
    ):
        with pytest.raises(InputError, match=words) as caught:
            history_from_scene(replace(scene, history=options))
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="below the round-off"):
        evolve(BLOCK, cyclic(50), SolverOptions(steady_tolerance=1e-15), until="limit")
    with pytest.raises(InputError, match="needs cycles"):
        evolve(BLOCK, replace(cyclic(50), loop=np.zeros((0, 1))), until="limit")


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


def test_an_interrupted_history_resumes_to_the_same_limit(tmp_path: Path) -> None:
    problem_ = problem_of_history(BLOCK, ended_by(cyclic(200), "limit"))
    whole = continue_history(problem_, Journal(1))

    def stop(cycle: int, *_: object) -> None:
        if cycle == 2:
            raise KeyboardInterrupt

    journal = JournalFile(tmp_path / "journal.bin", BLOCK, 1)
    with pytest.raises(KeyboardInterrupt):
        continue_history(problem_, journal, stop)
    journal.write()
    journal.close()
    again = JournalFile(tmp_path / "journal.bin", BLOCK, 1)
    assert len(again.cycles) == 3
    resumed = continue_history(problem_, again)
    again.close()
    for key in ("v", "w", "P", "Q", "state"):
        a, b = (getattr(r.turning_points, key) for r in (resumed, whole))
        assert np.array_equal(a, b), key
    assert resumed.limit == whole.limit


def test_a_resumed_history_says_the_same_of_searches_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tail, "MAX_CYCLES", 2)
    monkeypatch.setattr(search, "MAX_PLAYED", 2)
    problem_ = problem_of_history(block_system(12, 6), ended_by(cyclic(8), "limit"))
    journal = Journal(1)
    whole = continue_history(problem_, journal).limit
    assert whole is not None and not whole.reached
    for finished in (3, 6, 9):
        again = Journal(1)
        again.cycles = journal.cycles[:finished]
        resumed = continue_history(problem_, again).limit
        assert resumed is not None
        assert resumed.reason == whole.reason and resumed.cycles_played == whole.cycles_played
