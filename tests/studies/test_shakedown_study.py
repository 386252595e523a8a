"""Shakedown studies of scenes: command, files, two meshes, diagram, exact cycles, many starts."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block
from drawn_text import REPORTS, check_area, check_curves, check_figures, check_words
from shakedown_cases import LOWER, TO_AND_FRO, UPPER, two_nodes
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.interface.shakedown.margins import load_range, prepared, with_bound
from receding_fenicsx.interface.shakedown.opening import Opening
from receding_fenicsx.output.report.run import limit_rows
from receding_fenicsx.store.workspace import Case, CaseFile, Outcome
from receding_fenicsx.studies.shakedown.study import _files, diagram_figure, limits_at
from receding_fenicsx.studies.starts import starts_summary, steady_states_figure

SCENE = rf.to_toml(
    block(
        body=rf.Body(width=2.0),
        material=rf.Material(),
        contacts=(rf.Contact(friction=0.5),),
        loads=(rf.Load("press", "top", pressure=1.0), rf.Load("shear", "top", traction=(1.0, 0.0))),
        history=rf.HistoryOptions(
            "table",
            columns=("press", "shear"),
            cycle_rows=((1.0, 0.1), (1.0, -0.1), (1.0, 0.1)),
            cycles=5,
        ),
        shakedown=rf.ShakedownOptions({"press": 1.0}, ({"shear": 1.0}, {"shear": -1.0})),
    )
)
root = MPI.COMM_WORLD.rank == 0
BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"


def scene_file(folder: Path) -> str:
    path = folder / "sheared.toml"
    rf.on_root(MPI.COMM_WORLD, lambda: path.write_text(SCENE))
    return str(path)


def test_command_writes_what_the_next_run_can_start_from(
    shared_tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = scene_file(shared_tmp_path), shared_tmp_path / "study"
    assert cli.main(["shakedown", file, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    summary = json.loads((out / "shakedown.json").read_text())
    assert (f"upper limit   {summary['upper']:.6g}" in printed) == root
    names = "shakedown.json shakedown.png safe_slip.csv scene.toml cases.jsonl shakedown_cases.json"
    assert {path.name for path in out.iterdir()} == {*names.split()}
    assert [mesh["nodes"] for mesh in summary["meshes"]] == [17, 9]
    assert any("falls as the mesh is refined" in note for note in summary["notes"])
    # the sheared block opens at its ends
    opening, (low, _) = summary["opening"], summary["by_cycles"]
    assert opening["value"] >= low > 1.01 * summary["upper"]
    assert opening["dissipation"] < 1e-12
    assert {0, 16} <= set(opening["opening_nodes"])
    assert (f"with opening  {opening['value']:.6g}" in printed) == root
    system, known = rf.condense(rf.read_scene(file)), None
    if system is not None:
        known = rf.shakedown_limits(system, {"press": 1.0}, [{"shear": 1.0}, {"shear": -1.0}])
        for key in ("lower", "lower_is", "upper", "opens", "residual", "gap"):
            assert summary[key] == getattr(known, key), key
        assert summary["active"] == [vars(active) for active in known.active]
        assert np.array_equal(summary["safe_slip"], known.safe_slip)
        assert summary["separated"] == system.x[known.separated].tolist()
    told = [summary[key] for key in ("mean", "symmetry", "modelled_nodes")]
    assert told == [{"press": 1.0}, "none", 17]
    profile = np.loadtxt(out / "safe_slip.csv", delimiter=",", skiprows=1)
    assert summary["safe_slip"] == profile[:, 1].tolist()
    diagram = summary["diagram"]
    middle = int(np.argmin(np.abs(diagram["mean"])))
    assert diagram["load"] == "shear"
    assert diagram["upper"][middle] == pytest.approx(summary["upper"], rel=1e-9)
    # the largest range is a concave function of the mean
    assert np.all(np.diff(diagram["upper"], 2) < 1e-9)
    changes = [f"history.initial_slip={{file = '{out / 'safe_slip.csv'}'}}"]
    shear = 0.99 * summary["upper"]
    changes += [f"history.cycle_rows=[[1.0, {shear}], [1.0, {-shear}], [1.0, {shear}]]"]
    record = rf.run(rf.read_scene(file, changes))
    if record is not None:
        assert np.all(record.cycles.dissipation == 0.0)


@pytest.mark.one_rank
def test_a_study_that_lost_cases_goes_on_in_other_processes_to_the_same_limits(
    tmp_path: Path,
) -> None:
    out = tmp_path / "study"
    command = ["shakedown", scene_file(tmp_path), "--out", str(out)]
    assert cli.main(command) == 0
    whole = json.loads((out / "shakedown.json").read_text())
    lines = (out / "cases.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) == 4  # the diagram, the second mesh, exact cycles, the opening contact
    (out / "cases.jsonl").write_bytes(b"".join(lines[1::2]))
    for line in lines[::2]:  # these failed
        case = Case(json.loads(line.partition(b" ")[2])["identity"])
        CaseFile(out).add(case, Outcome({}, "fails once"))
    assert cli.main([*command, "--resume", "--workers", "2"]) == 0
    again = json.loads((out / "shakedown.json").read_text())
    for name in ("mean", "lower", "upper"):
        known = whole["diagram"].pop(name)
        assert again["diagram"].pop(name) == pytest.approx(known, rel=1e-9), name
    assert all(again[key] == whole[key] for key in whole if key != "timings")


@pytest.mark.one_rank
def test_the_safe_slip_of_half_a_body_is_written_for_both_halves(tmp_path: Path) -> None:
    changes = ["mesh.contact_elements=8", 'shakedown.separated="stay"', "shakedown.mean={p0=1.0}"]
    changes += ["shakedown.range=[{p0=0.5}, {p0=-0.5}]"]
    options = [word for change in changes for word in ("--set", change)]
    out = tmp_path / "study"
    assert cli.main(["shakedown", str(BLOCK), *options, "--out", str(out)]) == 0
    x, slip = np.loadtxt(out / "safe_slip.csv", delimiter=",", skiprows=1).T
    assert x == pytest.approx(np.linspace(-2.0, 2.0, len(x))) and len(x) == 17
    assert np.array_equal(slip, -slip[::-1]) and slip.any()
    receding, half, *_ = json.loads((out / "shakedown.json").read_text())["notes"]
    assert receding == (
        "at an edge where the contact is free to recede the continuum slips at any load range: "
        "both limits are those of the mesh, and fall on finer ones"
    )
    assert half == "half of the body is modelled: the limits are those of mirror-symmetric slip"


def test_text_and_diagram_show_the_limits_at_the_mean_of_the_scene() -> None:
    # the diagram is over the first load that varies
    changes = ["mean={press=1.0, shear=0.1}", "range=[{press=0.0, shear=1.0}, {shear=-0.5}]"]
    scene = rf.from_toml(SCENE, [f"shakedown.{change}" for change in changes])
    found, few = rf.shakedown(scene), ["mesh.contact_elements=8", "shakedown.largest_slip=0.2"]
    pressed = rf.from_toml(SCENE, ['shakedown.diagram="press"', *few])
    other = rf.shakedown(pressed)
    if found is None or other is None:
        return
    bounded = other.diagram
    lowest = np.interp(bounded.given, bounded.mean, bounded.lower)
    assert bounded.load == "press" and lowest == pytest.approx(other.limits.lower, rel=0.02)
    slip, closed = np.linspace(-0.1, 0.2, other.system.n), np.arange(other.system.n) != 2
    opening = Opening(3.0, 3.0, slip, closed[None], True, True, 0.0)
    texts = list[str]()
    for of, study in ((scene, found), (pressed, replace(other, opening=opening))):
        told = _files(of, study, {})["shakedown.json"]
        keys = [key for key in told if key not in ("active", "safe_slip", "diagram", "notes")]
        texts += [*str(study).splitlines(), *(f"{key}: {told[key]}" for key in keys)]
    check_words(texts, REPORTS / "shakedown_told.txt")
    limits, diagram = found.limits, found.diagram
    assert diagram.given == 0.1 and limits.lower < 0.9 * limits.upper
    assert np.interp(0.1, diagram.mean, diagram.upper) == pytest.approx(limits.upper, rel=0.02)
    # a mean of 0.2 has a smaller limit by far
    assert np.interp(0.2, diagram.mean, diagram.upper) < 0.9 * limits.upper
    (_, *own), (nodes, lower, upper) = found.meshes
    assert own == [limits.lower, limits.upper]
    assert f"second mesh   {lower:.6g} and {upper:.6g} with {nodes} nodes" in str(found)
    check_figures([("diagram", diagram_figure(diagram))], REPORTS / "shakedown.txt")
    none = np.zeros((0, 0), dtype=bool)
    opening = Opening(1.1 * limits.upper, 4.0, np.zeros(0), none, True, False, 0.0)
    (axes,) = diagram_figure(diagram, opening).axes
    x, low, high = diagram.mean, diagram.lower, diagram.upper
    assert np.all(low < high)
    # to 1.5 times the largest load away, or to the mean that just can be held without a range
    assert x[0] == pytest.approx(0.1 - 1.5 * limits.upper, rel=5e-3)
    assert x[-1] < 0.1 + 1.4 * limits.upper and high[-1] < 0.05 * high.max()
    given = ([0.1, 0.1], [0.0, 1.0]), ([0.1], [1.1 * limits.upper])
    check_curves(axes, (x, high), (x, low), *given)
    for area, below, above in zip(axes.collections, (0.0 * x, low), (low, high), strict=True):
        check_area(area, x, below, above)


@pytest.mark.one_rank
def test_a_bound_of_slips_raises_the_lower_limits_of_a_diagram_and_keeps_the_upper_ones() -> None:
    system = two_nodes()
    margins = prepared(system, load_range(system, {"mean": 1.0}, TO_AND_FRO))[0]
    free, bounded = (
        np.array(limits_at(with_bound(margins, bound), 1, [0.0, 0.05, -9.0])["limits"]).T
        for bound in (None, 0.03)
    )
    assert np.all(bounded[0, :2] > free[0, :2])
    assert bounded[1] == pytest.approx(free[1], rel=1e-9, nan_ok=True)
    assert np.isnan([free[:, 2], bounded[:, 2]]).all()  # no slip holds this mean


# -- many starts ----------------------------------------------------------------------------------


def from_starts(system: rf.ContactSystem, factor: float, count: int = 41) -> rf.SteadyStates:
    loads = {"mean": 1.0}, TO_AND_FRO
    safe = rf.shakedown_limits(system, *loads).safe_slip_modelled
    return rf.steady_states(system, rf.range_history(system, *loads, factor), count, safe)


@pytest.mark.one_rank
def test_whether_it_slips_for_ever_depends_on_the_start_between_the_limits_only() -> None:
    factors = 0.99 * LOWER, 1.02 * LOWER, 0.99 * UPPER, 1.01 * UPPER
    found = [from_starts(two_nodes(), factor) for factor in factors]
    counts = [states.counts.get("cyclic slip", 0) for states in found]
    assert counts[0] == 0 < counts[1] < counts[2] < counts[3] == 41
    # below the upper limit the safe start dissipates nothing
    states = found[2]
    # what starts are called is what they are; random ones go both ways, from small to large
    one = np.abs(states.slips).max()
    named = {"rest": [0, 0], "forward": [1, 1], "backward": [-1, -1], "out": [-1, 1], "in": [1, -1]}
    for name, slip in named.items():
        assert states.slips[states.names.index(name)].tolist() == (one * np.array(slip)).tolist()
    random = states.slips[[name.startswith("random") for name in states.names]]
    assert 0.3 < np.mean(random > 0.0) < 0.7
    assert np.abs(random[:10]).max() < 0.05 * one < 0.3 * one < np.abs(random[-10:]).max()
    low, high = states.interval
    assert low == 0.0 < high
    assert np.isnan(replace(states, kind=("not reached",) * 41).interval).all()
    assert states.counts.keys() == {"shakedown", "cyclic slip"}
    counted = ", ".join(f"{count} {kind}" for kind, count in states.counts.items())
    assert [" ".join(line.split()) for line in repr(states).splitlines()] == [
        "SteadyStates from 41 starts",
        f"dissipation per cycle {low:.6g} to {high:.6g}",
        f"kinds {counted}",
    ]
    safe = states.names.index("safe")
    assert (states.dissipation[safe], states.zones(safe)) == (0.0, [("stick", 0.0, 1.0)])
    # each row is that of the path from its own slip
    history = rf.range_history(two_nodes(), {"mean": 1.0}, TO_AND_FRO, factors[2])
    for k in range(0, 41, 4):
        record = rf.evolve(two_nodes(), history, initial_slip=states.slips[k], until="limit")
        D = record.cycles.dissipation
        row = states.dissipation[k], states.kind[k], states.cycles[k]
        assert row == (D[-1], record.steady.kind, len(D)), states.names[k]
    summary = starts_summary(states)
    told = [summary[key] for key in ("same", "kinds", "nodes_that_differ")]
    assert told == [False, states.counts, np.any(states.state != states.state[0], axis=0).sum()]
    # the same: states, kinds and dissipation are those of one start, and none failed
    one_state = replace(states, dissipation=np.ones(41), kind=("cyclic slip",) * 41)
    one_state = replace(one_state, state=np.repeat(states.state[:1], 41, axis=0))
    mixed = ("cyclic slip",) * 40 + ("shakedown",)
    others = {"kind": mixed}, {"dissipation": np.linspace(1.0, 2.0, 41)}, {"state": states.state}
    verdicts = ({}, True), ({"errors": {"in": "lost"}}, None), *((other, False) for other in others)
    for changes, same in verdicts:
        assert starts_summary(replace(one_state, **changes))["same"] is same, changes
    none = starts_summary(replace(states, kind=("not reached",) * 41))
    assert none["dissipation"] is none["spread"] is None
    limit = {"reached": False, "cycle": 2, "reason": "", "starts": summary}
    assert limit_rows({"limit": limit})[1][0] == "limits from 41 initial slips differ"
    # a node that stays on its limit does not slip
    slips = np.isin(states.state, (rf.State.FORWARD_SLIP, rf.State.BACKWARD_SLIP)).any(axis=1)
    assert np.array_equal(slips, np.array(states.kind) != "shakedown")
    figure = steady_states_figure(states)
    check_figures([("starts", figure)], REPORTS / "starts.txt")
    order = np.argsort(states.dissipation, kind="stable")
    kinds, D = np.array(states.kind)[order], states.dissipation[order]
    of_kinds = [np.flatnonzero(kinds == kind) for kind in dict.fromkeys(kinds)]
    check_curves(figure.axes[0], *((D[rows], rows) for rows in of_kinds))
    cells: Any = figure.axes[1].collections[0]
    assert np.array_equal(cells.get_array(), states.state[order])


@pytest.mark.one_rank
@pytest.mark.parametrize("seed", range(4))
def test_dissipation_of_uncoupled_systems_does_not_depend_on_the_start(seed: int) -> None:
    # Barber, Davies & Hills (2011)
    rng, n = np.random.default_rng(seed), 5
    blocks = [G @ G.T / 8 + 0.2 * np.eye(n) for G in rng.standard_normal((2, n, 8))]
    K = np.kron(np.diag([1.0, 0.0]), blocks[0]) + np.kron(np.diag([0.0, 1.0]), blocks[1])
    loads = {
        "mean": np.concatenate([rng.uniform(-0.3, 0.3, n), rng.uniform(0.7, 1.3, n)]),
        "range": np.concatenate([rng.uniform(-1, 1, n), rng.uniform(-0.4, 0.4, n)]),
    }
    system = small_system(K, loads, rng.uniform(0.2, 0.6, n))
    limits = rf.shakedown_limits(system, {"mean": 1.0}, TO_AND_FRO)
    found = from_starts(system, 1.3 * limits.upper, 12)
    low, high = found.interval
    assert low > 0.0 and starts_summary(found)["same"]
    assert high == pytest.approx(low, rel=1e-9)
