r"""Springs, bolts and prescribed gaps; unit loads that a compliance closes after condensation.

Springs to the ground add their part to $A$ and hold the rigid motions that they resist.

A spring between two places has as its unit load the pair of forces by which it pulls these
together. With unit loads $F$, the compliance $c$ of the springs themselves, tightened by $s$, and
the work-conjugates $D$ of their unit loads (by how much the places approach),

$$c F = s - D ,\quad D = C_{bb} F + C_{bl} \lambda - R u \quad\Rightarrow\quad
  F = \kappa\, (s - C_{bl} \lambda + R u) ,\quad \kappa = (c + C_{bb})^{-1} ,$$

for all at once. The factors of all unit loads are $T \lambda' + G u$ with $s$ in the place of $F$;
$K' = K + r^{*T} G$, $r^{*\prime} = T^T r^*$ and $C' = C T$ follow, and the conjugate of a
shortening is the force $F$. A bolt of stiffness $k$ between two patches has $c = 1 / k$; springs
between two edges, not tightened, have $c = M / k_d$: with $J = u_1 - u_2$ the displacement of an
edge relative to the point straight across on the other body, and $d$ the edge's normal or tangent,
their energy is $\frac{1}{2} \int k_d (J \cdot d)^2 dA = \frac{1}{2} k_d D^T M^{-1} D$ with
$D_i = \int N_i\, J \cdot d \, dA$, $M_{ij} = \int N_i N_j \, dA$ and nodes across, so that the
unit loads $N_i d$ on the edge and $-N_i d$ across have the factors $F = -k_d M^{-1} D$.

What is prescribed with the load factor at the contact itself shifts the displacements: with
$u = u' - S^T \lambda$,

$$r = r^{*T} \lambda + K u = (r^* - S K)^T \lambda + K u' .$$

So a gap $h$ that grows with a load, $g = g_0 + w + \lambda h$, is a load with $S = [0; h]$ whose
$u'$ has the change of the gap as $w$; its conjugate is $-\sum_i h_i P_i$. An interference of depth
$\delta$ is the gap $-\delta$. A parabola that rolls, $(x - s)^2 / 2R$, is the initial gap
$x^2 / 2R$ and the gap $-x / R$ with the factor $s$, but for $s^2 / 2R$, by which the free body
rises. Where a load drives a contact node of one body, the bodies are condensed and joined for the
displacement relative to the prescribed one, and $S$ is what it moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from scipy.linalg import block_diag
from scipy.optimize import linprog

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.contact_nodes import nodes_at
from receding_fenicsx.bulk.contact_operator import ContactPoints
from receding_fenicsx.bulk.join_bodies import JoinedBodies
from receding_fenicsx.bulk.loads import edge_facets, edge_nodes, facet_mass
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import INTERFERENCE, Scene, Spring
from receding_fenicsx.scene.profiles import evaluate_checked


def add_springs(matrix: PETSc.Mat, space: fem.FunctionSpace, body: BodyMesh, scene: Scene) -> Array:
    """Add int (k_n n n + k_t t t) N_i N_j dA / E to A, and k / E at points; collective.

    A is then to be assembled. Returns (m, 3) components of the rigid motions that springs to the
    ground resist.
    """
    resisted = [np.empty((0, 3))]
    for spring in (spring for spring in scene.springs if spring.against is None):
        if spring.point is not None:
            node, places = nodes_at(space, body, spring.point)
            if not len(node):
                raise MeshMisfit(f"[[spring]] at {spring.point}: no node lies there; move it")
            # of a ring the stiffness per radian
            part = 2.0 * np.pi if scene.axisymmetric else 1.0
            nodes, mass = node[:, None], np.full((len(node), 1, 1), 1.0 / part)
            axes = [(spring.x, np.array([[1.0, 0.0]])), (spring.y, np.array([[0.0, 1.0]]))]
        else:
            facets = edge_facets(space, body, spring.edge, spring.span)
            nodes, places, n = facets.nodes, facets.points.reshape(-1, 2), facets.outward
            mass = facet_mass(scene, facets)
            axes = [(spring.normal, n), (spring.tangential, np.stack([-n[:, 1], n[:, 0]], axis=1))]
        moved, width = motions(places, body.pivot, body.size), nodes.shape[1]
        for part, axis in axes:
            along = np.repeat(np.broadcast_to(axis, (len(nodes), 2)), width, axis=0)
            resisted += [np.einsum("nak,na->nk", moved, along)] if part > 0.0 else []
        k = sum(part * np.einsum("fa,fb->fab", axis, axis) for part, axis in axes)
        blocks = np.einsum(
            "fij,fab->fiajb", mass / scene.material.young, np.broadcast_to(k, (len(nodes), 2, 2))
        )
        dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 2 * width).astype(PETSc.IntType)
        if space.mesh.comm.rank == 0:
            for at, block in zip(dofs, blocks.reshape(-1, 2 * width, 2 * width), strict=True):
                matrix.setValues(at, at, block, addv=PETSc.InsertMode.ADD_VALUES)
    return np.concatenate(resisted)


def add_links(scene: Scene, parts: Mapping[str, Bulk]) -> Array:
    """Append the unit loads of all springs between two bodies to these, by name; collective.

    Returns M / k_d (m, m) of the m unit loads, on every rank. The first edge has to be straight,
    with the nodes of the other one straight across.
    """
    blocks: list[Array] = []
    for spring in (part for part in scene.springs if part.against is not None):
        named = [scene.find_edge(edge) for edge in (spring.edge, spring.against or "")]
        a, b = (parts[body.name] for body, _ in named)
        nodes, places = edge_nodes(a.space, a.body, named[0][1], spring.span)
        facets = edge_facets(a.space, a.body, named[0][1], spring.span)
        normal = facets.outward[0]
        if np.abs(facets.outward - normal).max() > 1e-9:
            raise InputError(f"[[spring]] against: '{spring.edge}' is not straight")
        mass = np.zeros((len(nodes), len(nodes)))
        rows = np.searchsorted(nodes, facets.nodes)
        np.add.at(mass, (rows[:, :, None], rows[:, None]), facet_mass(a.scene, facets))
        others, beyond = edge_nodes(b.space, b.body, named[1][1], None)
        others = others[_across(spring, places, beyond, normal)]
        tangent = np.array([-normal[1], normal[0]])
        for k, d in ((spring.normal, normal), (spring.tangential, tangent)):
            if k > 0.0:
                first = sum(map(len, blocks))
                # no load of a scene has such a name
                names = tuple(f"[[spring]] {first + i}" for i in range(len(nodes)))
                forces = np.einsum("kn,c->nck", mass, d)
                for part in parts.values():
                    on = slice(None if part is a or part is b else 0)
                    at, pull = (others, -forces) if part is b else (nodes, forces)
                    part.append_loads(names, at[on], pull[on])
                blocks.append(mass / k)
    return np.asarray(block_diag(*blocks)) if blocks else np.zeros((0, 0))


def _across(spring: Spring, places: Array, beyond: Array, normal: Array) -> Ints:
    """Return which of the nodes beyond are straight across from the nodes of an edge."""
    size = float(np.ptp(places, axis=0).max())
    offset = beyond - places[:, None]
    aside = np.abs(offset @ [-normal[1], normal[0]])
    found = np.argmin(aside, axis=1)
    worst = int(np.argmax(aside.min(axis=1)))
    gap = offset[np.arange(len(found)), found] @ normal
    if aside[worst].min() > 1e-9 * size or gap.min() < -1e-9 * size:
        x, y = places[worst]
        raise MeshMisfit(
            f"[[spring]] against: '{spring.against}' has no node straight across from the one of "
            f"'{spring.edge}' at ({x:g}, {y:g}); give a span, or both edges the same nodes"
        )
    if spring.tangential > 0.0 and gap.max() > 1e-9 * size:
        raise InputError(
            f"[[spring]] tangential: '{spring.edge}' and '{spring.against}' are {gap.max():g} "
            "apart, where forces along them would not balance in moment; put them on each other"
        )
    return found


def closed(
    joined: JoinedBodies, at: Ints, soft: Array, names: Sequence[str], kept: int
) -> JoinedBodies:
    """Return joined bodies some of whose unit loads, ``at``, have the compliance of springs.

    ``soft`` (m, m) are the displacements by which unit forces lengthen the springs with these
    names. The first ``kept`` loads remain, those of tightened springs with their shortening as
    factor; the other ones are not tightened.
    """
    C, r_star = joined.compliance, joined.r_star
    T, G = np.eye(len(C)), np.zeros_like(r_star)
    flexibility = soft + C[np.ix_(at, at)]
    size = np.sqrt(np.diag(flexibility).clip(min=np.finfo(float).tiny))
    values, modes = np.linalg.eigh(flexibility / np.outer(size, size))
    # what two almost alike rigid bolts share is known to the round-off of condensation over it
    if values[0] < 1e-10:
        part = np.abs(modes[:, 0]) / np.abs(modes[:, 0]).max()
        which = dict.fromkeys(name for name, p in zip(names, part, strict=True) if p > 1e-3)
        raise InputError(
            f"{', '.join(which)}: their forces are not determined, as those of rigid bolts between "
            "the same patches, or between held ones; give a lower stiffness, or leave one out"
        )
    kappa = np.linalg.inv(flexibility)
    T[at], G[at] = -kappa @ C[at], kappa @ r_star[at]
    T[np.ix_(at, at)] = kappa
    K = joined.K + r_star.T @ G
    compliance = C @ T
    compliance[at] = T[at]
    # free motions on which unit tensions do no work: 1e-9 of the sum of its parts is none
    pull, tiny = r_star[at] @ joined.rigid, np.finfo(float).tiny
    parts = np.abs(r_star[at]) @ np.abs(joined.rigid) + tiny
    held = np.where(np.abs(pull) > 1e-9 * parts, pull, 0.0)
    held = held / parts.max(axis=1, keepdims=True, initial=tiny)
    return replace(
        joined,
        K=0.5 * (K + K.T),
        r_star=T[:, :kept].T @ r_star,
        compliance=compliance[:kept, :kept],
        sign=np.where(np.isin(np.arange(len(T)), at), 1.0, joined.sign)[:kept],
        rigid=scaled(joined.rigid @ free_motions(held, 1e-9)),
        driven=joined.driven[:kept],
        factors=(T[:, :kept], G),
        shift=joined.shift[:kept],
    )


def driven_gaps(scene: Scene, contact: ContactPoints) -> Array:
    """Return the gap (n_loads, N) at the contact nodes of each load with factor 1."""
    names = scene.load_names
    gaps = np.zeros((len(names), len(contact.x)))
    for k, part in enumerate(scene.contacts):
        on = contact.edge == k
        for load in scene.loads:
            if load.gap is not None and load.edge == part.edge:
                low, high = load.span or (-np.inf, np.inf)
                near = 1e-9 * np.ptp(contact.x[on])  # round-off
                inside = on & (contact.x >= low - near) & (contact.x <= high + near)
                gap = evaluate_checked(load.gap, contact.x[inside], None, f"{load.label} gap")
                # parts of one load that meet have one value there
                gaps[names.index(load.name), inside] = gap
        if part.interference is not None:
            where = f"{scene.joint_labels[k]} interference"
            depth = evaluate_checked(part.interference, contact.x[on], None, where)
            if depth.min() < 0.0:
                raise InputError(f"{where}: is negative; give a depth, or remove it")
            gaps[-1, on] = -depth
    driven = {load.name: f"{load.label} gap" for load in scene.loads if load.gap is not None}
    if INTERFERENCE in scene.preloads:
        driven[INTERFERENCE] = "[contact] interference"
    for name, where in driven.items():
        if not gaps[names.index(name)].any():
            raise InputError(f"{where}: is zero everywhere; give it a value, or remove it")
    return gaps


def with_gaps(joined: JoinedBodies, scene: Scene, contact: ContactPoints) -> JoinedBodies:
    """Return joined bodies, for prescribed displacements relative to u, with the driven gaps."""
    gaps, n = driven_gaps(scene, contact), len(contact.x)
    lift = joined.rigid[n:][~joined.held[n:]]
    # a combination of motions that opens the gap of every node
    bounds = {"b_ub": -np.ones(len(lift)), "bounds": (None, None)}
    if INTERFERENCE in scene.preloads and lift.shape[1]:
        if linprog(np.zeros(lift.shape[1]), -lift, **bounds).status == 0:
            raise InputError(
                "[contact] interference: the body is free to move off the contact, so nothing "
                "presses; hold it by a [[support]], or remove the interference"
            )
    S = joined.driven + np.where(joined.held, 0.0, np.hstack([np.zeros_like(gaps), gaps]))
    if not S.any():
        return joined
    sign = np.where(gaps.any(axis=1), 1.0, joined.sign)
    cross, stiff = joined.r_star @ S.T, S @ joined.K
    return replace(
        joined,
        sign=sign,
        r_star=joined.r_star - stiff,
        compliance=joined.compliance - sign[:, None] * cross - cross.T + stiff @ S.T,
        shift=joined.shift - S,
    )
