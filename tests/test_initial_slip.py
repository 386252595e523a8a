import subprocess
from collections.abc import Callable
from pathlib import Path

DEMO = Path(__file__).parent.parent / "demos" / "initial_slip.py"
Run = Callable[..., subprocess.CompletedProcess[str]]


def test_a_map_that_was_stopped_goes_on_where_it_ended(mpirun: Run, tmp_path: Path) -> None:
    small = ["--nodes", "21", "--map", "2", "2", "--samples", "4", "--seeds", "2"]
    first = mpirun(2, DEMO, "--out", tmp_path, *small)
    assert first.returncode == 0, first.stderr
    journal, table = tmp_path / "map" / "cases.jsonl", tmp_path / "map" / "sweep.csv"
    lines, whole = journal.read_bytes().splitlines(keepends=True), table.read_bytes()
    assert len(lines) == 2 * 2 * 2
    # killed in the middle of the sixth case
    journal.write_bytes(b"".join(lines[:5]) + lines[5][:40])
    table.unlink()
    again = mpirun(1, DEMO, "--out", tmp_path, *small)
    assert again.returncode == 0, again.stderr
    assert again.stdout == first.stdout
    assert table.read_bytes() == whole
    assert journal.read_bytes().startswith(b"".join(lines[:5]))
