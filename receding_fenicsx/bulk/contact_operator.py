r"""Contact operator: relative displacements of two sides whose nodes need not match (mortar).

The contact points are the nodes of the slave side. With its shape functions $N_i$, the dual ones
$\psi_i$, $\int \psi_i N_j \, dA = \delta_{ij} m_i$ and $m_i = \int N_i \, dA$, and the shape
functions $N_j^m$ of the master side,

$$u_i = u_{s,i} - \sum_j \Pi_{ij} u_{m,j}, \qquad
  \Pi_{ij} = \frac{1}{m_i} \int \psi_i N^m_j \, dA ,$$

and the master carries $-\Pi^T r$. $\Pi$ is the identity where nodes match. On straight edges
$\Pi x_m = x_s$: rigid motions move nothing, and resultants and moments are kept. On curved edges,
whose chords lie apart, the point turns with the master about $\Pi x_m$: the rotation of the two
outermost master nodes of the row times $x_s - \Pi x_m$ is added, which restores both.

**Edges that meet.** A node of two edges has two normals and only two freedoms. It is no contact
point; its dual function is given to its neighbours along each edge, so that constants stay exact:
a neighbour $i$ of such a node $c$ has the weight $m_i + m_c$ and the displacement
$(m_i u_i + m_c u_c) / (m_i + m_c)$.

A tie is a contact whose relative displacement is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.contact_nodes import ContactNodes, ContactSide, tangent_of
from receding_fenicsx.bulk.loads import shape_functions
from receding_fenicsx.bulk.mesh.raw_mesh import gauss
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import sides_of_body


@dataclass(frozen=True)
class ContactPoints:
    """The points of all contacts, alike on every rank, sorted along each edge."""

    x: Array  # (N,) position along the edge from its middle; increasing on each edge
    edge: Ints  # (N,) number of the contact, not decreasing
    points: Array  # (N, 2) coordinates
    # tangent, normal: (N, 2) unit vectors t and n, n into the first body
    tangent: Array
    normal: Array
    # (N,) integral of the shape functions over the modelled edge, axisymmetric times r
    weight: Array
    # (2N,) relative displacements [v; w] that symmetry or supports hold on both sides
    held: NDArray[np.bool_]


@dataclass(frozen=True)
class Relative:
    """Relative displacements, u = sum_b on[b] u_b, of contact points, then of tied points."""

    on: tuple[sparse.csr_matrix, ...]  # (rows, 2N_b) of each body
    size: int  # 2N, the number of rows [v; w] of contact points, which come first
    joint: Ints  # (rows,) number of the contact, or of the tie after all contacts
    slave: Ints  # (joints,) number of the body that the points belong to; -1 where both sides match
    links: tuple[frozenset[int], ...]  # numbers of the contacts and ties of each body
    places: Array  # (rows, 2) coordinates of the points

    def of(self, rows: NDArray[np.bool_]) -> Relative:
        """Return some of the rows."""
        on = tuple(G[rows] for G in self.on)
        size = int(rows[: self.size].sum())
        return replace(self, on=on, size=size, joint=self.joint[rows], places=self.places[rows])

    def held(self, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which rows hold no freedom that is not held (n,), of all bodies."""
        coo = sparse.hstack(self.on).tocoo()
        return np.bincount(coo.row, weights=~held[coo.col], minlength=len(self.joint)) == 0


