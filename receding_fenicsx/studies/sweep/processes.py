"""Processes that share the cases of a sweep: this one, new ones of this machine, or MPI's ranks."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, as_completed, wait

from receding_fenicsx import workers
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.studies.sweep.worker import Outcome, Task, play

Played = Generator[tuple[int, Outcome], None, None]
"""Numbers of the cases as they finish, and their outcomes."""


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


def on_processes(tasks: Mapping[int, Task], count: int) -> Played:
    """Play cases on new processes of this machine.

    If a process dies, the cases that were begun are played again, each alone; the one whose process
    dies again has failed.
    """
    waiting = list(tasks)
    while waiting:
        for number in (yield from _until_one_dies(tasks, waiting, min(count, len(tasks)))):
            if (yield from _until_one_dies(tasks, [number], 1)):
                text = "its process was ended from outside, or crashed"
                yield number, Outcome({}, text, final=False)


def _until_one_dies(
    tasks: Mapping[int, Task], waiting: list[int], count: int
) -> Generator[tuple[int, Outcome], None, list[int]]:
    """Play the waiting cases, ``count`` at a time; return those begun when a process dies."""
    running: dict[Future[Outcome], int] = {}
    died: list[int] = []
    try:
        while running or (waiting and not died):
            while waiting and not died and len(running) < count:
                number = waiting.pop(0)
                job = workers.submit("sweep", play, tasks[number], count=count, loud=True)
                running[job] = number
            for job in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(job)
                if isinstance(job.exception(), BrokenExecutor):
                    died.append(number)
                else:
                    yield number, job.result()
    finally:
        workers.end("sweep")
    return died
