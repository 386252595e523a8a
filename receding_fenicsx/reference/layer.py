"""Frictionless contact of an endless layer by a singular integral equation: no mesh.

A layer of thickness h = 1, pressed down by a force F = 1 on |x| < load of its top, lies on a rigid
plane or an elastic half-plane without friction and touches it on |x| < c. With E' = E / (1 - nu^2)
and r = E'_layer / E'_halfplane, no gap and so no difference of slopes on |x| < c asks for

    (1 + r) H p(x) + (1/pi) int_0^inf [R(k) p^(k) - G(k) S(k)] sin(k x) dk = 0,

    R = (sinh k cosh k + k) / (sinh^2 k - k^2) - 1,    G = (sinh k + k cosh k) / (sinh^2 k - k^2),

H p(x) = (1/pi) int p(s) / (x - s) ds, p^(k) = int p(x) cos(k x) dx, S(k) = sin(k load) / (k load).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq
from scipy.special import j0, jv

from receding_fenicsx.arrays import Array

TERMS = 16
"""Chebyshev terms of the pressure."""
FIRST_WIDTH, STEP_FACTOR = 0.3, 1.3
"""First half width over h of the search, smaller than any solution, and factor of its steps."""
PANELS, MAX_WAVE_NUMBER = 100, 40.0
"""Gauss panels over the wave numbers 0 < k < 40 / h, where R and G have fallen to 1e-16."""


def contact_half_width(load: float = 0.0, modulus_ratio: float = 0.0) -> float:
    """Return c / h of a layer under a uniform load, at which p vanishes like a square root.

    Args:
        load: half width of the loaded strip, over h; 0 for a line load.
        modulus_ratio: E' of the layer over E' of the half-plane, (1 - alpha) / (1 + alpha) in
            Dundurs' alpha; 0 for a rigid plane.
    """

    def singular(c: float) -> float:
        return float(_pressure(c, load, modulus_ratio)[-1])

    c = FIRST_WIDTH
    while singular(STEP_FACTOR * c) > 0.0:
        c *= STEP_FACTOR
    return float(brentq(singular, c, STEP_FACTOR * c, xtol=1e-10))


def _pressure(c: float, load: float, modulus_ratio: float) -> Array:
    """Coefficients of p at a given half width: of sqrt(1 - s^2) U_2n(s), last 1 / sqrt(1 - s^2).

    Contacts of another half width than the right one end in a singularity (or in tension).
    """
    k, dk = _wave_numbers()
    # at the roots of T_(2 n + 1) beside s = 0, where the equation is trivial
    s = np.cos(0.5 * np.pi * (2.0 * np.arange(1, TERMS + 1) - 1.0) / (2 * TERMS + 1))
    order = 2 * np.arange(TERMS) + 1
    direct = np.cos(np.multiply.outer(np.arccos(s), order)) * (1.0 + modulus_ratio)
    z = k[:, None] * c
    hats = math.pi * c * (-1.0) ** np.arange(TERMS) * order * jv(order, z) / z
    hats = np.column_stack([hats, math.pi * c * j0(k * c)])
    at_zero = np.zeros(TERMS + 1)
    at_zero[[0, -1]] = 0.5 * math.pi * c, math.pi * c
    waves = np.sin(np.multiply.outer(c * s, k)) * dk / math.pi
    below = np.sinh(k) ** 2 - k**2
    R = (np.sinh(k) * np.cosh(k) + k) / below - 1.0
    G = (np.sinh(k) + k * np.cosh(k)) / below
    # sum_n a_n p_n^(0) = 1 is used to take the balanced part of the force out of R and G
    matrix = np.zeros((TERMS + 1, TERMS + 1))
    matrix[:TERMS, :TERMS] = direct
    matrix[:TERMS] += waves @ (R[:, None] * (hats - at_zero))
    matrix[TERMS] = at_zero
    right = np.append(-waves @ (R - G * np.sinc(k * load / math.pi)), 1.0)
    return np.asarray(np.linalg.solve(matrix, right))


def _wave_numbers() -> tuple[Array, Array]:
    points, weights = leggauss(8)
    ends = MAX_WAVE_NUMBER * np.linspace(0.0, 1.0, PANELS + 1) ** 1.5
    width = np.diff(ends)
    k = (ends[:-1, None] + 0.5 * width[:, None] * (points + 1.0)).ravel()
    return k, (0.5 * width[:, None] * weights).ravel()
