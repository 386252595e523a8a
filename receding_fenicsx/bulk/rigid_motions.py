"""Rigid motions in the plane: translations in x and y, rotation about a pivot."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from receding_fenicsx.arrays import Array


def motions(points: Array, pivot: Array, size: float) -> Array:
    """Return the displacements (n, 2, 3) of points in the three rigid motions."""
    moved = np.zeros((len(points), 2, 3))
    moved[:, 0, 0] = moved[:, 1, 1] = 1.0
    moved[:, 0, 2] = -(points[:, 1] - pivot[1]) / size
    moved[:, 1, 2] = (points[:, 0] - pivot[0]) / size
    return moved


def free_motions(constraints: Array, tolerance: float = 1e-12) -> Array:
    """Return a basis (n, k) of the combinations of n motions on which all rows (m, n) vanish.

    The basis is in echelon form: translations come first, without rotation where possible.
    """
    n = constraints.shape[1]
    _, values, right = np.linalg.svd(
        np.vstack([constraints, np.zeros((n, n))]), full_matrices=False
    )
    basis = right[int(np.sum(values > tolerance * values.max(initial=1.0))) :]
    leading: list[int] = []
    for column in range(n):
        if np.linalg.matrix_rank(basis[:, [*leading, column]], 1e-12) > len(leading):
            leading.append(column)
    basis = np.linalg.solve(basis[:, leading], basis)
    basis[:, leading] = np.eye(len(leading))
    return np.where(np.abs(basis) > 1e-12, basis, 0.0).T


def scaled(modes: Array) -> Array:
    """Return modes with largest entry 1."""
    if modes.shape[1] == 0:
        return modes
    return modes / np.abs(modes).max(axis=0)


def common_motions(
    constraints: Sequence[Array], sides: Sequence[Collection[int]]
) -> list[tuple[list[int], Array]]:
    """Return the groups of bodies that can move together, and their motions (3, n) about one pivot.

    Bodies that contacts connect move together; those that are connected with a plane cannot.
    ``constraints`` are (m, 3) of each body, ``sides`` its contacts and ties; one of one body only
    is one with a plane.
    """
    todo, found = set(range(len(sides))), []
    while todo:
        group: set[int] = set()
        grown = {min(todo)}
        while grown != group:
            group = grown
            touched = set().union(*(sides[i] for i in group))
            grown = group | {i for i in todo if touched & set(sides[i])}
        todo -= group
        motions = free_motions(np.vstack([constraints[i] for i in sorted(group)]))
        on_plane = any(sum(k in own for own in sides) == 1 for k in touched)
        if motions.shape[1] and not on_plane:
            found.append((sorted(group), motions))
    return found
