import subprocess
from collections.abc import Callable
from pathlib import Path

DEMO = Path(__file__).parent.parent / "demos" / "initial_slip.py"
Run = Callable[..., subprocess.CompletedProcess[str]]


def test_a_map_that_was_stopped_goes_on_where_it_ended(mpirun: Run, tmp_path: Path) -> None:
    small = ["--nodes", "41", "--map", "2", "2", "--samples", "6", "--seeds", "2"]
    first = mpirun(2, DEMO, "--out", tmp_path, *small)
    assert first.returncode == 0, first.stderr
    kept = tmp_path / "cells_41.csv"
    lines = kept.read_text().splitlines()
    # what scene, 7 samples and 2 x 2 cells of 2
    assert len(lines) == 16
    # killed in the middle of the twelfth cell
    kept.write_text("\n".join(lines[:12]) + "\n" + lines[12][:40])
    again = mpirun(1, DEMO, "--out", tmp_path, *small)
    assert again.returncode == 0, again.stderr
    assert "11 of 15 are finished already" in again.stdout
    finished = kept.read_text().splitlines()
    assert [line for line in finished if line in lines] == lines
    # cells of another scene are not mixed in
    kept.write_text("\n".join(["# scene 00000000", *lines[1:]]))
    other = mpirun(1, DEMO, "--out", tmp_path, *small)
    assert other.returncode != 0 and "is of another scene" in other.stderr
