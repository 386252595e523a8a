"""How far a leg can go at all: the load factor beyond which a body lifts off, slides or tips over.

The rigid motions R that supports leave do no elastic work, so that eq. (11) gives

    R^T r = R^T sum_k lambda_k r*_k,    P >= 0,  -f_forward P <= Q <= f_backward P.

How far along a leg such reactions exist is a linear program; where they end the body lifts off,
slides or tips over, whatever the path before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.optimize

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.tolerances import RESULTANT

SHORT = 1e-10
"""Part of the leg by which it has to fall short for its end to be called out of reach."""


class Limit(NamedTuple):
    """Where equilibrium ends on a leg."""

    s: float  # place on the leg
    kind: str  # "lift-off", "gross sliding" or "overturning"
    text: str  # what to tell the user


def furthest(system: ContactSystem, a: Array, b: Array) -> Limit | None:
    """Return where equilibrium ends on the leg from ``a`` to ``b``; None where it does not.

    Equilibrium exists at its start.
    """
    if system.rigid.shape[1] == 0:
        return None
    with_friction = _reach(system, a, b)
    if with_friction >= 1.0 - SHORT:
        return None
    load = (1.0 - with_friction) * a + with_friction * b
    if _reach(system, a, b, bounded=False) > with_friction + SHORT:
        kind, what = "gross sliding", "friction cannot hold the loads"
    else:
        kind, what = "overturning", "the body tips over the end of its contact"
        # the rigid motion nearest to lifting all nodes alike
        target = np.repeat([0.0, 1.0], system.n)
        motion = system.rigid @ np.linalg.lstsq(system.rigid, target, rcond=None)[0]
        pressure = float((load @ system.r_star)[system.n :] @ motion[system.n :])
        size = float(np.abs(np.vstack([a, b]) @ system.r_star).sum(axis=1).max())
        if np.abs(motion - target).max() <= 1e-9 and pressure <= 1e-8 * size:
            kind, what = "lift-off", "nothing presses the body on any more"
    text = (
        f"{kind} at {system.load_text(load)}: {what}, no contact forces balance the loads beyond; "
        "change their course, or add a [[support]]"
    )
    return Limit(with_friction, kind, text)


def is_balanced(system: ContactSystem, load: Array, end: ContactState) -> bool:
    """Return whether the contact forces of a state prove that equilibrium exists under a load.

    They keep the contact law; what the rigid motions feel of them beside the loads is the round-off
    of K u, which may carry a body that moves far.
    """
    elastic = end.r - load @ system.r_star
    carried = float(np.abs(system.rigid.T @ elastic).max(initial=0.0))
    return carried <= RESULTANT * float(np.abs(end.r).sum() + np.abs(elastic).sum())


def of_round_off(system: ContactSystem, load: Array) -> float:
    """Return the contact force that the round-off of the resultant of loads may leave."""
    return 10.0 * RESULTANT * float(np.abs(load @ system.r_star).sum())


def _reach(system: ContactSystem, a: Array, b: Array, bounded: bool = True) -> float:
    """Return the largest s in [0, 1] with balancing reactions."""
    n, R = system.n, system.rigid
    loose, pressed = ~system.held[:n], ~system.held[n:]
    P = np.flatnonzero(pressed)
    columns = [R[n + P].T]
    if not bounded:
        columns += [R[:n][loose].T, -R[:n][loose].T]
    else:
        Q = np.flatnonzero(loose & pressed & system.friction.present)
        # the edges of each friction cone: P = 1 with the lowest and the highest Q
        low, high = system.friction[Q, None].limits(np.ones((len(Q), 1)))
        columns += [(R[n + Q] + low * R[Q]).T, (R[n + Q] + high * R[Q]).T]
    start, way = R.T @ (a @ system.r_star), R.T @ ((b - a) @ system.r_star)
    # symmetric loads have a resultant of round-off
    none = RESULTANT * float(np.abs(np.vstack([a, b]) @ system.r_star).sum(axis=1).max())
    start[np.abs(start) <= none] = way[np.abs(way) <= none] = 0.0
    size = max(float(np.abs(start).max()), float(np.abs(way).max()))
    if size == 0.0:
        return 1.0
    # contact forces are counted in the size of the loads
    G, start = np.hstack([*columns, -way[:, None] / size]), start / size
    cost = np.zeros(G.shape[1])
    cost[-1] = -1.0
    bounds = [(0.0, None)] * (len(cost) - 1) + [(0.0, 1.0)]
    found = scipy.optimize.linprog(cost, A_eq=G, b_eq=start, bounds=bounds, method="highs-ds")
    if not found.success:
        return 0.0
    z = found.x
    if z[-1] >= 1.0:
        return 1.0
    # the vertex once more, without the tolerance of the program
    basis = np.flatnonzero(z[:-1] > 1e-9 * z[:-1].max(initial=0.0))
    basis = np.append(basis, len(z) - 1)
    exact = np.linalg.lstsq(G[:, basis], start, rcond=None)[0][-1]
    return float(np.clip(exact if abs(exact - z[-1]) <= 1e-5 else z[-1], 0.0, 1.0))