def eliminate(
    relative: Relative, held: NDArray[np.bool_], diagonal: Sequence[Array]
) -> tuple[sparse.csr_matrix, sparse.csr_matrix, Ints, NDArray[np.bool_]]:
    """Solve u = sum_b G_b u_b for the displacements of all bodies, each row by one freedom.

    Ties come first, one after the other, as several may meet in a node. ``held`` (n,) are freedoms
    of one body after the other, ``diagonal`` that of the stiffness of each: of matching nodes those
    of the softer side are solved for. Returned are A and Y of u_b = A u + Y y, the freedoms (m,)
    that y are, and the rows that are held.
    """
    n = len(held)
    owner = np.repeat(np.arange(len(diagonal)), [len(part) for part in diagonal])
    # infinite where a body is not on the joint
    stiffness = np.full((len(diagonal), len(relative.slave)), np.inf)
    for body, (G, values) in enumerate(zip(relative.on, diagonal, strict=True)):
        coo = G.tocoo()
        for joint in relative.links[body]:
            used = np.unique(coo.col[relative.joint[coo.row] == joint])
            stiffness[body, joint] = values[used].sum()
    every = sparse.hstack(relative.on).tocsr()
    stuck = relative.held(held)
    tied = np.unique(relative.joint[relative.size :])
    stages = [np.flatnonzero((relative.joint == k) & ~stuck) for k in tied]
    A, Y = sparse.csr_matrix((n, len(relative.joint))), sparse.identity(n, format="csr")
    fixed, left = held.copy(), np.ones(n)
    for stage in (*stages, np.arange(relative.size)):
        G = (every[stage] @ Y).tocsr()
        # ties that close a ring around a node say the same twice
        G.data[np.abs(G.data) < 1e-12] = 0.0
        G.eliminate_zeros()
        coo = G.tocoo()
        row, column, value = coo.row, coo.col, coo.data
        free = ~fixed[column]
        alone = np.bincount(column[free], minlength=n) == 1
        joint = relative.joint[stage][row]
        slave = relative.slave[joint]
        softness = stiffness[owner[column], joint]
        usable = np.isfinite(softness) & ((slave < 0) | (slave == owner[column]))
        usable &= stuck[stage][row] | (free & alone[column])
        order = np.lexsort((-np.abs(value), value < 0.0, softness, row))
        order = order[usable[order]]
        rows, first = np.unique(row[order], return_index=True)
        missing = np.setdiff1d(row, rows)
        if len(missing):
            x, y = relative.places[stage[missing[0]]]
            raise MeshMisfit(
                f"[[support]]: one or a displacement holds the node at ({x:.6g}, {y:.6g}) of one "
                "side where the nodes of both do not match; hold both sides, or make the other one "
                "the slave"
            )
        pivot, scale = column[order[first]], value[order[first]]
        fixed[pivot], left[pivot] = True, 0.0
        step = sparse.csr_matrix(
            (1.0 / scale, (pivot, stage[rows])), shape=(n, len(relative.joint))
        )
        others = sparse.diags(left)
        A = Y @ step
        Y = Y @ (others - step[:, stage] @ (G @ others))
    rest = np.flatnonzero(~fixed)
    Y = Y.tocsc()[:, rest].tocsr()
    Y.eliminate_zeros()
    return A.tocsr(), Y, rest, stuck


def relative_of(
    scene: Scene, contacts: Sequence[ContactNodes], bodies: Sequence[Scene]
) -> tuple[Relative, ContactPoints]:
    """Return the contact operator of bodies, from the scene of each, and the contact points."""
    numbers = [sides_of_body(scene, part.body) for part in bodies]
    joints: list[list[tuple[int, int, ContactSide]]] = [[] for _ in scene.joints]
    for body, (own, nodes) in enumerate(zip(numbers, contacts, strict=True)):
        for (joint, sign), side in zip(own, nodes.sides, strict=True):
            joints[joint].append((sign, body, side))
    points, slave = [], []
    for k, sides in enumerate(joints):
        sides.sort(key=lambda side: -side[0])
        same, (a, b) = True, (sides[0][2], sides[-1][2])
        if len(sides) > 1:
            # nodes are the same places to a part of the distance of the nearest two
            near = 1e-5 * np.linalg.norm(np.diff(a.points, axis=0), axis=1).min()
            same = len(a.x) == len(b.x)
            same = same and np.linalg.norm(a.points - b.points, axis=1).max() <= near
        if not same and sides[1][2].slave:
            sides.reverse()
        slave.append(-1 if same else sides[0][1])
        points.append(_points(scene, k, contacts, sides, same))
    count = len(scene.contacts)
    x, places, normals, weights, on = zip(*points, strict=True)
    # along t, then n, of contacts, then the same of ties
    every = range(count), range(count, len(points))
    order = [(k, axis) for some in every for axis in (0, 1) for k in some]
    rows = [
        sparse.vstack([on[k][body][axis * len(x[k]) :][: len(x[k])] for k, axis in order]).tocsr()
        for body in range(len(contacts))
    ]
    joint = np.concatenate([np.full(len(x[k]), k) for k, _ in order])
    at = np.concatenate([places[k] for k, _ in order])
    n = sum(map(len, x[:count]))
    links = tuple(frozenset(k for k, _ in own) for own in numbers)
    relative = Relative(tuple(rows), 2 * n, joint, np.array(slave), links, at)
    held = relative.held(np.concatenate([nodes.held for nodes in contacts]))[: 2 * n]
    along, normal, weight = (np.concatenate(part[:count]) for part in (x, normals, weights))
    tangent = tangent_of(normal)
    return relative, ContactPoints(along, joint[:n], at[:n], tangent, normal, weight, held)


