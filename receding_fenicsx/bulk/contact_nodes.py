"""Contact nodes: positions, directions t and n, weights, held components and rigid motions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.constraints import Constraints, find_constraints
from receding_fenicsx.bulk.edges import EdgeFacets, integrate, measure, tagged_facets
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, ContactFacets
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene

NORMAL_TOLERANCE = 1e-10
"""Largest difference of 1 and the component of t or n along an axis that it is parallel to."""


@dataclass(frozen=True)
class ContactNodes:
    """The contact nodes, known alike on every rank, sorted along the edge.

    Attributes:
        x: (N,) position along the node's edge from its middle; increasing on each edge.
        edge: (N,) number of the node's contact edge, not decreasing.
        points: (N, 2) coordinates.
        node: (N,) global number of the node, whose displacements are 2 node and 2 node + 1.
        tangent: (N, 2) unit vectors t = (n_y, -n_x).
        normal: (N, 2) unit vectors n into the body; on the second body of a contact, out of it.
        weight: (N,) integral of N_i over the modelled contact edge, axisymmetric times r.
        held: (2N,) degrees of freedom [v; w] fixed by symmetry or supports.
        modes: (2N, 3) displacements [v; w] of the rigid motions of the body: translations in x and
            y, rotation about a pivot, the middle of all contacts.
        constraints: (m, 3) components of these motions at all held degrees of freedom; the free
            motions are orthogonal to all rows.
        null: (2N, n) rigid motions that are free while no contact node is held: null vectors of
            the condensed stiffness.
        oblique: (k, 2) coordinates of the ends of contact edges that a support holds obliquely to
            the edge. These nodes belong to the support and are no contact nodes.
    """

    x: Array
    edge: Ints
    points: Array
    node: Ints
    tangent: Array
    normal: Array
    weight: Array
    held: NDArray[np.bool_]
    modes: Array
    constraints: Array
    null: Array
    oblique: Array = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def rigid(self) -> Array:
        """(2N, n) rigid motions free of supports and symmetry, each with largest entry 1."""
        return scaled(self.modes @ free_motions(self.constraints))

    @property
    def dofs(self) -> Ints:
        """(2N,) global degrees of freedom in the order [u_x; u_y]."""
        return np.concatenate([2 * self.node, 2 * self.node + 1])

    def to_local(self, values: Array) -> Array:
        """Turn [x; y] components (2N along the first axis) into [t; n] components."""
        return _turn(values, np.stack([self.tangent, self.normal], axis=1))

    def to_global(self, values: Array) -> Array:
        """Turn [t; n] components (2N along the first axis) into [x; y] components."""
        return _turn(values, np.stack([self.tangent, self.normal], axis=2))


def _turn(values: Array, rotation: Array) -> Array:
    """Apply a 2 x 2 matrix for each node (N, 2, 2) to the two halves of the first axis."""
    a, b = np.split(values, 2)
    rows = rotation.reshape(-1, 4, *[1] * (values.ndim - 1))
    return np.concatenate([rows[:, 0] * a + rows[:, 1] * b, rows[:, 2] * a + rows[:, 3] * b])


def find_contact(
    scene: Scene,
    space: fem.FunctionSpace,
    body: BodyMesh,
    resisted: Array,
    left_out: Array | None = None,
) -> tuple[ContactNodes, Constraints]:
    """Find the contact nodes and the constraints of the body; collective.

    Args:
        scene: the scene of this body alone.
        space: displacement space.
        body: the mesh.
        resisted: (m, 3) components of the rigid motions that springs resist.
        left_out: (k, 2) coordinates of further nodes that are no contact nodes.

    Raises:
        InputError: constraints that do not fit the mesh, each other or the contact; on all ranks.
    """
    edges = [_edge_nodes(scene, space, body, contact) for contact in body.contacts]
    found = find_constraints(scene, space, body, np.concatenate([e[0] for e in edges]))
    normals = [-contact.line.outward + 0.0 for contact in body.contacts]
    ends = [_held_obliquely(*e[:2], n, found.given) for e, n in zip(edges, normals, strict=True)]
    oblique = np.vstack(ends)
    none = oblique if left_out is None else left_out
    if len(none):
        near = POSITION_TOLERANCE * body.size
        apart = [np.linalg.norm(e[1][:, None] - none, axis=2).min(axis=1) > near for e in edges]
        edges = [tuple(part[on] for part in e) for e, on in zip(edges, apart, strict=True)]
    node, points, x, weight = (np.concatenate([e[k] for e in edges]) for k in range(4))
    count = [len(e[0]) for e in edges]
    normal = np.repeat(np.array(normals), count, axis=0)
    tangent = np.column_stack([normal[:, 1], -normal[:, 0]]) + 0.0

    # a body of revolution moves along its axis only
    axial = np.eye(3)[[0, 2] if scene.axisymmetric else []]
    excluded = np.vstack([found.tied, axial, resisted])
    at_contact = np.isin(found.given // 2, node)
    on_nodes = motions(points, body.pivot, body.size)
    modes = np.concatenate([np.einsum("nc,nck->nk", axis, on_nodes) for axis in (tangent, normal)])
    nodes = ContactNodes(
        x=x,
        edge=np.repeat(np.arange(len(edges)), count),
        points=points,
        node=node,
        tangent=tangent,
        normal=normal,
        weight=weight,
        held=_held_at_contact(found.given[at_contact], node, tangent, normal),
        modes=modes,
        constraints=np.vstack([found.rows, excluded]),
        null=scaled(modes @ free_motions(np.vstack([found.rows[~at_contact], excluded]))),
        oblique=oblique,
    )
    return nodes, found


def _edge_nodes(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: ContactFacets
) -> tuple[Ints, Array, Array, Array]:
    """Return number, coordinates, position and weight of the nodes of one contact edge, sorted."""
    comm = body.mesh.comm
    facets = on_all(comm, lambda: tagged_facets(space, body, (contact.tag,)))
    every = [part for part in comm.allgather(facets) if len(part)]
    facets = EdgeFacets(
        *(np.concatenate([getattr(p, a) for p in every]) for a in ("points", "nodes", "outward"))
    )
    weights = integrate(facets, lambda points, normals: measure(scene, points))[:, :, 0]
    node, first, inverse = np.unique(facets.nodes.ravel(), return_index=True, return_inverse=True)
    points = facets.points.reshape(-1, 2)[first]
    weight = np.bincount(inverse.ravel(), weights=weights.ravel()).astype(float)
    x = contact.line.along(points) + 0.0
    order = np.argsort(x)
    if scene.axisymmetric:
        # at order 2 the node on the axis has no weight: it gets no contact condition
        order = order[weight[order] > 1e-9 * weight.max()]
    return node[order], points[order], x[order], weight[order]


def _held_at_contact(dofs: Ints, node: Ints, tangent: Array, normal: Array) -> NDArray[np.bool_]:
    """Return (2N,) flags [v; w] of the held degrees of freedom of contact nodes."""
    n = len(node)
    place = {int(number): i for i, number in enumerate(node)}
    held = np.zeros(2 * n, dtype=bool)
    axes: dict[int, set[int]] = {}
    for dof in dofs:
        axes.setdefault(place[int(dof // 2)], set()).add(int(dof % 2))
    for i, fixed in axes.items():
        for k, direction in enumerate((tangent[i], normal[i])):
            held[k * n + i] = (
                len(fixed) == 2 or abs(direction[next(iter(fixed))]) > 1.0 - NORMAL_TOLERANCE
            )
    return held


def _held_obliquely(node: Ints, points: Array, normal: Array, dofs: Ints) -> Array:
    """Return the coordinates (k, 2) of the ends of an edge that are held obliquely to it.

    Args:
        node: numbers of the nodes, sorted along the edge.
        points: their coordinates.
        normal: (2,) unit normal of the edge.
        dofs: all held degrees of freedom.

    Raises:
        InputError: another node is held so.
    """
    fixed = np.isin(2 * node[:, None] + [0, 1], dofs)
    single = np.flatnonzero(fixed[:, 0] != fixed[:, 1])
    if np.abs(normal).max() > 1.0 - NORMAL_TOLERANCE:
        return points[:0]
    for i in single[(single > 0) & (single < len(node) - 1)]:
        raise InputError(
            f"[[support]]: holds the contact node at ({points[i, 0]:g}, {points[i, 1]:g}), inside "
            'the contact, obliquely to its edge; fix "xy", or move it'
        )
    return points[single]
