"""Axisymmetric bodies against closed forms: patch tests, Lame's ring, Boussinesq's punch."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from bodies import built, cylinder

import receding_fenicsx as rf
from receding_fenicsx.interface.measures.zones import on_axis
from receding_fenicsx.studies.run import condense as condense_scene

comm = MPI.COMM_WORLD


def evolved(scene: rf.Scene) -> rf.Record | None:
    system = condense_scene(scene)
    return None if system is None else rf.evolve(system, scene)


@pytest.mark.parametrize(
    ("load", "down", "out"),
    [
        # integrals of r, of r^2 and of z over the edges
        (rf.Load("p", "top", pressure=1.0), 2.0, 0.0),
        (rf.Load("p", "top", (0.0, 1.0), pressure="x"), 1.0 / 3.0, 0.0),
        (rf.Load("p", "right", pressure="y"), 0.0, -2.0 * 0.5),
        (rf.Load("p", "top", (1.0, 2.0), traction=("y", "-x")), 7.0 / 3.0, 1.5),
        (rf.Load("p", "top", platen=True, force=(0.0, -2.0 * np.pi)), 1.0, 0.0),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_nodal_forces_are_those_of_one_radian(
    degree: int, load: rf.Load, down: float, out: float
) -> None:
    bulk = built(cylinder(degree=degree, loads=(load,)), half=True)
    force = bulk.loads[0].getArray(readonly=True).reshape(-1, 2).sum(axis=0)
    assert comm.allreduce(force) == pytest.approx([out, -down], abs=1e-12)
    bulk.destroy()


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
    record = evolved(scene)
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
