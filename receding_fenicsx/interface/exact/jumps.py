"""Jumps of the contact where no quasi-static path continues."""

from __future__ import annotations

from dataclasses import dataclass

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoQuasiStaticContinuation
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.system import ContactState

JUMP_STEP = 1e-7
"""Part of the leg beyond a jump at which the state after it is solved for: at the jump itself the
state before is still an equilibrium."""

MAX_JUMPS = 100
"""Jumps on one leg after which an error is raised."""


@dataclass(frozen=True)
class Jump:
    """A jump at constant load.

    Attributes:
        end: state after it.
        work: sum lambda r* . change of u, as in the energy identity.
        released: energy -(change of 1/2 u K u + work), lost to friction and motion together.
    """

    end: ContactState
    work: float
    released: float


def find_jump(segments: Segments, start: ContactState, load: Array, place: Array) -> Jump:
    """Solve a static problem for the state after a jump, with slip counted from the state before.

    Args:
        segments: of the condensed body.
        start: state before the jump.
        load: (n_loads,) load factors just beyond.
        place: (n_loads,) load factors that an error names.

    Raises:
        NoQuasiStaticContinuation: no state was found.
    """
    end = solve_static(segments, start, load)
    if end is None:
        raise no_state_beyond(place)
    system, change = segments.system, end.u - start.u
    stored = 0.5 * float(change @ system.K @ (end.u + start.u))
    work = float(load @ system.r_star @ change)
    return Jump(end, work, -stored - work)


def no_state_beyond(place: Array) -> NoQuasiStaticContinuation:
    """Return the error for a jump that leads to no state."""
    return NoQuasiStaticContinuation(
        f"no quasi-static continuation at load factors [{_listed(place)}], and no state was found "
        "to jump to; reduce the friction or the load range"
    )


def check_jumps(jumps: int, place: Array) -> None:
    """Raise NoQuasiStaticContinuation when so many jumps on one leg are too many."""
    if jumps >= MAX_JUMPS:
        raise NoQuasiStaticContinuation(
            f"the contact has jumped {MAX_JUMPS} times on one leg and jumps again at load factors "
            f"[{_listed(place)}]; reduce the friction or the load range"
        )


def _listed(load: Array) -> str:
    return ", ".join(f"{value:.9g}" for value in load)
