"""Closed forms and computed values of reference contact problems, each with its source.

The tables were computed by integral equations, boundary collocation and complementarity solvers,
independent of this program and without finite elements; their digits are converged and were
cross-checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad

from receding_fenicsx.arrays import Array
from receding_fenicsx.reference.layer import wave_numbers


@dataclass(frozen=True)
class Pressed:
    """A frictionless contact under a uniform pressure p0 on |x| < load: half width and pressures.

    Attributes:
        load: half width of the loaded strip, over h.
        half_width: half width c of the contact, over h.
        x: positions over c.
        p: contact pressures there, over p0.
    """

    load: float
    half_width: float
    x: tuple[float, ...]
    p: tuple[float, ...]


_X = (0.0, 0.25, 0.5, 0.75, 0.9, 0.99)

BLOCK = Pressed(
    0.25, 0.895377825, _X, (0.45540099, 0.40751698, 0.29254339, 0.16285111, 0.086808, 0.02469477)
)
"""Block 4h wide and h high on a rigid plane, loaded on its top."""
LAYERS = (
    Pressed(
        0.5,
        1.0077824,
        _X,
        (0.78958816, 0.71663493, 0.52825711, 0.29739914, 0.15777233, 0.04461532),
    ),
    Pressed(
        2.0, 2.391061769, _X, (1.02609397, 1.0328384, 1.00012889, 0.70337242, 0.35061, 0.08868178)
    ),
)
"""Endless layer on a rigid plane."""
LAYER_ON_HALF_PLANE = {
    (0.0, "line load"): 1.32416537,
    (0.0, "load on |x| < h/2"): 1.43104929,
    (0.5, "line load"): 1.03713537,
    (0.5, "load on |x| < h/2"): 1.17183349,
}
"""Contact half width over h of an endless layer on a half-plane, frictionless, by Dundurs' alpha =
(E'_halfplane - E'_layer) / (E'_halfplane + E'_layer), E' = E / (1 - nu^2), and load."""
PUNCH_STICK = {
    "plane strain": {(0.0, 0.5): 0.52190767, (0.3, 0.2): 0.36038572, (0.2, 0.3): 0.42980529},
    "axisymmetric": {(0.0, 0.5): 0.81263649, (0.3, 0.2): 0.69827422, (0.2, 0.3): 0.75285417},
}
"""Stick half width (radius) over a, by (nu, f), of a rigid flat punch pressed on a half-space by a
growing normal force, normal and tangential problems fully coupled (Spence's problem). Elliptic
integrals often quoted for it neglect the coupling: 0.7071 in place of 0.5219 in the plane."""
FILON_ZERO = 1.3379218
"""x / h at which the normal stress between two layers that cannot separate, pressed together by two
opposite line loads, changes sign (Filon; thickness h each). It is no contact half width."""


def bilateral_pressure(x: ArrayLike, load: float = 0.0) -> Array:
    """Return the pressure on the middle plane of a layer of thickness 2h, squeezed from both sides.

    p h / F = (2 / pi) int_0^inf (sinh u + u cosh u) / (sinh 2u + 2u) S(u) cos(u x / h) du, with
    S = sin(u load) / (u load) for a force F spread over |x| < load, 1 for a line load. By symmetry
    it is the pressure between two unseparated layers, and below one on a frictionless plane that
    also holds it down.

    Args:
        x: positions over h.
        load: half width of the loaded strip, over h.

    Returns:
        p h / F, compression positive.

    Source: L.N.G. Filon, Philosophical Transactions of the Royal Society A 201 (1903) 63-155.
    """
    u, du = wave_numbers(1.0)
    kernel = (np.sinh(u) + u * np.cosh(u)) / (np.sinh(2.0 * u) + 2.0 * u)
    waves = np.cos(np.multiply.outer(np.asarray(x, dtype=float), u))
    return 2.0 / np.pi * waves @ (du * kernel * np.sinc(u * load / np.pi))


