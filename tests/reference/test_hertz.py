"""Stress below a pressed cylinder, at probes, against Hertz and McEwen."""

from __future__ import annotations

import numpy as np
import pytest

import receding_fenicsx as rf

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

    names = ("top", "right", "left")
    normals = ((0, 1), (1, 0), (-1, 0))
    return rf.Scene(
        body=rf.Body(width=WIDTH, height=HEIGHT),
        material=rf.Material(1.0, POISSON),
        mesh=rf.MeshOptions(elements, cell, degree, growth=1.0),
        contacts=(rf.Contact("bottom", (-1.5, 1.5), 0.0, f"x**2 / {2.0 * RADIUS}"),),
        loads=tuple(traction(*pair) for pair in zip(names, normals, strict=True)),
        supports=(rf.Support("x", point=(0.0, HEIGHT)),),
        history=rf.HistoryOptions("table", columns=names, rows=((0.0,) * 3, (1.0,) * 3)),
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
