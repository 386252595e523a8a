"""Curves of joints against closed forms: cylinders, a strip on a wall, one node."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures, check_words
from scipy.stats import linregress
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.studies.joint import curve as joint

ROOT = Path(__file__).parents[2]
CYLINDERS = ROOT / "demos" / "half_planes.toml"
comm = MPI.COMM_WORLD


def cylinders(elements: int = 60) -> rf.Scene:
    return rf.read_scene(CYLINDERS, [f"mesh.contact_elements={elements}"])


def test_cylinders_dissipate_as_cattaneo_and_mindlin_say_within_the_estimate() -> None:
    U, f = np.array([0.3, 0.5, 0.7, 0.9]), 0.5
    curve, coarse = (rf.joint_curve(cylinders(n), "Q", f * U) for n in (60, 30))
    scene = rf.from_toml(rf.to_toml(cylinders(30)), ["contact.shear_limit=0.2"])
    limited = rf.joint_curve(scene, "Q", f * U[1:3])
    if curve is None or coarse is None or limited is None:
        assert comm.rank > 0
        return
    E_star = 200.0 / (2.0 * (1.0 - 0.3**2))
    D = f**2 / (np.pi * E_star) * (4.0 * (1.0 - U) * np.log1p(-U) + 4.0 * U - 2.0 * U**2)
    assert np.all(np.abs(curve.dissipation - D) <= 2.0 * curve.estimate)
    assert np.all(curve.estimate < 0.1 * D)
    # the pressure does not change, so Masing's rule is exact
    assert curve.masing_defect.max() < 1e-9
    assert curve.kind == ("cyclic slip",) * 4
    assert 3.0 < curve.exponent[0] < 4.0 and np.isinf(curve.backbone.macroslip)
    # nor does it with a shear limit, which lets more slip
    assert limited.masing_defect.max() < 1e-9
    assert limited.dissipation[1] > 1.1 * coarse.dissipation[2]
    # a single change may be small by chance: the estimate covers those of the neighbours too
    change = np.abs(coarse.dissipation / curve.dissipation - 1.0)
    beside = [change[max(k - 1, 0) : k + 2].max() for k in range(4)]
    assert curve.estimate / curve.dissipation == pytest.approx(beside, rel=1e-9)


def test_macroslip_is_found_at_the_limit_of_friction() -> None:
    curve = rf.joint_curve(cylinders(40), "Q", [0.2, 0.6])
    if curve is None:
        return
    assert curve.backbone.macroslip == pytest.approx(0.5, rel=2e-6)
    assert curve.kind == ("cyclic slip", "failed") and "sliding" in curve.rows()[1]["error"]
    assert np.isnan(curve.masing[1]) and "macroslip" in repr(curve)
    assert len(curve.table) == 2 and list(curve.table) == list(curve.table.rows)


@pytest.mark.one_rank
def test_a_spring_that_is_moved_obeys_the_closed_form_of_a_slider(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Driven by U through k against friction f: D = 4 f (U - f/k), largest force min(k U, f)."""
    k, f, U = 2.5, 0.4, np.array([0.1, 0.5, 1.3])
    system = small_system(np.diag([k, 2.0]), {"P": [0.0, 1.0], "U": [-k, 0.0]}, f)
    # held in contact the spring takes k U: the conjugate of a prescribed displacement is its force,
    # to which P adds 3
    compliance = np.array([[0.0, 3.0], [3.0, k]])
    system = replace(system, load_compliance=compliance, load_sign=np.array([-1.0, 1.0]))
    rf.joint_curve(system, "U", U[:2], tmp_path / "out")
    assert system.local_stiffness[0] == k  # a property that is computed when it is asked for
    curve = rf.joint_curve(system, "U", U, tmp_path / "out", options=rf.StudyOptions(resume=True))
    assert len((tmp_path / "out" / "cases.jsonl").read_text().splitlines()) == 3
    with pytest.raises(rf.InputError, match="is a curve with another system"):
        other, resume = replace(system, f=0.5 * system.f), rf.StudyOptions(resume=True)
        rf.joint_curve(other, "U", U, tmp_path / "out", options=resume)
    assert curve is not None and curve.kind == ("shakedown", "cyclic slip", "cyclic slip")
    D = 4.0 * f * np.maximum(U - f / k, 0.0)
    assert curve.dissipation == pytest.approx(D, rel=1e-12)
    assert curve.masing == pytest.approx(D, rel=1e-12)
    assert curve.stiffness == pytest.approx(np.minimum(k * U, f) / U, rel=1e-12)
    assert curve.slip == pytest.approx(2.0 * np.maximum(U - f / k, 0.0), rel=1e-12)
    # by command, of a saved system
    rf.write_system(tmp_path / "node.h5", system)
    head = ["joint", f"{tmp_path}/node.h5", f"--out={tmp_path}/by_command", "--to=1.3"]
    one = ["--from", "1.3", "--count", "1", "--drive"]
    assert cli.main([*head, *one, "mode:1"]) == 2 and cli.main([*head, *one, "U"]) == 0
    again = json.loads((tmp_path / "by_command" / "joint.json").read_text())["amplitudes"]
    assert [row["dissipation"] for row in again] == pytest.approx(D[-1:], rel=1e-12)

    play, largest = joint._play_system, 0.5

    def fails(part: Any, history: rf.History, drive: str) -> object:
        if history.loop[0, 1] > largest:
            raise rf.SolveError(f"{drive} at {history.loop[0, 1]:g}")
        return play(part, history, drive)

    monkeypatch.setattr(joint, "_play_system", fails)
    again = [*head, "--from=0.1", "--drive=U", "--count=2", "--overwrite"]
    assert cli.main(again) == 0 and "all amplitudes" not in capsys.readouterr().err
    largest = 0.0
    assert cli.main(again) == 1
    assert "joint: all amplitudes failed, the smallest with: U at 0.1\n" in capsys.readouterr().err
    # the files hold the numbers of the curve
    with (tmp_path / "out" / "joint.csv").open() as file:
        rows = list(csv.DictReader(file))
    told = json.loads((tmp_path / "out" / "joint.json").read_text())
    texts = {"kind": list(curve.kind), "error": [""] * 3}
    names = ["amplitude", "dissipation", "estimate", "stiffness", "masing", "masing_defect", "slip"]
    assert set(rows[0]) == set(told["amplitudes"][0]) == {*names, *texts}
    for name in names:
        known = getattr(curve, name)
        assert np.array([float(row[name] or "nan") for row in rows]) == pytest.approx(
            known, rel=1e-15, nan_ok=True
        )
        assert [row[name] for row in told["amplitudes"]] == [x if x == x else None for x in known]
    for name, known in texts.items():
        assert [row[name] for row in rows] == [row[name] for row in told["amplitudes"]] == known
    assert (told["exponent"], told["drive"]) == (None, "U") and "numpy" in told["versions"]
    loading = told["first_loading"]
    # stuck at first: the spring takes k U, no work is done; past f/k it slides
    assert {name: loading[name] for name in loading} == {
        name: getattr(curve.backbone, name).tolist() for name in ("load", "displacement", "work")
    }


