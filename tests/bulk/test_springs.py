"""Elastic foundations: hand formulas, halves and wholes, work, bad input."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, cylinder, played

from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import given
from receding_fenicsx.output.plots.loops import loop_of
from receding_fenicsx.scene.model import (
    Body,
    Contact,
    HistoryOptions,
    Load,
    Material,
    OutputOptions,
    SolverOptions,
    Spring,
    Support,
)
from receding_fenicsx.scene.toml_file import from_toml, to_toml
from receding_fenicsx.study import condense

comm = MPI.COMM_WORLD
E, K = 2.0, 0.7
ONCE = HistoryOptions(kind="monotonic")
SMOOTH = (Contact(friction=0.0),)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("round_", [False, True])
def test_pushed_block_shares_its_load_with_the_foundation(degree: int, round_: bool) -> None:
    """At nu = 0 the top moves by d = p / (E / H + k), and the plane carries E d / H."""
    press = Load("p", "top", pressure=0.3)
    kinematics = "axisymmetric" if round_ else "plane strain"
    parts: dict[str, Any] = {
        "material": Material(E, 0.0, kinematics),
        "springs": (Spring("top", normal=K),),
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
        material=Material(1e6, 0.3),
        contacts=SMOOTH,
        loads=(
            Load("P", "top", pressure=0.1),
            Load("Q", "top", (-1.0, 1.0), traction=(0.01, 0.0)),
        ),
        springs=(Spring("top", span=(-1.0, 2.0), tangential=K),),
        history=HistoryOptions(kind="monotonic", load="Q", constant={"P": 1.0}),
    )
    record = played(scene)
    # the resultant through the top is taken up by springs at the top: no moment
    assert record.turning_points.v[-1] == pytest.approx(0.02 / (K * 3.0), rel=1e-4)
    assert record.turning_points.P[-1].sum() == pytest.approx(0.4, rel=1e-9)


@pytest.mark.one_rank
def test_stiff_springs_are_a_support_and_soft_ones_none() -> None:
    load = Load("p", "left", (0.0, 0.5), pressure=0.02)
    press = Load("P", "top", pressure=0.2)
    history = HistoryOptions(kind="monotonic", load="p", constant={"P": 1.0})
    scene = block(degree=2, loads=(load, press), history=history, contacts=(Contact(friction=0.2),))
    held = played(replace(scene, supports=(Support("xy", edge="right"),))).turning_points
    rigid = Spring("right", normal=1e7, tangential=1e7)
    stiff = played(replace(scene, springs=(rigid,))).turning_points
    np.testing.assert_allclose(stiff.P[-1, :-1], held.P[-1, :-1], atol=1e-6)
    soft = played(replace(scene, springs=(replace(rigid, normal=1e-9, tangential=1e-9),)))
    none = played(scene)
    np.testing.assert_allclose(soft.turning_points.P, none.turning_points.P, atol=1e-8)


@pytest.mark.one_rank
def test_half_whole_and_work() -> None:
    scene = block(
        degree=2,
        loads=(
            Load("P", "top", (-1.0, 1.0), pressure=0.5),
            Load("T", "top", (-1.0, 1.0), traction=("0.5*x", 0.0)),
        ),
        springs=(
            Spring("top", (-1.0, 1.0), 0.2, 0.1),
            Spring("left", (0.0, 0.5), 0.3),
            Spring("right", (0.0, 0.5), 0.3),
        ),
        history=HistoryOptions(
            kind="cyclic", load="T", minimum=-1.0, constant={"P": 1.0}, until="steady"
        ),
        output=OutputOptions(samples_per_leg=400),
    )
    a, b = played(scene), played(replace(scene, solver=SolverOptions(symmetry="none")))
    assert a.half and not b.half
    for name in ("P", "Q", "v", "w", "load_displacement"):
        one, two = (getattr(r.turning_points, name) for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-9 * np.abs(two).max())
    D = a.cycles.dissipation[-1]
    assert D > 1e-6 and a.energy_error_max < 1e-10
    assert loop_of(a, len(a.cycles.dissipation)).area().sum() == pytest.approx(D, rel=1e-3)
    uneven = replace(scene, springs=scene.springs[:2])
    assert not given(condense(uneven, MPI.COMM_SELF)).half


def test_springs_hold_a_pair() -> None:
    """Two layers, nu = 0: the pressure passes, the top moves by p (H / E + 1/k)."""
    bodies = [Body(name, height=0.5, position=(0.0, y)) for name, y in (("a", 0.5), ("b", 0.0))]
    scene = replace(
        block(degree=1, material=Material(E, 0.0), history=ONCE),
        body=bodies[0],
        others=(bodies[1],),
        contacts=(Contact("a.bottom", friction=0.0, against="b.top"),),
        loads=(Load("p", "a.top", pressure=0.3),),
        springs=(Spring("b.bottom", normal=K),),
    )
    record = played(scene)
    assert record.turning_points.p[-1] == pytest.approx(0.3, rel=1e-9)
    moved = record.turning_points.load_displacement[-1, 0]
    assert moved == pytest.approx(4.0 * 0.3**2 * (1.0 / E + 1.0 / K), rel=1e-9)
    assert from_toml(to_toml(scene)) == scene


@pytest.mark.parametrize(
    ("spring", "words"),
    [
        (Spring("top", normal=-1.0), r"\[\[spring\]\] normal: is -1; must not be negative"),
        (Spring("top"), r"\[\[spring\]\]: has no stiffness"),
        (Spring("topp", normal=1.0), r"\[\[spring\]\] edge: .topp. is unknown"),
        (Spring("top", (0.0, 3.0), normal=1.0), "span: .* reaches beyond edge"),
        (Spring("top", normal=float("nan")), "normal: must be a finite number"),
    ],
)
def test_bad_springs_are_refused(spring: Spring, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        condense(block(springs=(spring,)), comm)
    assert "\n" not in str(error.value)
