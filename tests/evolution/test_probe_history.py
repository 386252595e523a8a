"""Histories of the probes: every instant of the record, saved systems, resumed runs, refusals."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bodies import block

import receding_fenicsx as rf
from receding_fenicsx.store.run_folder import write_probes

pytestmark = pytest.mark.one_rank

BLOCK = block(
    degree=2,
    elements=24,
    history=rf.HistoryOptions(cycles=1),
    output=rf.OutputOptions(6),
    probes=(
        rf.Probe("deep", point=(0.5, 0.5)),
        rf.Probe("edge", segment=((-2.0, 0.0), (2.0, 0.0)), count=5),
    ),
)


@cache
def solved() -> tuple[rf.ContactSystem, rf.Record]:
    system = rf.given(rf.condense(BLOCK))
    return system, rf.evolve(system, BLOCK)


def test_a_probe_that_is_not_in_the_record_is_refused(tmp_path: Path) -> None:
    _, record = solved()
    with pytest.raises(rf.InputError, match="'dep': is not in the record; did you mean 'deep'"):
        record.probe("dep")
    rf.write_record(tmp_path / "r.h5", replace(record, probes=None))
    with pytest.raises(rf.InputError, match="has no probes; add a table"):
        rf.read_record(tmp_path / "r.h5").probe("deep")


def test_table_and_file_have_a_row_for_each_instant_and_point(tmp_path: Path) -> None:
    _, record = solved()
    assert write_probes(tmp_path / "probes", record) == [
        tmp_path / "probes" / f"{name}.csv" for name in ("deep", "edge")
    ]
    probe = record.probe("edge")
    with open(tmp_path / "probes" / "edge.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    table = probe.to_table()
    assert list(rows[0]) == list(table)
    n = len(probe.s)
    assert len(rows) == 5 * n
    row = rows[5 * (n // 2) + 3]
    assert float(row["x"]) == 1.0 and row["point"] == "3"
    assert [float(row[key]) for key in ("sxx", "syy", "szz", "sxy")] == probe.stress[
        n // 2, 3
    ].tolist()
    xx, yy, zz, xy = probe.stress[n // 2, 3]
    deviator = np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, zz]])
    deviator = deviator - np.eye(3) * np.trace(deviator) / 3.0
    assert float(row["von_mises"]) == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()))


def test_system_with_other_probes_is_refused() -> None:
    system, _ = solved()
    moved = replace(BLOCK, probes=(rf.Probe("deep", point=(0.5, 0.25)), BLOCK.probes[1]))
    for wrong, scene in ((replace(system, probes=None), BLOCK), (system, moved)):
        with pytest.raises(rf.InputError, match="condensed with other probes"):
            rf.evolve(wrong, scene)
    assert rf.evolve(system, replace(BLOCK, probes=())).probes is None
