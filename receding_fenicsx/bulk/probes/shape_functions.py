"""Shape functions of straight-sided cells at points, from the nodes of the element."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array, Ints

CELL_TOLERANCE = 1e-9
"""Distance from a cell, over its size, up to which it touches a point."""
NEWTON_STEPS = 20
"""Steps of Newton's method for reference coordinates in a quadrilateral."""


def middle(corners: int) -> Array:
    """Return the reference coordinates of a cell's midpoint."""
    return np.full(2, 1.0 / 3.0 if corners == 3 else 0.5)


def mapped(corners: Array, at: Array) -> tuple[Array, Array]:
    """Return the place of reference coordinates in a cell, and its Jacobian dx/dX."""
    first, along = corners[0], corners[1:3] - corners[0]
    if len(corners) == 3:
        return first + at @ along, along.T
    twist = corners[3] - corners[1] - corners[2] + first
    jacobian = np.column_stack([along[0] + at[1] * twist, along[1] + at[0] * twist])
    return first + at @ along + at[0] * at[1] * twist, jacobian


def reference(corners: Array, point: Array) -> Array:
    """Return the reference coordinates of a point of a cell; NaN where there are none."""
    at = np.full(2, 0.5)
    for _ in range(1 if len(corners) == 3 else NEWTON_STEPS):
        place, jacobian = mapped(corners, at)
        if np.linalg.det(jacobian) == 0.0:
            return np.full(2, np.nan)
        at = at + np.linalg.solve(jacobian, point - place)
    off = np.abs(mapped(corners, at)[0] - point).max()
    return at if off <= CELL_TOLERANCE * np.ptp(corners, axis=0).max() else np.full(2, np.nan)


def touches(at: Array, corners: int) -> bool:
    """Return whether reference coordinates lie in a cell, or on its boundary up to round-off."""
    inside = at.min() >= -CELL_TOLERANCE
    far = at.sum() if corners == 3 else at.max()
    return bool(inside and far <= 1.0 + CELL_TOLERANCE)


def shape_functions(corners: Array, nodes: Array, at: Array) -> tuple[Array, Array]:
    """Return values (n,) and gradients (n, 2) of a cell's shape functions.

    They are the polynomials of the element's space that are 1 at one of its n nodes and 0 at the
    others.

    Args:
        corners: the cell's corners.
        nodes: (n, 2) coordinates of the nodes.
        at: reference coordinates.
    """
    at_nodes = np.array([reference(corners, node) for node in nodes])
    value, slopes = tabulated(at_nodes, len(corners), at[None])
    _, jacobian = mapped(corners, at)
    return value[0], slopes[:, 0].T @ np.linalg.inv(jacobian)


def tabulated(nodes: Array, corners: int, at: Array) -> tuple[Array, Array]:
    """Return values (m, n) and slopes (2, m, n) of the shape functions of a reference cell.

    Args:
        nodes: (n, 2) reference coordinates of the element's nodes.
        corners: number of the cell's corners.
        at: (m, 2) reference points.
    """
    powers = _powers(len(nodes), corners)
    inverse = np.linalg.inv(_monomials(powers, nodes))
    lowered = [np.maximum(powers - unit, 0) for unit in ([1, 0], [0, 1])]
    slopes = [powers[:, k] * _monomials(lowered[k], at) @ inverse for k in range(2)]
    return _monomials(powers, at) @ inverse, np.array(slopes)


def _powers(nodes: int, corners: int) -> Ints:
    """Return the powers (n, 2) of the monomials that span an element's space."""
    degree = 1 if nodes == corners else 2
    every = np.indices((degree + 1, degree + 1)).reshape(2, -1).T
    return every[every.sum(axis=1) <= degree] if corners == 3 else every


def _monomials(powers: Ints, at: Array) -> Array:
    """Return the monomials (k, n) at k reference points."""
    return np.asarray(np.prod(at[:, None, :] ** powers, axis=2))
