"""Wear over many cycles: closed forms, explicit steps, published scars, resuming, refusals."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

from mpi4py import MPI

import models
import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.studies.wear.steps import Convected, NodePairs, advance, pressures, row_type
from receding_fenicsx.studies.wear.study import _end, figures

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[2]
comm = MPI.COMM_WORLD
CYLINDERS = ROOT / "demos" / "half_planes.toml"
PROBE = '[[probe]]\nname = "edge"\nedge = "lower.top"\n[fatigue]\n'
P, F, U, R = 1.0, 0.5, 0.6, 100.0
E_STAR = 100.0 / (1.0 - 0.3**2)
A = np.sqrt(4.0 * P * R / (np.pi * E_STAR))
C = 1e-3
"""Cylinders of the demo: load, friction, shear over f P, radius, modulus, half width, wear."""


def cylinders(elements: int, *changes: str) -> rf.Scene:
    width = [f"body.{name}.width=2.9" for name in ("upper", "lower")]
    steps = [f"mesh.contact_elements={elements}", f"wear.coefficient={C}", "output.cycles=[]"]
    return rf.read_scene(CYLINDERS, [*width, *steps, *changes])


def partial(elements: int, Q: float, *changes: str) -> rf.Scene:
    """Return the cylinders sheared by +-Q."""
    rows = [f"rows=[[1.0, 0.0], [1.0, {Q}]]", f"cycle_rows=[[1.0, {-Q}], [1.0, {Q}]]"]
    return cylinders(elements, *(f"history.{row}" for row in rows), *changes)


def worn(
    scene: rf.Scene, out: Path | None = None, options: rf.StudyOptions = rf.StudyOptions()
) -> rf.WearStudy:
    """Return the study of a scene on one rank."""
    return rf.given(rf.wear(scene, out, options))


def pairs_of(scene: rf.Scene) -> NodePairs:
    """Return the node pairs of a scene on one rank."""
    system = rf.given(rf.condense(scene))
    return NodePairs(problem_of_scene(system, scene), np.full(system.n, C))


def sliding(elements: int, slip: float, *changes: str) -> rf.Scene:
    """Return the cylinders moved to and fro by a prescribed displacement, in gross slip."""
    rows = [f"[[1.0, 0.0], [1.0, {slip}]]", f"[[1.0, {-slip}], [1.0, {slip}]]"]
    found = cylinders(elements, f"history.rows={rows[0]}", f"history.cycle_rows={rows[1]}")
    press, shear = found.loads
    moved = replace(shear, force=None, platen=False, displacement=(1.0, "free"))
    scene = replace(found, loads=(press, moved))
    return rf.from_toml(rf.to_toml(scene), changes)


def test_partial_slip_wears_to_the_closed_limit_with_its_stick_zone_kept() -> None:
    b = A * np.sqrt(1.0 - U)
    rest = P - np.pi * E_STAR * b**2 / (4.0 * R)
    errors = []
    for elements in (40, 80, 160):
        study = worn(cylinders(elements, "wear.tolerance=0.2"))
        assert study.end == "shakedown"
        node = study.x[1] - study.x[0]
        assert np.ptp(study.stick_half_width) == 0.0
        assert abs(study.stick_half_width[0] - b) < node
        # outside the stick zone nothing is left of the pressure
        outside = np.abs(study.x) > b + node
        assert study.pressure[-1][outside].max() < 1e-5 * P / b
        inside = np.abs(study.x) < 0.8 * b
        root = np.sqrt(b**2 - study.x[inside] ** 2)
        known = E_STAR / (2.0 * R) * root + rest / (np.pi * root)
        errors.append(np.abs(study.pressure[-1][inside] / known - 1.0).max())
        assert study.volume[-1] == pytest.approx(C * study.dissipation[-1], rel=1e-14)
    # the end of the stick zone is known to a node: first order
    assert errors[-1] < 0.012 and errors[-1] < 0.5 * errors[0]


def test_estimates_hold_against_smaller_steps() -> None:
    coarse, fine = (
        worn(cylinders(60, "wear.cycles=8000", f"wear.tolerance={t}")) for t in (0.2, 0.02)
    )
    assert len(fine.rows) > 2 * len(coarse.rows)
    off = np.abs(coarse.depth[-1] - fine.depth[-1])
    assert np.mean(off <= 2.0 * coarse.rows["estimate"][-1]) >= 0.95
    assert abs(coarse.volume[-1] - fine.volume[-1]) <= 2.0 * coarse.volume_estimate[-1]


def test_estimates_hold_against_smaller_elements() -> None:
    coarse, fine = (worn(partial(n, 0.1, "wear.cycles=500")) for n in (30, 120))
    off = abs(coarse.volume[-1] - fine.volume[-1])
    # the steps know much less of it
    assert 2.0 * coarse.rows["estimate"][-1] @ coarse.system.weight < off
    assert off <= 2.0 * coarse.volume_estimate[-1]
    assert abs(coarse.depth_max[-1] - fine.depth_max[-1]) <= 2.0 * coarse.depth_estimate[-1]
    # a scar of few nodes, deepest between them
    narrow = ["contact.friction=0.4", "material.lower.young=42.0", "wear.cycles=100"]
    narrow += [f"body.{name}.width=5.19" for name in ("upper", "lower")]
    coarse, fine = (worn(partial(n, 0.14, *narrow)) for n in (50, 200))
    assert abs(coarse.depth_max[-1] - fine.depth_max[-1]) <= 2.0 * coarse.depth_estimate[-1]


def test_the_stick_zone_is_worn_through_where_wear_takes_the_normal_force() -> None:
    # pressed by a displacement: all nodes slide when f P has fallen to Q
    Q = 0.54
    scene = partial(40, Q)
    press, shear = scene.loads
    held = replace(press, force=None, platen=False, displacement=("free", -0.025))
    study = worn(replace(scene, loads=(held, shear)))
    assert study.end == "stick zone worn through"
    force = study.rows["P"].sum(axis=1)
    assert np.all(np.diff(force) < 0.0) and Q < F * force[-1] < Q * (1.0 + 1e-3)


def test_nothing_wears_where_the_limit_cycle_has_no_slip() -> None:
    # shear in proportion to the pressing force
    rows = ["history.rows=[[1.0, 0.3]]", "history.cycle_rows=[[0.5, 0.15], [1.0, 0.3]]"]
    study = worn(cylinders(30, *rows))
    assert study.end == "shakedown" and study.cycles.tolist() == [0.0]
    assert study.dissipation_per_cycle[0] == 0.0


def test_gross_slip_wears_as_archard_says_explicitly_and_implicitly() -> None:
    # a stroke of one per cent of the contact, far beyond the slip before all nodes slide
    scene = sliding(30, 0.05, "contact.friction=0.002", "wear.cycles=1600")
    study = worn(scene)
    pairs = pairs_of(scene)
    row = pairs.begin()
    assert not np.any(row["zone"] == rf.State.STICK)
    for _ in range(40):
        row = pairs.settled(row, 40.0 * pairs.rate * row["energy"])
    assert np.abs(study.depth[-1] - row["depth"]).max() < 0.01 * row["depth"].max()
    # Archard: friction times pressure times sliding distance at every node, to round-off
    archard = 0.002 * study.rows["P"] * study.rows["path"]
    assert study.rows["energy"] == pytest.approx(archard, rel=1e-9, abs=1e-12 * archard.max())
    path = study.slip[0][study.pressure[0] > 0.0].max()
    assert study.volume[-1] == pytest.approx(1600 * C * 0.002 * P * path, rel=2e-3)


@pytest.mark.parametrize("kind", ["whole", "half", "round", "two edges"])
def test_numbers_of_a_wear_study_are_those_of_its_rows(kind: str) -> None:
    """Of made-up rows and coarser ones; the deepest node is the middle or the axis, then an end."""
    half, middle = kind == "half", 0 if kind in ("half", "round") else 2
    rng = np.random.default_rng(1)

    def made(elements: int, cycles: list[float]) -> rf.WearStudy:
        system = models.block_system(elements, 4, half=middle == 0)
        system, n = replace(system, half=half, axisymmetric=kind == "round"), system.n
        rows, end = np.zeros(len(cycles), row_type(n)), -1
        if kind == "two edges":
            system, end = replace(system, edge=np.repeat([0, 1], [n // 2 + 1, n // 2])), n // 2
        for name in ("depth", "estimate", "energy", "dissipated", "path"):
            rows[name] = rng.uniform(0.5, 1.0, rows[name].shape)
        rows["cycles"], rows["zone"] = cycles, rng.choice([1, 2, 3], rows["zone"].shape)
        rows["depth"][0], rows["depth"][1:, [0, -1]] = 0.0, 1e-4
        rows["depth"][[1, 2], [middle, end]] = 1.5, 2.0
        model: Any = SimpleNamespace(whole=SimpleNamespace(system=system), carried=False)
        return rf.WearStudy(model, [*rows], 0.3, "cycles done")

    coarse, fine = made(8, [0.0, 5.0, 8.0]), made(16, [0.0, 5.0, 8.0, 9.0])
    study = rf.WearStudy(fine.model, [*fine.rows], 0.3, "cycles done", coarse)
    row, own = study.rows, study.system
    factor = {"half": 2.0, "round": 2.0 * np.pi}.get(kind, 1.0)

    def whole(a: np.ndarray, sign: int = 1) -> np.ndarray:
        return np.hstack([sign * a[..., :0:-1], a]) if half else a

    gaps = np.diff(whole(own.x, -1)) * (np.diff(own.edges) == 0 if kind == "two edges" else 1.0)
    length, depth = 0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps)), whole(row["depth"])
    zone = whole(row["zone"])
    known = {
        "depth_of_bodies": np.stack([0.3 * depth, 0.7 * depth], axis=1),
        "dissipation_per_cycle": factor * row["energy"].sum(axis=1),
        "dissipation": factor * row["dissipated"],
        "slip": whole(row["path"]),
        "volume": factor * row["depth"] @ own.weight,
        "width": (depth > 1e-3 * depth.max(axis=1)[:, None]) @ length,
        "contact_half_width": 0.5 * (zone != 2) @ length,
        "stick_half_width": 0.5 * (zone == 1) @ length,
    }
    # meshes of twice the size: errors of first order; the last coarse row stands for later ones
    both = [(getattr(coarse, k)[[0, 1, 2, 2]], getattr(study, k)) for k in ("volume", "depth_max")]
    by_mesh = np.append(0.0, np.max([np.abs(1.0 - a[1:] / b[1:]) for a, b in both], axis=0))
    known["volume_estimate"] = factor * row["estimate"] @ own.weight + by_mesh * study.volume
    for name, values in known.items():
        assert getattr(study, name) == pytest.approx(values, rel=1e-12), name
    # at an end of an edge the depth grows with every finer mesh
    assert np.isinf(study.depth_estimate).tolist() == [False, False, True, False]
    bend = abs(row["depth"][1][[abs(middle - 1), middle + 1]].sum() - 3.0) / 8.0
    error = row["estimate"][1].max() + 1.5 * by_mesh[1] + bend
    assert study.depth_estimate[1] == pytest.approx(error)


def test_a_scar_that_grows_into_coarse_elements_ends_a_study() -> None:
    """From the nodes at -1, 0 and 1 to those at -2 and 2, beside the last elements."""
    for far, end in ((4.0, "cycles done"), (5.0, "contact past the fine mesh")):
        xs = np.array([-far, -2.0, -1.0, 0.0, 1.0, 2.0, far])
        rows = np.zeros(2, row_type(7))
        rows["energy"], rows["zone"] = 1.0, 2
        rows["zone"][0, 2:5] = rows["zone"][1, 1:6] = 3
        assert _end(models.grid_system(xs, np.array([0.0, 1.0])), list(rows), 0.0, np.inf) == end


CAPPED, STICKY = "contact.shear_limit=0.2", "contact.cohesion=0.04"


@pytest.mark.parametrize("law", [[], [STICKY], [CAPPED], [STICKY, CAPPED]])
def test_an_implicit_step_wears_by_the_limit_of_the_pressure_at_its_end(law: list[str]) -> None:
    """Under a constant force; what is at the shear limit keeps it in a step."""
    pairs = pairs_of(partial(40, 0.37, *law))
    row, system, n = pairs.begin(), pairs.problem.system, pairs.problem.system.n
    depth = pairs.increments(row, 200.0)
    load = system.r_star[0, n:] + system.K[n:, :n] @ row["v"]
    m, held, K = system.weight, system.held[n:], system.K[n:, n:]
    P = pressures(K, load, system.g0 + depth, np.zeros(n), row["P"] > 0.0, held)
    sticky, most = 0.04 * m * (STICKY in law), (0.2 * m if CAPPED in law else np.inf)
    before, after = (F * each + sticky for each in (row["P"], P))
    limit = np.where(before > most, most, after)
    wears = row["energy"] > 0.0
    assert (CAPPED in law) == np.any(wears & (before > most))
    known = np.where(wears, 200.0 * pairs.rate * row["path"] * limit, 0.0)
    assert depth == pytest.approx(known, rel=1e-9, abs=1e-12 * depth.max())


def test_nodes_that_open_where_the_pressure_is_read_wear_by_their_dissipation() -> None:
    pairs = pairs_of(cylinders(30))
    row = pairs.begin()
    node = int(np.argmax(row["energy"]))
    for P in (0.0, 1e-6 * row["P"][node]):
        row["P"][node] = P
        depth = pairs.increments(row, 10.0)[node]
        assert depth == pytest.approx(10.0 * pairs.rate[node] * row["energy"][node], rel=1e-12)


def test_steps_of_a_singular_system_fail_as_a_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = pairs_of(cylinders(20))
    monkeypatch.setattr(pairs, "increments", lambda *_: np.linalg.inv(np.zeros((1, 1))))
    with pytest.raises(rf.SolveError, match="Singular matrix"):
        advance(pairs, pairs.begin(), 0.2, 100.0)


def test_carried_profiles_become_node_pairs_for_small_strokes() -> None:
    scene = rf.from_toml(rf.to_toml(sliding(60, 0.1)) + PROBE)
    pairs = pairs_of(scene)
    first = pairs.begin()
    pairs.slip_at_corners *= 1e-3
    carried = Convected(pairs, 0.3, A)
    # the same sliding distance
    carried.positions = [(load, s, 1e3 * way) for load, s, way in carried.positions]
    row = carried.settled(first, np.zeros(2 * len(first["P"])))
    assert row["energy"].sum() == pytest.approx(first["energy"].sum(), rel=0.02)
    rows = []
    for model, row in ((pairs, first), (carried, row)):
        row = row.copy()
        row["step"] = 5.0
        while row["cycles"] < 40.0:
            row = advance(model, row, 0.05, 40.0)
        rows.append(row)
    assert np.abs(rows[0]["depth"] - rows[1]["depth"]).max() < 0.03 * rows[0]["depth"].max()
    worn = rows[1]["worn"].sum(axis=1)
    assert worn[0] / worn.sum() == pytest.approx(0.3, rel=1e-9)
    study = rf.WearStudy(carried, rows[1:], 0.3, "cycles done")
    assert np.array_equal(study.depth_of_bodies[0], rows[1]["worn"])
    assert study.fatigue() == [] and "(steps)\n" in repr(study)
    with pytest.raises(rf.InputError, match="that a stroke carries along have no single cycle"):
        study.record(0)
    # the second body wears where the first one has moved to
    moved = Convected(pairs, 0.3, A)
    moved.positions = [(carried.positions[0][0], 0.2 * A, 1.0)]
    depth, x = moved.increments(first, 1e-6)[len(first["P"]) :], study.system.x
    assert depth @ x / depth.sum() == pytest.approx(0.2 * A, rel=1e-2)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), rf.SolveError("fails once")])
def test_a_kill_or_failure_and_resume_repeat_an_undisturbed_study_bit_by_bit(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = cylinders(40, "wear.cycles=5000", "wear.share=0.3")
    said: list[str] = []
    whole = worn(scene, tmp_path / "whole", rf.StudyOptions(progress=said.append))
    for depth in whole.depth_max[1:]:
        assert any(f", depth {depth:.4g}" in text for text in said), (depth, said)

    def stop(model: NodePairs, row: Any, *options: float) -> Any:
        if row["cycles"] > 1500:
            raise error
        return advance(model, row, *options)

    with monkeypatch.context() as patch:
        patch.setattr("receding_fenicsx.studies.wear.study.advance", stop)
        with pytest.raises((rf.Interrupted, rf.SolveError), match=r"--resume|fails once"):
            rf.wear(scene, tmp_path / "cut")
    with open(tmp_path / "cut" / "cases.jsonl", "ab") as file:
        file.write(b"torn")
    again = worn(scene, tmp_path / "cut", rf.StudyOptions(resume=True))
    assert again.rows.tobytes() == whole.rows.tobytes()
    rows = list(csv.DictReader((tmp_path / "cut" / "wear.csv").read_text().splitlines()))
    assert len(rows) == len(whole.rows) and len(rows[0]) == 7
    for name in rows[0]:
        assert [float(row[name]) for row in rows] == getattr(whole, name).tolist(), name
    with np.load(tmp_path / "cut" / "wear.npz") as arrays:
        assert len(arrays) == 10
        for name, values in arrays.items():
            assert np.array_equal(values, getattr(whole, name)), name
    summary = json.loads((tmp_path / "cut" / "wear.json").read_text())
    known = {"title": scene.title, "end": "cycles done", "steps": len(rows) - 1, "carried": False}
    known |= {"fatigue": [], "dissipation_per_cycle": whole.dissipation_per_cycle.tolist()}
    errors = {"depth_max": whole.depth_estimate[-1], "volume": whole.volume_estimate[-1]}
    names = "depth", "depth_of_bodies", "pressure", "slip"
    profile = {name: getattr(whole, name)[-1].tolist() for name in names} | {"x": whole.x.tolist()}
    known |= whole.last | {"estimates": errors, "profile": profile}
    assert summary == known | {key: summary[key] for key in ("timings", "versions")}
    # nothing that is summed over the steps falls
    for name in ("cycles", "dissipated", "depth", "estimate", "force"):
        assert np.all(np.diff(whole.rows[name], axis=0) >= 0.0), name
    depth, volume = (getattr(whole, f"{name}_estimate")[-1] for name in ("depth", "volume"))
    contact, stick = (getattr(whole, f"{name}_half_width")[-1] for name in ("contact", "stick"))
    assert [" ".join(line.split()) for line in repr(whole).splitlines()] == [
        f"Wear: 5000 cycles in {len(rows) - 1} steps",
        "end cycles done",
        f"depth {whole.depth_max[-1]:.6g} +- {depth:.1g} (steps, mesh)",
        f"volume {whole.volume[-1]:.6g} +- {volume:.1g} (steps, mesh)",
        f"scar {whole.width[-1]:.6g} wide",
        f"half widths contact {contact:.6g}, stick {stick:.6g}",
        f"dissipation {whole.dissipation[-1]:.6g}",
    ]
    # a study for more or fewer cycles has its steps, but for the last one, which ends the study
    for cycles in (6000.0, 3000.0):
        changed = replace(scene, wear=replace(scene.wear, cycles=int(cycles)))
        other = worn(changed, tmp_path / "cut", rf.StudyOptions(resume=True))
        shared = min(len(other.rows), len(whole.rows)) - 1
        assert other.cycles[-1] == cycles and 5000.0 not in other.cycles
        assert other.rows[:shared].tobytes() == whole.rows[:shared].tobytes()


SOFT = "material.young=10.0"
STIFF = ["material.blade.young=60.0", "material.disc.young=100.0"]
WORN = {
    "round": ("block", ['material.kinematics="axisymmetric"', "load.p0.span=[0.0, 1.0]", SOFT]),
    "two meshed bodies": ("lap_joint", []),
    "limited": ("block", ["contact.shear_limit=0.2", SOFT]),
    "Archard": ("block", ["wear.archard=1e-9", "contact.friction=0.3 + 0.02*x**2", SOFT]),
    "two contact edges": ("dovetail", STIFF),
}


@pytest.mark.parametrize("name", WORN)
def test_all_scenes_wear_off_what_the_limit_cycle_of_a_run_dissipates(name: str) -> None:
    file, changes = WORN[name]
    wear = ["wear.cycles=2", "mesh.contact_elements=24"]
    wear += ["wear.coefficient=1e-9"] * (name != "Archard")
    scene = rf.read_scene(ROOT / "demos" / f"{file}.toml", [*wear, *changes])
    study = worn(scene)
    limit = replace(scene.history, until="limit", cycles=60)
    record = rf.evolve(rf.given(rf.condense(scene)), replace(scene, history=limit))
    energy = record.cycles.dissipation_density[-1] * record.weight
    worn_by = 1e-9 / (record.f if scene.wear.archard else 1.0)
    assert study.volume[-1] == pytest.approx(2.0 * np.sum(worn_by * energy), 1e-6, 0.0)


def test_a_sweep_has_the_wear_life_of_its_cases(tmp_path: Path) -> None:
    table = rf.sweep(
        cylinders(40, "wear.cycles=1000000", "wear.depth=6e-4"),
        {"wear.coefficient": [1e-3, 2e-3], "contact.friction": [0.5, 0.8]},
    )
    assert table is not None and set(table["wear_end"]) == {"depth reached"}
    assert np.asarray(table["wear_depth_max"], float) == pytest.approx(6e-4, rel=1.01e-3)
    assert np.all(np.asarray(table["wear_volume_estimate"], float) > 0.0)  # of the last step
    life = table.grid("wear_cycles").astype(float)
    # a coefficient only scales the cycles; with more friction less slips
    assert life[0] == pytest.approx(2.0 * life[1], rel=0.02)
    assert np.all(life[:, 1] > 1.2 * life[:, 0])
    scene = cylinders(40, "wear.cycles=1000000", "wear.depth=6e-4")
    scene = replace(scene, wear=replace(scene.wear, coefficient=None, archard=F * C))
    curve = rf.joint_curve(scene, "Q", [0.3, 0.36, 0.7], tmp_path / "curve")
    assert curve is not None
    # the first amplitude is the shear of the sweep
    rows = curve.rows()
    assert rows[0]["wear_cycles"] == pytest.approx(life[0, 0], rel=1e-6)
    assert rows[1]["wear_cycles"] < rows[0]["wear_cycles"]
    # one beyond gross sliding has none
    assert rows[2]["wear_cycles"] is None and "sliding" in rows[2]["error"]
    with (tmp_path / "curve" / "joint.csv").open() as file:
        assert [bool(row["wear_cycles"]) for row in csv.DictReader(file)] == [True, True, False]


def test_a_worn_contact_has_the_record_and_the_fatigue_of_a_run() -> None:
    scene = rf.from_toml(rf.to_toml(cylinders(40, "wear.cycles=8000")) + PROBE)
    study = worn(scene)
    for k in (0, len(study.rows) - 1):
        record = study.record(k)
        assert record.cycles.dissipation[-1] == pytest.approx(study.dissipation_per_cycle[k])
        pressure = record.turning_points.p[-1]
        assert pressure == pytest.approx(study.pressure[k], abs=1e-9 * pressure.max())
    run = rf.run(scene)
    assert run is not None
    known = rf.summarise(run)["fatigue"]["parameters"]
    found = study.fatigue()
    assert found[0]["cycles"] == 0.0 and found[-1]["cycles"] == 8000.0
    for name, row in known.items():
        assert found[0]["parameters"][name]["max"] == pytest.approx(row["max"], rel=1e-6), name
    assert len(found) == min(11, len(study.rows))
    drawn = figures(study, found)
    check_figures(drawn.items(), REPORTS / "wear.txt")
    # worn depth points downwards
    for axes, field in zip(drawn["profiles.png"].axes, (study.pressure, -study.depth), strict=True):
        check_curves(axes, *((study.x, field[row]) for row in study.shown(5)))
    zones: Any = drawn["zones.png"].axes[0].collections[0]
    assert np.array_equal(zones.get_array(), study.zone)
    ends = zones.get_coordinates()[:, 0, 1]
    assert ends[:-1].tolist() == study.cycles.tolist()
    worst = [[one["parameters"][name]["max"] for one in found] for name in known]
    cycles = [one["cycles"] for one in found]
    lines = ((cycles, np.array(values) / values[0]) for values in worst if values[0] > 0.0)
    check_curves(drawn["fatigue.png"].axes[0], *lines)
    # wear moves the worst point from the edge of the contact to that of the stick zone
    places = [abs(one["parameters"]["swt"]["x"]) for one in found]
    assert places[0] > 0.95 * A and places[-1] < study.stick_half_width[-1] + 0.1


@pytest.mark.one_rank(False)
def test_half_and_whole_bodies_wear_alike_and_end_at_the_edge_of_the_mesh() -> None:
    block = ROOT / "demos" / "block.toml"
    changes = ["mesh.contact_elements=40", "wear.coefficient=1e-3"]
    symmetries = "solver.symmetry=auto", "solver.symmetry=none"
    half, whole = (rf.wear(rf.read_scene(block, [*changes, each])) for each in symmetries)
    if half is None or whole is None:
        return
    assert half.end == whole.end == "contact past the fine mesh"
    assert np.abs(half.depth[-1] - whole.depth[-1]).max() < 1e-6 * whole.depth.max()
    assert half.last == pytest.approx(whole.last, rel=1e-6)


@pytest.mark.one_rank(False)
def test_steps_that_a_tolerance_does_not_allow_keep_the_table(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sets = ["mesh.contact_elements=30", "wear.coefficient=1e-3", "wear.cycles=100"]
    words = [f"--set={change}" for change in [*sets, "wear.tolerance=1e-9"]]
    out = comm.bcast(tmp_path) / "out"
    assert cli.main(["wear", str(CYLINDERS), "--out", str(out), *words]) == 1
    error = capfd.readouterr().err
    if comm.rank == 0:
        # before it may stand that the event loop is compiled
        assert "raise the tolerance" in error.splitlines()[-1]
        assert (out / "wear.csv").exists()
        told = json.loads((out / "wear.json").read_text())["failure"]
        assert told in error and "raise the tolerance" in told


@pytest.mark.one_rank(False)
def test_wear_needs_a_small_stroke_or_known_profiles() -> None:
    with pytest.raises(rf.InputError, match=r"is 0\.\d+ of the contact's width"):
        rf.wear(sliding(30, 1.0, "material.lower.young=100.0"))


def test_the_stroke_is_judged_on_each_contact_edge() -> None:
    wear = ["wear.coefficient=1e-9", "wear.cycles=2", "mesh.contact_elements=24"]
    scene = rf.read_scene(ROOT / "demos" / "dovetail.toml", [*wear, *STIFF])
    study = worn(scene)
    half = study.contact_half_width[0]  # two flanks alike
    stroke = 0.5 * study.slip[0][study.pressure[0] > 0.0].max()
    for ratio in (0.04, 0.07):
        factor = float(stroke / half) / ratio
        soft = tuple(replace(m, young=m.young * factor) for m in scene.materials)
        changed = replace(scene, materials=soft)
        if ratio < 0.05:
            assert worn(changed).end == "cycles done"
        else:
            with pytest.raises(rf.InputError, match=r"is 0\.07 of the contact's width"):
                rf.wear(changed)


@pytest.mark.parametrize(
    ("study", "passed"),
    [
        (rf.run, MeshMisfit("no vertex")),
        (rf.run, rf.NoEquilibrium("the coarser body slides")),
        (lambda scene: rf.run(scene, options=rf.RunOptions(tolerance=0.3)), MeshMisfit("none")),
        (rf.wear, MeshMisfit("no vertex")),
        (lambda scene: rf.joint_curve(scene, "Q", [0.3 * F * P]), MeshMisfit("no vertex")),
    ],
)
def test_only_what_a_coarser_mesh_lacks_is_passed_over(
    study: Callable[[rf.Scene], object], passed: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = rf.from_toml(rf.to_toml(cylinders(16, "wear.cycles=1")) + PROBE)
    refuse = Mock(side_effect=passed)
    monkeypatch.setattr("receding_fenicsx.studies.accuracy.meshes.count_nodes", refuse)
    assert study(scene) is not None
    refuse.side_effect = rf.InputError("not of the mesh")
    with pytest.raises(rf.InputError, match="not of the mesh"):
        study(scene)
