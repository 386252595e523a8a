"""Sections of a report in their order, and their numbers: the contents of ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.accuracy import ERRORS, SEARCH
from receding_fenicsx.output.report.checks import CHECKS
from receding_fenicsx.output.report.cycles import CYCLES, STEADY
from receding_fenicsx.output.report.forces import FORCES
from receding_fenicsx.output.report.run import COSTS, MODEL, VERSIONS, WARNINGS
from receding_fenicsx.output.report.turning_points import TURNING_POINTS

SECTIONS = (
    MODEL,
    WARNINGS,
    TURNING_POINTS,
    STEADY,
    CYCLES,
    FORCES,
    CHECKS,
    ERRORS,
    SEARCH,
    COSTS,
    VERSIONS,
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
