"""Springs on edges, at points and between bodies: hand formulas, work, bad input."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, cylinder, played

import receding_fenicsx as rf
from receding_fenicsx.bulk.springs import _across

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

comm = MPI.COMM_WORLD
E, K = 2.0, 0.7
ONCE = rf.HistoryOptions(kind="monotonic")
SMOOTH = (rf.Contact(friction=0.0),)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("round_", [False, True])
def test_pushed_block_shares_its_load_with_the_foundation(degree: int, round_: bool) -> None:
    """At nu = 0 the top moves by d = p / (E / H + k), and the plane carries E d / H."""
    press = rf.Load("p", "top", pressure=0.3)
    kinematics = "axisymmetric" if round_ else "plane strain"
    parts: dict[str, Any] = {
        "material": rf.Material(E, 0.0, kinematics),
        "springs": (rf.Spring("top", normal=K),),
        "history": ONCE,
    }
    scene = (cylinder if round_ else block)("triangle", degree, contacts=SMOOTH, **parts)
    record = played(replace(scene, loads=(press,)))
    moved = 0.3 / (E + K)
    work = 0.3 * (4.0 * np.pi if round_ else 4.0)
    assert record.turning_points.p[-1] == pytest.approx(E * moved, rel=1e-10)
    assert record.turning_points.load_displacement[-1, 0] == pytest.approx(work * moved, rel=1e-10)


@pytest.mark.parametrize("degree", [1, 2])
def test_sheared_block_hangs_on_tangential_springs(degree: int) -> None:
    """A stiff block that nothing else holds moves by F / (k L) on its springs."""
    scene = block(
        "quadrilateral",
        degree,
        material=rf.Material(1e6, 0.3),
        contacts=SMOOTH,
        loads=(
            rf.Load("P", "top", pressure=0.1),
            rf.Load("Q", "top", (-1.0, 1.0), traction=(0.01, 0.0)),
        ),
        springs=(rf.Spring("top", span=(-1.0, 2.0), tangential=K),),
        history=rf.HistoryOptions(kind="monotonic", load="Q", constant={"P": 1.0}),
    )
    record = played(scene)
    # the resultant through the top is taken up by springs at the top: no moment
    assert record.turning_points.v[-1] == pytest.approx(0.02 / (K * 3.0), rel=1e-4)
    assert record.turning_points.P[-1].sum() == pytest.approx(0.4, rel=1e-9)


@pytest.mark.parametrize("round_", [False, True])
def test_spring_at_a_point_shares_the_load(round_: bool) -> None:
    """At nu = 0 a platen moves by d = F / (E A / H + k), of a ring the full circle."""
    press = rf.Load("p", "top", platen=True, force=(0.0, -0.3))
    make, area = (cylinder, 4.0 * np.pi) if round_ else (block, 4.0)
    kinematics = "axisymmetric" if round_ else "plane strain"
    scene = make(
        contacts=SMOOTH,
        material=rf.Material(E, 0.0, kinematics),
        loads=(press,),
        springs=(rf.Spring(point=(1.0, 1.0), y=K),),
        history=ONCE,
    )
    record = played(scene)
    moved = 0.3 / (E * area + K)
    assert not record.half or round_
    assert record.turning_points.P[-1].sum() == pytest.approx(E * area * moved, rel=1e-9)
    assert record.turning_points.load_displacement[-1, 0] == pytest.approx(0.3 * moved, rel=1e-9)


def test_spring_at_a_point_holds_a_stiff_block() -> None:
    """The resultant through the point moves the block by F / k; nothing else holds it along x."""
    scene = block(
        material=rf.Material(1e7, 0.3),
        contacts=SMOOTH,
        loads=(rf.Load("P", "top", pressure=0.1), rf.Load("Q", "left", traction=(0.05, 0.0))),
        springs=(rf.Spring(point=(2.0, 0.5), x=K),),
        history=rf.HistoryOptions(kind="monotonic", load="Q", constant={"P": 1.0}),
    )
    np.testing.assert_allclose(played(scene).turning_points.v[-1], 0.05 / K, rtol=1e-5)


def tied(young: float, degree: int = 1, edge: str = "a.bottom", **parts: Any) -> rf.Scene:
    """A layer on another one, tied beside an open contact by springs of 2 and 1.5 on length 2."""
    bodies = [rf.Body(name, height=0.5, position=(0.0, y)) for name, y in (("a", 0.5), ("b", 0.0))]
    other = {"a.bottom": "b.top", "b.top": "a.bottom"}[edge]
    scene = replace(
        block(degree=degree, material=rf.Material(young, 0.3)),
        body=bodies[0],
        others=(bodies[1],),
        contacts=(rf.Contact("a.bottom", (-0.5, 0.5), 0.3, initial_gap=0.2, against="b.top"),),
        loads=(rf.Load("P", "a.top", pressure=0.3), rf.Load("Q", "a.top", traction=(0.1, 0.0))),
        supports=(rf.Support("xy", edge="b.bottom"),),
        springs=tuple(
            rf.Spring(edge, span, 2.0, 1.5, against=other) for span in ((-1.5, -0.5), (0.5, 1.5))
        ),
        history=rf.HistoryOptions(
            "table", columns=("P", "Q"), rows=((0.5, 0.0), (1.0, 0.0), (1, 1))
        ),
    )
    return replace(scene, **parts)


@pytest.mark.parametrize("degree", [1, 2])
def test_stiff_bodies_rest_on_the_springs_between_them(degree: int) -> None:
    """P / (k_n L) until the gap of 0.2 closes; the contact then carries the rest, with friction."""
    table = played(tied(1e8, degree)).turning_points
    np.testing.assert_allclose(table.w[0], -0.6 / 4.0, rtol=1e-6)
    np.testing.assert_allclose(table.P[1].sum(), 1.2 - 4.0 * 0.2, rtol=1e-5)
    np.testing.assert_allclose(table.v[2], (0.4 - 0.3 * 0.4) / 3.0, rtol=1e-5)


def test_springs_between_bodies_balance_whichever_edge_names_them() -> None:
    x = np.linspace(0.5, 1.5, 5)
    probes = tuple(
        rf.Probe(
            name, points=tuple((side * place, 0.5) for side in (-1, 1) for place in x), body=name
        )
        for name in ("a", "b")
    )
    a = played(tied(E, probes=probes))
    b = played(tied(E, edge="b.top"))
    for key in ("P", "Q", "w", "load_displacement"):
        one, two = (getattr(r.turning_points, key) for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-11)
    assert max(a.energy_error_max, b.energy_error_max) < 1e-11
    assert rf.from_toml(rf.to_toml(tied(E))) == tied(E)
    # piecewise linear along the edges: the trapezoidal rule is exact
    jump = a.probe("a").displacement[-1] - a.probe("b").displacement[-1]
    weights = 0.25 * np.tile([0.5, 1.0, 1.0, 1.0, 0.5], 2)
    force = weights @ jump * (1.5, 2.0)
    table = a.turning_points
    np.testing.assert_allclose(force[1], table.P[-1].sum() - 1.2, rtol=1e-9)
    np.testing.assert_allclose(force[0], table.Q[-1].sum() + 0.4, rtol=1e-9)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"against": "a.top"}, "against: must be an edge of another body"),
        ({"against": "c.top"}, "names none of the bodies a, b"),
        ({"against": "b.bottom", "edge": "a.top"}, "no node straight across"),
        ({"point": (0.0, 0.0)}, "has edge and point of"),
    ],
)
def test_bad_springs_between_bodies_are_refused(parts: dict[str, Any], words: str) -> None:
    springs = (replace(rf.Spring("a.bottom", (1.0, 1.5), 1.0, 1.0, against="b.top"), **parts),)
    with pytest.raises(rf.InputError, match=words) as error:
        rf.condense(tied(E, springs=springs), comm)
    assert "\n" not in str(error.value)


def test_tangential_springs_across_a_gap_are_refused() -> None:
    """Opposite forces along two edges that are apart would turn the pair."""
    spring = rf.Spring("a.bottom", normal=1.0, against="b.top")
    edge, below = (np.array([[0.0, y], [1.0, y]]) for y in (1.0, 0.9))
    down = np.array([0.0, -1.0])
    assert _across(spring, edge, below[::-1], down).tolist() == [1, 0]
    with pytest.raises(rf.InputError, match=r"tangential: .* are 0.1 apart, where forces"):
        _across(replace(spring, tangential=1.0), edge, below, down)
