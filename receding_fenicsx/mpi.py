"""Run functions on rank 0 or on all ranks, and raise their errors on every rank."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

POLL_SECONDS = 0.005
"""Longest pause between two polls of a waiting rank."""
POLL_SHARE = 0.1
"""Pause between two polls over the time waited so far: the largest relative delay of a stage."""
SAVING_SECONDS = 10.0
"""Time that a rank waits after a signal for rank 0 to save its work."""


def world() -> MPI.Comm:
    """Return the communicator of all processes of the job."""
    from mpi4py import MPI

    return MPI.COMM_WORLD


def on_root(comm: MPI.Comm, work: Callable[[], T]) -> T | None:
    """Run ``work`` on rank 0 while the other ranks sleep; raise its exception on every rank.

    Args:
        comm: communicator whose ranks all call this function.
        work: function without arguments, called on rank 0 only.

    Returns:
        What ``work`` returned on rank 0, None on the others.

    Raises:
        BaseException: what ``work`` raised, on every rank alike.
    """
    result: T | None = None
    error: BaseException | None = None
    if comm.rank == 0:
        try:
            result = work()
        except BaseException as caught:
            error = caught
    if comm.size > 1:
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
    """Sleep until rank 0 has done its work.

    A signal that ends the job reaches every rank, and rank 0 may have to save its work first. The
    others wait ``SAVING_SECONDS`` before they obey the signal.
    """
    stopped: BaseException | None = None
    begin, end = time.monotonic(), float("inf")
    while time.monotonic() < end:
        try:
            while time.monotonic() < end and not request.Test():
                time.sleep(pause_after(time.monotonic() - begin))
            if time.monotonic() < end:
                return
        except (KeyboardInterrupt, SystemExit) as signalled:
            stopped = stopped or signalled
            end = min(end, time.monotonic() + SAVING_SECONDS)
    assert stopped is not None
    raise stopped


def pause_after(waited: float) -> float:
    """Return the pause before the next poll, in seconds, after ``waited`` seconds."""
    return min(POLL_SHARE * waited, POLL_SECONDS)


def on_all(comm: MPI.Comm, work: Callable[[], T]) -> T:
    """Run rank-local ``work`` on every rank; if it fails on any rank, raise on all of them.

    ``work`` must not communicate: if one rank fails in a collective, the others never leave it.

    Args:
        comm: communicator whose ranks all call this function.
        work: function without arguments.

    Returns:
        What ``work`` returned on this rank.

    Raises:
        BaseException: this rank's exception, or that of the lowest failing rank.
    """
    result: T | None = None
    error: BaseException | None = None
    try:
        result = work()
    except BaseException as caught:
        error = caught
    errors = comm.allgather(error)
    for other in errors:
        if other is not None:
            raise error or other
    return result  # type: ignore[return-value]
