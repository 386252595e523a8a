"""Rolling: rigid motions along which a body without contact forces comes to rest.

A crowned body with gaps that is pressed beside the nodes which touch first rolls, as a rigid body
and without forces, until it rests below the load. With the rigid motions R c that leave the contact
nodes where they are tangentially and the rate of the loads d it minimises their potential:

    min_c  (sum_k d_k r*_k) . R c   so that   g0 + w + (R c)_n >= 0,

a linear program, whose multipliers are the forces that carry the first load.
"""

from __future__ import annotations

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.rest import carries_nothing
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem, has_rigid
from receding_fenicsx.interface.tolerances import RESULTANT, RIGID_TOLERANCE

GAP_TOLERANCE = 1e-10
"""Gap, over the largest one, up to which a node touches."""


def at_rest(
    system: ContactSystem, start: ContactState, ends: tuple[Array, Array], force_scale: float
) -> ContactState:
    """Roll a body without contact forces to where it rests under the loads that come.

    Args:
        system: the condensed body in 2N form.
        start: a state. A body that is free to fall has to touch somewhere at first.
        ends: (n_loads,) load factors at both ends of the leg that begins here.
        force_scale: largest nodal force so far.

    Returns:
        The state from which the leg begins; ``start`` where forces act or the body rests already,
        or where the loads lift it off, which following the leg will find.
    """
    if not system.rigid.shape[1] or not carries_nothing(system, start, ends[0], force_scale):
        return start
    n, held = system.n, system.held
    _, size, right = np.linalg.svd(system.rigid[:n][~held[:n]], full_matrices=True)
    R = system.rigid @ right[np.count_nonzero(size > RIGID_TOLERANCE) :].T
    pressed = (ends[1] - ends[0]) @ system.r_star
    gap = np.maximum(system.g0 + start.w, 0.0)
    nodes = np.flatnonzero(~held[n:])
    largest, force = float(gap.max(initial=0.0)), float(np.abs(pressed).sum())
    falls = np.all(system.g0[nodes] > 0.0) and has_rigid(system.rigid, np.repeat([0.0, 1.0], n))
    if R.shape[1] == 0 or largest == 0.0 or force == 0.0 or falls:
        return start
    # gaps and forces are counted in their largest
    cost, normal, room = pressed @ R / force, R[n + nodes], gap[nodes] / largest
    cost[np.abs(cost) <= RESULTANT] = 0.0
    c = _lowest(cost, normal, room)
    # less potential gained is none, but where the body floats
    least = 1e-9 if np.any(start.state[nodes] != State.SEPARATION) else 0.0
    if c is None or cost @ c >= -least:
        return start
    u = start.u + largest * (R @ c)
    left = system.g0 + u[n:]
    touching = (left <= GAP_TOLERANCE * largest) & ~held[n:]
    u[n:][touching] = -system.g0[touching]
    state = np.where(touching, State.STICK, State.SEPARATION).astype(np.int8)
    return ContactState(u, np.zeros(2 * n), np.where(held[n:], start.state, state).astype(np.int8))


def _lowest(cost: Array, normal: Array, room: Array) -> Array | None:
    """Minimise cost . c with room + normal c >= 0; None where there is no minimum.

    Where the load acts just above one node the body may lean to either side: the middle of all
    minima is returned.
    """

    def solve(objective: Array, **equal: Array) -> Array | None:
        found = scipy.optimize.linprog(
            objective, A_ub=-normal, b_ub=room, bounds=(None, None), method="highs-ds", **equal
        )
        return found.x if found.success else None

    best = solve(cost)
    if best is None:
        return None
    level = {"A_eq": cost[None], "b_eq": np.array([cost @ best])}
    middle, widest = best, 0.0
    for axis in np.eye(len(cost)):
        low, high = solve(axis, **level), solve(-axis, **level)
        if low is not None and high is not None and axis @ (high - low) > widest:
            middle, widest = 0.5 * (low + high), axis @ (high - low)
    on = room + normal @ middle <= GAP_TOLERANCE
    # the vertex once more, without the tolerance of the program
    return middle - np.linalg.lstsq(normal[on], room[on] + normal[on] @ middle, rcond=None)[0]


def middle(motions: Array, gap: Array, open_: NDArray[np.bool_]) -> Array | None:
    """Return the rotation of a body that balances on one node to the middle of its play.

    There it can rotate equally far either way until another node touches.

    Args:
        motions: (2N, k) rigid motions that leave the contact closed.
        gap: (N,) gaps.
        open_: (N,) nodes that do not touch.

    Returns:
        (2N,) displacement; None where the rotation is not unique, or no node is on one side.
    """
    n = len(gap)
    size, right = np.linalg.svd(motions[n:], full_matrices=False)[1:]
    turns = motions @ right[size > RIGID_TOLERANCE].T
    if turns.shape[1] != 1:
        return None
    turn = turns[:, 0]
    rise, room = turn[n:][open_], np.maximum(gap[open_], 0.0)
    up, down = rise > RIGID_TOLERANCE, rise < -RIGID_TOLERANCE
    ends = [
        -float((room[up] / rise[up]).min(initial=np.inf)),
        float((room[down] / -rise[down]).min(initial=np.inf)),
    ]
    if not np.all(np.isfinite(ends)):
        return None
    return 0.5 * (ends[0] + ends[1]) * turn
