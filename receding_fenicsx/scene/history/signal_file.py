"""Rows of a table history from a file, such as a measured signal.

The columns are found by the names in the header: those of the loads, with or without a unit in
brackets. A column "time" or "t" is checked and dropped. Equal successive rows are merged: a load
that dwells changes nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion, unknown_name
from receding_fenicsx.scene.column_file import Columns, read_columns, without_unit
from receding_fenicsx.scene.toml_reader import as_list

TIME = ("time", "t")
"""Names, in any case, of a column that is not a load."""
KEYS = ("rows", "cycle_rows")
"""Keys of [history] whose values may be read from a file."""


def with_signals(raw: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace the files of ``[history] rows`` and ``cycle_rows`` by the rows that they hold.

    A scene saved with its results then needs no other file, and a changed file is noticed.

    Args:
        raw: parsed TOML.
        folder: folder that paths are relative to.

    Returns:
        The parsed scene, with ``columns`` where only the files name them.

    Raises:
        InputError: a file cannot be read, or its columns are not the loads; one line.
    """
    history = raw.get("history")
    if not isinstance(history, dict):
        return raw
    files = [key for key in KEYS if isinstance(history.get(key), dict)]
    if not files:
        return raw
    history = dict(history)
    wanted = history.get("columns")
    if wanted is None and any(key in history and key not in files for key in KEYS):
        raise InputError(
            "[history] columns: is missing; name the load of each column, as one of rows and "
            "cycle_rows is no file"
        )
    if wanted is not None:
        if not isinstance(wanted, list) or not all(isinstance(name, str) for name in wanted):
            raise InputError("[history] columns: must be a list of strings in quotes")
    loads = [table.get("name") for table in as_list(raw.get("load", []), "load")]
    known = [name for name in loads if isinstance(name, str)]
    for key in files:
        where = f"[history] {key}"
        for other in history[key]:
            if other != "file":
                unknown_name(other, ("file",), where, "key")
        columns = read_columns(history[key].get("file"), folder, where)
        if wanted is None:
            wanted = _loads_in(columns, known)
        history["columns"] = [name for name in wanted if not _is_time(name, known)]
        history[key] = _values(columns, wanted, known).tolist()
    return {**raw, "history": history}


def _names(columns: Columns, known: list[str]) -> list[str]:
    """Return the names in the header: of a load, else without the unit."""
    names = columns.names or columns.remark
    return [name if name in known else without_unit(name) for name in names]


def _is_time(name: str, known: list[str]) -> bool:
    return name.lower() in TIME and name not in known


def _loads_in(columns: Columns, known: list[str]) -> list[str]:
    """Return the loads that the header names, in its order."""
    names = _names(columns, known)
    if not names or (not columns.names and not {*names} & {*known}):
        columns.refuse("has no header line; name the load of each column there, or in columns")
    for name in names:
        if name not in known and not _is_time(name, known):
            columns.refuse(
                f"the column '{name}' is no load, {suggestion(name, known)}; rename it, or choose "
                "the columns by [history] columns"
            )
        if names.count(name) > 1:
            columns.refuse(f"the column '{name}' occurs twice; name each load once")
    return [name for name in names if not _is_time(name, known)]


def _values(columns: Columns, wanted: list[str], known: list[str]) -> NDArray[np.float64]:
    """Return the values of the loads among some columns, equal successive rows once."""
    names, width = _names(columns, known), columns.values.shape[1]
    if not columns.names and not {*wanted} <= {*names}:
        # no header: the columns are those of the scene
        names = wanted
        if len(wanted) != width:
            columns.refuse(
                f"has {width} column(s) and no header line; [history] columns names {len(wanted)}"
            )
    for name in wanted:
        if names.count(name) != 1:
            count = names.count(name) or "no"
            columns.refuse(f"has {count} column(s) '{name}'; its header names {', '.join(names)}")
    for k in (k for k, name in enumerate(names) if _is_time(name, known)):
        _check_time(columns, columns.values[:, k])
    loads = [k for k, name in enumerate(wanted) if not _is_time(name, known)]
    values = columns.values[:, [names.index(wanted[k]) for k in loads]]
    moves = np.concatenate([[True], np.any(np.diff(values, axis=0) != 0.0, axis=1)])
    return values[moves]


def _check_time(columns: Columns, time: NDArray[np.float64]) -> None:
    falls = np.flatnonzero(np.diff(time) < 0.0)
    if len(falls):
        row = int(falls[0]) + 1
        columns.refuse(f"time {time[row]:g} follows {time[row - 1]:g}; sort the rows by time", row)
