"""Meshes of the body: gmsh fills the half in a .geo file, which is snapped, mirrored, distributed.

gmsh sees lengths in units of the body's depth below the contact edge, so that a scene whose lengths
are multiplied by a power of two has the same mesh to the bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh as dmesh
from numpy.typing import NDArray

from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.rectangle import (
    EDGE_NAMES,
    Frame,
    HalfMesh,
    Marks,
    find_marks,
    make_frame,
    mirror,
    snap,
)
from receding_fenicsx.errors import InputError, SolveError, on_root
from receding_fenicsx.scene import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GROUPS = {"bottom": 1, "right": 2, "top": 3, "left": 4, "axis": 5}
"""Facet tags; "axis" is x = 0 in a half body."""
CORNERS = {"triangle": 3, "quadrilateral": 4}
GMSH_TYPES = {"triangle": 2, "quadrilateral": 3}


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


def make_mesh(comm: MPI.Comm, scene: Scene, half: bool) -> BodyMesh:
    """Mesh the scene's body, graded from its contact edge.

    Args:
        comm: communicator that gets the mesh.
        scene: the scene.
        half: mesh only x >= 0.

    Returns:
        The distributed mesh; bitwise mirror-symmetric when the whole body is meshed.

    Raises:
        InputError: the number of contact elements puts no vertex where the scene needs one, or the
            body cannot be meshed; on all ranks.
    """
    cell = scene.mesh.cell
    made = on_root(comm, lambda: _make_on_root(scene, half))
    if made is None:
        points, cells = np.empty((0, 2)), np.empty((0, CORNERS[cell]), dtype=np.int64)
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
    """Return the path of a .geo file of the installed package, or of the repository.

    Raises:
        InputError: there is no such file.
    """
    package = Path(str(resources.files("receding_fenicsx")))
    for path in (package / "meshes" / name, package.parent / "meshes" / name):
        if path.is_file():
            return path
    raise InputError(f"the geometry '{name}' is missing from the package; install it again")


def _make_on_root(scene: Scene, half: bool) -> tuple[Array, Ints, Ints, NDArray[np.int32]]:
    """Return points, cells, facets and facet tags of the body; no communication."""
    frame = make_frame(scene, half)
    marks = find_marks(scene, frame)
    mesh = _gmsh_half(scene, frame, marks)
    snap(scene, frame, marks, mesh)
    if not half:
        mesh = mirror(mesh)
    names = EDGE_NAMES[frame.edge]
    facets = np.vstack(list(mesh.edges.values()))
    tags = [np.full(len(e), GROUPS[names[name]], dtype=np.int32) for name, e in mesh.edges.items()]
    return frame.to_body(mesh.s, mesh.d), mesh.cells, facets, np.concatenate(tags)


@contextmanager
def _gmsh_model() -> Iterator[Any]:
    """Give the gmsh module with an empty model of its own, silent and on one thread."""
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


def _gmsh_half(scene: Scene, frame: Frame, marks: Marks) -> HalfMesh:
    """Mesh the half body."""
    cell = scene.mesh.cell
    unit = frame.depth
    numbers = {
        "width": [frame.length / unit],
        "height": [1.0],
        "contact_elements": [float(scene.mesh.contact_elements)],
        "growth": [float(scene.mesh.growth)],
        "quadrilaterals": [float(cell == "quadrilateral")],
        "top_marks": (marks.top / unit).tolist(),
        "side_marks": (marks.side / unit).tolist(),
        "inner_x": (marks.inner[:, 0] / unit).tolist(),
        "inner_y": (marks.inner[:, 1] / unit).tolist(),
    }
    path = str(geo_path("rectangle.geo"))
    with _gmsh_model() as gmsh:
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, value)
        try:
            gmsh.merge(path)
            gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            raise SolveError(
                f"gmsh could not mesh the body: {caught}; change mesh.growth or contact_elements"
            ) from caught
        mesh = gmsh.model.mesh
        types, _, corners = mesh.getElements(2)
        if list(types) != [GMSH_TYPES[cell]]:
            raise SolveError(f"gmsh did not fill the body with {cell}s; change contact_elements")
        around = corners[0].astype(np.int64)
        tags, coordinates, _ = mesh.getNodes()
        # gmsh may keep nodes that no cell uses
        used = np.isin(tags, around)
        points = coordinates.reshape(-1, 3)[used] * unit
        number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
        number[tags[used].astype(np.int64)] = np.arange(len(points))
        edges = {}
        for dim, tag in gmsh.model.getPhysicalGroups(1):
            curves = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
            ends = np.concatenate([mesh.getElements(1, curve)[2][0] for curve in curves])
            name = gmsh.model.getPhysicalName(dim, tag)
            edges[name] = number[ends.astype(np.int64)].reshape(-1, 2)
    cells = number[around].reshape(-1, CORNERS[cell])
    return HalfMesh(points[:, 0].copy(), points[:, 1].copy(), cells, edges)
