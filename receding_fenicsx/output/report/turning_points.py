"""Section on turning points: half widths, extreme tractions, zones, ends of zones, corners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from receding_fenicsx.arrays import aligned
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.zones import contact_zones, on_axis
from receding_fenicsx.measures import ends
from receding_fenicsx.output.plots.labels import MOST_TOLD
from receding_fenicsx.output.report.section import Rows, Summary
from receding_fenicsx.scene.options import in_unit

Point = Summary
"""A turning point of the summary."""


def turning_points(record: Record) -> dict[str, Any]:
    """Return the turning points in order; with several contact edges one for each edge."""
    edges = record.by_edge()
    parts = [
        ({"edge": name} if len(edges) > 1 else {}, part, ends.contact_betas(part))
        for name, part in edges.items()
    ]
    count = len(record.turning_points.s)
    points = [edge | _turning_point(part, i, b) for i in range(count) for edge, part, b in parts]
    return {"turning_points": points}


def _turning_point(record: Record, i: int, betas: tuple[float, ...]) -> dict[str, Any]:
    table = record.turning_points
    x, cycle = record.x, table.cycle
    found = contact_zones(x, table.state[i], record.friction.present, record.begins_on_axis)
    point: dict[str, Any] = {
        "cycle": int(cycle[i]),
        "leg": int(table.leg[i]),
        "load": dict(zip(record.load_names, table.load[i].tolist(), strict=True)),
        "zones": [[name, float(a), float(b)] for name, a, b in found],
        **({"p_axis": float(on_axis(x, table.p[i]))} if record.begins_on_axis else {}),
        **ends.half_widths(record, i),
        "p_max": float(table.p[i].max()),
        "q_min": float(table.q[i].min()),
        "q_max": float(table.q[i].max()),
    }
    # ends of zones are fitted in the first and the last cycles, if these have few legs: a fit takes
    # longer than a cycle
    early = cycle[i] <= 20 or cycle[i] == cycle[-1]
    if early and np.count_nonzero(cycle == cycle[i]) <= 32:
        point |= ends.half_width_estimates(record, i, betas)
        point |= {"zone_ends": ends.estimated_ends(record, i, betas), **ends.corners_of(record, i)}
    return point


def headline_points(summary: Summary) -> list[Point]:
    """Return the turning points of cycles 0, 1 and the last, of many legs those at extreme loads.

    In a cycle of more than 12 legs these are where a load factor is the smallest or the largest of
    the cycle, and the end of the cycle.
    """
    points = summary["turning_points"]
    found = []
    for cycle in sorted({0, 1, _last_cycle(points)}):
        rows = [p for p in points if p["cycle"] == cycle]
        legs = {p["leg"]: p["load"] for p in rows}
        kept = {*legs}
        if len(legs) > 12:
            factors = [[load[name] for load in legs.values()] for name in rows[0]["load"]]
            ends = [(v.index(min(v)), v.index(max(v))) for v in factors if min(v) < max(v)]
            kept = {list(legs)[k] for pair in ends for k in pair} | {max(legs)}
        found += [p for p in rows if p["leg"] in kept]
    return found


def _last_cycle(points: Sequence[Point]) -> int:
    return max((p["cycle"] for p in points), default=0)


def _acting(point: Point) -> dict[str, float]:
    """Return the load factors, of more than ``MOST_TOLD`` those that are not zero."""
    load: dict[str, float] = point["load"]
    return {name: value for name, value in load.items() if value or len(load) <= MOST_TOLD}


def point_rows(summary: Summary) -> Rows:
    """Return a row for each turning point of the table."""
    form = length_format(summary)
    rows = []
    for p in headline_points(summary):
        load = ", ".join(f"{name} = {value:z.6g}" for name, value in _acting(p).items())
        widths: list[float | str | None] = []
        for kind in ("contact", "stick"):
            fitted, words = p.get(f"{kind}_half_width_estimate"), None
            if fitted is not None and fitted["fitted"]:
                low, high = fitted["interval"]
                words = f"{fitted['value']:{form}} ({low:{form}} to {high:{form}})"
            widths += [p[f"{kind}_half_width"], words]
        values: list[float | str] = list(extremes_of(p))
        if p.get("p_max_singular"):
            values = ["singular", *("singular" if value else value for value in values[1:])]
        edge = [p["edge"]] if "edge" in p else []
        rows.append([*edge, p["cycle"], load, *widths, *values, zones_shown(p, summary)])
    return rows


def point_head(summary: Summary) -> list[str]:
    """Return the heads of the columns, with the scene's units."""
    head = ["cycle", "load", "contact half width", "fitted", "stick half width", "fitted"]
    edge = ["edge"] if any("edge" in p for p in summary["turning_points"]) else []
    head = [_in_units(name, summary) for name in [*edge, *head, "p max", "q min", "q max"]]
    return [*head, zones_header(summary)]


