"""The residual of the contact law, evaluated afresh, and the scales that it is relative to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import SEPARATION, SLIP_SIGN
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.tolerances import ROUND_OFFS, TOO_FAR, TOO_FAR_ON_SPRINGS


def largest_force(system: ContactSystem, load: Array, r: Array, so_far: float) -> float:
    """Return the history's largest nodal force, the scale of every residual and force tolerance.

    Of one load (n_loads,), or of several (k, n_loads). An open contact has no force of its own:
    there a hundredth of the held reactions sum |lambda r*| sets the scale, also of loads that
    cancel, such as a fit and a bolt that is shortened for it.
    """
    held = float((np.abs(load) @ np.abs(system.r_star)).max(initial=0.0))
    return max(so_far, float(np.abs(r).max(initial=0.0)), 1e-2 * held)


def round_off(system: ContactSystem, u: Array, force_scale: float) -> float:
    """Return the relative residual that round-off of u alone leaves: eps max(|K| |u|) / scale."""
    if force_scale == 0.0:
        return 0.0
    return float(np.finfo(float).eps * (np.abs(system.K) @ np.abs(u)).max()) / force_scale


def reachable(system: ContactSystem, u: Array, force_scale: float) -> float:
    """Return the relative residual that is accepted for round-off."""
    return limit_excuse(system, ROUND_OFFS * round_off(system, u, force_scale), [u], force_scale)


def limit_excuse(
    system: ContactSystem, excused: float, u: list[Array], force_scale: float
) -> float:
    """Return a residual that round-off excuses, cut off at 1e-6 of the largest force.

    Beyond, that of a body which has moved far, tipping over, would let pass anything. The largest
    force is that of the contact or an elastic one, K u less its own round-off: soft springs may
    carry the loads of a body whose contact is open.
    """
    if not excused > 1e-6:
        return excused
    elastic = (
        float(np.abs(system.K @ at).max()) / force_scale
        - ROUND_OFFS * round_off(system, at, force_scale)
        for at in u
    )
    return min(excused, 1e-6 * max(1.0, *elastic))


def is_carried_by_round_off(system: ContactSystem, u: Array, force_scale: float) -> bool:
    """Return whether displacements are so large that round-off of K may balance the loads."""
    stiffness = system.largest_stiffness
    if stiffness * float(np.linalg.norm(u)) <= TOO_FAR * force_scale:
        return False
    size = max(force_scale, stiffness * float(np.abs(system.g0).max(initial=0.0)))
    basis = np.linalg.qr(system.rigid)[0]
    rigid, all_of_it = (np.abs(motion).max(initial=0.0) for motion in (basis @ (basis.T @ u), u))
    return bool(
        stiffness * rigid > TOO_FAR * size or stiffness * all_of_it > TOO_FAR_ON_SPRINGS * size
    )


def law_residual(
    system: ContactSystem,
    r: Array,
    u: Array,
    slip: Array,
    stiffness: tuple[Array, Array],
    touches: NDArray[np.bool_] | bool = True,
) -> Array:
    """Return the natural-map residual of the contact law, node by node, as a force.

    Normal: P - max(0, P - k_n g). Tangential: Q - clip(Q - k_t dv, -f_forward P+, f_backward P+),
    P+ = max(P, 0). Both vanish exactly when Signorini's and Coulomb's conditions hold (eqs. 4 to
    10). With a cohesion or a shear limit the clip is to those limits, 0 at open nodes: cohesion
    acts where a node ``touches`` (N,). The slip dv (N,) is that of the step or segment, from the
    point of first contact for a node that was open at its start; ``stiffness`` are k_t and k_n.

    Returned are absolute values (2N,), tangential part first, zero at held degrees of freedom; or
    (k, 2N) of k instants.
    """
    n = system.n
    k_t, k_n = stiffness
    Q, P, gap = r[..., :n], r[..., n:], system.g0 + u[..., n:]
    low, high = system.law.limits(P, touches)
    tangential = np.abs(Q - np.minimum(np.maximum(Q - k_t * slip, low), high))
    normal = np.abs(np.minimum(P, k_n * gap))
    both = np.concatenate([tangential, normal], axis=-1)
    both[..., system.held] = 0.0
    return both


def relative_residual(
    system: ContactSystem,
    state: ContactState,
    slip: Array,
    stiffness: tuple[Array, Array],
    force_scale: float,
) -> float:
    """Return the largest entry of :func:`law_residual` over the force scale."""
    if force_scale == 0.0:
        return 0.0
    touches = state.state != SEPARATION
    both = law_residual(system, state.r, state.u, slip, stiffness, touches)
    return float(both.max()) / force_scale


def residual_at_rest(system: ContactSystem, end: ContactState, force_scale: float) -> float:
    """Return the relative residual at one instant; a slipping node must be at its limit."""
    # a slip that leaves nothing but the limit
    beyond = 1e200 * SLIP_SIGN[end.state]
    return relative_residual(system, end, beyond, system.local_stiffness, force_scale)
