"""Files of a shakedown study: JSON, profile of the safe slip, diagram."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.environment import versions
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.output.plots.style import save
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import to_toml
from receding_fenicsx.store.summary_file import write_summary
from receding_fenicsx.store.workspace import FolderKind
from receding_fenicsx.studies.shakedown.figures import diagram_figure
from receding_fenicsx.studies.shakedown.opening import BELOW
from receding_fenicsx.studies.shakedown.result import FOUND_BY, ShakedownStudy

SUMMARY, SLIP, PICTURE, SCENE = "shakedown.json", "safe_slip.csv", "shakedown.png", "scene.toml"
"""Names of the files."""
STUDY = FolderKind("shakedown study", (SUMMARY,), resumable=False)


def write(path: Path, scene: Scene, result: ShakedownStudy, seconds: Mapping[str, float]) -> None:
    """Write a study beside its folder and rename it; several edges have no profile of safe slip."""
    system = result.system
    with STUDY.new(path, overwrite=True) as beside:
        write_summary(beside / SUMMARY, _summary(scene, result) | {"timings": dict(seconds)})
        (beside / SCENE).write_text(to_toml(scene), encoding="utf-8")
        if len(np.unique(system.edges)) == 1:
            columns = np.column_stack([mirror_of(system).odd(system.x), result.limits.safe_slip])
            np.savetxt(beside / SLIP, columns, "%.17g", ",", header="x,value", comments="")
        save(diagram_figure(result.diagram, result.opening), beside / PICTURE)


def _summary(scene: Scene, result: ShakedownStudy) -> dict[str, Any]:
    """Return the content of ``shakedown.json``, but for the timings."""
    limits, options, diagram = result.limits, scene.shakedown, result.diagram
    return {
        "title": scene.title,
        "mean": options.mean,
        "range": list(options.range),
        "modelled_nodes": result.system.n,
        "symmetry": "half" if result.system.half else "none",
        "lower": limits.lower,
        "lower_is": limits.lower_is,
        "upper": limits.upper,
        "opens": limits.opens,
        "active": [vars(active) for active in limits.active],
        "largest_slip": options.largest_slip,
        "separated": result.system.x[limits.separated].tolist(),
        "safe_slip": limits.safe_slip.tolist(),
        "residual": limits.residual,
        "gap": limits.gap,
        "meshes": [dict(zip(("nodes", "lower", "upper"), m, strict=True)) for m in result.meshes],
        "by_cycles": result.by_cycles,
        "opening": _opening(result),
        "diagram": {
            "load": diagram.load,
            "mean": diagram.mean.tolist(),
            "lower": diagram.lower.tolist(),
            "upper": diagram.upper.tolist(),
        },
        "notes": list(result.notes),
        "versions": versions(),
    }


def _opening(result: ShakedownStudy) -> dict[str, Any] | None:
    """Return the largest range with opening nodes, and the whole contact's slip for it."""
    found = result.opening
    if found is None:
        return None
    return {
        **{key: value for key, value in vars(found).items() if key not in ("slip", "closed")},
        "found": FOUND_BY,
        "verified_at": BELOW * found.value,
        "opening_nodes": np.flatnonzero(~found.closed.all(axis=0)).tolist(),
        "slip": mirror_of(result.system).odd(found.slip).tolist(),
    }
