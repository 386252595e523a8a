"""Estimated errors of a run's numbers, and the search for its mesh, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from receding_fenicsx.arrays import aligned

WAY_HEAD = ["elements", "nodes", "number", "value", "estimate", "relative", "seconds"]
"""Columns of the table of a search."""
DIVERGES = "does not converge in order"
"""Estimate of a number that moves on without end."""
SINGULAR = "singular"
"""Value of a number that is infinite."""


def error_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the headline numbers with their estimated space errors, and warnings about these."""
    rows = []
    for name, found in (summary.get("errors") or {}).items():
        error = "unknown" if found["error"] is None else f"{found['error']:.1e}"
        if found.get("converges") is False:
            error = DIVERGES
        order = found.get("order")
        seen = "" if order is None else f" (observed order {order:.1f})"
        value = SINGULAR if found["value"] is None else f"{found['value']:.6g}"
        words = f"{name.replace('_', ' ')} {value}, estimated space error"
        rows.append((words, f"{error}{seen}"))
    if "errors_warning" in summary:
        rows.append(("space errors:", summary["errors_warning"]))
    if "errors_failure" in summary:
        rows.append(("space errors are not known:", summary["errors_failure"]))
    return rows


def way_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Return the rows of the table of a search: a row for each mesh and number."""
    rows = []
    for level in summary["accuracy"]["way"]:
        mesh = [str(level["elements"]), str(level["nodes"])]
        seconds = f"{level['seconds']:.2f}"
        for name, found in level["numbers"].items():
            value = "-" if found["value"] is None else f"{found['value']:.6g}"
            error, relative = (
                "-" if found[key] is None else f"{found[key]:.1e}" for key in ("error", "relative")
            )
            if found["converges"] is False:
                error = DIVERGES
                value = SINGULAR if found["value"] is None else value
            rows.append([*mesh, name, value, error, relative, seconds])
            mesh, seconds = ["", ""], ""
    return rows


def unmet(summary: Mapping[str, Any]) -> str:
    """Return why a tolerance is not met; "" where it is, or none was asked for."""
    search = summary.get("accuracy") or {"met": True}
    if search["met"]:
        return ""
    return f"[accuracy] tolerance: {search['tolerance']:g} is not met: {search['reason']}"


def verdict(summary: Mapping[str, Any]) -> str:
    """Return how a search ended, in a line; "" without one."""
    search = summary.get("accuracy")
    if search is None:
        return ""
    kind = "graded meshes" if search.get("graded") else "meshes"
    spent = f"{search['seconds']:.3g} s on {len(search['way'])} {kind}"
    if search["met"]:
        return f"tolerance {search['tolerance']:g} met: twice each estimate is below it; {spent}"
    return f"tolerance {search['tolerance']:g} NOT met: {search['reason']}; {spent}"


def way_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the table of a search and how it ended; nothing without one."""
    if "accuracy" not in summary:
        return []
    failed = [
        f"no answer on {elements} elements: {reason}"
        for elements, reason in summary["accuracy"]["failures"]
    ]
    return [*failed, *aligned([WAY_HEAD, *way_rows(summary)]), verdict(summary)]