def _points(
    scene: Scene,
    joint: int,
    contacts: Sequence[ContactNodes],
    sides: Sequence[tuple[int, int, ContactSide]],
    same: bool,
) -> tuple[Array, Array, Array, Array, list[sparse.csr_matrix]]:
    """Return the points of one contact or tie; of two sides the slave is the first.

    They are x, places, normal and weight as of ``ContactPoints``, and (2n, 2N_b) the relative
    displacements [v; w] from those of each body.
    """
    sign, body, slave = sides[0]
    if same and joint >= len(scene.contacts):
        slave = replace(slave, carries=np.ones(len(slave.x), dtype=bool))
    if slave.carries.all():
        weight, W = slave.weight, sparse.identity(len(slave.x), format="csr")
    else:
        W = _merged(slave, scene.joint_labels[joint])
        weight = np.asarray(W.sum(axis=1)).ravel()
        W.data /= np.repeat(weight, np.diff(W.indptr))
    keep = np.flatnonzero(slave.carries)
    places, normal = W @ slave.points, slave.normal[keep]
    coo = W.tocoo()
    step = slave.x[coo.col] - slave.x[keep][coo.row]
    shift = np.bincount(coo.row, coo.data * step, len(keep))
    # beside the seam of a closed edge the node's own
    shift[coo.row[np.abs(step) > 0.5 * np.ptp(slave.x)]] = 0.0
    without = np.zeros((len(keep), 2), dtype=bool)
    if len(sides) == 1 and not slave.carries.all():
        without = contacts[body].held.reshape(2, -1)[:, slave.node[keep]].T
    elif len(sides) > 1 and not (same and slave.carries.all()):
        without = _held_together(contacts, (body, slave), sides[1][1:], keep)
    # the images of what is beside a plane of symmetry keep the point on it, and turn nothing
    tangent = tangent_of(normal)
    aside = without[:, 0] * np.einsum("pc,pc->p", slave.points[keep] - places, tangent)
    places, shift = places + aside[:, None] * tangent, np.where(without[:, 0], 0.0, shift)

    def displacement(body: int, side: ContactSide, weights: sparse.csr_matrix) -> sparse.csr_matrix:
        at = side.node[weights.indices], weights.indptr
        shape = weights.shape[0], len(contacts[body].node)
        part = sparse.csr_matrix((weights.data, *at), shape)
        return sparse.block_diag((part, part), "csr")

    parts = {body: sign * displacement(body, slave, W)}
    if len(sides) > 1:
        _, other, master = sides[1]
        pi = W if same else (W @ _projection(scene, joint, slave, master)).tocsr()
        parts[other] = -sign * displacement(other, master, pi)
        if not same:
            arm = np.where(without.any(axis=1)[:, None], 0.0, places - pi @ master.points)
            turning = _turning(pi, arm, master, len(contacts[other].node))
            parts[other] = parts[other] - sign * turning
    on = []
    along = sparse.bmat([[sparse.diags(part) for part in axis.T] for axis in (tangent, normal)])
    for b, nodes in enumerate(contacts):
        n, axes = len(nodes.node), (nodes.tangent, nodes.normal)
        turn = sparse.bmat([[sparse.diags(axis[:, i]) for axis in axes] for i in (0, 1)])
        part = parts.get(b, sparse.csr_matrix((2 * len(keep), 2 * n)))
        coo = (along @ part @ turn).tocoo()
        own = (b == body) & (coo.col % n == slave.node[keep][coo.row % len(keep)])
        value = np.where(without.T.ravel()[coo.row] & ~own, 0.0, coo.data)
        # products of unit vectors are 0 or 1 to round-off on straight edges
        value = np.where(np.abs(value) < 1e-15, 0.0, value)
        value = np.where(np.abs(np.abs(value) - 1.0) < 1e-15, np.sign(value), value)
        found = sparse.csr_matrix((value, (coo.row, coo.col)), coo.shape)
        found.eliminate_zeros()
        on.append(found)
    return slave.x[keep] + shift, places, normal, weight, on


