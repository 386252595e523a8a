"""Contact nodes of a body, and its constraints: supports, platens, prescribed displacements.

The linear constraints are u = P u' + sum_k lambda_k d_k. Each determines one degree of freedom
(dof). It is *given*, zero by a support, by symmetry or on the axis, and d_k under a load that
prescribes a displacement; or it *follows* another one, as the nodes of a platen (an edge that moves
rigidly without rotation) follow one of them. With u' zero at the dofs that follow, the stiffness
becomes P^T A P and nodal forces P^T f: an exact elimination that adds no unknowns. A dof that is
given and follows another one gives that one.

Where a platen touches the contact, its nodes follow the contact node, whose conditions of contact
thus act on the whole platen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from scipy import sparse

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.loads import (
    edge_nodes,
    integrate,
    measure,
    profile_values,
    tagged_facets,
)
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.raw_mesh import Line
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.model import FREE, Scene


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
    """Find contact nodes and constraints of a body; springs resist (m, 3) motions; collective."""
    edges = []
    for contact in body.contacts:
        on_edge = tagged_facets(space, body, (contact.tag,))
        weights = integrate(on_edge, lambda points, normals: measure(scene, points))[:, :, 0]
        own, first, inverse = np.unique(on_edge.nodes, return_index=True, return_inverse=True)
        points = on_edge.points.reshape(-1, 2)[first]
        weight = np.bincount(inverse.ravel(), weights=weights.ravel()).astype(float)
        x = contact.line.along(points) + 0.0
        order = np.argsort(x)
        if scene.axisymmetric and not contact.tie:
            # at order 2 the node on the axis has no weight: it gets no contact condition
            order = order[weight[order] > 1e-9 * weight.max()]
        edges.append((own[order], points[order], x[order], weight[order], on_edge.nodes))
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


# -- constraints ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Constraints:
    """The constraints of a body, alike on every rank."""

    # slaves, masters: (n,) dofs that follow, sorted, and the dof that each follows
    slaves: Ints
    masters: Ints
    given: Ints  # (m,) dofs of u' that are given, sorted; none of them follows
    prescribed: dict[str, Array]  # by the name of the load, (m,) their value with factor 1
    rows: Array  # (m, 3) components of the rigid motions at the given dofs
    tied: Array  # (k, 3) combinations of the rigid motions that platens exclude

    def matrix(self, stiffness: PETSc.Mat) -> PETSc.Mat | None:
        """Return P, with zeros on its diagonal for that of P^T A P; None where nothing follows."""
        if not len(self.slaves):
            return None
        start, end = stiffness.getOwnershipRange()
        dofs = np.arange(start, end)
        leaders = _leader(self.slaves, self.masters, dofs)
        follows = dofs != leaders
        rows = np.concatenate([dofs, dofs[follows]])
        columns = np.concatenate([dofs, leaders[follows]])
        values = np.concatenate([np.where(follows, 0.0, 1.0), np.ones(follows.sum())])
        local = sparse.csr_matrix(
            (values, (rows - start, columns)), (end - start, stiffness.getSize()[1])
        )
        csr = *(part.astype(PETSc.IntType) for part in (local.indptr, local.indices)), local.data
        P = PETSc.Mat().createAIJ(stiffness.getSizes(), csr=csr, comm=stiffness.comm)
        P.assemble()
        return P


def _leader(slaves: Ints, masters: Ints, dofs: Ints) -> Ints:
    """Return the dof that each dof follows, or itself."""
    if not len(slaves):
        return dofs
    at = np.minimum(np.searchsorted(slaves, dofs), len(slaves) - 1)
    return np.where(slaves[at] == dofs, masters[at], dofs)


class _Nodes:
    """Nodes of a body that are constrained, and where they lie."""

    def __init__(self, scene: Scene, space: fem.FunctionSpace, body: BodyMesh) -> None:
        self.scene, self.space, self.body = scene, space, body
        self.places = np.full((space.dofmap.index_map.size_global, 2), np.nan)

    def put(self, nodes: Ints, places: Array) -> tuple[Ints, Array]:
        """Keep where nodes lie, and return them."""
        self.places[nodes] = places
        return nodes, places

    def on_edge(self, edge: str, span: tuple[float, float] | None) -> tuple[Ints, Array]:
        """Return the nodes of an edge and their places; collective."""
        return self.put(*edge_nodes(self.space, self.body, edge, span))

    def components(self, dofs: Ints) -> Array:
        """Return the components (n, 3) of the rigid motions at degrees of freedom."""
        moving = motions(self.places[dofs // 2], self.body.pivot, self.body.size)
        return moving[np.arange(len(dofs)), dofs % 2]


def find_constraints(
    scene: Scene, space: fem.FunctionSpace, body: BodyMesh, contact: Ints
) -> Constraints:
    """Find all constraints of a body, also those of the nodes on contact edges; collective."""
    nodes = _Nodes(scene, space, body)
    slaves, masters = _platens(nodes, contact)
    held = _held(nodes)
    if scene.axisymmetric:
        # a rigid ring cannot widen
        held = np.concatenate([masters[masters % 2 == 0], held])
    held = _leader(slaves, masters, held)
    moved = {}
    for name, (every, values) in _displacements(nodes).items():
        dofs = _leader(slaves, masters, every)
        own, first, inverse = np.unique(dofs, return_index=True, return_inverse=True)
        differs = np.abs(values - values[first][inverse])
        against = np.isin(dofs, held) & (values != 0.0)
        # equal to round-off where the same profile is evaluated twice
        if differs.max() > 1e-12 * np.abs(values).max():
            x, y = nodes.places[every[np.argmax(differs)] // 2]
            raise InputError(
                f"load '{name}' displacement: has two values at ({x:g}, {y:g}), of two edges or "
                "on a platen, which moves without rotation; give equal numbers"
            )
        if against.any():
            x, y = nodes.places[every[np.argmax(against)] // 2]
            raise InputError(
                f"load '{name}': its displacement moves the node at ({x:.6g}, {y:.6g}), which a "
                "support, symmetry or the axis holds; restrict it by a span, or drop the support"
            )
        moved[name] = own, values[first]
    given = np.unique(np.concatenate([held, *(dofs for dofs, _ in moved.values())]))
    prescribed = {name: np.zeros(len(given)) for name in moved}
    for name, (dofs, values) in moved.items():
        prescribed[name][np.searchsorted(given, dofs)] = values
    tied = nodes.components(slaves) - nodes.components(masters)
    return Constraints(slaves, masters, given, prescribed, nodes.components(given), tied)


def _platens(nodes: _Nodes, contact: Ints) -> tuple[Ints, Ints]:
    """Return the dofs of platens that follow, sorted, and the one that each follows."""
    # loads on the same edge and span share a platen
    names: dict[tuple[str, tuple[float, float] | None], str] = {}
    for load in nodes.scene.loads:
        if load.platen:
            names.setdefault((load.edge, load.span), load.name)
    taken: dict[int, str] = {}
    slaves, masters = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for (edge, span), name in names.items():
        own, places = nodes.on_edge(edge, span)
        for node in own.tolist():
            if node in taken:
                raise InputError(
                    f"load '{name}': its platen on '{edge}' meets that of load '{taken[node]}'; "
                    "give both the same edge and span, or a span that leaves a gap between them"
                )
        taken |= dict.fromkeys(own.tolist(), name)
        touches = np.flatnonzero(np.isin(own, contact))
        if len(touches) > 1:
            ends = sorted(places[touches].tolist())
            at = " and ".join(f"({x:.6g}, {y:.6g})" for x, y in (ends[0], ends[-1]))
            raise InputError(
                f"load '{name}': its platen on '{edge}' joins contact nodes, as those at {at}; "
                "restrict it by a span, or give it a pressure or traction instead"
            )
        master = touches[0] if len(touches) else 0
        follow = np.delete(own, master)
        slaves.append((2 * follow[:, None] + np.arange(2)).ravel())
        masters.append(np.tile(2 * own[master] + np.arange(2), len(follow)))
    order = np.argsort(np.concatenate(slaves))
    return np.concatenate(slaves)[order], np.concatenate(masters)[order]


def _displacements(nodes: _Nodes) -> dict[str, tuple[Ints, Array]]:
    """Return the dofs that each load prescribes, and their values, by the load's name."""
    found: dict[str, tuple[Ints, Array]] = {}
    for load in nodes.scene.loads:
        if load.displacement is None:
            continue
        own, places = nodes.on_edge(load.edge, load.span)
        parts = [found[load.name]] if load.name in found else []
        axes = [axis for axis, part in enumerate(load.displacement) if part != FREE]
        if not axes:
            raise InputError(
                f"load '{load.name}' displacement: is free in both directions; give one"
            )
        for axis in axes:
            values = profile_values(load, nodes.body, load.displacement[axis], places)
            parts.append((2 * own + axis, values))
        dofs, values = map(np.concatenate, zip(*parts, strict=True))
        found[load.name] = dofs, values
    return found


