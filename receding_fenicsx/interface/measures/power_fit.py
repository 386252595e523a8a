"""Fit of a power law to mean values over cells, for the place where a quantity vanishes."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array

CANDIDATES = 33
"""Candidate ends in one round of the search."""
ROUNDS = 4
"""Rounds of the search; each one searches between the neighbours of the best candidate."""


def fit_end(
    near: Array, far: Array, mean: Array, law: tuple[float, int], search: tuple[float, float]
) -> float | None:
    """Fit d^m (A_0 + A_1 d + ...) to means over cells, by least squares of the relative error.

    For each candidate end the coefficients follow from linear least squares; the end with the
    smallest error is searched for.

    Args:
        near: (k,) distance of each cell's nearer end from the zone's last node.
        far: (k,) the same of its further end.
        mean: (k,) mean values over the cells.
        law: m, and the number of terms.
        search: range of the end's distance beyond the last node.

    Returns:
        Distance of the end beyond the last node; None when a value is not positive, or when the
        best end lies at the edge of the range.
    """
    if np.any(mean <= 0.0):
        return None
    exponent, terms = law
    power = exponent + np.arange(terms) + 1.0
    scale = float(far.max())
    low, high = max(search[0], -0.5 * float(far.min())), search[1]
    best = 0.0
    for turn in range(ROUNDS):
        ends = np.linspace(low, high, CANDIDATES)
        a = (near[None, :, None] + ends[:, None, None]) / scale
        b = (far[None, :, None] + ends[:, None, None]) / scale
        basis = (b**power - np.maximum(a, 0.0) ** power) / (power * (b - a))
        i = int(np.argmin(misfit(basis / mean[None, :, None])))
        if turn == 0 and i in (0, CANDIDATES - 1):
            return None
        best = float(ends[i])
        low, high = ends[max(i - 1, 0)], ends[min(i + 1, CANDIDATES - 1)]
    return best


def misfit(bases: Array) -> Array:
    """Return (n,) squared distances of the vector of ones from the spans of (n, k, terms) bases."""
    rest = np.ones(bases.shape[:2])
    for j in range(bases.shape[2]):
        direction = bases[:, :, j] / np.sqrt(np.sum(bases[:, :, j] ** 2, axis=1))[:, None]
        bases = bases - direction[:, :, None] * np.einsum("nk,nkt->nt", direction, bases)[:, None]
        rest = rest - direction * np.sum(direction * rest, axis=1)[:, None]
    return np.asarray(np.sum(rest**2, axis=1))
