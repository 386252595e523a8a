"""Closed forms and values by themselves: forces from tractions, limits, quadratures."""

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.integrate import trapezoid
from scipy.optimize import brentq

from receding_fenicsx.arrays import Array
from receding_fenicsx.reference import closed_forms
from receding_fenicsx.reference.closed_forms import CattaneoMindlin, Hertz
from receding_fenicsx.reference.fretting import cycle_dissipation
from receding_fenicsx.reference.layer import _pressures, contact_half_width, double_half_widths


def integral_of_arcs(values, end: float) -> float:  # type: ignore[no-untyped-def]
    """Integrate over |x| < end a function that ends like a square root (x = end sin t)."""
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 20001)
    return float(trapezoid(values(end * np.sin(t)) * end * np.cos(t), t))


@pytest.mark.parametrize("known", [closed_forms.BLOCK, *closed_forms.LAYERS])
def test_pressures_carry_the_load(known: closed_forms.Pressed) -> None:
    # p / sqrt(1 - s^2), s = x / c, is smooth and even: a polynomial in s^2 through all six values
    s = np.array(known.x)
    smooth = polynomial.polyfit(s**2, np.array(known.p) / np.sqrt(1.0 - s**2), len(s) - 1)
    carried = known.half_width * integral_of_arcs(
        lambda x: np.sqrt(np.maximum(1.0 - x**2, 0.0)) * polynomial.polyval(x**2, smooth), 1.0
    )
    assert carried == pytest.approx(2.0 * known.load, rel=1e-3)


@pytest.mark.parametrize("load", [0.0, 0.5, 2.0])
def test_bilateral_pressure_carries_the_load_and_changes_sign_at_filons_value(load: float) -> None:
    zero = brentq(lambda x: float(closed_forms.bilateral_pressure(x)), 1.2, 1.5, xtol=1e-10)
    assert zero == pytest.approx(closed_forms.FILON_ZERO, abs=2e-7)
    x = np.linspace(0.0, 12.0, 601)
    half = trapezoid(closed_forms.bilateral_pressure(x, load), x)
    assert half == pytest.approx(0.5, abs=5e-5)


def test_hertz_pressure_carries_the_force_and_follows_the_gap() -> None:
    hertz = Hertz(force=2.0, radius=30.0, modulus=7.0)
    assert integral_of_arcs(hertz.pressure, hertz.a) == pytest.approx(2.0, rel=1e-7)
    assert hertz.p0 == pytest.approx(np.sqrt(2.0 * 7.0 / (np.pi * 30.0)))
    assert hertz.pressure(2.0 * hertz.a) == 0.0
    # deflection of a half-plane, u' = -(2 / (pi E*)) int p(s) / (x - s) ds = -x / R inside
    for x in (0.3 * hertz.a, 0.7 * hertz.a):
        t = (np.arange(4000) + 0.5) * np.pi / 4000
        s = hertz.a * np.cos(t)
        regular = np.sum((hertz.pressure(s) - hertz.pressure(x)) / (x - s) * hertz.a * np.sin(t))
        log = np.log((hertz.a + x) / (hertz.a - x)) * hertz.pressure(x)
        slope = 2.0 / (np.pi * 7.0) * (regular * np.pi / 4000 + log)
        assert slope == pytest.approx(x / 30.0, rel=1e-4)


HERTZ = Hertz(force=1.3, radius=20.0, modulus=5.0)
F = 0.4
FULL = F * HERTZ.force
MINDLIN = CattaneoMindlin(HERTZ, F, largest=0.7 * FULL)


@pytest.mark.parametrize(
    ("leg", "forces"),
    [
        ("loading", [0.0, 0.3, 0.7, 1.0]),
        ("unloading", [0.69, 0.2, 0.0, -0.5, -0.7]),
        ("reloading", [-0.69, -0.2, 0.0, 0.5, 0.7]),
    ],
)
def test_shear_tractions_carry_the_force_within_the_friction_limit(
    leg: str, forces: list[float]
) -> None:
    x = np.linspace(-1.1 * HERTZ.a, 1.1 * HERTZ.a, 2001)
    limit = F * HERTZ.pressure(x)
    for part in forces:
        q, Q = MINDLIN.traction(x, part * FULL, leg), part * FULL
        carried = integral_of_arcs(lambda x, Q=Q: MINDLIN.traction(x, Q, leg), HERTZ.a)
        assert carried == pytest.approx(Q, abs=1e-5 * FULL)
        assert np.all(np.abs(q) <= limit + 1e-12)
        slips = np.abs(x) > MINDLIN.stick_half_width(Q, leg)
        sign = -1.0 if leg == "unloading" else 1.0
        np.testing.assert_allclose(q[slips], sign * limit[slips], atol=1e-12)


def test_legs_join_at_the_reversals() -> None:
    x = np.linspace(-HERTZ.a, HERTZ.a, 101)

    def q(part: float, leg: str) -> Array:
        return MINDLIN.traction(x, part * FULL, leg)

    np.testing.assert_allclose(q(0.7, "unloading"), q(0.7, "loading"), atol=1e-12)
    np.testing.assert_allclose(q(-0.7, "unloading"), -q(0.7, "loading"), atol=1e-12)
    np.testing.assert_allclose(q(0.7, "reloading"), q(0.7, "loading"), atol=1e-12)
    assert MINDLIN.stick_half_width(0.7 * FULL, "unloading") == HERTZ.a
    for part, leg in ((-0.7, "unloading"), (0.7, "loading")):
        assert MINDLIN.stick_half_width(part * FULL, leg) == pytest.approx(HERTZ.a * np.sqrt(0.3))


