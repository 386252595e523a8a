"""Fits of power laws to mean values over cells: the end of a zone, the exponent at a corner.

At the distance d from a corner in contact

    p(d) = d^m (A_0 + A_1 d),

in the zone that begins there. The first elements err by the singularity itself, those far away by
further terms; the fit uses the elements from the third one to a part of the zone. Where elements
are equal that is a short range of distances with few digits; graded ones cover decades.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.tractions import Tractions, cell_means, midside_nodes


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

    def misfits(ends: Array) -> Array:
        a = (near[None, :, None] + ends[:, None, None]) / scale
        b = (far[None, :, None] + ends[:, None, None]) / scale
        basis = (b**power - np.maximum(a, 0.0) ** power) / (power * (b - a))
        return misfit(basis / mean[None, :, None])

    return _searched(misfits, low, high, 33)


def _searched(
    misfits: Callable[[Array], Array], low: float, high: float, count: int
) -> float | None:
    """Return the candidate of the smallest misfit, None if it lies at the range's edge."""
    best = low
    for turn in range(4):  # each round searches between the neighbours of the best candidate
        candidates = np.linspace(low, high, count)
        i = int(np.argmin(misfits(candidates)))
        if turn == 0 and i in (0, count - 1):
            return None
        best, low, high = (float(candidates[min(max(i + k, 0), count - 1)]) for k in (0, -1, 1))
    return best


def misfit(bases: Array) -> Array:
    """Return (n,) squared distances of the vector of ones from the spans of (n, k, terms) bases."""
    rest = np.ones(bases.shape[:2])
    for j in range(bases.shape[2]):
        direction = bases[:, :, j] / np.sqrt(np.sum(bases[:, :, j] ** 2, axis=1))[:, None]
        bases = bases - direction[:, :, None] * np.einsum("nk,nkt->nt", direction, bases)[:, None]
        rest = rest - direction * np.sum(direction * rest, axis=1)[:, None]
    return np.asarray(np.sum(rest**2, axis=1))


def corner_exponent_fit(at: Tractions, side: int) -> float | None:
    """Fit m at an end of the contact edge.

    Args:
        at: nodal forces and states of one instant.
        side: 1 for the end at the greatest x, -1 for that at the smallest.

    Returns:
        m; None where the corner is separated, too few elements lie in the zone beside it, or the
        pressure there follows no power.
    """
    order = np.arange(len(at.x)) if side < 0 else np.arange(len(at.x))[::-1]
    d, state = np.abs(at.x[order] - at.x[order[0]]), np.asarray(at.state)[order]
    if state[0] == State.SEPARATION:
        return None
    weight, force = at.weight[order], at.P[order]
    if at.radius is not None:
        # tractions along the edge, without the factor r
        radius = np.where(at.radius[order] > 0.0, at.radius[order], 1.0)
        weight, force = weight / radius, force / radius
    other = np.flatnonzero(state != state[0])
    zone = d[other[0] - 1] if len(other) else d[-1]
    near, far, mean = cell_means(d, weight, force, midside_nodes(d, weight))
    chosen = np.arange(len(near))
    chosen = chosen[(chosen >= 2) & (far <= 0.05 * zone)]
    # six elements at least, whose distances differ enough to tell powers
    if len(chosen) < 6 or far[chosen[-1]] < 4.0 * near[chosen[0]]:
        return None
    near, far, mean = near[chosen, None] / zone, far[chosen, None] / zone, mean[chosen, None]
    if np.any(mean <= 0.0):
        return None

    def misfits(exponents: Array) -> Array:
        # off the powers -1 and 0, whose integrals are logarithms
        power = exponents[:, None, None] + np.array([1.0, 2.0]) + 1e-9
        basis = (far**power - near**power) / (power * (far - near)) / mean
        return np.where(_leads(basis), misfit(basis), np.inf)

    return _searched(misfits, -0.95, 1.5, 50)


def _leads(bases: Array) -> NDArray[np.bool_]:
    """Return the candidates whose first term makes up the larger part in every element."""
    # a fit that lives on its second term finds the exponent less one
    ones = np.ones(bases.shape[1])
    parts = [basis[:, 0] * np.linalg.lstsq(basis, ones, rcond=None)[0][0] for basis in bases]
    return np.array([part.min() > 0.5 for part in parts])
