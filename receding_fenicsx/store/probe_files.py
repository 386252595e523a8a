"""CSV files of the probes: a row for each instant and point."""

from __future__ import annotations

import csv
from pathlib import Path

from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.evolution.probes import probe_names
from receding_fenicsx.evolution.record import Record

PROBES = "probes"
"""Folder of the files in a run's folder."""


def write_probes(folder: Path, record: Record) -> list[Path]:
    """Write ``NAME.csv`` for each probe of a record, with the columns of ``probe.to_table()``.

    Args:
        folder: folder of the files, created if necessary; existing files are replaced.
        record: the record.

    Returns:
        The files; none, and no folder, for a record without probes.
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