def _held(nodes: _Nodes) -> Ints:
    """Return the dofs that symmetry or the axis holds, then those of each support; collective."""
    scene, body = nodes.scene, nodes.body
    near = POSITION_TOLERANCE * body.size

    def on_axis(places: Array) -> NDArray[np.bool_]:
        r = places[:, 0]
        if r.min(initial=0.0) < -near:
            raise InputError(
                f"body: a node has r = x = {r.min():g}; an axisymmetric body lies at x >= 0"
            )
        return r <= near

    found = [np.empty(0, dtype=np.int64)]
    if scene.axisymmetric:
        found.append(2 * nodes.put(*find_nodes(nodes.space, on_axis))[0])
    elif body.half:
        found.append(2 * nodes.on_edge("axis", None)[0])
    for support in scene.supports:
        if support.edge is not None:
            own, _ = nodes.on_edge(support.edge, None)
        else:
            own, _ = nodes.put(*nodes_at(nodes.space, body, support.point or ""))
        if not len(own) and scene.body.mesh is not None:
            raise MeshMisfit(
                f"support at {support.edge or support.point}: no node lies there; move it"
            )
        found += [2 * own + "xy".index(axis) for axis in support.fix]
    return np.concatenate(found)


def find_nodes(
    space: fem.FunctionSpace, chosen: Callable[[Array], NDArray[np.bool_]]
) -> tuple[Ints, Array]:
    """Return numbers and places (n, 2) of the nodes whose places are chosen; collective."""
    start, end = space.dofmap.index_map.local_range
    places = space.tabulate_dof_coordinates()[: end - start, :2]
    at = np.flatnonzero(on_all(space.mesh.comm, lambda: chosen(places))).astype(np.int64)
    parts = space.mesh.comm.allgather((start + at, places[at]))
    nodes, places = map(np.concatenate, zip(*parts, strict=True))
    return nodes, places


def nodes_at(
    space: fem.FunctionSpace, body: BodyMesh, point: tuple[float, float] | str
) -> tuple[Ints, Array]:
    """Return the nodes at a point, or at those of a named group, and their places; collective."""
    if isinstance(point, tuple):
        points = np.array([point])
    elif point in body.spots:
        points = body.spots[point]
    else:
        declare = f'declare Physical Point("{point}")'
        hint = suggestion(point, sorted(body.spots)) if body.spots else declare
        raise InputError(f"point: the mesh has no group of points '{point}'; {hint}")

    def at_one(places: Array) -> NDArray[np.bool_]:
        apart = np.linalg.norm(places[:, None] - points, axis=2).min(axis=1)
        return np.asarray(apart <= POSITION_TOLERANCE * body.size)

    return find_nodes(space, at_one)
