"""Sections of a report in their order; their numbers and their text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from receding_fenicsx.arrays import aligned
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.report import contact, run
from receding_fenicsx.output.report.section import Section, Summary, Told, shown

SECTIONS = {
    section.name: section
    for section in (
        Section("", summary=run.model),
        Section("Warnings", run.tell_warnings, run.warnings),
        Section("Turning points", contact.tell_points, contact.turning_points, headed=True),
        Section("Steady state and limit", run.tell_steady, run.steady_state),
        Section("Cycles", run.tell_cycles, run.cycles, headed=True, form="{:z.8g}"),
        Section("Forces", run.tell_forces, run.forces, headed=True, form="{:z.6g}"),
        Section("Fatigue parameters", contact.tell_fatigue, fatigue_summary, headed=True),
        Section("Checks", contact.tell_checks, contact.checks),
        Section("Space errors", run.tell_errors),
        Section("Search for the tolerance", run.tell_search, headed=True),
        Section("Time and memory", run.tell_costs),
        Section("Versions", lambda summary: Told(list(summary.get("versions", {}).items()))),
    )
}
"""Sections in the order of ``report.html``; pictures stand behind the turning points."""


def summarise(record: Record, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the summary of a record in the scene's units; extra keys replace those of it."""
    found: dict[str, Any] = {}
    for section in SECTIONS.values():
        found |= section.summary(record)
    return {**found, **(extra or {})}


def run_table(summary: Summary, everything: bool = False) -> str:
    """Return what a run prints: its answer in at most nine lines of at most 100 characters.

    They tell turning points of the last cycle and of the first loading, warnings, steady state,
    uniqueness, residual, time; with ``everything`` all sections of the report instead.
    """
    told = {name: section.tell(summary) for name, section in SECTIONS.items()}
    title = (
        f"{summary['title'] or 'untitled'}: {summary['nodes']} contact nodes, "
        f"{summary['modelled_nodes']} modelled, method {summary['method']}"
    )
    head = _wrapped([title])
    if everything:
        for name, (rows, _, note) in told.items():
            section = SECTIONS[name]
            if len(rows) > section.headed:
                cells = [[shown(cell, section.form) for cell in row] for row in rows]
                head += ["", name, *([note] if note else []), *aligned(cells)]
        return "\n".join(head)
    # most important first
    names = "Warnings", "Search for the tolerance", "Steady state and limit", "Fatigue parameters"
    lines = [
        line for name in (*names, "Space errors", "Forces", "Checks") for line in told[name].lines
    ]
    lines[-1] = "; ".join([lines[-1], *told["Time and memory"].lines])
    body = _wrapped(lines)
    # the command line adds where the files are, as the tenth line
    left = 9 - len(head)
    # the last turning point of each contact edge at least, below the heads of the columns
    room = left - 1 - min(len({point.get("edge") for point in summary["turning_points"]}), 3)
    if len(body) > room:
        body = [*body[: room - 1], "the rest is in report.html"]
    return "\n".join([*head, *contact.console_table(summary, left - len(body) - 1), *body])


def _wrapped(lines: Sequence[str]) -> list[str]:
    wrapped = [textwrap.wrap(line, 100, subsequent_indent="  ") for line in lines]
    return [part for parts in wrapped for part in parts]
