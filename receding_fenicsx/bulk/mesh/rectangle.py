"""Mesh of a rectangle: required vertices, exact node positions, mirror image.

Edge coordinates (s, d): s runs along the contact edge from its middle, d is the depth below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.mesh.grading import Base, grade_half, graded
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh
from receding_fenicsx.bulk.mesh.user_mesh import gmsh_model, mesh_of
from receding_fenicsx.errors import InputError, MeshMisfit, SolveError
from receding_fenicsx.scene.model import Body, Refinement, Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.symmetry import (
    EDGES,
    edge_points,
    edge_range,
    is_cylinder,
    is_horizontal,
)

OPPOSITE = {"bottom": "top", "top": "bottom", "left": "right", "right": "left"}
"""The edge opposite to each edge of a rectangle."""

POSITION_TOLERANCE = 1e-9
"""Largest distance of coinciding points, over the body's depth below the contact edge."""


@dataclass(frozen=True)
class Frame:
    """Edge coordinates of a rectangle."""

    scene: Scene  # that of the rectangle alone
    # edge, length: contact edge and its length
    edge: str
    length: float
    depth: float  # depth of the rectangle below it
    both: bool  # whether the opposite edge is a contact edge with the same vertices
    middle: Array  # (2,) middle of the contact edge, from the position of the body
    axes: Array  # (2, 2) unit vectors along s and d

    @property
    def near(self) -> float:
        """Distance of coinciding points."""
        return POSITION_TOLERANCE * self.depth

    def to_body(self, s: Array, d: Array) -> Array:
        """Return (n, 2) coordinates."""
        return np.stack([s, d], 1) @ self.axes + self.middle + np.array(self.scene.body.position)

    def from_body(self, points: Array) -> Array:
        """Return s and d (n, 2) of points (n, 2)."""
        return (points - np.array(self.scene.body.position) - self.middle) @ self.axes.T

    def on_edge(self, edge: str, positions: Sequence[float]) -> Array:
        """Return s and d (n, 2) of positions along an edge."""
        return self.from_body(np.column_stack(edge_points(self.scene, edge, np.array(positions))))


@dataclass(frozen=True)
class Marks:
    """Positions on the half s >= 0, besides its corners, that need a vertex."""

    contact: Array  # (n,) s of all vertices on the contact edge from 0 to its end
    top: Array  # (n,) s on the edge opposite the contact, increasing
    side: Array  # (n,) d on the sides (for columns of quadrilaterals: levels), increasing
    inner: Array  # (n, 2) points (s, d) inside
    # (n, 2) points (s, d) off the contact edge where loads and supports end, corners too. The mesh
    # is as fine there as on the contact edge, because stresses jump there
    ends: Array


def rectangle_mesh(whole: Scene, body: Body, half: bool) -> RawMesh:
    """Mesh a rectangle of a scene; no communication.

    gmsh sees lengths in units of the depth below the contact edge, without their round-off, so that
    a scene has the same mesh in any unit of length, to the bit in units of powers of two.
    """
    scene = part_of(whole, body)
    if scene.axisymmetric:
        half = is_cylinder(scene, body)
        if half and not is_horizontal(scene, scene.contacts[0].edge):
            # the section of a cylinder is meshed from its outer edge like that of a ring
            section = (0.25 * body.width, body.position[1])
            scene = replace(scene, body=replace(body, width=0.5 * body.width, position=section))
            half = False
    edge, size = scene.contacts[0].edge, np.array([scene.body.width, scene.body.height])
    inward = {"bottom": (0.0, 1.0), "top": (0.0, -1.0), "left": (1.0, 0.0), "right": (-1.0, 0.0)}
    axes = np.array([np.abs(inward[edge])[::-1], inward[edge]])
    both = bool(whole.others) and OPPOSITE[edge] in [contact.edge for contact in scene.contacts]
    (length, depth), middle = np.abs(axes) @ size, 0.5 * size * ([0.0, 1.0] - axes[1])
    frame = Frame(scene, edge, float(length), float(depth), both, middle, axes)
    marks = find_marks(frame)
    mesh = _gmsh_half(frame, marks)
    snap(frame, marks, mesh)
    if not half:
        mesh = mirror(mesh)
    # names on the body of the edges of rectangle.geo, whose contact edge is "bottom"
    names = {"bottom": frame.edge, "top": OPPOSITE[frame.edge]}
    if frame.edge in ("left", "right"):
        names |= {"left": "bottom", "right": "top"}
    edges = {names.get(name, name): facets for name, facets in mesh.edges.items()}
    if half:
        edges["left"] = np.empty((0, 2), dtype=np.int64)
    middles = {edge: np.hstack(edge_points(scene, edge, [0.0])) for edge in EDGES}
    return RawMesh(frame.to_body(*mesh.points.T), mesh.cells, edges, {}, middles, upright=True)


