"""Sections on checks (residual, energy, uniqueness, friction limits, corners) and on fatigue."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.uniqueness.watch import LARGE_MARGIN
from receding_fenicsx.measures.ends import is_singular
from receding_fenicsx.measures.limit_nodes import limit_nodes
from receding_fenicsx.output.report.section import Rows, Summary, shown
from receding_fenicsx.output.report.turning_points import headline_points


def checks(record: Record) -> dict[str, Any]:
    """Return residual, energy error, numbers of steps, uniqueness and chosen continuations."""
    last, ranges, edges = len(record.cycles.dissipation), [], record.by_edge()
    if last and np.any(record.samples.cycle == last):
        # ranges of x that reach the friction limit without slip in the last cycle
        for name, part in edges.items():
            nodes = limit_nodes(part, last).node
            behind = [name] if len(edges) > 1 else []
            for group in np.split(nodes, np.flatnonzero(np.diff(nodes) > 1) + 1):
                ranges += [[*part.x[group[[0, -1]]].tolist(), *behind]] if len(group) else []
    branch = {}
    if record.choices:
        rule = record.scene.solver.branch if record.scene else "first"
        choices = [asdict(choice) for choice in record.choices]
        branch = {"branch": {"rule": rule, "choices": choices}}
    return {
        "limit_without_slip": ranges,
        **uniqueness_summary(record),
        **branch,
        "residual_max": float(record.residual_max),
        "energy_error_max": float(record.energy_error_max),
        "events": int(record.n_events),
        "jumps": {"count": int(record.jumps), "energy_released": float(record.released)},
        "sweeps": int(record.sweeps),
    }


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
    if found["symmetric_paths_only"]:  # the certificate of half a model
        words += ", among mirror-symmetric paths"
    rows = [["only path from its start", words]]
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
    return [["jumps without a quasi-static path", words.format(**jumps)]] * bool(jumps["count"])


def _corners(summary: Summary) -> list[Summary]:
    """Return the corners at the turning points of the table."""
    return [c for point in headline_points(summary) for c in point.get("corners") or []]


def corner_rows(summary: Summary) -> Rows:
    """Return a row for each different corner and state at the turning points of the table."""
    rows = []
    last = {(f"{corner['x']:z.4g}", corner["state"]): corner for corner in _corners(summary)}
    for (x, state), corner in last.items():
        exact, fitted = (shown(corner[k], "{:z.4f}") for k in ("exponent", "fitted"))
        known = "no closed form here"
        if exact != "-":
            known = f"closed form, {corner['angle']:g} degrees"
        words = f"stresses like d^m, m = {exact} ({known}), fitted {fitted}"
        rows.append([f"corner at {x}, {state}", words + "; singular" * is_singular(corner)])
    return rows


def check_rows(summary: Summary) -> Rows:
    """Return residual, energy, steps, uniqueness, corners, and where the limit is reached."""
    residual = "largest residual of contact and friction conditions, over the largest nodal force"
    energy = "largest relative error of a leg's energy balance"
    ranges = ", ".join(
        " on ".join([f"{a:z.4g} to {b:z.4g}", *edge])
        for a, b, *edge in summary.get("limit_without_slip") or []
    )
    limit = "friction limit reached without slip in the last cycle, x from"
    return [
        [residual, f"{summary['residual_max']:.2e}"],
        [energy, f"{summary['energy_error_max']:.2e}"],
        *([k, str(summary[k])] for k in ("events", "sweeps")),
        *_jump_rows(summary),
        *uniqueness_rows(summary),
        *corner_rows(summary),
        *([[limit, ranges]] if ranges else []),
    ]


def check_lines(summary: Summary) -> list[str]:
    """Return jumps, the certificate with its first doubt, singular corners, residual and steps."""
    lines = []
    for head, words in [*_jump_rows(summary), *uniqueness_rows(summary)]:
        # how far the proof goes, and the first loading, are in the report
        if head not in ("friction margin", "first loading"):
            first, symmetric, _ = words.partition(", among mirror-symmetric paths")
            head = head.replace("only path", "only symmetric path") if symmetric else head
            lines.append(f"{head}: {first}")
    if places := sorted({corner["x"] for corner in _corners(summary) if is_singular(corner)}):
        words = ", ".join(f"{x:z.4g}" for x in places)
        lines.append(f"infinite stresses at corners in contact: x = {words}")
    counted = "events" if summary["method"] == "events" else "sweeps"
    residual = f"largest residual {summary['residual_max']:.1e}, {counted} {summary[counted]}"
    return [*lines, residual]


# -- fatigue parameters: the worst point of each -------------------------------------------------

CRITERIA = {
    "swt": "Smith, Watson and Topper",
    "fatemi_socie": "Fatemi and Socie",
    "dang_van": "Dang Van",
    "crossland": "Crossland",
    "ruiz_f1": "Ruiz F1",
    "ruiz_f2": "Ruiz F2",
}


def _parameters(summary: Summary) -> dict[str, Any]:
    return dict(summary.get("fatigue", {}).get("parameters", {}))


def fatigue_note(summary: Summary) -> str:
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


def fatigue_lines(summary: Summary) -> list[str]:
    """Return the largest of Smith, Watson and Topper's parameter."""
    row = _parameters(summary).get("swt")
    if row is None:
        return []
    life = "" if row["life"] is None else f", {row['life']:.3g} cycles"
    error = "" if row["estimate"] is None else f" +- {row['estimate']:.1g}"
    place = f"x = {row['x']:.4g} of probe '{row['probe']}', plane at {row['angle']:.0f} degrees"
    return [f"fatigue: Smith, Watson and Topper {row['max']:.4g}{error} at {place}{life}"]


def fatigue_table(summary: Summary) -> Rows:
    """Return the head and a row for each parameter."""
    columns = "max", "x", "y", "probe", "angle", "estimate", "averaged", "life"
    rows = [[CRITERIA[k], *map(row.get, columns)] for k, row in _parameters(summary).items()]
    return [["parameter", *columns], *rows]
