"""Legs from rest and to rest.

**First loading.** Without gaps the law is homogeneous in the displacements and the forces, so that
the solution grows in proportion to the load (section 1.1 of the paper): one static problem, one set
of states along the whole leg.

**Complete unloading.** Where all loads vanish on a free body without gaps, equilibrium gives P = Q
= 0 and K u = 0: every node reaches all its limits at once, and no single set of states leads there.
A leg that ends there is followed up to a small remaining load, and its end is set to the
displacements at rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, SolveError
from receding_fenicsx.interface.equilibrium import Limit, of_round_off
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import EPSILON, Segments, States
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.residual import largest_force, reachable, relative_residual
from receding_fenicsx.interface.system import (
    Changes,
    ContactState,
    ContactSystem,
    Leg,
    neutral_motions,
)
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL, REMAINING_LOAD, ROUND_OFFS

UNLOADED_FORCE = 1e-11
"""Nodal force, over the largest so far, up to which a contact is unloaded: round-off."""

UNLOADING_EVENTS = 1e-6
"""Part of a leg before its end at no load within which they may be round-off of the displacements
of a nearly singular body."""

UNLOADING_REFINEMENTS = 16
"""Steps of iterative refinement of the end of unloading at most: the round-off of far larger
displacements before must vanish there, and near-singular bodies gain little in a step."""


def carries_nothing(
    system: ContactSystem, state: ContactState, load: Array, force_scale: float
) -> bool:
    """Return whether all contact forces under a load are round-off, also of its resultant."""
    force = float(np.abs(state.r[~system.held]).max(initial=0.0))
    none = UNLOADED_FORCE * force_scale
    if none < force <= 1e-6 * force_scale:  # more is excused nowhere
        of_u = reachable(system, state.u, force_scale) * force_scale
        none = max(of_u, of_round_off(system, load))
    return force <= none


def is_at_rest(system: ContactSystem, load: Array) -> bool:
    """Return whether all loads vanish on a contact that fits without gaps."""
    return not load.any() and not system.g0.any()


def is_closed(segments: Segments, state: ContactState, force_scale: float) -> bool:
    """Return whether no node is open: a body may come off some of its edges as it slides."""
    n = segments.system.n
    gap = (segments.system.g0 + state.w) * segments.weight[n : 2 * n]
    opened = gap[~segments.system.held[n:]].max(initial=0.0)
    return bool(opened <= UNLOADED_FORCE * force_scale)


def stops_short(segments: Segments, load: Array) -> bool:
    """Return whether a leg to this load has to stop at the remaining load."""
    return is_at_rest(segments.system, load) and segments.lifts_freely


def zero_crossing(system: ContactSystem, ends: tuple[Array, Array]) -> float | None:
    """Return the s inside a leg at which all loads vanish together, or None."""
    # factors of loads have units of their own: their forces are compared
    a, b = (load * system.load_forces for load in ends)
    if a.dot(b) >= 0.0:
        return None
    back = a - b
    s = float(a.dot(back) / back.dot(back))
    load = (1.0 - s) * a + s * b
    return s if s < 1.0 and np.abs(load).max() <= REMAINING_LOAD * np.abs(a).max() else None


def displacements_at_rest(segments: Segments, end: ContactState) -> Array:
    """Return the (2N,) displacements of the unloaded body: the rigid sliding reached.

    It is that of the stuck nodes, in each motion that several contacts leave free; where a motion
    has none, of all. All others are still displaced by the remaining load, and by round-off.
    """
    system, n = segments.system, segments.system.n
    u = np.zeros(2 * n)
    stuck = segments.frictional & (end.state == STICK)
    motions = neutral_motions(system.rigid, np.arange(2 * n) >= n)[:n]
    if motions.shape[1]:
        u[:n] = motions @ np.linalg.lstsq(motions[stuck], end.v[stuck], rcond=1e-9)[0]
        # what slides without a stuck node
        rest = neutral_motions(motions, stuck)
        u[:n] += rest @ (rest.T @ (end.v - u[:n]))
    return u


def keeps_limits(segments: Segments, start: Array, y: Array, force_scale: float) -> bool:
    """Return whether y (4N,) at the end of unloading passes limits by round-off at most.

    Gaps keep the round-off of the displacements ``start`` (2N,) at the start of the leg.
    """
    n, weight = segments.system.n, segments.weight
    at_start = float(np.abs(start * weight[: 2 * n]).max())
    allowed = UNLOADED_FORCE * force_scale
    gaps = max(allowed, ROUND_OFFS * EPSILON * at_start)
    passed = y * weight
    return bool(passed[2 * n :].min() >= -allowed and passed[n : 2 * n].min() >= -gaps)


def load_from_rest(segments: Segments, problem: LegProblem, limit: Limit | None) -> Leg:
    """Solve for the end of the leg, and return the leg on which all grows in proportion.

    With the slip counted from the start, the dissipation of a node is -1/2 Q (v_end - v_start) and
    the work of the loads 1/2 sum lambda r* . (u_end - u_start).

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
    """
    moved = slip * segments.weight[: len(slip)]
    stuck = (end.state == STICK) & (np.abs(moved) > force)
    contrary = segments.frictional & (stuck | (SLIP_SIGN[end.state] * moved < -force))
    slides = np.where(moved > 0.0, FORWARD, BACKWARD)
    new = np.where(end.P > force, slides, SEPARATION)
    states: States = np.where(contrary, new, end.state).astype(np.int8)
    return states
