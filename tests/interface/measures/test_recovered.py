"""Recovered tractions: smooth ones, the law and the resultants, closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from demo_runs import demo, sheared_cylinders
from nodal import nodal_forces, with_middles

import receding_fenicsx as rf
from receding_fenicsx.evolution.moment import moment_of
from receding_fenicsx.interface.law import friction_of
from receding_fenicsx.interface.measures.tractions import Tractions, midside_nodes, recover

Array = np.ndarray

STICK, OPEN, FORWARD, BACKWARD = 1, 2, 3, 4


def nodal(corners: Array, traction: Any, radius: Any = None) -> tuple[Array, Array, Array]:
    """Nodes, weights and nodal forces of a traction on elements of order 2, by quadrature."""
    x = with_middles(corners)
    around = radius or np.ones_like

    weight = nodal_forces(x, 2, around)
    return x, weight, nodal_forces(x, 2, lambda at: around(at) * traction(at))


def sliding(f: Array, x: Array, weight: Array, P: Array, **parts: Any) -> Tractions:
    law = friction_of(f, None)
    return Tractions(x, weight, P, -f * P, np.full(len(x), FORWARD), law, **parts)


RADII = {
    "plane": None,
    "flat ring": lambda x: x,
    "cylinder": lambda x: np.full_like(x, 2.0),
    "cone": lambda x: 3.0 - x,
}
"""Distance of the nodes from the axis by their position along the edge."""


@pytest.mark.parametrize("shape", RADII)
def test_parabola_is_recovered_on_unequal_elements(shape: str) -> None:
    radius = RADII[shape]
    corners = np.array([0.3, 0.4, 0.52, 0.6, 0.71, 0.8, 0.88, 1.0, 1.1])
    x, weight, P = nodal(corners, lambda at: 3.0 - 2.0 * (at - 0.4) ** 2, radius)
    known = 3.0 - 2.0 * (x - 0.4) ** 2
    at = sliding(np.full(len(x), 0.3), x, weight, P, radius=radius and radius(x))
    p, q = recover(at)
    # the first element and the last one, and the corners next to them, keep their forces
    middle = midside_nodes(x, weight, at.radius)[1:-1]
    before = np.abs(P / weight - known)[middle].max()
    assert np.abs(p - known)[middle].max() < 0.2 * before
    assert np.abs(p - known)[6:-6].max() < 0.2 * np.abs(P / weight - known)[6:-6].max()
    assert np.array_equal(p[:2], (P / weight)[:2])
    assert np.allclose(q, -0.3 * p, rtol=1e-14)


def test_no_recovery_breaks_the_law_that_the_nodal_forces_keep() -> None:
    """Pressures from large to almost none, stick up to its limit beside slip and open nodes."""
    x, weight, _ = nodal(np.linspace(-1.0, 1.0, 17), np.ones_like)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        P = weight * np.square(np.repeat(rng.uniform(0.01, 1.0, 11), 3))
        f = 0.3 + 0.2 * (seed % 2) * np.sin(5.0 * x)
        state = np.repeat(rng.choice([STICK, FORWARD, BACKWARD, OPEN][: 3 + seed // 20], 11), 3)
        P[state == OPEN] = 0.0
        share = np.where(state == STICK, np.repeat(rng.choice([-1.0, -0.99, 0.99], 11), 3), 1.0)
        Q = f * P * np.where(state == FORWARD, -1.0, share)
        p, q = recover(Tractions(x, weight, P, Q, state, friction_of(f, None)))
        assert np.all(p >= 0.0) and np.all(np.abs(q) <= f * p + 1e-13), seed
        assert weight @ p == pytest.approx(P.sum(), rel=1e-13)
        assert weight @ q == pytest.approx(Q.sum(), abs=1e-13)
        # what keeps the resultant of q under changing friction moves p
        assert seed % 2 or (weight * x) @ p == pytest.approx(x @ P, abs=1e-13)
        assert np.abs(f * p - np.abs(q))[state != STICK].max(initial=0.0) <= 1e-13
        turned = np.array([0, STICK, OPEN, BACKWARD, FORWARD])[state]
        at, m, N, T, s, c = (part[::-1] for part in (-x, weight, P, -Q, turned, f))
        image = recover(Tractions(at, m, N, T, s, friction_of(c, None)))
        assert np.allclose(image, [p[::-1], -q[::-1]], rtol=0.0, atol=1e-13), seed


def zigzag(error: Array) -> Array:
    """Part of an error that alternates from node to node."""
    return 0.25 * (error[:-2] - 2.0 * error[1:-1] + error[2:])


def test_sheared_cylinders_have_less_error_and_a_fifth_of_the_zigzag() -> None:
    mindlin, record = demo("cattaneo_mindlin"), rf.given(sheared_cylinders())
    known, hertz = mindlin["KNOWN"], mindlin["HERTZ"]
    x, s = record.x, record.samples
    spacing = float(np.diff(x).max())
    size = {"p": np.zeros(2), "q": np.zeros(2)}
    for i in range(len(s.s)):
        leg = mindlin["LEGS"].get((int(s.cycle[i]), int(s.leg[i])))
        if leg is None:
            continue
        moment = moment_of(record, s, i)
        Q = moment.load["Q"]
        found = dict(zip("pq", rf.recovered_tractions(record, moment), strict=True))
        exact = {"p": hertz.pressure(x), "q": -known.traction(x, Q, leg)}
        ends = hertz.a, known.stick_half_width(Q, leg), known.stick_half_width(0.3, "loading")
        inside = np.abs(x) < hertz.a
        away = inside & np.all([np.abs(np.abs(x) - end) > 8.5 * spacing for end in ends], axis=0)
        for name in "pq":
            errors = [getattr(moment, name) - exact[name], found[name] - exact[name]]
            before, after = (np.abs(error).mean() for error in errors)
            assert after < before, (name, leg, Q)
            size[name] += [np.square(zigzag(error)[away[1:-1]]).sum() for error in errors]
    for before, after in size.values():
        # measured: 9.6 and 14
        assert np.sqrt(before / after) > 5.0
