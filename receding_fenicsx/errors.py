"""Exceptions, their exit codes, and raising on all ranks together."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

POLL_SECONDS = 0.005
"""Pause between two looks of a waiting rank: short beside any stage, long beside a busy core."""


class RecedingError(Exception):
    """Base of all errors raised on purpose; one line says what is wrong, where, what to do."""

    exit_code = 1


class InputError(RecedingError):
    """The scene, the options or a file cannot be used as given (exit code 2)."""

    exit_code = 2


class SolveError(RecedingError):
    """A solver did not reach an answer that satisfies its own checks (exit code 1).

    Attributes:
        record: the ``Record`` of the history up to the leg that failed, where there is one.
    """

    record: object | None = None


class NotConverged(SolveError):
    """An iteration ran out of sweeps before its residual fell under the tolerance."""


class NoEquilibrium(SolveError):
    """No equilibrium exists beyond the load factor in the message: lift-off or gross sliding."""


class NoQuasiStaticContinuation(SolveError):
    """The rate problem has no solution at the load factor and nodes named in the message."""


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
        request = comm.Ibcast(failed, root=0)
        while not request.Test():
            time.sleep(POLL_SECONDS)
        if failed[0]:
            error = comm.bcast(error, root=0)
    if error is not None:
        raise error
    return result


def on_all(comm: MPI.Comm, work: Callable[[], T]) -> T:
    """Run rank-local ``work`` on every rank; if it fails on any rank, raise on all of them.

    ``work`` must not communicate: a rank that fails inside a collective leaves the others in it.

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
