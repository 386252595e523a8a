"""Solutions of a static problem from rest: how many states an assembled contact may take.

With every node on all its limits no certificate is known that serves fine meshes. For few nodes all
sets of states are tried, which is proof. Otherwise Newton's method on sets of states starts from
slip of all nodes either way, and Lemke's method from several covering vectors: other solutions may
be found, but are not excluded.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.static import states_by_newton
from receding_fenicsx.interface.gauss_seidel.direct import solve_directly
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp import enumerate_states
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import Undecided, choices, states_by_covers
from receding_fenicsx.interface.residual import (
    largest_force,
    local_stiffness,
    reachable,
    relative_residual,
)
from receding_fenicsx.interface.system import ContactState, reactions
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL, SAME_RATES
from receding_fenicsx.interface.uniqueness.definite import Certificate, States

TRIED = 4**6
"""Sets of states up to which all are tried: six nodes with friction."""

MOST_COVERED = 40
"""Nodes with friction up to which Lemke's method is tried."""


def solutions_from_rest(
    certificate: Certificate,
    start: ContactState,
    known: States,
    load: Array,
    near: NDArray[np.bool_],
) -> tuple[NDArray[np.int8], bool]:
    """Find the solutions of a static problem, and say whether there are no others.

    Without friction there is one, the problem being convex.

    Args:
        certificate: of the contact.
        start: state without reactions that slip is counted from.
        known: (N,) states of the solution that the path has found.
        load: (n_loads,) load factors.
        near: (N,) nodes without gap; others stay open.

    Returns:
        (k, N) states of all nodes, a row for each solution with different reactions; and whether
        it is proved that there are no others.
    """
    system, n = certificate.system, certificate.system.n
    rubbing = near & certificate.frictional
    nothing = np.zeros(0, dtype=np.intp)
    undecided = Undecided(
        nothing, nothing, np.flatnonzero(rubbing), np.flatnonzero(near & certificate.smooth)
    )
    if not rubbing.any():
        return start.state[None], True
    u0 = np.concatenate([start.v, np.where(system.held[n:] | ~near, start.w, -system.g0)])
    problem = system, reactions(system, load, u0), undecided, certificate.free(~near)
    others = np.where(near, STICK, SEPARATION)
    try:
        if enumerate_states.count(list(choices(undecided).values())) <= TRIED:
            found = all_solutions(*problem)
            return np.where(found.states > 0, found.states, others), found.complete
        covers = states_by_covers(*problem) if rubbing.sum() <= MOST_COVERED else iter(())
        ends = [known, *_by_newton(certificate, start, load, near), *covers]
    except np.linalg.LinAlgError:
        return np.zeros((0, n), dtype=np.int8), False
    every = [np.where(state > 0, state, others) for state in ends]
    different = list({state.tobytes(): state for state in every}.values())
    return _distinct(certificate, start, load, different), False


def _by_newton(
    certificate: Certificate, start: ContactState, load: Array, near: NDArray[np.bool_]
) -> Iterator[States]:
    """Yield the states that Newton's method reaches where all nodes begin to slip."""
    if near.all():
        for first in (FORWARD, BACKWARD):
            end = states_by_newton(certificate.system, start, load, first)
            if end is not None:
                yield end.state


def _distinct(
    certificate: Certificate, start: ContactState, load: Array, every: list[States]
) -> NDArray[np.int8]:
    """Return those sets of states that satisfy the contact law, one for each set of reactions."""
    system, kept, forces = certificate.system, [], list[Array]()
    for state in every:
        given = state.copy()
        # a node without friction slides freely
        given[certificate.loose[state[certificate.loose] == STICK]] = FORWARD
        u = solve_directly(system, load, start.u, start.v, given)
        if u is None:
            continue
        end = ContactState(u, reactions(system, load, u), state)
        scale = largest_force(system, load, end.r, 0.0)
        residual = relative_residual(system, end, end.v - start.v, local_stiffness(system), scale)
        if residual > max(ACCEPTED_RESIDUAL, reachable(system, u, scale)):
            continue
        if all(np.abs(end.r - other).max() > SAME_RATES * scale for other in forces):
            kept.append(state)
            forces.append(end.r)
    return np.array(kept, dtype=np.int8).reshape(-1, system.n)
