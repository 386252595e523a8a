"""Elimination of the tangential displacements of a frictionless contact, and its inverse form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem, neutral_motions


def eliminate_tangential(system: ContactSystem) -> ContactSystem:
    """Condense a frictionless contact (f = 0 at every node) to its normal displacements.

    With Q = 0 eq. (11) gives v = -K_tt^+ (K_tn w + sum lambda Q*), hence
    K = K_nn - K_nt K_tt^+ K_tn and r* = P* - K_nt K_tt^+ Q*. Bodies that are free to slide have
    rigid motions in K_tt; they are pinned at v = 0 on average, which is allowed only when no load
    has a resultant along them.

    Args:
        system: ``kind = "frictional"``, f = 0 everywhere.

    Returns:
        The system of ``kind = "normal"`` with its ``slip_map``.

    Raises:
        InputError: if a load pushes a body along a rigid motion that nothing resists.

    One node with K_tt = 2, K_tn = 1, K_nn = 4 under Q* = 1, P* = 3: v = -(w + lambda) / 2,
    K = 4 - 1/2 and r* = 3 - 1/2:

        >>> system = ContactSystem(
        ...     x=np.zeros(1), points=np.zeros((1, 2)), weight=np.ones(1),
        ...     K=np.array([[2.0, 1.0], [1.0, 4.0]]), r_star=np.array([[1.0, 3.0]]),
        ...     load_names=("press",), f=np.zeros(1), g0=np.zeros(1),
        ...     held=np.zeros(2, dtype=bool), rigid=np.zeros((2, 0)),
        ... )
        >>> normal = eliminate_tangential(system)
        >>> normal.K.tolist(), normal.r_star.tolist(), normal.slip_map.tolist()
        ([[3.5]], [[2.5]], [[-0.5, -0.5]])
    """
    n = system.n
    free = np.flatnonzero(~system.held[:n])
    K_tt = system.K[np.ix_(free, free)]
    K_tn = system.K[free, n:]
    Q_star = system.r_star[:, free].T
    # rigid motions along the plane, which nothing resists
    motions = neutral_motions(system.rigid, np.arange(2 * n) >= n)
    if motions.shape[1]:
        slides = np.linalg.qr(motions[free])[0]
        resultant = np.abs(slides.T @ Q_star).max(axis=0)
        # relative to all reactions: two mirrored bodies have normal ones only
        if np.any(resultant > 1e-10 * np.abs(system.r_star).sum(axis=1)):
            name = system.load_names[int(np.argmax(resultant))]
            raise InputError(
                f"load '{name}' pushes the frictionless body along, and nothing resists it: "
                "add a [[support]] or friction"
            )
        K_tt = K_tt + slides @ slides.T * (np.trace(K_tt) / len(free))
    mapped = -np.linalg.solve(K_tt, np.hstack([K_tn, Q_star]))
    slip_map = np.zeros((n, n + len(system.load_names)))
    slip_map[free] = mapped
    K = system.K[n:, n:] + K_tn.T @ mapped[:, :n]
    compliance = system.load_compliance
    if compliance.size:
        # the loads also move through the slip that they cause by themselves
        compliance = compliance + system.load_sign[:, None] * (Q_star.T @ mapped[:, n:])
    return replace(
        system,
        K=0.5 * (K + K.T),
        r_star=system.r_star[:, n:] + (K_tn.T @ mapped[:, n:]).T,
        kind="normal",
        slip_map=slip_map,
        load_compliance=compliance,
    )


def frictional_form(system: ContactSystem) -> ContactSystem:
    """Return a system of ``kind = "normal"`` in the 2N layout that the solvers share.

    The eliminated tangential degrees of freedom become held ones without stiffness or coupling.
    """
    if system.kind == "frictional":
        return system
    n, n_loads = system.n, len(system.load_names)
    K = np.zeros((2 * n, 2 * n))
    K[n:, n:] = system.K
    held = system.held.copy()
    held[:n] = True
    r_star = np.hstack([np.zeros((n_loads, n)), system.r_star])
    return replace(system, K=K, r_star=r_star, held=held, kind="frictional")
