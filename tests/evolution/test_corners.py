"""Harmonic histories: corners by doubling, against closed forms and an independent integration."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from small import small_system

from receding_fenicsx import evolve, given, summarise
from receding_fenicsx.errors import Interrupted, SolveError
from receding_fenicsx.evolution import histories
from receding_fenicsx.evolution.evolve import evolve_bare
from receding_fenicsx.evolution.histories import with_corners
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Contact, Harmonic, HistoryOptions, Load, Scene
from receding_fenicsx.scene.toml_file import to_toml
from receding_fenicsx.store.hdf5 import read_record
from receding_fenicsx.studies import run as study


def harmonic(loads: dict[str, Harmonic], **options: Any) -> HistoryOptions:
    return replace(HistoryOptions(kind="harmonic", cycles=2, harmonic=loads), **options)


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


@pytest.mark.once
@pytest.mark.one_rank
def test_error_of_the_polygon_falls_with_the_square_of_the_corners_which_a_run_keeps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, system = spring()
    known = stepped()
    found = []
    for number in (32, 128, 512):
        fixed = replace(scene, history=replace(scene.history, corners=number))
        found.append(evolve(system, fixed).cycles.dissipation[-1])
    errors = np.abs(np.array(found) - known) / known
    assert errors[-1] < 2e-5
    assert errors[0] / errors[-1] > 0.5 * 16.0**2
    refined, doubling = study._with_corners(scene, system, tmp_path, None)
    assert doubling is not None and doubling[-1, 1] <= 1e-3 < doubling[-2, 1]
    record = evolve(system, scene)
    assert abs(record.cycles.dissipation[-1] - known) <= doubling[-1, 1] * known
    # the larger one of the last change and a quarter of that before, of any of the first cycles
    D = [
        evolve(system, replace(scene, history=replace(scene.history, corners=int(n)))).cycles
        for n in doubling[:, 0]
    ]
    change = np.array([np.ptp([a.dissipation, b.dissipation], 0).max() for a, b in pairwise(D)])
    change /= [one.dissipation.max() for one in D[1:]]
    assert doubling[2:, 1] == pytest.approx(np.maximum(change[1:], 0.25 * change[:-1]), rel=1e-9)
    # what was found is told, and is the scene of the record
    number, error = doubling[-1]
    assert record.scene is not None and record.scene.history.corners == number
    assert refined.history.corners == number
    bare = evolve_bare(system, scene).cycles.dissipation
    assert bare == pytest.approx(record.cycles.dissipation, rel=1e-12)
    told = summarise(record)["harmonic"]
    assert told.pop("doubling")[-1] == [number, error]
    assert told == {"corners": number, "error_estimate": error, "tolerance": 1e-3}
    # of a run that is interrupted too

    def stop(text: str) -> None:
        if text.startswith("evolve: cycle 2 "):
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="interrupted after cycle 2 of 3"):
        study.run_history(scene, system, tmp_path, stop)
    part = read_record(tmp_path / "record.h5")
    assert part.scene == record.scene
    assert np.array_equal(given(part.doubling), given(record.doubling), equal_nan=True)
    monkeypatch.setattr(study, "with_corners", lambda *_: pytest.fail("found anew"))
    again, kept = study._with_corners(scene, system, tmp_path, None)
    assert again == refined and np.array_equal(given(kept), doubling, equal_nan=True)


@pytest.mark.one_rank
def test_a_tolerance_out_of_reach_is_an_error_and_polygons_that_end_are_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, system = spring()
    monkeypatch.setattr(histories, "MOST_CORNERS", 64)
    traced = Mock(wraps=histories.first_cycles)
    monkeypatch.setattr(histories, "first_cycles", traced)
    with pytest.raises(SolveError, match=r"with 64 corners .* above 1e-09;") as caught:
        options = replace(scene.history, tolerance=1e-9, cycles=5)
        with_corners(system, replace(scene, history=options))
    assert "\n" not in str(caught.value)
    assert {call.args[2] for call in traced.call_args_list} == {3}  # cycles that are compared
    # a polygon that cannot be followed, where P lifts the node off, is told as the last one
    lifted = replace(scene, history=harmonic({**SPRING, "P": Harmonic(1.0, 1.5)}))
    free = replace(system, K=np.diag([STIFFNESS, 0.0]), rigid=np.array([[0.0], [1.0]]))
    refined, doubling = with_corners(free, lifted)
    assert doubling is not None and np.isnan(doubling[-1, 1])
    assert refined.history.corners == doubling[-1, 0]
