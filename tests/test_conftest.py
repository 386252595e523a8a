"""The suite's own promise under MPI: started on small test files, each in a job of two ranks."""

import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

Session = Callable[..., subprocess.CompletedProcess[str]]

HEAD = """
import pathlib, sys, time
import pytest
from mpi4py import MPI
comm = MPI.COMM_WORLD
rank = comm.rank
"""
RANK_WAIT = 3
"""Seconds: a failing rank's wait, in vain in most of these tests."""
RANKS_COME = ("-o", "rank_wait=60")
"""Where they do not wait in vain, a busy machine may take its time."""
NO_HANG = 120
"""Seconds: many times what a job takes here, less than what a hanging test may take."""


@pytest.fixture
def session(mpirun: Session, tmp_path: Path) -> Session:
    """Run pytest on two ranks on a file of the given text, under the conftest of this folder."""
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "pytest.ini").write_text(f"[pytest]\nrank_wait = {RANK_WAIT}\n")

    def run(text: str, *options: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "test_it.py").write_text(HEAD + text)
        return mpirun(
            2,
            *("-m", "pytest", "-p", "no:cacheprovider", "--color=no"),
            # two ranks that clean up old temporary folders at once are warned of each other
            *("-p", "no:warnings"),
            *options,
            cwd=tmp_path,
            timeout=NO_HANG,
        )

    return run


def test_what_fails_on_one_rank_fails_on_all_and_the_session_goes_on(session: Session) -> None:
    done = session(
        """
def test_both_fail():
    assert rank > 5, "both of them"

def test_rank_1_fails():
    print("printed by rank", rank)
    assert rank == 0, "rank 1 alone"

def test_rank_0_fails():
    assert rank == 1, "rank 0 alone"

@pytest.fixture
def broken():
    if rank == 1:
        raise OSError("no fixture on rank 1")

def test_fixture_fails_on_rank_1(broken):
    comm.Barrier()

def test_one_folder_for_all(shared_tmp_path):
    (shared_tmp_path / f"from_{rank}").touch()
    comm.Barrier()
    assert sorted(p.name for p in shared_tmp_path.iterdir()) == ["from_0", "from_1"]
""",
        *RANKS_COME,
    )
    assert done.returncode == 1
    assert done.stdout.count("3 failed, 1 passed, 1 error in") == 1, done.stdout
    for words in ("rank 1 alone", "printed by rank 1", "no fixture on rank 1"):
        assert words in done.stderr
    assert "rank 0 alone" in done.stdout


def test_failing_rank_ends_the_job_when_the_other_waits_in_a_barrier(session: Session) -> None:
    begin = time.monotonic()
    done = session(
        """
def test_fails_on_both():
    assert False, "an earlier failure"

def test_rank_1_never_comes():
    assert rank == 0, "rank 1 broke here"
    comm.Barrier()
"""
    )
    assert done.returncode != 0
    assert "AssertionError: rank 1 broke here" in done.stderr
    assert "an earlier failure" in done.stderr  # the aborted session has no report of its own
    assert "comm.Barrier" not in done.stdout
    assert "test_it.py" in done.stderr and "test_rank_1_never_comes" in done.stderr
    assert time.monotonic() - begin > RANK_WAIT
