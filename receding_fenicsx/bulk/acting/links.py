r"""Springs between parallel edges of two bodies.

With $J = u_1 - u_2$ the displacement of the edge relative to the point straight across, and $d$ the
edge's normal $n$ or tangent $t$, they have the energy $\frac{1}{2} \int k_d (J \cdot d)^2 dA$. On
the mesh $J \cdot d$ is projected on the shape functions $N_i$ of the edge: with
$D_i = \int N_i\, J \cdot d \, dA$ and $M_{ij} = \int N_i N_j \, dA$ the energy is
$\frac{1}{2} k_d D^T M^{-1} D$. So the unit loads $N_i d$ on the edge and $-N_i d$ across, of which
$D$ are the work-conjugates, have the factors $F = -k_d M^{-1} D$. Condensed,
$D = C_{ss} F + C_{sl} \lambda - R u$, and

$$F = T \lambda + G u , \quad G = \kappa R , \quad T = -\kappa C_{sl} , \quad
\kappa = (M / k_d + C_{ss})^{-1} .$$
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from petsc4py import PETSc

import numpy as np
from scipy.linalg import block_diag

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.acting.bolts import without_lengthening
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.edges import EdgeFacets, edge_facets, measure, shape_functions
from receding_fenicsx.bulk.join_bodies import JoinedBodies
from receding_fenicsx.bulk.mesh.curved_edges import gauss
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene, Spring

NAME = "[[spring]] "
"""Beginning of the names of the unit loads, which no load of a scene has."""
PARALLEL = 1e-9
"""Difference of unit normals, and distance over the edge's length, that is round-off."""


def add_links(scene: Scene, parts: Sequence[Bulk]) -> Array:
    """Append the unit loads of all springs between two bodies to these; collective.

    Returns:
        M / k_d (m, m) of the m unit loads, on every rank.

    Raises:
        InputError: the edges are not straight, parallel and opposite to each other.
    """
    blocks: list[Array] = []
    for spring in (part for part in scene.springs if part.against is not None):
        names = [scene.find_edge(edge) for edge in (spring.edge, spring.against or "")]
        own = [next(p for p in parts if p.scene.body.name == body.name) for body, _ in names]
        spans = (spring.span, None)
        facets = [
            _gathered(part, name, span)
            for part, (_, name), span in zip(own, names, spans, strict=True)
        ]
        nodes, mass, across = _integrals(scene, spring, *facets)
        normal = facets[0].outward[0]
        tangent = np.array([-normal[1], normal[0]])
        for k, d in ((spring.normal, normal), (spring.tangential, tangent)):
            if k > 0.0:
                blocks.append(mass / k)
                for i in range(len(mass)):
                    name = f"{NAME}{sum(map(len, blocks[:-1])) + i}"
                    _append(own[0], name, nodes[0], np.outer(mass[i], d))
                    _append(own[1], name, nodes[1], -np.outer(across[i], d))
    return np.asarray(block_diag(*blocks)) if blocks else np.zeros((0, 0))


def _gathered(part: Bulk, edge: str, span: tuple[float, float] | None) -> EdgeFacets:
    """Return all facets of an edge, on every rank."""
    comm = part.body.mesh.comm
    found = on_all(comm, lambda: edge_facets(part.space, part.body, edge, span))
    every = [facets for facets in comm.allgather(found) if len(facets)]
    keys = ("points", "nodes", "outward")
    return EdgeFacets(*(np.concatenate([getattr(f, key) for f in every]) for key in keys))


