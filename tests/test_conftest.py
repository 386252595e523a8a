"""The suite's own promise under MPI, on a small test file in a job of two ranks."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

SUITE, STUCK = (
    (Path(__file__).parent / "programs" / name).read_text() for name in ("suite.txt", "stuck.txt")
)


def test_what_fails_on_one_rank_fails_on_all_and_nobody_waits_for_ever(
    mpirun: Callable[..., Any], tmp_path: Path
) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    # two ranks that clean up old temporary folders at once are warned of each other
    options = "-m", "pytest", "-p", "no:cacheprovider", "--color=no", "-p", "no:warnings"
    # where they do not wait in vain, a busy machine may take its time
    for text, wait in ((SUITE, 60), (SUITE + STUCK, 3)):
        (tmp_path / "pytest.ini").write_text(f"[pytest]\nrank_wait = {wait}\n")
        (tmp_path / "test_it.py").write_text(text)
        done = mpirun(2, *options, cwd=tmp_path, timeout=120)
        assert done.returncode != 0
        for words in ("rank 1 alone", "printed by rank 1", "no fixture on rank 1"):
            assert words in done.stderr
        if text == SUITE:  # the session goes on
            assert done.returncode == 1 and "rank 0 alone" in done.stdout
            assert done.stdout.count("2 failed, 1 passed, 1 error in") == 1, done.stdout
    # the aborted session has no report of its own
    assert "AssertionError: rank 1 broke here" in done.stderr
    assert "test_rank_1_never_comes" in done.stderr and "comm.Barrier" not in done.stdout
