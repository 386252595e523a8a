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

Complexes = NDArray[np.complex128]


def point_values(
    surface: Surface, material: HalfPlaneMaterial, points: Array, datum: float, tractions: Complexes
) -> Array:
    """Return (m, 6, k) values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points (m, 2), y >= 0.

    Tractions (N, k) are nodal q + i p; all is in the half-plane's own axes. Displacements are
    relative to the datum, the depth at which those by the resultant vanish.
    """
    shortest = float(np.diff(surface.x[surface.elements], axis=1).min())
    # at some depth, as the integrals have logarithms of the distance from the nodes
    z = points[:, 0] + 1j * np.maximum(points[:, 1], 1e-9 * shortest)
    cauchy, slope, logs = _integrals(surface, z)
    over = -0.5 / np.pi * tractions
    Phi, Psi = cauchy @ over, cauchy @ np.conj(over)
    twist = -2j * z.imag[:, None]
    total, deviator = 4.0 * Phi.real, 2.0 * (twist * (slope @ over) - Phi - Psi)
    moved = material.kappa * (logs @ over) + np.conj(logs) @ over + twist * np.conj(Phi)
    resultant = surface.weight @ over
    level = (material.kappa + 1.0) * np.log(datum) * resultant + 2.0 * np.conj(resultant)
    moved = (moved - level) / (2.0 * material.mu)
    return np.stack(
        [
            moved.real,
            moved.imag,
            0.5 * (total - deviator.real),
            0.5 * (total + deviator.real),
            material.nu_out * total,
            0.5 * deviator.imag,
        ],
        axis=1,
    )


def _integrals(surface: Surface, z: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    """Return (m, N) integrals of phi_j / (z - s), its z-derivative, and phi_j ln((z - s) / i)."""
    low, high = surface.elements.T
    h = surface.x[high] - surface.x[low]
    to_node = z[:, None] - surface.x
    # ln(z / i) has its cut below the half-plane
    log = np.log(to_node / 1j)
    square = 0.5 * to_node**2 * (log - 1.5)
    to_a, to_b = to_node[:, low], to_node[:, high]
    between = (log[:, low] - log[:, high]) / h
    rising = to_a * between - 1.0
    second = (square[:, high] - square[:, low]) / h
    of_low = (
        between * h - rising,
        1.0 / to_a - between,
        to_a * (log[:, low] - 1.0) + second,
    )
    of_high = (rising, between - 1.0 / to_b, -to_b * (log[:, high] - 1.0) - second)
    found = np.zeros((3, len(z), len(surface.x)), dtype=complex)
    for part, below, above in zip(found, of_low, of_high, strict=True):
        # a node is the lower end of one element at most, and the upper end of one
        part[:, low] += below
        part[:, high] += above
    return found[0], found[1], found[2]
