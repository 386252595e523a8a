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
    table = record.probe("edge").to_table()
    with open(tmp_path / "probes" / "edge.csv", newline="") as file:
        head, *rows = csv.reader(file)
    for name, column in zip(head, zip(*rows, strict=True), strict=True):
        assert np.array_equal(np.array(column, table[name].dtype), table[name]), name
    assert head == list(table) and len(rows) == 5 * len(record.probe("edge").s)
    xx, yy, zz, xy = (table[key] for key in ("sxx", "syy", "szz", "sxy"))
    mean = (xx + yy + zz) / 3.0
    deviator = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2.0 * xy**2
    assert table["von_mises"] == pytest.approx(np.sqrt(1.5 * deviator))


def test_system_with_other_probes_is_refused() -> None:
    system, _ = solved()
    moved = replace(BLOCK, probes=(rf.Probe("deep", point=(0.5, 0.25)), BLOCK.probes[1]))
    for wrong, scene in ((replace(system, probes=None), BLOCK), (system, moved)):
        with pytest.raises(rf.InputError, match="condensed with other probes"):
            rf.evolve(wrong, scene)
    assert rf.evolve(system, replace(BLOCK, probes=())).probes is None
