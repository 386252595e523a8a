"""Mesh files for the tests: written as MSH 2.2 text, and the mesh of a rectangle to change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.bulk.mesh.meshing import raw_meshes
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh
from receding_fenicsx.scene.model import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def rectangle(scene: Scene) -> RawMesh:
    """The mesh of a scene's whole rectangle, as rank 0 makes it."""
    return raw_meshes(scene, False)[0]


def turned(points: Array, degrees: float, shift: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Points turned about the origin, then moved."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s], [-s, c]]) + np.array(shift)


def write_msh(
    path: Path,
    points: Array,
    cells: list[Ints],
    edges: dict[str, Ints],
    spots: dict[str, Ints] | None = None,
    surfaces: list[str] | None = None,
) -> Path:
    """Write a mesh file.

    Args:
        path: the file.
        points: (n, 2 or 3) coordinates.
        cells: points of the cells of each surface: 3 triangle, 4 quadrilateral, 6 triangle of
            second order.
        edges: (k, 2) facets of each group.
        spots: points of each group.
        surfaces: names of the surfaces; "body", ... when left out.

    Returns:
        The path.
    """
    names: list[str] = []
    rows: list[str] = []

    def add(dim: int, name: str, elements: Ints) -> None:
        tag = len(names) + 1
        names.append(f'{dim} {tag} "{name}"')
        kinds = {0: {1: 15}, 1: {2: 1}, 2: {3: 2, 4: 3, 6: 9}}
        for nodes in elements:
            kind = kinds[dim][len(nodes)]
            text = " ".join(str(i + 1) for i in nodes)
            rows.append(f"{len(rows) + 1} {kind} 2 {tag} {tag} {text}")

    for name, nodes in (spots or {}).items():
        add(0, name, np.reshape(nodes, (-1, 1)))
    for name, facets in edges.items():
        add(1, name, facets)
    for i, part in enumerate(cells):
        add(2, (surfaces or ["body", "rest", "more"])[i], part)
    flat = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    lines += ["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(points))]
    lines += [f"{i + 1} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(flat.tolist())]
    lines += ["$EndNodes", "$Elements", str(len(rows)), *rows, "$EndElements", ""]
    path.write_text("\n".join(lines))
    return path
