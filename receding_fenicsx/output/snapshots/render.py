"""Raster images of fields on plane meshes."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints

Pixels = NDArray[np.uint8]
"""(height, width, 3) red, green, blue, from the top row downwards."""


def raster(
    points: Array,
    cells: Ints,
    values: Array,
    limits: tuple[float, float],
    colours: Array,
    window: tuple[float, float, float, float],
    size: tuple[int, int],
) -> Pixels:
    """Return the image of a field that is linear in each triangle, white beside the mesh.

    A pixel has the mean colour of four samples, whose values are interpolated before they are
    coloured.

    Args:
        points: (n, 2) vertices.
        cells: (m, 3 or 4) vertices around each cell; a quadrilateral is drawn as two triangles.
        values: (n,) field.
        limits: values of the first and the last colour.
        colours: (k, 3 or 4) colours in [0, 1].
        window: left, right, bottom and top of what is shown.
        size: width and height in pixels.
    """
    left, right, bottom, top = window
    width, height = size
    triangles = cells if cells.shape[1] == 3 else np.vstack([cells[:, :3], cells[:, [0, 2, 3]]])
    places = (points - [left, bottom]) / [right - left, top - bottom] * size
    table = np.round(255.0 * np.vstack([colours[:, :3], np.ones(3)])).astype(np.uint16)
    total = np.zeros((height, width, 3), np.uint16)
    for shift in product((0.25, 0.75), repeat=2):
        sampled = _sample(places - shift, triangles, values, size)
        part = (sampled - limits[0]) / (limits[1] - limits[0])
        # beside the mesh there is nan, and the last colour is white
        index = np.clip(np.nan_to_num(len(colours) * part), 0, len(colours) - 1).astype(int)
        total += table[np.where(np.isnan(sampled), len(colours), index)]
    return np.asarray(np.round(total[::-1] / 4.0), dtype=np.uint8)


def _sample(points: Array, triangles: Ints, values: Array, size: tuple[int, int]) -> Array:
    """Return (height, width) values at the points of whole coordinates; nan beside the mesh.

    A point on an edge belongs to one of both triangles: the crossing of a row with an edge is the
    same number in both, as it is computed from its ends in the order of their numbers.
    """
    width, height = size
    image = np.full(width * height, np.nan)
    # three edges of each triangle, as three lists, and the rows that cross each: two edges of a
    # triangle or none
    ends = np.sort(np.vstack([np.roll(triangles, k, axis=1)[:, :2] for k in range(3)]), axis=1)
    (xa, ya), (xb, yb) = (points[ends[:, k]].T for k in (0, 1))
    first, stop = (
        np.clip(np.ceil(f(ya, yb)), 0, height).astype(int) for f in (np.minimum, np.maximum)
    )
    edge, row = _ranges(first, stop)
    crossing = xa[edge] + (row - ya[edge]) * ((xb - xa)[edge] / (yb - ya)[edge])
    order = np.argsort(edge % len(triangles) * height + row, kind="stable")
    owner, row = edge[order][::2] % len(triangles), row[order][::2]
    crossed = np.clip(np.ceil(np.sort(crossing[order].reshape(-1, 2), axis=1)), 0, width)
    span, column = _ranges(*crossed.T.astype(int))
    # the plane through the values of a triangle
    (x0, y0), (x1, y1), (x2, y2) = (points[triangles[:, k]].T for k in range(3))
    v0, v1, v2 = values[triangles].T
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    area = np.where(area == 0.0, 1.0, area)
    along = ((v1 - v0) * (y2 - y0) - (v2 - v0) * (y1 - y0)) / area
    up = ((v2 - v0) * (x1 - x0) - (v1 - v0) * (x2 - x0)) / area
    level = v0[owner] - along[owner] * x0[owner] + up[owner] * (row - y0[owner])
    image[row[span] * width + column] = level[span] + along[owner][span] * column
    return image.reshape(height, width)


def _ranges(first: Ints, stop: Ints) -> tuple[Ints, Ints]:
    """Return the members of the ranges from ``first`` up to ``stop``, and the number of each."""
    count = np.maximum(stop - first, 0)
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - (np.cumsum(count) - count - first)[which]
