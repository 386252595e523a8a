"""Sections on the run itself: model, warnings, time, memory and versions."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.forces import loose_warnings
from receding_fenicsx.output.report.section import Section, Summary
from receding_fenicsx.scene.validate import scene_warnings

METHODS = {"events": "exact path (events)", "gauss-seidel": "Gauss-Seidel in load steps"}


def _summary(record: Record) -> dict[str, Any]:
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


def model_line(summary: Summary) -> str:
    """Return size of the model, method and number of cycles."""
    spared = {"mirror": ", half of the body modelled", "axisymmetric": ", axisymmetric"}
    return (
        f"{summary['nodes']} contact nodes ({summary['modelled_nodes']} modelled"
        f"{spared.get(summary['symmetry'], '')}), "
        f"{METHODS.get(summary['method'], summary['method'])}, "
        f"{len(summary['dissipation_per_cycle'])} cycles after first loading"
    )


def _title_line(summary: Summary) -> list[str]:
    return [
        f"{summary['title'] or 'untitled'}: {summary['nodes']} contact nodes, "
        f"{summary['modelled_nodes']} modelled, method {summary['method']}"
    ]


def cut_off_warnings(record: Record) -> list[str]:
    """Return one line where pressure reaches an end of a half-plane's surface with an initial gap.

    Beyond its ends the surface cannot touch: a rounded profile that is pressed further than that
    gets the singular pressures of a punch there. Without an initial gap the end is that of a punch.
    """
    scene = record.scene
    if scene is None or not scene.find_edge(scene.contacts[0].edge)[0].is_half_plane:
        return []
    ends = [0, -1]
    touch = np.any(record.turning_points.P[:, ends] > 0.0, axis=0) & (record.g0[ends] > 0.0)
    places = " and ".join(f"{record.x[end]:g}" for end in np.array(ends)[touch])
    if not places:
        return []
    keys = "width" if scene.contacts[0].span is None else "span"
    return [
        f"the contact reaches the end of the half-plane's surface at x = {places}, beyond which "
        f"nothing can touch; where the profile goes on there, enlarge {keys}"
    ]


def _warnings(record: Record) -> dict[str, Any]:
    scene = scene_warnings(record.scene) if record.scene else []
    return {"warnings": [*scene, *cut_off_warnings(record), *loose_warnings(record)]}


def _cost_rows(summary: Summary) -> list[list[Any]]:
    if "timings" not in summary:
        return []
    rows = [[f"{name}, s", f"{value:.3f}"] for name, value in summary["timings"].items()]
    rows.append(["peak memory, MB", f"{summary['peak_memory_MB']:.0f}"])
    return [*rows, ["MPI ranks", summary["ranks"]]]


def _cost_line(summary: Summary) -> list[str]:
    if "timings" not in summary:
        return []
    times = summary["timings"]
    drawn = f" (pictures {times['pictures']:.1f} s)" if times.get("pictures") else ""
    return [f"{sum(times.values()):.1f} s{drawn}, {summary['peak_memory_MB']:.0f} MB"]


MODEL = Section("", summary=_summary, lines=_title_line)
WARNINGS = Section(
    "Warnings",
    summary=_warnings,
    rows=lambda summary: [[text] for text in summary.get("warnings") or []],
    lines=lambda summary: [f"warning: {text}" for text in summary.get("warnings") or []],
)
COSTS = Section("Time and memory", rows=_cost_rows, lines=_cost_line)
VERSIONS = Section("Versions", rows=lambda summary: list(summary.get("versions", {}).items()))