@dataclass(frozen=True)
class Hertz:
    """Line contact of cylinders: p = p0 sqrt(1 - x^2 / a^2).

    Attributes:
        force: normal force P per unit thickness.
        radius: relative radius R, initial gap x^2 / (2 R).
        modulus: E*, 1 / E* = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2.

    Source: K.L. Johnson, Contact Mechanics (1985), section 4.2(c).
    """

    force: float
    radius: float
    modulus: float

    @property
    def a(self) -> float:
        """Half width, a^2 = 4 P R / (pi E*)."""
        return float(np.sqrt(4.0 * self.force * self.radius / (np.pi * self.modulus)))

    @property
    def p0(self) -> float:
        """Largest pressure, 2 P / (pi a)."""
        return 2.0 * self.force / (np.pi * self.a)

    def pressure(self, x: ArrayLike) -> Array:
        """Pressure at x."""
        return self.p0 * arc(x, self.a)

    def stress(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return (..., [s_xx, s_yy, s_xy]) in the half-plane y > 0 that the pressure is on.

        With m^2 - n^2 = a^2 - x^2 + y^2, m n = x y, m > 0, and t = (y^2 + n^2) / (m^2 + n^2),

            s_xx = -p0 / a (m (1 + t) - 2 y),    s_yy = -p0 / a m (1 - t),
            s_xy = -p0 / a n (m^2 - y^2) / (m^2 + n^2).

        Source: E. McEwen, Philosophical Magazine 40 (1949) 454-459; Johnson, eqs. (4.49), where z
        is the depth y.
        """
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        root = np.sqrt((self.a**2 - x**2 + y**2) + 2j * x * y)
        m, n = root.real, root.imag
        t = (y**2 + n**2) / (m**2 + n**2)
        s_xx = m * (1.0 + t) - 2.0 * y
        s_xy = n * (m**2 - y**2) / (m**2 + n**2)
        return -self.p0 / self.a * np.stack([s_xx, m * (1.0 - t), s_xy], axis=-1)


def arc(x: ArrayLike, end: float) -> Array:
    """Return sqrt(1 - x^2 / end^2) where |x| < end, else 0."""
    if end <= 0.0:
        return np.zeros(np.shape(x))
    return np.sqrt(np.maximum(1.0 - (np.asarray(x, dtype=float) / end) ** 2, 0.0))


@dataclass(frozen=True)
class CattaneoMindlin:
    """A Hertz line contact held by P and sheared by Q, -f P < Q < f P, where beta = 0.

    With Q from 0 to ``largest``, back to -``largest`` and up again; q and Q have the same sign.
    A body that is stretched along its surface in proportion to Q, by the stress ``tension`` at
    ``largest``, moves the stick zones, as long as they stay within the contact. Its dissipation is
    known without tension only.

    Source: K.L. Johnson, Contact Mechanics (1985), sections 7.2 and 7.4; with tension D. Nowell and
    D.A. Hills, Int. J. Mech. Sci. 29 (1987) 355-365.
    """

    hertz: Hertz
    f: float
    largest: float
    tension: float = 0.0

    def middle(self, Q: float, leg: str) -> float:
        """Middle of the stick zone: e = tension a / (4 f p0) at ``largest``, equal materials.

        It is on the side of Q where the body that Q does not push is stretched. After a reversal
        e grows from zero again, to the same at the next one.

        Raises:
            ValueError: the stick zone reaches the end of the contact.
        """
        e = self._since(Q, leg) / self.largest * self.tension
        e *= self.hertz.a / (4.0 * self.f * self.hertz.p0)
        if abs(e) + self.stick_half_width(Q, leg) > self.hertz.a and e != 0.0:
            raise ValueError("the tension is so large that one side of the contact does not slip")
        return e

    def _since(self, Q: float, leg: str) -> float:
        """Force from rest that slips as far as Q does on a leg: half of it after a reversal."""
        if leg == "loading":
            return abs(Q)
        return 0.5 * abs(Q - (self.largest if leg == "unloading" else -self.largest))

    def stick_half_width(self, Q: float, leg: str) -> float:
        """Half width of the stick zone on "loading", "unloading" or "reloading".

        c = a sqrt(1 - Q / (f P)); after a reversal a sqrt(1 - |Q - Q_reversal| / (2 f P)).
        """
        part = 1.0 - self._since(Q, leg) / (self.f * self.hertz.force)
        return self.hertz.a * float(np.sqrt(max(part, 0.0)))

    def traction(self, x: ArrayLike, Q: float, leg: str) -> Array:
        """Return q at x: arcs over a, the present stick zone and that of the reversal."""
        if leg == "reloading":
            return -self.traction(x, -Q, "unloading")
        # the traction at the start of the leg
        a, peak = self.hertz.a, self.largest if leg == "unloading" else Q
        c, e = self.stick_half_width(peak, "loading"), self.middle(peak, "loading")
        scale, x = self.f * self.hertz.p0, np.asarray(x, dtype=float)
        first = arc(x, a) - c / a * arc(x - e, c)
        if leg == "loading":
            return scale * first
        d, e = self.stick_half_width(Q, leg), self.middle(Q, leg)
        return scale * (first - 2.0 * (arc(x, a) - d / a * arc(x - e, d)))

    def dissipation(self) -> float:
        """Return the frictional dissipation of a cycle of Q between -``largest`` and ``largest``.

        On the way from one reversal to the other, |q| = f p in c < |x| < a, and two points there
        slip by (2 f / R) int_c^x sqrt(t^2 - c^2) dt, where c is the stick half width at the
        reversals. The dissipation is the integral of f p times this slip, twice a cycle.

        Raises:
            ValueError: with tension.
        """
        if self.tension:
            raise ValueError("the dissipation under tension has no closed form here")
        c = self.stick_half_width(self.largest, "loading")

        def slip(x: float) -> float:
            root = np.sqrt(max(x**2 - c**2, 0.0))
            area = 0.5 * (x * root - c**2 * np.log((x + root) / c)) if c > 0.0 else 0.5 * x**2
            return float(2.0 * self.f / self.hertz.radius * area)

        half, _ = quad(lambda x: self.f * float(self.hertz.pressure(x)) * slip(x), c, self.hertz.a)
        return float(4.0 * half)
