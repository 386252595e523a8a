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

BRIEF_SWEEPS = 400
LONG_SWEEPS = 20000
"""Gauss-Seidel sweeps before and after the finite method."""

STATIC_RESIDUAL = 1e-13
"""Residual asked of Gauss-Seidel, where round-off allows it."""

ACCEPTED_RESIDUAL = 1e-11
"""Residual up to which the finite method's answer is accepted, where round-off allows it."""


def solve_static(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    """Solve the static problem from ``start`` to ``load``; None when no solution was found.

    Gauss-Seidel with polish comes first, then the finite method, then Gauss-Seidel with patience: a
    nearly incompressible body takes thousands of sweeps.

    Args:
        segments: of the condensed body.
        start: displacements that slip is counted from; its open nodes are taken as touching by the
            finite method.
        load: (n_loads,) load factors.
    """
    for attempt in (_sweep_briefly, _pivot, _sweep_long):
        end = attempt(segments, start, load)
        if end is not None:
            return end
    return None


def _sweep_briefly(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    return _sweep(segments, start, load, BRIEF_SWEEPS)


def _sweep_long(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    return _sweep(segments, start, load, LONG_SWEEPS)


def _sweep(
    segments: Segments, start: ContactState, load: Array, sweeps: int
) -> ContactState | None:
    options = gauss_seidel.GaussSeidelOptions(max_sweeps=sweeps, residual_tolerance=STATIC_RESIDUAL)
    try:
        return gauss_seidel.solve_step(segments.system, start, load, options).end
    except NotConverged:
        return None


def _pivot(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    """Solve by linear complementarity, every node being undecided."""
    system, n = segments.system, segments.system.n
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
