"""Reader and writer of ``summary.json``; CSV files of the probes."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.probes import probe_names
from receding_fenicsx.evolution.record import Record


def write_summary(path: Path, summary: Mapping[str, Any], overwrite: bool = False) -> None:
    """Write a summary as JSON; numbers that are not finite become null."""
    with new_file(path, overwrite) as beside:
        text = json.dumps(_finite(summary), indent=2, ensure_ascii=False, allow_nan=False)
        beside.write_text(text + "\n", encoding="utf-8")


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary; InputError where there is none."""
    try:
        summary = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give the folder of a finished run") from None
    except (OSError, ValueError):
        raise InputError(f"{path}: is damaged or not a JSON file; run the scene again") from None
    needed = {"title", "steady", "turning_points", "dissipation_per_cycle"}
    if not isinstance(summary, dict) or not needed <= summary.keys():
        raise InputError(f"{path}: is not a summary of a run; run the scene again")
    return summary


def _finite(value: Any) -> Any:
    """Return a value with every number that is not finite replaced by None."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


PROBES = "probes"
"""Folder of the files in a run's folder."""


def write_probes(folder: Path, record: Record) -> list[Path]:
    """Write ``NAME.csv`` for each probe of a record, with the columns of ``probe.to_table()``.

    The folder is created if there is a probe; the files, which are returned, replace earlier ones.
    """
    made = []
    for name in probe_names(record):
        make_folder(folder)
        table = record.probe(name).to_table()
        path = folder / f"{name}.csv"
        with new_file(path, overwrite=True) as beside, open(beside, "w", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(table)
            rows.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        made.append(path)
    return made
