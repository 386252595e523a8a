"""Frictionless contact of endless layers by singular integral equations: no mesh.

A layer of thickness h = 1, pressed down by a force F = 1 on |x| < load of its top, lies on a rigid
plane or an elastic half-plane without friction and touches it on |x| < c. With E' = E / (1 - nu^2)
and r = E'_layer / E'_halfplane, no gap and so no difference of slopes on |x| < c asks for

    (1 + r) H p(x) + (1/pi) int_0^inf [R(k) p^(k) - G(k) S(k)] sin(k x) dk = 0,

    R = (sinh k cosh k + k) / (sinh^2 k - k^2) - 1,    G = (sinh k + k cosh k) / (sinh^2 k - k^2),

H p(x) = (1/pi) int p(s) / (x - s) ds, p^(k) = int p(x) cos(k x) dx, S(k) = sin(k load) / (k load).

A second layer of thickness h_2 between the first one and a rigid plane, with the pressures p on
|x| < c above and a on |x| < c_2 below it, R_2(k) = R(k h_2), G_2(k) = G(k h_2), asks for

    (1 + r) H p + (1/pi) int_0^inf [(R + r R_2) p^ - G S - r G_2 a^] sin(k x) dk = 0,    |x| < c,
          H a + (1/pi) int_0^inf [R_2 a^ - G_2 p^] sin(k x) dk = 0,                      |x| < c_2

(receding contact as in Keer, Dundurs & Tsai 1972; of two layers, with a stamp, in Comez, Birinci &
Erdol 2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NotConverged

TERMS = 16
"""Chebyshev terms of the pressure."""


def contact_half_width(load: float = 0.0, modulus_ratio: float = 0.0) -> float:
    """Return c / h of a layer under a uniform load, at which p vanishes like a square root.

    Args:
        load: half width of the loaded strip, over h; 0 for a line load.
        modulus_ratio: E' of the layer over E' of the half-plane, (1 - alpha) / (1 + alpha) in
            Dundurs' alpha; 0 for a rigid plane.
    """
    return _zero(lambda c: _pressures(np.array([c]), load, modulus_ratio)[0, -1])


def double_half_widths(
    load: float, modulus_ratio: float = 1.0, second_height: float = 1.0
) -> tuple[float, float]:
    """Return c / h and c_2 / h of two layers on a rigid plane under a uniform load.

    Args:
        load: half width of the loaded strip, over h.
        modulus_ratio: r, E' of the first layer, the upper one, over that of the second one.
        second_height: h_2 / h.

    Raises:
        NotConverged: no half widths were found at which both pressures vanish like square roots.
    """

    def singular(c: float, c_2: float) -> Array:
        return _pressures(np.array([c, c_2]), load, modulus_ratio, second_height)[:, -1]

    c, c_2 = contact_half_width(load, modulus_ratio), math.inf
    # either width depends little on the other one
    for _ in range(30):
        before, c_2 = c_2, _zero(partial(lambda c, c_2: singular(c, c_2)[1], c))
        c = _zero(partial(lambda c_2, c: singular(c, c_2)[0], c_2))
        if abs(c_2 - before) < 1e-9 * c_2:
            return c, c_2
    raise NotConverged("two layers on a plane: the half widths of the contacts were not found")


def _zero(singular: Callable[[float], float]) -> float:
    """Return the smallest half width at which the coefficient of the singularity is zero."""
    c, factor = 0.3, 1.3  # smaller than any solution
    while singular(factor * c) > 0.0:
        c *= factor
    return float(brentq(singular, c, factor * c, xtol=1e-10))


def _pressures(widths: Array, load: float, modulus_ratio: float, second: float = 1.0) -> Array:
    """Return (1 or 2, TERMS + 1) coefficients of sqrt(1 - s^2) U_2n(s) and of 1 / sqrt(1 - s^2)."""
    k, dk = wave_numbers(min(1.0, second))
    (R, G), (R_2, G_2) = _kernels(k), _kernels(k * second)
    r = modulus_ratio
    kernels, diagonal = [[R]], [1.0 + r]
    if len(widths) == 2:
        kernels, diagonal = [[R + r * R_2, -r * G_2], [-G_2, R_2]], [1.0 + r, 1.0]
    # at the roots of T_(2 n + 1) beside s = 0, where the equation is trivial
    s = np.cos(0.5 * np.pi * (2.0 * np.arange(1, TERMS + 1) - 1.0) / (2 * TERMS + 1))
    order = 2 * np.arange(TERMS) + 1
    direct = np.cos(np.multiply.outer(np.arccos(s), order))
    size = TERMS + 1
    matrix, right = np.zeros((len(widths), size, len(widths), size)), np.ones((len(widths), size))
    transforms = [_transforms(k, c) for c in widths]
    for i, c in enumerate(widths):
        waves = np.sin(np.multiply.outer(c * s, k)) * dk / math.pi
        source = sum(kernels[i]) - (G * np.sinc(k * load / math.pi) if i == 0 else 0.0)
        right[i, :TERMS] = -waves @ source
        matrix[i, :TERMS, i, :TERMS] = direct * diagonal[i]
        for j, (hats, at_zero) in enumerate(transforms):
            # sum_n a_n p_n^(0) = 1 is used to take the balanced part of the force out
            matrix[i, :TERMS, j] += waves @ (kernels[i][j][:, None] * (hats - at_zero))
        matrix[i, TERMS, i] = transforms[i][1]
    found = np.linalg.solve(matrix.reshape(right.size, -1), right.ravel())
    return np.asarray(found.reshape(right.shape))


def _kernels(z: Array) -> tuple[Array, Array]:
    """Return R and G at the wave number times the height."""
    z = np.minimum(z, 80.0)
    below = np.sinh(z) ** 2 - z**2
    return (np.sinh(z) * np.cosh(z) + z) / below - 1.0, (np.sinh(z) + z * np.cosh(z)) / below


def _transforms(k: Array, c: float) -> tuple[Array, Array]:
    """Return the cosine transforms of the terms of a pressure on |x| < c, at k and at 0."""
    # chebyshev points of a transform besides one for every half wave
    points = int(0.5 * k[-1] * c) + 40
    angle = math.pi * (np.arange(points) + 0.5) / points
    order = 2 * np.arange(TERMS) + 1
    terms = np.sin(np.multiply.outer(angle, order)) * np.sin(angle)[:, None]
    terms = math.pi * c / points * np.column_stack([terms, np.ones(points)])
    return np.cos(np.multiply.outer(k, c * np.cos(angle))) @ terms, terms.sum(axis=0)


def wave_numbers(height: float) -> tuple[Array, Array]:
    """Return Gauss's points and weights on 0 < k < 40 / h, where R and G have fallen to 1e-16."""
    points, weights = leggauss(8)
    ends = 40.0 / height * np.linspace(0.0, 1.0, 101) ** 1.5
    width = np.diff(ends)
    k = (ends[:-1, None] + 0.5 * width[:, None] * (points + 1.0)).ravel()
    return k, (0.5 * width[:, None] * weights).ravel()
