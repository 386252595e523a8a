"""Values on the axis of an axisymmetric contact, from the nodes beside it."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array

FITTED_NODES = 5
"""Nodes off the axis that the fit goes through."""

GEOMETRY_TOLERANCE = 1e-6
"""Relative difference up to which positions and weights are the same."""


def begins_on_axis(x: Array) -> bool:
    """Return whether an axisymmetric contact edge begins on the axis, and not at a hole.

    At order 2 its first node is the middle of an element, half as far from the axis as the second:
    a hole whose radius is the distance between two nodes looks the same.

    Args:
        x: (N,) radii of the edge's contact nodes, increasing.
    """
    if len(x) == 0 or x[0] <= 0.0:
        return len(x) > 0
    return len(x) > 1 and bool(abs(x[1] - 2.0 * x[0]) <= GEOMETRY_TOLERANCE * x[1])


def midside_beside_axis(x: Array, weight: Array) -> bool:
    """Return whether an edge begins on the axis, with an element of order 2.

    The node on the axis has no weight then and is left out; the next one is the middle of an
    element of length h = 2 x_0, with the weight h^2 / 3 per radian.

    Args:
        x: (N,) radii of the edge's contact nodes, increasing.
        weight: (N,) integrals of the shape functions times r.
    """
    if not begins_on_axis(x):
        return False
    return bool(
        x[0] > 0.0 and abs(weight[0] - 4.0 / 3.0 * x[0] ** 2) <= GEOMETRY_TOLERANCE * weight[0]
    )


def on_axis(x: Array, values: Array) -> Array:
    """Return the value at r = 0 of a field that is even in r, by least squares of a + b r^2.

    A node on the axis itself is left out: its weight is the smallest by far (at order 2 it has
    none), and so its traction is the least certain.

    Args:
        x: (N,) radii of the contact nodes, increasing.
        values: (N,) or (n, N) tractions or normal displacements.

    Returns:
        The value on the axis, or (n,) of them.
    """
    near = np.flatnonzero(x > 0.0)[:FITTED_NODES]
    basis = np.stack([np.ones(len(near)), (x[near] / x[near[-1]]) ** 2], axis=1)
    fit = np.linalg.lstsq(basis, np.asarray(values)[..., near].T, rcond=None)[0]
    return np.asarray(fit[0])
