"""Contact that begins on the axis of revolution, against Hertz and Spence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bodies import cylinder

import receding_fenicsx as rf
from receding_fenicsx.interface.measures.zones import on_axis
from receding_fenicsx.studies import run as study

PUNCH = Path(__file__).parents[3] / "demos" / "punch_axisymmetric.toml"
A, R, MODULUS = 0.8, 4.0, 1.0 / (1.0 - 0.3**2)
"""Contact radius, radius of curvature, and E / (1 - nu^2) of the demo's half-ball."""
FORCE = 4.0 * MODULUS * A**3 / (3.0 * R)


def ball(*changes: str) -> rf.Record:
    """A ball of radius R under a hundredth of the force, then under all of it."""
    changes = (
        f"contact.initial_gap=x**2/(2*{R})",
        f"history.rows=[[{0.01 * FORCE}], [{FORCE}]]",
        "mesh.contact_elements=40",
        "output.cycles=[]",
        *changes,
    )
    return rf.given(study.run(rf.read_scene(PUNCH, changes)))


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
@pytest.mark.parametrize("degree", [1, 2])
def test_parabolic_gap_without_friction_is_hertz(method: str, degree: int) -> None:
    """a^3 = 3 P R / (4 E*) and p = 3 P / (2 pi a^2) sqrt(1 - r^2 / a^2), also on the axis."""
    record = ball("contact.friction=0", f"mesh.degree={degree}", f"solver.method={method}")
    x, table, spacing = record.x, record.turning_points, 1.0 / (20.0 * degree)
    assert record.corner_ends == [-1]
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
    pressed = rf.Load("p", "right", pressure=1.0)
    kept = stamp(supports=(rf.Support("y", edge="top"),), loads=(pressed,))
    scenes = stamp(), kept, stamp("0.1*x"), stamp("0.05 + x**2/40")
    free, held, cone, raised = (rf.given(study.condense(scene)) for scene in scenes)
    assert free.x[0] == 0.125
    assert free.g0 == pytest.approx((free.x**2 - 0.125**2) / 40.0, abs=1e-16)
    assert free.g0[0] == 0.0
    assert held.g0 == pytest.approx(held.x**2 / 40.0)
    assert cone.g0 == pytest.approx(0.1 * (cone.x - 0.125), abs=1e-16) and cone.g0[0] == 0.0
    assert raised.g0 == pytest.approx(0.05 + free.g0, abs=1e-16)
