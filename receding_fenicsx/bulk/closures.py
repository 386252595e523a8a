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

So an interference of depth $\delta$, which the gap $g = g_0 + w - \lambda \delta$ closes, is a load
with $S = -[0; \delta]$ whose $u'$ has the change of the gap as $w$; its conjugate is
$\sum_i \delta_i P_i$. Where a load drives a contact node of one body, the bodies are condensed and
joined for the displacement relative to the prescribed one, and $S$ is what it moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.contact_operator import ContactPoints
from receding_fenicsx.bulk.join_bodies import JoinedBodies
from receding_fenicsx.bulk.rigid_motions import scaled
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
    _, values, motions = np.linalg.svd(held)
    return scaled(rigid @ motions[int(np.sum(values > 1e-9)) :].T)


def shifted(joined: JoinedBodies, S: Array) -> JoinedBodies:
    """Return joined bodies for u' = u + S^T lambda.

    Args:
        joined: the bodies with n loads, for u.
        S: (n + m, 2N) displacements, zero for forces; the last m are of new loads.
    """
    new = len(S) - len(joined.r_star)
    sign = np.append(joined.sign, np.ones(new))
    r_star = np.pad(joined.r_star, ((0, new), (0, 0)))
    cross = r_star @ S.T
    compliance = np.pad(joined.compliance, ((0, new), (0, new)))
    T, G = joined.factors
    return replace(
        joined,
        r_star=r_star - S @ joined.K,
        compliance=compliance - sign[:, None] * cross - cross.T + S @ joined.K @ S.T,
        sign=sign,
        factors=(np.pad(T, ((0, 0), (0, new))), G),
        shift=np.pad(joined.shift, ((0, new), (0, 0))) - S,
    )


def interference_depth(scene: Scene, contact: ContactPoints) -> Array:
    """Return the depth (N,) of the interference at the contact nodes.

    Raises:
        InputError: it is negative somewhere, or zero everywhere.
    """
    depth = np.zeros(len(contact.x))
    for k, part in enumerate(scene.contacts):
        on = contact.edge == k
        if part.interference is not None:
            depth[on] = evaluate_checked(part.interference, contact.x[on], None, KEY)
    if depth.min() < 0.0 or not depth.any():
        what = "zero everywhere" if not depth.any() else "negative"
        raise InputError(f"{KEY}: is {what}; give a depth, or remove it")
    return depth


def with_interference(joined: JoinedBodies, scene: Scene, contact: ContactPoints) -> JoinedBodies:
    """Return joined bodies with an interference, if the scene has one, as their last load.

    Raises:
        InputError: a free motion opens the whole contact, so that nothing presses.
    """
    if INTERFERENCE not in scene.preloads:
        return joined
    depth, n = interference_depth(scene, contact), len(contact.x)
    lift = joined.rigid[n:][~joined.held[n:]]
    # a combination of motions that opens the gap of every node
    bounds = {"b_ub": -np.ones(len(lift)), "bounds": (None, None)}
    if lift.shape[1] and linprog(np.zeros(lift.shape[1]), -lift, **bounds).status == 0:
        raise InputError(
            f"{KEY}: the body is free to move off the contact, so nothing presses; hold it by a "
            "[[support]], or remove the interference"
        )
    overlap = np.where(joined.held, 0.0, np.concatenate([np.zeros(n), depth]))
    return shifted(joined, np.vstack([np.zeros_like(joined.r_star), -overlap]))