def _gmsh_half(frame: Frame, marks: Marks) -> RawMesh:
    """Mesh the half body in edge coordinates; edges have their names in the .geo file."""
    options, unit = frame.scene.mesh, frame.depth
    cell = options.cell
    numbers = {
        "width": [frame.length / unit],
        "height": [1.0],
        "contact_elements": [float(options.contact_elements)],
        "growth": [float(options.growth)],
        "quadrilaterals": [float(cell == "quadrilateral")],
        "both_edges": [float(frame.both)],
        "top_marks": (marks.top / unit).tolist(),
        "side_marks": (marks.side / unit).tolist(),
        "inner_x": (marks.inner[:, 0] / unit).tolist(),
        "inner_y": (marks.inner[:, 1] / unit).tolist(),
        "end_x": (marks.ends[:, 0] / unit).tolist(),
        "end_y": (marks.ends[:, 1] / unit).tolist(),
    }
    package = Path(str(resources.files("receding_fenicsx")))
    # of the installed package, or of the repository
    paths = [folder / "meshes" / "rectangle.geo" for folder in (package, package.parent)]
    with gmsh_model() as gmsh:
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, [float(f"{number:.12g}") for number in value])
        try:
            gmsh.merge(str(paths[0] if paths[0].is_file() else paths[1]))
            if options.refine:
                grade_half(gmsh, places_of(frame), marks.contact / unit, unit, frame.both)
            gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            raise SolveError(
                f"gmsh could not mesh the body: {caught}; change mesh.growth or contact_elements"
            ) from caught
        if list(gmsh.model.mesh.getElementTypes(2)) != [2 if cell == "triangle" else 3]:
            raise SolveError(f"gmsh did not fill the body with {cell}s; change contact_elements")
        return mesh_of(gmsh, None, "rectangle.geo", unit)


