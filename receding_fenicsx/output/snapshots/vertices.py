"""Operations on the vertices of the fields: merged axis, outline, areas, displacements of edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.fields import Fields

EDGE_TOLERANCE = 1e-9
"""Distance from a line, over the body's size, within which a vertex lies on it."""


def merge_axis(fields: Fields) -> Fields:
    """Merge the vertices of both halves of a body on the axis x = 0; average their values."""
    axis = np.flatnonzero(
        np.abs(fields.points[:, 0]) <= EDGE_TOLERANCE * np.abs(fields.points).max()
    )
    # vertices of two bodies are not merged
    bodies = np.zeros(len(axis)) if fields.body is None else fields.body[axis]
    keys = np.stack([fields.points[axis, 1], bodies], axis=1)
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = fields.points.copy()
    points[axis, 0] = 0.0
    target = np.arange(len(fields.points))
    target[axis] = axis[first][place]
    count = np.bincount(target, minlength=len(target)).astype(float)
    used = np.flatnonzero(count)

    def mean(values: Array) -> Array:
        return np.bincount(target, values, minlength=len(target))[used] / count[used]

    return Fields(
        points=points[used],
        cells=np.searchsorted(used, target[fields.cells]),
        displacement=np.stack([mean(part) for part in fields.displacement.T], axis=1),
        stress={name: mean(values) for name, values in fields.stress.items()},
        body=None if fields.body is None else fields.body[used],
    )


def outline(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (k, 2) vertices of the edges that belong to one cell only."""
    sides = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return np.asarray(edges[count == 1], dtype=np.int64)


def vertex_areas(points: Array, cells: NDArray[np.int64]) -> Array:
    """Return (n,) areas of the vertices: equal shares of the cells around each."""
    x, y = points[cells][..., 0], points[cells][..., 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    width = cells.shape[1]
    share = np.repeat(area / width, width)
    return np.asarray(np.bincount(cells.ravel(), share, len(points)), dtype=float)


def edge_values(fields: Fields, values: Array, place: Array, normal: Array, body: int = 0) -> Array:
    """Interpolate values along a straight edge from the vertices on it.

    Args:
        fields: fields of the whole body.
        values: (n, k) values at its vertices.
        place: (m, 2) points of the edge.
        normal: (2,) unit normal of the edge.
        body: number of the body that the edge belongs to.

    Returns:
        (m, k) values.
    """
    tangent = np.array([normal[1], -normal[0]])
    near = EDGE_TOLERANCE * np.abs(fields.points).max()
    along = (fields.points - place[0]) @ tangent
    wanted = (place - place[0]) @ tangent
    on = np.abs((fields.points - place[0]) @ normal) <= near
    on &= (along >= wanted.min() - near) & (along <= wanted.max() + near)
    if fields.body is not None:
        on &= fields.body == body
    order = np.argsort(along[on], kind="stable")
    position, known = along[on][order], values[on][order]
    return np.stack([np.interp(wanted, position, column) for column in known.T], axis=1)
