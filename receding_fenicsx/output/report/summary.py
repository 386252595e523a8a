"""Sections of a report in their order; their numbers and their text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from receding_fenicsx.arrays import aligned
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.report import contact, run
from receding_fenicsx.output.report.section import Section, Summary, shown

SECTIONS = {
    section.name: section
    for section in (
        Section("", run.model),
        Section(
            "Warnings",
            run.warnings,
            table=lambda summary: [[text] for text in summary.get("warnings") or []],
            lines=lambda summary: [f"warning: {text}" for text in summary.get("warnings") or []],
        ),
        Section("Turning points", contact.turning_points, contact.point_table, headed=True),
        Section("Steady state and limit", run.steady_state, run.steady_rows, run.steady_lines),
        Section(
            "Cycles",
            run.cycles,
            run.cycle_table,
            note=lambda summary: (
                "Dissipation of the first loading: "
                f"{shown(summary['dissipation_first_loading'])}. All cycles are in summary.json."
            ),
            headed=True,
            form="{:z.8g}",
        ),
        Section(
            "Forces", run.forces, run.force_table, run.force_lines, headed=True, form="{:z.6g}"
        ),
        Section(
            "Fatigue parameters",
            fatigue_summary,
            contact.fatigue_table,
            contact.fatigue_lines,
            contact.fatigue_note,
            headed=True,
        ),
        Section("Checks", contact.checks, contact.check_rows, contact.check_lines),
        Section("Space errors", table=run.error_rows, lines=run.error_lines),
        Section(
            "Search for the tolerance",
            table=run.search_table,
            lines=lambda summary: [run.verdict(summary)] if "accuracy" in summary else [],
            note=lambda summary: f"{run.verdict(summary)}.",
            headed=True,
        ),
        Section("Time and memory", table=run.cost_rows, lines=run.cost_lines),
        Section("Versions", table=lambda summary: list(summary.get("versions", {}).items())),
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
    head = _wrapped(
        [
            f"{summary['title'] or 'untitled'}: {summary['nodes']} contact nodes, "
            f"{summary['modelled_nodes']} modelled, method {summary['method']}"
        ]
    )
    if everything:
        for section in SECTIONS.values():
            rows = [[shown(cell, section.form) for cell in row] for row in section.table(summary)]
            if len(rows) > section.headed:
                note = section.note(summary)
                head += ["", section.name, *([note] if note else []), *aligned(rows)]
        return "\n".join(head)
    # most important first
    names = "Warnings", "Search for the tolerance", "Steady state and limit", "Fatigue parameters"
    lines = [
        line
        for name in (*names, "Space errors", "Forces", "Checks")
        for line in SECTIONS[name].lines(summary)
    ]
    lines[-1] = "; ".join([lines[-1], *run.cost_lines(summary)])
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
