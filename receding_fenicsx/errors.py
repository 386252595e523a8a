"""Exceptions and their exit codes."""

from __future__ import annotations

import errno

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What the system says where a disk is full or fails, which no other input would mend."""


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


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or a signal that asks to end, in the middle of a run that can be gone on with.

    Attributes:
        exit_code: 128 + the signal's number, by the shell's convention.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        """Say what is kept and how to go on."""
        super().__init__(message, exit_code)
        self.exit_code = exit_code

    def __str__(self) -> str:
        """Return the message alone."""
        return str(self.args[0])