def _merged(side: ContactSide, where: str) -> sparse.csr_matrix:
    """Return weights (points, n) of nodes; neighbours share those of a node without contact."""
    n = len(side.x)
    rows, columns, values = list(range(n)), list(range(n)), side.weight.tolist()
    for node in np.flatnonzero(~side.carries):
        near: list[int] = []
        # along each facet, first middles that carry contact
        for facet in side.facets[(side.facets == node).any(axis=1)]:
            ends, middle = facet[:2], facet[2:]
            if node in middle:
                near += list(ends[side.carries[ends]])
            else:
                near += list(middle[side.carries[middle]]) or list(ends[ends != node])
        if not near or not side.carries[near].all():
            x, y = side.points[node]
            raise MeshMisfit(
                f"{where}: the edge has no contact node of its own beside ({x:g}, {y:g}), where it "
                "meets another one or is held; refine it"
            )
        rows, columns = rows + near, columns + [node] * len(near)
        values += [side.weight[node] / len(near)] * len(near)
    W = sparse.csr_matrix((values, (rows, columns)), shape=(n, n))
    return W[np.flatnonzero(side.carries)]


def _projection(
    scene: Scene, joint: int, slave: ContactSide, master: ContactSide
) -> sparse.csr_matrix:
    """Return Pi (n_slave, n_master), integrated over pieces between the vertices of both sides."""
    if min(slave.facets.min(), master.facets.min()) < 0:
        raise InputError(
            f"{scene.joint_labels[joint]}: nodes need to match where the contact begins on the "
            "axis of revolution and elements are of order 2; use degree = 1, or matching meshes"
        )
    at, weight = gauss()
    a, b = np.moveaxis(slave.points[slave.facets[:, :2]], 1, 0)
    c, d = np.moveaxis(master.points[master.facets[:, :2]], 1, 0)
    step, length = b - a, np.linalg.norm(b - a, axis=1)
    across = np.column_stack([-step[:, 1], step[:, 0]]) / length[:, None]
    # of each facet of the master its place on each of the slave, from 0 to 1, and the distance
    from_c, from_d = (
        np.einsum("smc,sc->sm", end - a[:, None], step / length[:, None] ** 2) for end in (c, d)
    )
    off = np.abs(np.einsum("smc,sc->sm", 0.5 * (c + d) - a[:, None], across))
    close = off <= 0.5 * np.maximum(length[:, None], np.linalg.norm(d - c, axis=1))
    low, high = np.minimum(from_c, from_d).clip(0, 1), np.maximum(from_c, from_d).clip(0, 1)
    # shorter pieces are round-off
    pair = np.nonzero(close & (high - low > 1e-9))
    (facet, k), low, high, from_c, from_d = pair, low[pair], high[pair], from_c[pair], from_d[pair]
    covered = np.bincount(facet, high - low, len(a))
    wrong = int(np.argmax(np.abs(covered - 1.0)))
    if abs(covered[wrong] - 1.0) > 1e-8:
        x, y = 0.5 * (a + b)[wrong]
        raise MeshMisfit(
            f"{scene.joint_labels[joint]}: of the facet at ({x:g}, {y:g}) {covered[wrong]:.3g} of "
            "its length lies opposite of the other side; refine that, or restrict the edge by a "
            "span"
        )
    s = low[:, None] + (high - low)[:, None] * at
    nodes = slave.facets.shape[1]
    N = shape_functions(nodes, at)
    if scene.axisymmetric:
        on_facet = weight * (a[:, :1] + at * step[:, :1])
        on_piece = weight * (a[facet, :1] + s * step[facet, :1])
    else:
        on_facet, on_piece = np.tile(weight, (len(a), 1)), np.tile(weight, (len(s), 1))
    mass = np.einsum("iq,jq,sq->sij", N, N, on_facet)
    dual = mass.sum(axis=2)[:, :, None] * np.linalg.inv(mass)
    psi = np.einsum("pij,jpq->ipq", dual[facet], shape_functions(nodes, s))
    at_master = (s - from_c[:, None]) / (from_d - from_c)[:, None]
    on_master = shape_functions(master.facets.shape[1], at_master)
    values = np.einsum("ipq,jpq,pq->pij", psi, on_master, on_piece)
    values *= (length[facet] * (high - low))[:, None, None]
    rows, columns = np.broadcast_arrays(slave.facets[facet][:, :, None], master.facets[k][:, None])
    entries = values.ravel(), (rows.ravel(), columns.ravel())
    pi = sparse.csr_matrix(entries, shape=(len(slave.x), len(master.x)))
    pi.data[np.abs(pi.data) < 1e-14 * np.abs(pi.data).max()] = 0.0
    pi.eliminate_zeros()
    total = np.asarray(pi.sum(axis=1)).ravel()
    # a node on the axis of revolution may have no weight; it lies on one of the master
    on_axis = np.flatnonzero(slave.weight <= 1e-9 * slave.weight.max())
    opposite = cKDTree(master.points).query(slave.points[on_axis])[1]
    total[on_axis] = np.inf
    # translations to round-off
    exact = sparse.csr_matrix((np.ones(len(on_axis)), (on_axis, opposite)), shape=pi.shape)
    return sparse.csr_matrix(sparse.diags(1.0 / total) @ pi + exact)


