"""Text files with columns of numbers: profiles along an edge, measured rows of load factors.

The one format: a line with the names of the columns, then a row of numbers on each line. Columns
are separated by semicolons, commas or tabs, or else by blanks. Text after ``#``, lines that begin
with ``%``, and empty lines are comments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from re import sub
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.toml_reader import as_list


@dataclass(frozen=True)
class Columns:
    """Numbers of a text file, all finite."""

    label: str  # key and path of the file, for messages
    names: tuple[str, ...]
    values: Array  # (rows, columns)
    lines: tuple[int, ...]  # line of each row

    def refuse(self, reason: str, row: int | None = None) -> NoReturn:
        """Raise InputError with the file, the line of a row if given, and a reason."""
        line = "" if row is None else f" line {self.lines[row]}:"
        raise InputError(f"{self.label}:{line} {reason}")

    def check_sorted(self, name: str, values: Array, wrong: NDArray[np.bool_]) -> None:
        """Refuse the first of the steps between the values of a column that are wrong."""
        for k in np.flatnonzero(wrong):
            follows = f"{name} = {values[k + 1]:g} follows {values[k]:g}"
            self.refuse(f"{follows}; sort the rows by {name}", int(k) + 1)


def read_columns(
    name: str, folder: Path, where: str, known: Sequence[str], default: Sequence[str] = ()
) -> Columns:
    """Read a text file of columns; ``where`` begins messages, ``default`` are names it may lack.

    The first line above the numbers with as many cells as they have names the columns; a comment
    does so only where it holds one of the known names.
    """
    label = f'{where} file "{name}"'
    text = read_text(folder / name, label).splitlines()
    without = ("" if line.lstrip()[:1] == "%" else line.partition("#")[0].strip() for line in text)
    filled = [(i, line) for i, line in enumerate(without, 1) if line]
    numbered = (
        any(number is not None for number in numbers_in(_cells(line))) for _, line in filled
    )
    first = next((k for k, found in enumerate(numbered) if found), None)
    if first is None:
        raise InputError(f"{label}: has no row of numbers; write one row a line")
    rows, head = filled[first:], filled[first][0] - 1
    mark = next((mark for mark in ";,\t" if mark in rows[0][1]), None)
    values: list[list[float]] = []
    for i, line in rows:
        cells = _cells(line, mark)
        numbers = numbers_in(cells)
        values.append([number for number in numbers if number is not None])
        for count, (cell, number) in enumerate(zip(cells, numbers, strict=True), 1):
            if "," in cell or number is None or not math.isfinite(number):
                raise InputError(
                    f'{label}: line {i}: column {count} is "{cell[:40]}", not a finite number with '
                    "a decimal point; mend it, or begin the line with #"
                )
        if len(cells) != len(values[0]):
            first_row = f"line {rows[0][0]} has {len(values[0])}; all rows need the same"
            raise InputError(f"{label}: line {i}: has {len(cells)} column(s), {first_row}")

    def names_in(line: str) -> tuple[str, ...]:
        unit = r"\s*[\[(][^\])]*[\])]$"
        return tuple(cell if cell in known else sub(unit, "", cell) for cell in _cells(line, mark))

    headers = [names_in(line) for _, line in filled[:first]]
    comments = [names_in(line.strip()[1:].strip()) for line in text[:head] if line[:1] in "#%"]
    comments = [names for names in comments if {*known} & {*map(str.lower, names), *names}]
    found = [n for n in (*headers, *comments[::-1]) if len(n) == len(values[0]) and all(n)]
    if not found and (headers or len(default) != len(values[0])):
        reason = f"no line above the numbers names their {len(values[0])} column(s)"
        raise InputError(f"{label}: line {head or 1}: {reason}; name each, as in x,value")
    names = found[0] if found else tuple(default)
    columns = Columns(label, names, np.array(values), tuple(i for i, _ in rows))
    for one in names:
        if names.count(one) > 1:
            columns.refuse(f"the column '{one}' occurs twice; name each once")
    return columns


def _cells(line: str, separator: str | None = "") -> list[str]:
    """Return the cells of a line; separators are None for blanks, and "" for that of the line."""
    if separator == "":
        separator = next((mark for mark in ";,\t" if mark in line), None)
    return [cell.strip().strip("\"'").strip() for cell in line.split(separator)]


def numbers_in(cells: list[str]) -> list[float | None]:
    """Return numbers, also those with a decimal comma or D before the exponent; None for others."""
    found: list[float | None] = []
    for cell in cells:
        try:
            found.append(float(sub("[dD]", "E", cell.replace(",", ".").replace("_", "no number"))))
        except ValueError:
            found.append(None)
    return found


def _is_file(value: object) -> bool:
    """Return whether a value of a scene file is ``{file = "..."}``."""
    return isinstance(value, dict) and set(value) == {"file"} and isinstance(value["file"], str)


def with_files(raw: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace every ``{file = "..."}`` of a parsed scene by the values in that file.

    A scene saved with its results then needs no other file, and a changed file is noticed.
    """
    history = raw.get("history")
    if isinstance(history, dict):
        raw = {**raw, "history": _with_signals(history, raw.get("load", []), folder)}
    return {key: _with_profiles(value, folder, key) for key, value in raw.items()}


