"""Mesh on rank 0 before distribution: points, cells, named edges; edges as lines and curves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import legendre

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.checks import suggestion

STRAIGHT_TOLERANCE = 1e-6
"""Largest distance of a node from the line of its straight edge, over the edge's length."""


@dataclass(frozen=True)
class Arcs:
    """The true curves of the facets on curved edges of a .geo file, for the resultants of loads.

    Cells have straight sides. A load integrated on chords has a resultant that is off by the square
    of the facets' length; where gmsh knows the curve it is kept at the Gauss points of each facet.
    """

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


@dataclass(frozen=True)
class RawMesh:
    """A mesh of straight-sided cells of one kind."""

    points: Array  # (n, 2) coordinates
    cells: Ints  # (m, 3 or 4) points around each cell, counter-clockwise
    edges: dict[str, Ints]  # (k, 2) points of the facets of each edge, by name
    spots: dict[str, Ints] = field(default_factory=dict)  # points of each named group of points
    # (2,) middle of each edge of the whole body, where it is not that of the facets
    middles: dict[str, Array] = field(default_factory=dict)
    # positions along edges grow rightwards or upwards, as for a rectangle; else with the body on
    # the left, independent of the orientation of the scene
    upright: bool = False
    arcs: Arcs | None = None  # the true curves of the facets on curved edges, where they are known
    # name of the physical surface of each cell; empty where there are none
    surfaces: tuple[str, ...] = ()

    @property
    def cell(self) -> str:
        """Return the kind of the cells."""
        return "triangle" if self.cells.shape[1] == 3 else "quadrilateral"

    @property
    def size(self) -> float:
        """Return the larger side of the box around the mesh."""
        return float(np.ptp(self.points, axis=0).max())

    @cached_property
    def sides(self) -> tuple[Ints, Ints]:
        """Sides of all cells: a number made of the points of each, in order, and its cell."""
        pairs, owner = sides(self.cells)
        keys = pairs[:, 0] * len(self.points) + pairs[:, 1]
        order = np.argsort(keys, kind="stable")
        return keys[order], owner[order]

    def facets(self, edge: str, where: str) -> Ints:
        """Return the facets of an edge that the mesh has to have; ``where`` begins the message."""
        if edge not in self.edges:
            declare = f'declare Physical Curve("{edge}")'
            hint = suggestion(edge, sorted(self.edges)) if self.edges else declare
            raise InputError(f"{where}: the mesh has no group of curves '{edge}'; {hint}")
        return self.edges[edge]


def with_radii(mesh: RawMesh) -> RawMesh:
    """Return the mesh of a body of revolution: positions are radii, or distances from the axis."""
    middles, near = {}, STRAIGHT_TOLERANCE * mesh.size
    for edge, facets in mesh.edges.items():
        points = mesh.points[np.unique(facets)]
        on_axis = points[points[:, 0] <= near]
        if len(points) and np.ptp(points[:, 1]) <= near:
            middles[edge] = np.array([0.0, points[0, 1]])
        elif len(on_axis) == 1:
            middles[edge] = on_axis[0]
    return replace(mesh, middles=middles, upright=True)


@dataclass(frozen=True)
class Line:
    """The straight line that an edge lies on."""

    middle: Array  # (2,) middle of the edge, from which positions along it are measured
    direction: Array  # (2,) unit vector along which positions grow
    outward: Array  # (2,) unit outward normal
    length: float  # of the edge
    sag: ClassVar[float] = 0.0

    def along(self, points: Array) -> Array:
        """Return the positions of points (n, 2) along the edge."""
        return (points - self.middle) @ self.direction

    def inward(self, points: Array) -> Array:
        """Return the inward normal (n, 2) at points."""
        return np.tile(0.0 - self.outward, (len(points), 1))


def sides(cells: Ints) -> tuple[Ints, Ints]:
    """Return the sides of all cells (n, 2), the smaller point first, and the cell of each."""
    pairs = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    return np.sort(pairs, axis=1), np.repeat(np.arange(len(cells)), cells.shape[1])


def cells_behind(mesh: RawMesh, facets: Ints) -> tuple[Ints, Ints]:
    """Return how many cells have each facet as a side, and one of them (-1 where there is none)."""
    keys, owner = mesh.sides
    ordered = np.sort(facets, axis=1)
    wanted = ordered[:, 0] * len(mesh.points) + ordered[:, 1]
    first = np.searchsorted(keys, wanted, side="left")
    count = np.searchsorted(keys, wanted, side="right") - first
    found = owner[np.minimum(first, len(owner) - 1)]
    return count, np.where(count > 0, found, -1)


