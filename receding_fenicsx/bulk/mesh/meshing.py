"""Meshes of the bodies, tagged by edge and contact and distributed over the ranks."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import mesh as dmesh
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.mesh.contact_edges import ContactFacets, edges_of, find_interfaces
from receding_fenicsx.bulk.mesh.raw_mesh import Arcs, Line, RawMesh, line_of, with_radii
from receding_fenicsx.bulk.mesh.rectangle import rectangle_mesh
from receding_fenicsx.bulk.mesh.user_mesh import read_user_meshes
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.checks import check_known
from receding_fenicsx.scene.model import Body, Scene
from receding_fenicsx.scene.one_body import part_of


@dataclass(frozen=True)
class BodyMesh:
    """A distributed mesh of a body with named edges."""

    mesh: dmesh.Mesh  # DOLFINx mesh
    facet_tags: Any  # tags of boundary facets
    groups: dict[str, tuple[int, ...]]  # tags of each edge by name
    # the contact edges of this body in the scene's order, then the tied ones
    contacts: tuple[ContactFacets, ...]
    lines: dict[str, Line]  # the line of each straight edge
    spots: dict[str, Array]  # (k, 2) coordinates of each named group of points
    arcs: Arcs | None  # the true curves of the facets on curved edges, where they are known
    size: float  # length that tolerances on positions are relative to, the same for all bodies
    pivot: Array  # (2,) middle of all contacts, about which rigid motions rotate
    half: bool  # True when only x >= 0 is meshed; always for an axisymmetric body
    cell: str  # "triangle" or "quadrilateral"
    # number of the material of each owned cell, where the body has several
    materials: Ints | None = None


def raw_meshes(scene: Scene, half: bool) -> list[RawMesh]:
    """Mesh or read the bodies of a scene; the surfaces of one file together, if none is refined."""
    found: dict[str, RawMesh] = {}
    for body in scene.bodies:
        if body.mesh is None:
            found[body.name] = rectangle_mesh(scene, body, half)
        elif body.name not in found:
            file = body.mesh, body.parameters
            others = () if scene.mesh.refine else scene.others
            alike = [body, *(b for b in others if b != body and (b.mesh, b.parameters) == file)]
            meshes = read_user_meshes(alike, part_of(scene, body).mesh, scene.axisymmetric)
            for each, mesh in zip(alike, meshes, strict=True):
                found[each.name] = with_radii(mesh) if scene.axisymmetric else mesh
    corners = {mesh.cells.shape[1] for mesh in found.values()}
    if scene.mesh.cell == "quadrilateral" and corners == {3}:
        raise InputError("[mesh] cell: the mesh files have triangles; remove cell, or recombine")
    return [found[body.name] for body in scene.bodies]


def make_meshes(comm: MPI.Comm, scene: Scene, half: bool) -> tuple[BodyMesh, ...]:
    """Mesh the scene's bodies: rectangles graded from their contact edge, or the user's meshes.

    The mesh of a whole rectangle is bitwise mirror-symmetric; ``half`` meshes only x >= 0.
    """

    def tagged() -> list[tuple[dict[str, Any], tuple[NDArray[Any], ...]]]:
        meshes = raw_meshes(scene, half)
        interfaces = find_interfaces(scene, meshes, half and not scene.axisymmetric)
        sides = [(meshes[s.body], s) for s in interfaces if not s.tie]
        ends = np.vstack([mesh.points[mesh.edges[s.edge][s.facets].ravel()] for mesh, s in sides])
        low, high = ends.min(axis=0), ends.max(axis=0)
        size = max(mesh.size for mesh in meshes)
        shared = {"size": size, "pivot": 0.5 * (low + high), "half": half}
        found = []
        for k, (body, mesh) in enumerate(zip(scene.bodies, meshes, strict=True)):
            data, parts = _tagged(scene, body, mesh, [s for s in interfaces if s.body == k])
            found.append((data | shared, parts))
        return found

    made = on_root(comm, tagged)
    # arrays are empty on all ranks but 0
    every = comm.bcast(made and [(data, tuple(part[:0] for part in parts)) for data, parts in made])
    found = []
    for data, (points, cells, facets, tags, of_cells) in made or every:
        mesh = _dolfinx.create_mesh(comm, data["cell"], cells, points)
        tags = _dolfinx.tag_entities(mesh, 1, facets, tags)
        numbers = None
        if comm.bcast(len(of_cells)):
            tags_of = _dolfinx.tag_entities(mesh, 2, cells, of_cells)
            numbers = np.zeros(mesh.topology.index_map(2).size_local, dtype=np.int64)
            own = tags_of.indices < len(numbers)
            numbers[tags_of.indices[own]] = tags_of.values[own]
        found.append(BodyMesh(mesh, tags, materials=numbers, **data))
    return tuple(found)


def _tagged(
    scene: Scene, body: Body, mesh: RawMesh, sides: list[ContactFacets]
) -> tuple[dict[str, Any], tuple[NDArray[Any], ...]]:
    """Return attributes of a BodyMesh; points, cells, facets, their tags, materials of cells."""
    tag_of = {name: tag for tag, name in enumerate(mesh.edges, start=1)}
    tags = {name: np.full(len(f), tag_of[name], np.int32) for name, f in mesh.edges.items()}
    groups = {name: [tag] for name, tag in tag_of.items()}
    contacts = []
    for tag, side in enumerate(sides, start=len(tag_of) + 1):
        tags[side.edge][side.facets] = tag
        groups[side.edge].append(tag)
        contacts.append(replace(side, tag=tag))
    owned = [scene.find_edge(edge) for edge, _ in edges_of(scene)]
    wanted = {name for owner, name in owned if owner == body}
    wanted |= set(mesh.edges if body.mesh is None else ())
    used = [name for name in mesh.edges if name in wanted and len(mesh.edges[name])]
    lines = {}
    for edge in used:
        # not of a curved edge
        with contextlib.suppress(InputError):
            lines[edge] = line_of(mesh, edge, "")
    data = {
        "groups": {name: tuple(groups[name]) for name in used},
        "contacts": tuple(contacts),
        "lines": lines,
        "spots": {name: mesh.points[nodes] for name, nodes in mesh.spots.items()},
        "arcs": mesh.arcs,
        "cell": mesh.cell,
    }
    facets = np.vstack([np.empty((0, 2), dtype=np.int64), *(mesh.edges[name] for name in used)])
    every = np.concatenate([np.empty(0, np.int32), *(tags[name] for name in used)])
    materials = _materials_of_cells(scene, body, mesh)
    return data, (mesh.points, mesh.cells, facets, every, materials)


def _materials_of_cells(scene: Scene, body: Body, mesh: RawMesh) -> NDArray[np.int32]:
    """Return the number of the material of each cell; empty where the body has one."""
    names = [material.name for material in scene.surface_materials(body)]
    if not names:
        return np.empty(0, dtype=np.int32)
    label = f'[body] mesh "{Path(body.mesh or "").name}"'
    surfaces = sorted(set(mesh.surfaces))
    known = sorted({name for surface in surfaces for name in surface.split("/")})
    for name in names:
        check_known(name, known, f"[material.{name}]", "body or physical surface")
    for surface in surfaces:
        if surface not in names:
            advice = f"add [material.{surface}]" if "/" not in surface else "it is in two groups"
            raise InputError(f"{label}: the physical surface '{surface}' has no material; {advice}")
    return np.array([names.index(surface) for surface in mesh.surfaces], dtype=np.int32)
