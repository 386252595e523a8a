"""Largest range of a contact that opens: a program finds a motion, exact cycles verify it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.shakedown.limits import ShakedownLimits
from receding_fenicsx.interface.shakedown.margins import Loads, load_range
from receding_fenicsx.interface.shakedown.opening import Opening, largest_opening
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SLIP_ROUND_OFF
from receding_fenicsx.scene.model import OutputOptions
from receding_fenicsx.studies.shakedown.cycles import FACTORS, dissipated, range_history

ALL_NODES, MOST_NODES = 6, 20
"""Nodes of a contact up to which all may open in a program, and most that may."""
BELOW = 0.999
"""Part of the range that is played."""


def opening_limit(
    system: ContactSystem,
    mean: Loads,
    range: Sequence[Loads],
    limits: ShakedownLimits,
    seen: float = np.inf,
) -> Opening:
    """Return the largest range found round which nodes open and close, and nothing slips.

    A mixed-integer program finds it, up to ``FACTORS[-1]`` times the upper limit of the closed
    contact; exact cycles from its slip at ``BELOW`` times this range verify it.

    Args:
        system: the condensed body, without initial gaps.
        mean: load factors of the mean loads, by name.
        range: changes of the load factors at the corners of the range at lambda = 1.
        limits: limits of the closed contact, the upper one positive and finite.
        seen: lambda of the exact cycles that tell which of more than ``ALL_NODES`` nodes may open.

    Raises:
        InputError: the loads are not the system's, there are gaps, or too many nodes open.
        SolveError: no motion was found, or exact cycles slip.
    """
    loads, top = load_range(system, mean, range), FACTORS[-1] * limits.upper
    if not 0.0 < top < np.inf or np.any(system.g0 > 0.0):
        raise InputError("opening_limit: needs a positive, finite upper limit and no initial gaps")

    def played(factor: float, slip: np.ndarray) -> Record:
        history, output = range_history(system, mean, range, factor), OutputOptions(1, ())
        start = np.where(system.held[: system.n], 0.0, slip)
        return evolve(system, history, None, output, initial_slip=start, until="limit")

    opens = np.ones(system.n, dtype=bool)
    if system.n > ALL_NODES:
        opens = limits.separated.copy()
        for slip in (limits.safe_slip_modelled, np.zeros(system.n)):
            with suppress(SolveError):  # a path that ends tells nothing
                opens |= _opened(system, played(min(seen, top), slip))
        if opens.sum() > MOST_NODES:
            raise InputError(
                f"opening_limit: {opens.sum()} nodes open, {MOST_NODES} at most are tried"
            )
    found = largest_opening(system, loads, opens, top)
    D = float(dissipated(system, played(BELOW * found.value, found.slip)).max())
    if D > SLIP_ROUND_OFF:
        raise SolveError(f"opening_limit: exact cycles from the slip found dissipate {D:.1e}")
    return replace(found, dissipation=D)


def _opened(system: ContactSystem, record: Record) -> NDArray[np.bool_]:
    """Return (N,) modelled nodes that are open at some time."""
    table, events = record.turning_points, record.events
    whole = np.any(table.state == SEPARATION, axis=0)
    whole[events.node[events.new == SEPARATION]] = True
    opens = np.zeros(system.n, dtype=bool)
    opens[mirror_of(system).index[whole]] = True
    return opens
