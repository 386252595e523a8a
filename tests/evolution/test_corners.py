"""Harmonic histories: corners by doubling, against closed forms and an independent integration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from small import small_system

from receding_fenicsx import condense, evolve, run, summarise
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution import histories
from receding_fenicsx.evolution.histories import CORNERS, with_corners
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import Contact, Harmonic, HistoryOptions, Load, Scene
from receding_fenicsx.scene.toml_file import from_toml, to_toml
from receding_fenicsx.studies.run import RunOptions

comm = MPI.COMM_WORLD
ROOT = Path(__file__).parents[2]
QUADRATURE = {"P": Harmonic(1.0, 0.3), "Q": Harmonic(0.0, 0.3, 90.0)}


def harmonic(loads: dict[str, Harmonic], **options: Any) -> HistoryOptions:
    return replace(HistoryOptions(kind="harmonic", cycles=2, harmonic=loads), **options)


@cache
def cylinders() -> tuple[Scene, ContactSystem]:
    """Cattaneo and Mindlin's contact, coarse; on every rank by itself."""
    text = (ROOT / "demos" / "cattaneo_mindlin.toml").read_text()
    changes = ["mesh.contact_elements=60", "output.samples_per_leg=1"]
    scene = from_toml(text, changes, ROOT / "demos")
    return scene, given(condense(scene, MPI.COMM_SELF))


# -- a block on a spring, followed by hand -------------------------------------------------------

STIFFNESS, FRICTION = 2.0, 0.4
SPRING = {"P": Harmonic(1.0, 0.5), "Q": Harmonic(0.1, 1.2, 70.0)}


def spring() -> tuple[Scene, ContactSystem]:
    """One node: Q = -k v + lambda_Q, P = lambda_P."""
    scene = Scene(
        contacts=(Contact(friction=FRICTION),),
        loads=(Load("P", "top", pressure=1.0), Load("Q", "top", traction=(1.0, 0.0))),
        history=harmonic(SPRING, cycles=3),
    )
    K = np.diag([STIFFNESS, 1.0])
    system = small_system(K, {"P": [0.0, 1.0], "Q": [-1.0, 0.0]}, FRICTION)
    return scene, replace(system, scene_toml=to_toml(scene))


def stepped(steps: int = 40_000) -> float:
    """Dissipation of the third cycle in small steps: the spring's force returns to the limit."""
    angle = 2.0 * np.pi * np.arange(3 * steps + 1) / steps
    P, Q = (
        load.mean + load.amplitude * np.cos(angle - np.radians(load.phase))
        for load in SPRING.values()
    )
    v = total = 0.0
    for k, (limit, pull) in enumerate(zip((FRICTION * P).tolist(), Q.tolist(), strict=True)):
        force = pull - STIFFNESS * v
        if abs(force) > limit:
            slip = (abs(force) - limit) / STIFFNESS * np.sign(force)
            v += slip
            total += limit * abs(slip) if k > 2 * steps else 0.0
    return total


@pytest.mark.one_rank
def test_error_of_the_polygon_falls_with_the_square_of_the_corners() -> None:
    scene, system = spring()
    known = stepped()
    found = []
    for number in (32, 128, 512):
        fixed = replace(scene, history=replace(scene.history, corners=number))
        found.append(evolve(system, fixed).cycles.dissipation[-1])
    errors = np.abs(np.array(found) - known) / known
    assert errors[-1] < 2e-5
    assert errors[0] / errors[-1] > 0.5 * 16.0**2
    refined, doubling = with_corners(system, scene)
    assert doubling is not None and doubling[-1, 1] <= 1e-3 < doubling[-2, 1]
    record = evolve(system, scene)
    assert abs(record.cycles.dissipation[-1] - known) <= doubling[-1, 1] * known
    # what was found is told, and is the scene of the record
    number, error = doubling[-1]
    assert record.scene is not None and record.scene.history.corners == number
    assert refined.history.corners == number
    told = summarise(record)["harmonic"]
    assert told.pop("doubling")[-1] == [number, error]
    assert told == {"corners": number, "error_estimate": error, "tolerance": 1e-3}


@pytest.mark.one_rank
def test_tolerance_out_of_reach_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, system = spring()
    monkeypatch.setattr(histories, "MOST_CORNERS", 64)
    with pytest.raises(SolveError, match="with 64 corners the error estimate") as caught:
        with_corners(system, replace(scene, history=replace(scene.history, tolerance=1e-9)))
    assert "\n" not in str(caught.value)


# -- runs ----------------------------------------------------------------------------------------


def test_resumed_run_keeps_its_corners(shared_tmp_path: Path) -> None:
    scene, _ = cylinders()
    scene = replace(scene, history=harmonic(QUADRATURE, tolerance=0.05))
    out = shared_tmp_path / "run"
    first = run(scene, out, RunOptions(pictures=False))
    more = replace(scene, history=replace(scene.history, cycles=4))
    resumed = run(more, out, RunOptions(pictures=False, resume=True))
    assert (out / CORNERS).is_file()
    if comm.rank:
        return
    assert first is not None and first.doubling is not None
    assert resumed is not None and resumed.doubling is not None and resumed.scene is not None
    np.testing.assert_array_equal(first.doubling, resumed.doubling)
    np.testing.assert_array_equal(
        resumed.cycles.dissipation[: len(first.cycles.dissipation)], first.cycles.dissipation
    )
    _, system = cylinders()
    whole = evolve(system, resumed.scene)
    np.testing.assert_allclose(whole.cycles.dissipation, resumed.cycles.dissipation, rtol=1e-12)
    (out / CORNERS).write_text("16 corners\n")
    with pytest.raises(InputError, match="is damaged"):
        run(
            replace(more, history=replace(more.history, cycles=5)),
            out,
            RunOptions(pictures=False, resume=True),
            MPI.COMM_SELF,
        )
