"""Integrals of ln|x - s| and sgn(x - s) over pairs of hat functions on a line."""

from __future__ import annotations

from math import factorial

import numpy as np

from receding_fenicsx.arrays import Array, Ints

NEAR = 8.0
"""Distance of the middles of two elements, over the longer one, up to which integrals are taken in
closed form; beyond, these lose digits and Gauss's rule has an error below 1e-13."""
GAUSS_POINTS = 4
"""Points of Gauss's rule on an element."""


def log_integral(n: int, z: Array) -> Array:
    """Return the n-th antiderivative of ln|z|: z^n / n! (ln|z| - 1 - 1/2 - ... - 1/n)."""
    size = np.abs(z)
    harmonic = sum(1.0 / k for k in range(1, n + 1))
    return np.asarray(z**n / factorial(n) * (np.log(np.where(size > 0.0, size, 1.0)) - harmonic))


def surface_integrals(x: Array, elements: Ints) -> tuple[Array, Array]:
    """Return the integrals of both kernels over pairs of hat functions.

    Args:
        x: (N,) positions of the nodes, in units of about the length of all elements.
        elements: (E, 2) nodes at the lower and the upper end of each element; elements may not
            overlap.

    Returns:
        (N, N) integrals of phi_i(x) phi_j(s) ln|x - s| ds dx, symmetric, and those of
        phi_i(x) phi_j(s) sgn(x - s) ds dx, antisymmetric; both to the last bit.
    """
    a, b = x[elements].T
    log_matrix, sign_matrix = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
    # kernels of 200,000 pairs of elements together
    step = max(1, 200_000 // len(a))
    for first in range(0, len(a), step):
        rows = slice(first, first + step)
        logs, signs = _far_pairs(a[rows], b[rows], a, b)
        middles = 0.5 * (a + b)
        reach = NEAR * np.maximum((b - a)[rows, None], b - a)
        e, f = np.nonzero(np.abs(middles[rows, None] - middles) <= reach)
        logs[e, f] = _near_pairs(a[rows][e], b[rows][e], a[f], b[f])
        # the sign is antisymmetric on an element itself
        itself = np.arange(len(logs)), first + np.arange(len(logs))
        on_element = np.array([[0.0, -1.0], [1.0, 0.0]]) / 6.0
        signs[itself] = ((b - a)[rows] ** 2)[:, None, None] * on_element
        for i in range(2):
            for j in range(2):
                # a node is the lower end of one element at most, and the upper end of one
                at = np.ix_(elements[rows, i], elements[:, j])
                log_matrix[at] += logs[:, :, i, j]
                sign_matrix[at] += signs[:, :, i, j]
    return 0.5 * (log_matrix + log_matrix.T), 0.5 * (sign_matrix - sign_matrix.T)


def mixed_masses(x: Array, elements: Ints) -> Array:
    """Return the (N, N) integrals of phi_i phi_j."""
    mass = np.zeros((len(x), len(x)))
    length = np.diff(x[elements], axis=1)[:, 0]
    for i in range(2):
        for j in range(2):
            mass[elements[:, i], elements[:, j]] += length / (3.0 if i == j else 6.0)
    return mass


def _far_pairs(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Return (E, F, 2, 2) integrals of both kernels over pairs of elements apart.

    The elements are [a, b] for x and [c, d] for s; overlapping ones get finite values of no use.
    """
    point, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    upper, weight = 0.5 * (1.0 + point), 0.5 * weight
    shape = np.stack([1.0 - upper, upper]) * weight
    x, s = (low[:, None] + np.outer(high - low, upper) for low, high in ((a, b), (c, d)))
    apart = np.abs(x[:, None, :, None] - s[None, :, None, :])
    kernel = np.log(np.where(apart > 0.0, apart, 1.0))
    size = np.outer(b - a, d - c)[:, :, None, None]
    logs = size * np.einsum("ip,efpq,jq->efij", shape, kernel, shape, optimize=True)
    side = np.sign((a + b)[:, None] - (c + d))[:, :, None, None]
    return logs, 0.25 * size * side * np.ones((2, 2))


def _near_pairs(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return (n, 2, 2) integrals of ln|x - s| over pairs of elements, relative to [a, b]."""
    unit = b - a
    found = _closed(0.0 * a, unit / unit, (c - a) / unit, (d - a) / unit)
    mean = 0.25 * unit * (d - c) * np.log(unit)
    return np.asarray(found * (unit**2)[:, None, None] + mean[:, None, None])


def _closed(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return (n, 2, 2) integrals of N_i(x) N_j(s) ln|x - s| for x in [a, b], s in [c, d].

    By parts, with the antiderivatives G1, G2, ... of ln and the linear shape functions N,

        int_c^d N ln|x - s| ds = N(c) G1(x - c) - N(d) G1(x - d) + N' [G2(x - c) - G2(x - d)].
    """

    def over_x(i: int, n: int, s: Array) -> Array:
        """Return the integral of N_i(x) Gn(x - s)."""
        slope = (2 * i - 1) / (b - a)
        end = log_integral(n + 1, b - s) if i else -log_integral(n + 1, a - s)
        lower, upper = (log_integral(n + 2, edge - s) for edge in (a, b))
        return np.asarray(end - slope * (upper - lower))

    found = np.empty((*a.shape, 2, 2))
    for i in range(2):
        for j in range(2):
            slope = (2 * j - 1) / (d - c)
            end = -over_x(i, 1, d) if j else over_x(i, 1, c)
            found[..., i, j] = end + slope * (over_x(i, 2, c) - over_x(i, 2, d))
    return found
