"""Sections on the run: model, warnings, forces, cycles, space errors, time and versions."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.steady import RATCHETTING, limit_of_decay
from receding_fenicsx.output.plots.labels import kind_of
from receding_fenicsx.output.report.section import Rows, Summary, Told, shown
from receding_fenicsx.scene.history import history_from_scene, is_straight
from receding_fenicsx.scene.validate import scene_warnings


def model(record: Record) -> dict[str, Any]:
    """Return title, method and size; the names of the scene's units where it has some."""
    scene = record.scene
    units = {k: name for k, name in asdict(scene.units).items() if name} if scene else {}
    return {
        "title": scene.title if scene else "",
        "method": record.method,
        "nodes": len(record.x),
        "dofs": 2 * len(record.x),
        "modelled_nodes": record.modelled_nodes,
        "modelled_dofs": record.modelled_dofs,
        # the symmetry that reduced the model
        "symmetry": "axisymmetric" if record.axisymmetric else "mirror" if record.half else "none",
        **({"units": units} if units else {}),
    }


def warnings(record: Record) -> dict[str, Any]:
    """Return the warnings on the scene and on the record."""
    scene, found, ends = record.scene, [], np.array([0, -1])
    if scene is not None:
        found += scene_warnings(scene)
        first, table = scene.contacts[0], record.turning_points
        # beyond its ends a half-plane's surface cannot touch: a rounded profile that is pressed
        # further gets the singular pressures of a punch there
        touch = np.any(table.P[:, ends] > 0.0, axis=0) & (record.g0[ends] > 0.0)
        if scene.find_edge(first.edge)[0].is_half_plane and touch.any():
            places = " and ".join(f"{x:g}" for x in record.x[ends][touch])
            found.append(
                f"the contact reaches the end of the half-plane's surface at x = {places}, beyond "
                "which nothing can touch; where the profile goes on there, enlarge "
                f"{'width' if first.span is None else 'span'}"
            )
    return {"warnings": [*found, *slip_warnings(record), *loose_warnings(record)]}


def loose_warnings(record: Record) -> list[str]:
    """Return one line for each bolt that pushes: a real one would come loose."""
    return [
        f"bolt '{name}': its force falls to {min(force):.6g}, a push; it is loose there, shorten it"
        for name, force in _bolts(record).items()
        if min(force) < -1e-9 * max(force)  # less is round-off
    ]


def slip_warnings(record: Record) -> list[str]:
    """Return one line for each curved edge along which points do not stay opposite each other."""
    lines = []
    for number in np.unique(record.edge):
        on = record.edge == number
        points, table = record.points[on], record.turning_points
        if np.linalg.matrix_rank(points - points[0], 1e-6 * np.ptp(points)) < 2:
            continue
        apart = float(np.linalg.norm(np.diff(points, axis=0), axis=1).min())
        moved = float(np.abs(table.v[:, on] * (table.P[:, on] > 0.0)).max())
        # the error of a gap is the slip times the slope of the edge over half an element
        if moved > 0.5 * apart:
            lines.append(
                f"points of the curved edge '{record.edge_names[number]}' slip by up to "
                f"{moved:.3g}, {moved / apart:.2g} times the distance of its nodes, but are taken "
                "to stay opposite each other; reduce the load, or use larger elements"
            )
    return lines


def tell_warnings(summary: Summary) -> Told:
    """Tell each warning in a line."""
    found = summary.get("warnings") or []
    return Told([[text] for text in found], [f"warning: {text}" for text in found])


def _bolts(record: Record) -> dict[str, list[float]]:
    """Return each bolt's force at the turning points."""
    names = [bolt.name for bolt in record.scene.bolts] if record.scene else []
    force = record.turning_points.load_displacement
    return {name: force[:, record.load_names.index(name)].tolist() for name in names}


def forces(record: Record) -> dict[str, Any]:
    """Return the keys "bolts" and "forces": each one's force at the turning points."""
    of_displacements = {}
    for name in record.scene.driven_names if record.scene else ():
        kind = kind_of(record.scene, name, record.axisymmetric)
        if kind.symbol == "F":
            force = record.turning_points.load_displacement[:, record.load_names.index(name)]
            of_displacements[name] = (force / kind.size).tolist()
    found = {"bolts": _bolts(record), "forces": of_displacements}
    return {key: part for key, part in found.items() if part}


