"""gmsh session with an empty model, the mesh in a model, and paths of the .geo files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Ints
from receding_fenicsx.bulk.mesh.curved_edges import arcs_of
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import nearest

CORNERS = {2: 3, 3: 4}
"""Number of corners of triangles and quadrilaterals, by gmsh's element type."""
HIGHER_ORDER = (
    "has cells of higher order; save it with Mesh.ElementOrder = 1 (mesh.degree sets the degree of "
    "the displacement)"
)


@contextmanager
def gmsh_model() -> Iterator[Any]:
    """Yield the gmsh module with an empty model, silent and on one thread."""
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


def geo_path(name: str) -> Path:
    """Return the path of a .geo file of the installed package, or of the repository."""
    package = Path(str(resources.files("receding_fenicsx")))
    for path in (package / "meshes" / name, package.parent / "meshes" / name):
        if path.is_file():
            return path
    raise InputError(f"the geometry '{name}' is missing from the package; install it again")


def mesh_of(gmsh: Any, surface: str | None, where: str, scale: float) -> RawMesh:
    """Return the plane mesh in gmsh's model, with its groups.

    Args:
        gmsh: the module, with a meshed model.
        surface: physical surface of the body; None takes all of them, or all surfaces.
        where: begin of error messages.
        scale: length of gmsh's unit.
    """
    mesh, model = gmsh.model.mesh, gmsh.model
    if len(mesh.getElementTypes(3)):
        raise InputError(f"{where}: is a mesh of a solid; give the mesh of a plane body")
    around, surfaces = _cells(gmsh, surface, where)
    tags, coordinates, _ = mesh.getNodes()
    coordinates = coordinates.reshape(-1, 3)
    # nodes that no cell uses are left out
    used = np.isin(tags, around)
    points = scale * coordinates[used]
    # products of larger coordinates overflow
    wrong = ~np.all(np.abs(points) < 1e50, axis=1)
    if np.any(wrong):
        number, place = tags[used][wrong][0], points[wrong][0].tolist()
        raise InputError(
            f"{where}: node {number} is at {place}, not a finite position; mesh it again"
        )
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags[used].astype(np.int64)] = np.arange(len(points))
    size = np.ptp(points[:, :2], axis=0).max()
    if np.abs(points[:, 2]).max() > 1e-9 * size:
        raise InputError(f"{where}: is not plane; a plane body has z = 0 everywhere")
    # facets with two nodes are of type 1
    if set(mesh.getElementTypes(1)) - {1}:
        raise InputError(f"{where}: {HIGHER_ORDER}")
    edges, spots = {}, {}
    for dim, tag in model.getPhysicalGroups():
        if dim > 1:
            continue
        name = model.getPhysicalName(dim, tag) or str(tag)
        entities = model.getEntitiesForPhysicalGroup(dim, tag)
        nodes = [part for e in entities for part in mesh.getElements(dim, e)[2]]
        places = number[np.concatenate([np.empty(0), *nodes]).astype(np.int64)]
        # a group may extend to other bodies of the file
        if dim == 0:
            spots[name] = places[places >= 0]
        else:
            facets = places.reshape(-1, 2)
            edges[name] = facets[np.all(facets >= 0, axis=1)]
    cells, arcs = number[around], arcs_of(gmsh, scale)
    return RawMesh(points[:, :2].copy(), cells, edges, spots, arcs=arcs, surfaces=surfaces)


def _cells(gmsh: Any, name: str | None, where: str) -> tuple[Ints, tuple[str, ...]]:
    """Return the nodes around each cell of the body, and the name of its physical surface.

    They are those of the physical surfaces, if there are any.
    """
    model = gmsh.model
    groups = {
        model.getPhysicalName(2, tag) or str(tag): tag for _, tag in model.getPhysicalGroups(2)
    }
    if name is not None and name not in groups:
        close = nearest(name, groups)
        hint = f"did you mean '{close}'?" if close else f"it has {', '.join(groups) or 'none'}"
        raise InputError(f"{where}: has no physical surface '{name}'; {hint}")
    chosen = groups if name is None else {name: groups[name]}
    surfaces = {
        int(e): group
        for group, tag in chosen.items()
        for e in model.getEntitiesForPhysicalGroup(2, tag)
    }
    if not groups:
        surfaces = {int(e): "" for _, e in model.getEntities(2)}
    names: list[str] = []
    found: dict[int, list[NDArray[np.uint64]]] = {}
    for surface in sorted(surfaces):
        for kind, tags, nodes in zip(*model.mesh.getElements(2, surface), strict=True):
            found.setdefault(int(kind), []).append(nodes)
            names += [surfaces[surface]] * len(tags)
    if not found:
        advice = "mesh the surface and put it in a Physical Surface"
        if surfaces:
            advice = "is the outline of its surface closed, and does it enclose an area?"
        elif not model.getEntities():
            advice = "gmsh finds nothing in it; give a .geo or .msh file"
        raise InputError(f"{where}: has no cells; {advice}")
    if set(found) == set(CORNERS):
        raise InputError(
            f"{where}: mixes triangles and quadrilaterals; use one kind, for quadrilaterals "
            "transfinite surfaces with Recombine"
        )
    (kind,) = list(found)[:1]
    if len(found) > 1 or kind not in CORNERS:
        raise InputError(f"{where}: {HIGHER_ORDER}")
    return np.concatenate(found[kind]).astype(np.int64).reshape(-1, CORNERS[kind]), tuple(names)
