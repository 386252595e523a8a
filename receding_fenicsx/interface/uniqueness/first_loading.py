"""Solutions of a static problem from rest: how many states an assembled contact may take.

With every node on all its limits no certificate is known that serves fine meshes. For few nodes all
sets of states are tried, which is proof. Otherwise Newton's method on sets of states starts from
slip of all nodes either way, and Lemke's method from several covering vectors: other solutions may
be found, but are not excluded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.static import end_in_states, states_by_newton
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import (
    Undecided,
    choices,
    number_of_sets,
    states_by_covers,
)
from receding_fenicsx.interface.residual import (
    largest_force,
)
from receding_fenicsx.interface.system import ContactState, reactions
from receding_fenicsx.interface.tolerances import SAME_RATES
from receding_fenicsx.interface.uniqueness.certificate import Certificate, States


def solutions_from_rest(
    certificate: Certificate,
    segments: Segments,
    start: ContactState,
    known: States,
    load: Array,
    near: NDArray[np.bool_],
) -> tuple[NDArray[np.int8], bool]:
    """Find the solutions of a static problem, and say whether there are no others.

    Without friction there is one, the problem being convex.

    Args:
        certificate: of the contact.
        segments: of the contact.
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
        # six nodes with friction
        if number_of_sets(list(choices(undecided).values())) <= 4**6:
            found = all_solutions(*problem)
            return np.where(found.states > 0, found.states, others), found.complete
        ends = [known]
        for first in (FORWARD, BACKWARD) if near.all() else ():
            end = states_by_newton(system, start, load, first)
            ends += [] if end is None else [end.state]
        ends += states_by_covers(*problem) if rubbing.sum() <= 40 else ()
    except np.linalg.LinAlgError:
        return np.zeros((0, n), dtype=np.int8), False
    kept, forces = list[States](), list[Array]()
    for state in {state.tobytes(): state for state in ends}.values():
        solution = end_in_states(segments, start, load, np.where(state > 0, state, others))
        if solution is None:
            continue
        different = SAME_RATES * largest_force(system, load, solution.r, 0.0)
        if all(np.abs(solution.r - other).max() > different for other in forces):
            kept.append(solution.state)
            forces.append(solution.r)
    return np.array(kept, dtype=np.int8).reshape(-1, n), False
