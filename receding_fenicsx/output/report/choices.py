"""Choices among several continuations, for ``summary.json``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from receding_fenicsx.evolution.record import Record


def choices_summary(record: Record) -> dict[str, Any]:
    """Return the key "branch": the rule and the choices made by it; nothing where none was made."""
    if not record.choices:
        return {}
    rule = record.scene.solver.branch if record.scene else "first"
    return {"branch": {"rule": rule, "choices": [asdict(choice) for choice in record.choices]}}
