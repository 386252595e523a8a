"""Mean loads of a range: whether a residual slip holds them, and which nodes they separate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, NoEquilibrium
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.shakedown.margins import LoadRange, Margins, margins_of
from receding_fenicsx.interface.shakedown.programs import VANISHES, Answer, minimise
from receding_fenicsx.interface.system import ContactState, ContactSystem

MOST_NAMED = 6
"""Nodes that an error message names."""
REFUSE, STAY = "refuse", "stay"
"""Nodes separated under the mean loads: an error, or taken as separated throughout."""


def prepared(
    system: ContactSystem, loads: LoadRange, separated: str = REFUSE
) -> tuple[Margins, NDArray[np.bool_]]:
    """Return the margins of a range and the separated nodes; refuse what has no limits.

    Raises:
        InputError: as :func:`shakedown_limits`.
    """
    if system.kind == "normal" or not np.any(system.friction.present):
        raise InputError("shakedown: the scene has no friction; give [contact] friction")
    if separated not in (REFUSE, STAY):
        raise InputError(f'separated: "{separated}" is unknown; use "{REFUSE}" or "{STAY}"')
    away = np.zeros(system.n, dtype=bool)
    if separated == STAY:
        away = _mean_state(system, loads.mean).state == SEPARATION
    margins = margins_of(system, loads, away)
    answer = largest_margin(margins)
    if answer.value <= 1.0 + VANISHES:
        return margins, away
    nodes = np.unique(margins.node[answer.multipliers > VANISHES])
    reason = "change the mean loads or the friction"
    if separated == REFUSE:
        try:
            away = _mean_state(system, loads.mean).state == SEPARATION
        except NoEquilibrium as error:
            reason = str(error)
        if np.any(away):
            raise InputError(
                f"mean: {_named(system, np.flatnonzero(away))} separated under the mean loads; "
                "press the contact together, or take these nodes as separated throughout by "
                f'separated = "{STAY}"'
            )
    raise InputError(
        f"mean: no residual slip can hold the mean loads: {_named(system, nodes)} beyond the "
        f"limit; {reason}"
    )


def _mean_state(system: ContactSystem, mean: Array) -> ContactState:
    """Return the state under the mean loads, applied to the contact at rest.

    Raises:
        NoEquilibrium: no contact forces balance them.
    """
    n = system.n
    state = np.where(system.g0 > 0.0, SEPARATION, STICK).astype(np.int8)
    rest = ContactState(np.zeros(2 * n), np.zeros(2 * n), state)
    return EventPath(system).trace_leg(rest, (np.zeros_like(mean), mean), 0.0).end


def _named(system: ContactSystem, nodes: NDArray[np.integer]) -> str:
    """Return nodes with their positions and a verb, for messages."""
    names = [f"{i} (x = {system.x[i]:.4g})" for i in nodes[:MOST_NAMED]]
    more = f" and {len(nodes) - MOST_NAMED} more" if len(nodes) > MOST_NAMED else ""
    one = len(nodes) == 1
    return f"node{'' if one else 's'} {', '.join(names)}{more} {'is' if one else 'are'}"


def largest_margin(margins: Margins) -> Answer:
    """Return the residual slip whose smallest margin t <= 1 under the mean loads is the largest.

    The answer's value is 1 - t: at most 1 where a residual slip holds the mean loads.
    """
    shift = np.hstack([margins.G, np.ones((len(margins.c), 1))])
    cost = np.append(np.zeros(margins.G.shape[1]), 1.0)
    # t = 1 - z with z >= 0
    return minimise(cost, shift, margins.c - 1.0)
