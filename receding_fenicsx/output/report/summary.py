"""Sections of a report in their order; their numbers and their text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from receding_fenicsx.arrays import aligned
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.checks import CHECKS, FATIGUE
from receding_fenicsx.output.report.cycles import CYCLES, STEADY
from receding_fenicsx.output.report.run import (
    COSTS,
    ERRORS,
    FORCES,
    MODEL,
    SEARCH,
    VERSIONS,
    WARNINGS,
)
from receding_fenicsx.output.report.section import Summary, shown
from receding_fenicsx.output.report.turning_points import (
    CONSOLE_WIDTH,
    TURNING_POINTS,
    console_table,
)

SECTIONS = (
    *(MODEL, WARNINGS, TURNING_POINTS, STEADY, CYCLES),
    *(FORCES, FATIGUE, CHECKS, ERRORS, SEARCH, COSTS, VERSIONS),
)
"""Sections in the order of ``report.html``; pictures stand behind the turning points."""


def summarise(record: Record, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the summary of a record; lengths and tractions are in the scene's units.

    Args:
        record: the record.
        extra: further keys, such as timings and versions; they replace keys of the record.

    Returns:
        Numbers, strings, lists and dictionaries.
    """
    found: dict[str, Any] = {}
    for section in SECTIONS:
        found |= section.summary(record)
    return {**found, **(extra or {})}


def run_table(summary: Summary, everything: bool = False) -> str:
    """Return what a run prints: its answer in a few lines.

    Args:
        summary: contents of ``summary.json``.
        everything: return all sections of the report as text instead.

    Returns:
        At most nine lines of at most 100 characters: turning points of the last cycle and of the
        first loading, warnings, steady state, uniqueness, residual, time.
    """
    head = _wrapped(MODEL.lines(summary))
    if everything:
        for section in SECTIONS:
            rows = [[shown(cell, section.form) for cell in row] for row in section.rows(summary)]
            if rows:
                note, heads = section.note(summary), section.head(summary)
                head += ["", section.name, *([note] if note else [])]
                head += aligned([heads, *rows] if heads else rows)
        return "\n".join(head)
    # most important first
    behind_table = (WARNINGS, SEARCH, STEADY, FATIGUE, ERRORS, FORCES, CHECKS)
    lines = [line for section in behind_table for line in section.lines(summary)]
    lines[-1] = "; ".join([lines[-1], *COSTS.lines(summary)])
    body = _wrapped(lines)
    # the command line adds where the files are, as the tenth line
    left = 9 - len(head)
    # the last turning point of each contact edge at least, below the heads of the columns
    room = left - 1 - min(len({point.get("edge") for point in summary["turning_points"]}), 3)
    if len(body) > room:
        body = [*body[: room - 1], "the rest is in report.html"]
    return "\n".join([*head, *console_table(summary, left - len(body) - 1), *body])


def _wrapped(lines: Sequence[str]) -> list[str]:
    wrapped = [textwrap.wrap(line, CONSOLE_WIDTH, subsequent_indent="  ") for line in lines]
    return [part for parts in wrapped for part in parts]
