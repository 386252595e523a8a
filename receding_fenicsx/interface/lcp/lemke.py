"""Linear complementarity: find z >= 0 with y = M z + q >= 0 and y_i z_i = 0.

Lemke's method with lexicographic ratios cannot cycle, but may end on a ray.

Source: R. W. Cottle, J.-S. Pang, R. E. Stone, *The Linear Complementarity Problem* (1992), ch. 4.4.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from receding_fenicsx.arrays import Array


def solve(M: Array, q: Array, cover: Array) -> Array | None:
    """Return a solution z (n,), or None where Lemke's method ends on a ray.

    ``cover`` is a positive covering vector (n,).
    """
    n = len(q)
    if n == 0:
        return np.zeros(0)
    # scale rows and columns alike: y_i z_i keeps its sign
    diagonal = np.abs(np.diagonal(M))
    d = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, np.abs(M).max() or 1.0))
    scaled = d[:, None] * M * d[None, :]
    b = d * q
    size = np.abs(b).max()
    if size == 0.0:
        return np.zeros(n)
    b = b / size
    z = lemke(scaled, b, d * cover / np.abs(d * cover).max())
    if z is not None:
        # solved again without the round-off of the pivots; where the chosen unknowns leave a
        # singular block only the answer of the pivots is one
        chosen, again = np.flatnonzero(z > 0.0), np.zeros_like(z)
        with suppress(np.linalg.LinAlgError):
            again[chosen] = np.linalg.solve(scaled[np.ix_(chosen, chosen)], -b[chosen])
        for answer in (again, z):
            if is_solution(scaled, b, answer):
                return d * answer * size
    return None


def covers(size: int) -> Array:
    """Return (8, size) positive numbers for covering vectors, equal ones first, then random."""
    random = np.random.default_rng(0).uniform(0.1, 1.0, (7, size))
    return np.vstack([np.ones(size), random])


def is_solution(M: Array, q: Array, z: Array) -> bool:
    """Return whether z solves the (scaled) problem within 1e-9.

    Large z, of a nearly singular M, excuse in y = M z + q no more than its own round-off.
    """
    y = M @ z + q
    off_z = 1e-9 * max(1.0, float(np.abs(z).max(initial=0.0)))
    # 64 round-offs of the sum; from 0.1 on z has no meaning
    off_y = 1e-9 + np.minimum(64.0 * np.finfo(float).eps * (np.abs(M) @ np.abs(z)), 0.1)
    return bool(np.all(y >= -off_y) and np.all(z >= -off_z) and np.all((y <= off_y) | (z <= off_z)))


def lemke(M: Array, q: Array, cover: Array) -> Array | None:
    """Run Lemke's method with one covering vector; None when it ends on a ray."""
    n = len(q)
    if np.all(q >= 0.0):
        return np.zeros(n)
    # columns: y_1..y_n, z_1..z_n, z_0, right-hand side; rows: the basic variables
    tableau = np.hstack([np.eye(n), -M, -cover[:, None], q[:, None]])
    basic = np.arange(n)
    row = int(np.argmin(q / cover))
    entering = 2 * n
    for _ in range(50 * n + 100):
        tableau[row] /= tableau[row, entering]
        factor = tableau[:, entering].copy()
        factor[row] = 0.0
        tableau -= np.outer(factor, tableau[row])
        leaving, basic[row] = basic[row], entering
        if leaving == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basic] = tableau[:, -1]
            return z[n : 2 * n]
        entering = leaving + n if leaving < n else leaving - n
        # the leaving row, ties broken lexicographically by right-hand side and columns of the basis
        # inverse, z_0 preferred; smaller entries of the scaled tableau are no pivots
        rows = np.flatnonzero(tableau[:, entering] > 1e-11)
        if len(rows) == 0:
            return None
        for j in (-1, *range(n)):
            ratios = tableau[rows, j] / tableau[rows, entering]
            best = ratios.min()
            rows = rows[ratios <= best + 1e-11 * max(1.0, abs(best))]
            if j == -1 and np.any(basic[rows] == 2 * n):
                rows = rows[basic[rows] == 2 * n]
            if len(rows) == 1:
                break
        row = int(rows[0])
    return None