def _integrals(
    scene: Scene, spring: Spring, a: EdgeFacets, b: EdgeFacets
) -> tuple[tuple[Ints, Ints], Array, Array]:
    """Return the nodes of both edges, int N_i N_j dA (m, m) and int N_i N_j across (m, m_b)."""
    normal = a.outward[0]
    tangent = np.array([-normal[1], normal[0]])
    start, end = a.points[:, 0], a.points[:, 1]
    bent = np.abs(np.vstack([a.outward - normal, b.outward + normal])).max()
    size = float(np.ptp(a.points.reshape(-1, 2), axis=0).max())
    away = (b.points[0, 0] - start[0]) @ normal < -PARALLEL * size
    if bent > PARALLEL or away:
        raise InputError(
            f"[[spring]] against: '{spring.edge}' and '{spring.against}' have to be straight, "
            "parallel and turned towards each other"
        )
    s, weight = gauss()
    shape = shape_functions(a.nodes.shape[1])
    points = (start[:, None] + s[:, None] * (end - start)[:, None]).reshape(-1, 2)
    share = np.outer(np.hypot(*(end - start).T), weight).ravel() * measure(scene, points)[:, 0]
    first, last = (b.points[:, k] @ tangent for k in (0, 1))
    place = (points @ tangent)[:, None]
    xi = (place - first) / (last - first)
    facet = np.argmin(np.abs(xi - 0.5), axis=1)
    xi = xi[np.arange(len(xi)), facet]
    if np.any(np.abs(xi - 0.5) > 0.5 + PARALLEL):
        x, y = points[np.argmax(np.abs(xi - 0.5))]
        raise InputError(
            f"[[spring]] against: '{spring.against}' has no point straight across ({x:g}, {y:g}) "
            f"of '{spring.edge}'; give a span"
        )
    apart = np.abs((b.points[facet, 0] - points) @ normal).max()
    if spring.tangential > 0.0 and apart > PARALLEL * size:
        raise InputError(
            f"[[spring]] tangential: '{spring.edge}' and '{spring.against}' are {apart:g} apart, "
            "where forces along them would not balance in moment; put them on each other"
        )
    nodes_a, column_a = np.unique(a.nodes, return_inverse=True)
    nodes_b, column_b = np.unique(b.nodes, return_inverse=True)
    N = np.zeros((len(points), len(nodes_a)))
    N_b = np.zeros((len(points), len(nodes_b)))
    rows = np.arange(len(points))[:, None]
    N[rows, np.repeat(column_a.reshape(a.nodes.shape), len(s), axis=0)] = np.tile(
        shape.T, (len(a), 1)
    )
    N_b[rows, column_b.reshape(b.nodes.shape)[facet]] = shape_functions(b.nodes.shape[1], xi).T
    return (nodes_a, nodes_b), N.T * share @ N, N.T * share @ N_b


def _append(part: Bulk, name: str, nodes: Ints, forces: Array) -> None:
    """Append a load with forces (n, 2) at nodes (n,) to a body."""
    vector = part.stiffness.createVecLeft() if part.ties is None else part.ties.createVecLeft()
    vector.set(0.0)
    if part.comm.rank == 0:
        rows = (2 * nodes[:, None] + np.arange(2)).ravel().astype(PETSc.IntType)
        vector.setValues(rows, forces.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
    vector.assemble()
    if part.ties is not None:
        untied, vector = vector, part.stiffness.createVecLeft()
        part.ties.multTranspose(untied, vector)
        untied.destroy()
    part.loads.append(vector)
    part.load_names = (*part.load_names, name)


def with_links(joined: JoinedBodies, soft: Array) -> JoinedBodies:
    """Return joined bodies in which the last loads have the factors of springs between them.

    Args:
        joined: the bodies, with the unit loads.
        soft: M / k_d, from :func:`add_links`.
    """
    n = len(joined.r_star) - len(soft)
    C, R = joined.compliance, joined.r_star[n:]
    kappa = np.linalg.inv(soft + C[n:, n:])
    G, T = kappa @ R, -kappa @ C[n:, :n]
    K = joined.K + R.T @ G
    rest, rest_load = joined.rest
    return replace(
        joined,
        K=0.5 * (K + K.T),
        r_star=joined.r_star[:n] + T.T @ R,
        compliance=C[:n, :n] + C[:n, n:] @ T,
        sign=joined.sign[:n],
        rigid=without_lengthening(joined.rigid, R),
        rest=(rest + rest_load[:, n:] @ G, rest_load[:, :n] + rest_load[:, n:] @ T),
        links=(T, G),
    )
