"""Processes that share the cases of a sweep: this one, new ones of this machine, or MPI's ranks."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from multiprocessing.connection import wait

from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.parameter_sweep.worker import Outcome, Task, play

Played = Generator[tuple[int, Outcome], None, None]
"""Numbers of the cases as they finish, and their outcomes."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def in_this_process(tasks: Mapping[int, Task]) -> Played:
    """Play cases one after the other."""
    for number, task in tasks.items():
        yield number, play(task)


def on_executor(executor: Executor, tasks: Mapping[int, Task]) -> Played:
    """Play cases on an executor; those not begun are withdrawn when the caller stops early.

    Raises:
        RecedingError: the executor lost one of its processes.
    """
    futures: dict[Future[Outcome], int] = {}
    try:
        futures |= {executor.submit(play, task): number for number, task in tasks.items()}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenExecutor:
        raise RecedingError(
            "sweep: a process that played a case was ended from outside; the finished cases are "
            "kept, continue by --resume"
        ) from None
    finally:
        for future in futures:
            future.cancel()


def on_processes(tasks: Mapping[int, Task], workers: int) -> Played:
    """Play cases on new processes of this machine.

    If a process dies, the cases that were begun are played again, each in a process of its own; the
    one whose process dies again has failed.

    Raises:
        RecedingError: new processes cannot start.
    """
    left = dict(tasks)
    while left:
        begun: set[int] = set()
        for number, outcome in _round(left, workers, begun):
            del left[number]
            yield number, outcome
        for number in sorted(begun & left.keys()):
            alone = {number: left.pop(number)}
            outcomes = [outcome for _, outcome in _round(alone, 1, set())]
            died = Outcome({}, "its process was ended from outside, or crashed", final=False)
            yield number, (outcomes or [died])[0]


def _round(tasks: Mapping[int, Task], workers: int, begun: set[int]) -> Played:
    """Play cases until one of the processes dies; ``begun`` takes the cases begun by then."""
    before = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")  # a fork would copy MPI's state
    with _environment_of_workers():
        pool = ProcessPoolExecutor(min(workers, len(tasks)), spawn, _begin)
        futures: dict[Future[Outcome], int] = {}
        try:
            _check_start(pool)
            for number, task in tasks.items():
                futures[pool.submit(play, task)] = number
            for future in as_completed(futures):
                if isinstance(future.exception(), BrokenExecutor):
                    break
                yield futures[future], future.result()
        except BrokenExecutor:
            pass
        finally:
            begun |= {number for future, number in futures.items() if not future.cancel()}
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            pool.shutdown(wait=True)


def _check_start(pool: ProcessPoolExecutor) -> None:
    """Raise RecedingError unless a new process starts."""
    try:
        pool.submit(os.getpid).result()
    except BrokenExecutor:
        raise RecedingError(
            "sweep: new processes cannot start; a script that calls sweep with workers needs "
            '`if __name__ == "__main__":`'
        ) from None


def _begin() -> None:
    """Prepare a new process: it ends with its parent, which alone answers Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def follow() -> None:
        wait([sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextlib.contextmanager
def _environment_of_workers() -> Iterator[None]:
    """Set the environment that new processes inherit: one BLAS thread, no membership in MPI."""
    saved = dict(os.environ)
    inherited = child_environment()
    for name in saved.keys() - inherited.keys():
        del os.environ[name]
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name in THREADS:
            del os.environ[name]
        os.environ.update(saved)
