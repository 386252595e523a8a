r"""Stress intensity of short cracks along a probe line, and the depth at which they arrest.

A crack of depth a from the free surface of a half-plane, perpendicular to it, in the stresses
$\sigma(x)$ normal to its faces and $\tau(x)$ along them that act without it has

$$K_I = 2 \sqrt{\frac a \pi} \int_0^1 \frac{1 + F(\xi)}{\sqrt{1 - \xi^2}}\, \sigma(a \xi)\, d\xi,$$

$K_{II}$ the same with $\tau$, and $F = (1 - \xi^2)(0.2945 - 0.3912 \xi^2 + 0.7685 \xi^4 -
0.9942 \xi^6 + 0.5094 \xi^8)$ (Hartranft and Sih 1973; Tada, Paris and Irwin). The contact is taken
not to change by the crack, and a crack with $K_I < 0$ to be closed.

It grows where $\Delta K_I$ exceeds $\Delta K_{th} \sqrt{a / (a + a_0)}$, El Haddad's form of the
diagram of Kitagawa and Takahashi, with $\pi a_0 = (\Delta K_{th} / (1.1215\,
\Delta\sigma_{fl}))^2$: in a uniform stress cracks of all depths grow above the range
$\Delta\sigma_{fl}$ of the fatigue limit, and short ones do not below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import FatigueOptions


@dataclass(frozen=True)
class EdgeCrack:
    """Cracks from the first of m points to each of them, over n instants.

    Attributes:
        depth: (m,) distances from the first point.
        k_i: (n, m) stress intensity of opening, negative where the crack is pressed together.
        k_ii: (n, m) stress intensity of sliding.
        arrest: the least depth from which a crack does not grow: 0 if it does not begin to,
            infinite if it grows along all points, NaN without a threshold.
        threshold: (m,) range of K_I from which cracks grow, NaN without one.
    """

    depth: Array
    k_i: Array
    k_ii: Array
    arrest: float
    threshold: Array

    @property
    def delta_k(self) -> Array:
        """(m,) range of the stress intensity in which the crack is open."""
        return np.asarray(np.ptp(np.maximum(self.k_i, 0.0), axis=0))


def edge_crack(stress: Array, points: Array, options: FatigueOptions) -> EdgeCrack:
    """Return cracks along points (m, 2) on a straight line from the surface inwards.

    Args:
        stress: (n, m, 4) stresses [s_xx, s_yy, s_zz, s_xy] of a cycle, linear between the points.
        points: three at least.
        options: threshold and fatigue limit.

    Raises:
        InputError: the points are not on a straight line.
    """
    along = points - points[0]
    depth = np.linalg.norm(along, axis=1)
    if len(points) < 3 or not np.all(np.diff(depth) > 0.0):
        raise InputError("edge_crack: needs three points or more, from the surface inwards")
    t = along[-1] / depth[-1]
    if np.abs(along @ [-t[1], t[0]]).max() > 1e-6 * depth[-1]:
        raise InputError("edge_crack: the points are not on a straight line")
    c, s = -t[1], t[0]
    s_xx, s_yy, _, s_xy = np.moveaxis(stress, -1, 0)
    weights = _weights(depth)
    k_i = (s_xx * c**2 + s_yy * s**2 + 2.0 * s_xy * s * c) @ weights.T
    k_ii = ((s_xx - s_yy) * c * t[0] + s_xy * (c * t[1] + s * t[0])) @ weights.T
    found = EdgeCrack(depth, k_i, k_ii, np.nan, np.full(len(depth), np.nan))
    if options.threshold is None or options.fatigue_limit is None:
        return found
    short = (options.threshold / (1.1215 * options.fatigue_limit)) ** 2 / np.pi
    threshold = options.threshold * np.sqrt(depth / (depth + short))
    lack = (threshold - found.delta_k)[1:]
    stops, arrest = np.flatnonzero(lack > 0.0), np.inf
    if len(stops):
        k, arrest = int(stops[0]), 0.0
        if k > 0:
            part = -lack[k - 1] / (lack[k] - lack[k - 1])
            arrest = float(depth[k] + part * (depth[k + 1] - depth[k]))
    return EdgeCrack(depth, k_i, k_ii, arrest, threshold)


def _weights(depth: Array) -> Array:
    """Return (m, m): the stress intensity at each depth of a unit stress at each point."""
    found = np.zeros((len(depth), len(depth)))
    at, gauss = np.polynomial.legendre.leggauss(8)
    for k in range(1, len(depth)):
        a = depth[k]
        ends = np.arcsin(depth[: k + 1] / a)  # xi = sin(theta)
        half = 0.5 * np.diff(ends)[:, None]
        sine = np.sin(0.5 * (ends[1:] + ends[:-1])[:, None] + half * at)
        series = np.polynomial.polynomial.polyval(
            sine**2, [0.2945, -0.3912, 0.7685, -0.9942, 0.5094]
        )
        value = 2.0 * np.sqrt(a / np.pi) * half * gauss * (1.0 + (1.0 - sine**2) * series)
        part = (a * sine - depth[:k, None]) / np.diff(depth[: k + 1])[:, None]
        found[k, :k] += (value * (1.0 - part)).sum(axis=1)
        found[k, 1 : k + 1] += (value * part).sum(axis=1)
    return found
