"""Axisymmetric bodies against closed forms: patch tests, Lame's ring, Boussinesq's punch."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, NU, YOUNG, cylinder

import receding_fenicsx as rf
from receding_fenicsx.interface.measures.zones import on_axis
from receding_fenicsx.output.report.contact import zones_header, zones_shown

comm = MPI.COMM_WORLD


def punch(degree: int, elements: int) -> tuple[float, float, float]:
    """Errors of the pressure on the axis, mean within 0.9 a, of the first node against the axis."""
    height, force = 20.0, 1.0
    scene = cylinder(
        degree=degree,
        body=rf.Body(width=2.0 * height, height=height),
        mesh=rf.MeshOptions(elements, "triangle", degree, 1.15),
        contacts=(rf.Contact(friction=0.0, span=(0.0, 1.0)),),
        loads=(rf.Load("P", "top", pressure=force / (np.pi * height**2)),),
    )
    record = rf.run(scene)
    if record is None:
        return 0.0, 0.0, 0.0
    inside = record.x < 0.9
    p, exact = record.turning_points.p[-1], 1.0 / (2.0 * np.pi)
    shape = exact / np.sqrt(1.0 - record.x[inside] ** 2)
    assert record.turning_points.P[-1].sum() == pytest.approx(force, rel=1e-10)
    first = float(p[0] / on_axis(record.x, p) - 1.0)
    axis = float(on_axis(record.x, p) / exact - 1.0)
    return abs(axis), float(np.abs(p[inside] / shape - 1.0).mean()), abs(first)


@pytest.mark.parametrize("degree", [1, 2])
def test_pressure_under_a_flat_punch_converges_to_boussinesq(degree: int) -> None:
    """The closed form p = P / (2 pi a sqrt(a^2 - r^2)), also on the axis; order 1 by its edge."""
    coarse, fine = (punch(degree, elements) for elements in (400, 800))
    if comm.rank == 0:
        assert fine[0] < 0.55 * coarse[0] < 0.045
        assert fine[1] < 0.65 * coarse[1] < 0.06
        assert fine[2] < min(0.4 * coarse[2], 5e-3)


def washer(cell: str = "triangle", degree: int = 2, **parts: object) -> rf.Scene:
    """A ring 3 <= r <= 7 between smooth planes, under pressure inside and on its top."""
    scene = cylinder(
        cell,
        degree,
        body=rf.Body(width=4.0, height=1.0, position=(5.0, -0.5)),
        loads=(rf.Load("inside", "left", pressure=1.0), rf.Load("top", "top", pressure=1.0)),
        history=rf.HistoryOptions(kind="table", columns=("inside", "top"), rows=((0.5, 0.8),)),
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_rectangle_beside_the_axis_is_lames_ring_at_its_own_radii(cell: str, degree: int) -> None:
    """u_r = ((1 - nu) A r + (1 + nu) B / r + nu p r) / E, with p on the plane everywhere."""
    a, b, inside, top = 3.0, 7.0, 0.5, 0.8
    record = rf.run(washer(cell, degree, mesh=rf.MeshOptions(32, cell, degree, 1.3)))
    if record is None:
        return
    x, table = record.x, record.turning_points
    assert (x[0], x[-1]) == (a, b) and np.array_equal(record.points[:, 0], x)
    assert np.all(record.points[:, 1] == -0.5)
    A, B = inside * np.array([a**2, a**2 * b**2]) / (b**2 - a**2)
    expected = ((1.0 - NU) * A * x + (1.0 + NU) * B / x + NU * top * x) / YOUNG
    tolerance = 1e-3 if degree == 1 else 5e-6
    assert np.abs(table.v[-1] - expected).max() < tolerance * expected.max()
    assert np.abs(table.p[-1] - top).max() < (0.02 if degree == 1 else 1e-3) * top
    assert table.P[-1].sum() == pytest.approx(top * np.pi * (b**2 - a**2), rel=1e-12)
    # work-conjugate to the pressure inside: the volume that the bore's wall sweeps outwards
    bore = ((1.0 - NU) * A * a + (1.0 + NU) * B / a + NU * top * a) / YOUNG
    assert table.load_displacement[-1, 0] == pytest.approx(2.0 * np.pi * a * bore, rel=tolerance)
    point = rf.summarise(record)["turning_points"][-1]
    assert point["zones"] == [["contact", a, b]] and point["contact_half_width"] == 2.0
    assert "p_axis" not in point
    assert zones_shown(point, rf.summarise(record)) == "3.0000 contact to 7.0000"
    assert zones_header(rf.summarise(record)) == "zones"
