"""Exponent of the pressure at an end of the contact edge, fitted to mean values over elements.

At the distance d from a corner in contact

    p(d) = d^m (A_0 + A_1 d),

in the zone that begins there. The first elements err by the singularity itself, those far away by
further terms; the fit uses the elements from the third one to a part of the zone. Where elements
are equal that is a short range of distances with few digits; graded ones cover decades.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.power_fit import misfit
from receding_fenicsx.interface.measures.tractions import cell_means, midside_nodes
from receding_fenicsx.interface.measures.zone_ends import Tractions

FIRST = 2
"""Elements next to the corner that are left out."""
REACH = 0.05
"""Part of the zone that the fit uses."""
FEWEST = 6
"""Smallest number of elements of a fit."""
SMALLEST_RATIO = 4.0
"""Smallest ratio of the largest to the smallest distance of a fit."""
RANGE = (-0.95, 1.5)
"""Range of m."""
CANDIDATES, ROUNDS = 50, 4
"""Candidates in a round of the search; each one searches between neighbours of the best."""


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
    chosen = chosen[(chosen >= FIRST) & (far <= REACH * zone)]
    if len(chosen) < FEWEST or far[chosen[-1]] < SMALLEST_RATIO * near[chosen[0]]:
        return None
    return _best(near[chosen] / zone, far[chosen] / zone, mean[chosen])


def _best(near: Array, far: Array, mean: Array) -> float | None:
    """Return the exponent with the smallest relative error, None if it lies at the range's edge."""
    if np.any(mean <= 0.0):
        return None
    low, high = RANGE
    for turn in range(ROUNDS):
        exponents = np.linspace(low, high, CANDIDATES)
        # off the powers -1 and 0, whose integrals are logarithms
        power = exponents[:, None, None] + np.array([1.0, 2.0]) + 1e-9
        a, b = near[None, :, None], far[None, :, None]
        basis = (b**power - a**power) / (power * (b - a))
        scaled = basis / mean[None, :, None]
        i = int(np.argmin(np.where(_leads(scaled), misfit(scaled), np.inf)))
        if turn == 0 and i in (0, CANDIDATES - 1):
            return None
        low, high = exponents[max(i - 1, 0)], exponents[min(i + 1, CANDIDATES - 1)]
    return float(exponents[i])


def _leads(bases: Array) -> NDArray[np.bool_]:
    """Return the candidates whose first term makes up the larger part in every element.

    A fit that lives on its second term finds the exponent less one.
    """
    ones = np.ones(bases.shape[1])
    parts = [basis[:, 0] * np.linalg.lstsq(basis, ones, rcond=None)[0][0] for basis in bases]
    return np.array([part.min() > 0.5 for part in parts])
