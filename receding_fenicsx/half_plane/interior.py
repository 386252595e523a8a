"""Displacements and stresses inside a half-plane by closed integrals of its surface tractions.

In the half-plane's own axes, x along t and y >= 0 along n into it, with z = x + i y and

    Phi(z) = -1/(2 pi) int (q + i p) / (z - s) ds,    Psi(z) = -1/(2 pi) int (q - i p) / (z - s) ds,

Kolosov's formulas for a half-plane are (Muskhelishvili, Some Basic Problems, section 93)

    s_xx + s_yy = 4 Re Phi,
    s_yy - s_xx + 2 i s_xy = 2 [(conj(z) - z) Phi' - Phi - Psi],
    2 mu (u_x + i u_y) = kappa phi + phi* + (conj(z) - z) conj(Phi),

with phi = -1/(2 pi) int (q + i p) ln((z - s) / i) ds, and phi* the same with the conjugate
logarithm. Hat functions integrate to logarithms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.half_plane.stiffness import HalfPlaneMaterial, Surface

NEAREST = 1e-9
"""Smallest depth of a point, over the shortest element: nearer ones are moved to it, as the
integrals have logarithms of the distance from the nodes."""
Complexes = NDArray[np.complex128]


def point_values(
    surface: Surface, material: HalfPlaneMaterial, points: Array, datum: float
) -> Array:
    """Return values at points that unit nodal tractions cause.

    Args:
        surface: nodes of the half-plane in its own axes.
        material: elastic constants.
        points: (m, 2) points in its own axes, y >= 0.
        datum: depth of the point at which displacements by the resultant vanish.

    Returns:
        (m, 6, 2N) values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] in the half-plane's own axes, of nodal
        tractions [q; p]; displacements are relative to the datum.
    """
    shortest = float(np.diff(surface.x[surface.elements], axis=1).min())
    z = points[:, 0] + 1j * np.maximum(points[:, 1], NEAREST * shortest)
    cauchy, slope, logs = _integrals(surface, z)
    mu, kappa = material.mu, material.kappa
    twist = -2j * z.imag[:, None]
    # what q = 1 and p = 1 cause, which are q + i p = 1 and i
    found = []
    for unit in (1.0, 1j):
        Phi, Phi_slope = -unit / (2.0 * np.pi) * cauchy, -unit / (2.0 * np.pi) * slope
        Psi = -np.conj(unit) / (2.0 * np.pi) * cauchy
        total, deviator = 4.0 * Phi.real, 2.0 * (twist * Phi_slope - Phi - Psi)
        moved = -unit / (2.0 * np.pi) * (kappa * logs + np.conj(logs)) + twist * np.conj(Phi)
        level = unit * (kappa + 1.0) / (2.0 * np.pi) * np.log(datum) + np.conj(unit) / np.pi
        moved = (moved + level * surface.weight) / (2.0 * mu)
        found.append(
            [
                moved.real,
                moved.imag,
                0.5 * (total - deviator.real),
                0.5 * (total + deviator.real),
                material.nu_out * total,
                0.5 * deviator.imag,
            ]
        )
    return np.concatenate([np.stack(part, axis=1) for part in found], axis=2)


def _integrals(surface: Surface, z: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    """Return (m, N) integrals of phi_j / (z - s), its z-derivative, and phi_j ln((z - s) / i)."""
    cauchy, slope, logs = (np.zeros((len(z), len(surface.x)), dtype=complex) for _ in range(3))
    for low, high in surface.elements:
        a, b = surface.x[low], surface.x[high]
        h = b - a
        to_a, to_b = z - a, z - b
        # ln(z / i) has its cut below the half-plane
        log_a, log_b = np.log(to_a / 1j), np.log(to_b / 1j)
        between = log_a - log_b
        rising = to_a * between / h - 1.0
        cauchy[:, high] += rising
        cauchy[:, low] += between - rising
        slope[:, high] += between / h - 1.0 / to_b
        slope[:, low] += 1.0 / to_a - between / h
        # antiderivatives of the logarithm
        first = to_b * (log_b - 1.0)
        second = (to_b**2 * (log_b - 1.5) - to_a**2 * (log_a - 1.5)) / (2.0 * h)
        logs[:, high] += -first - second
        logs[:, low] += to_a * (log_a - 1.0) + second
    return cauchy, slope, logs
