"""Tractions between the nodes, from the nodal forces of a straight edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from receding_fenicsx.arrays import Array, Ints

MIDSIDE_SHARE = 0.58
"""Weight of a node over the distance of its neighbours above which it is a midside node: there it
is 2/3, at vertices of order 2 1/3 and of order 1 1/2, on graded edges too."""


def midside_nodes(x: Array, weight: Array, radius: Array | None = None) -> Ints:
    """Return the midside nodes with a neighbour on both sides; none on elements of order 1.

    Args:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions along the edge, times r when axisymmetric.
        radius: (N,) distances from the axis when axisymmetric.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(x) < 3:
        return none
    local = weight
    if radius is not None:
        local = np.divide(weight, radius, out=np.zeros(len(x)), where=radius > 0.0)
    heavy = local[1:-1] > MIDSIDE_SHARE * (x[2:] - x[:-2])
    # every second node, beginning with the first or the second that has two neighbours
    for start in (0, 1):
        if np.all(heavy[start::2]) and not np.any(heavy[1 - start :: 2]):
            return np.arange(start + 1, len(x) - 1, 2)
    return none


def cell_means(x: Array, weight: Array, force: Array, midside: Ints) -> tuple[Array, Array, Array]:
    """Return the ends of cells along the edge, and the mean traction in each.

    On elements of order 2 lumped tractions err by opposite amounts at vertices and midside nodes;
    an element's share of the nodal forces over its length is its mean traction to fourth order.
    On elements of order 1 a cell reaches half-way to the neighbouring nodes, to second order.

    Args:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions.
        force: (N,) nodal forces.
        midside: midside nodes, as :func:`midside_nodes` finds them.

    Returns:
        Left ends, right ends and means, (n,) each.
    """
    if len(midside):
        left, right = x[midside - 1], x[midside + 1]
        length = right - left
        part = np.ones((2, len(length)))
        both = length[1:] + length[:-1]
        part[0, 1:], part[1, :-1] = length[1:] / both, length[:-1] / both
        total, whole = (
            field[midside] + part[0] * field[midside - 1] + part[1] * field[midside + 1]
            for field in (force, weight)
        )
        return left, right, total / whole
    between = 0.5 * (x[1:] + x[:-1])
    traction = force / np.where(weight > 0.0, weight, np.inf)
    return np.append(x[0], between), np.append(between, x[-1]), traction


def traction_at(x: Array, weight: Array, force: Array, points: ArrayLike) -> Array:
    """Return the traction at any points: the slope of a cubic spline through the force so far.

    Fourth order in the element's size on elements of order 2 where the traction is smooth; beside
    zone ends no better than the nodes.

    Args:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions.
        force: (N,) nodal forces.
        points: where.
    """
    left, right, mean = cell_means(x, weight, force, midside_nodes(x, weight))
    so_far = np.append(0.0, np.cumsum(mean * (right - left)))
    return np.asarray(CubicSpline(np.append(left, right[-1]), so_far)(points, 1))
