"""First loading of an unloaded contact without gaps: one static problem.

Without gaps the law is homogeneous in the displacements and the forces, so that the solution grows
in proportion to the load (section 1.1 of the paper): one set of states holds along the whole leg.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, SolveError
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.residual import (
    largest_force,
    reachable,
    relative_residual,
)
from receding_fenicsx.interface.system import Changes, ContactState, Leg
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL


def load_from_rest(segments: Segments, problem: LegProblem, limit: Limit | None) -> Leg:
    """Solve for the end of the leg, and return the leg on which all grows in proportion.

    With the slip counted from the start, the dissipation of a node is -1/2 Q (v_end - v_start) and
    the work of the loads 1/2 sum lambda r* . (u_end - u_start).

    Args:
        segments: of the condensed body.
        problem: the leg; its start has no reactions.
        limit: where equilibrium ends between no load and the load at its end.

    Raises:
        NoEquilibrium: no contact forces balance the loads, or no solution was found.
        SolveError: the residual is above its tolerance.
    """
    system, start, load = segments.system, problem.start, problem.ends[1]
    if limit is not None and limit.kind == "lift-off":
        raise NoEquilibrium(
            f"lift-off at {system.load_text(0.0 * load)}: the loads {system.load_text(load)} "
            "pull the body off; check their signs, or add a [[support]]"
        )
    if limit is not None:
        raise NoEquilibrium(limit.text)
    end = solve_static(segments, start, load)
    if end is None:
        raise NoEquilibrium(
            f"no equilibrium was found under the loads {system.load_text(load)}: they may lift, "
            "tip or slide the body (check their signs, or add a [[support]]), or friction and "
            "Poisson's ratio may be so high that none exists"
        )
    if problem.chooser is not None:
        end = problem.chooser.choose_static(segments, problem, end)
    change, n = end.u - start.u, system.n
    scale = largest_force(system, load, end.r, problem.force_scale)
    slip = np.where(system.held[:n] | (end.state == SEPARATION), 0.0, change[:n])
    residual = relative_residual(system, end, change[:n], system.local_stiffness, scale)
    accepted = max(ACCEPTED_RESIDUAL, reachable(system, end.u, scale))
    if residual > accepted:
        raise SolveError(
            f"the first loading to {system.load_text(load)} lost accuracy: residual "
            f"{residual:.1e} over {accepted:.0e}; try the other solver method"
        )
    end = replace(end, state=_by_motion(segments, end, slip, accepted * scale))
    return Leg(
        end=end,
        dissipation=-0.5 * end.Q * slip,
        work=0.5 * float(load @ system.r_star @ change),
        residual=residual,
        force_scale=scale,
        samples=[
            (s, ContactState(start.u + s * change, s * end.r, end.state)) for s in problem.samples
        ],
        events=Changes.between(0.0, start.state, end.state),
        stops=[(0.0, start.u)],
    )


def _by_motion(segments: Segments, end: ContactState, slip: Array, force: float) -> States:
    """Return the states of the end, corrected where the motion of a node contradicts its own.

    Such a node, called stuck though it has moved or called slipping the other way, slips as it has
    moved; one that carries nothing is open.

    Args:
        segments: of the condensed body.
        end: a state that satisfies the contact law.
        slip: (N,) change of v.
        force: nodal force that counts as none.
    """
    moved = slip * segments.weight[: len(slip)]
    stuck = (end.state == STICK) & (np.abs(moved) > force)
    contrary = segments.frictional & (stuck | (SLIP_SIGN[end.state] * moved < -force))
    slides = np.where(moved > 0.0, FORWARD, BACKWARD)
    new = np.where(end.P > force, slides, SEPARATION)
    states: States = np.where(contrary, new, end.state).astype(np.int8)
    return states
