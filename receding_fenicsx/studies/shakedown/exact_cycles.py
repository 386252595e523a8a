"""Verdicts by exact cycles where the contact opens within the load range."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.measures.steady import SHAKEDOWN
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.shakedown.limits import ShakedownLimits
from receding_fenicsx.interface.shakedown.margins import Loads, load_range
from receding_fenicsx.interface.shakedown.opening import Opening, largest_opening
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SLIP_ROUND_OFF
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions

ALL_NODES, MOST_NODES = 6, 20
"""Nodes of a contact up to which all may open in a program, and most that may."""
BELOW = 0.999
"""Part of the range that is played."""


def range_history(
    system: ContactSystem,
    mean: Loads,
    range: Sequence[Loads],
    factor: float,
    cycles: int = 400,
) -> History:
    """Return the history that goes straight to the first vertex of a range and then round it.

    Corners are ``mean`` + ``factor`` ``range[k]``; it ends when it is steady, or after ``cycles``.
    """
    if not isinstance(factor, int | float) or not np.isfinite(factor):
        raise InputError(f"range_history: factor must be a finite number, not {factor!r}")
    loads = load_range(system, mean, range)
    corners = loads.mean + factor * loads.vertices
    path = np.vstack([np.zeros_like(loads.mean), corners[:1]])
    return History(system.load_names, path, np.vstack([corners, corners[:1]]), cycles, True)


def shakes_down(system: ContactSystem, history: History, start: Array | None) -> bool:
    """Return whether exact cycles from rest or from an initial slip end without slip.

    A path that ends or is not steady after all its cycles counts as one that does not, and so
    does a steady one that dissipates little over its first cycle, but more than round-off.
    """
    try:
        record = evolve(
            system, history, None, OutputOptions(1, ()), initial_slip=start, until="limit"
        )
    except SolveError:
        return False
    return record.steady.kind == SHAKEDOWN and dissipated(system, record)[-1] <= SLIP_ROUND_OFF


def dissipated(system: ContactSystem, record: Record) -> Array:
    """Return the dissipation of all cycles over F^2 / K_ii of the largest nodal force F."""
    force = max(float(np.abs(r).max()) for r in (record.turning_points.P, record.turning_points.Q))
    energy = force**2 / float(system.local_stiffness[0].max())
    return np.abs(record.cycles.dissipation) / energy


def limit_by_cycles(
    system: ContactSystem, mean: Loads, range: Sequence[Loads], upper: float, safe: Array
) -> tuple[float, float]:
    """Return an interval of lambda at whose lower end cycles from rest or safe slip end stuck.

    At its upper end, the smallest range tried at which they do not, both slip on; inf when there
    was none. ``upper`` is lambda_2 of the closed contact, positive, ``safe`` its (N,) safe slip.
    """

    def ends(factor: float) -> bool:
        history = range_history(system, mean, range, factor)
        return any(shakes_down(system, history, start) for start in (safe, None))

    low = 0.0
    for high in (upper, 2.0 * upper, 4.0 * upper):
        if not ends(high):
            break
        low = high
    else:
        return low, np.inf
    while high - low > 1e-3 * max(high, upper):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ends(middle) else (low, middle)
    return low, high


def opening_limit(
    system: ContactSystem,
    mean: Loads,
    range: Sequence[Loads],
    limits: ShakedownLimits,
    seen: float = np.inf,
) -> Opening:
    """Return the largest range found round which nodes open and close, and nothing slips.

    A mixed-integer program finds it, up to four times the upper limit of the closed contact; exact
    cycles from its slip at ``BELOW`` times this range verify it. ``limits`` are those of the closed
    contact, the upper one positive and finite, without initial gaps; ``seen`` is lambda of the
    exact cycles that tell which of more than ``ALL_NODES`` nodes may open.

    Raises:
        InputError: the loads are not the system's, there are gaps, or too many nodes open.
        SolveError: no motion was found, or exact cycles slip.
    """
    loads, top = load_range(system, mean, range), 4.0 * limits.upper
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
                record = played(min(seen, top), slip)
                whole = np.any(record.turning_points.state == SEPARATION, axis=0)
                whole[record.events.node[record.events.new == SEPARATION]] = True
                opens[mirror_of(system).index[whole]] = True
        if opens.sum() > MOST_NODES:
            most = f"{opens.sum()} nodes open, {MOST_NODES} at most are tried"
            raise InputError(f"opening_limit: {most}")
    found = largest_opening(system, loads, opens, top)
    D = float(dissipated(system, played(BELOW * found.value, found.slip)).max())
    if D > SLIP_ROUND_OFF:
        raise SolveError(f"opening_limit: exact cycles from the slip found dissipate {D:.1e}")
    return replace(found, dissipation=D)