def _with_profiles(raw: Any, folder: Path, where: str) -> Any:
    """Return a part of a parsed scene with tables of x and value for files."""
    if isinstance(raw, list):
        return [_with_profiles(item, folder, where) for item in raw]
    if not isinstance(raw, dict):
        return raw
    if not _is_file(raw):
        return {key: _with_profiles(item, folder, f"{where} {key}") for key, item in raw.items()}
    columns = read_columns(raw["file"], folder, where, ("x", "value"), ("x", "value"))
    names = [name.lower() for name in columns.names]
    if len(names) == 2 and ("x" in names or "value" not in names):
        # the one beside x may have any name, and so may both
        at = [1, 0] if names[1] == "x" else [0, 1]
    elif names.count("x") == names.count("value") == 1:
        at = [names.index("x"), names.index("value")]
    else:
        columns.refuse(f"its columns are {', '.join(columns.names)}; it needs one x and one value")
    x, value = columns.values[:, at].T
    columns.check_sorted("x", x, np.diff(x) <= 0.0)
    if len(x) < 2:
        columns.refuse("has one row; a table needs at least 2")
    return {"x": x.tolist(), "value": value.tolist()}


def _with_signals(history: dict[str, Any], loads: Any, folder: Path) -> dict[str, Any]:
    """Return [history] with ``columns`` and rows of load factors in place of files."""
    given = [key for key in ("rows", "cycle_rows") if key in history]
    files = [key for key in given if _is_file(history[key])]
    wanted = history.get("columns")
    if not files:
        return history
    if wanted is None and given != files:
        raise InputError(
            "[history] columns: is missing; name the load of each column, as one of rows and "
            "cycle_rows is no file"
        )
    listed = isinstance(wanted, list) and all(isinstance(name, str) for name in wanted)
    if wanted is not None and not listed:
        raise InputError("[history] columns: must be a list of strings in quotes")
    names = [table.get("name") for table in as_list(loads, "load")]
    known = [name for name in names if isinstance(name, str)]
    # columns that are checked and dropped
    times = {"time", "t"} - {*known}
    history = dict(history)
    for key in files:
        columns = read_columns(
            history[key]["file"], folder, f"[history] {key}", wanted or known, wanted or ()
        )
        chosen = [name for name in wanted or columns.names if name.lower() not in times]
        for name in chosen:
            if name not in (columns.names if wanted else known):
                have = ", ".join(columns.names)
                columns.refuse(
                    f"has no column '{name}'; its columns are {have}"
                    if wanted
                    else f"the column '{name}' is no load, {suggestion(name, known)}; rename it, "
                    "or choose the columns by [history] columns"
                )
        for name, values in zip(columns.names, columns.values.T, strict=True):
            if name.lower() in times:
                columns.check_sorted("time", values, np.diff(values) < 0.0)
        rows = columns.values[:, [columns.names.index(name) for name in chosen]]
        moves = np.concatenate([[True], np.any(np.diff(rows, axis=0) != 0.0, axis=1)])
        history |= {"columns": chosen, key: rows[moves].tolist()}
        wanted = wanted or chosen
    return history
