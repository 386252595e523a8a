"""Stress exponents at corners: known values, special cases, the boundary conditions anew, a fit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import ONCE, block, played
from demo_runs import sheared_block
from nodal import nodal_forces, with_middles

import receding_fenicsx as rf
from receding_fenicsx.interface.law import friction_of
from receding_fenicsx.interface.measures.tractions import Tractions
from receding_fenicsx.interface.measures.zone_ends import corner_exponent_fit, kolosov
from receding_fenicsx.measures.ends import corners_of, is_singular
from receding_fenicsx.output.report.contact import tell_checks
from receding_fenicsx.reference.corners import corner_exponent


def conditions(lam: complex, alpha: float, kappa: float, slip: float | None) -> Any:
    """Matrix of the four boundary conditions on A, B, C, D, from displacements and stresses."""
    a, b = lam + 1.0, lam - 1.0

    def F(theta: float) -> Any:
        return np.array([f(k * theta) for k in (a, b) for f in (np.cos, np.sin)])

    def slope(theta: float) -> Any:
        sines = [[-k * np.sin(k * theta), k * np.cos(k * theta)] for k in (a, b)]
        return np.array(sines).ravel()

    u_t = np.array([0.0, -(lam + 1.0), 0.0, -(kappa + lam)])
    u_r = np.array([-(lam + 1.0), 0.0, kappa - lam, 0.0])
    last = u_r if slip is None else -lam * slope(0.0) - slip * lam * (lam + 1.0) * F(0.0)
    return np.array([F(alpha), slope(alpha), u_t, last])


@pytest.mark.parametrize("slip", [None, 0.0, 0.5, -0.5, 0.8])
@pytest.mark.parametrize("angle", [75.0, 90.0, 110.0, 150.0, 180.0])
def test_exponent_satisfies_the_boundary_conditions(angle: float, slip: float | None) -> None:
    kappa = kolosov(0.25)
    m = corner_exponent(angle, kappa, slip)
    matrix = conditions(m + 1.0, math.radians(angle), kappa, slip)
    values = np.linalg.svd(matrix, compute_uv=False)
    assert values[-1] < 1e-8 * values[0]
    # and none with a smaller real part, on the real axis
    for lam in np.linspace(0.02, m.real + 0.97, 60):
        values = np.linalg.svd(conditions(lam, math.radians(angle), kappa, slip), compute_uv=False)
        assert values[-1] > 1e-5 * values[0]


def test_a_corner_is_singular_by_its_closed_form_where_the_fit_does_not_say_otherwise() -> None:
    for exponent, fitted, singular in (
        (-0.3, None, True),
        (-0.3, -0.01, True),
        (-0.3, 0.1, False),
        (0.1, -0.3, False),
        (None, -0.3, True),
        (None, -0.01, False),
        (None, None, False),
    ):
        assert is_singular({"exponent": exponent, "fitted": fitted}) == singular


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("m", [-0.4, -0.1, 0.2, 0.5, 0.8])
def test_fit_takes_no_power_for_the_second_term_of_that_below_it(m: float, side: int) -> None:
    sizes = 1.2 ** np.arange(60.0)
    x = with_middles(np.append(0.0, np.cumsum(sizes)) / sizes.sum())
    weight, state = nodal_forces(x, 2, np.ones_like), np.full(len(x), rf.State.STICK)
    for slope in (-2.0, 0.0, 1e-3, 2.0):
        P = nodal_forces(x, 2, lambda d, a=slope: d**m * (1.0 + a * d))  # type: ignore[misc]
        for noise in (0.0, 1e-4, -1e-4):
            force = P * (1.0 + noise * np.cos(np.arange(len(x))))
            law = friction_of(0.3 + 0.0 * x, None)
            at = Tractions(x if side < 0 else -x, weight, force, 0.0 * x, state, law)
            if side > 0:
                at = replace(at, x=at.x[::-1], weight=weight[::-1], P=force[::-1])
            assert corner_exponent_fit(at, side) == pytest.approx(m, abs=0.01)


@pytest.mark.parametrize("f", [0.5, 0.8])
def test_fit_on_graded_edges_finds_the_exponent(f: float) -> None:
    """Within 1 % on about 120 elements; the largest pressure is called singular."""
    scene = sheared_block(f, "mesh.contact_elements=40")
    mesh = replace(scene.mesh, refine=(rf.Refinement(3e-6, growth=1.2),))
    record = rf.given(rf.run(replace(scene, mesh=mesh)))
    assert len(record.x) < 2 * 160
    exact = corner_exponent(90.0, kolosov(0.3)).real
    fits = 0
    for row in range(1, len(record.turning_points.s)):
        found = corners_of(record, row)
        assert found["p_max_singular"]
        for corner in found["corners"]:
            assert corner["state"] == "stick" and corner["exponent"] == pytest.approx(exact)
            assert corner["fitted"] == pytest.approx(exact, rel=0.01)
            fits += 1
    assert fits >= 3
    summary = rf.summarise(record)
    words = next(words for head, words in tell_checks(summary).rows if head.startswith("corner"))
    assert "m = -0.2888 (closed form, 90 degrees)" in words and words.endswith("; singular")
    assert "infinite stresses" in rf.run_table(summary)
    assert "-0.2888" in rf.run_table(summary, everything=True)


@pytest.mark.parametrize("f", [0.0, 0.3])
@pytest.mark.parametrize("surface", ["bottom", "top"])
def test_ends_of_a_punch_on_a_half_plane_are_straight_angles(surface: str, f: float) -> None:
    """Under a flat punch tractions are d^m, m = -1/2 without friction; Spence's slip else."""
    force = -1.0 if surface == "bottom" else 1.0
    scene = rf.Scene(
        body=rf.Body(shape="half-plane", width=2.0),
        material=rf.Material(poisson=0.0),
        mesh=rf.MeshOptions(40, refine=(rf.Refinement(1e-5, growth=1.2),)),
        contacts=(rf.Contact(surface, friction=f),),
        loads=(rf.Load("P", "far", platen=True, force=(0.0, force)),),
        history=rf.HistoryOptions("monotonic"),
    )
    record = rf.given(rf.run(scene))
    found = corners_of(record, -1)
    # the surface moves inwards under the punch; beta' = (1 - 2 nu) / (2 (1 - nu)) = 1/2
    exact = -0.5 + np.arctan(0.5 * f) / np.pi
    assert found["p_max_singular"]
    assert [corner["angle"] for corner in found["corners"]] == [180.0, 180.0]
    for corner in found["corners"]:
        assert (corner["state"] == "contact") == (f == 0.0)
        assert corner["exponent"] == pytest.approx(exact, abs=1e-9)
        assert corner["fitted"] == pytest.approx(exact, rel=0.01)


