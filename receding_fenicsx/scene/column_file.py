"""Text files with columns of numbers: profiles along an edge, measured rows of load factors.

The one format: a line with the names of the columns, then a row of numbers on each line. Columns
are separated by semicolons, commas or tabs, or else by blanks. Text after ``#``, lines that begin
with ``%``, and empty lines are comments.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.profiles import DIRECTIONS
from receding_fenicsx.scene.toml_reader import as_list


@dataclass(frozen=True)
class Columns:
    """Numbers of a text file, all finite, with the names of its columns and the line of each row.

    ``label`` is its key and path, for messages.
    """

    label: str
    names: tuple[str, ...]
    values: Array
    lines: tuple[int, ...]

    def refuse(self, reason: str, row: int | None = None) -> NoReturn:
        """Raise InputError with the file, the line of a row if given, and a reason."""
        line = "" if row is None else f" line {self.lines[row]}:"
        raise InputError(f"{self.label}:{line} {reason}")


def read_columns(
    name: object, folder: Path, where: str, known: Sequence[str], default: Sequence[str] = ()
) -> Columns:
    """Read a text file of columns, ``name`` relative to a folder; ``where`` begins messages.

    The first line above the numbers with as many cells as they have names the columns; a comment
    does so only where it holds one of the known names. ``default`` names those of a file that does
    not.
    """
    if not isinstance(name, str):
        raise InputError(f"{where} file: must be a path in quotes")
    label = f'{where} file "{name}"'
    text = read_text(folder / name, label).splitlines()
    without = ("" if line.lstrip()[:1] == "%" else line.partition("#")[0].strip() for line in text)
    filled = [(i, line) for i, line in enumerate(without, 1) if line]
    numbered = (any(map(_is_number, _cells(line, _separator(line)))) for _, line in filled)
    first = next((k for k, found in enumerate(numbered) if found), None)
    if first is None:
        raise InputError(f"{label}: has no row of numbers; write one row a line")
    rows, head = filled[first:], filled[first][0] - 1
    mark = _separator(rows[0][1])
    values: list[list[float]] = []
    for i, line in rows:
        cells = _cells(line, mark)
        for count, cell in enumerate(cells, 1):
            wrong = ""
            if not cell:
                wrong = "empty; every row needs every value"
            elif not _is_number(cell):
                wrong = f'"{cell[:40]}", not a number; mend it, or begin the line with #'
            elif "," in cell:
                wrong = f'"{cell[:40]}", with a decimal comma; write points'
            elif not math.isfinite(float(cell)):
                wrong = f'"{cell}", not a finite number; mend it'
            if wrong:
                raise InputError(f"{label}: line {i}: column {count} is {wrong}")
        values.append([float(cell) for cell in cells])
        if len(cells) != len(values[0]):
            first_row = f"line {rows[0][0]} has {len(values[0])}; all rows need the same"
            raise InputError(f"{label}: line {i}: has {len(cells)} column(s), {first_row}")

    def names_in(line: str) -> tuple[str, ...]:
        cells = _cells(line, mark)
        unit = r"\s*[\[(][^\])]*[\])]$"
        return tuple(cell if cell in known else re.sub(unit, "", cell) for cell in cells)

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


def _separator(line: str) -> str | None:
    """Return the separator of a line's cells, None for blanks."""
    return next((mark for mark in ";,\t" if mark in line), None)


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip("\"'").strip() for cell in line.split(separator)]


def _is_number(cell: str) -> bool:
    number = r"\d+[.,]?\d*|[.,]\d+"
    return bool(re.fullmatch(rf"[+-]?(({number})(e[+-]?\d+)?|inf|infinity|nan)", cell, re.I))


