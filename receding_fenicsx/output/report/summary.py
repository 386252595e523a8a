"""Summary of a record: the contents of ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.axis import on_axis
from receding_fenicsx.interface.measures.steady import limit_of_decay
from receding_fenicsx.interface.measures.zones import contact_zones
from receding_fenicsx.measures.corner_exponents import corners_of
from receding_fenicsx.measures.half_widths import (
    contact_betas,
    estimated_ends,
    half_width_estimates,
    half_widths,
)
from receding_fenicsx.measures.limit_nodes import limit_nodes
from receding_fenicsx.output.report.bolts import bolt_summary, force_summary, loose_warnings
from receding_fenicsx.output.report.limit import limit_summary
from receding_fenicsx.output.report.surface_ends import cut_off_warnings
from receding_fenicsx.output.report.uniqueness import uniqueness_summary
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.scene.history.harmonic import DEFAULT_TOLERANCE, is_straight
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.validate import scene_warnings

FITTED_LEGS = 32
"""Largest number of legs of a cycle at whose turning points ends of zones are fitted."""

TREND_CYCLES = 8
"""Smallest number of cycles for a fitted trend of the dissipation."""

FITTED_CYCLES = 20
"""Number of first cycles at whose turning points ends of zones are fitted, as in the last cycle. A
fit takes longer than a cycle."""


def summarise(record: Record, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the summary of a record; lengths and tractions are in the scene's units.

    Args:
        record: the record.
        extra: further keys, such as timings and versions; they replace keys of the record.

    Returns:
        Numbers, strings, lists and dictionaries.
    """
    scene = record.scene
    steady = record.steady
    return {
        "title": scene.title if scene else "",
        "method": record.method,
        "nodes": len(record.x),
        "dofs": 2 * len(record.x),
        "modelled_nodes": record.modelled_nodes,
        "modelled_dofs": record.modelled_dofs,
        "symmetry": _symmetry(record),
        "turning_points": _turning_points(record),
        "dissipation_first_loading": float(record.dissipation_first_loading),
        "dissipation_per_cycle": record.cycles.dissipation.tolist(),
        "dissipates": record.dissipates,
        "slip_per_cycle_max": slip_per_cycle_max(record),
        "steady": {
            "reached": bool(steady.reached),
            "cycle": int(steady.cycle),
            "kind": steady.kind,
            "period": int(steady.period),
            **_trend(record),
        },
        "limit_without_slip": _limit_ranges(record),
        **_polygon(record),
        **bolt_summary(record),
        **force_summary(record),
        **limit_summary(record),
        **uniqueness_summary(record),
        **_branch(record),
        "residual_max": float(record.residual_max),
        "energy_error_max": float(record.energy_error_max),
        "events": int(record.n_events),
        "jumps": {"count": int(record.jumps), "energy_released": float(record.released)},
        "sweeps": int(record.sweeps),
        "warnings": [
            *(scene_warnings(scene) if scene else []),
            *cut_off_warnings(record),
            *loose_warnings(record),
        ],
        **_units(scene),
        **(extra or {}),
    }


def _branch(record: Record) -> dict[str, Any]:
    """Return the rule and the choices made by it among continuations; nothing without any."""
    if not record.choices:
        return {}
    rule = record.scene.solver.branch if record.scene else "first"
    return {"branch": {"rule": rule, "choices": [asdict(choice) for choice in record.choices]}}


def _units(scene: Scene | None) -> dict[str, Any]:
    """Return the names of the scene's units, as far as it has some."""
    given = asdict(scene.units) if scene else {}
    found = {key: name for key, name in given.items() if name is not None}
    return {"units": found} if found else {}


def _turning_points(record: Record) -> list[dict[str, Any]]:
    """Return the turning points in order; with several contact edges one row for each edge."""
    edges = record.by_edge()
    rows = range(len(record.turning_points.s))
    if len(edges) == 1:
        betas = contact_betas(record)
        return [_turning_point(record, i, betas) for i in rows]
    parts = [(name, part, contact_betas(part)) for name, part in edges.items()]
    return [
        {"edge": name, **_turning_point(part, i, betas)}
        for i in rows
        for name, part, betas in parts
    ]


def _polygon(record: Record) -> dict[str, Any]:
    """Return the polygon that stands for a harmonic history, and its error estimate."""
    scene, doubling = record.scene, record.doubling
    if scene is None or scene.history.kind != "harmonic":
        return {}
    found: dict[str, Any] = {"corners": len(history_from_scene(scene).loop) - 1}
    if is_straight(scene.history):
        return {"harmonic": {**found, "error_estimate": 0.0}}
    if doubling is None:
        return {"harmonic": {**found, "error_estimate": None}}
    tolerance = scene.history.tolerance or DEFAULT_TOLERANCE
    found |= {"error_estimate": float(doubling[-1, 1]), "tolerance": tolerance}
    return {"harmonic": {**found, "doubling": [[int(n), float(e)] for n, e in doubling]}}


def _symmetry(record: Record) -> str:
    """Return the symmetry that reduced the model: "mirror", "axisymmetric" or "none"."""
    if record.axisymmetric:
        return "axisymmetric"
    return "mirror" if record.half else "none"


def _trend(record: Record) -> dict[str, Any]:
    """Return trend and extrapolated limit of the dissipation if no steady state was reached."""
    D = record.cycles.dissipation
    if record.steady.reached or len(D) < TREND_CYCLES or not record.dissipates:
        return {}
    law, value, limit = limit_of_decay(D)
    return {"trend": law, "trend_value": value, "dissipation_limit": limit}


def _limit_ranges(record: Record) -> list[list[Any]]:
    """Return ranges of x that reach the friction limit without slip in the last cycle.

    With several contact edges the name of the edge follows each range.
    """
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


def slip_per_cycle_max(record: Record) -> list[float]:
    """Return the largest slip increment of each cycle, of nodes in contact at its start and end."""
    return np.abs(record.cycles.slip_increment).max(axis=1, initial=0.0).tolist()


def _turning_point(record: Record, i: int, betas: tuple[float, ...]) -> dict[str, Any]:
    table = record.turning_points
    x, state = record.x, table.state[i]
    found = contact_zones(x, state, record.friction.mean, record.begins_on_axis)
    return {
        "cycle": int(table.cycle[i]),
        "leg": int(table.leg[i]),
        "load": dict(zip(record.load_names, table.load[i].tolist(), strict=True)),
        "zones": [list(zone) for zone in found],
        **({"p_axis": float(on_axis(x, table.p[i]))} if record.begins_on_axis else {}),
        **half_widths(record, i),
        "p_max": float(table.p[i].max()),
        "q_min": float(table.q[i].min()),
        "q_max": float(table.q[i].max()),
        **(_below_spacing(record, i, betas) if _is_fitted(record, i) else {}),
    }


def _is_fitted(record: Record, i: int) -> bool:
    """Return whether the ends of zones are fitted at a turning point."""
    cycle = record.turning_points.cycle
    if np.count_nonzero(cycle == cycle[i]) > FITTED_LEGS:
        return False
    return bool(cycle[i] <= FITTED_CYCLES or cycle[i] == cycle[-1])


def _below_spacing(record: Record, i: int, betas: tuple[float, ...]) -> dict[str, Any]:
    return {
        **half_width_estimates(record, i, betas),
        "zone_ends": estimated_ends(record, i, betas),
        **corners_of(record, i),
    }
