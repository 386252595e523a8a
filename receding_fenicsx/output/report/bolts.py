"""Forces of bolts in the summary and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from receding_fenicsx.evolution.record import Record

ROUND_OFF = 1e-9
"""Push of a bolt, over its largest force, that is none."""


def bolt_summary(record: Record) -> dict[str, Any]:
    """Return the key "bolts": each bolt's force at the turning points; nothing without bolts."""
    names = [bolt.name for bolt in record.scene.bolts] if record.scene else []
    force = record.turning_points.load_displacement
    found = {name: force[:, record.load_names.index(name)].tolist() for name in names}
    return {"bolts": found} if found else {}


def loose_warnings(record: Record) -> list[str]:
    """Return one line for each bolt that pushes: a real one would come loose."""
    return [
        f"bolt '{name}': its force falls to {min(force):.6g}, a push; it is loose there, shorten it"
        for name, force in bolt_summary(record).get("bolts", {}).items()
        if min(force) < -ROUND_OFF * max(force)
    ]


def bolt_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return a line for each bolt, for the console."""
    return [
        f"bolt {name}: force {min(force):.6g} to {max(force):.6g}, last {force[-1]:.6g}"
        for name, force in summary.get("bolts", {}).items()
        if force
    ]
