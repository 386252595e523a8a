"""Verdicts by exact cycles, where the contact opens within the load range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.steady import SHAKEDOWN
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.shakedown.margins import Loads, load_range
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SLIP_ROUND_OFF
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions

CYCLES = 400
"""Most cycles of one verdict; a contact that is not steady then counts as slipping."""
RESOLUTION = 1e-3
"""Width of the interval at which bisection ends, over lambda_2 of the closed contact."""
FACTORS = (1.0, 2.0, 4.0)
"""Ranges that are tried, over the upper limit of the closed contact, before bisection."""


def range_history(
    system: ContactSystem,
    mean: Loads,
    range: Sequence[Loads],
    factor: float,
    cycles: int = CYCLES,
) -> History:
    """Return the history that goes straight to the first vertex of a range and then round it.

    Args:
        system: the condensed body.
        mean: load factors of the mean loads, by name.
        range: changes of the load factors at the corners of the range at lambda = 1.
        factor: lambda.
        cycles: most cycles; the history ends before when it is steady.
    """
    if not isinstance(factor, int | float) or not np.isfinite(factor):
        raise InputError(f"range_history: factor must be a finite number, not {factor!r}")
    loads = load_range(system, mean, range)
    corners = loads.mean + factor * loads.vertices
    path = np.vstack([np.zeros_like(loads.mean), corners[:1]])
    return History(system.load_names, path, np.vstack([corners, corners[:1]]), cycles, True)


def shakes_down(system: ContactSystem, history: History, start: Array | None) -> bool:
    """Return whether exact cycles from rest or from an initial slip end without slip.

    A path that ends or is not steady after ``CYCLES`` cycles counts as one that does not, and so
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
    energy = force**2 / float(local_stiffness(system)[0].max())
    return np.abs(record.cycles.dissipation) / energy


def limit_by_cycles(
    system: ContactSystem, mean: Loads, range: Sequence[Loads], upper: float, safe: Array
) -> tuple[float, float]:
    """Return an interval of lambda at whose lower end cycles from rest or safe slip end stuck.

    At its upper end, the smallest range tried at which they do not, both slip on; inf when there
    was none.

    Args:
        system: the condensed body.
        mean: load factors of the mean loads, by name.
        range: changes of the load factors at the corners of the range at lambda = 1.
        upper: lambda_2 of the closed contact, positive.
        safe: (N,) safe slip of the closed contact.
    """

    def ends(factor: float) -> bool:
        history = range_history(system, mean, range, factor)
        return any(shakes_down(system, history, start) for start in (safe, None))

    low = 0.0
    for high in (factor * upper for factor in FACTORS):
        if not ends(high):
            break
        low = high
    else:
        return low, np.inf
    while high - low > RESOLUTION * max(high, upper):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ends(middle) else (low, middle)
    return low, high
