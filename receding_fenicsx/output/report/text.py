"""Table of a run for the console."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from receding_fenicsx.arrays import aligned
from receding_fenicsx.measures.corner_exponents import is_singular
from receding_fenicsx.output.report.accuracy import error_rows, way_lines
from receding_fenicsx.output.report.bolts import force_lines
from receding_fenicsx.output.report.limit import limit_lines
from receding_fenicsx.output.report.uniqueness import uniqueness_lines
from receding_fenicsx.scene.units import in_unit

EXTREMES = ("p_max", "q_min", "q_max")
"""Extreme tractions of a turning point."""
MANY_LEGS = 12
"""Largest number of legs of a cycle whose turning points are all in the printed table."""
ROUND_OFF = 1e-12
"""Part of the largest traction below which a traction is round-off."""
COLUMNS = (
    "cycle",
    "load",
    "contact half width",
    "fitted",
    "stick half width",
    "fitted",
    "p_max",
    "|q|_max",
)
"""Columns of the table of turning points; "fitted" half widths are those between nodes."""
UNIT_OF_COLUMN = {
    **dict.fromkeys(("contact half width", "stick half width"), "length"),
    **dict.fromkeys(("p_max", "|q|_max", "p max", "q min", "q max"), "stress"),
}
"""Unit of a column; other columns have none."""


def run_table(summary: Mapping[str, Any]) -> str:
    """Return the table that a run prints.

    Args:
        summary: contents of ``summary.json``.

    Returns:
        Text: turning points of the first loading and of the first and last cycles, dissipation,
        steady state, residual, timings.
    """
    lines = [
        f"{summary['title'] or 'untitled'}: {summary['nodes']} contact nodes, "
        f"{summary['modelled_nodes']} modelled, method {summary['method']}",
        *_turning_points(summary),
        *_cycles(summary),
        *(f"{words} {error}" for words, error in error_rows(summary)),
        *force_lines(summary),
        *way_lines(summary),
        *_checks(summary),
        *(f"warning: {text}" for text in summary.get("warnings") or []),
    ]
    if "timings" in summary:
        times = ", ".join(f"{name} {seconds:.2f}" for name, seconds in summary["timings"].items())
        lines.append(f"seconds: {times}; peak memory {summary['peak_memory_MB']:.0f} MB")
    return "\n".join(lines)


def _turning_points(summary: Mapping[str, Any]) -> list[str]:
    """Return the table of the turning points of cycle 0, of cycle 1 and of the last cycle."""
    points = headline_points(summary)
    edge = ["edge"] if any("edge" in p for p in points) else []
    length, traction = length_format(summary), _format([p[k] for p in points for k in EXTREMES])
    rows = [
        [
            *(p[key] for key in edge),
            str(p["cycle"]),
            " ".join(f"{name}={value:z.4g}" for name, value in p["load"].items()),
            shown(p["contact_half_width"], length),
            fitted(p.get("contact_half_width_estimate"), length),
            shown(p["stick_half_width"], length),
            fitted(p.get("stick_half_width_estimate"), length),
            *largest_shown(p, traction),
            zones_shown(p, summary),
        ]
        for p in points
    ]
    table = aligned([[*edge, *heads(COLUMNS, summary), zones_header(summary)], *rows])
    return [*table, *corner_lines(points)]


def largest_shown(point: Mapping[str, Any], form: str) -> tuple[str, str]:
    """Return the largest pressure and shear traction in words, "singular" where they have none."""
    p, *q = extremes_of(point)
    largest = max(map(abs, q))
    if point.get("p_max_singular"):
        return "singular", "singular" if largest > 0.0 else f"{largest:{form}}"
    return f"{p:{form}}", f"{largest:{form}}"


def heads(names: Sequence[str], summary: Mapping[str, Any]) -> list[str]:
    """Return the heads of columns, with the scene's units where it has some."""
    units = summary.get("units") or {}
    return [in_unit(name, units.get(UNIT_OF_COLUMN.get(name))) for name in names]


