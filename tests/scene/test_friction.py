"""Friction of a scene that differs between forward and backward slip."""

import re
from pathlib import Path

from mpi4py import MPI

import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
COARSE = ["mesh.contact_elements=24", "history.cycles=2", "output.samples_per_leg=3"]


def block(friction: str, *changes: str) -> rf.Scene:
    return rf.read_scene(BLOCK, [*COARSE, f"contact.friction={friction}", *changes])


def test_values_of_a_direction_may_come_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "f.csv").write_text("-2, 0.1\n2, 0.3\n")
    both = 'friction = {forward = {file = "f.csv"}, backward = 1}'
    text = re.sub("friction *=.*", both, BLOCK.read_text())
    (tmp_path / "scene.toml").write_text(text)
    friction = rf.read_scene(tmp_path / "scene.toml").contacts[0].friction
    assert friction == {"forward": {"x": [-2.0, 2.0], "value": [0.1, 0.3]}, "backward": 1.0}


def test_one_direction_is_set_and_the_other_one_kept() -> None:
    def friction(*changes: str) -> object:
        return rf.read_scene(BLOCK, changes).contacts[0].friction

    assert friction("contact.friction.forward=0.2") == {"forward": 0.2, "backward": 0.35}
    both = friction("contact.friction.forward=0.2", "contact.1.friction.backward=0.3 + 0.1*x")
    assert both == {"forward": 0.2, "backward": "0.3 + 0.1*x"}
    table = "contact.friction={x = [-2, 2], value = [0.1, 0.3]}"
    kept = {"x": [-2.0, 2.0], "value": [0.1, 0.3]}
    assert friction(table, "contact.friction.backward=1") == {"forward": kept, "backward": 1.0}
    default = rf.from_toml(
        '[[load]]\nname = "p"\nedge = "top"\npressure = 1', ["contact.friction.forward=0.2"]
    )
    assert default.contacts[0].friction == {"forward": 0.2, "backward": rf.Contact().friction}
    for wrong in ("contact.friction.forwards=0.2", "contact.friction.x=[0, 1]"):
        with pytest.raises(rf.InputError, match=r"unknown key .*forward"):
            friction(wrong)


def test_record_and_figures_of_friction_with_two_directions(tmp_path: Path) -> None:
    scene = block("{forward = 0.4, backward = 0.1}")
    record = rf.run(scene, tmp_path / "run", rf.RunOptions(pictures=True, snapshots=False))
    assert record is not None and not record.half and record.f_backward is not None
    pressed = record.at(cycle=-1, load="maximum")
    ahead, back = (pressed.state == s for s in (rf.State.FORWARD_SLIP, rf.State.BACKWARD_SLIP))
    assert ahead.any() and back.any()
    assert pressed.Q[ahead] == pytest.approx(-0.4 * pressed.P[ahead], rel=1e-9)
    assert pressed.Q[back] == pytest.approx(0.1 * pressed.P[back], rel=1e-9)


def test_no_ratio_is_told_of_a_dissipation_that_is_round_off() -> None:
    # without friction in one direction nothing resists a free body: Q = 0 at all nodes
    for backward, dissipates in ((0.3, True), (0.0, False)):
        scene = block(f"{{forward = 0.3, backward = {backward}}}", "history.cycles=3")
        system = rf.condense(scene, MPI.COMM_SELF)
        assert system is not None
        record = rf.evolve(system, scene)
        summary = rf.summarise(record)
        assert record.dissipates == summary["dissipates"] == dissipates
        assert ("of cycle 3 over cycle 1" in rf.run_table(summary)) == dissipates
        assert ("dissipation_ratio" in rf.headline(record)) == dissipates
        assert (record.cycles.dissipation[0] > 1e-3) == dissipates
