"""Limit of infinitely many cycles in the summary and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.steady import RATCHETTING

UNIQUE = {1: True, 0: False}
"""Value of "unique" in the summary; None where it was not examined."""


def limit_summary(record: Record) -> dict[str, Any]:
    """Return the key "limit" of the summary; nothing where the limit was not asked for."""
    limit, D = record.limit, record.cycles.dissipation
    if limit is None:
        return {}
    period = record.steady.period
    last = float(D[-period:].mean()) if limit.reached else None
    ratio = last / float(D[0]) if last is not None and record.dissipates else None
    return {
        "limit": {
            "reached": bool(limit.reached),
            "cycle": int(limit.cycle),
            "cycles_played": int(limit.cycles_played),
            "dissipation": last,
            "dissipation_ratio": ratio,
            "residual": float(limit.residual) if np.isfinite(limit.residual) else None,
            "period": int(period) if limit.reached else None,
            "walk": _walk(record) if limit.reached else None,
            "unique": UNIQUE.get(int(limit.unique)),
            "reason": limit.reason,
            "jumped": bool(limit.jumped),
        }
    }


def _walk(record: Record) -> float | None:
    """Return the largest slip that each cycle of ratchetting adds, None for other kinds."""
    if record.steady.kind != RATCHETTING:
        return None
    gained = record.cycles.slip_increment[-record.steady.period :].mean(axis=0)
    return float(gained[np.abs(gained).argmax()])


def limit_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return lines on the limit of infinitely many cycles, if it was asked for."""
    limit = summary.get("limit")
    if limit is None:
        return []
    walk = limit.get("walk")
    words = [] if walk is None else [f"ratchetting: a cycle adds the slip {walk:.6g}"]
    return [*_found_lines(limit), *words, *_starts_lines(limit.get("starts"))]


def _found_lines(limit: Mapping[str, Any]) -> list[str]:
    if not limit["reached"]:
        return [f"limit of infinitely many cycles: not reached; {limit['reason']}"]
    if not limit["jumped"]:
        return [f"limit of infinitely many cycles: cycle {limit['cycle']}; {limit['reason']}"]
    lines = [
        f"limit of infinitely many cycles: found by a search, {limit['cycles_played']} cycles "
        f"played, shown as cycle {limit['cycle']}, residual {limit['residual']:.1e}",
        limit["reason"],
    ]
    return lines


def _starts_lines(starts: Mapping[str, Any] | None) -> list[str]:
    """Return a line on the limits from further initial slips, if they were asked for."""
    if starts is None:
        return []
    kinds = ", ".join(f"{count} {kind}" for kind, count in starts["kinds"].items())
    words = "do not differ" if starts["same"] else "differ"
    line = f"limits from {starts['count']} initial slips {words}: {kinds}"
    if starts["dissipation"] is not None:
        low, high = starts["dissipation"]
        spread = "" if starts["spread"] is None else f" (spread {starts['spread']:.2g})"
        line += f"; dissipation per cycle {low:.6g} to {high:.6g}{spread}"
    if len(starts["zones"]) > 1:
        nodes = f"{starts['nodes_that_differ']} of {starts['nodes']} nodes"
        line += f"; {len(starts['zones'])} arrangements of zones, which differ at {nodes}"
    return [line]
