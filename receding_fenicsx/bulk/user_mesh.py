"""Meshes of the user's own: a .geo file that gmsh meshes, or a mesh that gmsh can read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from receding_fenicsx.bulk.gmsh_model import gmsh_model
from receding_fenicsx.bulk.raw_mesh import RawMesh
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import Body, MeshOptions, nearest

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FLAT_TOLERANCE = 1e-9
"""Largest distance from the plane, over the mesh's size, of a mesh that is plane."""
THIN_TOLERANCE = 1e-12
"""Twice the area at a corner of a cell, over its longest side squared, below which it is flat."""
CELLS = {2: 3, 3: 4}
"""Corners of the cells that can be used, by gmsh's number of the kind."""
LINE = 1
"""gmsh's number of a facet with two nodes."""
HIGHER = (
    "has cells of higher order; save it with Mesh.ElementOrder = 1 (mesh.degree sets the degree of "
    "the displacement)"
)


def read_user_mesh(body: Body, options: MeshOptions) -> RawMesh:
    """Mesh a .geo file, or read a mesh; no communication.

    A .geo file is given the numbers ``contact_elements``, ``growth`` and ``quadrilaterals`` (0 or
    1) of the scene and the body's own ``parameters``; its DefineConstant then leaves them be.

    Args:
        body: the body; ``mesh`` is the path.
        options: the scene's mesh options.

    Returns:
        The mesh of first-order cells.

    Raises:
        InputError: gmsh cannot read or mesh the file, or the mesh cannot be used.
    """
    assert body.mesh is not None
    path = Path(body.mesh)
    where = f'[body] mesh "{path.name}"'
    if not path.is_file():
        raise InputError(f'[body] mesh: "{path}": no such file; check the path')
    is_geo = path.suffix == ".geo"
    _check_parameters(body, path, where, is_geo)
    with gmsh_model() as gmsh:
        numbers = {
            "contact_elements": float(options.contact_elements),
            "growth": float(options.growth),
            "quadrilaterals": float(options.cell == "quadrilateral"),
            **body.parameters,
        }
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, [value])
        try:
            gmsh.merge(str(path))
            if is_geo:
                gmsh.option.setNumber("Mesh.ElementOrder", 1)
                gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            reason = " ".join(str(caught).split())
            raise InputError(f"{where}: gmsh cannot use it: {reason}; mend the file") from None
        # gmsh itself scales a mesh only when it writes it
        scale = gmsh.option.getNumber("Mesh.ScalingFactor") if is_geo else 1.0
        mesh = _collect(gmsh, body, where, scale)
    _check_cells(mesh, where)
    return mesh


def _check_parameters(body: Body, path: Path, where: str, is_geo: bool) -> None:
    """Refuse parameters that the file does not take."""
    if not body.parameters:
        return
    if not is_geo:
        raise InputError(
            f"{where}: parameters are for .geo files; leave them out, or give the .geo file"
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    words = set(re.findall(r"[A-Za-z_]\w*", text))
    for name in body.parameters:
        if name not in words and not words & {"Include", "Merge"}:
            close = nearest(name, words)
            hint = f"did you mean '{close}'?" if close else "DefineConstant it there"
            raise InputError(f"{where}: the file has no parameter '{name}'; {hint}")


def _collect(gmsh: Any, body: Body, where: str, scale: float) -> RawMesh:
    """Take points, times a scale, cells and groups out of gmsh's model."""
    mesh, model = gmsh.model.mesh, gmsh.model
    if len(mesh.getElementTypes(3)):
        raise InputError(f"{where}: is a mesh of a solid; give the mesh of a plane body")
    around = _cells(gmsh, body, where)
    tags, coordinates, _ = mesh.getNodes()
    coordinates = coordinates.reshape(-1, 3)
    # nodes that no cell uses are left out
    used = np.isin(tags, around)
    points = scale * coordinates[used]
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags[used].astype(np.int64)] = np.arange(len(points))
    size = np.ptp(points[:, :2], axis=0).max()
    if np.abs(points[:, 2]).max() > FLAT_TOLERANCE * size:
        raise InputError(f"{where}: is not plane; a plane body has z = 0 everywhere")
    if set(mesh.getElementTypes(1)) - {LINE}:
        raise InputError(f"{where}: {HIGHER}")
    edges, spots = {}, {}
    for dim, tag in model.getPhysicalGroups():
        if dim > 1:
            continue
        name = model.getPhysicalName(dim, tag) or str(tag)
        entities = model.getEntitiesForPhysicalGroup(dim, tag)
        nodes = [part for e in entities for part in mesh.getElements(dim, e)[2]]
        places = number[np.concatenate([np.empty(0), *nodes]).astype(np.int64)]
        # a group may go on where another body of the file is
        if dim == 0:
            spots[name] = places[places >= 0]
        else:
            facets = places.reshape(-1, 2)
            edges[name] = facets[np.all(facets >= 0, axis=1)]
    return RawMesh(points[:, :2].copy(), number[around], edges, spots)


