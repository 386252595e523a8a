r"""Unit loads closed by a compliance (bolts, springs between bodies), and prescribed gaps.

A spring between two places has as its unit load the pair of forces by which it pulls these
together. With unit loads $F$, the compliance $c$ of the springs themselves, tightened by $s$, and
the work-conjugates $D$ of their unit loads (by how much the places approach),

$$c F = s - D ,\quad D = C_{bb} F + C_{bl} \lambda - R u \quad\Rightarrow\quad
  F = \kappa\, (s - C_{bl} \lambda + R u) ,\quad \kappa = (c + C_{bb})^{-1} ,$$

for all at once. The factors of all unit loads are $T \lambda' + G u$ with $s$ in the place of $F$;
$K' = K + r^{*T} G$, $r^{*\prime} = T^T r^*$ and $C' = C T$ follow, and the conjugate of a
shortening is the force $F$. A bolt of stiffness $k$ between two patches has $c = 1 / k$; springs
between two edges (`springs.add_links`) have $c = M / k_d$ with the mass matrix $M$ of the edge, and
$s = 0$.

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

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.contact_operator import ContactPoints
from receding_fenicsx.bulk.join_bodies import JoinedBodies
from receding_fenicsx.bulk.rigid_motions import free_motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import INTERFERENCE, Scene
from receding_fenicsx.scene.profiles import evaluate_checked

KEY = "[contact] interference"


def bolt_compliance(scene: Scene) -> Array:
    """Return the compliance (m, m) of a scene's bolts; that of a ring of bolts is per radian."""
    part = 2.0 * np.pi if scene.axisymmetric else 1.0
    soft = [part / (bolt.stiffness or np.inf) for bolt in scene.bolts]
    return np.diag(np.array(soft, dtype=float))


def closed(
    joined: JoinedBodies, at: Ints, soft: Array, names: Sequence[str], kept: int
) -> JoinedBodies:
    """Return joined bodies some of whose unit loads have the compliance of springs.

    Args:
        joined: the bodies, with n unit loads.
        at: (m,) numbers of the loads that springs close.
        soft: (m, m) displacements by which unit forces lengthen the springs.
        names: (m,) names of the springs.
        kept: number of loads that remain, those of tightened springs with their shortening as
            factor. The other ones, the last, are not tightened.

    Raises:
        InputError: some of the springs are rigid, and some of their forces deform nothing.
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
    return replace(
        joined,
        K=0.5 * (K + K.T),
        r_star=T[:, :kept].T @ r_star,
        compliance=compliance[:kept, :kept],
        sign=np.where(np.isin(np.arange(len(T)), at), 1.0, joined.sign)[:kept],
        rigid=_without_lengthening(joined.rigid, r_star[at]),
        driven=joined.driven[:kept],
        factors=(T[:, :kept], G),
        shift=joined.shift[:kept],
    )


def _without_lengthening(rigid: Array, r_star: Array) -> Array:
    """Return the rigid motions (2N, n) on which unit tensions with these r* do no work."""
    pull = r_star @ rigid
    size = np.abs(r_star) @ np.abs(rigid) + np.finfo(float).tiny
    # a force of 1e-9 of the sum of its parts is none
    held = np.where(np.abs(pull) > 1e-9 * size, pull, 0.0)
    held = held / size.max(axis=1, keepdims=True, initial=np.finfo(float).tiny)
    return scaled(rigid @ free_motions(held, 1e-9))


def shifted(joined: JoinedBodies, S: Array) -> JoinedBodies:
    """Return joined bodies for u' = u + S^T lambda, with S (n_loads, 2N) zero for forces."""
    if not S.any():
        return joined
    cross, stiff = joined.r_star @ S.T, S @ joined.K
    compliance = joined.compliance - joined.sign[:, None] * cross - cross.T + stiff @ S.T
    shift = joined.shift - S
    return replace(joined, r_star=joined.r_star - stiff, compliance=compliance, shift=shift)


def driven_gaps(scene: Scene, contact: ContactPoints) -> Array:
    """Return the gap (n_loads, N) at the contact nodes of each load with factor 1.

    Raises:
        InputError: an interference is negative somewhere, or a gap is zero everywhere.
    """
    names = scene.load_names
    gaps = np.zeros((len(names), len(contact.x)))
    for k, part in enumerate(scene.contacts):
        on = contact.edge == k
        for load in scene.loads:
            if load.gap is not None and load.edge == part.edge:
                low, high = load.span or (-np.inf, np.inf)
                inside = on & (contact.x >= low) & (contact.x <= high)
                where = f"{load.label} gap"
                gap = evaluate_checked(load.gap, contact.x[inside], None, where)
                # parts of one load that meet have one value there
                gaps[names.index(load.name), inside] = gap
        if part.interference is not None:
            depth = evaluate_checked(part.interference, contact.x[on], None, KEY)
            if depth.min() < 0.0:
                raise InputError(f"{KEY}: is negative; give a depth, or remove it")
            gaps[-1, on] = -depth
    driven = {load.name: f"{load.label} gap" for load in scene.loads if load.gap is not None}
    if INTERFERENCE in scene.preloads:
        driven[INTERFERENCE] = KEY
    for name, where in driven.items():
        if not gaps[names.index(name)].any():
            raise InputError(f"{where}: is zero everywhere; give it a value, or remove it")
    return gaps


def with_gaps(joined: JoinedBodies, scene: Scene, contact: ContactPoints) -> JoinedBodies:
    """Return joined bodies, for prescribed displacements relative to u, with the driven gaps.

    Raises:
        InputError: a free motion opens the whole contact, so that no interference presses.
    """
    gaps, n = driven_gaps(scene, contact), len(contact.x)
    lift = joined.rigid[n:][~joined.held[n:]]
    # a combination of motions that opens the gap of every node
    bounds = {"b_ub": -np.ones(len(lift)), "bounds": (None, None)}
    if INTERFERENCE in scene.preloads and lift.shape[1]:
        if linprog(np.zeros(lift.shape[1]), -lift, **bounds).status == 0:
            raise InputError(
                f"{KEY}: the body is free to move off the contact, so nothing presses; hold it by "
                "a [[support]], or remove the interference"
            )
    overlap = np.where(joined.held, 0.0, np.hstack([np.zeros_like(gaps), gaps]))
    sign = np.where(gaps.any(axis=1), 1.0, joined.sign)
    return shifted(replace(joined, sign=sign), joined.driven + overlap)
