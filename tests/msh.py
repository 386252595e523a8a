"""Mesh files for the tests: written as MSH 2.2 text, and the mesh of a rectangle to change."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

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


def write_msh(path: Path, points: Array, cells: list[Ints], edges: dict[str, Ints]) -> Path:
    """Write a mesh file: points of the cells of each surface, and facets of each group.

    Cells are triangles, quadrilaterals or triangles of second order.
    """
    names: list[str] = []
    rows: list[str] = []

    def add(dim: int, name: str, elements: Ints) -> None:
        tag = len(names) + 1
        names.append(f'{dim} {tag} "{name}"')
        kinds = {1: {2: 1}, 2: {3: 2, 4: 3, 6: 9}}
        for nodes in elements:
            kind = kinds[dim][len(nodes)]
            text = " ".join(str(i + 1) for i in nodes)
            rows.append(f"{len(rows) + 1} {kind} 2 {tag} {tag} {text}")

    for name, facets in edges.items():
        add(1, name, facets)
    for name, part in zip(("body", "rest"), cells, strict=False):
        add(2, name, part)
    flat = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    lines += ["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(points))]
    lines += [f"{i + 1} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(flat.tolist())]
    lines += ["$EndNodes", "$Elements", str(len(rows)), *rows, "$EndElements", ""]
    path.write_text("\n".join(lines))
    return path


def grid(
    path: Path, at: Callable[[Array, Array], tuple[Array, Array]], across: int, up: int
) -> str:
    """Write the mesh of the unit square mapped by a function; return its path."""
    s, t = np.meshgrid(np.arange(across + 1.0) / across, np.arange(up + 1.0) / up)
    points = np.column_stack(at(s.ravel(), t.ravel()))
    k = np.arange(len(points)).reshape(s.shape)
    cells = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]], axis=-1).reshape(-1, 4)
    edges = {"bottom": k[0], "top": k[-1], "left": k[:, 0], "right": k[:, -1]}
    facets = {name: np.column_stack([e[:-1], e[1:]]) for name, e in edges.items()}
    if MPI.COMM_WORLD.rank == 0:
        # nodes that coincide, as those of a closed ring, are one
        _, first, same = np.unique(
            np.round(points, 9), axis=0, return_index=True, return_inverse=True
        )
        same = same.ravel()
        facets = {name: same[f] for name, f in facets.items() if len(f)}
        write_msh(path, points[first], [same[cells]], facets)
    MPI.COMM_WORLD.barrier()
    return str(path)


def ring(
    low: float, high: float, turn: float = 0.0
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """A closed ring between two radii."""

    def at(s: Array, t: Array) -> tuple[Array, Array]:
        r, angle = low + (high - low) * t, turn + 2.0 * np.pi * s
        return r * np.cos(angle), r * np.sin(angle)

    return at
