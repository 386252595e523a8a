"""Nodal forces of a traction, from shape functions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial.legendre import leggauss

Array = np.ndarray


def nodal_forces(
    x: Array, degree: int, traction: Callable[[Array], Array], pieces: int = 1
) -> Array:
    """Integrals of a traction times each shape function, by Gauss's rule in pieces of an element.

    ``x`` are the nodes of an edge, middle ones of elements of order 2 included; one piece is exact
    for polynomials up to degree 13.
    """
    points, weights = leggauss(8)
    cuts = np.linspace(0.0, 1.0, pieces + 1)
    t = (cuts[:-1, None] + 0.5 * (points + 1.0) * np.diff(cuts)[:, None]).ravel()
    dt = (0.5 * weights * np.diff(cuts)[:, None]).ravel()
    shapes = [1.0 - t, t]
    if degree == 2:
        shapes = [(1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)]
    force = np.zeros(len(x))
    for i in range(0, len(x) - 1, degree):
        length = x[i + degree] - x[i]
        values = traction(x[i] + t * length)
        for j, shape in enumerate(shapes):
            force[i + j] += length * np.sum(dt * values * shape)
    return force


def with_middles(corners: Array) -> Array:
    """Nodes of elements of order 2 between corners."""
    return np.sort(np.append(corners, 0.5 * (corners[1:] + corners[:-1])))
