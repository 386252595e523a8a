"""Sections on the contact: turning points, checks (residual, uniqueness, corners), fatigue."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
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
from receding_fenicsx.output.report.section import Rows, Summary, Told, shown
from receding_fenicsx.scene.options import in_unit


def turning_points(record: Record) -> dict[str, Any]:
    """Return the turning points in order; with several contact edges one for each edge."""
    edges, cycle, points = record.by_edge(), record.turning_points.cycle, []
    betas = {name: ends.contact_betas(part) for name, part in edges.items()}
    for i, (name, part) in product(range(len(cycle)), edges.items()):
        table, x = part.turning_points, part.x
        found = zones(x, table.state[i], part.begins_on_axis, part.friction.present)
        point: dict[str, Any] = {
            **({"edge": name} if len(edges) > 1 else {}),
            "cycle": int(cycle[i]),
            "leg": int(table.leg[i]),
            "load": dict(zip(record.load_names, table.load[i].tolist(), strict=True)),
            "zones": [[zone, float(a), float(b)] for zone, a, b in found],
            **({"p_axis": float(on_axis(x, table.p[i]))} if part.begins_on_axis else {}),
            **ends.half_widths(part, i),
            "p_max": float(table.p[i].max()),
            "q_min": float(table.q[i].min()),
            "q_max": float(table.q[i].max()),
        }
        # ends of zones are fitted in the first and the last cycles, if these have few legs: a fit
        # takes longer than a cycle
        early = cycle[i] <= 20 or cycle[i] == cycle[-1]
        if early and np.count_nonzero(cycle == cycle[i]) <= 32:
            point |= ends.half_width_estimates(part, i, betas[name])
            point["zone_ends"] = ends.estimated_ends(part, i, betas[name])
            point |= ends.corners_of(part, i)
        points.append(point)
    return {"turning_points": points}


def headline_points(summary: Summary) -> list[Summary]:
    """Return the turning points of cycles 0, 1 and the last.

    In a cycle of more than 12 legs those at extreme load factors, and the end of the cycle.
    """
    points = summary["turning_points"]
    found = []
    for cycle in sorted({0, 1, *(p["cycle"] for p in points[-1:])}):
        rows = [p for p in points if p["cycle"] == cycle]
        legs = {p["leg"]: p["load"] for p in rows}
        kept = {*legs}
        if len(legs) > 12:
            factors = [[load[name] for load in legs.values()] for name in rows[0]["load"]]
            ends = [(v.index(min(v)), v.index(max(v))) for v in factors if min(v) < max(v)]
            kept = {list(legs)[k] for pair in ends for k in pair} | {max(legs)}
        found += [p for p in rows if p["leg"] in kept]
    return found


def _loads(point: Summary, form: str, between: str) -> str:
    """Return the load factors, of more than ``MOST_TOLD`` those that are not zero."""
    load: dict[str, float] = point["load"]
    told = {name: value for name, value in load.items() if value or len(load) <= MOST_TOLD}
    return between.join(form.format(name, value) for name, value in told.items())


def tell_points(summary: Summary) -> Told:
    """Tell the turning points of the table."""
    form, points = length_format(summary), headline_points(summary)
    edges = any("edge" in p for p in points)
    head = ["cycle", "load", "contact half width", "fitted", "stick half width", "fitted"]
    head = [*["edge"] * edges, *head, "p max", "q min", "q max"]
    rows: Rows = [[*(_in_units(name, summary) for name in head), zones_header(summary)]]
    for p in points:
        widths: list[float | str | None] = []
        for kind in ("contact", "stick"):
            fitted, words = p.get(f"{kind}_half_width_estimate"), None
            if fitted is not None and fitted["fitted"]:
                low, high = fitted["interval"]
                words = f"{fitted['value']:{form}} ({low:{form}} to {high:{form}})"
            widths += [p[f"{kind}_half_width"], words]
        singular = p.get("p_max_singular", False)
        values = ["singular" if singular and value else value for value in extremes_of(p)]
        start = [*[p.get("edge")] * edges, p["cycle"], _loads(p, "{} = {:z.6g}", ", ")]
        rows.append([*start, *widths, *values, zones_shown(p, summary)])
    return Told(rows)


def console_table(summary: Summary, most: int) -> list[str]:
    """Return a table of at most so many turning points: of the last cycle, then of cycles 0 and 1.

    Half widths are the fitted ones where all are; columns that do not fit are left out.
    """
    points = headline_points(summary)
    rank = {1: 2, 0: 1} | {p["cycle"]: 0 for p in points[-1:]}
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
    widths = []
    for kind in ("contact", "stick"):
        known = [p[f"{kind}_half_width"] for p in chosen]
        below = [p.get(f"{kind}_half_width_estimate") or {"fitted": False} for p in chosen]
        if all(e["fitted"] for e in below):
            known = [e["value"] for e in below]
        widths.append([shown(value, f"{{:{length_format(summary)}}}") for value in known])
    columns = {
        "edge": [p.get("edge", "") for p in chosen],
        "cycle": [str(p["cycle"]) for p in chosen],
        "load": [_loads(p, "{}={:z.4g}", " ") for p in chosen],
        "contact half width": widths[0],
        "stick half width": widths[1],
        "p_max": [p for p, _ in largest],
        "|q|_max": [q for _, q in largest],
        zones_header(summary): [zones_shown(p, summary) for p in chosen],
    }
    columns = {head: cells for head, cells in columns.items() if {*cells} - {"", "-"}}
    while columns:
        heads = [_in_units(head, summary) for head in columns]
        lines = aligned([heads, *zip(*columns.values(), strict=True)])
        if max(map(len, lines)) <= 100:
            return lines
        # the zones are in the report
        columns.pop([*columns][-1])
    return []


def extremes_of(point: Summary) -> list[float]:
    """Return p_max, q_min and q_max of a turning point, with 0 in place of round-off."""
    values = [point[key] for key in ("p_max", "q_min", "q_max")]
    largest = max(map(abs, values))
    return [value if abs(value) > 1e-12 * largest else 0.0 for value in values]


def _in_units(name: str, summary: Summary) -> str:
    """Return the head of a column, with the scene's unit where it has one."""
    kind = "length" if name.endswith("half width") else "stress" if name[0] in "pq|" else ""
    return in_unit(name, (summary.get("units") or {}).get(kind))


