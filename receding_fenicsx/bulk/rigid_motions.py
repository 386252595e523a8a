"""Rigid motions in the plane: translations in x and y, rotation about a pivot."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array

MOTION_TOLERANCE = 1e-12
"""Largest constraint on a rigid motion (lengths over the body's size) that counts as zero."""


def motions(points: Array, pivot: Array, size: float) -> Array:
    """Return the displacements (n, 2, 3) of points in the three rigid motions."""
    moved = np.zeros((len(points), 2, 3))
    moved[:, 0, 0] = moved[:, 1, 1] = 1.0
    moved[:, 0, 2] = -(points[:, 1] - pivot[1]) / size
    moved[:, 1, 2] = (points[:, 0] - pivot[0]) / size
    return moved


def free_motions(constraints: Array) -> Array:
    """Return a basis (3, n) of the rigid motions on which all constraints (m, 3) vanish.

    The basis is in echelon form: translations come first, without rotation where possible.
    """
    _, values, right = np.linalg.svd(
        np.vstack([constraints, np.zeros((3, 3))]), full_matrices=False
    )
    basis = right[int(np.sum(values > MOTION_TOLERANCE * max(1.0, values[0]))) :]
    row = 0
    for column in range(3):
        if row == len(basis):
            break
        best = row + int(np.argmax(np.abs(basis[row:, column])))
        if abs(basis[best, column]) > MOTION_TOLERANCE:
            basis[[row, best]] = basis[[best, row]]
            basis[row] /= basis[row, column]
            for other in range(len(basis)):
                if other != row:
                    basis[other] -= basis[other, column] * basis[row]
            row += 1
    return np.where(np.abs(basis) > MOTION_TOLERANCE, basis, 0.0).T


def scaled(modes: Array) -> Array:
    """Return modes with largest entry 1."""
    if modes.shape[1] == 0:
        return modes
    return modes / np.abs(modes).max(axis=0)
