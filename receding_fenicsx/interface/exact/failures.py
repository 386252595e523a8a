"""Errors raised when the exact path cannot continue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.exact.legs import PathPoint
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.law import SEPARATION

LISTED_NODES = 12
"""Nodes that a message names at most."""

LOAD_ROUND_OFF = 1e-12
"""Load factor over the largest of its leg, up to which a message calls it zero."""


def explain(
    segments: Segments,
    point: PathPoint,
    states: States,
    force_scale: float,
    nodes: NDArray[np.intp],
    exhausted: bool,
) -> SolveError:
    """Return the error for a path that ends: lift-off, gross sliding or no continuation.

    Args:
        segments: of the condensed body.
        point: where the path ends.
        states: (N,) states on the way there.
        force_scale: largest nodal force of the history so far.
        nodes: those whose rates have no solution.
        exhausted: all sets of their states were tried.
    """
    s = point.problem.place(point.s)
    load = point.load
    load[np.abs(load) <= LOAD_ROUND_OFF * np.abs(point.problem.ends).max()] = 0.0
    factors = ", ".join(f"{value:.9g}" for value in load)
    where = f"at load factors [{factors}] (s = {s:.9g} of the leg)"
    contact = states != SEPARATION
    A, B = (point.y - segments.limit * force_scale).reshape(4, -1)[2:]
    if segments.lifts_freely and np.all(((A <= 0.0) & (B <= 0.0))[contact]):
        return _not_pressed(segments, contact, where, at_start=s == 0.0)
    loose = contact & segments.frictional
    all_slip = np.all(A[loose] <= 0.0) or np.all(B[loose] <= 0.0)
    if segments.slides_freely and loose.any() and all_slip:
        return NoEquilibrium(
            f"gross sliding {where}: all contact nodes are at their limit, in the same direction"
        )
    listed = ", ".join(map(str, nodes[:LISTED_NODES].tolist())) + " ..." * (
        len(nodes) > LISTED_NODES
    )
    which = f"the rates of nodes [{listed}]" if len(nodes) else "the rates of the contact"
    return NoQuasiStaticContinuation(
        f"no quasi-static continuation {where}: {which} have no solution"
        f"{' (all sets of their states were tried)' if exhausted else ''}, the body jumps here; "
        'solver.on_jump = "static" passes the jump, or reduce the friction or the load range'
    )


def _not_pressed(
    segments: Segments, contact: NDArray[np.bool_], where: str, at_start: bool
) -> NoEquilibrium:
    """Return the error for a body that nothing presses on its contact."""
    gap = segments.system.g0
    if at_start and not contact.any() and gap.min() > 0.0:
        return NoEquilibrium(
            f"the body is not held {where}: it touches nowhere, its smallest initial gap is "
            f"{gap.min():.3g}; take that off the gap, or add a [[support]]"
        )
    if at_start and np.any(gap):
        return NoEquilibrium(
            f"the body is not held {where}: the loads lift it or turn it about the nodes that "
            "touch first; move their resultant to above the contact, or add a [[support]]"
        )
    return NoEquilibrium(
        f"lift-off {where}: no pressure is left on the contact, nothing holds the body"
    )
