"""Histories of the probes: every instant of the record, saved systems, resumed runs, refusals."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from mpi4py import MPI

import h5py
import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.evolution.evolve import continue_history
from receding_fenicsx.evolution.journal import Journal, JournalFile
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.store.run_folder import write_probes

comm = MPI.COMM_WORLD

BLOCK = """
[mesh]
contact_elements = 24
[[load]]
name = "p0"
edge = "top"
span = [-1.0, 1.0]
pressure = 1.0
[history]
cycles = 4
[output]
samples_per_leg = 6
checkpoint_cycles = 2
[[probe]]
name = "deep"
point = [0.5, 0.5]
[[probe]]
name = "edge"
segment = [[-2.0, 0.0], [2.0, 0.0]]
count = 5
"""


def small(*overrides: str) -> rf.Scene:
    return rf.from_toml(BLOCK, overrides)


@cache
def solved() -> tuple[rf.ContactSystem, rf.Record] | None:
    system = rf.condense(small())
    return None if system is None else (system, rf.evolve(system, small()))


def test_history_has_every_turning_point_sample_and_event_of_the_record() -> None:
    found = solved()
    if found is None:
        return
    record = found[1]
    probe = record.probe("deep")

    def places(table: object) -> set[tuple[int, int, float]]:
        columns = [getattr(table, key).tolist() for key in ("cycle", "leg", "s")]
        return set(zip(*columns, strict=True))

    corners, samples, events = (
        places(table) for table in (record.turning_points, record.samples, record.events)
    )
    path = list(zip(probe.cycle.tolist(), probe.leg.tolist(), probe.s.tolist(), strict=True))
    assert set(path) == corners | samples | events
    assert path == sorted(set(path))
    kinds = dict(zip(path, probe.kind.tolist(), strict=True))
    assert {kinds[place] for place in corners} == {"turning point"}
    assert {kinds[place] for place in events - corners - samples} == {"event"}
    assert np.array_equal(probe.load[probe.kind == "turning point"], record.turning_points.load)


def test_half_and_whole_model_give_the_same_histories() -> None:
    """The whole mesh is the half one and its mirror image."""
    found = solved()
    scene = small("solver.symmetry=none")
    whole = rf.condense(scene)
    if found is None or whole is None:
        return
    record = rf.evolve(whole, scene)
    for name in ("deep", "edge"):
        a, b = found[1].probe(name), record.probe(name)
        rows, others = ((p.kind != "event") & (p.s > 0.0) for p in (a, b))
        assert np.abs(a.stress[rows] - b.stress[others]).max() < 1e-9
        assert np.abs(a.displacement[rows] - b.displacement[others]).max() < 1e-9
    edge = found[1].probe("edge")
    left, right = edge.stress[:, 0], edge.stress[:, -1]
    assert np.array_equal(left[:, :3], right[:, :3])
    assert np.array_equal(left[:, 3], -right[:, 3])
    assert np.array_equal(edge.displacement[:, 0], edge.displacement[:, -1] * [-1.0, 1.0])
    assert not edge.displacement[:, 2, 0].any() and not edge.stress[:, 2, 3].any()


def test_histories_on_a_system_and_files_keep_the_probes(tmp_path: Path) -> None:
    found = solved()
    if found is None:
        return
    system, record = found
    history = rf.history_from_scene(small())
    again = rf.evolve(system, history, small().solver, small().output)
    # a scene's checkpoints renew the solver: other round-off
    a, b = (r.probe("deep") for r in (again, record))
    corners = [probe.stress[probe.kind == "turning point"] for probe in (a, b)]
    assert np.abs(corners[0] - corners[1]).max() < 1e-12
    rf.write_record(tmp_path / "r.h5", record)
    read = rf.read_record(tmp_path / "r.h5")
    for name in ("deep", "edge"):
        a, b = record.probe(name), read.probe(name)
        assert all(np.array_equal(getattr(a, key), getattr(b, key)) for key in vars(a))
    rf.write_record(tmp_path / "r.h5", replace(record, probes=None), overwrite=True)
    assert rf.read_record(tmp_path / "r.h5").probes is None
    with pytest.raises(rf.InputError, match="has no probes; add a table"):
        rf.read_record(tmp_path / "r.h5").probe("deep")
    with pytest.raises(rf.InputError, match="'dep': is not in the record; did you mean 'deep'"):
        record.probe("dep")


def test_table_and_file_have_a_row_for_each_instant_and_point(tmp_path: Path) -> None:
    found = solved()
    if found is None:
        return
    record = found[1]
    assert write_probes(tmp_path / "probes", record) == [
        tmp_path / "probes" / f"{name}.csv" for name in ("deep", "edge")
    ]
    probe = record.probe("edge")
    with open(tmp_path / "probes" / "edge.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    table = probe.to_table()
    assert list(rows[0]) == list(table)
    n = len(probe.s)
    assert len(rows) == 5 * n
    row = rows[5 * (n // 2) + 3]
    assert float(row["x"]) == 1.0 and row["point"] == "3"
    assert [float(row[key]) for key in ("sxx", "syy", "szz", "sxy")] == probe.stress[
        n // 2, 3
    ].tolist()
    xx, yy, zz, xy = probe.stress[n // 2, 3]
    deviator = np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, zz]])
    deviator = deviator - np.eye(3) * np.trace(deviator) / 3.0
    assert float(row["von_mises"]) == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()))


def differing(a: Path, b: Path) -> list[str]:
    """Return the probes' arrays that differ between two records."""
    with h5py.File(a / "record.h5") as one, h5py.File(b / "record.h5") as other:
        assert set(one["probes"]) == set(other["probes"])
        return [
            k for k in one["probes"] if not np.array_equal(one["probes"][k], other["probes"][k])
        ]