def test_an_end_on_a_plane_of_symmetry_is_no_corner_and_one_at_a_held_point_is() -> None:
    plane, *points = (rf.Support("x", "left"), *(rf.Support("x", point=(-2, y)) for y in (0, 1)))
    supports = {(): [0, -1], (plane,): [-1], (plane, points[1]): [-1], (points[0],): [0, -1]}
    for some, ends in supports.items():
        assert played(block(supports=some)).corner_ends == ends, some


def test_corners_of_an_edge_have_the_angles_and_slips_of_its_own_ends() -> None:
    """Of the left edge the upper end touches, and slips downwards."""
    loads = tuple(rf.Load("P", edge, pressure=1.0) for edge in ("top", "right"))
    contacts = (rf.Contact("bottom", (-1.0, 2.0), 0.3), rf.Contact("left", friction=0.3))
    scene = block(loads=loads, contacts=contacts, history=ONCE)
    record = played(scene)
    below, left = (corners_of(edge, -1)["corners"] for edge in record.by_edge().values())
    assert [corner["angle"] for corner in (*below, *left)] == [180.0, 90.0, 90.0]
    assert left[0]["x"] == 0.5 and left[0]["state"] == "forward slip"
    inwards = corner_exponent(90.0, kolosov(0.3), -0.3).real
    assert left[0]["exponent"] == pytest.approx(inwards) and inwards > 0.0
    # the closed form is that of one isotropic body on a rigid plane, whose shape is known
    wood = rf.Material(2.0, 0.3, "plane stress", young_2=1.0, shear=0.5)
    edges = (rf.Contact("a.bottom", against="b.top"), rf.Contact("a.left", against="b.right"))
    pair = {"body": rf.Body("a"), "others": (rf.Body("b"),), "contacts": edges}
    others: tuple[dict[str, Any], ...] = {"material": wood}, {"body": rf.Body(mesh="own.geo")}, pair
    for text in ("", *(rf.to_toml(replace(scene, **parts)) for parts in others)):
        for edge in replace(record, scene_toml=text).by_edge().values():
            for corner in corners_of(edge, -1)["corners"]:
                assert corner["exponent"] is corner["angle"] is None, text