def _turning(
    pi: sparse.csr_matrix, arm: Array, master: ContactSide, count: int
) -> sparse.csr_matrix:
    """Return (2n, 2 count) displacements [x; y] of points that turn with the master's nodes."""
    found = sparse.lil_matrix((2 * len(arm), 2 * count))
    for point, d in enumerate(arm):
        used = pi.indices[pi.indptr[point] : pi.indptr[point + 1]]
        if len(used) < 2:
            continue  # the point is a node of the master
        at = master.points[used]
        first = int(np.argmax(np.linalg.norm(at - at[0], axis=1)))
        last = int(np.argmax(np.linalg.norm(at - at[first], axis=1)))
        r = at[last] - at[first]
        turn = np.outer([-d[1], d[0]], [-r[1], r[0]]) / (r @ r)
        for end, part in ((first, -turn), (last, turn)):
            node = master.node[used[end]]
            found[np.ix_([point, len(arm) + point], [node, count + node])] = part
    return found.tocsr()


def _held_together(
    contacts: Sequence[ContactNodes],
    slave: tuple[int, ContactSide],
    master: tuple[int, ContactSide],
    keep: Ints,
) -> NDArray[np.bool_]:
    """Return (n, 2) whether the slave's node and the master's one at its place are held in [v; w].

    There the neighbours on both sides do not count, as on a plane of symmetry.
    """
    nodes, others = contacts[slave[0]], contacts[master[0]]
    points, node = slave[1].points, slave[1].node[keep]
    apart, nearest = cKDTree(master[1].points).query(points[keep])
    there = master[1].node[nearest]
    near = apart <= 1e-6 * np.linalg.norm(np.diff(points, axis=0), axis=1).min()
    held, held_there = nodes.held.reshape(2, -1).T[node], others.held.reshape(2, -1).T[there]
    own = np.stack([nodes.tangent, nodes.normal], axis=1)[node]
    axes = np.stack([others.tangent, others.normal], axis=1)[there]
    along = np.abs(np.einsum("nac,nbc->nab", own, axes)) > 1.0 - 1e-10
    together = (along & held_there[:, None]).any(axis=2) | held_there.all(axis=1, keepdims=True)
    return near[:, None] & held & together
