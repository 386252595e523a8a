"""Interference: shrink fits against Lame's pressure, and other ways to the same state."""

from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, played

import receding_fenicsx as rf
from receding_fenicsx.scene.symmetry import is_half_meshed

comm = MPI.COMM_WORLD
E, NU, DEPTH = 2.0, 0.3, 0.004
ONCE = rf.HistoryOptions(kind="monotonic")
A, B, C = 0.5, 1.0, 2.0


# -- a block that its support presses on the plane -----------------------------------------------

BULGE = "0.01*(1 - 0.1*x**2)"
HELD = (rf.Support("y", edge="top"),)


def wedged(**parts: Any) -> rf.Scene:
    scene = block(
        degree=2,
        loads=(rf.Load("P", "top", (-1.0, 1.0), traction=("0.06*x", 0.0)),),
        contacts=(rf.Contact(friction=0.3, interference=BULGE),),
        supports=HELD,
        history=rf.HistoryOptions(kind="cyclic", minimum=-1.0, cycles=3),
        probes=(rf.Probe("s", points=((-0.3, 0.1), (0.3, 0.1))),),
    )
    return replace(scene, **parts)


@pytest.mark.one_rank
def test_first_leg_closes_the_interference_alone() -> None:
    history = rf.history_from_scene(wedged(history=replace(wedged().history, cycles=2)))
    assert history.load_names == ("P", "interference")
    assert history.path.tolist() == [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    assert history.loop.tolist() == [[1.0, 1.0], [-1.0, 1.0], [1.0, 1.0]]


@pytest.mark.one_rank
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_pushing_the_far_side_by_the_depth_gives_the_same(friction: float) -> None:
    """A uniform interference against the displacement of the held edge by the same."""
    contacts = (rf.Contact(friction=friction, interference=0.01),)
    scene = wedged(
        contacts=contacts, loads=(), supports=(rf.Support("xy", edge="top"),), history=ONCE
    )
    other = replace(
        scene,
        contacts=(rf.Contact(friction=friction),),
        loads=(rf.Load("d", "top", displacement=(0.0, -0.01)),),
        supports=(),
    )
    a, b = played(scene), played(other)
    for name in ("P", "Q", "v"):
        one, two = (getattr(r.turning_points, name)[-1] for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-9 * np.abs(b.turning_points.P).max())
    ends = [r.turning_points.load_displacement[-1, 0] for r in (a, b)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)
    one, two = a.probe("s"), b.probe("s")
    np.testing.assert_allclose(one.stress[-1], two.stress[-1], atol=1e-9)
    shift = two.displacement[-1] - one.displacement[-1]
    np.testing.assert_allclose(shift, np.tile([0.0, -0.01], (2, 1)), atol=1e-11)


@pytest.mark.one_rank
@pytest.mark.parametrize("shape", [BULGE, "0.01 + 0.002*x"])
def test_a_gap_that_a_load_closes_is_an_interference(shape: str) -> None:
    fitted = wedged(contacts=(rf.Contact(friction=0.3, interference=shape),))
    steps = (0.0, 1.0), (1.0, 1.0)
    driven = wedged(
        contacts=(rf.Contact(friction=0.3),),
        loads=(*fitted.loads, rf.Load("d", "bottom", gap=f"-({shape})")),
        history=rf.HistoryOptions(
            kind="table", columns=("P", "d"), rows=steps, cycle_rows=((-1.0, 1.0), steps[1])
        ),
    )
    driven = replace(driven, history=replace(driven.history, cycles=3))
    assert is_half_meshed(driven) == is_half_meshed(fitted) == (shape == BULGE)
    a, b = played(fitted), played(rf.from_toml(rf.to_toml(driven)))
    for name in ("P", "Q", "v", "w", "load_displacement"):
        one, two = (getattr(r.turning_points, name)[-1] for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-12 * np.abs(two).max())
    one, two = a.probe("s"), b.probe("s")
    np.testing.assert_allclose(one.displacement[-1], two.displacement[-1], atol=1e-14)


@pytest.mark.one_rank
def test_conjugate_of_a_pressure_is_its_integral_over_the_true_displacement() -> None:
    """Of an edge that the interference moves, too, though [v; w] has no part of it."""
    y = np.linspace(0.0, 1.0, 101)
    edge = rf.Probe("edge", points=tuple((-2.0, value) for value in y))
    push = rf.Load("P", "left", pressure="0.01*(1 + y)")
    record = played(wedged(loads=(push,), probes=(edge,)))
    inward, table = record.probe("edge").displacement[:, :, 0], record.turning_points
    weight = 0.01 * (1.0 + y) * 0.01 * np.where((y == 0.0) | (y == 1.0), 0.5, 1.0)
    rows = record.probe("edge").kind == "turning point"
    known = inward[rows] @ weight
    found = table.load_displacement[:, record.load_names.index("P")]
    assert found == pytest.approx(known, abs=1e-3 * np.abs(known).max())
    assert abs(found[0]) > 0.1 * np.abs(found).max()  # interference alone
