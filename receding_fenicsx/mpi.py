"""Run functions on rank 0 or on all ranks, and raise their errors on every rank."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

RANK_WAIT_SECONDS = 10.0
"""Time that a failing rank waits for the others to fail too, before it aborts the job."""


def world() -> MPI.Comm:
    """Return the communicator of all processes of the job."""
    from mpi4py import MPI

    return guarded(MPI.COMM_WORLD)


def guarded(comm: MPI.Comm) -> MPI.Comm:
    """Return a communicator; an uncaught exception on one of its ranks will end the whole job.

    Python would end that rank alone, and leave the others in a collective for ever.
    """
    if comm.size > 1:
        _set_hook()
    return comm


@cache
def _set_hook() -> None:
    """Let uncaught exceptions be followed by :func:`leave`."""
    from mpi4py import MPI

    earlier = sys.excepthook

    def report_and_leave(kind: Any, error: BaseException, trace: Any) -> None:
        earlier(kind, error, trace)
        leave(MPI.COMM_WORLD, getattr(error, "exit_code", 1), f"{kind.__name__}: {error}")

    sys.excepthook = report_and_leave


def leave(comm: MPI.Comm, code: int, text: str = "") -> None:
    """Wait after an error until all ranks leave; abort the job with this code if some do not come.

    The ranks agree by messages of pairs: a collective could meet another one in which they wait.
    Another rank than 0 prints the text before it aborts the job.
    """
    missing = [rank for rank in range(comm.size) if rank != comm.rank]
    tag = 32_767  # the largest that every MPI has
    with contextlib.suppress(Exception):  # an error of MPI itself: the others cannot be reached
        requests = [comm.isend(None, rank, tag) for rank in missing]
        end = time.monotonic() + RANK_WAIT_SECONDS
        while missing and time.monotonic() < end:
            come = [rank for rank in missing if comm.iprobe(rank, tag)]
            for rank in come:
                comm.recv(source=rank, tag=tag)
            missing = [rank for rank in missing if rank not in come]
            time.sleep(0.005)
        if not missing:
            for request in requests:
                request.wait()
            return
    if text and comm.rank != 0:
        print(f"rank {comm.rank}: {text}", file=sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, AttributeError):
            stream.flush()
    time.sleep(0.5)  # MPICH's launcher drops output not yet passed on
    comm.Abort(code)


def on_root(comm: MPI.Comm | None, work: Callable[[], T]) -> T | None:
    """Run ``work`` on rank 0 while the other ranks sleep; raise its exception on every rank.

    Without a communicator, in a process without MPI, it is run at once.
    """
    if comm is None:
        return work()
    result: T | None = None
    error: BaseException | None = None
    if comm.rank == 0:
        try:
            result = work()
        except BaseException as caught:
            error = caught
    if guarded(comm).size > 1:
        failed = bytearray([error is not None])
        _wait_for_root(comm.Ibcast(failed, root=0))
        if failed[0]:
            error = comm.bcast(error, root=0)
    if error is not None:
        raise error
    return result


def given(value: T | None) -> T:
    """Assert that a value known on rank 0 only is not None; return it."""
    assert value is not None
    return value


def _wait_for_root(request: MPI.Request) -> None:
    """Sleep until rank 0 has done its work."""
    # a signal that ends the job reaches every rank; rank 0 has 10 s to save its work first
    stopped: BaseException | None = None
    begin, end = time.monotonic(), float("inf")
    while time.monotonic() < end:
        try:
            while time.monotonic() < end and not request.Test():
                # late by a tenth at most
                time.sleep(min(0.1 * (time.monotonic() - begin), 0.005))
            if time.monotonic() < end:
                return
        except (KeyboardInterrupt, SystemExit) as signalled:
            stopped = stopped or signalled
            end = min(end, time.monotonic() + 10.0)
    assert stopped is not None
    raise stopped


def on_all(comm: MPI.Comm, work: Callable[[], T]) -> T:
    """Run rank-local ``work`` on every rank; if it fails on any rank, raise on all of them.

    ``work`` must not communicate: if one rank fails in a collective, the others never leave it. The
    error is this rank's own, or that of the lowest failing rank.
    """
    result, error = None, None
    try:
        result = work()
    except BaseException as caught:
        error = caught
    errors = [other for other in guarded(comm).allgather(error) if other is not None]
    if errors:
        raise error or errors[0]
    return result  # type: ignore[return-value]
