"""Helper processes: for work that may crash, that must not meet DOLFINx, or that runs beside other.

VTK ends the whole process where a graphics library is missing, and gmsh where a file asks for it.
Each pool of processes has a name and is kept for later jobs: only its first job pays for its start.
Its processes are no part of the MPI job, and end with the one that started them, which alone
answers Ctrl-C.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any, TypeVar

from receding_fenicsx.environment import MPI_VARIABLES
from receding_fenicsx.errors import RecedingError

T = TypeVar("T")

_pools: dict[tuple[int, str], Executor] = {}
"""Pools by the number of this process, as forks need their own, and their names."""


class WorkerEnded(RecedingError):
    """A process ended before its job was done."""

    def __init__(self, reason: str, code: int | None = None) -> None:
        """Keep its exit code, the negative number of a signal; None where it is not known."""
        super().__init__(reason)
        self.code = code


def submit(
    pool: str, work: Callable[..., T], *arguments: Any, count: int = 1, loud: bool = False
) -> Future[T]:
    """Begin a job in a pool, which starts with ``count`` processes if there is none.

    The function may be one of the user's main program; it runs in this working directory. ``loud``
    processes keep what they print.
    """
    from multiprocessing import resource_tracker

    from loky.backend import resource_tracker as trackers
    from loky.process_executor import ProcessPoolExecutor, ShutdownExecutorError

    # those that remove semaphores after a kill would tell of it; they also unblock signals
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")
    try:
        resource_tracker.ensure_running()
        trackers.ensure_running()
    finally:
        sys.warnoptions.pop()
    # new processes inherit the mask: neither Ctrl-C nor a signal to the group ends them
    held = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        if threading.current_thread() is threading.main_thread():
            # PETSc ends the job when the other end of a pipe is closed
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        while True:
            key = (os.getpid(), pool)
            new = key not in _pools
            if new:
                options = os.environ.get("PETSC_OPTIONS", "")
                threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
                variables = dict.fromkeys(threads, "1") | {
                    "PETSC_OPTIONS": f"{options} -no_signal_handler".strip(),
                    # a process that grows is not replaced: condensed systems stay in memory
                    "LOKY_MAX_MEMORY_LEAK_SIZE": "1e18",
                }
                _pools[key] = ProcessPoolExecutor(
                    count, initializer=_begin, initargs=(os.getpid(), loud), env=variables
                )
            try:
                job = _pools[key].submit(_do, os.getcwd(), work, arguments)
                if new:
                    # at the exit loky would wait for jobs; the last one registered is called first
                    threading._register_atexit(end, pool)  # type: ignore[attr-defined]
                return job
            except (BrokenExecutor, ShutdownExecutorError):  # one ended while it had no job
                end(pool)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def result(pool: str, job: Future[T], seconds: float | None = None) -> T:
    """Wait for a job; end its pool if it takes longer than this, or at an interrupt.

    The errors are those of the job, and WorkerEnded if the process ended.
    """
    try:
        return job.result(seconds)
    except BrokenExecutor as error:
        found = re.search(r"(\w+)\((-?\d+)\)", str(error))
        if found is None:
            raise WorkerEnded("its process ended") from None
        name, code = found[1], int(found[2])
        how = f"with exit code {code}" if code >= 0 else f"by {name}"
        raise WorkerEnded(f"its process ended {how}", code) from None
    except BaseException as error:
        if isinstance(error, RecedingError):
            raise error from None  # without the trace in the other process
        if job.done():
            raise
        end(pool)
        if isinstance(error, TimeoutError):
            raise WorkerEnded(f"no answer within {seconds:g} s") from None
        raise


def end(pool: str) -> None:
    """End the processes of a pool by force, with the jobs that they have, if there is one."""
    executor: Any = _pools.pop((os.getpid(), pool), None)
    if executor is not None:
        executor.shutdown(wait=True, kill_workers=True)


def _begin(parent: int, loud: bool) -> None:
    """Prepare a new process of a pool."""
    for name in [name for name in os.environ if MPI_VARIABLES.match(name)]:
        del os.environ[name]
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0,) if loud else (0, 1, 2):
        os.dup2(null, stream)

    def follow() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _do(folder: str, work: Callable[..., T], arguments: tuple[Any, ...]) -> T:
    """Do a job in a folder."""
    os.chdir(folder)
    return work(*arguments)
