"""Sweeps over grids of values, interrupted and gone on with, against runs of single scenes."""

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any
from unittest.mock import Mock

from mpi4py import MPI

import numpy as np
import pytest
import sweep_measures
from test_workers import wait_for_end_of

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.studies import runner
from receding_fenicsx.studies.sweep import grid_of, read_over

BLOCK = str(Path(__file__).parents[2] / "demos" / "block.toml")
SMALL = ["mesh.contact_elements=10", "history.cycles=2"]
SETTINGS = [word for change in SMALL for word in ("--set", change)]
NO_CYCLE: dict[str, Any] = {"cycle": None, "period": None}
OVER: dict[str, Any] = {"contact.friction": [0.2, 0.6], "history.minimum": [0.0, 0.25, 0.5]}
comm = MPI.COMM_WORLD
Run = Callable[..., Any]


def scene(*changes: str) -> rf.Scene:
    return rf.read_scene(BLOCK, [*SMALL, *changes])


def lines(folder: Path, name: str = "cases.jsonl") -> list[bytes]:
    return (folder / name).read_bytes().splitlines(keepends=True)


def test_the_command_fails_where_all_cases_do(
    shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for code, minima in ((0, "0.25,0.5"), (1, "0.5,0.45")):
        command = ["sweep", BLOCK, *SETTINGS, "--out", str(shared_tmp_path / f"out{code}")]
        # the minimum has to be below the maximum
        command += ["--over", "history.maximum=0.4,1", "--over", f"history.minimum={minima}"]
        command += ["--set", "solver.method=gauss-seidel", "--set", "solver.max_sweeps=1"] * code
        assert cli.main(command) == code
    if comm.rank == 0:
        assert "1 failed" in (printed := capsys.readouterr().out) and "4 failed" in printed


def test_rows_hold_the_numbers_of_single_runs() -> None:
    table = rf.sweep(scene(), OVER)
    for k, (f, minimum) in enumerate((f, m) for f in (0.2, 0.6) for m in (0.0, 0.25, 0.5)):
        record = rf.run(scene(f"contact.friction={f}", f"history.minimum={minimum}"))
        if table is None or record is None:
            continue
        row, summary = table.rows[k], rf.summarise(record)
        assert (row["contact.friction"], row["history.minimum"]) == (f, minimum)
        D = summary["dissipation_per_cycle"]
        assert (row["dissipation_cycle_1"], row["dissipation_last_cycle"]) == (D[0], D[-1])
        assert (D[0] == D[-1]) == (minimum == 0.0) and row["cycles"] == len(D)
        assert row["dissipation_first_loading"] == summary["dissipation_first_loading"]
        assert (row["steady"], row["events"]) == (summary["steady"]["kind"], summary["events"])
        for key in ("residual_max", "energy_error_max", "sweeps", "jumps"):
            assert row[key] == getattr(record, key)
        steady = record.steady if record.steady.reached else replace(record.steady, **NO_CYCLE)
        assert (row["steady_cycle"], row["steady_period"]) == (steady.cycle, steady.period)
        low, high = summary["turning_points"][-2:]
        for key in ("contact_half_width", "stick_half_width", "p_max"):
            assert row[f"{key}_at_minimum"] == low[key]
            assert row[f"{key}_at_maximum"] == high[key]
        q = np.abs(record.turning_points.q[-2:]).max(axis=1)
        assert [row[f"q_abs_max_at_{load}"] for load in ("minimum", "maximum")] == q.tolist()
        assert row["error"] == ""
    if table is not None:
        assert len(table.rows) == 6 and table.failed == ()
        assert table.grid("steady").shape == (2, 3)
        # less friction, more slip; the same for a larger range of the load
        assert np.all(np.diff(table.grid("dissipation_last_cycle"), axis=1) < 0.0)


@pytest.mark.one_rank
def test_a_table_has_gaps_where_a_case_has_no_number_and_shows_twenty_rows() -> None:
    rows = {"a": 1.0, "b": True, "c": "x", "d": 0.5, "error": ""}, {"a": 2.0, "error": "no"}
    table = rf.SweepTable(("a",), ((1.0, 2.0),), rows)
    known = {"a": [1.0, 2.0], "b": [True, None], "c": ["x", None], "error": ["", "no"]}
    assert {name: table[name].tolist() for name in known} == known
    assert np.array_equal(table["d"], [0.5, np.nan], equal_nan=True)
    words = "a b c d error", "1 True x 0.5", "2 - - - no", "2 cases, 1 failed"
    assert [" ".join(line.split()) for line in repr(table).splitlines()] == [*words]
    names = "d", "residual_max", "steady"  # the last two are among the most important
    for n in (20, 21):
        many = tuple(dict.fromkeys(names, 0.5) | {"a": k, "error": ""} for k in range(n))
        head, *shown = repr(rf.SweepTable(("a",), (tuple(range(n)),), many)).splitlines()
        assert head.split() == ["a", "steady", "residual_max"] and len(shown) == n + 1
        assert (shown[-2] == "... 1 more rows") == (n > 20)


def test_a_case_that_fails_is_a_row_with_its_reason(shared_tmp_path: Path) -> None:
    over = {
        "solver.max_sweeps": [1, 20000],
        "history.maximum": [0.4, 1.0],
        "history.minimum": [0.25, 0.5],
    }
    changed = scene("solver.method=gauss-seidel", "solver.polish=false", "solver.steps_per_leg=4")
    for _ in range(2):  # failures are kept as results are
        options = rf.StudyOptions(resume=True)
        table = rf.sweep(changed, over, shared_tmp_path / "out", options=options)
        if table is None:
            continue
        errors = table.grid("error")
        assert all("minimum: 0.5 is not below maximum, 0.4" in text for text in errors[:, 0, 1])
        assert all("residual" in text for text in (*errors[0, 0, :1], *errors[0, 1]))
        assert errors[1, 0, 0] == "" and set(errors[1, 1]) == {""}
        D = table["dissipation_last_cycle"]
        assert np.array_equal(np.isfinite(D), table["error"] == "")
        assert np.array_equal([kind is None for kind in table["steady"]], table["error"] != "")
        assert repr(table).endswith("8 cases, 5 failed") and " error" in repr(table)
        assert len(lines(shared_tmp_path / "out")) == 6  # two cases had no scene


KILLED = (Path(__file__).parents[1] / "programs" / "killed_sweep.txt").read_text()


def test_a_sweep_killed_twice_has_the_table_of_an_undisturbed_one(
    tmp_path: Path, mpirun: Run
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    undisturbed = rf.sweep(scene(), OVER, whole)
    program = tmp_path / "killed.py"
    program.write_text(KILLED.format(block=BLOCK, small=SMALL, over=OVER))
    # two processes of this machine, then two ranks; the parent kills itself by SIGKILL
    command = [sys.executable, str(program), str(out), "2", "2"]
    environment = {**rf.child_environment(), "SWEEP_MARK": str(tmp_path)}
    killed = subprocess.run(command, env=environment, check=False)
    assert killed.returncode == -signal.SIGKILL
    wait_for_end_of(f"SWEEP_MARK={tmp_path}")  # the new processes end with their parent
    assert len(lines(out)) == 2
    for path in (out / "systems").glob("*.h5"):  # as by a full disk
        path.write_bytes(path.read_bytes()[:5000])
    assert mpirun(2, program, out, 2, 0).returncode != 0
    assert len(lines(out)) == 4
    assert not (out / "sweep.csv").exists()
    said: list[str] = []
    options = rf.StudyOptions(resume=True, progress=said.append)
    table = rf.sweep(scene(), OVER, out, options=options)
    assert len(said) == 2 and said[0].startswith("sweep: case 5 of 6, 0 failed")
    assert table == undisturbed
    assert (out / "sweep.csv").read_bytes() == (whole / "sweep.csv").read_bytes()
    assert sorted(lines(out)) == sorted(lines(whole))
    assert sorted(os.listdir(out)) == ["cases.jsonl", "sweep.csv", "sweep.json"]


@pytest.mark.one_rank
def test_shares_played_apart_at_the_same_time_and_killed_make_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, undisturbed = tmp_path / "out", rf.sweep(scene(), OVER)

    def share(number: int, progress: Any = None) -> rf.SweepTable:
        options = rf.StudyOptions(shard=(number, 3), progress=progress)
        return rf.given(rf.sweep(scene(), OVER, out, options=options))

    def another(_: str) -> None:
        tables.append(share(3))  # while the second one is being played

    def interrupt(_: str) -> None:
        with pytest.raises(rf.InputError, match="another run is using"):
            share(1)
        raise KeyboardInterrupt

    tables: list[rf.SweepTable] = []
    with pytest.raises(rf.Interrupted):
        share(1, interrupt)
    tables.append(share(2, lambda text: another(text) if len(tables) == 0 else None))
    assert all(sum("not finished" in e for e in table["error"]) > 0 for table in tables)
    assert not (out / "sweep.csv").exists() and len(lines(out, "cases.1-of-3.jsonl")) == 1
    assert share(1) == undisturbed
    assert sum(len(lines(out, f"cases.{k}-of-3.jsonl")) for k in (1, 2, 3)) == 6
    # without shares it goes on with what all of them have finished, though a later one failed in it
    later = runner.CaseFile(out, "cases.9.jsonl")
    died = runner.Outcome({}, "its process died", final=False)
    for identity in (*(known := later.read()), "new"):
        later.add(runner.Case(identity), died)
    assert later.read() == known | {"new": died} and later.read(final=True) == known
    monkeypatch.setattr(runner, "play", lambda *_: pytest.fail("played again"))
    again = rf.StudyOptions(resume=True)
    assert rf.sweep(scene(), OVER, out, options=again) == undisturbed
    # keys may come in another order
    turned = rf.given(rf.sweep(scene(), dict(reversed(OVER.items())), out, options=again))
    assert np.array_equal(turned.grid("events").T, rf.given(undisturbed).grid("events"))


def test_damaged_lines_are_played_again(shared_tmp_path: Path) -> None:
    out = shared_tmp_path / "out"
    rf.sweep(scene(), OVER, out)
    comm.Barrier()
    whole, kept = (out / "sweep.csv").read_bytes(), lines(out)
    comm.Barrier()
    if comm.rank == 0:
        flipped = bytearray(kept[1])
        flipped[200] ^= 1
        (out / "cases.jsonl").write_bytes(kept[0] + bytes(flipped) + kept[2] + kept[3][:100])
    comm.Barrier()
    said: list[str] = []
    rf.sweep(scene(), OVER, out, options=rf.StudyOptions(resume=True, progress=said.append))
    if comm.rank == 0:
        assert len(said) == 4
        assert (out / "sweep.csv").read_bytes() == whole
        assert set(lines(out)) - {bytes(flipped)} == set(kept)


def test_a_sweep_goes_on_with_more_values_but_nothing_else(shared_tmp_path: Path) -> None:
    out, resume = shared_tmp_path / "out", rf.StudyOptions(resume=True)
    over = {"contact.friction": [0.2]}
    rf.sweep(scene(), over, out)
    for other, keys, measure, word in (
        (scene("material.poisson=0.2"), over, None, r"\[material\] poisson"),
        (scene(), {"history.minimum": [0.2]}, None, "key: it has contact.friction"),
        (scene(), over, sweep_measures.half, "function measure"),
    ):
        with pytest.raises(rf.InputError, match=f"is a sweep with another.*{word}"):
            rf.sweep(other, keys, out, measure=measure, options=resume)
    said: list[str] = []
    more = {"contact.friction": [0.4, 0.2]}

    def say(text: str) -> None:  # an old table is gone while cases are missing
        said.extend([text] * (not (out / "sweep.csv").exists()))

    table = rf.sweep(scene(), more, out, options=replace(resume, progress=say))
    if table is not None:
        assert len(said) == 1 and table["contact.friction"].tolist() == [0.4, 0.2]
    # a title says nothing of the cases
    rf.sweep(scene("title=x"), over, out, options=replace(resume, progress=said.append))
    assert len(said) == (comm.rank == 0)
    rf.sweep(scene(), over, out, options=rf.StudyOptions(overwrite=True))
    comm.Barrier()
    assert len(lines(out)) == 1
    file = out / "sweep.json"
    known = file.read_text().replace('"digest": "', '"digest": "0')
    comm.Barrier()
    rf.on_root(comm, lambda: file.write_text(known))
    with pytest.raises(rf.InputError, match="is a sweep with another mesh file"):
        rf.sweep(scene(), over, out, options=resume)


def test_a_sweep_goes_on_only_with_the_values_of_its_function(shared_tmp_path: Path) -> None:
    def bound(factor: float) -> list[Callable[..., Any]]:
        def inner(record: rf.Record) -> dict[str, Any]:
            return {"half": factor * record.turning_points.P[-1].max()}

        return [partial(sweep_measures.times, factor=factor), sweep_measures.Times(factor), inner]

    for k in range(2 if comm.size > 1 else 3):
        first, other, same = (bound(factor)[k] for factor in (1.0, 2.0, 1.0))
        out, resume = shared_tmp_path / f"out{k}", rf.StudyOptions(resume=True)
        rf.sweep(scene(), {"contact.friction": [0.2]}, out, measure=first)
        with pytest.raises(rf.InputError, match="another function measure"):
            rf.sweep(scene(), {"contact.friction": [0.2]}, out, measure=other, options=resume)
        rf.sweep(scene(), {"contact.friction": [0.2]}, out, measure=same, options=resume)


def test_the_table_may_hold_numbers_of_the_users_own(shared_tmp_path: Path) -> None:
    slips = {"none": 0.0, "wave": {"x": [-2.0, 0.0, 2.0], "value": [0.0, 0.1, 0.0]}}
    over = {"history.initial_slip": slips, "load.p0.pressure": np.array([1.0, 2.0])}
    worn = scene("wear.coefficient=1e-3")  # what is not measured is not computed
    table = rf.sweep(worn, over, shared_tmp_path / "out", measure=sweep_measures.half)
    if table is None:
        return
    assert table.columns == ("history.initial_slip", "load.p0.pressure", "half", "name", "error")
    assert table["history.initial_slip"].tolist() == ["none", "none", "wave", "wave"]
    # forces are proportional to the load, except where slip was there before
    half = table.grid("half")
    assert half[0, 1] == pytest.approx(2.0 * half[0, 0], rel=1e-12)
    assert half[1, 1] != pytest.approx(2.0 * half[1, 0], rel=1e-3)
    table.write_csv(own := shared_tmp_path / "own.csv")
    assert own.read_bytes() == (shared_tmp_path / "out" / "sweep.csv").read_bytes()
    with open(own, newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["half"]) for row in rows] == [*table["half"]] == [*table.to_pandas()["half"]]
    assert repr(table).split()[:4] == [*table.columns[:4]]


def test_files_among_values_are_beside_the_scene_and_named_in_the_table(
    shared_tmp_path: Path,
) -> None:
    rf.on_root(comm, lambda: (shared_tmp_path / "gap.csv").write_text("-2, 0.5\n2, 0.25\n"))
    gap = {"file": "gap.csv"}
    over = {"contact.initial_gap": [gap]}
    options = rf.StudyOptions(folder=shared_tmp_path)
    table = rf.sweep(scene("history.cycles=1"), over, options=options)
    if table is not None:
        assert table["contact.initial_gap"].tolist() == ["gap.csv"]
    line = {"x": [-2, 2], "value": [0, 1]}
    for given, label in (({"mine": gap}, "mine"), (["x**2"], "x**2"), ([line], json.dumps(line))):
        assert grid_of(scene(), {"contact.initial_gap": given}, shared_tmp_path).labels == (
            (label,),
        )


def test_probes_may_move_from_case_to_case() -> None:
    text = Path(BLOCK).read_text(encoding="utf-8") + '[[probe]]\nname = "a"\npoint = [0, 0.5]\n'
    places = [[0.0, 0.5], [0.25, 0.5]]
    over = {"contact.friction": [0.2, 0.4], "probe.a.point": places}
    table = rf.sweep(rf.from_toml(text, SMALL), over, measure=sweep_measures.syy)
    for k, (f, (x, y)) in enumerate((f, place) for f in (0.2, 0.4) for place in places):
        changes = [*SMALL, f"contact.friction={f}", f"probe.a.point=[{x}, {y}]"]
        record = rf.run(rf.from_toml(text, changes))
        if table is not None and record is not None:
            assert table["syy"][k] == sweep_measures.syy(record)["syy"]


@pytest.mark.one_rank
def test_a_case_whose_process_dies_or_has_no_memory_is_a_row_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, over = tmp_path / "out", {"contact.friction": [0.2, 0.3, 0.4, 0.5]}

    def measure(record: rf.Record) -> dict[str, Any]:  # of no module, for a process of this machine
        if record.f[0] == 0.5:
            raise MemoryError
        return sweep_measures.dies_at_three_tenths(record)

    assert not runner.play(runner.Case(""), lambda: {"f": 1 / 0}).final
    with pytest.raises(rf.InputError, match=r"measure: cannot be sent .* \(.*lock.*\); make it"):
        rf.sweep(scene(), over, workers=1, measure=Lock().acquire)  # type: ignore[arg-type]
    submit = Mock(wraps=runner.workers.submit)
    monkeypatch.setattr(runner.workers, "submit", submit)
    table = rf.sweep(scene(), over, out, workers=1, measure=measure)
    assert table is not None
    assert {call.kwargs["count"] for call in submit.call_args_list} == {1}
    bad, full = table.failed
    assert bad["contact.friction"] == 0.3 and "process was ended" in bad["error"]
    assert full["contact.friction"] == 0.5 and full["error"].startswith("MemoryError")
    assert table["f"].tolist()[:3:2] == [0.2, 0.4] and np.isnan(table["f"][1::2]).all()
    monkeypatch.setattr(runner, "play", lambda *_: runner.Outcome({"f": 7.0}))
    again = rf.sweep(scene(), over, out, measure=measure, options=rf.StudyOptions(resume=True))
    assert again is not None and again["f"].tolist() == [0.2, 7.0, 0.4, 7.0]


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("texts", "values"),
    [
        (["a.b=1,2.5,true"], [1, 2.5, True]),
        (["a.b=0.1:0.3:3"], [0.1, 0.2, 0.3]),
        (["a.b=0:1:3,1.0:3:3"], [0.0, 0.5, 1.0, 1.0, 2.0, 3.0]),
        (["a.b=10:30:3, 99"], [10, 20, 30, 99]),  # alone TOML would read a time of day
        (["a.b=[-1.0, 1.0],[0.0, 2.0]"], [[-1.0, 1.0], [0.0, 2.0]]),
        (['a.b={file = "gap.csv"}, "0.1*max(x, 0)"'], [{"file": "gap.csv"}, "0.1*max(x, 0)"]),
    ],
)
def test_values_of_the_command_line(texts: list[str], values: list[Any]) -> None:
    (found,) = read_over(texts).values()
    assert found == pytest.approx(values) if isinstance(values[0], float) else found == values
    assert list(map(type, found)) == list(map(type, values))


def test_measures_that_are_no_numbers_are_rows_with_the_reason() -> None:
    error = partial(sweep_measures.wrong, found={"error": 0.0})
    for measure, reason in (
        (error, "measure: 'error' cannot be the name of a column; choose another"),
        (sweep_measures.wrong, "ZeroDivisionError: division by zero"),
    ):
        table = rf.sweep(scene("history.cycles=1"), {"contact.friction": [0.2]}, measure=measure)
        if table is not None:
            assert reason == table.rows[0]["error"]


def test_the_command_prints_a_short_table_and_says_where_the_rest_is(
    shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shared_tmp_path / "out"
    command = ["sweep", BLOCK, *SETTINGS, "--out", str(out)]
    command += ["--over", "contact.friction=0.1:0.5:5", "--over", "history.minimum=0:0.5:5"]
    assert cli.main(command) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    if comm.rank == 0:
        shown = captured.out.splitlines()
        assert len(shown) <= 30
        assert shown[-3:] == ["... 5 more rows", "25 cases", f"written to {out / 'sweep.csv'}"]
        assert json.loads((out / "sweep.json").read_text())["over"]["history.minimum"][1] == 0.125
