"""The displacements of a contact whose states are given, by one linear solve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem, neutral_motions, reactions


def solve_directly(
    system: ContactSystem, load: Array, u: Array, v_ref: Array, state: NDArray[np.integer]
) -> Array | None:
    """Return the displacements in given states, from eqs. (4), (6), (8) and (10) at once.

    Along a rigid motion that the states leave free, where K is round-off, the body stays where it
    is.

    Args:
        system: the condensed body, ``kind = "frictional"``.
        load: (n_loads,) load factors.
        u: (2N,) displacements of the held freedoms; of the others any, from where the body does not
            move along free rigid motions.
        v_ref: (N,) where stuck nodes stick.
        state: (N,) states.

    Returns:
        (2N,) displacements, None if the body has another motion without stiffness in these states.
    """
    n, K, held = system.n, system.K, system.held
    u = u.copy()
    grounded = (state != State.SEPARATION) & ~held[n:]
    u[n:][grounded] = -system.g0[grounded]
    stuck = (state == State.STICK) & ~held[:n]
    u[:n][stuck] = v_ref[stuck]
    free_t = np.flatnonzero((state != State.STICK) & ~held[:n])
    free_n = np.flatnonzero((state == State.SEPARATION) & ~held[n:])
    free = np.concatenate([free_t, n + free_n])
    if len(free) == 0:
        return u
    motions = neutral_motions(system.rigid, np.concatenate([stuck, grounded]))
    if motions.shape[1]:
        K = K + float(np.abs(np.diagonal(K)).max()) * motions @ motions.T
    f = system.friction.at_slip(state)[free_t]
    rows = K.take(free, axis=0)
    rows[: len(f)] += f[:, None] * K.take(n + free_t, axis=0)
    matrix = rows.take(free, axis=1)
    r = reactions(system, load, u)
    rhs = r[free]
    rhs[: len(f)] += f * r[n + free_t]
    try:
        u[free] -= np.linalg.solve(matrix, rhs)
    except np.linalg.LinAlgError:
        return None
    return u
