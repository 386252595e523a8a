"""A section of a report: its numbers for ``summary.json``, its table, its lines for the console."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


@dataclass(frozen=True)
class Section:
    """A section; its table and lines are made of the summary, which is also read from a file."""

    name: str  # heading; "" for a section without one
    # returns the keys of the summary from a record
    summary: Callable[[Record], dict[str, Any]] = lambda _: {}
    # returns the rows of the table from the summary, the first one with the heads of the columns if
    # it is ``headed``; without further rows the report omits the section
    table: Callable[[Summary], Rows] = lambda _: []
    # returns what the console shows, most important first
    lines: Callable[[Summary], list[str]] = lambda _: []
    note: Callable[[Summary], str] = lambda _: ""  # returns a paragraph before the table
    headed: bool = False
    form: str = "{:z.5g}"  # format of floating-point numbers in the table
