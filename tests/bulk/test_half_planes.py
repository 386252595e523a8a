"""Scenes with half-planes, against closed forms and against meshed bodies."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import played
from images import Image
from kinds import UNEVEN

import receding_fenicsx as rf
from receding_fenicsx.measures.ends import contact_betas, half_width_estimates

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

closed_forms = rf.reference.closed_forms
HERTZ = closed_forms.Hertz(force=1.0, radius=100.0, modulus=0.5 * 200.0 / (1.0 - 0.3**2))
SHEARED = closed_forms.CattaneoMindlin(HERTZ, f=0.5, largest=0.3)
MESHED = Path(__file__).parents[2] / "meshes" / "pad.geo"

UPPER = 'name = "upper"\nshape = "half-plane"\nwidth = 2.4\n'
LOWER = 'name = "lower"\nshape = "half-plane"\nwidth = 2.4\n'
PAIR = (Path(__file__).parents[2] / "demos" / "half_planes.toml").read_text()
ONE = Path(__file__).with_name("half_plane.toml").read_text()


def pressure_error(record: rf.Record, hertz: closed_forms.Hertz) -> float:
    """Largest error of the first pressure over p0, not within four nodes of the contact's end."""
    spacing = float(np.diff(record.x).max())
    away = np.abs(np.abs(record.x) - hertz.a) > 4.5 * spacing
    off = record.turning_points.p[0] - hertz.pressure(record.x)
    return float(np.abs(off[away]).max()) / hertz.p0


@pytest.mark.parametrize(("edge", "datum"), [("bottom", ()), ("top", ("body.datum=45.0",))])
def test_cylinder_on_a_plane_without_friction_is_hertz(edge: str, datum: tuple[str, ...]) -> None:
    hertz = closed_forms.Hertz(force=1.0, radius=50.0, modulus=200.0 / (1.0 - 0.3**2))
    force = "[0.0, 1.0]" if edge == "top" else "[0.0, -1.0]"
    record = played(rf.from_toml(ONE, [f"contact.edge={edge}", f"load.P.force={force}", *datum]))
    assert pressure_error(record, hertz) < 1e-3
    assert abs(record.turning_points.p[0].max() / hertz.p0 - 1.0) < 2e-4
    # Johnson, eq. (5.57): the point at the depth d, by default 30, comes nearer
    a, nu, d = hertz.a, 0.3, 45.0 if datum else 30.0
    known = (1.0 - nu**2) / (np.pi * 200.0) * (2.0 * np.log(2.0 * d / a) - nu / (1.0 - nu))
    assert np.isclose(record.turning_points.load_displacement[0, 0], known, rtol=1e-4)


def test_probes_of_a_pair_on_the_axis_are_hertz() -> None:
    """Stresses below the middle, at the surface of both bodies, and the datum at rest."""
    probe = (
        '[[probe]]\nname = "above"\nbody = "upper"\npoints = [[0.0, 0.5], [0.0, 0.0]]\n'
        '[[probe]]\nname = "below"\nbody = "lower"\n'
        "points = [[0.0, -0.5], [0.0, 0.0], [0.0, -24.0]]\n"
    )
    system = rf.given(rf.condense(rf.from_toml(PAIR + probe)))
    record, matrix = played(rf.from_toml(PAIR)), rf.given(system.probes)
    table = record.turning_points
    values = matrix.rows @ np.concatenate([table.v[0], table.w[0], table.load[0]])
    a, z = HERTZ.a, 0.5
    known_yy = -HERTZ.p0 * a / np.hypot(a, z)
    known_xx = -HERTZ.p0 / a * ((a**2 + 2.0 * z**2) / np.hypot(a, z) - 2.0 * z)
    for rows in (values[:2], values[2:4]):
        assert np.allclose(rows[:, 3], [known_yy, -HERTZ.p0], rtol=1e-3)
        assert np.allclose(rows[:, 2], [known_xx, -HERTZ.p0], rtol=1e-3)
        assert np.allclose(rows[:, 4], 0.3 * (rows[:, 2] + rows[:, 3]))  # plane strain
    assert abs(values[4, 1]) < 1e-3 * abs(values[3, 1])


def test_contact_that_the_surface_cuts_off_is_a_warning() -> None:
    """Contact half width 0.54, 1.2 or 2.15 on a surface that ends at 1.5, or at -1."""
    part = ["contact.span=[-1.0, 1.5]", "history.rows=[[1.0], [0.1]]"]
    known: Any = {-1.0: ([], []), -16.0: ([], [("-1.5 and 1.5", "width")])}
    for force, (more, places) in (known | {-5.0: (part, [("-1", "span")])}).items():
        one = [f"load.P.force=[0.0, {force}]", "load.P.platen=true", "mesh.contact_elements=20"]
        for punch, told in (([], places), (["contact.initial_gap=0.0"], [])):
            record = played(rf.from_toml(ONE, [*one, *more, *punch]))
            text = " ".join(rf.summarise(record)["warnings"])
            assert re.findall(r"surface at x = (.*), beyond which.*, enlarge (\w+)", text) == told


