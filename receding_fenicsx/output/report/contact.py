"""Sections on the contact: turning points, checks (residual, uniqueness, corners), fatigue."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.arrays import aligned
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.zones import on_axis, zones
from receding_fenicsx.interface.uniqueness.watch import LARGE_MARGIN
from receding_fenicsx.measures import ends
from receding_fenicsx.measures.ends import is_singular
from receding_fenicsx.measures.limit_nodes import limit_nodes
from receding_fenicsx.output.plots.labels import MOST_TOLD
from receding_fenicsx.output.report.section import Rows, Summary, shown
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
    found = zones(x, table.state[i], record.begins_on_axis, record.friction.present)
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
    largest = []
    for point in chosen:
        p_max, *q = extremes_of(point)
        singular = point.get("p_max_singular", False)
        values = p_max, max(map(abs, q))
        largest.append(["singular" if singular and v else f"{v:{traction}}" for v in values])
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


def extremes_of(point: Point) -> list[float]:
    """Return p_max, q_min and q_max of a turning point, with 0 in place of round-off."""
    values = [point[key] for key in ("p_max", "q_min", "q_max")]
    largest = max(map(abs, values))
    return [value if abs(value) > 1e-12 * largest else 0.0 for value in values]


def _in_units(name: str, summary: Summary) -> str:
    """Return the head of a column, with the scene's unit where it has one."""
    kind = "length" if name.endswith("half width") else "stress" if name[0] in "pq|" else ""
    return in_unit(name, (summary.get("units") or {}).get(kind))


def _one_half(point: Point, symmetry: str) -> bool:
    """Return whether the zones from the centre are shown alone: the others are their mirror."""
    on_axis = symmetry == "axisymmetric" and "p_axis" in point
    return "edge" not in point and (on_axis or symmetry == "mirror")


def zones_header(summary: Summary) -> str:
    """Return the header of the column of zones; of a symmetric contact only one half is shown."""
    symmetry = summary["symmetry"]
    if not all(_one_half(point, symmetry) for point in summary["turning_points"]):
        return "zones"
    return f"zones ({'from the axis' if symmetry == 'axisymmetric' else 'x > 0, from the centre'})"


def zones_shown(point: Point, summary: Summary) -> str:
    """Return the zones of a turning point; of a symmetric contact those from the centre."""
    zones, form, symmetry = point["zones"], length_format(summary), summary["symmetry"]
    first, centre = f"{zones[0][1]:{form}} " if zones else "", -math.inf
    if _one_half(point, symmetry):
        axis = symmetry == "axisymmetric"
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


# -- checks ----------------------------------------------------------------------------------------


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
