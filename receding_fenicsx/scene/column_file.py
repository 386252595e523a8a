"""Reader of text files with columns of numbers: commas, semicolons, tabs or blanks, header, #."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError

SEPARATORS = (";", ",", "\t")
"""Separators of columns, the first that a line holds counts; without any of them, blanks."""

COMMENTS = ("#", "%")
"""Marks at the beginning of a comment line."""


@dataclass(frozen=True)
class Columns:
    """Numbers of a text file.

    Attributes:
        label: key and path, for messages.
        names: (columns,) names in the header line; empty without a header.
        remark: (columns,) words of the last comment above the rows with as many; empty without.
        values: (rows, columns), all finite.
        lines: number of the line of each row, from 1.
    """

    label: str
    names: tuple[str, ...]
    remark: tuple[str, ...]
    values: Array
    lines: tuple[int, ...]

    def refuse(self, reason: str, row: int | None = None) -> NoReturn:
        """Raise InputError with the file, the line of a row if given, and a reason."""
        line = "" if row is None else f" line {self.lines[row]}:"
        raise InputError(f"{self.label}:{line} {reason}")


def read_columns(name: object, folder: Path, where: str) -> Columns:
    """Read a text file with columns of numbers.

    Text after ``#``, lines that begin with ``%`` and empty lines are ignored. Lines without any
    number above the first row are header lines; the first of them with as many filled cells as the
    rows names the columns. Cells are separated by semicolons, commas, tabs or blanks, all as in the
    first row. Numbers have a decimal point.

    Args:
        name: path in the scene file.
        folder: folder that it is relative to.
        where: table and key, for messages.

    Raises:
        InputError: the file cannot be read or has no rows, rows differ in length, or a cell is not
            a finite number; one line with the number of the line.
    """
    if not isinstance(name, str):
        raise InputError(f"{where} file: must be a path in quotes")
    label = f'{where} file "{name}"'
    text = read_text(folder / name, label)
    lines = [(i, _content(line)) for i, line in enumerate(text.splitlines(), 1)]
    filled = [(i, line) for i, line in lines if line]
    first = next((k for k, (_, line) in enumerate(filled) if _has_number(line)), None)
    if first is None:
        raise InputError(f"{label}: has no row of numbers; write one row a line")
    separator = _separator(filled[first][1])
    rows = [_row(line, separator, f"{label}: line {i}") for i, line in filled[first:]]
    for (i, _), row in zip(filled[first:], rows, strict=True):
        if len(row) != len(rows[0]):
            raise InputError(
                f"{label}: line {i}: has {len(row)} column(s), line {filled[first][0]} has "
                f"{len(rows[0])}; all rows need the same"
            )
    heads = (_cells(line, separator) for _, line in filled[:first])
    names = next((tuple(head) for head in heads if len(head) == len(rows[0]) and all(head)), ())
    if first and not names:
        raise InputError(
            f"{label}: line {filled[first - 1][0]}: the header does not name the {len(rows[0])} "
            "column(s) of the rows; name each, or begin the line with #"
        )
    above = [line.strip() for line in text.splitlines()[: filled[first][0] - 1]]
    remarks = (tuple(_cells(line[1:].strip(), separator)) for line in above if line[:1] in COMMENTS)
    remark = ([words for words in remarks if len(words) == len(rows[0])] or [()])[-1]
    return Columns(label, names, remark, np.array(rows), tuple(i for i, _ in filled[first:]))


def _content(line: str) -> str:
    """Return a line without its comment."""
    return "" if line.lstrip()[:1] == "%" else line.partition("#")[0].strip()


def without_unit(name: str) -> str:
    """Return a column's name without a unit in brackets."""
    return re.sub(r"\s*[\[(][^\])]*[\])]$", "", name)


def _separator(line: str) -> str | None:
    """Return the separator of a line's cells, None for blanks."""
    return next((mark for mark in SEPARATORS if mark in line), None)


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip("\"'").strip() for cell in line.split(separator)]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def _has_number(line: str) -> bool:
    return any(_is_number(cell) for cell in _cells(line, _separator(line)))


def _row(line: str, separator: str | None, where: str) -> list[float]:
    """Return the finite numbers of a line."""
    numbers = []
    for count, cell in enumerate(_cells(line, separator), 1):
        if not cell:
            raise InputError(f"{where}: column {count} is empty; every row needs every value")
        if not _is_number(cell):
            raise InputError(
                f'{where}: column {count} is "{cell[:40]}", not a number; mend it, or begin the '
                "line with #"
            )
        if "," in cell:
            raise InputError(f'{where}: "{cell[:40]}" has a decimal comma; write decimal points')
        number = float(cell)
        if not math.isfinite(number):
            raise InputError(f'{where}: column {count} is "{cell}", not a finite number; mend it')
        numbers.append(number)
    return numbers
