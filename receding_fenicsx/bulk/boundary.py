"""Contact nodes, what symmetry and supports hold, and the rigid motions that they leave."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.bulk.edges import EdgeFacets, edge_facets, integrate, measure, positions
from receding_fenicsx.bulk.meshing import BodyMesh
from receding_fenicsx.bulk.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.ties import Prescribed, Ties, tied_dofs
from receding_fenicsx.errors import InputError, on_all
from receding_fenicsx.scene import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NORMAL_TOLERANCE = 1e-10
"""Largest component of a difference between unit vectors that are to be the same."""
MOTION_TOLERANCE = 1e-12
"""Size of a constraint on a rigid motion (lengths over the body's) that counts as none."""
WEIGHT_TOLERANCE = 1e-9
"""Weight of a contact node over the largest one below which it is none."""
AXES = {"x": (0,), "y": (1,), "xy": (0, 1)}


@dataclass(frozen=True)
class ContactNodes:
    """The contact nodes, known alike on every rank, sorted along the edge.

    Attributes:
        x: (N,) position along the edge from the body's centre, increasing.
        points: (N, 2) coordinates.
        node: (N,) global number of the node, whose displacements are 2 node and 2 node + 1.
        tangent: (2,) unit vector t = (n_y, -n_x).
        normal: (2,) unit vector n into the body.
        weight: (N,) integral of N_i over the modelled contact edge, axisymmetric times r.
        held: (2N,) degrees of freedom [v; w] fixed by symmetry or supports.
        rigid: (2N, n) rigid motions [v; w] that supports and symmetry leave, each with largest
            entry 1.
        null: (2N, m) the same with ``held`` disregarded: null vectors of the condensed stiffness.
    """

    x: Array
    points: Array
    node: Ints
    tangent: Array
    normal: Array
    weight: Array
    held: NDArray[np.bool_]
    rigid: Array
    null: Array

    @property
    def dofs(self) -> Ints:
        """(2N,) global degrees of freedom in the order [u_x; u_y]."""
        return np.concatenate([2 * self.node, 2 * self.node + 1])

    def to_local(self, values: Array) -> Array:
        """Turn [x; y] components (2N along the first axis) into [t; n] components."""
        return _turn(values, np.vstack([self.tangent, self.normal]))

    def to_global(self, values: Array) -> Array:
        """Turn [t; n] components (2N along the first axis) into [x; y] components."""
        return _turn(values, np.column_stack([self.tangent, self.normal]))


def _turn(values: Array, rotation: Array) -> Array:
    """Apply a 2 x 2 matrix to the two halves of the first axis."""
    a, b = np.split(values, 2)
    return np.concatenate(
        [rotation[0, 0] * a + rotation[0, 1] * b, rotation[1, 0] * a + rotation[1, 1] * b]
    )


def find_contact(
    scene: Scene,
    space: fem.FunctionSpace,
    body: BodyMesh,
    ties: Ties,
    prescribed: Iterable[Prescribed] = (),
) -> tuple[ContactNodes, Ints]:
    """Find the contact nodes and what is held.

    Args:
        scene: the scene, with one contact.
        space: displacement space.
        body: the mesh.
        ties: its platens.
        prescribed: displacements that loads prescribe.

    Returns:
        The contact nodes, and the global degrees of freedom off the contact that symmetry,
        supports, prescribed displacements and platens leave no freedom of their own; both alike on
        every rank.

    Raises:
        InputError: an edge that is not straight, a span without facets, a support without nodes, a
            contact node that moves with a platen or as prescribed.
    """
    comm, contact = body.mesh.comm, scene.contacts[0]
    facets = on_all(comm, lambda: edge_facets(space, body, contact.edge, contact.span))
    every = [part for part in comm.allgather(facets) if len(part)]
    if not every:
        raise InputError(
            f"contact: no part of edge '{contact.edge}' lies in its span; move the span"
        )
    facets = EdgeFacets(
        *(np.concatenate([getattr(p, a) for p in every]) for a in ("points", "nodes", "outward"))
    )
    normal = -facets.outward[0] + 0.0
    if np.abs(facets.outward + normal).max() > NORMAL_TOLERANCE:
        raise InputError(f"contact.edge = '{contact.edge}' is not straight; it has to be")
    weights = integrate(facets, lambda points, normals: measure(scene, points))[:, :, 0]
    node, first, inverse = np.unique(facets.nodes.ravel(), return_index=True, return_inverse=True)
    points = facets.points.reshape(-1, 2)[first]
    weight = np.bincount(inverse.ravel(), weights=weights.ravel()).astype(float)
    x = positions(points, normal, body.centre)
    order = np.argsort(x)
    if scene.axisymmetric:
        # at order 2 the node on the axis has no weight: it gets no contact condition
        order = order[weight[order] > WEIGHT_TOLERANCE * weight.max()]
    node, points, x, weight = node[order], points[order], x[order], weight[order]
    tangent = np.array([normal[1], -normal[0]]) + 0.0

    _check_apart(node, ties, prescribed)
    dofs, places = _held(scene, space, body, ties, prescribed)
    pivot = 0.5 * (points[0] + points[-1])
    constraints = _motions(places, pivot, body.size)[np.arange(len(dofs)), dofs % 2]
    apart = _motions(ties.places, pivot, body.size) - _motions(ties.master_places, pivot, body.size)
    # a body of revolution moves along its axis only
    never = np.vstack([apart.reshape(-1, 3), np.eye(3)[[0, 2] if scene.axisymmetric else []]])
    at_contact = np.isin(dofs // 2, node)
    on_nodes = _motions(points, pivot, body.size)
    modes = np.concatenate([np.einsum("c,nck->nk", axis, on_nodes) for axis in (tangent, normal)])
    found = ContactNodes(
        x=x,
        points=points,
        node=node,
        tangent=tangent,
        normal=normal,
        weight=weight,
        held=_held_at_contact(dofs[at_contact], node, tangent, normal),
        rigid=_scaled(modes @ _left(np.vstack([constraints, never]))),
        null=_scaled(modes @ _left(np.vstack([constraints[~at_contact], never]))),
    )
    return found, np.union1d(dofs[~at_contact], tied_dofs(ties))


def _check_apart(node: Ints, ties: Ties, prescribed: Iterable[Prescribed]) -> None:
    """Raise where a contact node follows a platen, or a displacement other than zero."""
    moved = [part.dofs[part.values != 0.0] // 2 for part in prescribed]
    if np.isin(node, np.concatenate([ties.slaves, ties.masters, *moved])).any():
        raise InputError(
            "load: its platen or prescribed displacement takes along a contact node; restrict it "
            "by a span that ends before the contact edge"
        )


def _held(
    scene: Scene,
    space: fem.FunctionSpace,
    body: BodyMesh,
    ties: Ties,
    prescribed: Iterable[Prescribed],
) -> tuple[Ints, Array]:
    """Return all held degrees of freedom, sorted, and their nodes' places (n, 2); on every rank."""
    comm = body.mesh.comm
    near = POSITION_TOLERANCE * body.size
    start, end = space.dofmap.index_map.local_range

    def search() -> list[tuple[Ints, Array, tuple[int, ...]]]:
        found = []
        coordinates = space.tabulate_dof_coordinates()[: end - start, :2]
        if scene.axisymmetric:
            r = coordinates[:, 0]
            if r.min(initial=0.0) < -near:
                raise InputError(
                    f"body: a node has r = x = {r.min():g}; an axisymmetric body lies at x >= 0"
                )
            at = np.flatnonzero(r <= near)
            found.append((start + at.astype(np.int64), coordinates[at], AXES["x"]))
        elif body.half:
            facets = edge_facets(space, body, "axis")
            found.append((facets.nodes.ravel(), facets.points.reshape(-1, 2), AXES["x"]))
        for support in scene.supports:
            if support.fix not in AXES:
                raise InputError(
                    f'support.fix = \'{support.fix}\' is unknown; use "x", "y" or "xy"'
                )
            if support.edge is not None:
                facets = edge_facets(space, body, support.edge)
                found.append(
                    (facets.nodes.ravel(), facets.points.reshape(-1, 2), AXES[support.fix])
                )
            elif support.point is not None:
                at = np.flatnonzero(np.hypot(*(coordinates - np.array(support.point)).T) <= near)
                found.append((start + at.astype(np.int64), coordinates[at], AXES[support.fix]))
            else:
                raise InputError("support: it has neither edge nor point; give one")
        return found

    parts = comm.allgather(on_all(comm, search))
    for k, support in enumerate(scene.supports, start=int(body.half or scene.axisymmetric)):
        mirrored = (body.half and not scene.axisymmetric) and (
            support.edge == "left" or (support.point is not None and support.point[0] < -near)
        )
        if not mirrored and not any(len(part[k][0]) for part in parts):
            raise InputError(
                f"support at {support.edge or support.point}: no node lies there; move it"
            )
    dofs = [np.empty(0, dtype=np.int64)]
    places = [np.empty((0, 2))]
    if scene.axisymmetric:
        # a rigid ring cannot widen
        dofs.append(2 * ties.masters)
        places.append(ties.master_places)
    for part in parts:
        for numbers, points, axes in part:
            for axis in axes:
                dofs.append(2 * numbers + axis)
                places.append(points)
    numbers = np.concatenate(dofs)
    leaders = 2 * ties.leader(numbers // 2) + numbers % 2
    moved = [part.dofs[part.values != 0.0] for part in prescribed]
    if np.isin(leaders, np.concatenate([np.empty(0, dtype=np.int64), *moved])).any():
        raise InputError(
            "load: its displacement moves a node that a support, symmetry or the axis holds; "
            "restrict it by a span, or drop the support"
        )
    leaders = np.concatenate([leaders, *(part.dofs for part in prescribed)])
    places += [part.places for part in prescribed]
    unique, first = np.unique(leaders, return_index=True)
    return unique, np.concatenate(places)[first]


def _held_at_contact(dofs: Ints, node: Ints, tangent: Array, normal: Array) -> NDArray[np.bool_]:
    """Return (2N,) flags [v; w] of the held degrees of freedom of contact nodes."""
    n = len(node)
    place = {int(number): i for i, number in enumerate(node)}
    held = np.zeros(2 * n, dtype=bool)
    axes: dict[int, set[int]] = {}
    for dof in dofs:
        axes.setdefault(place[int(dof // 2)], set()).add(int(dof % 2))
    for i, fixed in axes.items():
        for k, direction in enumerate((tangent, normal)):
            held[k * n + i] = (
                len(fixed) == 2 or abs(direction[next(iter(fixed))]) > 1.0 - NORMAL_TOLERANCE
            )
        if not (held[i] or held[n + i]):
            raise InputError(
                'support: it holds a contact node obliquely to its edge; fix "xy" or move it'
            )
    return held


def _motions(points: Array, pivot: Array, size: float) -> Array:
    """Return (n, 2, 3) displacements of points moved right, up, and about a pivot."""
    motions = np.zeros((len(points), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, 0, 2] = -(points[:, 1] - pivot[1]) / size
    motions[:, 1, 2] = (points[:, 0] - pivot[0]) / size
    return motions


def _left(constraints: Array) -> Array:
    """Return (3, n) motions on which all constraints (m, 3) vanish, in echelon form."""
    _, values, right = np.linalg.svd(
        np.vstack([constraints, np.zeros((3, 3))]), full_matrices=False
    )
    basis = right[int(np.sum(values > MOTION_TOLERANCE * max(1.0, values[0]))) :]
    row = 0
    for column in range(3):
        if row == len(basis):
            break
        best = row + int(np.argmax(np.abs(basis[row:, column])))
        if abs(basis[best, column]) > MOTION_TOLERANCE:
            basis[[row, best]] = basis[[best, row]]
            basis[row] /= basis[row, column]
            for other in range(len(basis)):
                if other != row:
                    basis[other] -= basis[other, column] * basis[row]
            row += 1
    return np.where(np.abs(basis) > MOTION_TOLERANCE, basis, 0.0).T


def _scaled(modes: Array) -> Array:
    """Return modes with largest entry 1."""
    if modes.shape[1] == 0:
        return modes
    return modes / np.abs(modes).max(axis=0)
