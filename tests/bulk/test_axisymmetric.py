"""Axisymmetric bodies against closed forms: patch tests, Lame's ring, Boussinesq's punch."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, NU, ONCE, RADIUS, ROUND, YOUNG, built, condense, cylinder, make_mesh
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk.body import back_substitute
from receding_fenicsx.bulk.elasticity import build
from receding_fenicsx.bulk.stress import STRESSES, stresses
from receding_fenicsx.interface.measures.zones import on_axis
from receding_fenicsx.studies.run import condense as condense_scene

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]


def evolved(scene: rf.Scene) -> rf.Record | None:
    system = condense_scene(scene)
    return None if system is None else rf.evolve(system, scene)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_forces_and_displacements_are_those_of_the_full_circle(cell: str, degree: int) -> None:
    p = 0.75
    scene = cylinder(cell, degree, history=replace(ONCE, maximum=p))
    record = evolved(scene)
    if record is None:
        return
    table, area = record.turning_points, np.pi * RADIUS**2
    assert record.weight.sum() == pytest.approx(area, rel=1e-13)
    assert table.P[-1].sum() == pytest.approx(p * area, rel=1e-13)
    assert table.p[-1] == pytest.approx(p, rel=1e-11)
    assert table.v[-1] == pytest.approx(NU * p / YOUNG * record.x, abs=1e-13)
    # work-conjugate to the pressure: the volume that the top sweeps
    assert table.load_displacement[-1, 0] == pytest.approx(p / YOUNG * area, rel=1e-12)
    summary = rf.summarise(record)
    assert summary["symmetry"] == "axisymmetric"
    assert summary["turning_points"][-1]["contact_half_width"] == RADIUS
    assert summary["turning_points"][-1]["zones"] == [["contact", 0.0, RADIUS]]
    assert summary["turning_points"][-1]["p_axis"] == pytest.approx(p, rel=1e-11)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("nu", [-0.4, 0.0, 0.3, 0.49])
def test_pressure_on_the_mantle_gives_uniform_stress(cell: str, degree: int, nu: float) -> None:
    """Patch test: radial and hoop stress -p, u_r = -(1 - nu) p r / E; squeezed between smooth ends.

    The end pressure is chosen to leave the height as it is: 2 nu p.
    """
    p = 0.5
    loads = (rf.Load("p", "right", pressure=1.0), rf.Load("ends", "top", pressure=2.0 * nu))
    material = replace(ROUND, poisson=nu)
    bulk = built(cylinder(cell, degree, loads=loads, material=material), half=True)
    system = condense(bulk)
    u = None
    if system is not None:
        n = system.n
        load = p * system.r_star.sum(axis=0)
        u = np.zeros(2 * n)
        free = np.flatnonzero(~system.held[:n])
        u[free] = np.linalg.solve(system.K[np.ix_(free, free)], -load[free])
        r = load + system.K @ u
        assert np.abs(r[:n][~system.held[:n]]).max() < 1e-12
        assert r[n:] == pytest.approx(2.0 * nu * p * system.weight, abs=1e-11)
        strain = -(1.0 - nu - 2.0 * nu**2) * p / YOUNG
        assert u[:n] == pytest.approx(strain * system.x, abs=1e-12)
    field = back_substitute(bulk, np.array([p, p]), u)
    found = stresses(bulk, field)
    difference = abs(p - 2.0 * nu * p)
    expected = (-p, -2.0 * nu * p, -p, 0.0, difference, 0.5 * difference)
    for name, value in zip(STRESSES, expected, strict=True):
        for function in (found.cell[name], found.nodal[name]):
            assert np.abs(function.x.array - value).max() < 1e-11, name
    bulk.destroy()


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


def ring(degree: int, elements: int, inner: float) -> tuple[float, float]:
    """Largest errors of u_r and of the hoop stress at midpoints of cells, Lame's ring, p inside."""
    width, p = 1.0, 1.0
    scene = cylinder(
        "quadrilateral",
        degree,
        body=rf.Body(width=width, height=0.5),
        mesh=rf.MeshOptions(elements, "quadrilateral", degree, 1.0),
        loads=(rf.Load("p", "left", pressure=p),),
    )
    body = make_mesh(comm, replace(scene, material=rf.Material(YOUNG, NU)), half=False)
    body.mesh.geometry.x[:, 0] += inner + 0.5 * width
    bulk = build(scene, body)
    system = condense(bulk)
    u = np.zeros(0)
    if system is not None:
        n = system.n
        K, load = system.K[:n, :n], system.r_star[0, :n]
        u = np.concatenate([np.linalg.solve(K, -p * load), np.zeros(n)])
        assert system.rigid.shape[1] == 1
    field = back_substitute(bulk, np.array([p]), u)
    a, b = inner, inner + width
    A, B = p * a**2 / (b**2 - a**2), p * a**2 * b**2 / (b**2 - a**2)
    r = bulk.space.tabulate_dof_coordinates()[:, 0]
    radial = ((1.0 - NU) * A * r + (1.0 + NU) * B / r) / YOUNG
    hoop = stresses(bulk, field).cell["szz"]
    middle = hoop.function_space.tabulate_dof_coordinates()[:, 0]
    errors = (
        np.abs(field.x.array[::2] - radial).max() / radial.max(),
        np.abs(hoop.x.array - (A + B / middle**2)).max() / (A + B / a**2),
    )
    bulk.destroy()
    return comm.allreduce(errors[0], MPI.MAX), comm.allreduce(errors[1], MPI.MAX)


@pytest.mark.parametrize("degree", [1, 2])
def test_lame_ring_under_inner_pressure_converges(degree: int) -> None:
    """Displacement of order degree + 1, stress at midpoints of cells of order degree."""
    coarse, fine = (ring(degree, elements, 0.5) for elements in (16, 32))
    orders = np.log2(np.array(coarse) / np.array(fine))
    assert orders[0] > degree + 0.6 and orders[1] > degree - 0.25
    assert fine[0] < (2e-3, 2e-5)[degree - 1] and fine[1] < (3e-3, 1e-3)[degree - 1]


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


@pytest.mark.parametrize("degree", [1, 2])
def test_node_on_the_axis_has_a_contact_condition_only_where_it_has_weight(degree: int) -> None:
    bulk = built(cylinder(degree=degree), half=True)
    contact = bulk.contact
    (side,), n = contact.sides, len(contact.node)
    assert side.x[0] == (0.0 if degree == 1 else 0.125)
    assert side.weight.min() > 0.0
    assert contact.held.tolist() == [degree == 1] + [False] * (2 * n - 1)
    # the axial motion alone is rigid
    rigid = np.concatenate([np.zeros(n), np.ones(n)])
    assert contact.rigid == pytest.approx(rigid[:, None])
    bulk.destroy()


def test_value_on_the_axis_of_an_even_field() -> None:
    x = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 9.0])
    field = np.stack([3.0 - 2.0 * x**2, np.where(x == 0.0, 7.0, 1.0)])
    assert on_axis(x, field) == pytest.approx([3.0, 1.0])