def _one_half(point: Summary, symmetry: str) -> bool:
    """Return whether the zones from the centre are shown alone: the others are their mirror."""
    on_axis = symmetry == "axisymmetric" and "p_axis" in point
    return "edge" not in point and (on_axis or symmetry == "mirror")


def zones_header(summary: Summary) -> str:
    """Return the header of the column of zones; of a symmetric contact only one half is shown."""
    symmetry = summary["symmetry"]
    if not all(_one_half(point, symmetry) for point in summary["turning_points"]):
        return "zones"
    return f"zones ({'from the axis' if symmetry == 'axisymmetric' else 'x > 0, from the centre'})"


def zones_shown(point: Summary, summary: Summary) -> str:
    """Return the zones of a turning point; of a symmetric contact those from the centre."""
    zones, form = point["zones"], length_format(summary)
    first, centre = f"{zones[0][1]:{form}} " if zones else "", -math.inf
    if _one_half(point, summary["symmetry"]):
        first, centre = "", 0.0
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
    summary: dict[str, Any] = {"limit_without_slip": ranges}
    if (found := record.uniqueness) is not None:
        place = {"cycle": int(found.cycle), "leg": int(found.leg), "s": float(found.s)}
        static = {"solutions": int(found.first_loading), "proved": bool(found.first_loading_proved)}
        summary["uniqueness"] = {
            "certified": bool(found.certified),
            "margin": float(found.margin),  # null in the file where it is not finite
            "solutions": int(found.solutions),
            "where": {**place, "nodes": found.nodes.tolist()} if found.cycle >= 0 else None,
            "first_loading": static if found.first_loading else None,
            "symmetric_paths_only": bool(record.half),
        }
    if record.choices:
        rule = record.scene.solver.branch if record.scene else "first"
        summary["branch"] = {"rule": rule, "choices": [asdict(c) for c in record.choices]}
    return {
        **summary,
        "residual_max": float(record.residual_max),
        "energy_error_max": float(record.energy_error_max),
        "events": int(record.n_events),
        "jumps": {"count": int(record.jumps), "energy_released": float(record.released)},
        "sweeps": int(record.sweeps),
    }


def uniqueness_rows(summary: Summary) -> Rows:
    """Return what a run says of uniqueness, a head and words for each fact; nothing without it."""
    found = summary.get("uniqueness")
    if found is None:
        return []

    def solutions(count: int) -> str:
        return f"{count} solution{'s' * (count != 1)} found"

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
        rows.append(["first doubt", f"{words}{solutions(found['solutions'])} at one instant"])
    if margin is not None and np.isfinite(margin):
        where = "elsewhere the " if margin > 1.0 and not found["certified"] else ""
        words = f"{where}proof holds up to {margin:.3g} times the friction"
        if margin > LARGE_MARGIN:
            words += f" at the ends of legs, up to {LARGE_MARGIN:g} between them"
        rows.append(["friction margin", words])
    if static is not None:
        rest = "proved to be all" if static["proved"] else "others not excluded"
        rows.append(["first loading", f"{solutions(static['solutions'])}, {rest}"])
    return rows


