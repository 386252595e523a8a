import os
import resource
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

from mpi4py import MPI

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx import mpi
from receding_fenicsx.bulk.from_scene import is_small
from receding_fenicsx.pictures import default_instants
from receding_fenicsx.store.run_folder import is_finished
from receding_fenicsx.studies import run as study

DEMOS = Path(__file__).parents[1] / "demos"
SMALL = [
    "mesh.contact_elements=40",
    "history.cycles=2",
    "solver.method=events",
    "output.samples_per_leg=4",
]
comm = MPI.COMM_WORLD


def small(*overrides: str) -> rf.Scene:
    return rf.read_scene(DEMOS / "block.toml", [*SMALL, *overrides])


Finished = tuple[Path, rf.Record | None, list[str]]
"""Folder and record of a finished run, and what it has told."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """A run of the small block without pictures, in one folder for all ranks."""
    out = Path(comm.bcast(str(tmp_path_factory.mktemp("study")))) / "run"
    heard: list[str] = []
    options = study.RunOptions(pictures=False, progress=heard.append)
    record = study.run(small(), out, options, comm)
    comm.Barrier()
    return out, record, heard


def test_run_leaves_all_files_and_returns_their_record(finished: Finished) -> None:
    out, record, heard = finished
    assert (record is None) == (comm.rank > 0)
    assert {"record.h5", "summary.json", "system.h5"} <= set(os.listdir(out))
    assert os.listdir(out.parent) == ["run"]
    summary = rf.read_summary(out / "summary.json")
    assert set(summary["timings"]) == {"mesh", "assemble", "condense", "evolve", "pictures"}
    assert all(summary["timings"][s] > 0 for s in ("mesh", "assemble", "condense", "evolve"))
    assert summary["ranks"] == comm.size
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    assert 0.7 * memory < summary["peak_memory_MB"] <= memory
    assert {"python", "numpy", "dolfinx", "petsc", "MPI"} <= set(summary["versions"])
    assert summary["residual_max"] < 1e-9
    assert summary["energy_error_max"] < 1e-10  # the exact path's energy identity
    assert (summary["nodes"], summary["modelled_nodes"]) == (81, 41)
    if record is not None:
        stored = rf.read_record(out / "record.h5")
        np.testing.assert_array_equal(stored.turning_points.P, record.turning_points.P)
        assert any("mesh" in text for text in heard)
        assert any("cycle 2 of 2" in text for text in heard)
    else:
        assert heard == []


def test_instants_are_found_by_the_names_of_legs(finished: Finished) -> None:
    scene, (out, record, _) = small(), finished
    if record is not None:
        system = rf.read_system(out / "system.h5", scene)
        low = rf.instant_of(scene, system, record, 2, "unloading")
        np.testing.assert_array_equal(low.load, [scene.history.minimum])
        middle = rf.instant_of(scene, system, record, 2, "loading", 0.25)
        np.testing.assert_allclose(middle.load, [0.5], rtol=1e-14)
        slipped = replace(scene, history=replace(scene.history, initial_slip="0.001*x"))
        with pytest.raises(rf.InputError, match="one jump"):
            rf.instant_of(slipped, system, record, 0, "loading", 0.5)
        assert rf.instant_of(slipped, system, record, 1, "unloading", 0.5).cycle == 1


@pytest.mark.one_rank
def test_of_a_cycle_of_many_legs_few_turning_points_are_drawn() -> None:
    scene = small()
    system = rf.given(study.condense(scene, MPI.COMM_SELF))
    name = scene.loads[0].name
    corners = tuple((1.0 - 0.3 * (k % 2),) for k in range(1, 31))
    table = rf.HistoryOptions(
        "table", columns=(name,), rows=((1.0,),), cycle_rows=corners, cycles=3
    )
    scene = replace(scene, history=table)
    record = rf.evolve(system, scene)
    chosen = [(found.cycle, found.leg) for found in default_instants(scene, system, record)]
    legs = [0, 6, 12, 17, 23, 29]
    assert chosen == [(0, 0), *((1, leg) for leg in legs), *((3, leg) for leg in legs)]
    # the body is drawn where its loads are largest, wherever the cycle ends
    ends = ((0.5,), (1.0,), (0.7,))
    table = replace(table, rows=((0.7,),), cycle_rows=ends, cycles=2)
    scene = replace(scene, history=table)
    record = rf.evolve(system, scene)
    (found,) = default_instants(scene, system, record, everything=False)
    assert (found.cycle, found.leg, found.load[0]) == (2, 1, 1.0)


def test_small_bodies_are_condensed_in_the_same_bits_on_any_number_of_ranks() -> None:
    together = study.condense(small(), comm)
    if together is not None:
        alone = rf.given(study.condense(small(), MPI.COMM_SELF))
        assert alone.K.tobytes() == together.K.tobytes()
        assert alone.r_star.tobytes() == together.r_star.tobytes()
    comm.Barrier()
    assert is_small(small("mesh.contact_elements=1280"))
    assert not is_small(small("mesh.contact_elements=640", "mesh.growth=1"))


@pytest.mark.parametrize("place", ["draw_run", "condense"])
def test_interrupt_after_the_history_says_how_to_continue(
    place: str, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt = Mock(side_effect=KeyboardInterrupt)
    out = shared_tmp_path / "out"
    options = study.RunOptions(pictures=place == "draw_run", error=place == "condense")
    with monkeypatch.context() as patch:
        patch.setattr(f"receding_fenicsx.studies.run.{place}", interrupt)
        with pytest.raises(KeyboardInterrupt) as caught:
            study.run(small(), out, options)
    if MPI.COMM_WORLD.rank == 0:
        assert isinstance(caught.value, rf.Interrupted) and caught.value.exit_code == 130
        assert str(caught.value).endswith("out.part holds the whole history; continue by --resume")
    assert not out.exists()
    study.run(small(), out, replace(options, resume=True, pictures=False))
    assert (out / "summary.json").is_file()


def test_run_that_fails_on_the_way_keeps_what_it_found_and_says_why(shared_tmp_path: Path) -> None:
    out = shared_tmp_path / "run"
    table = rf.HistoryOptions(
        "table", columns=("p0",), rows=((1.0,),), cycle_rows=((0.5,), (-1.0,), (1.0,)), cycles=3
    )
    scene = replace(small(), history=table)
    with pytest.raises(rf.NoEquilibrium, match=r"^cycle 1, leg 1: lift-off") as caught:
        study.run(scene, out, comm=comm)
    comm.Barrier()
    if comm.rank == 0:
        assert os.listdir(shared_tmp_path) == ["run"]
        assert caught.value.record is None
        assert rf.read_summary(out / "summary.json")["failure"] == str(caught.value)
        assert f"The run ended early: {caught.value}" in (out / "report.html").read_text()
        assert not (out / "figures").exists() and not (out / "snapshots").exists()
        # up to the end of the last leg that has an answer, as in a run that goes no further
        rows = replace(table, rows=((1.0,), (0.5,)), cycle_rows=(), cycles=0)
        part = rf.evolve(rf.read_system(out / "system.h5", scene), replace(scene, history=rows))
        ends = rf.read_record(out / "record.h5").turning_points
        assert list(zip(ends.cycle.tolist(), ends.leg.tolist(), strict=True)) == [(0, 0), (1, 0)]
        assert np.array_equal(ends.state, part.turning_points.state)
        assert ends.P == pytest.approx(part.turning_points.P, abs=1e-12)
        with pytest.raises(rf.InputError, match=r"that run has failed \(cycle 1, leg 1"):
            is_finished(out, scene)
    comm.Barrier()


def test_a_run_from_a_saved_system_keeps_its_own_gap_and_friction(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved, out = shared_tmp_path / "saved.h5", shared_tmp_path / "run"
    system = study.condense(small(), comm, whole=True)
    scene = small("contact.initial_gap=0.001*x**2", "contact.friction=0.2")
    scene = replace(scene, probes=(rf.Probe("below", point=(0.0, 0.25)),))
    mpi.on_root(comm, lambda: rf.write_system(saved, rf.given(system)))
    drawn: list[bool] = []
    monkeypatch.setattr(study, "start_drawing", drawn.append)
    monkeypatch.setattr(study, "begin_figures", lambda *_: None)
    monkeypatch.setattr(study, "draw_run", lambda *_, body, **__: drawn.append(body))
    record = study.run(scene, out, study.RunOptions(system_file=saved), comm)
    assert set(drawn) == {False}  # the body is not meshed for its pictures
    if record is not None:
        kept = rf.read_system(out / "system.h5")
        x = np.abs(kept.x)
        assert kept.g0 == pytest.approx(0.001 * x**2) and np.all(kept.f == 0.2)
        assert record.g0[-len(x) :] == pytest.approx(kept.g0)
        # the saved one had no probes: they are kept for a run that goes on
        assert kept.probes is not None and record.probe("below").stress.any()


@pytest.mark.one_rank
def test_each_cycle_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", "receding_fenicsx"):
        rf.run(small("history.cycles=2"))
    assert sum("cycle 1" in record.getMessage() for record in caplog.records) == 1


def test_a_rank_alone_has_an_answer_of_its_own() -> None:
    scene = small("mesh.contact_elements=16", "history.cycles=1")
    assert study.condense(scene, MPI.COMM_SELF) is not None
    assert study.run(scene, comm=MPI.COMM_SELF) is not None
    assert study.check(scene, MPI.COMM_SELF) == 33