@pytest.mark.parametrize("degree", [1, 2])
def test_block_on_a_half_plane(degree: int) -> None:
    """Pressure and dissipation within the errors of one block: its elements and its truncation."""
    block = f'name = "upper"\nmesh = "{MESHED}"\n'
    block += "parameters = {size = 30.0, half_width = 1.2, up = 1}\n"
    text = PAIR.replace(UPPER, block).replace(LOWER, LOWER.replace("width = 2.4\n", ""))
    text = text.replace("upper.bottom", "upper.contact").replace("upper.far", "upper.platen")
    changes = [f"mesh.degree={degree}", f"mesh.contact_elements={160 // degree}"]
    record = played(rf.from_toml(text, changes))
    assert pressure_error(record, HERTZ) < {1: 0.02, 2: 0.01}[degree]
    assert (
        abs(record.cycles.dissipation[-1] / SHEARED.dissipation() - 1.0)
        < {1: 1e-2, 2: 5e-3}[degree]
    )


PUNCH_STICK = closed_forms.PUNCH_STICK["plane strain"]


def test_cylinders_of_different_materials_stick_by_dundurs_beta() -> None:
    """A pair with the beta of nu = 0.3 on a rigid plane has the same c / a (Spence 1975).

    With c1 ~ (1 - nu^2) / E and c2 ~ (1 - 2 nu)(1 + nu) / E, beta is (c2a - c2b) / (c1a + c1b) / 2.
    """
    beta, nu_b = 0.5 * (1.0 - 0.6) / 0.7, 0.45
    # body a: nu = 0, E = 1, so that its c1 = c2 = 1
    compliance = (1.0 - 2.0 * beta) / (
        2.0 * beta * (1.0 - nu_b**2) + (1.0 - 2.0 * nu_b) * (1.0 + nu_b)
    )
    changes = ["material.upper.young=1.0", "material.upper.poisson=0.0", "contact.friction=0.2"]
    changes += [f"material.lower.young={1.0 / compliance}", f"material.lower.poisson={nu_b}"]
    # Hertz's a^2 = 4 P R / (pi E*), to be 1, with 1 / E* = c1a + c1b
    radius = np.pi / 4.0 / (1.0 + compliance * (1.0 - nu_b**2)) / 0.01
    changes += [f"contact.initial_gap=x**2 / {2.0 * radius}", "load.P.force=[0.0, -0.01]"]
    changes += [
        "history.rows=[[1.0, 0.0], [1.0, 1e-9]]",
        "history.cycle_rows=[]",
        "history.cycles=0",
    ]
    record = played(rf.from_toml(PAIR.replace("2.4", "2.2"), changes))
    state = record.turning_points.state[0]
    stick = np.abs(record.x[state == rf.State.STICK]).max()
    touching = np.abs(record.x[state != rf.State.SEPARATION]).max()
    assert abs(touching - 1.0) < 0.03
    spacing = record.x[1] - record.x[0]
    assert abs(stick / touching - PUNCH_STICK[0.3, 0.2]) < 1.5 * spacing
    # the zone has grown with the load: between nodes its end is known by its own power
    found = half_width_estimates(record, 0, contact_betas(record))
    a, c = (found[f"{name}_half_width_estimate"] for name in ("contact", "stick"))
    assert c["fitted"] and abs(c["value"] - PUNCH_STICK[0.3, 0.2] * a["value"]) < 0.2 * spacing
    low, high = c["interval"]
    assert low < PUNCH_STICK[0.3, 0.2] * a["value"] < high


TENSION = 0.4 * 1.2 * SHEARED.f * HERTZ.p0
STRETCHED = Path(__file__).with_name("stretched.toml").read_text()


def stretched(text: str, edge: str, columns: str, rows: str, tension: float = TENSION) -> str:
    """Return a scene with a tension in one body and another history."""
    head, tail = text.split("[history]")
    load = STRETCHED.format(edge=edge, tension=tension, columns=columns, rows=rows)
    return head + load + tail[tail.index("[output]") :]


