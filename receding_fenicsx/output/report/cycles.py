"""Sections on cycles: dissipation, steady state, limit of infinitely many cycles."""

from __future__ import annotations

from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.steady import RATCHETTING, limit_of_decay
from receding_fenicsx.output.report.section import Rows, Summary, shown
from receding_fenicsx.scene.history import DEFAULT_TOLERANCE, history_from_scene, is_straight


def cycle_rows(summary: Summary) -> Rows:
    """Return the first 20 cycles and the last one."""
    D, slip = summary["dissipation_per_cycle"], summary["slip_per_cycle_max"]
    first = D[0] if D and summary.get("dissipates", True) else 0.0
    numbers = sorted({*range(min(20, len(D))), len(D) - 1}) if D else []
    return [[k + 1, D[k], D[k] / first if first else None, slip[k]] for k in numbers]


def ratio_words(summary: Summary) -> tuple[str, str] | None:
    """Return what the ratio of the last to the first dissipation is, and the ratio in figures."""
    D = summary["dissipation_per_cycle"]
    if not D or not D[0] or not summary.get("dissipates", True):
        return None
    return f"dissipation of cycle {len(D)} over cycle 1", f"{D[-1] / D[0]:.5f}"


def cycles(record: Record) -> dict[str, Any]:
    """Return dissipation and largest slip of each cycle."""
    slip = np.abs(record.cycles.slip_increment).max(axis=1, initial=0.0)
    return {
        "dissipation_first_loading": float(record.dissipation_first_loading),
        "dissipation_per_cycle": record.cycles.dissipation.tolist(),
        "dissipates": record.dissipates,
        # of nodes in contact at the cycle's start and end
        "slip_per_cycle_max": slip.tolist(),
    }


def cycle_note(summary: Summary) -> str:
    """Return the dissipation of the first loading."""
    first = shown(summary["dissipation_first_loading"])
    return f"Dissipation of the first loading: {first}. All cycles are in summary.json."


# -- steady state --------------------------------------------------------------------------------


def steady_state(record: Record) -> dict[str, Any]:
    """Return the steady state, or else the trend of the dissipation with its extrapolated limit."""
    steady, D = record.steady, record.cycles.dissipation
    found: dict[str, Any] = {
        "reached": bool(steady.reached),
        "cycle": int(steady.cycle),
        "kind": steady.kind,
        "period": int(steady.period),
    }
    # fewer cycles show no trend
    if not steady.reached and len(D) >= 8 and record.dissipates:
        keys = ("trend", "trend_value", "dissipation_limit")
        found |= dict(zip(keys, limit_of_decay(D), strict=True))
    scene, doubling = record.scene, record.doubling
    if scene is None or scene.history.kind != "harmonic":
        return {"steady": found, **limit_summary(record)}
    # the polygon that stands for a harmonic history
    polygon: dict[str, Any] = {"corners": len(history_from_scene(scene).loop) - 1}
    if doubling is None or is_straight(scene.history):
        polygon["error_estimate"] = 0.0 if is_straight(scene.history) else None
    else:
        tolerance = scene.history.tolerance or DEFAULT_TOLERANCE
        polygon |= {"error_estimate": float(doubling[-1, 1]), "tolerance": tolerance}
        polygon["doubling"] = [[int(n), float(e)] for n, e in doubling]
    return {"steady": found, "harmonic": polygon, **limit_summary(record)}


def limit_summary(record: Record) -> dict[str, Any]:
    """Return the key "limit" of the summary; nothing where the limit was not asked for."""
    limit, D = record.limit, record.cycles.dissipation
    if limit is None:
        return {}
    period, last, walk = record.steady.period, None, None
    if limit.reached:
        last = float(D[-period:].mean())
        if record.steady.kind == RATCHETTING:
            gained = record.cycles.slip_increment[-period:].mean(axis=0)
            walk = float(gained[np.abs(gained).argmax()])
    return {
        "limit": {
            "reached": bool(limit.reached),
            "cycle": int(limit.cycle),
            "cycles_played": int(limit.cycles_played),
            "dissipation": last,
            "dissipation_ratio": last / float(D[0]) if last and record.dissipates else None,
            "residual": float(limit.residual) if np.isfinite(limit.residual) else None,
            "period": int(period) if limit.reached else None,
            # the largest slip that each cycle of ratchetting adds
            "walk": walk,
            # None where it was not examined
            "unique": {1: True, 0: False}.get(int(limit.unique)),
            "reason": limit.reason,
            "jumped": bool(limit.jumped),
        }
    }


