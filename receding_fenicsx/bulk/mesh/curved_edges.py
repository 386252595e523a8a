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

    def find(self, a: Array, b: Array) -> tuple[Ints, Ints]:
        """Return the numbers of the facets from a to b (n, 2) that are here, and those here."""
        keys = [_key(*pair) for pair in self.ends]
        place = {key: i for i, key in enumerate(keys)}
        found = [place.get(_key(*pair), -1) for pair in zip(a, b, strict=True)]
        numbers = np.array(found, dtype=np.int64)
        on = np.flatnonzero(numbers >= 0)
        return on, numbers[on]


@cache
def gauss() -> tuple[Array, Array]:
    """Return places s in [0, 1] and weights of Gauss's rule on a facet."""
    # 8 points: at order 2, polynomial loads of degree 13 are integrated exactly
    position, weight = legendre.leggauss(8)
    return 0.5 * (1.0 + position), 0.5 * weight


def _key(a: Array, b: Array) -> frozenset[tuple[float, float]]:
    """Return the key of a facet, the same in both orientations."""
    return frozenset([(float(a[0]), float(a[1])), (float(b[0]), float(b[1]))])


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
    tags, coordinates, _ = model.mesh.getNodes(1, curve, includeBoundary=True)
    place = dict(zip(tags.tolist(), coordinates.reshape(-1, 3)[:, :2], strict=True))
    inner, _, parameters = model.mesh.getNodes(1, curve, returnParametricCoord=True)
    known = dict(zip(inner.tolist(), parameters.tolist(), strict=True))
    facets = np.asarray(nodes[0], dtype=np.int64).reshape(-1, 2)
    ends = np.array([[place[int(tag)] for tag in facet] for facet in facets])
    u = np.array([[known.get(int(tag), np.nan) for tag in facet] for facet in facets])
    low, high = (float(bound[0]) for bound in model.getParametrizationBounds(1, curve))

    def at(u: Array) -> Array:
        values = np.array(model.getValue(1, curve, u.ravel().tolist()))
        return np.asarray(values.reshape(*u.shape, 3)[..., :2])

    _fill_ends(u, ends, at(np.array([low, high])), (low, high))
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


def _fill_ends(u: Array, ends: Array, bounds: Array, limits: tuple[float, float]) -> None:
    """Fill in the parameters of the curve's ends: of the nearer, on closed curves by direction."""
    low, high = limits
    for facet, end in zip(*np.nonzero(np.isnan(u)), strict=True):
        away = np.hypot(*(bounds - ends[facet, end]).T)
        other = u[facet, 1 - end]
        length = np.hypot(*(ends[facet, 0] - ends[facet, 1]))
        if np.isnan(other) or abs(away[0] - away[1]) > 0.5 * length:
            u[facet, end] = low if away[0] <= away[1] else high
        else:
            u[facet, end] = low if other - low < high - other else high