def headline_points(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the turning points of cycles 0, 1 and the last, of many legs those at extreme loads.

    In a cycle of more than ``MANY_LEGS`` these are where a load factor is the smallest or the
    largest of the cycle, and the end of the cycle.
    """
    points = summary["turning_points"]
    last = max((p["cycle"] for p in points), default=0)
    found = []
    for cycle in sorted({0, 1, last}):
        rows = [p for p in points if p["cycle"] == cycle]
        legs = {p["leg"]: p["load"] for p in rows}
        kept = {*legs}
        if len(legs) > MANY_LEGS:
            factors = [[load[name] for load in legs.values()] for name in rows[0]["load"]]
            ends = [(v.index(min(v)), v.index(max(v))) for v in factors if min(v) < max(v)]
            kept = {list(legs)[k] for pair in ends for k in pair} | {max(legs)}
        found += [p for p in rows if p["leg"] in kept]
    return found


def _cycles(summary: Mapping[str, Any]) -> list[str]:
    """Return lines on dissipation and steady state."""
    D, steady = summary["dissipation_per_cycle"], summary["steady"]
    if not D:
        return []
    lines = []
    if D[0] and summary.get("dissipates", True):
        lines.append(f"dissipation of cycle {len(D)} over cycle 1: {D[-1] / D[0]:.5f}")
    start = f", from cycle {steady['cycle']}, period {steady['period']}"
    lines.append(f"steady state: {steady['kind']}{start if steady['reached'] else ''}")
    if steady.get("dissipation_limit"):
        lines.append(
            f"dissipation, {steady['trend']} law ({steady['trend_value']:.3g}): extrapolated limit "
            f"{steady['dissipation_limit'] / D[0]:.4f} of cycle 1"
        )
    return lines + limit_lines(summary) + polygon_line(summary)


def polygon_line(summary: Mapping[str, Any]) -> list[str]:
    """Return the line on the polygon that stands for a harmonic history, if it is one."""
    polygon = summary.get("harmonic")
    if polygon is None:
        return []
    error = polygon["error_estimate"]
    words = "not estimated, the corners are fixed" if error is None else f"{error:.1e}"
    if error == 0.0:
        words = "none, the loads follow a straight line"
    elif error is None and "tolerance" in polygon:
        words = "unknown, the history ended early"
    return [
        f"harmonic history: polygon of {polygon['corners']} corners, error of the dissipation per "
        f"cycle by it: {words}"
    ]


def _checks(summary: Mapping[str, Any]) -> list[str]:
    """Return lines on friction limit, uniqueness, residual and number of steps."""
    lines = []
    if ranges := limit_ranges(summary):
        lines.append(f"friction limit reached without slip in the last cycle: x from {ranges}")
    lines += [f"{head}: {words}" for head, words in uniqueness_lines(summary)]
    lines.append(
        f"largest residual {summary['residual_max']:.1e}, events {summary['events']}, "
        f"sweeps {summary['sweeps']}"
    )
    return lines


def limit_ranges(summary: Mapping[str, Any]) -> str:
    """Return the ranges of x that reach the friction limit without slip in the last cycle."""
    return ", ".join(
        " on ".join([f"{a:z.4g} to {b:z.4g}", *edge])
        for a, b, *edge in summary.get("limit_without_slip") or []
    )


def zones_header(summary: Mapping[str, Any]) -> str:
    """Return the header of the column of zones; of a symmetric contact only one half is shown."""
    points = summary["turning_points"]
    if any("edge" in p or _off_axis(p, summary) for p in points):
        return "zones"
    return {
        "mirror": "zones (x > 0, from the centre)",
        "axisymmetric": "zones (from the axis)",
    }.get(summary["symmetry"], "zones")


def zones_shown(point: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    """Return the zones of a turning point; of a symmetric contact those from the centre."""
    zones, symmetry = point["zones"], summary["symmetry"]
    form = length_format(summary)
    mirrored = symmetry in ("mirror", "axisymmetric")
    if not mirrored or "edge" in point or _off_axis(point, summary):
        first = f"{zones[0][1]:{form}} " if zones else ""
        return first + " | ".join(f"{name} to {end:{form}}" for name, _, end in zones)
    centre = 0.0 if symmetry == "axisymmetric" else 0.5 * (zones[0][1] + zones[-1][2])
    return " | ".join(f"{name} to {end:{form}}" for name, _, end in zones if end > centre)


def _off_axis(point: Mapping[str, Any], summary: Mapping[str, Any]) -> bool:
    """Return whether the contact of a body of revolution does not begin on the axis."""
    return summary["symmetry"] == "axisymmetric" and "p_axis" not in point


def shown(value: float | None, form: str) -> str:
    """Format a number; None is a dash."""
    return "-" if value is None else f"{value:{form}}"


def fitted(estimate: Mapping[str, Any] | None, form: str = "z.4f") -> str:
    """Format a fitted half width with its interval; a dash if nothing was fitted."""
    if estimate is None or not estimate["fitted"]:
        return "-"
    low, high = estimate["interval"]
    return f"{estimate['value']:{form}} ({low:{form}} to {high:{form}})"


def extremes_of(point: Mapping[str, Any]) -> list[float]:
    """Return p_max, q_min and q_max of a turning point, with 0 in place of round-off."""
    values = [point[key] for key in EXTREMES]
    largest = max(map(abs, values))
    return [value if abs(value) > ROUND_OFF * largest else 0.0 for value in values]


def length_format(summary: Mapping[str, Any]) -> str:
    """Return the format of positions along the contact, for any unit of length."""
    zones = [zone for point in summary["turning_points"] for zone in point["zones"]]
    return _format([end for _, *ends in zones for end in ends])


def _format(values: Sequence[float]) -> str:
    """Return a format that shows about five digits of the largest value.

    Values that round to zero have no sign.
    """
    largest = max((abs(value) for value in values), default=0.0)
    if largest == 0.0 or 0.1 <= largest < 100.0:
        return "z.4f"
    places = 4 - math.floor(math.log10(largest))
    return f"z.{places}f" if 0 <= places <= 8 else "z.4e"


def corner_lines(points: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a line for each different corner and state at turning points of the summary."""
    last: dict[tuple[str, str], Mapping[str, Any]] = {}
    for point in points:
        for corner in point.get("corners") or []:
            last[f"{corner['x']:z.4g}", corner["state"]] = corner
    return [
        f"corner at {x}, {state}: stresses like d^m, m = {_exponent(corner['exponent'])} "
        f"({_origin(corner)}), fitted {_exponent(corner['fitted'])}"
        + ("; singular" if is_singular(corner) else "")
        for (x, state), corner in last.items()
    ]


def _origin(corner: Mapping[str, Any]) -> str:
    if corner["exponent"] is None:
        return "no closed form here"
    return f"closed form, {corner['angle']:g} degrees"


def _exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:z.4f}"
