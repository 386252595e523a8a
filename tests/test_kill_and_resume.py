"""The demo that kills runs compares their records by bits."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from demo_runs import demo

pytestmark = pytest.mark.one_rank


def test_records_are_told_apart_by_single_bits(tmp_path: Path) -> None:
    differing = demo("benchmarks/kill_and_resume")["differing"]
    for name, zero in (("a", 0.0), ("b", -0.0), ("c", 0.0)):
        (tmp_path / name).mkdir()
        with h5py.File(tmp_path / name / "record.h5", "w") as file:
            file["turning_points/P"] = np.array([[1.0, zero]])
            file["turning_points/v"] = np.ones(2, dtype="f4" if name == "c" else "f8")
    same, wrong, other = (tmp_path / name for name in "abc")
    assert differing(same, same) == ([], 2)
    assert differing(same, wrong) == (["turning_points/P"], 2)
    assert differing(other, same) == (["turning_points/v"], 2)
