"""Operations on large symmetric matrices in place, tile by tile, without a second matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array, Ints


def _slices(size: int) -> Iterator[slice]:
    # two tiles of 128 by 128 fit into a core's cache
    return (slice(first, min(first + 128, size)) for first in range(0, size, 128))


def block(rows: Ints, columns: Ints) -> tuple[Any, ...]:
    """Return the index of a block; by slices, which copy nothing, where numbers are consecutive."""
    parts = [slice(k[0], k[-1] + 1) for k in (rows, columns) if len(k) and np.all(np.diff(k) == 1)]
    return (parts[0], parts[1]) if len(parts) == 2 else np.ix_(rows, columns)


def symmetrise(K: Array, triangle: str | None = None) -> None:
    """Make a square matrix symmetric to the last bit, in place.

    ``triangle`` "lower" or "upper" replaces the other one; None takes the mean of both.
    """
    for rows in _slices(len(K)):
        for columns in _slices(rows.stop):
            below, above = K[rows, columns], K[columns, rows].T
            if triangle is None:
                tile = 0.5 * (below + above)
            elif rows == columns:
                tile = _mirrored(below, triangle)
            else:
                tile = (below if triangle == "lower" else above).copy()
            K[rows, columns] = tile
            K[columns, rows] = tile.T


def _mirrored(tile: Array, triangle: str) -> Array:
    part: Array = np.tril(tile) if triangle == "lower" else np.triu(tile)
    return part + part.T - np.diag(np.diagonal(part))


def turn(K: Array, to_local: Callable[[Array], Array]) -> None:
    """Replace a symmetric K by R K R^T to the last bit; ``to_local`` returns R times a matrix."""
    # no work where the rotation is the identity
    pattern = np.cos(1.0 + np.arange(len(K)) ** 2)
    if np.array_equal(to_local(pattern), pattern):
        return
    for part in _slices(len(K)):
        K[:, part] = to_local(K[:, part])
    for part in _slices(len(K)):
        K[part] = to_local(K[part].T).T
    symmetrise(K)


def norm(K: Array) -> float:
    """Return the largest row sum of |K|."""
    return max((float(np.abs(K[rows]).sum(axis=1).max()) for rows in _slices(len(K))), default=0.0)
