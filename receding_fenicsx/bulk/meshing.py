"""Meshes of the body: gmsh fills a .geo file's half body, which is snapped, mirrored and distributed.

Meshing happens in edge coordinates (s, d): s along the contact edge from its middle, d the depth below it, both
in units of the body's depth. A scene whose lengths are multiplied by a power of two has the same mesh to the bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI
from numpy.typing import NDArray

from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.errors import InputError, SolveError, on_root
from receding_fenicsx.scene import Scene, edge_points

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

POSITION_TOLERANCE = 1e-9
"""Distance over the body's depth below which two points are the same."""
COUNT_LIMIT = 20
"""A fitting number of contact elements is looked for up to this multiple of the one asked for."""

GROUPS = {"bottom": 1, "right": 2, "top": 3, "left": 4, "axis": 5}
"""Facet tags; "axis" is x = 0 in a half body."""
EDGES_AROUND = {
    "bottom": {"bottom": "bottom", "right": "right", "top": "top", "left": "left", "axis": "axis"},
    "top": {"bottom": "top", "right": "right", "top": "bottom", "left": "left", "axis": "axis"},
    "left": {"bottom": "left", "right": "top", "top": "right", "left": "bottom"},
    "right": {"bottom": "right", "right": "top", "top": "left", "left": "bottom"},
}
"""Name in the body of each edge of the .geo file, by contact edge."""


@dataclass(frozen=True)
class BodyMesh:
    """A distributed mesh of the body with named edges.

    Attributes:
        mesh: DOLFINx mesh.
        cell_tags: tags of cells, all 1 for a rectangle.
        facet_tags: tags of boundary facets, values as in ``groups``.
        groups: tag of each edge by name.
        centre: (2,) point from which positions along edges are measured.
        size: length that tolerances on positions are relative to.
        half: True when only x >= 0 is meshed.
        cell: "triangle" or "quadrilateral".
    """

    mesh: dmesh.Mesh
    cell_tags: Any
    facet_tags: Any
    groups: dict[str, int]
    centre: Array
    size: float
    half: bool
    cell: str


