"""Linear complementarity: find z >= 0 with y = M z + q >= 0 and y_i z_i = 0.

The finite methods behind the quick ones: Lemke's with lexicographic ratios, which cannot cycle but
may end on a ray, and enumeration, which is proof for few unknowns.

Source: R. W. Cottle, J.-S. Pang, R. E. Stone, *The Linear Complementarity Problem* (1992), ch. 4.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array

PIVOT_TOLERANCE = 1e-11
"""Entry of the scaled tableau below which it is not used as a pivot."""

CHECK_TOLERANCE = 1e-9
"""Violation of y >= 0 or z >= 0, in the scaled problem, up to which an answer is accepted."""

ROUND_OFFS = 64.0
"""Round-offs of y, as a sum, that are accepted beside that."""

MOST_EXCUSED = 0.1
"""Violation, in the scaled problem, beyond which round-off excuses none: z has no meaning there."""

ENUMERATED = 12
"""Largest number of complementary pairs that :func:`enumerate_all` goes through."""


def solve(M: Array, q: Array, covers: Iterable[Array]) -> Array | None:
    """Return a solution z, or None when Lemke's method ends on rays and no enumeration finds one.

    Args:
        M: (n, n) matrix.
        q: (n,) vector.
        covers: covering vectors to try in turn, (n,) positive each.

    Returns:
        (n,) solution; None proves nonexistence only for n <= ``ENUMERATED``.
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
    for cover in covers:
        z = lemke(scaled, b, d * cover / np.abs(d * cover).max())
        if z is not None:
            # where the chosen unknowns leave a singular block only the answer of the pivots is one
            for answer in (_solved_again(scaled, b, z), z):
                if is_solution(scaled, b, answer):
                    return d * answer * size
    if n <= ENUMERATED:
        for z in enumerate_all(scaled, b):
            return d * z * size
    return None


def _solved_again(M: Array, q: Array, z: Array) -> Array:
    """Return the solution with the positive unknowns of z, without the round-off of the pivots."""
    chosen = np.flatnonzero(z > 0.0)
    found = np.zeros_like(z)
    try:
        found[chosen] = np.linalg.solve(M[np.ix_(chosen, chosen)], -q[chosen])
    except np.linalg.LinAlgError:
        return z
    return found


def is_solution(M: Array, q: Array, z: Array) -> bool:
    """Return whether z solves the (scaled) problem within ``CHECK_TOLERANCE``.

    Large z, of a nearly singular M, excuse in y = M z + q no more than its own round-off.
    """
    y = M @ z + q
    off_z = CHECK_TOLERANCE * max(1.0, float(np.abs(z).max(initial=0.0)))
    round_off = ROUND_OFFS * np.finfo(float).eps * (np.abs(M) @ np.abs(z))
    off_y = CHECK_TOLERANCE + np.minimum(round_off, MOST_EXCUSED)
    return bool(np.all(y >= -off_y) and np.all(z >= -off_z) and np.all((y <= off_y) | (z <= off_z)))


def lemke(M: Array, q: Array, cover: Array) -> Array | None:
    """Run Lemke's method with one covering vector; None when it ends on a ray.

    Args:
        M: (n, n) matrix.
        q: (n,) vector.
        cover: (n,) positive covering vector.
    """
    n = len(q)
    if np.all(q >= 0.0):
        return np.zeros(n)
    # columns: y_1..y_n, z_1..z_n, z_0, right-hand side; rows: the basic variables
    tableau = np.hstack([np.eye(n), -M, -cover[:, None], q[:, None]])
    basic = np.arange(n)
    row = int(np.argmin(q / cover))
    entering = 2 * n
    for _ in range(50 * n + 100):
        _pivot(tableau, row, entering)
        leaving, basic[row] = basic[row], entering
        if leaving == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basic] = tableau[:, -1]
            return z[n : 2 * n]
        entering = leaving + n if leaving < n else leaving - n
        found = _ratio_test(tableau, basic, entering, n)
        if found is None:
            return None
        row = found
    return None


def _pivot(tableau: Array, row: int, column: int) -> None:
    tableau[row] /= tableau[row, column]
    factor = tableau[:, column].copy()
    factor[row] = 0.0
    tableau -= np.outer(factor, tableau[row])


def _ratio_test(tableau: Array, basic: NDArray[np.intp], entering: int, n: int) -> int | None:
    """Return the leaving row, ties broken lexicographically, z_0 preferred; None on a ray."""
    column = tableau[:, entering]
    rows = np.flatnonzero(column > PIVOT_TOLERANCE)
    if len(rows) == 0:
        return None
    # order of comparison: right-hand side, then the columns of the basis inverse
    for j in (-1, *range(n)):
        ratios = tableau[rows, j] / column[rows]
        best = ratios.min()
        rows = rows[ratios <= best + PIVOT_TOLERANCE * max(1.0, abs(best))]
        if j == -1:
            artificial = rows[basic[rows] == 2 * n]
            if len(artificial):
                return int(artificial[0])
        if len(rows) == 1:
            break
    return int(rows[0])


def enumerate_all(M: Array, q: Array) -> Iterator[Array]:
    """Yield the solutions of a small problem, one for each complementary basis that has one."""
    n = len(q)
    for bits in range(2**n):
        chosen = np.flatnonzero([(bits >> i) & 1 for i in range(n)])
        z = np.zeros(n)
        if len(chosen):
            block = M[np.ix_(chosen, chosen)]
            if np.linalg.cond(block) > 1.0 / PIVOT_TOLERANCE:
                continue
            z[chosen] = np.linalg.solve(block, -q[chosen])
        if is_solution(M, q, z):
            yield z