@pytest.mark.one_rank
def test_a_saved_joint_is_tightened_as_its_scene_says() -> None:
    scene = rf.read_scene(ROOT / "demos" / "bolted_joint.toml", ["mesh.contact_elements=48"])
    bolts = [replace(bolt, shortening=s) for bolt, s in zip(scene.bolts, (0.5, 0.8), strict=True)]
    scene = replace(scene, bolts=tuple(bolts))
    curves = [rf.given(rf.joint_curve(one, "pull", [4e-3])) for one in (scene, rf.condense(scene))]  # type: ignore[arg-type]
    for key in ("dissipation", "stiffness", "slip", "masing"):
        of_scene, saved = (getattr(curve, key) for curve in curves)
        assert saved == pytest.approx(of_scene, rel=1e-9, abs=0.0) and saved > 0.0


@pytest.mark.one_rank
def test_the_slip_is_that_of_nodes_that_touch_all_the_time() -> None:
    """Uncoupled sliders of stiffness 1: the second one opens under U and swings further."""
    loads = {"P": [0.0, 0.0, 1.0, 0.1], "U": [-1.0, -5.0, 0.0, -0.5]}
    system = small_system(np.eye(4), loads, 0.4)
    path, loop = np.array([[0, 0], [1, 0], [1, 1]]), np.array([[1, 1], [1, -1], [1, 1]])
    record = rf.evolve(system, rf.History(("P", "U"), path, loop, cycles=2))
    found = joint.loop_numbers(record, "U")
    assert found["slip"] == pytest.approx(2.0 * (1.0 - 0.4), rel=1e-12)
    assert (found["cycles"], found["residual_max"]) == (2, record.residual_max)


@pytest.mark.one_rank
def test_a_preload_without_equilibrium_is_no_macroslip() -> None:
    """A slider on rollers is pulled off before it is driven."""
    loads = {"P": [0.0, 1.0], "U": [-2.5, 0.0]}
    system = small_system(np.diag([2.5, 0.0]), loads, 0.4, rigid=[[0.0, 1.0]])
    with pytest.raises(rf.NoEquilibrium, match="lift-off"):
        joint.first_loading(system, "U", np.array([[0.0, 0.0], [-1.0, 0.0]]), [0.1])
    free = small_system(np.diag([0.0, 2.0]), loads, 0.4, rigid=[[1.0, 0.0]])
    with pytest.raises(rf.SolveError, match="load 'U': moves the contact at any load factor: "):
        joint.first_loading(free, "U", np.zeros((1, 2)), [0.1])


