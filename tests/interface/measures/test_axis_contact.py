"""Contact that begins on the axis of revolution, against Hertz and Spence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bodies import cylinder

import receding_fenicsx as rf
from receding_fenicsx.evolution.problem import with_profiles
from receding_fenicsx.interface.measures.zones import on_axis
from receding_fenicsx.reference.closed_forms import PUNCH_STICK
from receding_fenicsx.studies import run as study

PUNCH = Path(__file__).parents[3] / "demos" / "punch_axisymmetric.toml"
A, R, MODULUS = 0.8, 4.0, 1.0 / (1.0 - 0.3**2)
"""Contact radius, radius of curvature, and E / (1 - nu^2) of the demo's half-ball."""
FORCE = 4.0 * MODULUS * A**3 / (3.0 * R)


def ball(*changes: str) -> rf.Record | None:
    """A ball of radius R under a hundredth of the force, then under all of it."""
    return study.run(
        rf.read_scene(
            PUNCH,
            [
                f"contact.initial_gap=x**2/(2*{R})",
                f"history.rows=[[{0.01 * FORCE}], [{FORCE}]]",
                "mesh.contact_elements=40",
                "output.cycles=[]",
                *changes,
            ],
        )
    )


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
@pytest.mark.parametrize("degree", [1, 2])
def test_parabolic_gap_without_friction_is_hertz(method: str, degree: int) -> None:
    """a^3 = 3 P R / (4 E*) and p = 3 P / (2 pi a^2) sqrt(1 - r^2 / a^2), also on the axis."""
    record = ball("contact.friction=0", f"mesh.degree={degree}", f"solver.method={method}")
    if record is None:
        return
    x, table, spacing = record.x, record.turning_points, 1.0 / (20.0 * degree)
    for row, part in enumerate((0.01, 1.0)):
        a = A * part ** (1.0 / 3.0)
        assert table.P[row].sum() == pytest.approx(part * FORCE, rel=1e-9)
        assert rf.contact_half_width(x, table.state[row], True) == pytest.approx(a, abs=spacing)
    p0 = 1.5 * FORCE / (np.pi * A**2)
    assert on_axis(x, table.p[-1]) == pytest.approx(p0, rel=2e-3)
    inside = (x > 2.0 * spacing) & (x < 0.8 * A)
    hertz = p0 * np.sqrt(1.0 - (x[inside] / A) ** 2)
    # lumped tractions of order 2 err by opposite amounts at vertices and midside nodes
    assert np.abs(table.p[-1, inside] / hertz - 1.0).max() < 0.02


@pytest.mark.parametrize("degree", [1, 2])
def test_frictional_hertz_sticks_within_spences_radius_by_both_methods(degree: int) -> None:
    """On first loading c / a is that of a flat punch (Spence 1975), whatever the load."""
    options = [f"mesh.degree={degree}", "contact.friction=0.2"]
    steps = ["solver.method=gauss-seidel", "solver.steps_per_leg=20"]
    exact, stepped = ball(*options), ball(*options, *steps)
    if exact is None or stepped is None:
        return
    spacing = 1.0 / (20.0 * degree)
    for record in (exact, stepped):
        state = record.turning_points.state[-1]
        radius, stick = (
            rf.contact_half_width(record.x, state, True),
            rf.stick_half_width(record.x, state, record.f, True),
        )
        assert radius == pytest.approx(A, abs=spacing)
        known = PUNCH_STICK["axisymmetric"][0.3, 0.2]
        assert stick / A == pytest.approx(known, abs=spacing / A)
        assert set(state[record.x < 0.9 * stick].tolist()) == {rf.State.STICK}
    a, b = exact.turning_points, stepped.turning_points
    assert np.abs(a.P[-1] - b.P[-1]).max() < 0.01 * a.P[-1].max()
    assert exact.energy_error_max < 1e-10
    # friction alone: a few per cent more pressure on the axis
    assert 1.03 < on_axis(exact.x, a.p[-1]) / (1.5 * FORCE / (np.pi * A**2)) < 1.12


def stamp(gap: str = "x**2/40", **parts: object) -> rf.Scene:
    """A coarse rounded cylinder of order 2, free along its axis."""
    scene = cylinder(
        degree=2,
        contacts=(rf.Contact(friction=0.3, initial_gap=gap),),
        mesh=rf.MeshOptions(16, "triangle", 2, 1.3),
        loads=(rf.Load("p", "top", platen=True, force=(0.0, -0.02)),),
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


def test_a_free_body_counts_its_gap_from_the_axis_and_a_held_one_keeps_its_place() -> None:
    """The nodes at 1/8, 1/4, ... of a free body are let down by the gap of the first."""
    free = study.condense(stamp())
    held = study.condense(
        stamp(supports=(rf.Support("y", edge="top"),), loads=(rf.Load("p", "right", pressure=1.0),))
    )
    cone = study.condense(stamp("0.1*x"))
    if free is None or held is None or cone is None:
        return
    assert free.x[0] == 0.125
    assert free.g0 == pytest.approx((free.x**2 - 0.125**2) / 40.0, abs=1e-16)
    assert free.g0[0] == 0.0
    assert held.g0 == pytest.approx(held.x**2 / 40.0)
    assert cone.g0 == pytest.approx(0.1 * (cone.x - 0.125), abs=1e-16) and cone.g0[0] == 0.0


def test_a_body_that_hovers_or_touches_elsewhere_is_not_let_down() -> None:
    system = study.condense(stamp())
    if system is None:
        return
    for gap in ("0.01 + x**2/40", "0.01*max(1 - x, 0)", "0.0"):
        found = with_profiles(stamp(gap), system)
        low = 0.01 if gap.startswith("0.01 +") else 0.0
        assert found.g0.min() == pytest.approx(low, rel=1e-12)
    ridge = with_profiles(stamp("0.01*max(1 - x, 0)"), system)
    assert ridge.g0 == pytest.approx(0.01 * np.maximum(1.0 - ridge.x, 0.0), abs=1e-17)


def test_a_ball_on_a_cylinder_carries_the_load_of_one_on_a_plane_twice_as_soft() -> None:
    """Two equal elastic bodies: half the modulus and a larger contact, by both methods."""
    body = rf.Body(name="a", width=8.0, height=4.0)
    scene = cylinder(
        degree=2,
        body=body,
        others=(replace(body, name="b", position=(0.0, -4.0)),),
        mesh=rf.MeshOptions(128, "triangle", 2, 1.3),
        contacts=(rf.Contact("a.bottom", (0.0, 1.0), 0.0, "x**2/8", against="b.top"),),
        loads=(rf.Load("p", "a.top", platen=True, force=(0.0, -0.05)),),
        supports=(rf.Support("y", edge="b.bottom"),),
    )
    record = study.run(scene)
    if record is None:
        return
    modulus = 0.5 * 2.0 / (1.0 - 0.3**2)
    a = (3.0 * 0.05 * 4.0 / (4.0 * modulus)) ** (1.0 / 3.0)
    p = record.turning_points.p[-1]
    assert record.turning_points.P[-1].sum() == pytest.approx(0.05, rel=1e-9)
    assert on_axis(record.x, p) == pytest.approx(1.5 * 0.05 / (np.pi * a**2), rel=0.02)