def _first_rows(summary: Summary) -> Rows:
    """Return the steady state, the ratio of dissipations, its limit by extrapolation."""
    D, steady = summary["dissipation_per_cycle"], summary["steady"]
    if not D:
        return []
    start = f", from cycle {steady['cycle']}, period {steady['period']}"
    rows: Rows = [["steady state", steady["kind"] + start * steady["reached"]]]
    if ratio := ratio_words(summary):
        rows.append([*ratio])
    if steady.get("dissipation_limit"):
        law = f"{steady['trend']} law, {steady['trend_value']:.3g}"
        rows.append(["extrapolated", f"{steady['dissipation_limit'] / D[0]:.4f} ({law})"])
    return rows


def limit_rows(summary: Summary) -> Rows:
    """Return rows on the limit of infinitely many cycles, if it was asked for."""
    limit = summary.get("limit")
    if limit is None:
        return []
    words, reason = f"cycle {limit['cycle']}; {limit['reason']}", []
    if not limit["reached"]:
        words = f"not reached; {limit['reason']}"
    elif limit["jumped"]:
        words = f"shown as cycle {limit['cycle']}, residual {limit['residual']:.1e}, found by a "
        words += f"search, {limit['cycles_played']} cycles played"
        reason = [["reason", limit["reason"]]]
    rows = [["limit of infinitely many cycles", words], *reason]
    if limit.get("walk") is not None:
        rows.append(["ratchetting", f"a cycle adds the slip {limit['walk']:.6g}"])
    return [*rows, *_starts_rows(limit.get("starts"))]


def _starts_rows(starts: Summary | None) -> Rows:
    """Return a row on the limits from further initial slips, if they were asked for."""
    if starts is None:
        return []
    words = ", ".join(f"{count} {kind}" for kind, count in starts["kinds"].items())
    if starts["dissipation"] is not None:
        low, high = starts["dissipation"]
        spread = "" if starts["spread"] is None else f" (spread {starts['spread']:.2g})"
        words += f"; dissipation per cycle {low:.6g} to {high:.6g}{spread}"
    if len(starts["zones"]) > 1:
        nodes = f"{starts['nodes_that_differ']} of {starts['nodes']} nodes"
        words += f"; {len(starts['zones'])} arrangements of zones, which differ at {nodes}"
    differ = "do not differ" if starts["same"] else "differ"
    return [[f"limits from {starts['count']} initial slips {differ}", words]]


def _polygon_rows(summary: Summary) -> Rows:
    """Return the row on the polygon that stands for a harmonic history, if it is one."""
    polygon = summary.get("harmonic")
    if polygon is None:
        return []
    error = polygon["error_estimate"]
    if error is not None and np.isfinite(error):
        words = f"{error:.1e}" if error else "none, a straight line"
    else:
        ended = "tolerance" in polygon
        words = "unknown, the history ended early" if ended else "not estimated, fixed corners"
    head = f"harmonic history, polygon of {polygon['corners']} corners"
    return [[head, f"error of the dissipation per cycle {words}"]]


def steady_lines(summary: Summary) -> list[str]:
    """Return the steady state with the ratio of dissipations, and the limit, on a line each."""
    first, limit, polygon = _first_rows(summary), limit_rows(summary), _polygon_rows(summary)
    if len(limit) > 1 and limit[1][0] == "reason":
        # how it was found is in the report
        limit = [[limit[0][0], limit[0][1].partition(", found")[0]], *limit[2:]]
    # the law of an extrapolation is in the report
    together = "; ".join(f"{head}: {words}".partition(" (")[0] for head, words in first)
    rest = [f"{head}: {words}" for head, words in [*limit, *polygon]]
    return [together, *rest]


def steady_rows(summary: Summary) -> Rows:
    """Return steady state, limit and polygon."""
    return [*_first_rows(summary), *limit_rows(summary), *_polygon_rows(summary)]
