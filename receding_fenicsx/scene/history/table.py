"""History of kind "table": rows of load factors from rest to the cycles, and rows of a cycle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.history.driven import check_driven
from receding_fenicsx.scene.history.polyline import History
from receding_fenicsx.scene.model import HistoryOptions


def from_table(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the history of a table of load factors.

    Args:
        options: the options of the history.
        names: names of the loads that are not constant.

    Raises:
        InputError: a column or row is missing, too short or not closed, or a row is repeated.
    """
    if not options.columns:
        raise InputError("[history] columns: is missing; give the name of the load of each column")
    if len(set(options.columns)) < len(options.columns):
        raise InputError("[history] columns: a load occurs twice; name each load once")
    check_driven(options.columns, names, options, "columns")
    loop = _rows(options.cycle_rows, options.columns, "cycle_rows")
    rows = _rows(options.rows, options.columns, "rows")
    if not len(rows):
        if not len(loop):
            raise InputError(
                "[history] rows: is missing; give the load factors up to the start of the cycles"
            )
        rows = loop[-1:]
    preloaded = any(options.constant.values())
    if np.any(rows[0] != 0.0):
        rows = np.vstack([np.zeros_like(rows[:1]), rows])
    if not np.any(rows) and not preloaded:
        raise InputError("[history] rows: all load factors are zero; give one that is not")
    _check_moves(rows, "rows")
    order = [options.columns.index(name) for name in names]
    if not len(loop):
        return History(names, rows[:, order], np.zeros((0, len(names))))
    if np.any(loop[-1] != rows[-1]):
        raise InputError(
            f"[history] cycle_rows: is not closed: ends at {loop[-1].tolist()}, but rows end at "
            f"{rows[-1].tolist()}; use the same load factors"
        )
    if np.any(loop[0] != rows[-1]) or len(loop) == 1:
        loop = np.vstack([rows[-1:], loop])
    _check_moves(loop, "cycle_rows")
    return History(names, rows[:, order], loop[:, order], options.cycles)


def _rows(
    rows: tuple[tuple[float, ...], ...], columns: tuple[str, ...], key: str
) -> NDArray[np.float64]:
    for i, row in enumerate(rows):
        if len(row) != len(columns):
            raise InputError(
                f"[history] {key} row {i + 1}: has {len(row)} value(s) for {len(columns)} "
                "column(s); give one per column"
            )
    return np.array(rows, dtype=float).reshape(len(rows), len(columns))


def _check_moves(rows: NDArray[np.float64], key: str) -> None:
    still = np.flatnonzero(np.all(np.diff(rows, axis=0) == 0.0, axis=1))
    if len(still):
        raise InputError(
            f"[history] {key}: the load factors {rows[still[0]].tolist()} occur twice in a row; "
            "remove one"
        )
