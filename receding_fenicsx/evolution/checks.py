"""Checks of an evolving history: energy identity, range of the forces, landing of open nodes."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg
from receding_fenicsx.scene.history import History


def energy_error(
    system: ContactSystem,
    start: ContactState,
    ends: tuple[Array, Array],
    leg: Leg,
    energy_scale: float,
) -> tuple[float, float]:
    """Return the relative error of D + change of (1/2 u K u) + integral lambda r* . du = 0.

    With K u = r - sum lambda r* at both ends of a leg. The largest energy of a leg so far is
    returned too.
    """
    forces = leg.end.r + start.r - (ends[0] + ends[1]) @ system.r_star
    stored = 0.5 * float((leg.end.u - start.u) @ forces)
    D = float(leg.dissipation.sum()) + sum(energy for _, energy in leg.jumps)
    largest = max(energy_scale, abs(D) + abs(stored))
    F, u = leg.force_scale, float(np.abs(leg.end.u).max())
    # the largest entry of a stiffness matrix is on its diagonal
    K, k = float(system.diagonal.max()), system.typical_stiffness or np.inf
    # smallest scale over (F + K u) (F / k + u): F the largest nodal force, u the largest
    # displacement, K and k the largest and a typical stiffness. Residuals up to 1e-11 stay below
    # the tolerance
    least = 1e-5 * (F + K * u) * (F / k + u)
    # smallest scale of a leg's energy error, over the largest energy of a leg so far
    scale = max(abs(D) + abs(stored), 1e-4 * largest, least)
    return (abs(D + stored + leg.work) / scale if scale > 0.0 else 0.0), largest


def check_force_range(model: ContactSystem, history: History, force: float) -> None:
    """Raise SolveError where the cycles change the forces by no more than their round-off."""
    way = (history.loop - history.loop[0]) @ model.r_star
    change = float(np.abs(way).max(initial=0.0))
    if change < 1e-7 * force:
        raise SolveError(
            f"[history]: a cycle changes the forces by {change / force:.1e} of the largest; "
            f"below 1e-07 its events cannot be told from round-off: enlarge "
            "the load range"
        )


def check_landing(model: ContactSystem, end: ContactState) -> None:
    """Raise InputError where an open node with friction lands in the static problem of a first leg.

    Its slip counts from the place of first contact, which a static problem does not give.
    """
    slips = model.law.present & ~model.held[: model.n] & ~model.held[model.n :]
    landed = np.flatnonzero(slips & (model.g0 > 0.0) & (end.state != State.SEPARATION))
    if len(landed):
        i = int(landed[0])
        raise InputError(
            f"initial_slip: node {i} (x = {model.x[i]:.6g}) has an initial gap, "
            f"{model.g0[i]:.3g}, and lands on the first leg, which an initial slip makes one "
            "static problem: where its slip begins is not defined; leave out the initial slip, "
            "or the gap"
        )
