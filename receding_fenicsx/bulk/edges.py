"""Edges of the body: facets, positions along an edge, integrals of shape functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.raw_mesh import gauss
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene


@dataclass(frozen=True)
class EdgeFacets:
    """Straight boundary facets of all ranks, alike on every rank."""

    # (n, nodes, 2) coordinates of a facet's nodes: both ends, and at order 2 the middle
    points: Array
    nodes: Ints  # (n, nodes) their global numbers
    outward: Array  # (n, 2) unit normals

    def __len__(self) -> int:
        """Return the number of facets."""
        return len(self.nodes)


def edge_facets(
    space: fem.FunctionSpace, body: BodyMesh, edge: str, span: tuple[float, float] | None = None
) -> EdgeFacets:
    """Find the facets of a named edge; an edge that the (half) body lacks has none; collective.

    With a span, keep the facets between these positions along the edge, which are vertices.
    """
    found = tagged_facets(space, body, body.groups.get(edge, ()))
    if span is None or not len(found):
        return found
    middle = along(body, edge, found.points[:, :2].mean(axis=1))
    inside = (middle > span[0]) & (middle < span[1])
    return EdgeFacets(found.points[inside], found.nodes[inside], found.outward[inside])


def tagged_facets(space: fem.FunctionSpace, body: BodyMesh, tags: Sequence[int]) -> EdgeFacets:
    """Find the facets with one of the tags; collective."""
    topology = body.mesh.topology
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    cell_of, facets_of = topology.connectivity(1, 2), topology.connectivity(2, 1)
    corners = _dolfinx.facet_corners(body.cell)
    facets = np.concatenate([np.empty(0, np.int32), *map(body.facet_tags.find, tags)])
    cells = cell_of.array[cell_of.offsets[facets]]
    owned = cells < topology.index_map(2).size_local
    facets, cells = facets[owned], cells[owned]
    around = facets_of.array.reshape(-1, len(corners))[cells]
    side = np.argmax(around == facets[:, None], axis=1)
    places = body.mesh.geometry.x[_dolfinx.cell_nodes(body.mesh)[cells], :2]
    a, b = np.moveaxis(places[np.arange(len(cells))[:, None], corners[side]], 1, 0)
    normal = np.column_stack([b[:, 1] - a[:, 1], a[:, 0] - b[:, 0]])
    normal /= np.hypot(*(b - a).T)[:, None]
    inside = np.sum(normal * (places.mean(axis=1) - a), axis=1) > 0.0
    layout = space.dofmap.dof_layout
    closure = np.array([layout.entity_closure_dofs(1, i) for i in range(len(corners))])[side]
    nodes = _dolfinx.global_nodes(space, _dolfinx.cell_dofs(space)[cells[:, None], closure])
    points = np.stack([a, b, 0.5 * (a + b)], axis=1)[:, : nodes.shape[1]]
    outward = np.where(inside[:, None], -normal, normal) + 0.0
    parts = body.mesh.comm.allgather((points, nodes, outward))
    return EdgeFacets(*map(np.concatenate, zip(*parts, strict=True)))


def along(body: BodyMesh, edge: str, points: Array) -> Array:
    """Return positions of points (n, 2) along an edge from its middle; it must be straight."""
    if edge not in body.lines:
        raise InputError(
            f"'{edge}' is not straight or in pieces, so there is no position along it; leave out "
            "its span and use expressions in x and y"
        )
    return body.lines[edge].along(points)


def edge_nodes(
    space: fem.FunctionSpace, body: BodyMesh, edge: str, span: tuple[float, float] | None
) -> tuple[Ints, Array]:
    """Return all nodes of an edge or a span of it, sorted, and their places; collective."""
    facets = edge_facets(space, body, edge, span)
    unique, first = np.unique(facets.nodes, return_index=True)
    return unique, facets.points.reshape(-1, 2)[first]


def measure(scene: Scene, points: Array) -> Array:
    """Return the factor (n, 1) of a length element at points (n, 2): 1, or r if axisymmetric."""
    return points[:, :1] if scene.axisymmetric else np.ones((len(points), 1))


def integrate(
    facets: EdgeFacets,
    traction: Callable[[Array, Array], Array],
    part: tuple[Array, Array] | None = None,
) -> Array:
    """Integrate a traction times each nodal shape function by Gauss's rule; (n, nodes, k) forces.

    The traction is a function of points (m, 2) and outward normals (m, 2) that returns (m, k)
    values, ``part`` where the integral begins and ends in each facet (n,), from 0 to 1.
    """
    s, weight = gauss()
    n, nodes = facets.nodes.shape
    begin, end = part or (np.zeros(n), np.ones(n))
    s = begin[:, None] + (end - begin)[:, None] * s
    shape = shape_functions(nodes, s)
    a, b = facets.points[:, 0], facets.points[:, 1]
    points = a[:, None, :] + s[:, :, None] * (b - a)[:, None, :]
    normals = np.repeat(facets.outward, len(weight), axis=0)
    values = np.asarray(traction(points.reshape(-1, 2), normals))
    values = values.reshape(n, len(weight), values.shape[-1])
    length = (end - begin) * np.hypot(b[:, 0] - a[:, 0], b[:, 1] - a[:, 1])
    return length[:, None, None] * np.einsum("inq,q,nqk->nik", shape, weight, values)


def facet_mass(scene: Scene, facets: EdgeFacets) -> Array:
    """Return int N_i N_j dA (n, nodes, nodes) of each facet."""
    shapes = np.tile(shape_functions(facets.nodes.shape[1], gauss()[0]).T, (len(facets), 1))
    return integrate(facets, lambda points, _: measure(scene, points) * shapes)


def shape_functions(nodes: int, s: Array) -> Array:
    """Return the values (nodes, ...) of a facet's shape functions at s (...), from 0 to 1."""
    if nodes == 2:
        return np.array([1.0 - s, s])
    return np.array([(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0), 4.0 * s * (1.0 - s)])
