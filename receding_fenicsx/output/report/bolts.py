"""Forces of bolts and of prescribed displacements in the summary and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots.load_kinds import kind_of

ROUND_OFF = 1e-9
"""Push of a bolt, over its largest force, that is none."""


def bolt_summary(record: Record) -> dict[str, Any]:
    """Return the key "bolts": each bolt's force at the turning points; nothing without bolts."""
    names = [bolt.name for bolt in record.scene.bolts] if record.scene else []
    force = record.turning_points.load_displacement
    found = {name: force[:, record.load_names.index(name)].tolist() for name in names}
    return {"bolts": found} if found else {}


def force_summary(record: Record) -> dict[str, Any]:
    """Return the key "forces": the force of each prescribed displacement at the turning points.

    It is the component along the displacement: the work-conjugate load displacement over the size
    of the displacement at factor 1. A displacement that is no single number has none.
    """
    kinds = {
        name: kind_of(record.scene, name, record.axisymmetric)
        for name in {load.name: None for load in (record.scene.loads if record.scene else ())}
    }
    found = {
        name: (
            record.turning_points.load_displacement[:, record.load_names.index(name)] / kind.size
        ).tolist()
        for name, kind in kinds.items()
        if kind.symbol == "F"
    }
    return {"forces": found} if found else {}


def loose_warnings(record: Record) -> list[str]:
    """Return one line for each bolt that pushes: a real one would come loose."""
    return [
        f"bolt '{name}': its force falls to {min(force):.6g}, a push; it is loose there, shorten it"
        for name, force in bolt_summary(record).get("bolts", {}).items()
        if min(force) < -ROUND_OFF * max(force)
    ]


def force_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return a line for each bolt and each prescribed displacement, for the console."""
    return [
        f"{what} {name}: force {min(force):.6g} to {max(force):.6g}, last {force[-1]:.6g}"
        for what, key in (("bolt", "bolts"), ("displacement", "forces"))
        for name, force in summary.get(key, {}).items()
        if force
    ]
