"""One static problem: the contact under a finite load, slip counted from a given state."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import NotConverged
from receding_fenicsx.interface import gauss_seidel
from receding_fenicsx.interface.contact import (
    Array,
    ContactState,
    largest_force,
    local_stiffness,
    reactions,
    relative_residual,
    round_off,
)
from receding_fenicsx.interface.contact_lcp import Undecided, solve_states
from receding_fenicsx.interface.rates import STICK, SingularExchange
from receding_fenicsx.interface.segments import Segments

STATIC_RESIDUAL = 1e-13
"""Residual asked of Gauss-Seidel, where round-off allows it."""

ACCEPTED_RESIDUAL = 1e-11
"""Residual up to which the finite method's answer is accepted, where round-off allows it."""


def solve_static(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    """Solve the static problem from ``start`` to ``load``; None when no solution was found.

    Gauss-Seidel with polish comes first, the finite method when it does not converge.

    Args:
        segments: of the condensed body.
        start: displacements that slip is counted from; its open nodes are taken as touching.
        load: (n_loads,) load factors.
    """
    system, n = segments.system, segments.system.n
    options = gauss_seidel.GaussSeidelOptions(
        max_sweeps=max(400, 4 * n), residual_tolerance=STATIC_RESIDUAL
    )
    try:
        return gauss_seidel.solve_step(system, start, load, options).end
    except NotConverged:
        pass
    nothing = np.zeros(0, dtype=np.intp)
    u0 = np.concatenate([start.v, np.where(system.held[n:], start.w, -system.g0)])
    nodes = Undecided(
        nothing, nothing, np.flatnonzero(segments.frictional), np.flatnonzero(segments.smooth)
    )
    free_v = np.flatnonzero(~system.held[:n] & ~segments.frictional)
    state = solve_states(system, reactions(system, load, u0), nodes, free_v)
    if state is None:
        return None
    state[state == 0] = STICK
    try:
        tableau = segments.tableau(state)
    except SingularExchange:
        return None
    u = u0.copy()
    for _ in range(3):
        u = u + tableau.correction(reactions(system, load, u))
    end = ContactState(u, reactions(system, load, u), state)
    scale = largest_force(system, load, end.r, 0.0)
    residual = relative_residual(system, end, end.v - start.v, local_stiffness(system), scale)
    accepted = max(ACCEPTED_RESIDUAL, round_off(system, u, scale))
    return end if residual <= accepted else None
