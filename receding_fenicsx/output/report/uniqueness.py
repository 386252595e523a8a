"""Uniqueness of a path, for ``summary.json``, the console and the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from receding_fenicsx.evolution.record import Record

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
        "margin": float(found.margin),  # null in the file where nothing slips
        "solutions": int(found.solutions),
        "where": {**place, "nodes": found.nodes.tolist()} if found.cycle >= 0 else None,
        "first_loading": static if found.first_loading else None,
        "symmetric_paths_only": bool(record.half),
    }
    return {"uniqueness": told}


def uniqueness_line(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what a run says of uniqueness, as head and words; nothing without it."""
    found = summary.get("uniqueness")
    if found is None:
        return []
    margin, place, static = found["margin"], found["where"], found["first_loading"]
    words = "certified" if found["certified"] else "not certified"
    if summary["method"] != "events":
        words += " at the ends of load steps"
    if found["symmetric_paths_only"]:
        words += ", among mirror-symmetric paths"
    if place is not None:
        nodes = ", ".join(map(str, place["nodes"]))
        at = f" at nodes {nodes}" if nodes else ""
        words += f", in doubt from cycle {place['cycle']}, leg {place['leg']}, s = {place['s']:.6g}"
        words += f"{at}; {found['solutions']} found at one instant"
    if margin is not None and margin < float("inf"):
        words += f"; rates unique up to {margin:.3g} times the friction"
    if static is not None:
        several = f"{static['solutions']} solution{'s' if static['solutions'] > 1 else ''}"
        rest = "proved" if static["proved"] else "others not excluded"
        words += f"; first loading: {several}, {rest}"
    return [(CERTIFICATE, words)]
