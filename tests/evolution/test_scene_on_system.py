"""Scenes played on a body that is condensed already, as ``evolve(system, scene)``."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from small import assert_same_bits

from receding_fenicsx import condense, evolve, given, read_scene, run
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve_bare
from receding_fenicsx.evolution.replay import instant_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import to_toml

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[2]
COARSE = ["mesh.contact_elements=24", "history.cycles=2", "output.samples_per_leg=3"]
CHANGES = {
    "friction": ["contact.friction=0.2*max(abs(x) - 0.3, 0)"],
    "no friction": ["contact.friction=0.0"],
    "gap": ["contact.initial_gap=0.01*x**2"],
    "history": ["history.minimum=0.7", "history.maximum=2.0"],
    "solver": ["solver.method=gauss-seidel", "solver.steps_per_leg=6"],
    "output": ["output.samples_per_leg=5", "output.cycles=[1]"],
    "initial slip": ["history.initial_slip=0.02*x"],
    "checkpoints": ["history.cycles=5", "output.checkpoint_cycles=2"],
}


def block(*changes: str) -> Scene:
    return read_scene(ROOT / "demos" / "block.toml", [*COARSE, *changes])


@cache
def body() -> ContactSystem:
    return given(condense(block()))


@pytest.mark.parametrize("change", CHANGES)
def test_a_scene_on_a_condensed_body_is_the_whole_run_of_that_scene(change: str) -> None:
    scene = block(*CHANGES[change])
    whole = given(run(scene))
    again = evolve(body(), scene)
    assert again.scene_toml == to_toml(scene)
    assert_same_bits(again, whole)
    # and the change has changed something
    plain = evolve(body(), block())
    ends = plain.turning_points.P.tobytes(), plain.samples.s.tobytes()
    assert ends != (again.turning_points.P.tobytes(), again.samples.s.tobytes())


def test_only_the_first_leg_after_an_initial_slip_is_known_at_its_end_alone() -> None:
    scene = block(*CHANGES["initial slip"])
    record = evolve(body(), scene)
    found = instant_of(scene, body(), record, 1, "unloading", 1 / 3)
    wanted = record.at(1, leg=0, s=1 / 3).v[record.x >= 0.0]
    np.testing.assert_allclose(found.v, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
    with pytest.raises(InputError, match="initial_slip is one jump"):
        instant_of(scene, body(), record, 0, "loading", 1 / 3)


def test_a_bare_evolution_has_the_states_of_the_whole_one() -> None:
    whole, bare = evolve(body(), block()), evolve_bare(body(), block())
    for field in ("cycle", "P", "Q", "v", "w", "load_displacement"):
        wanted, found = (getattr(record.turning_points, field) for record in (whole, bare))
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(bare.cycles.dissipation, whole.cycles.dissipation, rtol=1e-12)
    assert not len(bare.samples.s) and not len(bare.events.s)
    # that it is the only path is not known
    assert whole.uniqueness is not None and whole.uniqueness.certified
    assert bare.uniqueness is not None and not bare.uniqueness.certified
    assert np.isnan(bare.uniqueness.margin)
