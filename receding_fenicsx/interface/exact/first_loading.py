"""First loading of an unloaded contact without gaps: one static problem.

Without gaps the law is homogeneous in the displacements and the forces, so that the solution grows
in proportion to the load (section 1.1 of the paper): one set of states holds along the whole leg.
"""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import NoEquilibrium
from receding_fenicsx.interface.equilibrium import Limit
from receding_fenicsx.interface.exact.legs import LegProblem, changes
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.residual import (
    largest_force,
    local_stiffness,
    relative_residual,
)
from receding_fenicsx.interface.system import ContactState, Leg


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
    """
    system, start, load = segments.system, problem.start, problem.ends[1]
    if limit is not None and limit.kind == "lift-off":
        raise NoEquilibrium(
            f"lift-off at load factors {[0] * len(load)}: the load factors {load.tolist()} "
            "pull the body off; check their signs, or add a [[support]]"
        )
    if limit is not None:
        raise NoEquilibrium(limit.text)
    end = solve_static(segments, start, load)
    if end is None:
        raise NoEquilibrium(
            f"no equilibrium was found under the load factors {load.tolist()}: they may lift, "
            "tip or slide the body (check their signs, or add a [[support]]), or friction and "
            "Poisson's ratio may be so high that none exists"
        )
    change, n = end.u - start.u, system.n
    scale = largest_force(system, load, end.r, problem.force_scale)
    slip = np.where(system.held[:n] | (end.state == SEPARATION), 0.0, change[:n])
    return Leg(
        end=end,
        dissipation=-0.5 * end.Q * slip,
        work=0.5 * float(load @ system.r_star @ change),
        residual=relative_residual(system, end, change[:n], local_stiffness(system), scale),
        force_scale=scale,
        samples=[
            (s, ContactState(start.u + s * change, s * end.r, end.state)) for s in problem.samples
        ],
        events=changes(0.0, start.state, end.state),
    )
