"""Bolts: springs between the mean displacements of two patches, shortened by tightening.

With unit tensions as loads, a bolt of stiffness k, shortened by s, has the force F = k (s - D),
where D = C_bb F + C_bl lambda - R u is the work-conjugate of its tension: by how much the patches
approach. So

    F = kappa (s - C_bl lambda + R u),   kappa = (1 / k + C_bb)^-1,

for all bolts at once, and the factors of all loads are T lambda' + G u with s in the place of F.
K' = K + r*^T G, r*' = T^T r* and C' = C T follow; the conjugate of a shortening is the force F.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.join_bodies import CondensedBody, JoinedBodies
from receding_fenicsx.bulk.rigid_motions import scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene

SINGULAR = 1e-10
"""Smallest eigenvalue of the flexibility, for unit diagonal, by which forces are found: what two
almost alike rigid bolts share is known to the round-off of condensation over it."""
FREE_TOLERANCE = 1e-9
"""Force of a bolt by a rigid motion, over the sum of its parts, that counts as none."""


def closed(
    C: Array, r_star: Array, at: Ints, soft: Array, names: Sequence[str]
) -> tuple[Array, Array]:
    """Return T (n, n) and G (n, 2N) of n loads, some of which have the compliance ``soft``.

    Args:
        C: (n, n) compliance of the loads.
        r_star: (n, 2N) their reactions.
        at: (m,) numbers of the loads that springs close.
        soft: (m, m) displacements by which unit forces lengthen the springs.
        names: (m,) names of the springs.

    Raises:
        InputError: some of the springs are rigid, and some of their forces deform nothing.
    """
    T, G = np.eye(len(C)), np.zeros_like(r_star)
    flexibility = soft + C[np.ix_(at, at)]
    size = np.sqrt(np.diag(flexibility).clip(min=np.finfo(float).tiny))
    values, modes = np.linalg.eigh(flexibility / np.outer(size, size))
    if len(at) and values[0] < SINGULAR:
        part = np.abs(modes[:, 0]) / np.abs(modes[:, 0]).max()
        which = dict.fromkeys(name for name, p in zip(names, part, strict=True) if p > 1e-3)
        raise InputError(
            f"{', '.join(which)}: their forces are not determined, as those of rigid bolts between "
            "the same patches, or between held ones; give a lower stiffness, or leave one out"
        )
    kappa = np.linalg.inv(flexibility)
    T[at], G[at] = -kappa @ C[at], kappa @ r_star[at]
    T[np.ix_(at, at)] = kappa
    return T, G


def bolt_law(scene: Scene, condensed: CondensedBody | JoinedBodies) -> tuple[Array, Array]:
    """Return T (n_loads, n_loads) and G (n_loads, 2N); the identity and zero without bolts."""
    names = scene.body_names
    at = np.array([names.index(bolt.name) for bolt in scene.bolts], dtype=int)
    # the forces of a ring of bolts are those per radian
    part = 2.0 * np.pi if scene.axisymmetric else 1.0
    soft = np.diag([part / (bolt.stiffness or np.inf) for bolt in scene.bolts])
    labels = [f"bolt '{bolt.name}'" for bolt in scene.bolts]
    soft = soft.reshape(len(at), len(at))
    return closed(condensed.compliance, condensed.r_star, at, soft, labels)


def with_bolts(system: ContactSystem, scene: Scene, law: tuple[Array, Array]) -> ContactSystem:
    """Return a system whose unit tensions are replaced by shortenings of its bolts."""
    T, G = law
    at = [system.load_names.index(bolt.name) for bolt in scene.bolts]
    K = system.K + system.r_star.T @ G
    C = system.load_compliance @ T
    C[at] = T[at]
    return replace(
        system,
        K=0.5 * (K + K.T),
        r_star=T.T @ system.r_star,
        load_compliance=C,
        load_sign=np.where(np.isin(np.arange(len(T)), at), 1.0, system.load_sign),
        rigid=without_lengthening(system.rigid, system.r_star[at]),
    )


def without_lengthening(rigid: Array, r_star: Array) -> Array:
    """Return the rigid motions (2N, n) on which unit tensions with these r* do no work."""
    pull = r_star @ rigid
    size = np.abs(r_star) @ np.abs(rigid) + np.finfo(float).tiny
    held = np.where(np.abs(pull) > FREE_TOLERANCE * size, pull, 0.0)
    held = held / size.max(axis=1, keepdims=True, initial=np.finfo(float).tiny)
    _, values, motions = np.linalg.svd(held)
    return scaled(rigid @ motions[int(np.sum(values > FREE_TOLERANCE)) :].T)