def with_files(raw: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace every ``{file = "..."}`` of a parsed scene by the values in that file.

    A scene saved with its results then needs no other file, and a changed file is noticed.
    """
    history = raw.get("history")
    if isinstance(history, dict):
        raw = {**raw, "history": _with_signals(history, raw.get("load", []), folder)}
    return {key: _with_profiles(value, folder, (key,)) for key, value in raw.items()}


def _with_profiles(raw: Any, folder: Path, keys: tuple[str, ...]) -> Any:
    """Return a part of a parsed scene with tables of x and value for files."""
    if isinstance(raw, list):
        return [_with_profiles(item, folder, keys) for item in raw]
    if not isinstance(raw, dict):
        return raw
    key = next((key for key in reversed(keys) if key not in DIRECTIONS), "")
    profiles = ("friction", "initial_gap", "shear_limit", "cohesion", "interference")
    loads = ("pressure", "traction", "displacement", "initial_slip")
    if set(raw) != {"file"} or key not in (*profiles, *loads):
        return {name: _with_profiles(item, folder, (*keys, name)) for name, item in raw.items()}
    columns = read_columns(raw["file"], folder, " ".join(keys), ("x", "value"), ("x", "value"))
    names = [name.lower() for name in columns.names]
    if len(names) == 2 and ("x" in names or "value" not in names):
        # the one beside x may have any name, and so may both
        at = [1, 0] if names[1] == "x" else [0, 1]
    elif names.count("x") == names.count("value") == 1:
        at = [names.index("x"), names.index("value")]
    else:
        columns.refuse(f"its columns are {', '.join(columns.names)}; it needs one x and one value")
    x, value = columns.values[:, at].T
    falls = np.flatnonzero(np.diff(x) <= 0.0)
    if len(falls):
        row = int(falls[0]) + 1
        columns.refuse(f"x = {x[row]:g} follows {x[row - 1]:g}; sort the rows by x", row)
    if len(x) < 2:
        columns.refuse("has one row; a table needs at least 2")
    return {"x": x.tolist(), "value": value.tolist()}


def _with_signals(history: dict[str, Any], loads: Any, folder: Path) -> dict[str, Any]:
    """Return [history] with ``columns`` and rows of load factors in place of files."""
    given = [key for key in ("rows", "cycle_rows") if key in history]
    files = [key for key in given if isinstance(history[key], dict)]
    wanted = history.get("columns")
    if not files:
        return history
    if wanted is None and given != files:
        raise InputError(
            "[history] columns: is missing; name the load of each column, as one of rows and "
            "cycle_rows is no file"
        )
    if wanted is not None and not all(isinstance(name, str) for name in wanted):
        raise InputError("[history] columns: must be a list of strings in quotes")
    names = [table.get("name") for table in as_list(loads, "load")]
    known = [name for name in names if isinstance(name, str)]

    def is_time(name: str) -> bool:
        # names, in any case, of a column that is checked and dropped, unless a load has the name
        return name.lower() in ("time", "t") and name not in known

    history = dict(history)
    for key in files:
        where = f"[history] {key}"
        for other in history[key].keys() - {"file"}:
            raise InputError(f"{where}: unknown key '{other}'; {suggestion(other, ['file'])}")
        file = history[key].get("file")
        columns = read_columns(file, folder, where, wanted or known, wanted or ())
        chosen = [name for name in wanted or columns.names if not is_time(name)]
        for name in chosen:
            if name not in (columns.names if wanted else known):
                have = ", ".join(columns.names)
                columns.refuse(
                    f"has no column '{name}'; its columns are {have}"
                    if wanted
                    else f"the column '{name}' is no load, {suggestion(name, known)}; rename it, "
                    "or choose the columns by [history] columns"
                )
        for k in (k for k, name in enumerate(columns.names) if is_time(name)):
            time = columns.values[:, k]
            falls = np.flatnonzero(np.diff(time) < 0.0)
            if len(falls):
                row = int(falls[0]) + 1
                columns.refuse(
                    f"time {time[row]:g} follows {time[row - 1]:g}; sort the rows by time", row
                )
        values = columns.values[:, [columns.names.index(name) for name in chosen]]
        moves = np.concatenate([[True], np.any(np.diff(values, axis=0) != 0.0, axis=1)])
        history |= {"columns": chosen, key: values[moves].tolist()}
        wanted = wanted or chosen
    return history
