"""One static problem: the contact under a finite load, slip counted from a given state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NotConverged
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.gauss_seidel.sweeps import (
    GaussSeidelOptions,
    solve_directly,
    solve_step,
)
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, natural_states
from receding_fenicsx.interface.lcp.contact import Undecided, solve_states
from receding_fenicsx.interface.residual import (
    is_carried_by_round_off,
    largest_force,
    reachable,
    relative_residual,
)
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL


def solve_static(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    """Solve the static problem from ``start`` to ``load``; None when no solution was found.

    Tried in turn: Newton's method on whole sets of states, which mostly converges in a few steps;
    Gauss-Seidel with polish; linear complementarity; Newton's method from several starts, of which
    slender bodies take as many steps as there are nodes that open one after the other; Gauss-Seidel
    with many sweeps, of which a nearly incompressible body takes thousands.
    """
    system = segments.system
    attempts = (
        lambda: states_by_newton(system, start, load),
        lambda: _sweep(system, start, load, 400, 1e-13),
        lambda: _pivot(segments, start, load),
        lambda: _patient_newton(system, start, load),
        lambda: _sweep(system, start, load, 20000, ACCEPTED_RESIDUAL),
    )
    for attempt in attempts:
        end = attempt()
        if end is None:
            continue
        scale = largest_force(system, load, end.r, 0.0)
        if not is_carried_by_round_off(system, end.u, scale):
            return end
    return None


def _patient_newton(system: ContactSystem, start: ContactState, load: Array) -> ContactState | None:
    """Solve by Newton's method from several starts, each followed until its sets return.

    They are: all nodes with friction in one state, and the contact without friction.
    """
    for first in (STICK, FORWARD, BACKWARD, SEPARATION):
        end = states_by_newton(system, start, load, first, patient=True)
        if end is not None:
            return end
    return None


def states_by_newton(
    system: ContactSystem,
    start: ContactState,
    load: Array,
    first: int = STICK,
    patient: bool = False,
) -> ContactState | None:
    """Solve with whole sets of states, each read from the law's natural map at the last answer.

    This is Newton's method for the natural map; it has no proof of convergence with friction. It
    ends where a set returns. Unless it is patient it ends also where sets oscillate, two times
    running fewer than half as many nodes having changed after two steps as after one, and where the
    start has gaps, so that first contact is not where the node is.

    All nodes with friction begin in the state ``first``. A patient search takes open nodes as
    linear complementarity does.
    """
    n = system.n
    if not patient and np.any((system.g0 + start.w)[~system.held[n:]] != 0.0):
        return None
    k_t, k_n = system.local_stiffness
    loose, can_open = ~system.held[:n], ~system.held[n:]
    frictionless = ~system.friction.present
    state = np.where(loose & ~frictionless, first, STICK).astype(np.int8)
    state[loose & frictionless] = FORWARD
    seen: set[bytes] = set()
    last, before, oscillates = state, state, False
    most = 3 * n if patient else 30
    while len(seen) < most and state.tobytes() not in seen:
        changed = [np.count_nonzero(state != other) for other in (before, last)]
        comes_back = not patient and len(seen) > 1 and 2 * changed[0] < changed[1]
        if comes_back and oscillates:
            return None
        oscillates = comes_back
        seen.add(state.tobytes())
        u = solve_directly(system, load, start.u, start.v, state)
        if u is None:
            return None
        r = reactions(system, load, u)
        trial = r[:n] - k_t * (u[:n] - start.v), r[n:] - k_n * (system.g0 + u[n:])
        before, last = last, state
        state = natural_states(system.friction, r[n:], trial, loose, can_open)
        if np.array_equal(state, last):
            state[frictionless & (state != SEPARATION)] = STICK
            return _accepted(system, start, load, ContactState(u, r, state))
    return None


def _accepted(
    system: ContactSystem, start: ContactState, load: Array, end: ContactState
) -> ContactState | None:
    """Return the end if it satisfies the contact law."""
    scale = largest_force(system, load, end.r, 0.0)
    slip = end.v - start.v
    residual = relative_residual(system, end, slip, system.local_stiffness, scale)
    accepted = max(ACCEPTED_RESIDUAL, reachable(system, end.u, scale))
    return end if residual <= accepted else None


def _sweep(
    system: ContactSystem, start: ContactState, load: Array, sweeps: int, residual: float
) -> ContactState | None:
    """Solve by Gauss-Seidel with polish, in so many sweeps to so small a residual."""
    options = GaussSeidelOptions(max_sweeps=sweeps, residual_tolerance=residual)
    try:
        return solve_step(system, start, load, options, patient=True).end
    except NotConverged:
        return None


def touching_start(segments: Segments, start: ContactState) -> Array:
    """Return the (2N,) displacements of a start with all gaps closed."""
    system = segments.system
    return np.concatenate([start.v, np.where(system.held[system.n :], start.w, -system.g0)])


def static_problem(
    segments: Segments, start: ContactState, load: Array
) -> tuple[ContactSystem, Array, Undecided, NDArray[np.intp]]:
    """Return a static problem for linear complementarity, every node being undecided."""
    system, nothing = segments.system, np.zeros(0, dtype=np.intp)
    nodes = Undecided(
        nothing, nothing, np.flatnonzero(segments.frictional), np.flatnonzero(segments.smooth)
    )
    free_v = np.flatnonzero(~system.held[: system.n] & ~segments.frictional)
    return system, reactions(system, load, touching_start(segments, start)), nodes, free_v


def _pivot(segments: Segments, start: ContactState, load: Array) -> ContactState | None:
    """Solve by linear complementarity, every node being undecided."""
    try:
        state = solve_states(*static_problem(segments, start, load))
    except np.linalg.LinAlgError:  # a motion that nothing resists
        return None
    if state is None:
        return None
    return end_in_states(segments, start, load, state)


def end_in_states(
    segments: Segments, start: ContactState, load: Array, state: States
) -> ContactState | None:
    """Return the answer of a static problem in given states; None where it breaks the law.

    Open nodes are taken as touching; states 0 do not matter.
    """
    system, n = segments.system, segments.system.n
    state = np.where(state == 0, STICK, state).astype(np.int8)
    u = touching_start(segments, start)
    try:
        tableau = segments.tableau(state)
    except SingularExchange:
        return None
    for _ in range(3):
        u = u + tableau.correction(reactions(system, load, u))[: 2 * n]
    end = ContactState(u, reactions(system, load, u), state)
    return _accepted(system, start, load, end)
