"""The cores of the validation demos, and stresses at probes, against what is known."""

from pathlib import Path

import numpy as np
import pytest
from demo_runs import demo

import receding_fenicsx as rf
from receding_fenicsx.reference import closed_forms

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("known", "width"),
    [(closed_forms.BLOCK, 4.0), *((layer, 8.0) for layer in closed_forms.LAYERS)],
)
def test_frictionless_pressure_is_right_to_1e_5_and_half_width_to_1e_3(
    known: closed_forms.Pressed, width: float
) -> None:
    block = demo("frictionless_block")
    # 40 quadratic elements on h: 321 nodes under the block
    centre, profile, half_width = block["errors"](known, block["solve"](known, width, 160, 1.1))
    assert centre < 1e-5
    assert profile < 3e-4
    assert half_width < 1e-3


@pytest.mark.parametrize(
    ("degree", "cell"), [(1, "triangle"), (2, "triangle"), (2, "quadrilateral")]
)
def test_interval_of_the_half_width_holds_the_known_one_and_shrinks_with_the_elements(
    degree: int, cell: str
) -> None:
    block = demo("frictionless_block")
    lengths = []
    for nodes, growth in ((96, 1.15), (160, 1.1), (240, 1.07)):
        changes = [f"mesh.degree={degree}", f"mesh.cell={cell}"]
        record = block["solve"](closed_forms.BLOCK, 4.0, nodes * 2 // degree, growth, *changes)
        found = rf.half_width_estimates(record, -1)["contact_half_width_estimate"]
        spacing = record.x[1] - record.x[0]
        low, high = found["interval"]
        assert low <= closed_forms.BLOCK.half_width <= high
        # linear elements shift an end by up to a third of the spacing, quadratic ones by a fifth
        off = abs(found["value"] - closed_forms.BLOCK.half_width)
        assert off < (0.4 if degree == 1 else 0.2) * spacing
        lengths.append(high - low)
    assert lengths[-1] < 0.6 * lengths[0]


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_leaves_of_a_spring_touch_at_both_ends_as_beams_do(method: str) -> None:
    """Guided at x = 0, lengths a = 60, supported at its end, and b = 50; F = 2 at x = c = 1.

    The leaves touch at x = 0 and b. There their deflections from x = 0 agree: with the force R at b
    R b^3 / 3 - F b^2 (3 a - b) / 6 = F c^2 (3 b - c) / 6 - R b^3 / 3. Nodes open one after the
    other on the way to these states.
    """
    scene = TESTS / "trials" / "leaf_spring.toml"
    changes = [f'solver.method="{method}"', "solver.steps_per_leg=4"]
    record = rf.given(rf.run(rf.read_scene(scene, changes)))
    P, (a, b, c, F) = record.turning_points.P[-1], (60.0, 50.0, 1.0, 2.0)
    R = (F * b**2 * (3 * a - b) + F * c**2 * (3 * b - c)) / (4.0 * b**3)
    assert P[-3:].sum() == pytest.approx(R, rel=2e-3)
    assert P[:3].sum() == pytest.approx(F - R, rel=2e-3)
    assert P.sum() == pytest.approx(F, rel=1e-7)


# -- stress below a pressed cylinder, at probes, against Hertz and McEwen --------------------------

POISSON, RADIUS, MODULUS = 0.3, 10.0, 1.0 / (1.0 - 0.3**2)
HERTZ = rf.reference.closed_forms.Hertz(np.pi * MODULUS / (4.0 * RADIUS), RADIUS, MODULUS)
"""Half width a = 1 on a rigid plane, with E = 1."""
WIDTH, HEIGHT = 4.0, 2.0


def cut_out(elements: int, cell: str, degree: int) -> rf.Scene:
    """The part |x| < 2, y < 2 of the half-plane, loaded by the closed form's tractions on its cuts.

    The contact pressure is solved for; the truncation brings no error.
    """

    def traction(edge: str, normal: tuple[int, int]) -> rf.Load:
        along = np.linspace(-1.0, 1.0, 1001) * (WIDTH if normal[1] else HEIGHT) / 2.0
        x, y = (along, HEIGHT) if normal[1] else (normal[0] * WIDTH / 2.0, along + HEIGHT / 2.0)
        xx, yy, xy = np.moveaxis(HERTZ.stress(x, y), -1, 0)
        tx, ty = xx * normal[0] + xy * normal[1], xy * normal[0] + yy * normal[1]
        parts = [{"x": along.tolist(), "value": part.tolist()} for part in (tx, ty)]
        return rf.Load(edge, edge, traction=(parts[0], parts[1]))

    normals = {"top": (0, 1), "right": (1, 0), "left": (-1, 0)}
    return rf.Scene(
        body=rf.Body(width=WIDTH, height=HEIGHT),
        material=rf.Material(1.0, POISSON),
        mesh=rf.MeshOptions(elements, cell, degree, growth=1.0),
        contacts=(rf.Contact("bottom", (-1.5, 1.5), 0.0, f"x**2 / {2.0 * RADIUS}"),),
        loads=tuple(traction(*pair) for pair in normals.items()),
        supports=(rf.Support("x", point=(0.0, HEIGHT)),),
        history=rf.HistoryOptions("table", columns=tuple(normals), rows=((0.0,) * 3, (1.0,) * 3)),
        probes=(rf.Probe("axis", segment=((0.0, 0.25), (0.0, 1.5)), count=6),),
    )


def error(elements: int, cell: str, degree: int) -> float:
    """Largest error of any stress on the axis, at depths from a / 4 to 3 a / 2, over p0."""
    probe = rf.given(rf.run(cut_out(elements, cell, degree))).probe("axis")
    xx, yy, xy = np.moveaxis(HERTZ.stress(*probe.points.T), -1, 0)
    known = np.column_stack([xx, yy, POISSON * (xx + yy), xy])
    return float(np.abs(probe.stress[-1] - known).max()) / HERTZ.p0


@pytest.mark.parametrize(
    ("cell", "degree", "largest"),
    [("quadrilateral", 1, 2e-3), ("quadrilateral", 2, 1e-3), ("triangle", 2, 6e-4)],
)
def test_stress_below_a_pressed_cylinder_is_hertzian_to_second_order(
    cell: str, degree: int, largest: float
) -> None:
    coarse, fine = (error(elements, cell, degree) for elements in (16, 64))
    assert fine < largest
    # measured: 1.99, 1.97, 1.89
    assert np.log(coarse / fine) / np.log(4.0) > 1.8
