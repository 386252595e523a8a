"""Values on the axis of an axisymmetric contact, from the nodes beside it."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.interface.contact import Array

AXIS_NODES = 5
"""Nodes off the axis that the fit goes through."""


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
    near = np.flatnonzero(x > 0.0)[:AXIS_NODES]
    basis = np.stack([np.ones(len(near)), (x[near] / x[near[-1]]) ** 2], axis=1)
    fit = np.linalg.lstsq(basis, np.asarray(values)[..., near].T, rcond=None)[0]
    return np.asarray(fit[0])
