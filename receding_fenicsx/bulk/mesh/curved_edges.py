"""True curves of the facets on curved edges of a .geo file, for the resultants of loads.

Cells have straight sides, so that a facet on a curved edge is a chord. A load integrated on chords
has a resultant that is off by the square of the facets' length. Where gmsh knows the curve it is
kept at the Gauss points of each facet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from receding_fenicsx.arrays import Array, Ints


@dataclass(frozen=True)
class Arcs:
    """The true curves of the facets on curved edges."""

    ends: Array  # (n, 2, 2) coordinates of the facets' ends
    points: Array  # (n, points, 2) Gauss points of the curve between them
    # (n, points, 2) derivative of the curve's points by s, which runs from 0 at the first end
    # to 1 at the second
    slopes: Array

    def find(self, ends: Array) -> tuple[Ints, Ints]:
        """Return the numbers of facets with ends (n, 2, 2) that are here, and those here."""

        def keys(ends: Array) -> list[frozenset[tuple[float, ...]]]:
            return [frozenset(map(tuple, pair)) for pair in ends.tolist()]

        place = {key: i for i, key in enumerate(keys(self.ends))}
        numbers = np.array([place.get(key, -1) for key in keys(ends)], dtype=np.int64)
        on = np.flatnonzero(numbers >= 0)
        return on, numbers[on]


@cache
def gauss() -> tuple[Array, Array]:
    """Return places s in [0, 1] and weights of Gauss's rule on a facet."""
    # 8 points: at order 2, polynomial loads of degree 13 are integrated exactly
    position, weight = legendre.leggauss(8)
    return 0.5 * (1.0 + position), 0.5 * weight


def arcs_of(gmsh: Any, scale: float) -> Arcs:
    """Return the curves behind the facets of all physical curves of gmsh's model, times a scale."""
    curves = {
        int(curve)
        for dim, tag in gmsh.model.getPhysicalGroups(1)
        for curve in gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    }
    parts = [_arcs_of_curve(gmsh, curve) for curve in sorted(curves)]
    ends, points, slopes = (
        np.concatenate([np.empty((0, n, 2)), *(part[i] for part in parts if part is not None)])
        for i, n in enumerate((2, len(gauss()[0]), len(gauss()[0])))
    )
    return Arcs(scale * ends, scale * points, scale * slopes)


def _arcs_of_curve(gmsh: Any, curve: int) -> tuple[Array, Array, Array] | None:
    """Return ends, points and slopes of one curve's facets; None where it is straight."""
    model = gmsh.model
    # straight, or known by its mesh only
    if model.getType(1, curve) in ("Line", "Discrete curve", "Unknown"):
        return None
    nodes = model.mesh.getElements(1, curve)[2]
    if not len(nodes):
        return None
    tags, coordinates, parameters = model.mesh.getNodes(1, curve, True, True)  # ends too
    known, first = np.unique(tags, return_index=True)
    facets = first[np.searchsorted(known, nodes[0])].reshape(-1, 2)
    ends, u = coordinates.reshape(-1, 3)[facets, :2], parameters[facets]
    if len(known) < len(tags):
        # both ends of a closed curve are one node, with the parameter of one
        low, high = (float(bound[0]) for bound in model.getParametrizationBounds(1, curve))
        far = np.abs(u[:, 1:] - u[:, :1]) > 0.5 * (high - low)
        at_end = np.minimum(u - low, high - u) < 1e-9 * (high - low)
        u = np.where(far & at_end, low + high - u, u)

    def at(u: Array) -> Array:
        values = np.array(model.getValue(1, curve, u.ravel().tolist()))
        return np.asarray(values.reshape(*u.shape, 3)[..., :2])

    near = 1e-6 * float(np.hypot(*np.ptp(ends.reshape(-1, 2), axis=0)))
    if not np.all(np.abs(at(u) - ends) <= near):
        return None  # the nodes lie on another curve, such as a compound one
    # derivatives at Gauss's points of the polynomial through these and the ends: gmsh's own are
    # finite differences, good to 1e-10 only
    places = np.concatenate([[0.0], gauss()[0], [1.0]])
    degree = len(places) - 1
    coefficients = np.linalg.inv(legendre.legvander(2.0 * places - 1.0, degree))
    derivative = 2.0 * legendre.legder(coefficients, axis=0)
    slope = legendre.legvander(2.0 * places[1:-1] - 1.0, degree - 1) @ derivative
    points = at(u[:, :1] + places * (u[:, 1:] - u[:, :1]))
    return ends, points[:, 1:-1], np.einsum("qp,npk->nqk", slope, points)
