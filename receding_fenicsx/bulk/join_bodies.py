"""Two condensed bodies that meet at their contact nodes, as one contact system.

With u = u_a - u_b, n pointing from b into a, and r the force of b on a,

    r = r*_a + K_a u_a,   -r = r*_b + K_b u_b,

so that, with S = (K_a + K_b)^-1, r = K_a S K_b u + K_b S r*_a - K_a S r*_b. It is evaluated as
the softer body's stiffness less what the stiffer one gives way, which loses no figures when one
of them is much stiffer, and which lets a node be held on one body only.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, LinAlgWarning, solve

from receding_fenicsx.bulk.rigid_motions import free_motions, scaled
from receding_fenicsx.errors import InputError, SolveError

Array = NDArray[np.float64]

RIGID_TOLERANCE = 1e-11
"""Largest force of a common or relative rigid motion over the largest row sum of |K|."""
BALANCE_TOLERANCE = 1e-9
"""Resultant of a load on a pair that nothing holds, over the sum of its reactions, that is none."""


@dataclass(frozen=True)
class Reduced:
    """One body condensed to its contact nodes.

    Attributes:
        K: (2N, 2N) stiffness, order [v; w].
        r_star: (n_loads, 2N) reactions to each unit load, all contact nodes held.
        compliance: (n_loads, n_loads) work-conjugate displacements, all contact nodes held.
        sign: (n_loads,) -1 for forces, +1 for prescribed displacements, 0 where none acts.
        held: (2N,) contact degrees of freedom held by symmetry or supports.
        constraints: (m, 3) rigid motions at everything that is held.
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    constraints: Array


@dataclass(frozen=True)
class Joined:
    """Two bodies in one.

    Attributes:
        K, r_star, compliance, sign, held, rigid: as in ``ContactSystem``, for u = u_a - u_b.
        back: (2N, 2N) and (2N, n_loads): u_b = back[0] u + back[1] lambda.
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    rigid: Array
    back: tuple[Array, Array]


def join(a: Reduced, b: Reduced, modes: Array, load_names: tuple[str, ...]) -> Joined:
    """Join two bodies.

    Args:
        a: the body that n points into.
        b: the other one, in the same coordinates, with the same loads (zero where they act on a).
        modes: (2N, 3) displacements of the contact nodes when a body moves right, up and about a
            pivot, as the constraints count them.
        load_names: names of the loads.

    Returns:
        The joined system.

    Raises:
        InputError: nothing holds the pair against a motion in which a load moves it.
        SolveError: K does not keep the rigid motions.
    """
    # the stiffer body's displacements u_e are eliminated; u_s = u_e + direction * u
    stiffer_b = np.trace(b.K) >= np.trace(a.K)
    e, s = (b, a) if stiffer_b else (a, b)
    direction = 1.0 if stiffer_b else -1.0
    free = ~(e.held | s.held)
    on_s = s.held & ~e.held
    # u_e = t (direction u) + y on the free ones, u_s = v (direction u) + y
    t = np.where(on_s, -1.0, 0.0)
    v = t + 1.0
    H = (e.K + s.K)[np.ix_(free, free)]
    C = e.K[free] * t + s.K[free] * v
    L = (e.r_star + s.r_star)[:, free].T
    common = free_motions(np.vstack([e.constraints, s.constraints]))
    if common.shape[1]:
        R = np.linalg.qr((modes @ common)[free])[0]
        size = np.abs(e.r_star).sum(axis=1) + np.abs(s.r_star).sum(axis=1)
        out = np.abs(R.T @ L).max(axis=0) > BALANCE_TOLERANCE * size
        if np.any(out):
            raise InputError(
                f"load '{load_names[int(np.argmax(out))]}' moves both bodies together, and nothing "
                "holds them: add a [[support]] to one of them, or balance it by its part on the "
                "other body (a [[load]] of the same name)"
            )
        H = H + R @ R.T * (np.trace(H) / len(H))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            given = solve(H, np.hstack([C, L]), assume_a="pos")
    except (LinAlgError, LinAlgWarning):
        raise SolveError(
            "the stiffness of the joined bodies is singular to round-off; bring their Young's "
            "moduli closer together or hold the stiffer one"
        ) from None
    y, y_load = -given[:, : C.shape[1]], -given[:, C.shape[1] :]
    K = t[:, None] * e.K * t + v[:, None] * s.K * v + C.T @ y
    K = 0.5 * (K + K.T)
    r_star = direction * (e.r_star * t + s.r_star * v + (C.T @ y_load).T)
    sign = np.where(a.sign == 0.0, b.sign, a.sign)
    if np.any(a.sign * b.sign < 0.0):
        name = load_names[int(np.argmin(a.sign * b.sign))]
        raise InputError(
            f"load '{name}': is a force on one body and a displacement on the other; give it the "
            "same form on both"
        )
    compliance = e.compliance + s.compliance + sign[:, None] * (L.T @ y_load)
    u_e, u_e_load = np.diag(direction * t), np.zeros((len(t), L.shape[1]))
    u_e[free] += direction * y
    u_e_load[free] = y_load
    held = a.held & b.held
    apart = np.hstack([free_motions(part.constraints) for part in (a, b)])
    rigid = scaled(modes @ _span(apart))
    error = np.abs((K @ rigid)[~held]).max(initial=0.0) / np.abs(K).sum(axis=1).max()
    if not error <= RIGID_TOLERANCE:
        raise SolveError(
            f"the stiffness of the joined bodies resists a rigid motion by {error:.1e} of its "
            f"size (at most {RIGID_TOLERANCE:g}); bring their Young's moduli closer together "
            "or hold the stiffer one"
        )
    if stiffer_b:
        return Joined(K, r_star, compliance, sign, held, rigid, (u_e, u_e_load))
    return Joined(K, r_star, compliance, sign, held, rigid, (u_e - np.eye(len(t)), u_e_load))


def _span(motions: Array) -> Array:
    """Return a basis (3, n), in echelon form, of the motions that the columns span."""
    # what is orthogonal to all that is orthogonal to them
    return free_motions(free_motions(motions.T).T)
