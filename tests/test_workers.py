"""Helper processes: they answer, raise or die alone, and none is left behind."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from receding_fenicsx import child_environment, workers


def answer(work: Callable[..., Any], *arguments: Any) -> Any:
    return workers.result("test", workers.submit("test", work, *arguments))


def wait_for_end_of(mark: str) -> None:
    """Wait until no process has a text in its environment."""
    while any(mark.encode() in environment_of(place) for place in Path("/proc").glob("[0-9]*")):
        time.sleep(0.02)


def environment_of(process: Path) -> bytes:
    try:
        return (process / "environ").read_bytes()
    except OSError:
        return b""


@pytest.mark.one_rank
def test_a_process_answers_raises_or_dies_and_the_next_one_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = answer(os.getpid)
    assert one not in (os.getpid(), None) and answer(os.getpid) == one
    with pytest.raises(ValueError, match="no number"):
        answer(int, "no number")
    monkeypatch.chdir(tmp_path)
    assert answer(os.getcwd) == str(tmp_path) and answer(os.getpid) == one
    for work, number, code in (
        (os._exit, 3, 3),
        (signal.raise_signal, signal.SIGSEGV, -signal.SIGSEGV),
        (lambda number: os.kill(os.getpid(), number), signal.SIGKILL, -signal.SIGKILL),
    ):
        with pytest.raises(workers.WorkerEnded, match="its process ended") as ended:
            answer(work, number)
        assert ended.value.code == code and "\n" not in str(ended.value)
    with pytest.raises(workers.WorkerEnded, match=r"no answer within 0\.1 s"):
        workers.result("test", workers.submit("test", time.sleep, 3600.0), 0.1)
    # one that is killed while it has no job
    two = answer(os.getpid)
    os.kill(two, signal.SIGKILL)
    with contextlib.suppress(workers.WorkerEnded):  # it may still be seen alive
        answer(os.getpid)
    assert answer(os.getpid) not in (one, two)


def test_processes_are_no_ranks_have_one_thread_and_hear_no_ctrl_c() -> None:
    def found() -> tuple[Any, ...]:
        from mpi4py import MPI

        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
        return MPI.COMM_WORLD.size, os.environ["OMP_NUM_THREADS"], blocked

    size, threads, blocked = answer(found)
    assert size == 1 and threads == "1" and blocked == {signal.SIGINT, signal.SIGTERM}
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & blocked


@pytest.mark.one_rank
def test_a_crash_beside_petsc_ends_the_process_by_its_signal() -> None:
    def crash() -> None:
        from petsc4py import PETSc  # noqa: F401 - its handlers would end the job, with a code

        signal.raise_signal(signal.SIGSEGV)

    with pytest.raises(workers.WorkerEnded, match="SIGSEGV"):
        answer(crash)


@pytest.mark.one_rank
def test_what_interrupts_waiting_ends_the_work() -> None:
    class Interrupted(Exception):
        pass

    def interrupt(*_: object) -> None:
        raise Interrupted

    process = answer(os.getpid)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(Interrupted):
            answer(time.sleep, 3600.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert answer(os.getpid) != process


PROGRAM = Path(__file__).parent / "programs" / "ends_while_busy.txt"
"""Program, without a guard, that ends while one process has a job and another has none."""


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("how", "code"), [("fail", 3), ("interrupt", -signal.SIGINT), ("kill", -signal.SIGKILL)]
)
def test_no_process_is_left_behind(how: str, code: int, tmp_path: Path) -> None:
    mark = {"WORKERS_MARK": str(tmp_path)}
    started = subprocess.Popen(
        [sys.executable, str(PROGRAM), how],
        env={**child_environment(), **mark},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    if how == "interrupt":
        assert started.stdout is not None and started.stdout.readline() == "ready\n"
        os.killpg(started.pid, signal.SIGINT)  # as a terminal does
    _, said = started.communicate()
    assert started.returncode == code
    assert "KeyboardInterrupt" in said if how == "interrupt" else said == ""
    wait_for_end_of(str(tmp_path))
