"""Limits of a run from many initial slips: command, summary, report, bad input."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.studies.starts import SteadyStates, _states, starts_summary

SCENE = rf.to_toml(block(elements=8, history=rf.HistoryOptions(cycles=200, until="limit")))
COMM = MPI.COMM_WORLD


@pytest.fixture
def scene(shared_tmp_path: Path) -> Path:
    file = shared_tmp_path / "scene.toml"
    rf.on_root(COMM, lambda: file.write_text(SCENE))
    return file


def test_a_run_reports_the_limits_from_many_starts_in_this_process_or_others(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = scene.parent / "out"
    run = ["run", str(scene), "--out", str(out), "--starts=6", "--pictures=none"]
    assert cli.main(run) == 0
    limit = json.loads((out / "summary.json").read_text())["limit"]
    starts, record = limit["starts"], rf.read_record(out / "record.h5")
    assert starts["count"] == 6 == sum(starts["kinds"].values())
    assert sum(zones["starts"] for zones in starts["zones"]) == 6
    assert len((out / "cases.jsonl").read_text().splitlines()) == 6  # for a run that goes on
    # rest is among the starts, so that the run's own limit lies between
    low, high = starts["dissipation"]
    assert low <= record.cycles.dissipation[-1] * (1 + 1e-9) and limit["dissipation"] <= high
    assert starts["spread"] == pytest.approx(1.0 - low / high)
    # rank 0 prints
    assert ("limits from 6 initial slips" in capsys.readouterr().out) == (COMM.rank == 0)
    assert "limits from 6 initial slips" in (out / "report.html").read_text()
    if COMM.size == 1:
        assert cli.main([*run, "--overwrite", "--workers=2"]) == 0
        assert json.loads((out / "summary.json").read_text())["limit"]["starts"] == starts


def test_a_start_that_fails_is_reported_beside_the_others(scene: Path) -> None:
    # the nodes of the gap land on their initial slip, where it begins is not defined
    out = scene.parent / "out"
    gap = ["--set", 'contact.initial_gap="0.01*x**2"', "--pictures=none"]
    assert cli.main(["run", str(scene), "--out", str(out), "--starts=3", *gap]) == 0
    # starts of a run without a limit cycle tell nothing
    pulled = ["--set", "history.minimum=-0.5", "--starts=3", "--pictures=none"]
    assert cli.main(["run", str(scene), "--out", f"{out}2", *pulled]) == 1
    assert "failure" in rf.read_summary(f"{out}2/summary.json")
    starts = json.loads((out / "summary.json").read_text())["limit"]["starts"]
    assert starts["same"] is None and starts["kinds"]["failed"] == 2
    assert np.ptp(starts["dissipation"]) == starts["spread"] == 0.0  # of one alone
    assert set(starts["errors"]) == {"forward", "backward"}
    assert all("has an initial gap" in text for text in starts["errors"].values())
    assert "limits from 3 initial slips, some failed" in (out / "report.html").read_text()


def test_a_run_that_its_limit_has_ended_is_not_played_again(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = scene.parent / "out"
    run = ["run", str(scene), "--out", str(out), "--pictures=none"]
    assert cli.main(run) == 0
    before = (out / "record.h5").read_bytes()
    for more in ((), ("--set", "history.cycles=300")):
        assert cli.main([*run, "--resume", *more]) == 0
        assert ("was finished already" in capsys.readouterr().out) == (COMM.rank == 0)
        assert (out / "record.h5").read_bytes() == before
    # plain cycles do not begin where the limit has jumped to
    plain = SCENE.replace('until = "limit"', "").replace("cycles = 200", "cycles = 3")
    COMM.Barrier()
    rf.on_root(COMM, lambda: scene.write_text(plain))
    assert cli.main([*run, "--resume"]) == 0
    COMM.Barrier()
    record = rf.read_record(out / "record.h5")
    assert record.limit is None and len(record.cycles.dissipation) == 3


def test_a_node_has_the_direction_of_its_last_slip_in_the_last_cycle() -> None:
    # nodes by column; two legs after a first loading
    v = np.array([[0, 0, 0, 0, 0, 0, 0], [3, 1, 1, 0, 2, 1, 0], [2, 0, 1 - 1e-13, 0, 1, 1, 0]])
    state = np.array([[1] * 7, [1, 1, 1, 3, 3, 2, 3], [1, 1, 1, 1, 1, 1, 4]])
    density = np.array([[1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1e-12]])
    table = SimpleNamespace(cycle=np.array([0, 1, 1]), state=state, v=v)
    cycles = SimpleNamespace(dissipation_density=density)
    record: Any = SimpleNamespace(x=v[0], turning_points=table, cycles=cycles)
    assert _states(record).tolist() == [4, 4, 3, 3, 4, 2, 1]


def test_each_arrangement_has_the_zones_of_a_start_that_came_to_it() -> None:
    state = np.array([[3, 1, 2], [3, 1, 2], [1, 1, 2]], dtype=np.int8)
    D, cycles = np.ones(3), np.full(3, 9)
    named = ("a", "b", "c"), np.zeros((3, 3)), D, ("cyclic slip",) * 3
    states = SteadyStates(np.arange(3.0), *named, state, cycles, {})
    assert starts_summary(states)["zones"] == [
        {"starts": 1, "zones": states.zones(2)},
        {"starts": 2, "zones": states.zones(0)},
    ]
    assert states.zones(2) == [("stick", 0.0, 1.5), ("separation", 1.5, 2.0)]