@pytest.mark.parametrize(("edge", "side"), [("lower.far", 1.0), ("upper.far", -1.0)])
def test_cylinder_on_a_stretched_body_sticks_where_nowell_and_hills_say(
    edge: str, side: float
) -> None:
    rows = "[1.0, 0.0, 0.0], [1.0, 0.3, 1.0], [1.0, -0.18, -0.6]"
    record = played(rf.from_toml(stretched(PAIR, edge, '"P", "Q", "S"', rows)))
    assert record.energy_error_max < 1e-10
    instant, spacing = record.turning_points, 2.4 / 160
    known = closed_forms.CattaneoMindlin(HERTZ, 0.5, 0.3, side * TENSION)
    assert abs(known.middle(0.3, "loading")) > 8.0 * spacing
    for row, Q, leg in ((1, 0.3, "loading"), (2, -0.18, "unloading")):
        # q on the upper body resists Q
        error = np.abs(-instant.q[row] - known.traction(record.x, Q, leg))
        assert error.max() < 0.04 * SHEARED.f * HERTZ.p0
        assert np.sqrt(np.mean(error**2)) < 6e-3 * SHEARED.f * HERTZ.p0
        sticks = record.x[instant.state[row] == rf.State.STICK]
        ends = known.middle(Q, leg) + np.array([-1.0, 1.0]) * known.stick_half_width(Q, leg)
        np.testing.assert_allclose([sticks[0], sticks[-1]], ends, atol=1.5 * spacing)


@pytest.mark.parametrize("kinematics", ["plane strain", "plane stress"])
def test_tension_without_friction_is_a_uniform_stress(kinematics: str) -> None:
    probe = '[[probe]]\nname = "inside"\npoints = [[0.4, 0.3], [-0.2, 1.1]]\n[history]'
    text = stretched(ONE, "far", '"P", "S"', "[1.0, 0.0], [1.0, 1.0]", tension=3.0)
    text = text.replace("[history]", probe)
    record = played(rf.from_toml(text, [f"material.kinematics={kinematics}"]))
    at, end = record.probe("inside"), record.turning_points
    np.testing.assert_allclose(end.P[1], end.P[0], atol=1e-12 * end.P[0].max())
    stress = (at.stress[-1] - at.stress[-2]) / 3.0
    plane = kinematics == "plane strain"
    out = np.array([1.0, 0.0, 0.3 if plane else 0.0, 0.0])
    np.testing.assert_allclose(stress, np.tile(out, (2, 1)), atol=1e-12)
    # plane Hooke's law, relative to the middle of the surface
    along = 3.0 / 200.0 * (1.0 - 0.3**2 if plane else 1.0)
    across = -3.0 / 200.0 * (0.3 * 1.3 if plane else 0.3)
    moved = at.displacement[-1] - at.displacement[-2]
    known = np.array([[0.4 * along, 0.3 * across], [-0.2 * along, 1.1 * across]])
    np.testing.assert_allclose(moved, known, atol=1e-12)


def test_a_pair_does_the_same_whichever_body_is_held_and_pushed() -> None:
    """Also where loads on both balance; what its surfaces move apart are the record's v and w."""
    faces = rf.Probe("a", edge="a.bottom"), rf.Probe("b", edge="b.top")
    scene = UNEVEN["half-planes"]
    scene = replace(scene, probes=(*scene.probes, *faces))
    *pushes, tension = scene.loads
    ways = ((0.0, 1.0), (-0.2, 0.0))
    against = [
        replace(load, edge="b.far", force=way) for load, way in zip(pushes, ways, strict=True)
    ]
    held = (rf.Support("xy", edge="a.far"),)
    other = replace(scene, loads=(*against, tension), supports=held)
    both = replace(scene, loads=(*pushes, *against, tension), supports=())
    known = played(scene)
    for record, rests in ((known, 0.0), (played(other), 1.0), (played(both), 0.0)):
        Image().check(replace(record, probes=None), replace(known, probes=None), 1e-8)
        a, b, inside = (record.probe(name) for name in "abs")
        ends = a.kind == "turning point"
        table, apart = record.turning_points, (a.displacement - b.displacement)[ends]
        moved = np.stack([table.v, table.w], axis=-1)
        assert np.abs(apart - moved).max() < 0.05 * np.abs(moved).max()
        # the far field of a moves by the conjugates of P and T, or that of b the other way
        far = rests * table.load_displacement[:, :2] @ [[0.0, -1.0], [5.0, 0.0]]
        own = known.probe("b").displacement[ends] - far[:, None]
        assert np.abs(b.displacement[ends] - own).max() < 1e-8 * np.abs(own).max()
        stress = known.probe("s").stress
        assert np.abs(inside.stress - stress).max() < 1e-8 * np.abs(stress).max()
