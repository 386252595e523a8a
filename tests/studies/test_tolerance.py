"""``run --error`` and ``run --tolerance`` on bodies of all kinds, and their folders."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.reference.closed_forms import BLOCK
from receding_fenicsx.store.workspace import CASES
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy.estimate import asked_numbers, level_of
from receding_fenicsx.studies.accuracy.meshes import is_refined
from receding_fenicsx.timing import Timer

DEMOS = Path(__file__).parents[2] / "demos"
COMM = MPI.COMM_WORLD
PLAIN = study.RunOptions(pictures=False)
COARSE = "mesh.contact_elements=48"
NARROW = ("contact.friction=0.0", f"load.p0.span=[{-BLOCK.load}, {BLOCK.load}]")


def block(*overrides: str) -> rf.Scene:
    return rf.read_scene(DEMOS / "block.toml", ["history.cycles=1", *overrides])


def searching(scene: rf.Scene, tolerance: float, *numbers: str, budget: float = 600.0) -> rf.Scene:
    options = replace(scene.accuracy, tolerance=tolerance, numbers=numbers, budget_seconds=budget)
    return replace(scene, accuracy=options)


def summary_of(folder: Path) -> dict[str, Any]:
    return rf.read_summary(folder / "summary.json")


# -- errors on every scene ------------------------------------------------------------------------


def test_bolts_have_their_preloads_on_coarser_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rf.read_scene(DEMOS / "bolted_joint.toml")
    bolts = tuple(replace(bolt, shortening=None, preload=0.02) for bolt in scene.bolts)
    seen = []

    def errors_of_run(own: rf.Scene, *_: object) -> dict[str, Any]:
        seen.append(own.bolts)
        return {}

    monkeypatch.setattr("receding_fenicsx.studies.accuracy.study.errors_of_run", errors_of_run)
    given = replace(scene, bolts=bolts), COMM, Timer(), None, replace(PLAIN, error=True)
    found = study._found(*given)
    assert seen == [bolts]
    assert all(bolt.shortening for bolt in found.scene.bolts)


@pytest.mark.parametrize(
    ("name", "overrides", "expected"),
    [
        ("dovetail", (COARSE, "history.cycles=1"), "largest_pressure[blade.left]"),
        ("block", ("mesh.contact_elements=32", "history.cycles=3"), "dissipation_ratio"),
        ("punch", (COARSE,), "stick_half_width"),
        ("punch_axisymmetric", (COARSE,), "centre_pressure"),
        ("layer", (COARSE,), "contact_half_width"),
        ("lap_joint", ("mesh.contact_elements=120",), "load_displacement[pull]"),
    ],
)
def test_errors_are_estimated_on_own_meshes_two_bodies_and_several_edges(
    name: str, overrides: tuple[str, ...], expected: str, shared_tmp_path: Path
) -> None:
    scene = rf.read_scene(DEMOS / f"{name}.toml", overrides)
    if name == "block":
        scene = replace(scene, probes=(rf.Probe("axis", point=(0.0, 0.5)),))
    record = study.run(scene, shared_tmp_path / "run", replace(PLAIN, error=True), COMM)
    if record is None:
        return
    summary, numbers = summary_of(shared_tmp_path / "run"), rf.headline(record)
    errors = summary["errors"]
    assert list(errors) == list(numbers) and expected in errors
    assert summary["timings"]["errors"] > 0.0
    on_axis = [p["p_axis"] for p in summary["turning_points"] if "p_axis" in p]
    assert not on_axis or numbers["centre_pressure"].value in on_axis
    # ends of zones and largest pressures are asked for by name only
    asked = asked_numbers(scene, [level_of(record, k) for k in (8, 16)])
    edges = {f"{zone}_{end}" for zone in ("contact", "stick") for end in ("left", "right")}
    local = edges | {"contact_half_width", "stick_half_width", "largest_pressure"}
    assert list(asked) == [name for name in errors if name.partition("[")[0] not in local]
    for name, found in errors.items():
        number, plain = numbers[name], name.partition("[")[0]
        assert plain in rf.HEADLINE_NAMES and found["size"] in (number.size, None)
        assert found["converges"] is False or (
            found["error"] > 0.0 and found["value"] == number.value
        )
        if name.endswith("half_width"):
            assert found["size"] == 0.5 * np.ptp(record.x)
        if plain == "dissipation_ratio":
            D = record.cycles.dissipation
            assert found["value"] == D[-1] / D[0]
        if name.startswith(("load_displacement", "dissipation_first")):
            assert found["order"] is not None, name
        if plain[:5] == "probe":  # at the end of the first loading
            axis = record.probe("axis")
            end = np.flatnonzero(axis.cycle == 0)[-1]
            assert found["value"] in (*axis.stress[end, 0], *axis.displacement[end, 0])
            assert found["error"] < 0.05 * found["size"]
    # u_x and s_xy vanish on the axis
    probes = [f"probe_{k}[axis]" for k in ("uy", "sxx", "syy", "szz") if scene.probes]
    assert [name for name in errors if name.startswith("probe")] == probes


def test_a_mesh_file_is_refined_and_is_its_own_coarser_partner(shared_tmp_path: Path) -> None:
    text = """
    SetFactory("OpenCASCADE"); Rectangle(1) = {-2, 0, 0, 4, 1};
    Point(9) = {-0.5, 1, 0}; Point(10) = {0.5, 1, 0};
    BooleanFragments{ Surface{1}; Delete; }{ Point{9, 10}; Delete; }
    MeshSize{:} = 0.25;
    Physical Curve("bottom") = Curve In BoundingBox{-3, -.1, -1, 3, .1, 1};
    Physical Curve("top") = Curve In BoundingBox{-3, .9, -1, 3, 1.1, 1};
    """
    file, scene = shared_tmp_path / "own.geo", block("load.p0.span=[-0.5, 0.5]")
    rf.on_root(COMM, lambda: file.write_text(text))
    scene = replace(scene, body=replace(scene.body, mesh=str(file)))
    assert is_refined(scene) and not is_refined(block())
    record = study.run(scene, shared_tmp_path / "run", replace(PLAIN, error=True), COMM)
    once = study.condense(scene, COMM)
    if record is None or once is None:
        return
    assert len(record.x) == 2 * once.n - 1
    assert record.scene is not None and record.scene.mesh.refinements == 1
    for found in summary_of(shared_tmp_path / "run")["errors"].values():
        assert found["error"] > 0.0


# -- a tolerance ----------------------------------------------------------------------------------


def test_a_tolerance_is_met_and_the_true_error_is_within_it(shared_tmp_path: Path) -> None:
    out = shared_tmp_path / "run"
    scene = searching(block(*NARROW), 3e-3, "centre_pressure", "contact_half_width")
    record = study.run(scene, out, replace(PLAIN, tolerance=2e-3), COMM)
    if record is None:
        return
    summary = summary_of(out)
    found = summary["accuracy"]
    assert found["met"] and found["tolerance"] == 2e-3
    for name, limit in (("centre_pressure", BLOCK.p[0]), ("contact_half_width", BLOCK.half_width)):
        row = summary["errors"][name]
        assert abs(row["value"] - limit) <= 2.0 * row["error"] <= 2e-3 * row["size"]
    # the record is that of the last mesh
    last = found["way"][-1]
    assert found["seconds"] == pytest.approx(sum(level["seconds"] for level in found["way"]))
    assert len(record.x) == len(rf.read_record(out / "record.h5").x) == last["nodes"]
    assert record.scene is not None
    assert record.scene.mesh.contact_elements == last["elements"]


def test_a_tolerance_beyond_the_budget_keeps_the_best_run(
    shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shared_tmp_path / "run"
    changes = ["history.cycles=1", "accuracy.budget_seconds=1e-3", "accuracy.tolerance=1e-5"]
    set_all = [word for change in changes for word in ("--set", change)]
    code = cli.main(
        ["run", str(DEMOS / "block.toml"), "--out", str(out), "--pictures", "figures", *set_all]
    )
    printed = capsys.readouterr()
    assert code == 1
    if COMM.rank:
        return
    assert "the budget of 0.001 s ends first" in printed.err
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "NOT met" in printed.out and "centre_pressure" in page
    assert (out / "record.h5").is_file() and (out / "figures" / "accuracy.png").is_file()
    assert not (shared_tmp_path / "run.part").exists()


def test_an_interrupted_search_is_resumed_where_it_was(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = searching(block(), 2e-2)
    whole = study.run(scene, shared_tmp_path / "whole", PLAIN, COMM)
    evolved, calls = study._system, []

    def stop_third(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:
            raise rf.Interrupted("enough", 143)
        return evolved(*arguments)

    monkeypatch.setattr(study, "_system", stop_third)
    out = shared_tmp_path / "run"
    with pytest.raises(rf.Interrupted, match="enough") as caught:
        study.run(scene, out, PLAIN, COMM)
    assert caught.value.exit_code == 143
    if COMM.rank == 0:
        assert len((shared_tmp_path / "run.part" / CASES).read_text().splitlines()) == 2
    calls += [1] * 7
    record = study.run(scene, out, replace(PLAIN, resume=True), COMM)
    study.run(scene, out, replace(PLAIN, resume=True), COMM)  # all meshes are finished
    if record is None or whole is None:
        return
    ways = [summary_of(shared_tmp_path / name)["accuracy"]["way"] for name in ("whole", "run")]
    # two meshes were not solved again
    assert len(calls) == 10 + len(ways[0]) - 2 + 1
    for way in ways:
        for level in way:
            del level["seconds"]
    assert ways[0] == ways[1]
    assert np.array_equal(record.turning_points.P, whole.turning_points.P)


def test_a_finished_search_goes_on_with_a_smaller_tolerance(shared_tmp_path: Path) -> None:
    out, numbers = shared_tmp_path / "run", ("load_displacement",)
    with pytest.raises(rf.ToleranceNotMet):
        study.run(searching(block(), 1e-3, *numbers, budget=1e-3), out, PLAIN, COMM)
    study.run(searching(block(), 1e-3, *numbers), out, replace(PLAIN, resume=True), COMM)
    if COMM.rank == 0:
        way = summary_of(out)["accuracy"]["way"]
        assert [level["elements"] for level in way[:2]] == [24, 60]
        assert summary_of(out)["accuracy"]["met"]


def test_sharp_corners_in_contact_are_graded_unasked(shared_tmp_path: Path) -> None:
    """True errors against a mesh twice as fine; equal elements are three times worse."""
    scene = rf.read_scene(DEMOS / "punch_axisymmetric.toml", ["output.cycles=[]"])
    record = study.run(searching(scene, 4e-3), shared_tmp_path / "run", PLAIN, COMM)
    off = replace(scene, mesh=replace(scene.mesh, refine=()))
    study.run(searching(off, 0.2), shared_tmp_path / "off", PLAIN, COMM)
    if record is None:
        return
    assert not summary_of(shared_tmp_path / "off")["accuracy"]["graded"]
    summary = summary_of(shared_tmp_path / "run")
    assert summary["accuracy"]["met"] and summary["accuracy"]["graded"]
    assert record.scene is not None
    elements = record.scene.mesh.contact_elements
    finest, equal = (
        rf.headline(study.run(each, None, PLAIN, MPI.COMM_SELF))  # type: ignore[arg-type]
        for each in (rf.scaled_mesh(record.scene, 2 * elements), rf.scaled_mesh(scene, elements))
    )
    for name in ("centre_pressure", "load_displacement[P]", "dissipation_first_loading"):
        exact, found = finest[name].value, summary["errors"][name]
        true = abs(found["value"] - exact)
        assert true <= 2.0 * found["error"] <= 4e-3 * abs(exact)
        assert 3.0 * true < abs(equal[name].value - exact)
