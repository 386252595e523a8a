"""Tractions between the nodes, from the nodal forces of a straight edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from receding_fenicsx.interface.contact import Array

HEAVY = 1.5
"""Weight of a midside node over its neighbours' beyond which elements are seen to be of order 2."""


def is_quadratic(weight: Array) -> bool:
    """Whether every second node is the midside node of an element of order 2.

    Args:
        weight: (N,) integrals of the shape functions along the edge (not times r).
    """
    ends = np.maximum(weight[:-1:2], weight[2::2]) if len(weight) % 2 else weight
    return len(weight) % 2 == 1 and bool(np.all(weight[1::2] > HEAVY * ends))


def cell_means(
    x: Array, weight: Array, force: Array, quadratic: bool
) -> tuple[Array, Array, Array]:
    """Return the ends of cells along the edge, and the mean traction in each.

    On elements of order 2 lumped tractions err by opposite amounts at vertices and midside nodes;
    an element's share of the nodal forces over its length is its mean traction to fourth order.
    On elements of order 1 a cell reaches half-way to the neighbouring nodes, to second order.

    Args:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions.
        force: (N,) nodal forces.
        quadratic: whether the elements are of order 2, as :func:`is_quadratic` says.

    Returns:
        Left ends, right ends and means, (n,) each.
    """
    if quadratic:
        left, right = x[:-1:2], x[2::2]
        length = right - left
        part = np.ones((2, len(length)))
        both = length[1:] + length[:-1]
        part[0, 1:], part[1, :-1] = length[1:] / both, length[:-1] / both
        total = force[1::2] + part[0] * force[:-1:2] + part[1] * force[2::2]
        return left, right, total / length
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
    left, right, mean = cell_means(x, weight, force, is_quadratic(weight))
    so_far = np.append(0.0, np.cumsum(mean * (right - left)))
    return np.asarray(CubicSpline(np.append(left, right[-1]), so_far)(points, 1))
