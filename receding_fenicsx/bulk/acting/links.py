r"""Springs between parallel edges of two bodies.

With $J = u_1 - u_2$ the displacement of the edge relative to the point straight across, and $d$ the
edge's normal $n$ or tangent $t$, they have the energy $\frac{1}{2} \int k_d (J \cdot d)^2 dA$. With
the shape functions $N_i$ of the edge, whose nodes are those across,
$D_i = \int N_i\, J \cdot d \, dA$ and $M_{ij} = \int N_i N_j \, dA$ it is
$\frac{1}{2} k_d D^T M^{-1} D$. So the unit loads $N_i d$ on the edge and $-N_i d$ across, of which
$D$ are the work-conjugates, have the factors $F = -k_d M^{-1} D$, as bolts have without tightening
(:mod:`~receding_fenicsx.bulk.acting.bolts`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

from petsc4py import PETSc

import numpy as np
from scipy.linalg import block_diag

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.acting.bolts import closed, without_lengthening
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.edges import edge_facets, edge_nodes, facet_mass
from receding_fenicsx.bulk.join_bodies import JoinedBodies
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Scene, Spring

NAME = "[[spring]] "
"""Beginning of the names of the unit loads, which no load of a scene has."""
STRAIGHT = 1e-9
"""Difference of unit normals, and distance over the edge's length, that is round-off."""


def add_links(scene: Scene, parts: Sequence[Bulk]) -> Array:
    """Append the unit loads of all springs between two bodies to these; collective.

    Returns:
        M / k_d (m, m) of the m unit loads, on every rank.

    Raises:
        InputError: the first edge is not straight, or the nodes of the other one do not match.
    """
    blocks: list[Array] = []
    number = count()
    for spring in (part for part in scene.springs if part.against is not None):
        named = [scene.find_edge(edge) for edge in (spring.edge, spring.against or "")]
        a, b = (next(p for p in parts if p.scene.body.name == body.name) for body, _ in named)
        nodes, places = edge_nodes(a.space, a.body, named[0][1], spring.span)
        mass, normal = _mass(a, named[0][1], spring, nodes)
        others, beyond = edge_nodes(b.space, b.body, named[1][1], None)
        others = others[_across(spring, places, beyond, normal)]
        tangent = np.array([-normal[1], normal[0]])
        for k, d in ((spring.normal, normal), (spring.tangential, tangent)):
            for row in mass if k > 0.0 else ():
                name = f"{NAME}{next(number)}"
                _append(a, name, nodes, np.outer(row, d))
                _append(b, name, others, -np.outer(row, d))
            blocks += [mass / k] if k > 0.0 else []
    return np.asarray(block_diag(*blocks)) if blocks else np.zeros((0, 0))


def _mass(part: Bulk, edge: str, spring: Spring, nodes: Ints) -> tuple[Array, Array]:
    """Return int N_i N_j dA of the nodes of an edge, and its outward normal, on every rank."""
    comm = part.body.mesh.comm
    facets = on_all(comm, lambda: edge_facets(part.space, part.body, edge, spring.span))
    matrix = np.zeros((len(nodes), len(nodes)))
    rows = np.searchsorted(nodes, facets.nodes)
    np.add.at(matrix, (rows[:, :, None], rows[:, None]), facet_mass(part.scene, facets))
    normals = np.concatenate(comm.allgather(facets.outward))
    if np.abs(normals - normals[0]).max() > STRAIGHT:
        raise InputError(f"[[spring]] against: '{spring.edge}' is not straight")
    return comm.allreduce(matrix), normals[0]


def _across(spring: Spring, places: Array, beyond: Array, normal: Array) -> Ints:
    """Return which of the nodes beyond are straight across from the nodes of an edge."""
    size = float(np.ptp(places, axis=0).max())
    offset = beyond - places[:, None]
    aside = np.abs(offset @ [-normal[1], normal[0]])
    found = np.argmin(aside, axis=1)
    worst = int(np.argmax(aside.min(axis=1)))
    gap = offset[np.arange(len(found)), found] @ normal
    if aside[worst].min() > STRAIGHT * size or gap.min() < -STRAIGHT * size:
        x, y = places[worst]
        raise InputError(
            f"[[spring]] against: '{spring.against}' has no node straight across from the one of "
            f"'{spring.edge}' at ({x:g}, {y:g}); give a span, or both edges the same nodes"
        )
    if spring.tangential > 0.0 and gap.max() > STRAIGHT * size:
        raise InputError(
            f"[[spring]] tangential: '{spring.edge}' and '{spring.against}' are {gap.max():g} "
            "apart, where forces along them would not balance in moment; put them on each other"
        )
    return found


def _append(part: Bulk, name: str, nodes: Ints, forces: Array) -> None:
    """Append a load with forces (n, 2) at nodes (n,) to a body."""
    vector = part.stiffness.createVecLeft() if part.ties is None else part.ties.createVecLeft()
    vector.set(0.0)
    if part.comm.rank == 0:
        rows = (2 * nodes[:, None] + np.arange(2)).ravel().astype(PETSc.IntType)
        vector.setValues(rows, forces.ravel())
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
    at, labels = np.arange(n, n + len(soft)), ["[[spring]]"] * len(soft)
    T, G = closed(joined.compliance, joined.r_star, at, soft, labels)
    T = T[:, :n]
    K = joined.K + joined.r_star.T @ G
    rest, rest_load = joined.rest
    return replace(
        joined,
        K=0.5 * (K + K.T),
        r_star=T.T @ joined.r_star,
        compliance=(joined.compliance @ T)[:n],
        sign=joined.sign[:n],
        rigid=without_lengthening(joined.rigid, joined.r_star[n:]),
        rest=(rest + rest_load @ G, rest_load @ T),
        links=(T[n:], G[n:]),
    )