def test_hertzian_stress_is_in_equilibrium_and_compatible_below_the_pressure() -> None:
    """Those two, the values on the edge and decay determine the stress."""
    hertz = Hertz(force=1.0, radius=100.0, modulus=50.0)
    x, y = np.meshgrid(hertz.a * np.linspace(-2.1, 2.1, 15), hertz.a * np.linspace(0.2, 3.0, 8))
    h = 1e-4 * hertz.a

    def slope(axis: int) -> Array:
        dx, dy = (h, 0.0) if axis == 0 else (0.0, h)
        return (hertz.stress(x + dx, y + dy) - hertz.stress(x - dx, y - dy)) / (2.0 * h)

    along, down = slope(0), slope(1)
    scale = hertz.p0 / hertz.a
    assert np.abs(along[..., 0] + down[..., 2]).max() < 1e-6 * scale
    assert np.abs(along[..., 2] + down[..., 1]).max() < 1e-6 * scale

    def trace(dx: float, dy: float) -> Array:
        return np.asarray(hertz.stress(x + dx, y + dy)[..., :2].sum(axis=-1))

    h *= 20.0
    laplacian = trace(h, 0) + trace(-h, 0) + trace(0, h) + trace(0, -h) - 4.0 * trace(0, 0)
    assert np.abs(laplacian).max() < 1e-3 * hertz.p0 * (h / hertz.a) ** 2
    edge = hertz.a * np.array([-3.0, -1.5, -0.9, 0.0, 0.3, 0.99, 1.2])
    at = hertz.stress(edge, 0.0)
    assert np.abs(at[:, 1] + hertz.pressure(edge)).max() < 1e-14
    assert np.abs(at[:, 2]).max() < 1e-14
    # far away the pressure is a line load: s_rr = -2 P / (pi r) on the axis
    far = 1e3 * hertz.a
    assert hertz.stress(0.0, far)[1] == pytest.approx(-2.0 / (np.pi * far), rel=1e-5)


# -- layers ----------------------------------------------------------------------------------------


def test_half_widths_of_layers_are_the_tabulated_ones() -> None:
    found = {known.half_width: contact_half_width(known.load) for known in closed_forms.LAYERS}
    for (alpha, load), c in closed_forms.LAYER_ON_HALF_PLANE.items():
        strip = 0.0 if load == "line load" else 0.5
        found[c] = contact_half_width(strip, (1.0 - alpha) / (1.0 + alpha))
    assert [*found.values()] == pytest.approx([*found], rel=1e-7)


def test_two_layers_have_the_limits_of_one() -> None:
    # a stiff second layer is a rigid plane, a thick one a half-plane, which a line load presses
    assert double_half_widths(0.5, 1e-9)[0] == pytest.approx(contact_half_width(0.5), rel=1e-8)
    first, second = double_half_widths(0.5, 1.0, 40.0)
    assert first == pytest.approx(contact_half_width(0.5, 1.0), rel=1e-3)
    assert second / 40.0 == pytest.approx(contact_half_width(0.0), rel=1e-3)
    # a thin stiff one hands all pressure on to the plane; both pressures end without singularity
    thin = double_half_widths(0.5, 0.03, 0.2)
    assert thin == pytest.approx([contact_half_width(0.5)] * 2, rel=0.03)
    assert np.abs(_pressures(np.array(thin), 0.5, 0.03, 0.2)[:, -1]).max() < 1e-9


# -- dissipation of sheared cylinders by the memory of the contact --------------------------------

ANGLE = 2.0 * np.pi * np.arange(801) / 800


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.999, 1.0])
def test_constant_normal_force_gives_the_loop_of_cattaneo_and_mindlin(part: float) -> None:
    largest = part * F * HERTZ.force
    known = CattaneoMindlin(HERTZ, F, largest).dissipation()
    P = np.full_like(ANGLE, HERTZ.force)
    found = cycle_dissipation(HERTZ, F, P, largest * np.cos(ANGLE))
    assert found == pytest.approx(known, rel=1e-4 / part)
    # to lowest order the loop grows with the third power of the force
    if part == 0.1:
        half = CattaneoMindlin(HERTZ, F, 0.5 * largest).dissipation()
        assert known / half == pytest.approx(8.0, rel=0.05)


def test_loads_around_a_rectangle_dissipate_the_work_of_its_sides() -> None:
    """P from 1 to 2, Q from -f D to f D: at P = 1 slip reaches to 1 - D, at P = 2 to 2 - 2 D.

    What has grown from 1 to 2 has no traction before and is lost again: with Q du on three sides
    the work is f^2 / (pi E*) times the integral of (2 D - x) ln(2 - x) - x ln(1 - x / 2) to 2 D.
    """
    D, s = 0.4, np.linspace(0.0, 4.0, 801)
    P, Q = (np.interp(s, range(5), of) for of in ([1, 2, 2, 1, 1], [-1, -1, 1, 1, -1]))
    x = np.linspace(0.0, 2.0 * D, 2001)
    known = trapezoid((2.0 * D - x) * np.log(2.0 - x) - x * np.log(1.0 - 0.5 * x), x)
    found = cycle_dissipation(HERTZ, F, P, F * D * Q)
    assert found == pytest.approx(F**2 / (np.pi * HERTZ.modulus) * known, rel=1e-3)
    # in proportion to P below f P nothing slips
    assert abs(cycle_dissipation(HERTZ, F, P, 0.9 * F * P)) < 1e-12 * found
