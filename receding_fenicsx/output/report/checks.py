"""Sections on checks (residual, energy, uniqueness, friction limits, corners) and on fatigue."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.uniqueness.watch import LARGE_MARGIN
from receding_fenicsx.measures.ends import is_singular
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.measures.limit_nodes import limit_nodes
from receding_fenicsx.output.report.section import Rows, Section, Summary
from receding_fenicsx.output.report.turning_points import headline_points

SYMMETRIC = ", among mirror-symmetric paths"
"""Restriction of the certificate of half a model."""


def _summary(record: Record) -> dict[str, Any]:
    """Return residual, energy error, numbers of steps, uniqueness and chosen continuations."""
    branch = {}
    if record.choices:
        rule = record.scene.solver.branch if record.scene else "first"
        choices = [asdict(choice) for choice in record.choices]
        branch = {"branch": {"rule": rule, "choices": choices}}
    return {
        "limit_without_slip": _limit_ranges(record),
        **uniqueness_summary(record),
        **branch,
        "residual_max": float(record.residual_max),
        "energy_error_max": float(record.energy_error_max),
        "events": int(record.n_events),
        "jumps": {"count": int(record.jumps), "energy_released": float(record.released)},
        "sweeps": int(record.sweeps),
    }


def _limit_ranges(record: Record) -> list[list[Any]]:
    """Return ranges of x that reach the friction limit without slip in the last cycle."""
    last = len(record.cycles.dissipation)
    if not last or not np.any(record.samples.cycle == last):
        return []
    edges = record.by_edge()
    ranges: list[list[Any]] = []
    for name, part in edges.items():
        nodes = limit_nodes(part, last).node
        groups = np.split(nodes, np.flatnonzero(np.diff(nodes) > 1) + 1) if len(nodes) else []
        behind = [name] if len(edges) > 1 else []
        ranges += [[float(part.x[g[0]]), float(part.x[g[-1]]), *behind] for g in groups]
    return ranges


def uniqueness_summary(record: Record) -> dict[str, Any]:
    """Return the key "uniqueness" of the summary; nothing for records without it."""
    found = record.uniqueness
    if found is None:
        return {}
    place = {"cycle": int(found.cycle), "leg": int(found.leg), "s": float(found.s)}
    static = {"solutions": int(found.first_loading), "proved": bool(found.first_loading_proved)}
    return {
        "uniqueness": {
            "certified": bool(found.certified),
            "margin": float(found.margin),  # null in the file where it is not finite
            "solutions": int(found.solutions),
            "where": {**place, "nodes": found.nodes.tolist()} if found.cycle >= 0 else None,
            "first_loading": static if found.first_loading else None,
            "symmetric_paths_only": bool(record.half),
        }
    }


def uniqueness_rows(summary: Summary) -> Rows:
    """Return what a run says of uniqueness, a head and words for each fact; nothing without it."""
    found = summary.get("uniqueness")
    if found is None:
        return []
    margin, place, static = found["margin"], found["where"], found["first_loading"]
    words = "certified" if found["certified"] else "not certified"
    if found["certified"] and static is not None and not static["proved"]:
        words += " after the first loading (not proved unique)"
    if summary["method"] != "events":
        words += " at the ends of load steps"
    rows = [["only path from its start", words + SYMMETRIC * found["symmetric_paths_only"]]]
    if place is not None:
        nodes = ", ".join(map(str, place["nodes"]))
        at = f", nodes {nodes}" if nodes else ""
        words = f"cycle {place['cycle']}, leg {place['leg']}, s = {place['s']:.6g}{at}; at most "
        rows.append(["first doubt", f"{words}{_solutions(found['solutions'])} at one instant"])
    if margin is not None and np.isfinite(margin):
        where = "elsewhere the " if margin > 1.0 and not found["certified"] else ""
        words = f"{where}proof holds up to {margin:.3g} times the friction"
        if margin > LARGE_MARGIN:
            words += f" at the ends of legs, up to {LARGE_MARGIN:g} between them"
        rows.append(["friction margin", words])
    if static is not None:
        rest = "proved to be all" if static["proved"] else "others not excluded"
        rows.append(["first loading", f"{_solutions(static['solutions'])}, {rest}"])
    return rows


def _solutions(count: int) -> str:
    return f"{count} solution{'' if count == 1 else 's'} found"


def _jump_rows(summary: Summary) -> Rows:
    jumps = summary.get("jumps") or {"count": 0}
    words = "{count}, energy released {energy_released:.4g}"
    found = ["jumps without a quasi-static path", words.format(**jumps)] if jumps["count"] else []
    return [found] if found else []


def _corners(summary: Summary) -> list[Summary]:
    """Return the corners at the turning points of the table."""
    return [c for point in headline_points(summary) for c in point.get("corners") or []]


def corner_rows(summary: Summary) -> Rows:
    """Return a row for each different corner and state at the turning points of the table."""
    rows = []
    last = {(f"{corner['x']:z.4g}", corner["state"]): corner for corner in _corners(summary)}
    for (x, state), corner in last.items():
        exact, fitted = (
            "-" if corner[k] is None else f"{corner[k]:z.4f}" for k in ("exponent", "fitted")
        )
        known = (
            f"closed form, {corner['angle']:g} degrees" if exact != "-" else "no closed form here"
        )
        words = f"stresses like d^m, m = {exact} ({known}), fitted {fitted}"
        rows.append([f"corner at {x}, {state}", words + "; singular" * is_singular(corner)])
    return rows


def _rows(summary: Summary) -> Rows:
    residual = "largest residual of contact and friction conditions, over the largest nodal force"
    energy = "largest relative error of a leg's energy balance"
    rows = [
        [residual, f"{summary['residual_max']:.2e}"],
        [energy, f"{summary['energy_error_max']:.2e}"],
        *([k, str(summary[k])] for k in ("events", "sweeps")),
        *_jump_rows(summary),
        *uniqueness_rows(summary),
        *corner_rows(summary),
    ]
    ranges = ", ".join(
        " on ".join([f"{a:z.4g} to {b:z.4g}", *edge])
        for a, b, *edge in summary.get("limit_without_slip") or []
    )
    if ranges:
        rows.append(["friction limit reached without slip in the last cycle, x from", ranges])
    return rows


def _lines(summary: Summary) -> list[str]:
    """Return jumps, the certificate with its first doubt, singular corners, residual and steps."""
    facts = [*_jump_rows(summary), *uniqueness_rows(summary)]
    # how far the proof goes, and the first loading, are in the report
    lines = [f"{k}: {words}" for k, words in facts if k not in ("friction margin", "first loading")]
    lines = [
        line.replace("only path", "only symmetric path").removesuffix(SYMMETRIC)
        if line.endswith(SYMMETRIC)
        else line
        for line in lines
    ]
    if places := sorted({corner["x"] for corner in _corners(summary) if is_singular(corner)}):
        words = ", ".join(f"{x:z.4g}" for x in places)
        lines.append(f"infinite stresses at corners in contact: x = {words}")
    counted = "events" if summary["method"] == "events" else "sweeps"
    residual = f"largest residual {summary['residual_max']:.1e}, {counted} {summary[counted]}"
    return [*lines, residual]


CHECKS = Section("Checks", summary=_summary, rows=_rows, lines=_lines)


# -- fatigue parameters: the worst point of each -------------------------------------------------

CRITERIA = {
    "swt": "Smith, Watson and Topper",
    "fatemi_socie": "Fatemi and Socie",
    "dang_van": "Dang Van",
    "crossland": "Crossland",
    "ruiz_f1": "Ruiz F1",
    "ruiz_f2": "Ruiz F2",
}
COLUMNS = ("max", "x", "y", "probe", "angle", "estimate", "averaged", "life")


def _parameters(summary: Summary) -> dict[str, Any]:
    return dict(summary.get("fatigue", {}).get("parameters", {}))


def _note(summary: Summary) -> str:
    """Return what the mesh decides by more than a tenth."""
    large = [
        CRITERIA[name]
        for name, row in _parameters(summary).items()
        if row["estimate"] is not None and row["estimate"] > 0.1 * abs(row["max"])
    ]
    if not large:
        return ""
    return (
        f"The mesh decides {', '.join(large)} by more than 10%: refine the ends of the contact; at "
        "a singular corner take the mean over a length, [fatigue] average."
    )


def _fatigue_lines(summary: Summary) -> list[str]:
    row = _parameters(summary).get("swt")
    if row is None:
        return []
    life = "" if row["life"] is None else f", {row['life']:.3g} cycles"
    error = "" if row["estimate"] is None else f" +- {row['estimate']:.1g}"
    place = f"x = {row['x']:.4g} of probe '{row['probe']}', plane at {row['angle']:.0f} degrees"
    return [f"fatigue: Smith, Watson and Topper {row['max']:.4g}{error} at {place}{life}"]


FATIGUE = Section(
    "Fatigue parameters",
    summary=fatigue_summary,
    rows=lambda summary: [
        [CRITERIA[name], *(row.get(column) for column in COLUMNS)]
        for name, row in _parameters(summary).items()
    ],
    head=lambda _: ["parameter", *COLUMNS],
    note=_note,
    lines=_fatigue_lines,
)
