"""Complete unloading: all loads vanish, and the contact carries no force.

Where all loads vanish on a free body without gaps, equilibrium gives P = Q = 0 and K u = 0: every
node reaches all its limits at once, and no single set of states leads there. A leg that ends there
is followed up to a small remaining load, and its end is set to the displacements at rest.
"""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import EPSILON, Segments
from receding_fenicsx.interface.law import STICK
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.tolerances import REMAINING_LOAD, ROUND_OFFS

UNLOADED_FORCE = 1e-11
"""Nodal force, over the largest so far, up to which a contact is unloaded: round-off."""

UNLOADING_EVENTS = 1e-6
"""Part of a leg before its end at no load within which they may be round-off of the displacements
of a nearly singular body."""

UNLOADING_REFINEMENTS = 16
"""Steps of iterative refinement of the end of unloading at most: the round-off of far larger
displacements before must vanish there, and near-singular bodies gain little in a step."""


def carries_nothing(state: ContactState, force_scale: float) -> bool:
    """Return whether all reactions are round-off."""
    return float(np.abs(state.r).max(initial=0.0)) <= UNLOADED_FORCE * force_scale


def is_at_rest(system: ContactSystem, load: Array) -> bool:
    """Return whether all loads vanish on a contact that fits without gaps."""
    return not np.any(load) and not np.any(system.g0)


def is_closed(segments: Segments, state: ContactState, force_scale: float) -> bool:
    """Return whether no node is open: a body may come off some of its edges as it slides."""
    n = segments.system.n
    gap = (segments.system.g0 + state.w) * segments.weight[n : 2 * n]
    opened = gap[~segments.system.held[n:]].max(initial=0.0)
    return bool(opened <= UNLOADED_FORCE * force_scale)


def stops_short(segments: Segments, load: Array) -> bool:
    """Return whether a leg to this load has to stop at the remaining load."""
    return is_at_rest(segments.system, load) and segments.lifts_freely


def zero_crossing(ends: tuple[Array, Array]) -> float | None:
    """Return the s inside a leg at which all loads vanish together, or None."""
    a, b = ends
    back = a - b
    length = float(back.dot(back))
    s = float(a.dot(back)) / length if length > 0.0 else 0.0
    if not 0.0 < s < 1.0:
        return None
    load = (1.0 - s) * a + s * b
    return s if np.abs(load).max() <= REMAINING_LOAD * np.abs(a).max() else None


def displacements_at_rest(segments: Segments, end: ContactState) -> Array:
    """Return the (2N,) displacements of the unloaded body: the rigid sliding reached.

    It is the mean of the stuck nodes; all others are still displaced by the remaining load, and by
    round-off.

    Args:
        segments: of the condensed body.
        end: state under the remaining load.
    """
    system, n = segments.system, segments.system.n
    u = np.zeros(2 * n)
    if segments.slides_freely:
        stuck = segments.frictional & (end.state == STICK)
        u[:n] = (end.v[stuck] if stuck.any() else end.v).mean()
    u[:n][system.held[:n]] = end.v[system.held[:n]]
    return u


def keeps_limits(segments: Segments, start: Array, y: Array, force_scale: float) -> bool:
    """Return whether y (4N,) at the end of unloading passes limits by round-off at most.

    Args:
        segments: of the condensed body.
        start: (2N,) displacements at the start of the leg, whose round-off gaps keep.
        y: the quantities.
        force_scale: largest nodal force of the history so far.
    """
    n, weight = segments.system.n, segments.weight
    at_start = float(np.abs(start * weight[: 2 * n]).max())
    allowed = UNLOADED_FORCE * force_scale
    gaps = max(allowed, ROUND_OFFS * EPSILON * at_start)
    passed = y * weight
    return bool(passed[2 * n :].min() >= -allowed and passed[n : 2 * n].min() >= -gaps)
