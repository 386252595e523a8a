r"""Critical friction: the smallest factor of all coefficients at which a slip mode appears.

On a given contact (open nodes without reactions, all others closed) let $s_i = \pm 1$ be assumed
directions of slip, $S = \mathrm{diag}(s)$, $F = \mathrm{diag}(f)$, and all freedoms that move
freely be condensed. With coefficients $\varphi f$ the rates, $\dot Q = -\varphi s f \dot P$, have a
slip mode, a motion without any change of load, where

$$(K_{tt} + \varphi\, S F K_{nt})\, v = 0 ,$$

that is where $1/\varphi$ is a real eigenvalue of $S A$, $A = -F K_{nt} K_{tt}^{-1}$, with the
eigenvector $x = K_{tt} v$. ``sign_radius`` bounds the largest one over all signs from below (a
mode) and above (a proof).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.branches.sign_radius import (
    ALL_SIGNS,
    REAL,
    STARTS,
    eigenvectors,
    mode_bound,
    search_signs,
    try_all_signs,
    uniqueness_bound,
)
from receding_fenicsx.interface.law import SEPARATION, STATE_NAMES
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import NO_STIFFNESS


@dataclass(frozen=True)
class CriticalFriction:
    """Bounds of the friction at which a slip mode appears, and the mode found.

    Attributes:
        factor: a slip mode exists at this multiple of f; infinite where none was found.
        lower_bound: below this multiple none exists, for any signs of all slipping nodes.
        unique_below: below this multiple none exists for any signs, with any nodes stuck, and the
            rates of slipping nodes are unique.
        exact: all signs were tried: the factor is the smallest one if no node sticks.
        signs: (N,) assumed direction of slip of each modelled node, 0 where it cannot slip.
        mode: (2N,) displacements [v; w] of the mode, largest entry 1; zero where none was found.
        reactions: (2N,) changes of the reactions [Q; P] of the mode.
        keeps_signs: every node slips in its assumed direction.
    """

    factor: float
    lower_bound: float
    unique_below: float
    exact: bool
    signs: Array
    mode: Array
    reactions: Array
    keeps_signs: bool


def critical_friction(
    system: ContactSystem,
    states: ArrayLike | None = None,
    starts: int = STARTS,
) -> CriticalFriction:
    """Return bounds of the common factor of f at which a slip mode appears on a contact.

    It says what is possible, not that it happens: the mode's directions of slip need not be those
    of its own motion, and a history may never come to these states.

    Args:
        system: the condensed body. That of half a body has mirror-symmetric modes only.
        states: (N,) states of the modelled nodes, or of the whole contact; separated nodes are
            open, all others are closed and may slip. Default: all are closed.
        starts: random starts of the search over signs.

    Raises:
        InputError: the system has no friction, the states are not those of its nodes, no node may
            slip, or the body slides freely.
    """
    n, state = system.n, _states(system, states)
    closed = state != SEPARATION
    slips = closed & system.friction.present & ~system.held[:n] & ~system.held[n:]
    if not slips.any():
        raise InputError(
            "critical_friction: no node can slip with friction in these states; give states with "
            "closed nodes, and friction"
        )
    if system.f_backward is not None:
        raise InputError("critical_friction: needs one coefficient for both directions of slip")
    nodes = np.flatnonzero(slips)
    loose_t = ~system.held[:n] & ~slips
    free = np.flatnonzero(np.concatenate([loose_t, ~closed & ~system.held[n:]]))
    S, follow = _condensed(system, nodes, free)
    K_tt, C = S[: len(nodes)], system.f[nodes, None] * S[len(nodes) :]
    A = -np.linalg.solve(K_tt, C.T).T
    exact = len(nodes) <= ALL_SIGNS
    mu, s = try_all_signs(A) if exact else search_signs(A, starts)
    mode, signs = np.zeros(2 * n), np.zeros(n)
    if mu > 0.0:
        signs[nodes] = s
        v = np.linalg.solve(K_tt, eigenvectors(s, A, mu)[0])
        v *= np.sign(s @ v) or 1.0
        mode[nodes], mode[free] = v, follow @ v
        mode /= np.abs(mode).max()
    return CriticalFriction(
        factor=1.0 / mu if mu > 0.0 else np.inf,
        lower_bound=mode_bound(A),
        unique_below=uniqueness_bound(K_tt, C),
        exact=exact,
        signs=signs,
        mode=mode,
        reactions=system.K @ mode,
        keeps_signs=bool(mu > 0.0 and np.all(signs * mode[:n] >= -REAL)),
    )


def _states(system: ContactSystem, states: ArrayLike | None) -> NDArray[np.int8]:
    """Return the states of the modelled nodes, checked."""
    if system.kind == "normal" or not np.any(system.friction.present):
        raise InputError("critical_friction: the system has no friction; set [contact] friction")
    if states is None:
        return np.ones(system.n, dtype=np.int8)
    given = np.asarray(states)
    whole = mirror_of(system)
    if given.shape == whole.index.shape and given.shape != (system.n,):
        # the modelled nodes are the images that are not mirrored
        own = np.flatnonzero(~whole.left)
        given = given[own[np.argsort(whole.index[own])]]
    if given.shape != (system.n,) or not np.isin(given, list(STATE_NAMES)).all():
        raise InputError(
            f"critical_friction: states must be {system.n} numbers from 1 to 4, one for each "
            "modelled node"
        )
    return given.astype(np.int8)


def _condensed(
    system: ContactSystem, nodes: NDArray[np.intp], free: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return [K_tt; K_nt] of the slipping nodes, and the motion of the free freedoms with them."""
    K, rows = system.K, np.concatenate([nodes, system.n + nodes])
    follow = np.zeros((0, len(nodes)))
    if len(free):
        block = K[np.ix_(free, free)]
        if not _is_stiff(block):
            raise InputError(
                "critical_friction: nothing resists a motion of the open or frictionless nodes; "
                "close a node, or add a [[support]]"
            )
        follow = -np.linalg.solve(block, K[np.ix_(free, nodes)])
    S: Array = K[np.ix_(rows, nodes)] + K[np.ix_(rows, free)] @ follow
    if not _is_stiff(S[: len(nodes)]):
        raise InputError(
            "critical_friction: the body slides freely along its contact; hold it by a [[support]],"
            " by symmetry, or by a node without friction that is held"
        )
    return S, follow


def _is_stiff(K: Array) -> bool:
    """Return whether a symmetric block resists every motion."""
    size = np.linalg.eigvalsh(0.5 * (K + K.T))
    return bool(size[0] > NO_STIFFNESS * size[-1])
