"""Half-planes without a mesh: kernels, stiffness and fields against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from receding_fenicsx.arrays import Array
from receding_fenicsx.half_plane import interior
from receding_fenicsx.half_plane.stiffness import (
    FarField,
    Surface,
    SurfaceStiffness,
    compliance,
    condense_far_field,
    plane_material,
    surface_of,
)

RANDOM = np.random.default_rng(3)
STEEL = plane_material(200.0, 0.3, plane_stress=False)


def graded(n: int, half: float = 1.0) -> Array:
    """Nodes that are six times as dense at the ends as in the middle."""
    s = np.linspace(-1.0, 1.0, n)
    return half * (1.2 * s - 0.2 * s**3) + 0.0


def surface(x: Array, order: int = 1) -> Surface:
    """A surface of neighbouring nodes."""
    lower = np.arange(len(x) - 1)
    return surface_of(x, np.stack([lower, lower + 1], axis=1), order)


def point_values(part: Surface, points: Array, datum: float, tractions: Array) -> Array:
    """(m, 6) values under nodal tractions [q; p]."""
    q, p = np.split(tractions, 2)
    return interior.point_values(part, STEEL, points, datum, (q + 1j * p)[:, None])[..., 0]


def modes_of(x: Array) -> Array:
    """(2N, 3) rigid motions [v; w]."""
    one, zero = np.ones_like(x), np.zeros_like(x)
    along, across = np.concatenate([one, zero]), np.concatenate([zero, one])
    return np.column_stack([along, across, np.concatenate([zero, x])])


def pressed(free: tuple[bool, bool, bool] = (True, True, False)) -> FarField:
    """A far field under a unit force against n."""
    return FarField(np.array(free), np.array([[0.0, -1.0, 0.0]]), np.zeros((1, 3)), -np.ones(1))


def test_integrals_over_elements_are_sums_of_those_over_their_parts() -> None:
    """Long elements beside short ones of a tenth; the hats of both surfaces are nested."""
    lengths = np.array([1, 10, 1, 1, 10, 10, 1, 3, 1, 10])
    ends, fine = np.append(0, np.cumsum(lengths)), np.arange(lengths.sum() + 1)
    coarse, parts = (surface(line / fine[-1]) for line in (ends, fine))
    nested = np.array([np.interp(fine, ends, hat) for hat in np.eye(len(ends))])
    for name in ("logs", "signs"):
        known = nested @ getattr(parts, name) @ nested.T
        assert np.abs(getattr(coarse, name) - known).max() < 1e-8 * np.abs(known).max(), name


@pytest.mark.parametrize("order", [1, 2])
def test_a_surface_does_not_depend_on_the_numbers_of_nodes_and_elements(order: int) -> None:
    x, n = graded(13), 13
    number = np.random.default_rng(5).permutation(n)  # of each node from left to right
    elements = np.stack([number[:-1], number[1:]], axis=1)
    # an element of order 2 has two of them
    shuffled = elements.reshape(-1, order, 2)[::-1, ::-1].reshape(-1, 2)
    found, known = surface_of(x[number.argsort()], shuffled, order), surface(x, order)
    for name in ("B", "logs", "signs"):
        mine = getattr(found, name)[np.ix_(number, number)]
        assert mine == pytest.approx(getattr(known, name), abs=1e-15)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("side", [1, -1])
def test_stiffness_is_symmetric_and_keeps_rigid_motions(order: int, side: int) -> None:
    x = graded(81, 3.0)
    part = surface(x, order)
    D = compliance(part, STEEL, side, 60.0)
    assert np.array_equal(D, D.T)
    found = condense_far_field(SurfaceStiffness(part, D).A, modes_of(x), pressed((True,) * 3))
    size = np.abs(found.K).sum(axis=1).max()
    assert np.array_equal(found.K, found.K.T)
    assert np.abs(found.K @ modes_of(x)).max() < 1e-14 * size
    assert np.linalg.eigvalsh(found.K).min() > -1e-13 * size
    # the reactions balance the far force, without a moment
    assert np.allclose(modes_of(x).T @ found.r_star[0], [0.0, 1.0, 0.0], atol=1e-12)


def test_far_field_follows_from_the_balance_of_forces() -> None:
    """Under a force and a given rotation; work-conjugate: motion of the force, its own moment."""
    x = graded(9)
    part, modes = surface(x), modes_of(x)
    A = SurfaceStiffness(part, compliance(part, STEEL, 1, 20.0)).A
    R, F, turn = modes[:, :2], np.array([0.3, -1.0]), 0.5 * modes[:, 2]
    force, moved = np.array([[*F, 0.0], [0, 0, 0]]), np.array([[0, 0, 0], [0, 0, 0.5]])
    far = FarField(np.array([True, True, False]), force, moved, np.array([-1.0, 1.0]))
    found = condense_far_field(A, modes, far)
    for load in np.eye(2):
        a = np.linalg.solve(R.T @ A @ R, load[0] * F - R.T @ A @ turn * load[1])
        r = -A @ (R @ a + turn * load[1])
        assert found.r_star.T @ load == pytest.approx(r, abs=1e-9 * np.abs(A).max())
        assert found.compliance @ load == pytest.approx([F @ a, -turn @ r], rel=1e-9)
        # with the contact nodes moved too
        u = RANDOM.standard_normal(len(A))
        a = a + np.linalg.solve(R.T @ A @ R, R.T @ A @ u)
        on_u, on_loads = found.motion
        assert on_u @ u + on_loads @ load == pytest.approx([*a, 0.5 * load[1]], rel=1e-9)


def bonded_errors(n: int, plane_stress: bool) -> tuple[float, float]:
    """Errors of p, relative, and q, over P / a, on 0.8 of a bonded punch of half width 1.

    Johnson, Contact Mechanics, section 2.8(c): p + i q oscillates with ln(kappa).
    """
    material = plane_material(3.0, 0.1, plane_stress)
    x = graded(n)
    part = surface(x)
    A = SurfaceStiffness(part, compliance(part, material, 1, 20.0)).A
    r = condense_far_field(A, modes_of(x), pressed()).r_star[0]
    inside = np.abs(x) < 0.8
    q, p = (values[inside] for values in np.split(r, 2) / part.weight)
    kappa, x = material.kappa, x[inside]
    size = (1.0 + kappa) / (2.0 * np.sqrt(kappa)) / (np.pi * np.sqrt(1.0 - x**2))
    turn = np.log(kappa) / (2.0 * np.pi) * np.log((1.0 + x) / (1.0 - x))
    # the surface would move inwards
    errors = p / (size * np.cos(turn)) - 1.0, q - size * np.sin(turn)
    return float(np.abs(errors[0]).max()), float(np.abs(errors[1]).max())


def punch_errors(n: int) -> tuple[float, float]:
    """Errors of pressure (on 0.9) and approach of a frictionless punch of half width 2.

    p = P / (pi sqrt(a^2 - x^2)), and c1 P ln(2 d / a) - P / (2 pi mu) below the datum.
    """
    x, d = graded(n, 2.0), 50.0
    part = surface(x)
    D = compliance(part, STEEL, 1, d)[n:, n:]
    A = part.B.T @ np.linalg.solve(D, part.B)
    p = A @ np.ones(n) / A.sum() / part.weight
    inside = np.abs(x) < 1.8
    known = 1.0 / (np.pi * np.sqrt(4.0 - x[inside] ** 2))
    approach = STEEL.c1 * np.log(2.0 * d / 2.0) - 1.0 / (2.0 * np.pi * STEEL.mu)
    return float(np.abs(p[inside] / known - 1.0).max()), abs(1.0 / A.sum() / approach - 1.0)


@pytest.mark.parametrize(
    ("errors_of", "largest", "order"),
    [
        (partial(bonded_errors, plane_stress=False), (1e-3, 5e-4), 0.6),
        (partial(bonded_errors, plane_stress=True), (1e-3, 5e-4), 0.6),
        (punch_errors, (1e-3, 1e-4), 0.7),
    ],
)
def test_punches_have_known_tractions_and_approach(
    errors_of: Callable[[int], tuple[float, float]], largest: tuple[float, float], order: float
) -> None:
    coarse, fine = (np.array(errors_of(n)) for n in (201, 401))
    assert np.all(fine < largest) and np.all(fine < order * coarse)


def test_stresses_inside_balance_and_follow_hookes_law() -> None:
    x = graded(21)
    part, h = surface(x), 1e-4
    tractions = RANDOM.standard_normal(42)
    points = np.array([[0.13, 0.4], [-0.7, 0.2], [1.5, 0.9]])

    def at(dx: float, dy: float) -> Array:
        return point_values(part, points + np.array([dx, dy]), 30.0, tractions)

    by_x, by_y = (at(h, 0.0) - at(-h, 0.0)) / (2 * h), (at(0.0, h) - at(0.0, -h)) / (2 * h)
    middle = at(0.0, 0.0)
    scale = np.abs(middle[:, 2:]).max()
    assert np.abs(by_x[:, 2] + by_y[:, 5]).max() < 1e-5 * scale
    assert np.abs(by_x[:, 5] + by_y[:, 3]).max() < 1e-5 * scale
    lam = 2.0 * STEEL.mu * STEEL.nu_out / (1.0 - 2.0 * STEEL.nu_out)
    dilation = by_x[:, 0] + by_y[:, 1]
    assert np.allclose(lam * dilation + 2 * STEEL.mu * by_x[:, 0], middle[:, 2], atol=1e-5 * scale)
    assert np.allclose(lam * dilation + 2 * STEEL.mu * by_y[:, 1], middle[:, 3], atol=1e-5 * scale)
    assert np.allclose(STEEL.mu * (by_y[:, 0] + by_x[:, 1]), middle[:, 5], atol=1e-5 * scale)


def test_stresses_at_the_surface_are_the_tractions() -> None:
    x = graded(21)
    part = surface(x)
    q, p = RANDOM.standard_normal((2, 21))
    at = 0.5 * (x[1:] + x[:-1])
    points = np.stack([at, np.zeros(20)], axis=1)
    values = point_values(part, points, 30.0, np.concatenate([q, p]))
    assert np.allclose(values[:, 3], -np.interp(at, x, p), atol=1e-6)
    assert np.allclose(values[:, 5], -np.interp(at, x, q), atol=1e-6)


def test_displacements_at_the_surface_are_those_of_the_compliance() -> None:
    """The mean over a hat function of the displacement inside is D's."""
    x = graded(15)
    part = surface(x)
    tractions = RANDOM.standard_normal(30)
    work = compliance(part, STEEL, 1, 30.0) @ tractions
    point, weight = np.polynomial.legendre.leggauss(40)
    for i in (0, 7, 14):
        means = np.zeros(2)
        for low, high in part.elements[np.any(part.elements == i, axis=1)]:
            at = 0.5 * (x[low] + x[high]) + 0.5 * (x[high] - x[low]) * point
            u = point_values(part, np.stack([at, 0.0 * at], 1), 30.0, tractions)[:, :2]
            hat = np.interp(at, x, np.eye(15)[i])
            means += 0.5 * (x[high] - x[low]) * (weight * hat) @ u
        assert np.allclose(means, work[[i, 15 + i]], rtol=1e-5, atol=1e-7)