def tell_checks(summary: Summary) -> Told:
    """Tell residual, energy, steps, jumps, uniqueness, corners, and where the limit is reached."""
    paths, jumps = uniqueness_rows(summary), summary.get("jumps") or {"count": 0}
    if jumps["count"]:
        words = f"{jumps['count']}, energy released {jumps['energy_released']:.4g}"
        paths.insert(0, ["jumps without a quasi-static path", words])
    found = [(p.get("edge", ""), c) for p in headline_points(summary) for c in p.get("corners", [])]
    corners = [(" on ".join([f"{c['x']:z.4g}", *[edge] * bool(edge)]), c) for edge, c in found]
    rows = [
        [
            "largest residual of contact and friction conditions, over the largest nodal force",
            f"{summary['residual_max']:.2e}",
        ],
        ["largest relative error of a leg's energy balance", f"{summary['energy_error_max']:.2e}"],
        *([k, str(summary[k])] for k in ("events", "sweeps")),
        *paths,
    ]
    # each different corner and state
    for (place, state), corner in {(at, c["state"]): c for at, c in corners}.items():
        exact, fitted = (shown(corner[k], "{:z.4f}") for k in ("exponent", "fitted"))
        known = "no closed form here"
        if exact != "-":
            known = f"closed form, {corner['angle']:g} degrees"
        words = f"stresses like d^m, m = {exact} ({known}), fitted {fitted}"
        rows.append([f"corner at {place}, {state}", words + "; singular" * is_singular(corner)])
    ranges = ", ".join(
        " on ".join([f"{a:z.4g} to {b:z.4g}", *edge])
        for a, b, *edge in summary.get("limit_without_slip") or []
    )
    if ranges:
        rows.append(["friction limit reached without slip in the last cycle, x from", ranges])
    lines = []
    for head, words in paths:
        # how far the proof goes, and the first loading, are in the report
        if head not in ("friction margin", "first loading"):
            first, symmetric, _ = words.partition(", among mirror-symmetric paths")
            head = head.replace("only path", "only symmetric path") if symmetric else head
            lines.append(f"{head}: {first}")
    if singular := sorted({(c["x"], at) for at, c in corners if is_singular(c)}):
        words = ", ".join(at for _, at in singular)
        lines.append(f"infinite stresses at corners in contact: x = {words}")
    counted = "events" if summary["method"] == "events" else "sweeps"
    residual = f"largest residual {summary['residual_max']:.1e}, {counted} {summary[counted]}"
    return Told(rows, [*lines, residual])


CRITERIA = {
    "swt": "Smith, Watson and Topper",
    "fatemi_socie": "Fatemi and Socie",
    "dang_van": "Dang Van",
    "crossland": "Crossland",
    "ruiz_f1": "Ruiz F1",
    "ruiz_f2": "Ruiz F2",
}


def tell_fatigue(summary: Summary) -> Told:
    """Tell the largest of each parameter, and which ones the mesh decides by more than a tenth."""
    found, lines = summary.get("fatigue", {}).get("parameters", {}), []
    columns = "max", "x", "y", "probe", "angle", "estimate", "averaged", "life"
    rows = [[CRITERIA[k], *map(row.get, columns)] for k, row in found.items()]
    coarse = [k for k, row in found.items() if (row["estimate"] or 0.0) > 0.1 * abs(row["max"])]
    large = ", ".join(CRITERIA[name] for name in coarse)
    note = large and (
        f"The mesh decides {large} by more than 10%: refine the ends of the contact; at a singular "
        "corner take the mean over a length, [fatigue] average."
    )
    if row := found.get("swt"):
        life = "" if row["life"] is None else f", {row['life']:.3g} cycles"
        error = "" if row["estimate"] is None else f" +- {row['estimate']:.1g}"
        place = f"x = {row['x']:.4g} of probe '{row['probe']}', plane at {row['angle']:.0f} degrees"
        lines = [f"fatigue: Smith, Watson and Topper {row['max']:.4g}{error} at {place}{life}"]
    return Told([["parameter", *columns], *rows], lines, note)