def tell_forces(summary: Summary) -> Told:
    """Tell smallest, largest and last force of each bolt and prescribed displacement."""
    rows = [
        [f"{what} {name}", min(force), max(force), force[-1]]
        for what, key in (("bolt", "bolts"), ("displacement", "forces"))
        for name, force in summary.get(key, {}).items()
        if force
    ]
    found = ", ".join(f"{who} {low:.4g} to {high:.4g}" for who, low, high, _ in rows)
    lines = [f"smallest and largest force: {found}"] if rows else []
    return Told([["", "smallest", "largest", "last"], *rows], lines)


def _error(found: Summary, empty: str) -> str:
    """Return an estimate in figures, or that it moves on without end."""
    if found.get("converges") is False:
        return "does not converge in order"
    return shown(found["error"], "{:.1e}", empty)


def tell_errors(summary: Summary) -> Told:
    """Tell the headline numbers with their space errors (lines: the largest), and doubts."""
    heads = {"errors_warning": "space errors", "errors_failure": "space errors are not known"}
    doubts = [[head, summary[key]] for key, head in heads.items() if key in summary]
    rows, lines = [], [f"{head}: {words}" for head, words in doubts]
    errors = summary.get("errors") or {}
    for name, found in errors.items():
        order = found.get("order")
        seen = "" if order is None else f" (observed order {order:.1f})"
        value = shown(found["value"], "{:.6g}", "singular")
        words = f"{name.replace('_', ' ')} {value}, estimated space error"
        rows.append([words, _error(found, "unknown") + seen])
    meshes = (summary.get("accuracy") or {}).get("way")
    asked = meshes[-1]["numbers"] if meshes else errors
    named = {n: n if n in asked else f"{n} (not in the tolerance)" for n in errors}
    wrong = [named[name] for name, found in errors.items() if found.get("converges") is False]
    if wrong:
        more = ", ..." * (len(wrong) > 3)
        lines.append(f"{', '.join(wrong[:3])}{more}: does not converge in order")
    known = [(e["relative"], name) for name, e in errors.items() if e.get("relative")]
    if known:
        largest = sorted(known, reverse=True)[:2]
        listed = ", ".join(f"{named[name]} {relative:.1e}" for relative, name in largest)
        lines.append(f"largest estimated relative space errors: {listed}")
    return Told([*rows, *doubts], lines)


def tell_search(summary: Summary) -> Told:
    """Tell each mesh and number of a search, then meshes without answer; how it ended."""
    rows: Rows = ["elements nodes number value estimate relative seconds".split()]
    search = summary.get("accuracy")
    if search is None:
        return Told(rows)
    for level in search["way"]:
        mesh = [str(level["elements"]), str(level["nodes"])]
        seconds = f"{level['seconds']:.2f}"
        for name, found in level["numbers"].items():
            empty = "singular" if found["converges"] is False else "-"
            value, relative = shown(found["value"], "{:.6g}", empty), found["relative"]
            both = _error(found, "-"), shown(relative, "{:.1e}")
            rows.append([*mesh, name, value, *both, seconds])
            mesh, seconds = ["", ""], ""
    rows += [[str(n), "", "no answer", why, "", "", ""] for n, why in search["failures"]]
    meshes = len(search["way"])
    kind = "graded mesh" if search.get("graded") else "mesh"
    count = len(search["way"][-1]["numbers"]) if meshes else 0
    ended = f"met by {count} number{'s' * (count != 1)}: twice each estimate is below it"
    if not search["met"]:
        ended = f"NOT met: {search['reason']}"
    spent = f"{search['seconds']:.3g} s on {meshes} {kind}{'es' * (meshes != 1)}"
    verdict = f"tolerance {search['tolerance']:g} {ended}; {spent}"
    return Told(rows, [verdict], f"{verdict}.")


def unmet(summary: Summary) -> str:
    """Return why a tolerance is not met; "" where it is, or none was asked for."""
    search = summary.get("accuracy") or {"met": True}
    if search["met"]:
        return ""
    return f"[accuracy] tolerance: {search['tolerance']:g} is not met: {search['reason']}"


def tell_costs(summary: Summary) -> Told:
    """Tell times and memory."""
    if "timings" not in summary:
        return Told([])
    times, memory = summary["timings"], f"{summary['peak_memory_MB']:.0f}"
    rows: Rows = [[f"{name}, s", f"{value:.3f}"] for name, value in times.items()]
    rows += [["peak memory, MB", memory], ["MPI ranks", summary["ranks"]]]
    drawn = f" (pictures {times['pictures']:.1f} s)" if times.get("pictures") else ""
    return Told(rows, [f"{sum(times.values()):.1f} s{drawn}, {memory} MB"])