def find_marks(frame: Frame) -> Marks:
    """Collect where loads, contact and supports need vertices, mirrored to s >= 0."""
    scene, near = frame.scene, frame.near
    wanted: list[tuple[str, Array]] = []
    uses = [("contact.span", c.edge, c.span) for c in scene.contacts]
    uses += [(f"{part.label} span", part.edge, part.span) for part in scene.edge_parts]
    uses += [("support", s.edge, None) for s in scene.supports if s.edge is not None]
    uses += [("opposite", OPPOSITE[frame.edge], None)] if frame.both else []
    ends = {}
    for key, edge, span in uses:
        places = frame.on_edge(edge, span or edge_range(scene, edge))
        wanted += [(key, place) for place in places] if span is not None else []
        for s, d in places.tolist() if key != "contact.span" else ():
            # nothing ends on the axis of a body of revolution
            if d > near and not (is_cylinder(scene, scene.body) and s <= near):
                ends[round(abs(s) / near), round(d / near)] = abs(s), d
    for key, parts in (("support.point", scene.supports), ("spring.point", scene.springs)):
        for part in parts:
            if isinstance(part.point, tuple):
                wanted += [(key, place) for place in frame.from_body(np.array([part.point]))]

    n = scene.mesh.contact_elements
    dx = frame.length / n
    columns = scene.mesh.cell == "quadrilateral"
    stops: list[float] = []
    top, side, inner = [], [], []
    for key, (s, d) in wanted:
        s = abs(s) if abs(s) > near else 0.0
        on_top = d >= frame.depth - near
        on_contact = d <= near or (frame.both and on_top)
        on_side = s >= 0.5 * frame.length - near
        if on_contact and scene.mesh.refine:
            stops.append(s)
            continue
        if (on_contact or (columns and not on_side)) and abs(s - round(s / dx) * dx) > near:
            steps = ((m, frame.length / m) for m in range(n, 20 * n, 2))
            fits = [m for m, step in steps if abs(s - round(s / step) * step) <= near]
            raise MeshMisfit(
                f"mesh.contact_elements = {n} puts no vertex {s:g} from the middle, where {key} "
                f"needs one; {f'use {fits[0]}' if fits else f'move it to a multiple of {dx:g}'}"
            )
        if on_contact or (on_top and (on_side or s == 0.0)):
            continue
        if on_top:
            top.append(s)
        elif on_side or columns:
            side.append(d)
        else:
            inner.append((s, d))
    points = np.array(sorted(set(inner))).reshape(-1, 2)
    half = 0.5 * frame.length
    stations = frame.length * np.arange(n // 2 + 1) / n
    if scene.mesh.refine:
        base = Base(np.array([0.0, half]), np.array([dx]))
        breaks = [Refinement(dx, s, 2.0) for s in stops]
        stations = graded((0.0, half), base, [*places_of(frame), *breaks])

    def apart(values: list[float]) -> Array:
        """Return values in order, without those that coincide with the one before."""
        ordered = np.sort(np.array(values, dtype=float))
        return ordered[np.diff(ordered, prepend=-np.inf) > near]

    return Marks(
        stations, apart(top), apart(side), points, np.array(sorted(ends.values())).reshape(-1, 2)
    )


def places_of(frame: Frame) -> list[Refinement]:
    """Return the refined places on the contact edge, with their mirror images, by s."""
    found = []
    for place in frame.scene.mesh.places:
        assert place.edge is not None
        if place.edge not in (frame.edge, OPPOSITE[frame.edge] if frame.both else None):
            raise InputError(
                "[mesh] refine: of a rectangle only the first contact edge and the opposite one in "
                f"contact can be refined, not '{place.edge}'; name another one by edge"
            )
        low, high = frame.on_edge(place.edge, place.span)[:, 0].tolist()
        found += [replace(place, at=(low, high)), replace(place, at=(-high, -low))]
    return found


def snap(frame: Frame, marks: Marks, mesh: RawMesh) -> None:
    """Move the nodes of the boundary and of the marks to their exact positions, in place."""
    n, near = frame.scene.mesh.contact_elements, frame.near
    s, d = mesh.points.T
    dx = frame.length / n
    on = {edge: np.unique(facets) for edge, facets in mesh.edges.items()}
    quadrilaterals = frame.scene.mesh.cell == "quadrilateral"
    if quadrilaterals:
        s[:] = frame.length * np.round(s / dx) / n
        levels = np.sort(d[on["axis"]])
        d[:] = levels[np.searchsorted(0.5 * (levels[1:] + levels[:-1]), d)]
    between = 0.5 * (marks.contact[1:] + marks.contact[:-1])
    column = np.searchsorted(between, s[on["bottom"]])
    if not np.array_equal(np.sort(column), np.arange(len(marks.contact))):
        raise SolveError("gmsh did not put the nodes of the contact edge where they were wanted")
    s[on["bottom"]] = marks.contact[column]
    d[on["bottom"]] = 0.0
    s[on["axis"]] = 0.0
    d[on["top"]] = frame.depth
    s[on["right"]] = 0.5 * frame.length
    if frame.both:
        s[on["top"]] = marks.contact[np.searchsorted(between, s[on["top"]])]
    if quadrilaterals:
        for mark in marks.side:
            d[np.abs(d - mark) <= near] = mark
    places = [] if quadrilaterals else [(0.5 * frame.length, mark) for mark in marks.side]
    places += [(mark, frame.depth) for mark in marks.top] + marks.inner.tolist()
    for place in places:
        distance = np.hypot(s - place[0], d - place[1])
        node = int(np.argmin(distance))
        if distance[node] > near:
            raise SolveError(f"gmsh put no vertex where one is needed, but {distance[node]:g} away")
        s[node], d[node] = place


def mirror(mesh: RawMesh) -> RawMesh:
    """Return the whole body: the half and its mirror image about s = 0, with the axis shared."""
    off = np.flatnonzero(mesh.points[:, 0] > 0.0)
    image = np.arange(len(mesh.points))
    image[off] = len(mesh.points) + np.arange(len(off))
    edges = {e: np.vstack([mesh.edges[e], image[mesh.edges[e]]]) for e in ("bottom", "top")}
    edges["right"], edges["left"] = mesh.edges["right"], image[mesh.edges["right"]]
    # reverse the images of the cells to keep their orientation
    return RawMesh(
        np.vstack([mesh.points, mesh.points[off] * [-1.0, 1.0]]),
        np.vstack([mesh.cells, image[mesh.cells][:, ::-1]]),
        edges,
    )
