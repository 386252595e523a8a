"""Exponents of the stress at a sharp corner of an elastic body on a rigid plane.

Near the corner stresses are r^m, m = lambda - 1. The body fills the wedge 0 < theta < alpha, its
contact is theta = 0, its free side theta = alpha. With Airy's function (Williams 1952)

    phi = r^(lambda + 1) F(theta),
    F = A cos((lambda + 1) theta) + B sin((lambda + 1) theta)
        + C cos((lambda - 1) theta) + D sin((lambda - 1) theta)

the stresses are sigma_tt = lambda (lambda + 1) F r^m and sigma_rt = -lambda F' r^m; on the contact

    2 G u_r = (-(lambda + 1) A + (kappa - lambda) C) r^lambda,
    2 G u_t = (-(lambda + 1) B - (kappa + lambda) D) r^lambda.

The free side asks for F(alpha) = F'(alpha) = 0. The contact asks for u_t = 0, with stick for
u_r = 0, with slip for sigma_rt = s f sigma_tt: s = 1 where the body slips outwards (from the
contact towards the corner and beyond), s = -1 inwards (Comninou 1976). Two constants are left:

    stick:  A = (kappa - lambda) C / (lambda + 1),   B = -(kappa + lambda) D / (lambda + 1);
    slip:   B = -s f (kappa + lambda) / (kappa + 1) (A + C),
            D = s f (lambda + 1) / (kappa + 1) (A + C),

and a determinant of two rows that vanishes. With stick it is the characteristic equation

    4 kappa sin^2(lambda alpha) = (kappa + 1)^2 - 4 lambda^2 sin^2(alpha).

Stick at alpha = 90 degrees in plane strain, nu = 0.3: m = -0.2888.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError, SolveError


def characteristic(lam: NDArray[Any], angle: float, kappa: float, slip: float | None) -> Any:
    """Return the determinant that vanishes at the exponents, of complex lambda.

    The angle is alpha in radians, ``slip`` is s f: the coefficient of friction in outward slip, its
    negative in inward slip, None where the contact sticks.
    """
    if slip is None:
        return (
            (kappa + 1.0) ** 2
            - 4.0 * (lam * math.sin(angle)) ** 2
            - 4.0 * kappa * np.sin(lam * angle) ** 2
        )
    a, b = (lam + 1.0) * angle, (lam - 1.0) * angle
    ratio = slip / (kappa + 1.0)
    B, D = -ratio * (kappa + lam), ratio * (lam + 1.0)
    # F and F' at alpha: those of A and C each, and the common part of A + C
    F = B * np.sin(a) + D * np.sin(b)
    dF = B * (lam + 1.0) * np.cos(a) + D * (lam - 1.0) * np.cos(b)
    of_A = np.cos(a) + F, -(lam + 1.0) * np.sin(a) + dF
    of_C = np.cos(b) + F, -(lam - 1.0) * np.sin(b) + dF
    return of_A[0] * of_C[1] - of_A[1] * of_C[0]


def corner_exponent(angle: float, kappa: float, slip: float | None = None) -> complex:
    """Return m, the exponent of the stress with the smallest real part above -1.

    Stresses are singular where its real part is negative, and oscillate where it is complex.

    Args:
        angle: alpha, in degrees, above 0 and at most 180.
        kappa: Kolosov's constant, above 1 and at most 7, below 3 for nu > 0
            (:func:`~receding_fenicsx.interface.measures.zone_ends.kolosov`).
        slip: as in :func:`characteristic`.

    Raises:
        InputError: an angle or a constant outside its range.
        SolveError: there is no exponent below 1.
    """
    if not 0.0 < angle <= 180.0 or not 1.0 < kappa <= 7.0:
        raise InputError(f"no corner of {angle:g} degrees with kappa = {kappa:g} can be analysed")
    alpha, step, largest, least = math.radians(angle), 1e-5, 2.0, 1e-3  # of lambda
    # starts of Newton's method
    real, imaginary = np.meshgrid(np.linspace(0.02, largest, 40), np.linspace(0.0, 2.0, 9))
    lam = (real + 1j * imaginary).ravel()
    with np.errstate(all="ignore"):
        for _ in range(25):
            value = characteristic(lam, alpha, kappa, slip)
            up, down = (characteristic(lam + d, alpha, kappa, slip) for d in (step, -step))
            lam = lam - 2.0 * step * value / (up - down)
        size = np.abs(characteristic(lam, alpha, kappa, slip))
    # a determinant below 1e-8 counts as zero, its terms are of order one; lambda = 0 is rigid
    good = lam[(size < 1e-8) & (lam.real > least) & (lam.real < largest)]
    if not len(good):
        raise SolveError(f"a corner of {angle:g} degrees has no exponent below {largest - 1.0:g}")
    found = good[np.argmin(good.real)]
    imag = abs(found.imag)
    return complex(found.real - 1.0, imag if imag > least else 0.0)