def stop_at(cycle: int) -> Callable[[str], None]:
    def say(text: str) -> None:
        if text.startswith(f"evolve: cycle {cycle} "):
            raise KeyboardInterrupt

    return say


def test_resumed_run_and_saved_system_give_the_same_bits(tmp_path: Path) -> None:
    scene, out = small("output.cycles='all'"), comm.bcast(tmp_path)
    plain = rf.RunOptions(pictures=False)
    rf.run(scene, out / "whole", plain, comm)
    with pytest.raises((rf.Interrupted, KeyboardInterrupt)):
        rf.run(scene, out / "cut", replace(plain, progress=stop_at(3)), comm)
    rf.run(scene, out / "cut", replace(plain, resume=True), comm)
    # the same system with its probes, with other ones, and without
    saved = replace(plain, system_file=out / "whole" / "system.h5")
    rf.run(scene, out / "saved", saved, comm)
    other = replace(scene, probes=(rf.Probe("other", point=(0.1, 0.2)),))
    rf.run(other, out / "other", saved, comm)
    rf.run(scene, out / "back", replace(plain, system_file=out / "other" / "system.h5"), comm)
    if comm.rank == 0:
        for name in ("cut", "saved", "back"):
            assert differing(out / "whole", out / name) == [], name
        assert rf.read_record(out / "other" / "record.h5").probe("other").stress.any()
        assert (out / "other" / "probes" / "other.csv").is_file()
    comm.barrier()


def test_changes_under_an_initial_slip_have_no_probe_values_before_and_after_a_checkpoint(
    tmp_path: Path,
) -> None:
    """The first leg is one static problem: what lies within it is not known."""
    slipped = ["history.initial_slip='0.05*x*(1-x)'", "output.cycles='all'"]
    scenes = [small(*slipped, f"history.cycles={cycles}") for cycles in (1, 4)]
    system = rf.condense(scenes[1])
    if system is None:
        return
    whole = continue_history(problem_of_scene(system, scenes[1]), Journal(1), None)
    records = []
    for problem in (problem_of_scene(system, scene) for scene in scenes):
        journal = JournalFile(tmp_path / "journal", problem.system, 1)
        records.append(continue_history(problem, journal, None))
        journal.close()
    assert whole.probes is not None
    for key in ("kind", "cycle", "leg", "s", "displacement", "stress"):
        assert np.array_equal(getattr(records[1].probes, key), getattr(whole.probes, key)), key
    first = (whole.events.cycle == 0) & (whole.events.leg == 0)
    assert first.any() and np.isfinite(whole.probes.stress).all()


def test_system_with_other_probes_is_refused() -> None:
    found = solved()
    if found is None:
        return
    system, _ = found
    moved = replace(small(), probes=(rf.Probe("deep", point=(0.5, 0.25)), small().probes[1]))
    for wrong, scene in ((replace(system, probes=None), small()), (system, moved)):
        with pytest.raises(rf.InputError, match="condensed with other probes"):
            rf.evolve(wrong, scene)
    assert rf.evolve(system, replace(small("history.cycles=1"), probes=())).probes is None
