"""Values on the axis of an axisymmetric contact, from the nodes beside it."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array

FITTED_NODES = 5
"""Nodes off the axis that the fit goes through."""

GEOMETRY_TOLERANCE = 1e-6
"""Relative difference up to which positions and weights are the same."""


def begins_on_axis(radius: Array, weight: Array) -> bool:
    """Return whether an axisymmetric contact edge begins on the axis r = 0.

    At order 2 the node on the axis has no weight and is left out. The next one is the middle of an
    element from r = 0 to h = 2 r_0, with a weight in proportion to h^2 / 3; the node behind it has
    h (h + h') / 6, with h' of the next element, 0 where there is none.

    Args:
        radius: (N,) distance of the edge's contact nodes from the axis, in their order.
        weight: (N,) integrals of the shape functions times r.
    """
    if len(radius) == 0 or radius[0] <= GEOMETRY_TOLERANCE * radius[-1]:
        return len(radius) > 0
    h = 2.0 * radius[0]
    if len(radius) < 2 or abs(radius[1] - h) > GEOMETRY_TOLERANCE * h:
        return False
    beyond = radius[3] - radius[1] if len(radius) > 3 else 0.0
    expected = 2.0 * h * weight[1]
    return bool(abs(weight[0] * (h + beyond) - expected) <= GEOMETRY_TOLERANCE * expected)


def on_axis(x: Array, values: Array) -> Array:
    """Return the value at r = 0 of a field that is even in r, by least squares of a + b r^2.

    A node on the axis itself is left out: its weight is the smallest by far (at order 2 it has
    none), and so its traction is the least certain.

    Args:
        x: (N,) distances from the axis along the edge, increasing.
        values: (N,) or (n, N) tractions or normal displacements.

    Returns:
        The value on the axis, or (n,) of them.
    """
    near = np.flatnonzero(x > 0.0)[:FITTED_NODES]
    basis = np.stack([np.ones(len(near)), (x[near] / x[near[-1]]) ** 2], axis=1)
    fit = np.linalg.lstsq(basis, np.asarray(values)[..., near].T, rcond=None)[0]
    return np.asarray(fit[0])
