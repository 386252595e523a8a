"""Problems of a new user, with public names only, each against an estimate made by hand."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

ROOT = Path(__file__).parents[1]

PAD = """
// A pad of height 1: foot |x| < foot on the base, head |x| < head, loaded on |x| < loaded.
DefineConstant[foot = {3}, head = {2}, loaded = {0.5}, contact_elements = {120}, growth = {1.2}];
Point(1) = {-foot, 0, 0}; Point(2) = {foot, 0, 0}; Point(3) = {head, 1, 0};
Point(4) = {loaded, 1, 0}; Point(5) = {-loaded, 1, 0}; Point(6) = {-head, 1, 0};
For i In {1 : 6}
  Line(i) = {i, i % 6 + 1};
EndFor
Curve Loop(1) = {1 : 6};
Plane Surface(1) = {1};
Transfinite Curve{1} = contact_elements + 1;
Physical Curve("foot") = {1};
Physical Curve("head") = {4};
Physical Surface("pad") = {1};
Field[1] = MathEval;
Field[1].F = Sprintf("%.17g + %.17g * y", 2 * foot / contact_elements, growth - 1);
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
"""

PAD_SCENE = """
[body]
mesh = "pad.geo"
[mesh]
contact_elements = 120
[contact]
edge = "foot"
friction = 0.3
[[load]]
name = "press"
edge = "head"
pressure = 1.0
[history]
minimum = 0.2
cycles = 2
[output]
cycles = []
"""


def solve(scene: rf.Scene) -> rf.Record:
    """Run a scene on each rank by itself."""
    system = rf.given(rf.condense(scene, MPI.COMM_SELF))
    return rf.evolve(system, scene)


def estimate(record: rf.Record, name: str, row: int = 0) -> float:
    """Return a fitted half width (radius) at a turning point; an elastic body on a rigid one."""
    beta = rf.dundurs_beta((1.0, 0.3, "plane strain"))
    return float(
        rf.half_width_estimates(record, row, (beta,))[f"{name}_half_width_estimate"]["value"]
    )


# -- trapezoid pad --------------------------------------------------------------------------------


@pytest.fixture
def pad(tmp_path: Path) -> Path:
    (tmp_path / "pad.geo").write_text(PAD)
    return tmp_path


def test_trapezoid_pad_recedes_to_the_contact_of_a_layer_whatever_the_load(pad: Path) -> None:
    """Without friction, half width 1.0078 (an endless layer, loaded on |x| < 0.5).

    The flanks begin one height beyond the end of the contact, and what has lifted off carries no
    load. A receding contact has no length of its own: its size does not depend on the load, and
    displacements are proportional to it.
    """
    layer = rf.reference.closed_forms.LAYERS[0]
    changes = ["contact.friction=0.0", "history.kind=monotonic"]
    once, thrice = (
        solve(rf.from_toml(PAD_SCENE, [*changes, f"load.press.pressure={load}"], pad))
        for load in (1.0, 3.0)
    )
    assert estimate(once, "contact") == pytest.approx(layer.half_width, rel=5e-3)
    first, second = once.turning_points, thrice.turning_points
    np.testing.assert_allclose(first.P.sum(), 2.0 * 0.5, rtol=1e-12)
    np.testing.assert_array_equal(first.state, second.state)
    np.testing.assert_allclose(second.p, 3.0 * first.p, atol=1e-11)
    middle = np.interp(0.0, once.x, first.p[-1])
    assert middle == pytest.approx(layer.p[0], rel=5e-3)


# -- leaf spring ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_leaves_of_a_spring_touch_at_both_ends_as_beams_do(method: str) -> None:
    """Guided at x = 0, lengths a = 60, supported at its end, and b = 50; F = 2 at x = c = 1.

    The leaves touch at x = 0 and b. There their deflections from x = 0 agree: with the force R at b
    R b^3 / 3 - F b^2 (3 a - b) / 6 = F c^2 (3 b - c) / 6 - R b^3 / 3. Nodes open one after the
    other on the way to these states.
    """
    scene = ROOT / "tests" / "trials" / "leaf_spring.toml"
    record = solve(rf.read_scene(scene, [f'solver.method="{method}"', "solver.steps_per_leg=4"]))
    P, (a, b, c, F) = record.turning_points.P[-1], (60.0, 50.0, 1.0, 2.0)
    R = (F * b**2 * (3 * a - b) + F * c**2 * (3 * b - c)) / (4.0 * b**3)
    assert P[-3:].sum() == pytest.approx(R, rel=2e-3)
    assert P[:3].sum() == pytest.approx(F - R, rel=2e-3)
    assert P.sum() == pytest.approx(F, rel=1e-7)


# -- lap joint ------------------------------------------------------------------------------------


# -- axisymmetric punch with a friction map -------------------------------------------------------


def punch(friction: str) -> rf.Record:
    """Press a flat round punch with some friction on a half-space."""
    changes = ["mesh.contact_elements=80", "mesh.growth=1.3", "history.rows=[[1.0]]"]
    changes += [f"contact.friction={friction}", "output.cycles=[]"]
    return solve(rf.read_scene(ROOT / "demos" / "punch_axisymmetric.toml", changes))


def test_friction_inside_the_stick_zone_of_a_round_punch_does_not_matter() -> None:
    """Friction 0.6 on r < 0.5 and 0.2 beyond: all as with 0.2 alone, Spence's stick radius 0.6983.

    Friction enters the law only where a limit is reached. With f = 0.2 all of r < 0.6983 sticks
    below its limit at every load, so a higher limit there changes nothing.
    """
    known = rf.reference.closed_forms.PUNCH_STICK["axisymmetric"][0.3, 0.2]
    constant, mapped = punch("0.2"), punch("where(x < 0.5, 0.6, 0.2)")
    assert estimate(mapped, "stick") == pytest.approx(known, rel=0.015)
    for name in ("p", "q", "v", "w"):
        values = [getattr(record.turning_points, name) for record in (constant, mapped)]
        np.testing.assert_allclose(values[1], values[0], atol=1e-13)


# -- gap from a file ------------------------------------------------------------------------------