@dataclass(frozen=True)
class Curve:
    """A curved edge, with the body on the left."""

    vertices: Array  # (n + 1, 2) vertices in order; of a closed edge the last one is the first
    position: Array  # (n + 1,) arc length from the middle, of a closed edge from its lowest vertex
    angle: Array  # (n + 1,) direction of the tangent t at the vertices, by the circle through three
    closed: bool  # whether the edge is a closed one

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


Along = Line | Curve
"""A straight or curved edge."""


def nearest_facet(points: Array, a: Array, b: Array) -> tuple[Ints, Array, Array]:
    """Return the nearest facet of each point, the place on it (0 at a, 1 at b), the distance."""
    step = b - a
    s = np.einsum("pfc,fc->pf", points[:, None] - a, step) / (step**2).sum(axis=1)
    s = np.clip(s, 0.0, 1.0)
    apart = np.linalg.norm(points[:, None] - a - s[..., None] * step, axis=2)
    facet, rows = np.argmin(apart, axis=1), np.arange(len(points))
    return facet, s[rows, facet], apart[rows, facet]


def line_of(mesh: RawMesh, edge: str, where: str) -> Line:
    """Return the line of a straight edge in one piece."""
    line = curve_of(mesh, edge, where)
    if not isinstance(line, Line):
        raise InputError(
            f"{where}: '{edge}' is not straight; split it into straight groups, each with a table "
            "of its own"
        )
    return line


def curve_of(mesh: RawMesh, edge: str, where: str) -> Line | Curve:
    """Return the line of a straight edge, the curve of another one; both are in one piece."""
    facets = mesh.facets(edge, where)
    a, b = np.moveaxis(mesh.points[facets], 1, 0)
    inside = mesh.points[mesh.cells[cells_behind(mesh, facets)[1]]].mean(axis=1) - a
    left = (b - a)[:, 0] * inside[:, 1] - (b - a)[:, 1] * inside[:, 0] > 0.0
    facets = np.where(left[:, None], facets, facets[:, ::-1])
    following = dict(facets.tolist())
    if len(set(following.values())) < len(facets):
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
    return _straight(mesh, edge, vertices) or _curved(vertices, closed, f"{where}: '{edge}'")


def _straight(mesh: RawMesh, edge: str, vertices: Array) -> Line | None:
    """Return the line through the vertices of an edge, which has the body on the left, if any."""
    first, last = vertices[[0, -1]]
    length = float(np.hypot(*(last - first)))
    direction = (last - first) / (length or 1.0)
    outward = np.array([direction[1], -direction[0]])
    off = np.abs((vertices - first) @ outward).max()
    if off > STRAIGHT_TOLERANCE * length or np.diff(vertices @ direction).min() <= 0.0:
        return None
    middle = mesh.middles.get(edge, 0.5 * (first + last))
    if mesh.upright:
        # the larger component is positive
        direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
        offset = float((0.5 * (first + last) - middle) @ direction)
        if abs(abs(offset) - 0.5 * length) <= STRAIGHT_TOLERANCE * length:
            # measured from one of its ends, away from that
            direction = direction * np.sign(offset)
    return Line(middle, direction + 0.0, outward + 0.0, length)


def _curved(vertices: Array, closed: bool, where: str) -> Curve:
    """Return the curve through the vertices of an edge, which has the body on the left."""
    step = np.diff(vertices, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    chord = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    if closed:
        # the first facet once more after the last one, and the last one before the first
        turn = 2.0 * np.pi * np.sign(chord[-1] - chord[0])
        chord = np.concatenate([[chord[-1] - turn], chord, [chord[0] + turn]])
        length = np.concatenate([length[-1:], length, length[:1]])
    turns = np.diff(chord)
    # 11 facets on a circle at least
    if np.abs(turns).max() > 0.6:
        k = int(np.argmax(np.abs(turns)))
        x, y = vertices[k if closed else k + 1]
        raise MeshMisfit(
            f"{where} turns by {np.degrees(abs(turns[k])):.0f} degrees at ({x:g}, "
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
