"""Loads that travel along an edge: unit loads, histories, and what a pass leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, played

import receding_fenicsx as rf
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.scene.toml_file import from_toml, to_toml
from receding_fenicsx.studies.run import condense

comm = MPI.COMM_WORLD
WHEEL = rf.Load("wheel", "top", (-0.5, 0.5), pressure=1.0, travel=(-1.0, 1.0), steps=4)
TRAVEL = rf.HistoryOptions(kind="travel", cycles=2, constant={"weight": 1.0})


def strip(*wheels: rf.Load, **parts: Any) -> rf.Scene:
    scene = block(
        degree=2,
        contacts=(rf.Contact(friction=0.2),),
        loads=(rf.Load("weight", body_force=(0.0, -0.05)), *wheels),
        history=TRAVEL,
    )
    return replace(scene, **parts)


TABLE = {"x": [-0.5, 0.1, 0.5], "value": [1.0, 2.0, 0.0]}


@pytest.mark.parametrize(
    ("pressure", "size", "middle"),
    [
        (1.0, 1.0, 0.0),
        ("1 + 0.4*x", 1.0, 0.4 / 12.0),
        (TABLE, 1.3, (0.9 * (-0.5 + 0.6 * 5.0 / 9.0) + 0.4 * (0.1 + 0.4 / 3.0)) / 1.3),
    ],
)
def test_unit_loads_have_resultant_and_moment_of_the_load_at_their_positions(
    pressure: Any, size: float, middle: float
) -> None:
    """Wherever their ends and the kinks of a table lie between the vertices."""
    wheel = replace(WHEEL, pressure=pressure, travel=(-1.0, 1.13), steps=7)
    system = condense(strip(wheel), comm)
    if system is None:
        return
    assert system.load_names == ("weight", *(f"wheel {k}" for k in range(8)))
    for k, s in enumerate(np.linspace(-1.0, 1.13, 8)):
        tangential, normal = np.split(system.r_star[1 + k], 2)
        assert normal.sum() == pytest.approx(size, rel=1e-12)
        assert tangential.sum() == pytest.approx(0.0, abs=1e-12)
        assert normal @ system.x == pytest.approx(size * (s + middle), abs=1e-12)


@pytest.mark.one_rank
def test_loads_are_put_on_travel_and_are_taken_off() -> None:
    drag = rf.Load(
        "wheel", "top", (-0.5, 0.5), traction=(0.1, 0.0), travel=(-1.0, 1.0, 0.0), steps=3
    )
    wheel = replace(WHEEL, travel=drag.travel, steps=3)
    scene = strip(wheel, drag)
    history = history_from_scene(scene)
    assert history.load_names == ("weight", *(f"wheel {k}" for k in range(4)))
    hats = np.vstack([np.zeros(4), np.eye(4), np.zeros(4)])
    assert np.array_equal(history.loop, np.column_stack([np.ones(6), hats]))
    assert [unit.travel for unit in wheel.units] == [(-1.0,), (0.0,), (1.0,), (0.0,)]
    assert np.array_equal(history.path[1:], history.loop) and not history.path[0].any()
    assert from_toml(to_toml(scene)) == scene
    # a uniform pressure over 1: (2 sqrt(1e-3))^2 / 4 = 1e-3
    assert len(replace(WHEEL, steps=None).units) == 1 + 32


@pytest.mark.one_rank
def test_the_other_way_is_the_mirror_image() -> None:
    """The strip creeps in the direction of travel, by the same in every pass."""
    ways = [strip(replace(WHEEL, travel=(-s, s), steps=8)) for s in (1.0, -1.0)]
    a, b = (played(scene).turning_points for scene in ways)
    scale = np.abs(a.v).max()
    assert a.v == pytest.approx(-b.v[:, ::-1], abs=1e-9 * scale)
    assert pytest.approx(b.P[:, ::-1], abs=1e-9 * a.P.max()) == a.P
    ends = [a.v[a.cycle == cycle][-1] for cycle in range(3)]
    steps = np.diff(ends, axis=0)
    assert steps[1] == pytest.approx(steps[0], abs=1e-9 * scale)
    assert steps.min() > 0.1 * scale


def test_the_interpolated_load_converges_with_the_square_of_the_steps() -> None:
    """The forces that a load between two positions leaves on the contact, all of it held."""
    off = []
    for steps in (8, 32):
        system = condense(strip(replace(WHEEL, steps=steps)), comm)
        if system is None:
            continue
        unit = system.r_star[1:]
        off.append(np.abs(unit[1:-1:2] - 0.5 * (unit[:-2:2] + unit[2::2])).max())
    if off:
        assert off[0] / off[1] == pytest.approx(16.0, rel=0.2)


@pytest.mark.parametrize(
    ("wheel", "history", "words"),
    [
        ({"pressure": None, "displacement": (0.0, 0.1)}, {}, "travel: is for a pressure or"),
        ({"travel": (1.0, 1.0)}, {}, "travel: stays at a position"),
        ({"span": None, "steps": None}, {}, "steps: are needed to travel without a span"),
        ({"steps": None, "span": (0.0, 1e-3)}, {}, "unit loads, 1000 are the most"),
        ({"travel": (-3.0, 3.0)}, {}, "load 'wheel 0': is zero"),
        ({}, {"kind": "monotonic", "cycles": 60}, 'needs .history. kind = "travel"'),
        ({"travel": (), "steps": None}, {}, "no load travels"),
    ],
)
def test_what_cannot_travel_is_refused_in_one_line(
    wheel: dict[str, Any], history: dict[str, Any], words: str
) -> None:
    scene = strip(replace(WHEEL, **wheel), history=replace(TRAVEL, **history))
    with pytest.raises(rf.InputError, match=words) as caught:
        condense(scene, comm)
    assert "\n" not in str(caught.value)
