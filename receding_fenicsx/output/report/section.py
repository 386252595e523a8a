"""A section of a report: its numbers for ``summary.json``, its table, its lines for the console."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from receding_fenicsx.evolution.record import Record

Summary = Mapping[str, Any]
"""Contents of ``summary.json``."""
Rows = list[list[Any]]


def shown(cell: object, form: str = "{:z.5g}", dash: str = "-") -> str:
    """Format a cell; a number that is not finite is a dash, like None, which files have for it."""
    if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
        return dash
    return form.format(cell) if isinstance(cell, float) else str(cell)


class Told(NamedTuple):
    """What a section tells of a summary."""

    # the table, whose first row has the heads of the columns if the section is headed; without
    # further rows the report omits the section
    rows: Rows
    lines: Sequence[str] = ()  # what the console shows, most important first
    note: str = ""  # a paragraph before the table


class Section(NamedTuple):
    """A section; what it tells is made of the summary, which is also read from a file."""

    name: str  # heading; "" for a section without one
    tell: Callable[[Summary], Told] = lambda _: Told([])
    # returns the keys of the summary from a record
    summary: Callable[[Record], dict[str, Any]] = lambda _: {}
    headed: bool = False
    form: str = "{:z.5g}"  # format of floating-point numbers in the table
