"""Section on forces of bolts and of prescribed displacements."""

from __future__ import annotations

from typing import Any

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots.labels import kind_of
from receding_fenicsx.output.report.section import Section, Summary

KINDS = (("bolt", "bolts"), ("displacement", "forces"))
"""What carries a force, and its key of the summary."""


def _bolts(record: Record) -> dict[str, list[float]]:
    """Return each bolt's force at the turning points."""
    names = [bolt.name for bolt in record.scene.bolts] if record.scene else []
    force = record.turning_points.load_displacement
    return {name: force[:, record.load_names.index(name)].tolist() for name in names}


def _summary(record: Record) -> dict[str, Any]:
    """Return the keys "bolts" and "forces": each one's force at the turning points.

    The force of a prescribed displacement is the component along it: the work-conjugate load
    displacement over the size of the displacement at factor 1. A displacement that is no single
    number has none.
    """
    loads = record.scene.loads if record.scene else ()
    kinds = {load.name: kind_of(record.scene, load.name, record.axisymmetric) for load in loads}
    conjugate = record.turning_points.load_displacement
    forces = {
        name: (conjugate[:, record.load_names.index(name)] / kind.size).tolist()
        for name, kind in kinds.items()
        if kind.symbol == "F"
    }
    return {key: part for key, part in (("bolts", _bolts(record)), ("forces", forces)) if part}


def loose_warnings(record: Record) -> list[str]:
    """Return one line for each bolt that pushes: a real one would come loose."""
    return [
        f"bolt '{name}': its force falls to {min(force):.6g}, a push; it is loose there, shorten it"
        for name, force in _bolts(record).items()
        if min(force) < -1e-9 * max(force)  # less is round-off
    ]


def _rows(summary: Summary) -> list[list[Any]]:
    return [
        [f"{what} {name}", min(force), max(force), force[-1]]
        for what, key in KINDS
        for name, force in summary.get(key, {}).items()
        if force
    ]


def _lines(summary: Summary) -> list[str]:
    found = [f"{who} {low:.4g} to {high:.4g}" for who, low, high, _ in _rows(summary)]
    return [f"smallest and largest force: {', '.join(found)}"] if found else []


FORCES = Section(
    "Forces",
    summary=_summary,
    rows=_rows,
    head=lambda _: ["", "smallest", "largest", "last"],
    lines=_lines,
    form="{:z.6g}",
)
