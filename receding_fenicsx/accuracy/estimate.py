"""Estimated errors of numbers from their values on several meshes.

With numbers a_0 of the finest mesh and a_1, a_2, ... of meshes coarser by r_1 < r_2 < ... (r_0 = 1)
three meshes i < j < k show the order p of

    |a_k - a_j| / |a_j - a_i| = (r_k^p - r_j^p) / (r_j^p - r_i^p),

and with the median p of all triples, limited to [1/2, 8/5], or to 7/4 on graded meshes, the error
of a_0 is taken to be

    e = max |a_i - a_j| / (r_j^p - r_i^p)  over all pairs of meshes.

The largest value is taken because numbers may agree on two meshes by chance. The limits are used
because zone ends move from node to node: differences are partly noise, and an order above that of
the elements is chance. Where a zone is one or two nodes wide numbers stay constant over several
meshes until it is resolved: there p is at most 1. Meshes of nearly the same size differ by noise
only and are not compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import brentq

from receding_fenicsx.accuracy.numbers import Number

MIN_RATIO = 1.4
"""Smallest ratio of the sizes of two meshes that are compared."""
FARTHEST = 7.9
"""Largest ratio of the size of a mesh to the finest that is used: two steps of a search."""
ORDERS = (0.5, 1.6)
"""Range of orders that an estimate assumes on equal elements."""
GRADED_ORDER = 1.75
"""The largest on meshes graded to sharp corners, whose orders are less disturbed."""
SEARCHED_ORDERS = (-2.0, 8.0)
"""Range in which the order of three meshes is searched for."""
UNRESOLVED_ORDER = 1.0
"""Largest order that is assumed where a zone is not resolved, or with two meshes."""
SINGULAR_ORDER = 0.2
"""Median order below which numbers that move in one direction do not converge in order."""
SINGULAR_CHANGE = 1e-3
"""Relative change between meshes below which a number is not called singular."""
MIN_RELATIVE_ERROR = 1e-6
"""Smallest relative error that is returned."""


@dataclass(frozen=True)
class Level:
    """What a run on one mesh of a family found.

    Attributes:
        elements: contact elements, or their equivalent; meshes of a family have sizes ~ 1/elements.
        nodes: contact nodes.
        seconds: what the run took.
        numbers: its headline numbers.
        resolved: every zone is more than two nodes wide.
        sharp: a contact edge ends in a large pressure, at a sharp corner.
        graded: the mesh is graded towards the ends of the contact.
    """

    elements: int
    nodes: int
    seconds: float
    numbers: Mapping[str, Number]
    resolved: bool = True
    sharp: bool = False
    graded: bool = False


@dataclass(frozen=True)
class Estimate:
    """A number with its estimated error.

    Attributes:
        value: on the finest mesh; infinite where the number is singular there.
        error: estimated; NaN where nothing is known, infinite where the number does not converge.
        order: observed order, NaN where fewer than three meshes show it.
        size: what relative errors refer to.
    """

    value: float
    error: float
    order: float
    size: float

    @property
    def relative(self) -> float:
        """The error over the number's size."""
        return self.error / self.size if self.size > 0.0 else 0.0 * self.error


def estimates_of(levels: Sequence[Level]) -> dict[str, Estimate]:
    """Estimate the errors of all numbers of the finest mesh.

    Args:
        levels: meshes of one family, in any order.
    """
    finest, *coarser = sorted(levels, key=lambda level: -level.elements)
    found = {}
    for name, number in finest.numbers.items():
        if math.isinf(number.value):
            found[name] = Estimate(number.value, math.inf, math.nan, number.size)
            continue
        values = [(1.0, number.value)]
        for level in coarser:
            ratio = finest.elements / level.elements
            other = level.numbers.get(name)
            if other is not None and ratio <= FARTHEST and math.isfinite(other.value):
                values.append((ratio, other.value))
        order = observed_order(values)
        if is_singular(values, order, number.size):
            error = math.inf
        else:
            resolved = GRADED_ORDER if finest.graded else ORDERS[1]
            most = resolved if finest.resolved else UNRESOLVED_ORDER
            least = max(number.known_to, MIN_RELATIVE_ERROR * number.size)
            error = max(estimated_error(values, order, most), least)
        found[name] = Estimate(number.value, error, order, number.size)
    return found


def estimated_error(
    values: Sequence[tuple[float, float]], order: float, most: float = ORDERS[1]
) -> float:
    """Return the estimated error of the first value; NaN when nothing is known of coarser meshes.

    Args:
        values: (r_k, a_k), r_k increasing from 1.
        order: observed order; NaN stands for 1.
        most: largest order that is assumed.
    """
    p = UNRESOLVED_ORDER if math.isnan(order) else order
    p = min(max(p, ORDERS[0]), most)
    slopes = [abs(a - b) / (s**p - r**p) for (r, a), (s, b) in _pairs(values)]
    return max(slopes, default=math.nan)


def observed_order(values: Sequence[tuple[float, float]]) -> float:
    """Return the median order that triples of meshes show; NaN without one."""
    orders = []
    for (r, a), (s, b), (t, c) in combinations(values, 3):
        near, far = abs(a - b), abs(b - c)
        if s < MIN_RATIO * r or t < MIN_RATIO * s or near == far == 0.0:
            continue
        orders.append(_order((r, s, t), far / near if near > 0.0 else math.inf))
    return float(np.median(orders)) if orders else math.nan


def _order(sizes: tuple[float, float, float], ratio: float) -> float:
    """Return the order at which differences between three sizes have a ratio."""
    r, s, t = sizes

    def excess(p: float) -> float:
        if abs(p) < 1e-9:
            return math.log(t / s) / math.log(s / r) - ratio
        return (t**p - s**p) / (s**p - r**p) - ratio

    low, high = SEARCHED_ORDERS
    if excess(low) >= 0.0 or excess(high) <= 0.0:
        return low if excess(low) >= 0.0 else high
    return float(brentq(excess, low, high))


def is_singular(values: Sequence[tuple[float, float]], order: float, size: float) -> bool:
    """Return whether a number moves in one direction without converging in order."""
    chain = [values[0]]
    for value in values[1:]:
        if value[0] >= MIN_RATIO * chain[-1][0]:
            chain.append(value)
    steps = np.diff([a for _, a in chain])
    one_way = len(steps) > 1 and bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    return one_way and order < SINGULAR_ORDER and abs(steps[0]) > SINGULAR_CHANGE * size


def _pairs(
    values: Sequence[tuple[float, float]],
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return [(a, b) for a, b in combinations(values, 2) if b[0] >= MIN_RATIO * a[0]]