def _cells(gmsh: Any, body: Body, where: str) -> Ints:
    """Return the nodes around each cell of the body: of its physical surfaces, if there are any."""
    model = gmsh.model
    groups = {
        model.getPhysicalName(2, tag) or str(tag): tag for _, tag in model.getPhysicalGroups(2)
    }
    if body.surface is not None and body.surface not in groups:
        close = nearest(body.surface, groups)
        hint = f"did you mean '{close}'?" if close else f"it has {', '.join(groups) or 'none'}"
        raise InputError(f"{where}: has no physical surface '{body.surface}'; {hint}")
    chosen = groups.values() if body.surface is None else [groups[body.surface]]
    surfaces = {int(e) for tag in chosen for e in model.getEntitiesForPhysicalGroup(2, tag)}
    if not groups:
        surfaces = {int(e) for _, e in model.getEntities(2)}
    found: dict[int, list[NDArray[np.uint64]]] = {}
    for surface in sorted(surfaces):
        for kind, _, nodes in zip(*model.mesh.getElements(2, surface), strict=True):
            found.setdefault(int(kind), []).append(nodes)
    if not found:
        raise InputError(
            f"{where}: has no cells; mesh the surface and put it in a Physical Surface"
        )
    if set(found) == set(CELLS):
        raise InputError(
            f"{where}: mixes triangles and quadrilaterals; use one kind, for quadrilaterals "
            "transfinite surfaces with Recombine"
        )
    (kind,) = list(found)[:1]
    if len(found) > 1 or kind not in CELLS:
        raise InputError(f"{where}: {HIGHER}")
    return np.concatenate(found[kind]).astype(np.int64).reshape(-1, CELLS[kind])


def _check_cells(mesh: RawMesh, where: str) -> None:
    """Turn all cells counter-clockwise; refuse flat cells and meshes in several parts."""
    corners = mesh.points[mesh.cells]
    after, before = (np.roll(corners, shift, axis=1) - corners for shift in (-1, 1))
    turn = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    clockwise = turn.sum(axis=1) < 0.0
    mesh.cells[clockwise] = mesh.cells[clockwise][:, ::-1]
    turn[clockwise] *= -1.0
    longest = (after**2).sum(axis=-1).max(axis=1)
    flat = turn.min(axis=1) <= THIN_TOLERANCE * longest
    if np.any(flat):
        x, y = corners[np.argmax(flat)].mean(axis=0)
        raise InputError(
            f"{where}: {int(flat.sum())} of its cells are flat or folded, one at ({x:g}, {y:g}); "
            "mesh the body better"
        )
    n, width = len(mesh.points), mesh.cells.shape[1]
    rows, columns = np.repeat(mesh.cells[:, 0], width), mesh.cells.ravel()
    links = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    parts, _ = connected_components(links, directed=False)
    if parts > 1:
        raise InputError(
            f"{where}: falls into {parts} parts that share no nodes; join them (Coherence), or "
            "name the part that is the body by body.surface"
        )
