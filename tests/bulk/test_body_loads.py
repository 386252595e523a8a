"""Body forces and thermal strains, against closed forms, halves and wholes, and work."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, cylinder, played

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array

comm = MPI.COMM_WORLD
E, NU = 2.0, 0.3
HEAT = rf.Load("heat", thermal_strain=0.013)
ONCE = rf.HistoryOptions(kind="monotonic")
KINDS = ("plane stress", "plane strain", "axisymmetric")
ORDERS = ((1, "triangle"), (1, "quadrilateral"), (2, "triangle"), (2, "quadrilateral"))
POINTS = rf.Probe("s", points=((0.3, 0.4), (0.7, 0.9), (1.1, 0.12)))


def at_probe(record: rf.Record) -> dict[str, Array]:
    """Values of the probe "s" at the end, each (points,)."""
    probe = record.probe("s")
    values = np.hstack([probe.displacement[-1], probe.stress[-1]])
    return dict(zip(("ux", "uy", "sxx", "syy", "szz", "sxy"), values.T, strict=True))


@pytest.mark.one_rank
@pytest.mark.parametrize(("degree", "cell"), ORDERS)
@pytest.mark.parametrize("kinematics", KINDS)
def test_bar_between_walls(kinematics: str, degree: int, cell: str) -> None:
    """Sides free: s_yy = -E alpha dT; in plane strain s_yy = s_zz = -E alpha dT / (1 - nu)."""
    heat = 0.013
    scene = block(
        cell,
        degree,
        load=HEAT,
        material=rf.Material(E, NU, kinematics),
        contacts=(rf.Contact(friction=0.0),),
        supports=(rf.Support("y", edge="top"),),
        history=ONCE,
        probes=(POINTS,),
    )
    known = -E * heat / (1.0 - NU if kinematics == "plane strain" else 1.0)
    stress = {"sxx": 0.0, "syy": known, "sxy": 0.0}
    stress["szz"] = known if kinematics == "plane strain" else 0.0
    record = played(scene)
    assert record.turning_points.p[-1] == pytest.approx(-known, rel=1e-9)
    at = at_probe(record)
    for name, value in stress.items():
        np.testing.assert_allclose(at[name], value, atol=1e-9 * abs(known))
    # the conjugate: integral of the held stress times the dilation
    dilation = {"plane stress": 1.0 + NU, "axisymmetric": 2.0 * (1.0 + NU)}
    dilation["plane strain"] = 1.0 + 2.0 * NU / (1.0 - NU)
    held = E * heat / (1.0 - NU if kinematics == "plane stress" else 1.0 - 2.0 * NU)
    volume = 4.0 * np.pi if kinematics == "axisymmetric" else 4.0
    conjugate = held * heat * dilation[kinematics] * volume
    assert record.turning_points.load_displacement[-1, 0] == pytest.approx(conjugate, rel=1e-9)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("kinematics", ["plane stress", "plane strain"])
def test_free_expansion_by_a_linear_field(kinematics: str, cell: str) -> None:
    """Strains a + b x + c y are compatible: no stress in the plane; s_zz = -E alpha dT."""
    heat = rf.Load("heat", thermal_strain="0.01 + 0.004*x - 0.003*y")
    material = rf.Material(E, NU, kinematics)
    scene = block(cell, 2, load=heat, material=material, probes=(POINTS,))
    system = rf.condense(scene, comm)
    if system is None:
        return
    # contact displacements that leave no reaction
    u = -np.linalg.lstsq(system.K, system.r_star[0], rcond=1e-12)[0]
    left = np.abs(system.r_star[0] + system.K @ u).max()
    assert left < 1e-11 * np.abs(system.r_star[0]).max()
    at = rf.given(system.probes).rows @ np.concatenate([u, [1.0]])
    x, y = np.array(POINTS.points).T
    strain = 0.01 + 0.004 * x - 0.003 * y
    assert np.abs(at[:, [2, 3, 5]]).max() < 1e-10 * E
    szz = -E * strain if kinematics == "plane strain" else 0.0 * x
    np.testing.assert_allclose(at[:, 4], szz, atol=1e-10 * E)


# -- rotation ------------------------------------------------------------------------------------


@pytest.mark.one_rank
@pytest.mark.parametrize("degree", [1, 2])
def test_rotating_shaft_between_smooth_plates(degree: int) -> None:
    """Long shaft, e_zz given: s_rr = (3 - 2 nu)/(8 (1 - nu)) rho omega^2 (R^2 - r^2)."""
    squeeze, rate = 0.5, 0.4
    scene = cylinder(
        degree=degree,
        loads=(
            rf.Load("press", "top", displacement=("free", -squeeze)),
            rf.Load("spin", body_force=(f"{rate}*x", 0.0)),
        ),
        mesh=rf.MeshOptions(32, "quadrilateral", degree, 1.0),
        history=rf.HistoryOptions(kind="monotonic", load="spin", constant={"press": 1.0}),
        probes=(POINTS,),
    )
    record = played(scene)
    r = np.array(POINTS.points)[:, 0]
    c, R = 1.0 / (8.0 * (1.0 - NU)), 2.0
    srr = c * (3.0 - 2.0 * NU) * rate * (R**2 - r**2)
    stt = c * rate * ((3.0 - 2.0 * NU) * R**2 - (1.0 + 2.0 * NU) * r**2)
    szz = -E * squeeze + NU * (srr + stt)
    at = at_probe(record)
    off = 2e-2 if degree == 1 else 3e-4
    for found, known in (("sxx", srr), ("szz", stt), ("syy", szz)):
        np.testing.assert_allclose(at[found], known, atol=off * srr.max())
    eps = (stt - NU * (srr + szz)) / E
    np.testing.assert_allclose(at["ux"], r * eps, rtol=1e-2 * off, atol=0.2 * off * eps.max())


# -- halves, wholes, pairs, work -----------------------------------------------------------------


FIELDS = ("0.01", "0.01*y", "-0.01*y", "0.01*(1-y)", "0.01*x", "0.01*x**2*y", "0.01*sin(3*x)*y")


@pytest.mark.one_rank
@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
@pytest.mark.parametrize("left", [-1.0, -0.3])
@pytest.mark.parametrize("field", FIELDS)
def test_a_free_body_that_is_heated_first_rests_where_it_is_pressed(
    field: str, left: float, method: str
) -> None:
    """Without friction the end does not depend on what came first, heat or pressure."""

    def pressures(f: float, *rows: tuple[float, float]) -> Array:
        loads = (
            rf.Load("heat", thermal_strain=field),
            rf.Load("p", "top", (left, 1.0), pressure=1.0),
        )
        history = rf.HistoryOptions("table", columns=("heat", "p"), rows=rows)
        scene = block(contacts=(rf.Contact(friction=f),), history=history)
        solver = rf.SolverOptions(method=method, steps_per_leg=4)
        return played(replace(scene, loads=loads, solver=solver)).turning_points.P

    heated, pressed = (pressures(0.0, first, (1.0, 1.0))[-1] for first in ((1.0, 0.0), (0.0, 1.0)))
    np.testing.assert_allclose(heated, pressed, atol=1e-9)
    cooled = (1.0, 0.0), (1.0, 1.0), (0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (-1.0, 1.0)
    sums = pressures(0.3, *cooled).sum(axis=1)
    np.testing.assert_allclose(sums, (1.0 - left) * np.array([0, 1, 0, 0, 0, 1]), atol=1e-9)