@dataclass(frozen=True)
class _Frame:
    """Edge coordinates (s, d) of a rectangle: contact edge, its length and the depth below it."""

    edge: str
    length: float
    depth: float

    def to_body(self, s: Array, d: Array) -> Array:
        """Return (n, 2) body coordinates."""
        if self.edge == "bottom":
            return np.column_stack([s, d])
        if self.edge == "top":
            return np.column_stack([s, self.depth - d])
        x = 0.5 * self.depth - d
        return np.column_stack([x if self.edge == "right" else -x, s + 0.5 * self.length])

    def from_body(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return s and d of points of the body."""
        if self.edge in ("bottom", "top"):
            return x, y if self.edge == "bottom" else self.depth - y
        return y - 0.5 * self.length, 0.5 * self.depth - (x if self.edge == "right" else -x)


@dataclass(frozen=True)
class _Marks:
    """Where the half body needs vertices besides its corners, in units of length, sorted, s >= 0."""

    top: Array
    side: Array
    inner: Array


def make_mesh(comm: MPI.Comm, scene: Scene, half: bool) -> BodyMesh:
    """Mesh the scene's body, graded from its contact edge.

    Args:
        comm: communicator that gets the mesh.
        scene: the scene.
        half: mesh only x >= 0.

    Returns:
        The distributed mesh; bitwise mirror-symmetric when the whole body is meshed.

    Raises:
        InputError: the number of contact elements puts no vertex where the scene needs one, or the scene
            asks for a body that cannot be meshed here.
    """
    cell = scene.mesh.cell
    made = on_root(comm, lambda: _make_on_root(scene, half))
    if made is None:
        corners = {"triangle": 3, "quadrilateral": 4}[cell]
        points, cells = np.empty((0, 2)), np.empty((0, corners), dtype=np.int64)
        facets, values = np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int32)
    else:
        points, cells, facets, values = made
    mesh = _dolfinx.create_mesh(comm, cell, cells, points)
    cell_tags = _dolfinx.tag_entities(mesh, 2, cells, np.ones(len(cells), dtype=np.int32))
    facet_tags = _dolfinx.tag_entities(mesh, 1, facets, values)
    groups = {name: tag for name, tag in GROUPS.items() if name != ("left" if half else "axis")}
    centre = np.array([0.0, 0.5 * scene.body.height])
    size = max(scene.body.width, scene.body.height)
    return BodyMesh(mesh, cell_tags, facet_tags, groups, centre, size, half, cell)


def geo_path(name: str) -> Path:
    """Return the path of a .geo file of the package (or of the repository it runs from).

    Raises:
        InputError: there is no such file.
    """
    folder = resources.files("receding_fenicsx")
    for path in (Path(str(folder / "meshes" / name)), Path(str(folder)).parent / "meshes" / name):
        if path.is_file():
            return path
    raise InputError(f"the geometry '{name}' was not found beside the package; reinstall it")


def _make_on_root(scene: Scene, half: bool) -> tuple[Array, Ints, Ints, NDArray[np.int32]]:
    """Return points, cells, facets and facet tags of the body; no communication."""
    frame = _frame(scene, half)
    marks = _marks(scene, frame)
    canonical = _gmsh_half(scene, frame, marks)
    s, d, cells, edges = _snap(scene, frame, marks, *canonical)
    if not half:
        s, d, cells, edges = _mirror(s, d, cells, edges)
    points = frame.to_body(s, d)
    names = EDGES_AROUND[frame.edge]
    kept = {names[edge]: facets for edge, facets in edges.items() if half or edge != "axis"}
    facets = np.vstack(list(kept.values()))
    values = np.concatenate([np.full(len(f), GROUPS[edge], dtype=np.int32) for edge, f in kept.items()])
    return points, cells, facets, values


def _frame(scene: Scene, half: bool) -> _Frame:
    """Check what can be meshed and return the edge coordinates."""
    if scene.body.mesh is not None or scene.body.shape != "rectangle":
        raise InputError('body: only shape = "rectangle" can be meshed; remove body.mesh')
    if len(scene.contacts) != 1:
        raise InputError(f"contact: {len(scene.contacts)} contact edges given, exactly one can be modelled")
    if scene.mesh.cell not in ("triangle", "quadrilateral"):
        raise InputError(f"mesh.cell = '{scene.mesh.cell}' is unknown; use \"triangle\" or \"quadrilateral\"")
    n = scene.mesh.contact_elements
    if n < 2 or n % 2:
        raise InputError(f"mesh.contact_elements = {n} must be even, so that a node lies in the middle; use {n + 1}")
    if not scene.mesh.growth >= 1.0:
        raise InputError(f"mesh.growth = {scene.mesh.growth:g} must not be less than 1 (1 = uniform)")
    edge = scene.contacts[0].edge
    if edge not in EDGES_AROUND:
        raise InputError(f"contact.edge = '{edge}' is no edge of a rectangle; use one of {', '.join(EDGES_AROUND)}")
    if edge in ("bottom", "top"):
        return _Frame(edge, scene.body.width, scene.body.height)
    if half:
        raise InputError(f"contact.edge = '{edge}' leaves no half to model about x = 0; set solver.symmetry = \"none\"")
    return _Frame(edge, scene.body.height, scene.body.width)


def _marks(scene: Scene, frame: _Frame) -> _Marks:
    """Collect where loads, contact and supports need vertices, mirrored to s >= 0."""
    wanted: list[tuple[str, float, float]] = []
    spans = [("contact.span", c.edge, c.span) for c in scene.contacts]
    spans += [(f"load.{load.name}.span", load.edge, load.span) for load in scene.loads]
    for key, edge, span in spans:
        if span is not None:
            x, y = edge_points(scene, edge, np.array(span))
            wanted += [(key, float(x[i]), float(y[i])) for i in range(2)]
    wanted += [("support.point", *s.point) for s in scene.supports if s.point is not None]

    near = POSITION_TOLERANCE * frame.depth
    dx = frame.length / scene.mesh.contact_elements
    columns = scene.mesh.cell == "quadrilateral"
    top, side, inner = [], [], []
    for key, x, y in wanted:
        s, d = (float(c) for c in frame.from_body(np.float64(x), np.float64(y)))
        s = abs(s)
        if s > 0.5 * frame.length + near or d < -near or d > frame.depth + near:
            raise InputError(f"{key}: the point ({x:g}, {y:g}) lies outside the body")
        on_bottom, on_top, on_side = d <= near, d >= frame.depth - near, s >= 0.5 * frame.length - near
        if (on_bottom or (columns and not on_side)) and abs(s / dx - round(s / dx)) * dx > near:
            raise InputError(_misfit(scene, frame, key, s))
        if on_side and not (on_bottom or on_top):
            side.append(d)
        elif on_top and not on_side and s > near:
            top.append(s)
        elif not (on_bottom or on_top or on_side):
            if columns:
                side.append(d)
            else:
                inner.append((s, d))
    return _Marks(_merge(top, near), _merge(side, near), np.array(sorted(set(inner))).reshape(-1, 2))


def _misfit(scene: Scene, frame: _Frame, key: str, s: float) -> str:
    """Return the message for a position that no vertex of the contact edge or column meets."""
    n = scene.mesh.contact_elements
    text = f"mesh.contact_elements = {n} puts no node at {s:g} from the middle, where {key} needs one"
    for m in range(n, COUNT_LIMIT * n, 2):
        position = s / frame.length * m
        if abs(position - round(position)) * frame.length / m <= POSITION_TOLERANCE * frame.depth:
            return f"{text}; use {m}"
    return f"{text}; move it to a multiple of {frame.length / n:g}"


def _merge(values: list[float], near: float) -> Array:
    """Return values sorted, those nearer than ``near`` to the one before left out."""
    ordered = np.sort(np.array(values, dtype=float))
    return ordered[np.diff(ordered, prepend=-np.inf) > near]


@contextmanager
def _gmsh_model() -> Iterator[Any]:
    """Give the gmsh module with an empty model of its own, silent, raising on errors."""
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.model.add("receding_fenicsx")
    gmsh.parser.clear()
    try:
        yield gmsh
    finally:
        gmsh.parser.clear()
        gmsh.model.remove()
        if ours:
            gmsh.finalize()


def _gmsh_half(scene: Scene, frame: _Frame, marks: _Marks) -> tuple[Array, Ints, dict[str, Ints]]:
    """Mesh the half body in units of its depth: points, cells and the facets of each edge."""
    numbers: dict[str, Any] = {
        "width": [frame.length / frame.depth],
        "height": [1.0],
        "contact_elements": [float(scene.mesh.contact_elements)],
        "growth": [float(scene.mesh.growth)],
        "quadrilaterals": [float(scene.mesh.cell == "quadrilateral")],
        "top_marks": (marks.top / frame.depth).tolist(),
        "side_marks": (marks.side / frame.depth).tolist(),
        "inner_x": (marks.inner[:, 0] / frame.depth).tolist(),
        "inner_y": (marks.inner[:, 1] / frame.depth).tolist(),
    }
    with _gmsh_model() as gmsh:
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, value)
        try:
            gmsh.merge(str(geo_path("rectangle.geo")))
            gmsh.model.mesh.generate(2)
        except InputError:
            raise
        except Exception as caught:
            raise SolveError(f"gmsh could not mesh the body: {caught}; change mesh.growth or contact_elements") from caught
        model = gmsh.model
        corners = {"triangle": 3, "quadrilateral": 4}[scene.mesh.cell]
        kind = {"triangle": 2, "quadrilateral": 3}[scene.mesh.cell]
        types, _, nodes = model.mesh.getElements(2)
        if list(types) != [kind]:
            raise SolveError(f"gmsh did not fill the body with {scene.mesh.cell}s only; change mesh.contact_elements")
        tags, coordinates, _ = model.mesh.getNodes()
        number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
        # only nodes that a cell uses: gmsh may keep others
        used = np.isin(tags, nodes[0])
        number[tags[used]] = np.arange(int(used.sum()))
        points = coordinates.reshape(-1, 3)[used, :2]
        cells = number[nodes[0].astype(np.int64)].reshape(-1, corners)
        edges = {}
        for dim, tag in model.getPhysicalGroups(1):
            lines = [model.mesh.getElements(1, line)[2][0] for line in model.getEntitiesForPhysicalGroup(dim, tag)]
            edges[model.getPhysicalName(dim, tag)] = number[np.concatenate(lines).astype(np.int64)].reshape(-1, 2)
    return points, cells, edges


def _snap(
    scene: Scene, frame: _Frame, marks: _Marks, points: Array, cells: Ints, edges: dict[str, Ints]
) -> tuple[Array, Array, Ints, dict[str, Ints]]:
    """Scale to lengths and put the nodes of the boundary, and those at marks, exactly where they belong."""
    n = scene.mesh.contact_elements
    s, d = points[:, 0] * frame.depth, points[:, 1] * frame.depth
    dx = frame.length / n
    on = {edge: np.unique(facets) for edge, facets in edges.items()}
    if scene.mesh.cell == "quadrilateral":
        s = frame.length * np.round(s / dx) / n
        levels = d[on["axis"]]
        d = levels[np.argmin(np.abs(d[:, None] - levels[None, :]), axis=1)]
    columns = np.round(s[on["bottom"]] / dx)
    if not np.array_equal(np.sort(columns), np.arange(n // 2 + 1)):
        raise SolveError("gmsh did not space the nodes of the contact edge equally")
    s[on["bottom"]] = frame.length * columns / n
    d[on["bottom"]] = 0.0
    s[on["axis"]] = 0.0
    d[on["top"]] = frame.depth
    s[on["right"]] = 0.5 * frame.length
    for mark in marks.top:
        s[_nearest(frame, s - mark, d - frame.depth)] = mark
    for mark in marks.side:
        row = np.abs(d - mark) <= POSITION_TOLERANCE * frame.depth
        d[row if scene.mesh.cell == "quadrilateral" else _nearest(frame, s - 0.5 * frame.length, d - mark)] = mark
    for mark in marks.inner:
        node = _nearest(frame, s - mark[0], d - mark[1])
        s[node], d[node] = mark
    return s, d, cells, edges


def _nearest(frame: _Frame, ds: Array, dd: Array) -> int:
    """Return the node nearest to a mark, which must be there already but for round-off."""
    distance = np.hypot(ds, dd)
    node = int(np.argmin(distance))
    if distance[node] > POSITION_TOLERANCE * frame.depth:
        raise SolveError(f"gmsh put no vertex where one is needed (nearest at a distance of {distance[node]:g})")
    return node


def _mirror(
    s: Array, d: Array, cells: Ints, edges: dict[str, Ints]
) -> tuple[Array, Array, Ints, dict[str, Ints]]:
    """Add the mirror image about s = 0; the points on the axis are shared."""
    off = np.flatnonzero(s > 0.0)
    image = np.arange(len(s))
    image[off] = len(s) + np.arange(len(off))
    whole = {edge: np.vstack([edges[edge], image[edges[edge]]]) for edge in ("bottom", "top")}
    whole["right"], whole["left"] = edges["right"], image[edges["right"]]
    # the image of a cell runs the other way round
    return (
        np.concatenate([s, -s[off]]),
        np.concatenate([d, d[off]]),
        np.vstack([cells, image[cells][:, ::-1]]),
        whole,
    )
