"""Sections on estimated space errors, and on the search for a mesh that meets a tolerance."""

from __future__ import annotations

from typing import Any

from receding_fenicsx.output.report.section import Section, Summary

DIVERGES = "does not converge in order"
"""Estimate of a number that moves on without end."""
SINGULAR = "singular"
"""Value of a number that is infinite."""


def error_rows(summary: Summary) -> list[list[str]]:
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
        rows.append([words, f"{error}{seen}"])
    return [*rows, *([head, words] for head, words in _doubts(summary))]


def _doubts(summary: Summary) -> list[tuple[str, str]]:
    """Return what is wrong with the estimates, a head and words."""
    heads = {"errors_warning": "space errors", "errors_failure": "space errors are not known"}
    return [(head, summary[key]) for key, head in heads.items() if key in summary]


def _error_lines(summary: Summary) -> list[str]:
    """Return doubts about the estimates, and the largest relative errors on one line."""
    errors = (summary.get("errors") or {}).items()
    lines = [f"{head}: {words}" for head, words in _doubts(summary)]
    wrong = [name for name, found in errors if found.get("converges") is False]
    if wrong:
        lines.append(f"{', '.join(wrong[:3])}{', ...' * (len(wrong) > 3)}: {DIVERGES}")
    known = sorted(((e["relative"], name) for name, e in errors if e.get("relative")), reverse=True)
    if known:
        listed = ", ".join(f"{name} {relative:.1e}" for relative, name in known[:2])
        lines.append(f"largest estimated relative space errors: {listed}")
    return lines


def search_rows(summary: Summary) -> list[list[Any]]:
    """Return the table of a search: a row for each mesh and number, then meshes without answer."""
    if "accuracy" not in summary:
        return []
    rows = []
    for level in summary["accuracy"]["way"]:
        mesh = [str(level["elements"]), str(level["nodes"])]
        seconds = f"{level['seconds']:.2f}"
        for name, found in level["numbers"].items():
            value = "-" if found["value"] is None else f"{found['value']:.6g}"
            error, relative = _figures(found["error"]), _figures(found["relative"])
            if found["converges"] is False:
                error = DIVERGES
                value = SINGULAR if found["value"] is None else value
            rows.append([*mesh, name, value, error, relative, seconds])
            mesh, seconds = ["", ""], ""
    failures = summary["accuracy"]["failures"]
    return [*rows, *([str(n), "", "no answer", why, "", "", ""] for n, why in failures)]


def _figures(error: float | None) -> str:
    return "-" if error is None else f"{error:.1e}"


def unmet(summary: Summary) -> str:
    """Return why a tolerance is not met; "" where it is, or none was asked for."""
    search = summary.get("accuracy") or {"met": True}
    if search["met"]:
        return ""
    return f"[accuracy] tolerance: {search['tolerance']:g} is not met: {search['reason']}"


def verdict(summary: Summary) -> str:
    """Return how a search ended, in a line; "" without one."""
    search = summary.get("accuracy")
    if search is None:
        return ""
    kind = "graded meshes" if search.get("graded") else "meshes"
    spent = f"{search['seconds']:.3g} s on {len(search['way'])} {kind}"
    if search["met"]:
        return f"tolerance {search['tolerance']:g} met: twice each estimate is below it; {spent}"
    return f"tolerance {search['tolerance']:g} NOT met: {search['reason']}; {spent}"


ERRORS = Section("Space errors", rows=error_rows, lines=_error_lines)
SEARCH = Section(
    "Search for the tolerance",
    rows=search_rows,
    head=lambda _: ["elements", "nodes", "number", "value", "estimate", "relative", "seconds"],
    note=lambda summary: f"{verdict(summary)}.",
    lines=lambda summary: [verdict(summary)] if "accuracy" in summary else [],
)
