"""Section on fatigue parameters: the worst point of each."""

from __future__ import annotations

from typing import Any

import numpy as np

from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.report.section import Section, Summary

NAMES = {
    "swt": "Smith, Watson and Topper",
    "fatemi_socie": "Fatemi and Socie",
    "dang_van": "Dang Van",
    "crossland": "Crossland",
    "ruiz_f1": "Ruiz F1",
    "ruiz_f2": "Ruiz F2",
}
COLUMNS = ("max", "x", "y", "probe", "angle", "estimate", "averaged", "life")
SINGULAR = 0.1
"""Estimated error over the parameter from which a mean over a length is recommended."""


def _parameters(summary: Summary) -> dict[str, Any]:
    return dict(summary.get("fatigue", {}).get("parameters", {}))


def _note(summary: Summary) -> str:
    """Return what the mesh decides."""
    found = _parameters(summary)
    large = [
        NAMES[name]
        for name, row in found.items()
        if row["estimate"] is not None and row["estimate"] > SINGULAR * abs(row["max"])
    ]
    if not large:
        return ""
    return (
        f"The mesh decides {', '.join(large)} by more than {SINGULAR:.0%}: refine the ends of the "
        "contact; at a singular corner take the mean over a length, [fatigue] average."
    )


def _rows(summary: Summary) -> list[list[Any]]:
    return [
        [NAMES[name], *(row.get(column) for column in COLUMNS)]
        for name, row in _parameters(summary).items()
    ]


def _lines(summary: Summary) -> list[str]:
    row = _parameters(summary).get("swt")
    if row is None:
        return []
    life = "" if row["life"] is None else f", {row['life']:.3g} cycles"
    error = "" if row["estimate"] is None else f" +- {row['estimate']:.1g}"
    place = f"x = {row['x']:.4g} of probe '{row['probe']}', plane at {row['angle']:.0f} degrees"
    lines = [f"fatigue: Smith, Watson and Topper {row['max']:.4g}{error} at {place}{life}"]
    for name, crack in summary["fatigue"].get("cracks", {}).items():
        depth = crack["arrest"]
        if depth is None or depth == np.inf:  # a file has no infinite numbers
            ends = f"grows beyond {crack['depth'][-1]:.4g}"
        else:
            ends = f"arrests at a depth of {depth:.4g}" if depth else "does not begin to grow"
        lines.append(f"crack along '{name}': {ends}")
    return lines


FATIGUE = Section(
    "Fatigue parameters",
    summary=fatigue_summary,
    rows=_rows,
    head=lambda _: ["parameter", *COLUMNS],
    note=_note,
    lines=_lines,
)
