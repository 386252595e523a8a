"""A section of a report: its numbers for ``summary.json``, its table, its lines for the console."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from receding_fenicsx.evolution.record import Record

Summary = Mapping[str, Any]
"""Contents of ``summary.json``."""
Rows = list[list[Any]]


def shown(cell: object, form: str = "{:z.5g}", dash: str = "-") -> str:
    """Format a cell; None is a dash."""
    if cell is None:
        return dash
    return form.format(cell) if isinstance(cell, float) else str(cell)


def _nothing(_: Summary) -> list[Any]:
    return []


@dataclass(frozen=True)
class Section:
    """A section; the table and the lines are made of the summary, which is also read from a file.

    Attributes:
        name: heading; "" for a section without one.
        summary: returns the keys of the summary from a record.
        rows: returns the rows of the table from the summary; without rows the report omits it.
        head: returns the heads of the columns; without them the first column is what a row is.
        note: returns a paragraph before the table.
        lines: returns what the console shows, most important first.
        form: format of floating-point numbers in the table.
    """

    name: str
    summary: Callable[[Record], dict[str, Any]] = lambda _: {}
    rows: Callable[[Summary], Rows] = _nothing
    head: Callable[[Summary], Sequence[str]] = _nothing
    note: Callable[[Summary], str] = lambda _: ""
    lines: Callable[[Summary], list[str]] = _nothing
    form: str = "{:z.5g}"
