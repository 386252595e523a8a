"""Scenes of all kinds: halves, images, other writings, files, and the balance of energy."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from images import Image, image_for, played
from kinds import EVEN, UNEVEN
from pydantic_core import to_json
from random_scenes import random_scene, rewritten
from replay import objections
from small import assert_same_bits, named_loads
from test_refusals import changed

import receding_fenicsx as rf
from receding_fenicsx.studies.sweep import measure_record

pytestmark = [pytest.mark.one_rank, pytest.mark.once]
KINDS = EVEN | UNEVEN
SEEDS = (3, 19, 38, 40, 43, 49, 68, 89, 90, 103, 110, 114, 125, 132, 144, 5599)
RANDOM = {f"seed {seed}": random_scene(seed) for seed in SEEDS}
"""In which each choice of the generator occurs twice; in the last a body has half of 9 elements."""
ALL = KINDS | RANDOM


@cache
def systems(name: str) -> rf.ContactSystem:
    return rf.given(rf.condense(ALL[name], MPI.COMM_SELF))


@cache
def record(name: str) -> rf.Record:
    return rf.evolve(systems(name), ALL[name])


@pytest.mark.parametrize("name", EVEN)
def test_half_of_a_body_tells_of_the_whole(name: str) -> None:
    half, whole = record(name), replace(EVEN[name], solver=rf.SolverOptions(symmetry="none"))
    assert half.half == (name != "cylinder" and systems(name).half)
    assert half.half or name in ("cylinder", "two edges")
    assert name != "two edges" or [*half.by_edge()] == ["bottom 1", "bottom 2"]
    Image().check(half, played(whole), 1e-8)


@pytest.mark.parametrize("name", ALL)
def test_the_image_of_a_scene_has_the_image_of_its_record(name: str) -> None:
    """Other units of length and stress, mirrored, turned and shifted, all of it at once."""
    image = image_for(ALL[name], [*ALL].index(name))
    image.check(played(image.of(ALL[name])), record(name), 1e-7)


@pytest.mark.parametrize("name", RANDOM)
def test_names_orders_shares_and_cuts_do_not_matter(name: str) -> None:
    scene, found = RANDOM[name], record(name)
    n, legs = len(scene.preloads), len(found.turning_points.s)
    cut = np.r_[:n, n + 1 : 2 * legs - n : 2]
    rows = cut if scene.history.kind == "table" else slice(None)
    Image(loads={"q": 0.5}).check(played(rewritten(scene)), found, 1e-7, rows)


@pytest.mark.parametrize("name", KINDS)
def test_a_shear_limit_that_is_never_met_changes_nothing(name: str) -> None:
    limited = [replace(each, shear_limit=each.shear_limit or 1e6) for each in KINDS[name].contacts]
    Image().check(played(replace(KINDS[name], contacts=tuple(limited))), record(name), 1e-7)


@pytest.mark.parametrize("row", Path(__file__).with_name("alike.txt").read_text().splitlines()[1:])
def test_a_scene_written_otherwise_has_the_same_record(
    row: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    base, _, both = row.partition(": ")
    records = []
    for changes in both.split(" == "):
        files, values, _ = changed(base, changes)
        for name, text in files.items():
            Path(name).write_text(text)
        records.append(played(rf.read_scene("scene.toml", values)))
    assert records[1].turning_points.P.any()
    Image().check(records[0], records[1], 1e-7)


@pytest.mark.parametrize("seed", [58, 83, 92])
def test_what_ends_a_path_ends_that_of_its_images(seed: int) -> None:
    """Gross sliding, and a jump."""
    scene = random_scene(seed)
    ends = []
    for each in (scene, image_for(scene, seed).of(scene)):
        with pytest.raises(rf.SolveError) as caught:
            played(each)
        ends.append((type(caught.value), named_loads(caught.value, "p", "q", "s")))
    assert ends[0][0] is ends[1][0] and ends[0][1] == pytest.approx(ends[1][1], rel=1e-6)


@pytest.mark.parametrize("name", ALL)
def test_a_record_keeps_all_laws_and_loops_enclose_the_dissipation(name: str) -> None:
    found, system = record(name), replace(systems(name), half=False, axisymmetric=False)
    history = rf.history_from_scene(rf.given(found.scene))
    slip = ALL[name].history.initial_slip is not None
    if not slip:
        again = rf.evolve(system, history, output=rf.OutputOptions(12, "all"))
        assert objections(system, history, again) == []
    assert found.energy_error_max < 1e-9 and found.residual_max < 1e-9
    for probe in (probe for probe in ALL[name].probes if probe.edge):
        on = [contact.edge == probe.edge for contact in ALL[name].contacts]
        assert len(found.probe(probe.name).points) == np.sum(np.array(on)[found.edge])
    D = found.cycles.dissipation
    assert found.cycles.dissipation_density @ found.weight == pytest.approx(D, abs=1e-12)
    if name in KINDS and abs(D[1] - D[0]) < 1e-6 * D[0]:  # a closed loop
        fine = replace(KINDS[name], output=rf.OutputOptions(200, (2,)))
        loop = rf.loop_of(rf.evolve(systems(name), fine), 2)
        assert loop.area().sum() == pytest.approx(D[-1], rel=0.01)


@pytest.mark.parametrize("name", ALL)
def test_a_row_of_a_sweep_holds_the_last_cycle_of_the_summary_edge_by_edge(name: str) -> None:
    found, summary = record(name), rf.summarise(record(name))
    row, last = measure_record(found), len(found.cycles.dissipation)
    for edge, part in found.by_edge().items():
        end = f".{edge}" if len(found.by_edge()) > 1 else ""
        points = [p for p in summary["turning_points"] if p["cycle"] == last]
        points = [p for p in points if p.get("edge", edge) == edge]
        for load in ("minimum", "maximum"):
            moment = part.at(last, load)
            (point,) = (p for p in points if p["leg"] == moment.leg)
            assert [*map(tuple, point["zones"])] == moment.zones
            assert ("p_axis" in point) == part.begins_on_axis
            for key in ("contact_half_width", "stick_half_width", "p_max"):
                assert row.pop(f"{key}_at_{load}{end}") == point[key], (edge, load, key)
            largest = max(-point["q_min"], point["q_max"])
            assert row.pop(f"q_abs_max_at_{load}{end}") == pytest.approx(largest, rel=1e-12)
    assert not any("_at_" in key for key in row) and row["cycles"] == last
    # there is a text of any of them, the same of a summary in a file
    printed, written = rf.run_table(summary, everything=True), to_json(summary, inf_nan_mode="null")
    assert rf.run_table(json.loads(written), everything=True) == printed
    assert all(f"{zone} to" in printed for p in points for zone, *_ in p["zones"][-1:])


@pytest.mark.once(False)
@pytest.mark.parametrize("name", KINDS)
def test_scene_system_and_record_are_read_as_they_were_written(name: str, tmp_path: Path) -> None:
    scene, system, found = KINDS[name], systems(name), record(name)
    sign, C = system.load_sign, system.load_compliance
    assert np.outer(sign, sign) * C.T == pytest.approx(C, abs=1e-9 * np.abs(C).max())
    assert rf.from_toml(rf.to_toml(scene)) == scene
    rf.write_system(tmp_path / "system.h5", system)
    read = rf.read_system(tmp_path / "system.h5", scene)
    rf.write_record(tmp_path / "record.h5", found)
    assert_same_bits(read, system)
    assert_same_bits(rf.read_record(tmp_path / "record.h5"), found)