def console_table(summary: Summary, most: int) -> list[str]:
    """Return a table of at most so many turning points: of the last cycle, then of cycles 0 and 1.

    Columns that do not fit the console are left out. Half widths are the fitted ones where all that
    are shown are fitted.
    """
    points = headline_points(summary)
    rank = {1: 2, 0: 1, _last_cycle(points): 0}
    order = sorted(range(len(points)), key=lambda k: (rank[points[k]["cycle"]], -k))
    # all contact edges of an instant, or none
    edges = len({p.get("edge") for p in points}) or 1
    chosen = [points[k] for k in sorted(order[: max(most // edges * edges, 1)])]
    traction = _format([p[k] for p in points for k in ("p_max", "q_min", "q_max")])
    largest = [largest_shown(p, traction) for p in chosen]
    columns = {
        "edge": [p.get("edge", "") for p in chosen],
        "cycle": [str(p["cycle"]) for p in chosen],
        "load": [
            " ".join(f"{name}={value:z.4g}" for name, value in _acting(p).items()) for p in chosen
        ],
        "contact half width": _half_widths("contact", chosen, summary),
        "stick half width": _half_widths("stick", chosen, summary),
        "p_max": [p for p, _ in largest],
        "|q|_max": [q for _, q in largest],
        zones_header(summary): [zones_shown(p, summary) for p in chosen],
    }
    columns = {head: cells for head, cells in columns.items() if any(cells)}
    while columns:
        heads = [_in_units(head, summary) for head in columns]
        lines = aligned([heads, *zip(*columns.values(), strict=True)])
        if max(map(len, lines)) <= 100:
            return lines
        # the zones are in the report
        columns.pop([*columns][-1])
    return []


def _half_widths(kind: str, points: Sequence[Point], summary: Summary) -> list[str]:
    """Return the cells of a column of half widths; empty ones where none is known."""
    values = [p[f"{kind}_half_width"] for p in points]
    below = [p.get(f"{kind}_half_width_estimate") or {"fitted": False} for p in points]
    if all(e["fitted"] for e in below):
        values = [e["value"] for e in below]
    if all(value is None for value in values):
        return [""] * len(points)
    return ["-" if value is None else f"{value:{length_format(summary)}}" for value in values]


def largest_shown(point: Point, form: str) -> tuple[str, str]:
    """Return the largest pressure and shear traction in words, "singular" where they have none."""
    p, *q = extremes_of(point)
    largest = max(map(abs, q))
    if point.get("p_max_singular"):
        return "singular", "singular" if largest > 0.0 else f"{largest:{form}}"
    return f"{p:{form}}", f"{largest:{form}}"


def extremes_of(point: Point) -> list[float]:
    """Return p_max, q_min and q_max of a turning point, with 0 in place of round-off."""
    values = [point[key] for key in ("p_max", "q_min", "q_max")]
    largest = max(map(abs, values))
    return [value if abs(value) > 1e-12 * largest else 0.0 for value in values]


def _in_units(name: str, summary: Summary) -> str:
    """Return the head of a column, with the scene's unit where it has one."""
    kind = "length" if name.endswith("half width") else "stress" if name[0] in "pq|" else ""
    return in_unit(name, (summary.get("units") or {}).get(kind))


def _one_half(point: Point, summary: Summary) -> bool:
    """Return whether the zones from the centre are shown alone: the others are their mirror."""
    on_axis = summary["symmetry"] == "axisymmetric" and "p_axis" in point
    return "edge" not in point and (on_axis or summary["symmetry"] == "mirror")


def zones_header(summary: Summary) -> str:
    """Return the header of the column of zones; of a symmetric contact only one half is shown."""
    if not all(_one_half(point, summary) for point in summary["turning_points"]):
        return "zones"
    if summary["symmetry"] == "axisymmetric":
        return "zones (from the axis)"
    return "zones (x > 0, from the centre)"


def zones_shown(point: Point, summary: Summary) -> str:
    """Return the zones of a turning point; of a symmetric contact those from the centre."""
    zones, form = point["zones"], length_format(summary)
    first, centre = f"{zones[0][1]:{form}} " if zones else "", -math.inf
    if _one_half(point, summary):
        axis = summary["symmetry"] == "axisymmetric"
        first, centre = "", 0.0 if axis else 0.5 * (zones[0][1] + zones[-1][2])
    return first + " | ".join(f"{name} to {end:{form}}" for name, _, end in zones if end > centre)


def length_format(summary: Summary) -> str:
    """Return the format of positions along the contact, for any unit of length."""
    zones = [zone for point in summary["turning_points"] for zone in point["zones"]]
    return _format([end for _, *ends in zones for end in ends])


def _format(values: Sequence[float]) -> str:
    """Return a format that shows about five digits of the largest value."""
    largest = max((abs(value) for value in values), default=0.0)
    if largest == 0.0 or 0.1 <= largest < 100.0:
        return "z.4f"
    places = 4 - math.floor(math.log10(largest))
    return f"z.{places}f" if 0 <= places <= 8 else "z.4e"
