"""Numbers of one case of a sweep: the columns of its table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.moment import extreme_row
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.half_widths import half_widths

Cell = float | int | str | bool | None
"""Value in a table; None where a case has no such number."""


def measure_record(record: Record) -> dict[str, Cell]:
    """Return the headline numbers of a record, with the names of ``summary.json``.

    Half widths and extreme tractions are those of the last cycle at the smallest and the largest
    load. With several contact edges their names end in ".EDGE".

    Args:
        record: the record; samples and events are not used.
    """
    D, steady = record.cycles.dissipation, record.steady
    row: dict[str, Cell] = {
        "cycles": len(D),
        "dissipation_first_loading": record.dissipation_first_loading,
        "dissipation_cycle_1": D[0] if len(D) else None,
        "dissipation_last_cycle": D[-1] if len(D) else None,
        "steady": steady.kind,
        "steady_cycle": steady.cycle if steady.reached else None,
        "steady_period": steady.period if steady.reached else None,
    }
    edges = record.by_edge()
    for name, part in edges.items():
        end = f".{name}" if len(edges) > 1 else ""
        row |= {f"{key}{end}": value for key, value in _last_cycle(part).items()}
    return row | {
        "residual_max": record.residual_max,
        "energy_error_max": record.energy_error_max,
        "events": record.n_events,
        "sweeps": record.sweeps,
        "jumps": record.jumps,
    }


def _last_cycle(record: Record) -> dict[str, Cell]:
    """Return half widths and extreme tractions in the last cycle."""
    points = record.turning_points
    rows = np.flatnonzero(points.cycle == points.cycle.max())
    found: dict[str, Cell] = {}
    for load in ("minimum", "maximum"):
        i = extreme_row(points, rows, load)
        found |= {f"{key}_at_{load}": value for key, value in half_widths(record, i).items()}
        found[f"p_max_at_{load}"] = points.p[i].max()
        found[f"q_abs_max_at_{load}"] = np.abs(points.q[i]).max()
    return found


def cells_of(measured: Any, taken: Iterable[str]) -> dict[str, Cell]:
    """Return measured values as plain numbers and texts.

    Args:
        measured: what a function ``measure`` returned.
        taken: names of columns that the table has already.

    Raises:
        InputError: it is not a dictionary of numbers and texts, or names such a column.
    """
    if not isinstance(measured, Mapping):
        raise InputError(f"measure: must return a dictionary, not a {type(measured).__name__}")
    cells: dict[str, Cell] = {}
    for name, given in measured.items():
        value = given.item() if isinstance(given, np.generic) else given
        if not isinstance(name, str) or name in taken:
            raise InputError(f"measure: {name!r} cannot be the name of a column; choose another")
        if not (value is None or isinstance(value, str | bool | int | float)):
            kind = type(value).__name__
            raise InputError(f"measure: '{name}' must be a number or a text, not a {kind}")
        cells[name] = value
    return cells
