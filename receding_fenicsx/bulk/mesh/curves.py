"""Curved edges: the polyline of their vertices, with positions and normals along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.mesh.raw_mesh import Line, NotStraight, RawMesh, cells_behind, line_of
from receding_fenicsx.errors import InputError

SHARPEST_TURN = 0.6
"""Largest angle between neighbouring facets of a curved edge: 11 facets on a circle."""


@dataclass(frozen=True)
class Curve:
    """A curved edge, with the body on the left.

    Attributes:
        vertices: (n + 1, 2) vertices in order; of a closed edge the last one is the first.
        position: (n + 1,) arc length from the middle, of a closed edge from its lowest vertex.
        angle: (n + 1,) direction of the tangent t at the vertices, by the circle through three.
        closed: whether the edge is a closed one.
    """

    vertices: Array
    position: Array
    angle: Array
    closed: bool

    @property
    def length(self) -> float:
        """Length of the edge."""
        return float(self.position[-1] - self.position[0])

    @property
    def sag(self) -> float:
        """Largest distance of the curve from its chords."""
        return float((np.diff(self.position) * np.abs(np.diff(self.angle))).max() / 8.0)

    def along(self, points: Array) -> Array:
        """Return the positions of points (n, 2) along the edge."""
        facet, s, _ = nearest_facet(points, self.vertices[:-1], self.vertices[1:])
        found = self.position[facet] + s * np.diff(self.position)[facet]
        if self.closed:
            # from -length / 2, not included to round-off, to length / 2
            half = (0.5 + 1e-9) * self.length
            found = half - np.mod(half - found, self.length)
        return np.asarray(found)

    def inward(self, points: Array) -> Array:
        """Return the inward normals (n, 2) at points of the edge."""
        facet, s, _ = nearest_facet(points, self.vertices[:-1], self.vertices[1:])
        angle = self.angle[facet] + s * np.diff(self.angle)[facet]
        return np.column_stack([-np.sin(angle), np.cos(angle)])


def nearest_facet(points: Array, a: Array, b: Array) -> tuple[Ints, Array, Array]:
    """Return the nearest facet of each point, from a to b, the place on it, and the distance.

    Places are 0 at a and 1 at b.
    """
    step = b - a
    s = np.einsum("pfc,fc->pf", points[:, None] - a, step) / (step**2).sum(axis=1)
    s = np.clip(s, 0.0, 1.0)
    apart = np.linalg.norm(points[:, None] - a - s[..., None] * step, axis=2)
    facet, rows = np.argmin(apart, axis=1), np.arange(len(points))
    return facet, s[rows, facet], apart[rows, facet]


def curve_of(mesh: RawMesh, edge: str, where: str) -> Line | Curve:
    """Return the line of a straight edge, the curve of another one; both are in one piece."""
    try:
        return line_of(mesh, edge, where)
    except NotStraight:
        pass
    facets = mesh.facets(edge, where)
    a, b = np.moveaxis(mesh.points[facets], 1, 0)
    inside = mesh.points[mesh.cells[cells_behind(mesh, facets)[1]]].mean(axis=1) - a
    left = (b - a)[:, 0] * inside[:, 1] - (b - a)[:, 1] * inside[:, 0] > 0.0
    facets = np.where(left[:, None], facets, facets[:, ::-1])
    following = dict(facets.tolist())
    if len(following) < len(facets) or len(set(following.values())) < len(facets):
        raise InputError(f"{where}: '{edge}' branches; give each branch a group of its own")
    starts = sorted(set(following) - set(following.values()))
    closed = not starts
    if closed:
        starts = [min(following, key=lambda k: (mesh.points[k, 1], mesh.points[k, 0]))]
    chain = [starts[0]]
    while chain[-1] in following and (len(chain) == 1 or chain[-1] != chain[0]):
        chain.append(following[chain[-1]])
    if len(chain) < len(facets) + 1:
        x, y = mesh.points[chain[-1]]
        raise InputError(
            f"{where}: '{edge}' is in pieces, one ends at ({x:g}, {y:g}); give each piece a group "
            "and a table of its own"
        )
    vertices = mesh.points[chain]
    step = np.diff(vertices, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    chord = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    if closed:
        # the first facet once more after the last one, and the last one before the first
        turn = 2.0 * np.pi * np.sign(chord[-1] - chord[0])
        chord = np.concatenate([[chord[-1] - turn], chord, [chord[0] + turn]])
        length = np.concatenate([length[-1:], length, length[:1]])
    turns = np.diff(chord)
    if np.abs(turns).max() > SHARPEST_TURN:
        k = int(np.argmax(np.abs(turns)))
        x, y = vertices[k if closed else k + 1]
        raise InputError(
            f"{where}: '{edge}' turns by {np.degrees(abs(turns[k])):.0f} degrees at ({x:g}, "
            f"{y:g}); make it a group on either side of a corner, or refine the curve"
        )
    angle = chord[:-1] + turns * length[:-1] / (length[:-1] + length[1:])
    if closed:
        length = length[1:-1]
    else:
        first = chord[0] - turns[0] * length[0] / (length[0] + length[1])
        last = chord[-1] + turns[-1] * length[-1] / (length[-1] + length[-2])
        angle = np.concatenate([[first], angle, [last]])
    position = np.concatenate([[0.0], np.cumsum(length)])
    return Curve(vertices, position if closed else position - 0.5 * position[-1], angle, closed)