@pytest.mark.one_rank
@pytest.mark.parametrize("drive", ["F", "mode:1"])
def test_the_figure_draws_damping_ratio_and_frequency_of_a_mode_else_d_and_stiffness(
    drive: str,
) -> None:
    a, D = np.array([0.2, 0.5, 1.0]), np.array([0.3, 0.9, 7.0])
    k, masing = np.array([9.0, 8.0, 5.0]), np.array([0.2, 1.0, 8.0])
    # by Masing's rule 8 times the work, where nothing moves
    load, work = np.append(0.0, a), np.append(0.0, masing / 8.0)
    backbone = joint.Backbone(load, np.zeros(4), work, 1.5, "lifts")
    rows = [
        tuple({"dissipation": d, "stiffness": s, "error": ""} for d, s in np.stack([found, k], 1))
        for found in (D, D * [1.1, 1.0, 1.3])
    ]
    tables = [rf.SweepTable(("amplitude",), (tuple(a),), each) for each in rows]
    curve = rf.JointCurve(drive, tables, backbone, np.array([2.5, 7.0]))
    figure = joint.joint_figure(curve)
    check_figures([("joint curve", figure)], REPORTS / f"joint_{drive[0]}.txt")
    told = joint._files("a title", curve)["joint.json"]
    texts = [f"{key}: {told[key]}" for key in told if key not in ("amplitudes", "first_loading")]
    check_words([*repr(curve).splitlines(), *texts], REPORTS / f"joint_{drive[0]}_told.txt")
    line = linregress(np.log(a), np.log(D))
    assert curve.exponent == pytest.approx((line.slope, line.stderr))
    left, right = figure.axes
    for axes in figure.axes:  # amplitudes 1, 2, 5 and 10 times a power of ten are named
        names = [float(label.get_text()) for label in axes.get_xticklabels()]
        assert all(f"{name:.0e}"[0] in "125" and name == float(f"{name:.0e}") for name in names)
    # a mass-normalised mode: omega^2 = alpha/q and zeta = D / (2 pi omega^2 q^2)
    q, omega = a / k, np.sqrt(k)
    damping = 2.0 * np.pi * omega**2 * q**2
    unit = damping if drive == "mode:1" else np.ones(3)
    macroslip = [1.5, 1.5], [0.0, 1.0]
    check_curves(left, (a, D / unit), (a, masing / unit), macroslip)
    check_curves(right, (a, omega if drive == "mode:1" else k), macroslip)
    # a bar is the largest change from the coarser mesh of an amplitude and its neighbours
    bars: Any = left.collections[0]
    assert np.array(bars.get_segments())[:, :, 1].T == pytest.approx(
        D / unit * (1.0 + np.outer([-1, 1], [0.1, 0.3, 0.3]))
    )
    assert curve.masing_defect == pytest.approx([1 / 3, 1 / 9, 1 / 7])
    # without an answer there is nothing to draw and no fit
    lost = rf.SweepTable(("amplitude",), (tuple(a),), ({"error": "lost"},) * 3)
    curve_of_none = rf.JointCurve(drive, [lost], backbone)
    assert all(f"{words}\n" in repr(curve_of_none) for words in ("none found", "at most 0"))
    assert joint.joint_figure(curve_of_none).axes[0].get_yscale() == "linear"
    if drive == "mode:1":
        for name, known in {"zeta": D / damping, "omega": omega}.items():
            assert [row[name] for row in curve.rows()] == pytest.approx(known), name


def test_command_writes_a_curve_and_goes_on_with_it(shared_tmp_path: Path) -> None:
    out = shared_tmp_path / "curve"
    head = ["joint", str(CYLINDERS), "--set", "mesh.contact_elements=40", "--drive", "Q"]
    head += ["--to", "0.4", "--out", str(out)]
    assert cli.main([*head, "--from", "0.1", "--count", "2"]) == 0
    comm.barrier()
    assert cli.main([*head, "--from", "0.2", "--count", "2", "--resume"]) == 0
    comm.barrier()
    told = json.loads((out / "joint.json").read_text())
    assert [row["amplitude"] for row in told["amplitudes"]] == pytest.approx([0.2, 0.4])
    assert told["macroslip"] is None and told["first_loading"]["load"][0] == 0.0
    assert (out / "joint.png").stat().st_size > 10_000
