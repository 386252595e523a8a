"""Where no quasi-static path continues: the error that says why, or a jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.exact.legs import PathPoint
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg

MAX_JUMPS = 100
"""Jumps on one leg after which an error is raised."""


@dataclass(frozen=True)
class Jump:
    """A jump at constant load."""

    end: ContactState  # state after it
    work: float  # sum lambda r* . change of u, as in the energy identity
    released: float  # energy -(change of 1/2 u K u + work), lost to friction and motion together


def find_jump(segments: Segments, start: ContactState, load: Array, place: Array) -> Jump:
    """Solve a static problem for the state after a jump, with slip counted from the state before.

    ``load`` is just beyond, ``place`` the load factors that an error names.

    Raises:
        NoQuasiStaticContinuation: no state was found.
    """
    system, end = segments.system, solve_static(segments, start, load)
    if end is None:
        raise no_state_beyond(system, place)
    return jump_between(system, start, end, load)


def jump_between(
    system: ContactSystem, start: ContactState, end: ContactState, load: Array
) -> Jump:
    """Return the jump between two states under load factors (n_loads,), with its energies."""
    change = end.u - start.u
    stored = 0.5 * float(change @ system.K @ (end.u + start.u))
    work = float(load @ system.r_star @ change)
    return Jump(end, work, -stored - work)


def add_jump(
    leg: Leg, part: tuple[float, float], jump: Jump, samples: tuple[float, ...] = ()
) -> None:
    """Add a jump between two places to what has been followed of a leg.

    States at places of samples in between are those before it.
    """
    leg.samples += [(place, leg.end) for place in samples if part[0] < place <= part[1]]
    jumped = Changes.between(part[1], leg.end.state, jump.end.state)
    leg.events = Changes.joined(leg.events, jumped)
    leg.stops.append((part[1], jump.end.u))
    leg.jumps.append((part[0], jump.released))
    leg.end, leg.work = jump.end, leg.work + jump.work


def no_state_beyond(system: ContactSystem, place: Array) -> NoQuasiStaticContinuation:
    """Return the error for a jump that leads to no state."""
    return NoQuasiStaticContinuation(
        f"no quasi-static continuation at {system.load_text(place)}, and no state was found "
        "to jump to; reduce the friction or the load range"
    )


def lost_by_loose_motion(system: ContactSystem, load: Array) -> SolveError:
    """Return the error for states of the exact path that leave a motion without stiffness."""
    return SolveError(
        f"the exact path is lost on the way to {system.load_text(load)}: a motion of the body is "
        "left that nothing resists; add a [[support]], or use method gauss-seidel"
    )


def check_jumps(system: ContactSystem, jumps: int, place: Array) -> None:
    """Raise NoQuasiStaticContinuation when so many jumps on one leg are too many."""
    if jumps >= MAX_JUMPS:
        raise NoQuasiStaticContinuation(
            f"the contact has jumped {MAX_JUMPS} times on one leg and jumps again at "
            f"{system.load_text(place)}; reduce the friction or the load range"
        )


def explain(
    segments: Segments,
    point: PathPoint,
    states: States,
    force_scale: float,
    nodes: NDArray[np.intp],
    exhausted: bool,
) -> SolveError:
    """Return the error for a path that ends: lift-off, gross sliding or no continuation.

    ``nodes`` are those whose rates have no solution; ``exhausted``: all sets of their states were
    tried.
    """
    s = point.problem.place(point.s)
    load = point.load
    # round-off of the leg's load factors is called zero
    load[np.abs(load) <= 1e-12 * np.abs(point.problem.ends).max()] = 0.0
    where = f"at {segments.system.load_text(load)} (s = {s:.9g} of the leg)"
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
    listed = ", ".join(map(str, nodes[:12].tolist())) + " ..." * (len(nodes) > 12)
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
