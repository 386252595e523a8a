"""Text of a report: the answer in a few lines for the console, or all sections."""

from __future__ import annotations

import textwrap

from receding_fenicsx.arrays import aligned
from receding_fenicsx.output.report.accuracy import ERRORS, SEARCH
from receding_fenicsx.output.report.checks import CHECKS
from receding_fenicsx.output.report.cycles import STEADY
from receding_fenicsx.output.report.forces import FORCES
from receding_fenicsx.output.report.run import COSTS, MODEL, WARNINGS
from receding_fenicsx.output.report.section import Summary, shown
from receding_fenicsx.output.report.summary import SECTIONS
from receding_fenicsx.output.report.turning_points import CONSOLE_WIDTH, console_table

CONSOLE_LINES = 9
"""Largest number of lines of :func:`run_table`; the command line adds where the files are."""
BEHIND_TABLE = (WARNINGS, SEARCH, STEADY, ERRORS, FORCES, CHECKS)
"""Sections whose lines stand behind the table of turning points, most important first."""


def run_table(summary: Summary, everything: bool = False) -> str:
    """Return what a run prints: its answer in a few lines.

    Args:
        summary: contents of ``summary.json``.
        everything: return all sections of the report as text instead.

    Returns:
        Text of at most ``CONSOLE_LINES`` lines of at most ``CONSOLE_WIDTH`` characters: turning
        points of the last cycle and of the first loading, warnings, steady state, uniqueness,
        residual, time.
    """
    head = _wrapped(MODEL.lines(summary))
    if everything:
        return "\n".join([*head, *_all_sections(summary)])
    lines = [line for section in BEHIND_TABLE for line in section.lines(summary)]
    lines[-1] = "; ".join([lines[-1], *COSTS.lines(summary)])
    body = _wrapped(lines)
    # the last turning point of each contact edge at least, below the heads of the columns
    edges = len({point.get("edge") for point in summary["turning_points"]})
    room = CONSOLE_LINES - len(head) - 1 - min(edges, 3)
    if len(body) > room:
        body = [*body[: room - 1], "the rest is in report.html"]
    points = console_table(summary, CONSOLE_LINES - len(head) - len(body) - 1)
    return "\n".join([*head, *points, *body])


def _wrapped(lines: list[str]) -> list[str]:
    wrapped = [textwrap.wrap(line, CONSOLE_WIDTH, subsequent_indent="  ") for line in lines]
    return [part for parts in wrapped for part in parts]


def _all_sections(summary: Summary) -> list[str]:
    """Return heading, note and aligned table of each section that has rows."""
    lines = []
    for section in SECTIONS:
        rows = [[shown(cell, section.form) for cell in row] for row in section.rows(summary)]
        if rows:
            head, note = section.head(summary), section.note(summary)
            lines += ["", section.name, *([note] if note else [])]
            lines += aligned([head, *rows] if head else rows)
    return lines
