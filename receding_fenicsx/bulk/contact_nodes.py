"""Contact nodes of a body: edges, directions t and n, held components and rigid motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.constraints import Constraints, find_constraints
from receding_fenicsx.bulk.loads import integrate, measure, tagged_facets
from receding_fenicsx.bulk.mesh.contact_edges import ContactFacets
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.raw_mesh import Line
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene


@dataclass(frozen=True)
class ContactSide:
    """A contact edge of a body, or a tied one."""

    node: Ints  # (n,) its nodes among the body's, sorted along the edge
    x: Array  # (n,) position along the first body's edge from its middle
    points: Array  # (n, 2) coordinates
    normal: Array  # (n, 2) unit vectors n into the first body
    weight: Array  # (n,) integral of N_i over the modelled edge, axisymmetric times r
    # (k, 2 or 3) places in ``node`` of the nodes of each facet: ends, middle; -1 for one without
    # weight, on the axis of revolution
    facets: Ints
    # (n,) whether a node may be a contact point. Nodes of two edges and obliquely held ones are
    # none, nor are the middles of chords, which lie off their curve; of a tie, nodes of two ties
    # are none where they do not match
    carries: NDArray[np.bool_]
    slave: bool  # whether the contact points are this side's nodes where those of both do not match


@dataclass(frozen=True)
class ContactNodes:
    """The nodes of all contact and tied edges of a body, each once, known alike on every rank."""

    points: Array  # (N, 2) coordinates
    node: Ints  # (N,) global number of the node, whose displacements are 2 node and 2 node + 1
    tangent: Array  # (N, 2) unit vectors t = (n_y, -n_x)
    # (N, 2) unit vectors n into the first body of the contact; y of nodes that are no contact
    # points
    normal: Array
    held: NDArray[np.bool_]  # (2N,) degrees of freedom [v; w] fixed by symmetry or supports
    # (2N, 3) displacements [v; w] of the rigid motions of the body: translations in x and y,
    # rotation about a pivot, the middle of all contacts
    modes: Array
    # (m, 3) components of these motions at all held degrees of freedom; the free motions are
    # orthogonal to all rows
    constraints: Array
    # (2N, n) rigid motions that are free while no contact node is held: null vectors of the
    # condensed stiffness
    null: Array
    sides: tuple[ContactSide, ...] = ()  # the edges

    @classmethod
    def of(
        cls,
        places: tuple[Ints, Array, Array],
        held: NDArray[np.bool_],
        constraints: tuple[Array, Array],
        pivot: tuple[Array, float],
        sides: Sequence[ContactSide],
    ) -> ContactNodes:
        """Return nodes, given by number, place and normal, that turn about a pivot by a length.

        The second of the constraints are those of which no contact node is part.
        """
        node, points, normal = places
        moved, tangent = motions(points, *pivot), tangent_of(normal)
        modes = np.concatenate([np.einsum("nc,nck->nk", axis, moved) for axis in (tangent, normal)])
        null = scaled(modes @ free_motions(constraints[1]))
        rows = constraints[0]
        return cls(points, node, tangent, normal, held, modes, rows, null, tuple(sides))

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


def tangent_of(normal: Array) -> Array:
    """Return the tangents t = (n_y, -n_x) of normals (n, 2)."""
    return np.column_stack([normal[:, 1], -normal[:, 0]]) + 0.0


def _turn(values: Array, rotation: Array) -> Array:
    """Apply a 2 x 2 matrix for each node (N, 2, 2) to the two halves of the first axis."""
    a, b = np.split(values, 2)
    rows = rotation.reshape(-1, 4, *[1] * (values.ndim - 1))
    return np.concatenate([rows[:, 0] * a + rows[:, 1] * b, rows[:, 2] * a + rows[:, 3] * b])


def find_contact(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, resisted: Array
) -> tuple[ContactNodes, Constraints]:
    """Find the contact nodes and the constraints of the body; collective.

    ``resisted`` (m, 3) are components of the rigid motions that springs resist.
    """
    edges = [_edge_nodes(scene, space, body, contact) for contact in body.contacts]
    every = np.concatenate([own for own, *_ in edges])
    found = find_constraints(scene, space, body, every)
    node, first, times = np.unique(every, return_index=True, return_counts=True)
    # in the order of the edges
    order = np.argsort(first)
    node, first, times = node[order], first[order], times[order]
    place = {int(number): i for i, number in enumerate(node)}
    sides = []
    for edge, contact in zip(edges, body.contacts, strict=True):
        own, points, x, weight, nodes_of_facets = edge
        at = np.array([place[int(number)] for number in own])
        normal = contact.inward(points)
        carries = times[at] == 1
        if contact.tie:
            normal = np.tile([0.0, 1.0], (len(at), 1))
            tied = [e[0] for e, c in zip(edges, body.contacts, strict=True) if c.tie]
            others = np.concatenate([own[:0], *(o for o in tied if o is not own)])
            carries = ~np.isin(own, others)
        else:
            # a support holds in one direction oblique to the edge
            fixed = np.isin(2 * own[:, None] + [0, 1], found.given)
            oblique = (fixed[:, 0] != fixed[:, 1]) & carries
            oblique &= np.abs(normal).max(axis=1) <= 1.0 - 1e-10
            for px, py in points[1:-1][oblique[1:-1]]:
                raise InputError(
                    f"[[support]]: holds the contact node at ({px:g}, {py:g}), inside the contact, "
                    'obliquely to its edge; fix "xy", or move it'
                )
            carries &= ~oblique
        rows = {int(number): i for i, number in enumerate(own)}
        facets = np.array([[rows.get(int(n), -1) for n in facet] for facet in nodes_of_facets])
        if not (contact.tie or isinstance(contact.line, Line)):
            # chords have only their ends on the curve
            carries[facets[:, 2:]] = False
        sides.append(ContactSide(at, x, points, normal, weight, facets, carries, contact.slave))
    points = np.concatenate([side.points for side in sides])[first]
    normal = np.concatenate([side.normal for side in sides])[first]
    pairs = zip(sides, body.contacts, strict=True)
    own = np.concatenate([side.carries & (not contact.tie) for side, contact in pairs])[first]
    normal = np.where(own[:, None], normal, [0.0, 1.0])
    # a body of revolution moves along its axis only
    axial = np.eye(3)[[0, 2] if scene.axisymmetric else []]
    excluded = np.vstack([found.tied, axial, resisted])
    at_contact = np.isin(found.given // 2, node)
    every, off = np.vstack([found.rows, excluded]), np.vstack([found.rows[~at_contact], excluded])
    # along t and n; of an oblique node only if it is held in both directions
    fixed = np.isin(2 * node[:, None] + [0, 1], found.given)
    axes = np.abs(np.stack([tangent_of(normal), normal]))
    along = (fixed & (axes > 1.0 - 1e-10)).any(axis=2)
    held = np.where(fixed.all(axis=1), True, along).ravel()
    pivot = body.pivot, body.size
    return ContactNodes.of((node, points, normal), held, (every, off), pivot, sides), found


def _edge_nodes(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: ContactFacets
) -> tuple[Ints, Array, Array, Array, Ints]:
    """Return number, place, position and weight of the nodes of an edge, sorted, and its facets."""
    facets = tagged_facets(space, body, (contact.tag,))
    weights = integrate(facets, lambda points, normals: measure(scene, points))[:, :, 0]
    node, first, inverse = np.unique(facets.nodes.ravel(), return_index=True, return_inverse=True)
    points = facets.points.reshape(-1, 2)[first]
    weight = np.bincount(inverse.ravel(), weights=weights.ravel()).astype(float)
    x = contact.line.along(points) + 0.0
    order = np.argsort(x)
    if scene.axisymmetric and not contact.tie:
        # at order 2 the node on the axis has no weight: it gets no contact condition
        order = order[weight[order] > 1e-9 * weight.max()]
    return node[order], points[order], x[order], weight[order], facets.nodes