def cycles(record: Record) -> dict[str, Any]:
    """Return dissipation and largest slip of each cycle."""
    slip = np.abs(record.cycles.slip_increment).max(axis=1, initial=0.0)
    return {
        "dissipation_first_loading": float(record.dissipation_first_loading),
        "dissipation_per_cycle": record.cycles.dissipation.tolist(),
        "dissipates": record.dissipates,
        "dissipation_round_off": record.dissipation_round_off,
        # of nodes in contact at the cycle's start and end
        "slip_per_cycle_max": slip.tolist(),
    }


def tell_cycles(summary: Summary) -> Told:
    """Tell the first 20 cycles and the last one."""
    D, slip = summary["dissipation_per_cycle"], summary["slip_per_cycle_max"]
    first = D[0] if D and summary.get("dissipates", True) else 0.0
    numbers = sorted({*range(min(20, len(D))), len(D) - 1}) if D else []
    rows = [[k + 1, D[k], D[k] / first if first else None, slip[k]] for k in numbers]
    start = f"Dissipation of the first loading: {shown(summary['dissipation_first_loading'])}."
    feigned = summary.get("dissipation_round_off", 0.0)
    if D and feigned > 1e-3 * min(D[k] for k in numbers):
        start += f" Round-off may feign up to {feigned:.0e} a cycle."
    head = ["cycle N", "dissipation D", "over cycle 1", "largest slip increment"]
    return Told([head, *rows], note=f"{start} All cycles are in summary.json.")


def ratio_words(summary: Summary) -> list[list[str]]:
    """Return what the ratio of the last to the first dissipation is, with the ratio, if any."""
    D = summary["dissipation_per_cycle"]
    if not D or not D[0] or not summary.get("dissipates", True):
        return []
    return [[f"dissipation of cycle {len(D)} over cycle 1", f"{D[-1] / D[0]:.5f}"]]


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
    summary, scene, doubling = {"steady": found}, record.scene, record.doubling
    if scene is not None and scene.history.kind == "harmonic":
        # the polygon that stands for a harmonic history
        polygon: dict[str, Any] = {"corners": len(history_from_scene(scene).loop) - 1}
        if doubling is None or is_straight(scene.history):
            polygon["error_estimate"] = 0.0 if is_straight(scene.history) else None
        else:
            tolerance = scene.history.tolerance or 1e-3
            polygon |= {"error_estimate": float(doubling[-1, 1]), "tolerance": tolerance}
            polygon["doubling"] = [[int(n), float(e)] for n, e in doubling]
        summary["harmonic"] = polygon
    return summary | limit_summary(record)


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
    if (starts := limit.get("starts")) is not None:
        words = ", ".join(f"{count} {kind}" for kind, count in starts["kinds"].items())
        if starts["dissipation"] is not None:
            low, high = starts["dissipation"]
            spread = "" if starts["spread"] is None else f" (spread {starts['spread']:.2g})"
            words += f"; dissipation per cycle {low:.6g} to {high:.6g}{spread}"
        if len(starts["zones"]) > 1:
            nodes = f"{starts['nodes_that_differ']} of {starts['nodes']} nodes"
            words += f"; {len(starts['zones'])} arrangements of zones, which differ at {nodes}"
        differ = {True: " do not differ", False: " differ", None: ", some failed"}[starts["same"]]
        rows.append([f"limits from {starts['count']} initial slips{differ}", words])
    return rows


def tell_steady(summary: Summary) -> Told:
    """Tell the steady state with the ratio of dissipations, the limit, a harmonic's polygon."""
    D, steady, first = summary["dissipation_per_cycle"], summary["steady"], []
    if D:
        start = f", from cycle {steady['cycle']}, period {steady['period']}"
        first = [["steady state", steady["kind"] + start * steady["reached"]]]
        first += ratio_words(summary)
        if steady.get("dissipation_limit"):
            law = f"{steady['trend']} law, {steady['trend_value']:.3g}"
            first.append(["extrapolated", f"{steady['dissipation_limit'] / D[0]:.4f} ({law})"])
    rest, polygon = limit_rows(summary), summary.get("harmonic")
    if polygon is not None:
        error, ended = polygon["error_estimate"], "tolerance" in polygon
        if error is not None and np.isfinite(error):
            words = f"{error:.1e}" if error else "none, a straight line"
        else:
            words = "unknown, the history ended early" if ended else "not estimated, fixed corners"
        head = f"harmonic history, polygon of {polygon['corners']} corners"
        rest.append([head, f"error of the dissipation per cycle {words}"])
    # the law of an extrapolation, and how a limit was found, are in the report alone
    lines = ["; ".join(f"{head}: {words}".partition(" (")[0] for head, words in first)]
    for head, words in rest:
        if head != "reason":
            lines.append(f"{head}: {words.partition(', found by a')[0]}")
    return Told([*first, *rest], lines)
