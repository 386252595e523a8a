"""Limit of ratchetting: the cycle that repeats itself but for a rigid motion of the body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.limit.frozen import Budget, Frozen, NoLimit
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle, MovedCycle
from receding_fenicsx.evolution.limit.newton import margin_rows, smallest_margins
from receding_fenicsx.evolution.limit.search import VIOLATED, Candidate
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.measures.steady import SLIP_ROUND_OFF
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.rigid_motions import neutral_motions
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

MAX_STEPS = 8
"""Newton steps after which the search is given up; those that succeed take one to five."""

REPEATS = 1e-12
"""Change of forces over a cycle, over the largest, that is none; the same for slips as forces."""

MOST = 0.6
"""Part of the touching nodes that slip along a common rigid motion where the body may walk."""


def walking_motions(system: ContactSystem) -> Array:
    """Return (N, k) tangential displacements of the rigid motions that slide on the contact."""
    kept = system.held.copy()
    kept[system.n :] = True
    return neutral_motions(system.rigid, kept)[: system.n]


def walk_of(motions: Array, slip: Array, touches: NDArray[np.bool_]) -> Array:
    """Return (N,) displacements of the rigid motion that is nearest to the slip (N,)."""
    t = np.linalg.lstsq(motions[touches], slip[touches], rcond=None)[0]
    walk: Array = motions @ t
    return walk


def may_walk(motions: Array, before: ContactState, start: ContactState) -> bool:
    """Return whether most nodes that touch have slipped in a cycle along one rigid motion."""
    touches = (before.state != SEPARATION) & (start.state != SEPARATION)
    if not motions.shape[1] or not np.any(touches):
        return False
    slip = start.v - before.v
    along = slip * walk_of(motions, slip, touches) > 0.0
    return bool(np.mean(along[touches]) >= MOST)


def find_walk(
    model: ContactSystem, start: ContactState, loop: Array, force: float, budget: Budget
) -> Candidate:
    """Find the state to which the starts of cycles tend but for a rigid motion in each.

    Forces repeat only if K d = 0 for the displacement d of a cycle, so that d = D t with the rigid
    motions D. Every node that touches slips by it, and none is frozen: with the slips s(x) of
    nodes stuck at the start of the cycle and shifts x of these there,

        s(x) = D t,    D^T x = 0 .

    Where a node does not slip yet, s = -m / k continues the slip by its smallest margin m towards
    the walk. In given states s is linear in x and one Newton step is exact.

    Raises:
        NoLimit: none was found.
    """
    motions, state = walking_motions(model), start
    try:
        for step in range(MAX_STEPS):
            stuck = np.flatnonzero(model.friction.present & (state.state == STICK))
            frozen = Frozen(model, np.zeros(0, dtype=int), stuck, loop, force, budget)
            cycle = frozen.cycle(state, np.zeros(len(stuck)))
            touches = (state.state != SEPARATION) & (cycle.end.state != SEPARATION)
            slip = cycle.end.v - state.v
            walk = walk_of(motions, slip, touches)
            uneven = (local_stiffness(model)[0] * np.abs(slip - walk))[touches].max(initial=0.0)
            residual = max(float(np.abs(cycle.end.r - state.r).max()), float(uneven)) / force
            if residual <= REPEATS:
                return Candidate(state, step, residual)
            state = _newton_step(frozen, cycle, motions, walk)
    except (SolveError, np.linalg.LinAlgError, SingularExchange) as error:
        raise NoLimit("a cycle of a body that walks ends early") from error
    raise NoLimit(f"{MAX_STEPS} Newton steps for a body that walks did not converge")


def _newton_step(frozen: Frozen, cycle: FrozenCycle, motions: Array, walk: Array) -> ContactState:
    """Return the start of the next cycle, in the states in which this one ends.

    Raises:
        NoLimit: the contact law does not hold there.
        LinAlgError: the slips do not determine the shifts.
    """
    model, nodes = frozen.system, frozen.shifted
    n, m, k = model.n, len(nodes), local_stiffness(model)[0]
    start, events = frozen.start_change(cycle.start), cycle.events
    S, ds = start[: 2 * n], events.moved(start[events.label])
    gained = events.change[:, : 2 * n].T @ ds
    s, J, D = (cycle.end.v - cycle.start.v)[nodes], gained[nodes], motions[nodes]
    still = np.abs(s) <= SLIP_ROUND_OFF * frozen.force / k[nodes]
    at_rest, sign = nodes[still], np.sign(walk[nodes[still]])
    low = smallest_margins(frozen, cycle, at_rest)
    margin, at = np.where(sign > 0.0, (low.A, low.at_A), (low.B, low.at_B))
    s[still] = -sign * margin / k[at_rest]
    rows = margin_rows(frozen, cycle, at_rest, sign, at.astype(int))
    J[still] = -(sign / k[at_rest])[:, None] * rows.moved(MovedCycle(S, ds), nodes)
    bordered = np.block([[J, -D], [D.T, np.zeros((D.shape[1],) * 2)]])
    x = np.linalg.solve(bordered, np.append(-s, np.zeros(D.shape[1])))[:m]
    u = cycle.end.u + (S + gained) @ x
    u[nodes] += x
    r, states = reactions(model, frozen.loop[0], u), cycle.end.state
    A, B = model.friction.margins(r[:n], r[n:])
    touches = states != SEPARATION
    least = min(np.minimum(A, B)[touches].min(), r[n:][touches].min()) / frozen.force
    if least < -VIOLATED or np.any((u[n:] + model.g0)[~touches] < 0.0):
        raise NoLimit("the start of a cycle of a body that walks would break the contact law")
    return ContactState(u, r, states.copy())
