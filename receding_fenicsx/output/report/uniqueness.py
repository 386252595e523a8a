"""Uniqueness of a path, for ``summary.json``, the console and the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.uniqueness.watch import LARGE_MARGIN

CERTIFICATE = "only path from its start"
"""Head of the line."""


def uniqueness_summary(record: Record) -> dict[str, Any]:
    """Return the key "uniqueness" of the summary; nothing for records without it."""
    found = record.uniqueness
    if found is None:
        return {}
    place = {"cycle": int(found.cycle), "leg": int(found.leg), "s": float(found.s)}
    static = {
        "solutions": int(found.first_loading),
        "proved": bool(found.first_loading_proved),
    }
    told = {
        "certified": bool(found.certified),
        "margin": float(found.margin),  # null in the file where it is not finite
        "solutions": int(found.solutions),
        "where": {**place, "nodes": found.nodes.tolist()} if found.cycle >= 0 else None,
        "first_loading": static if found.first_loading else None,
        "symmetric_paths_only": bool(record.half),
    }
    return {"uniqueness": told}


def uniqueness_lines(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what a run says of uniqueness, a head and words for each fact; nothing without it."""
    found = summary.get("uniqueness")
    if found is None:
        return []
    margin, place, static = found["margin"], found["where"], found["first_loading"]
    words = "certified" if found["certified"] else "not certified"
    if found["certified"] and static is not None and not static["proved"]:
        words += " after the first loading, which is not proved to have one solution only"
    if summary["method"] != "events":
        words += " at the ends of load steps"
    if found["symmetric_paths_only"]:
        words += ", among mirror-symmetric paths"
    lines = [(CERTIFICATE, words)]
    if place is not None:
        nodes = ", ".join(map(str, place["nodes"]))
        at = f", nodes {nodes}" if nodes else ""
        words = f"cycle {place['cycle']}, leg {place['leg']}, s = {place['s']:.6g}{at}; at most "
        lines.append(("first doubt", f"{words}{_solutions(found['solutions'])} at one instant"))
    if margin is not None and np.isfinite(margin):
        where = "elsewhere the " if margin > 1.0 and not found["certified"] else ""
        words = f"{where}proof holds up to {margin:.3g} times the friction"
        if margin > LARGE_MARGIN:
            words += f" at the ends of legs, up to {LARGE_MARGIN:g} between them"
        lines.append(("friction margin", words))
    if static is not None:
        rest = "proved to be all" if static["proved"] else "others not excluded"
        lines.append(("first loading", f"{_solutions(static['solutions'])}, {rest}"))
    return lines


def _solutions(count: int) -> str:
    return f"{count} solution{'' if count == 1 else 's'} found"
