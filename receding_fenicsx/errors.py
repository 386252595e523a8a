"""Exceptions and their exit codes."""

from __future__ import annotations

import errno

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Error numbers of a full or failing disk: not an error of the input."""


class RecedingError(Exception):
    """Base of all errors raised on purpose; the message says what is wrong, where, what to do."""

    exit_code = 1


class InputError(RecedingError):
    """A scene, an option or a file cannot be used as given (exit code 2)."""

    exit_code = 2


class InputErrors(InputError):
    """Several errors of one file or scene, each in one line: its ``args``."""

    def __str__(self) -> str:
        """Return one line for each error."""
        return "\n".join(self.args)


class MeshMisfit(InputError):
    """A mesh cannot serve a scene, as for a missing vertex, but one of other elements may."""


class SolveError(RecedingError):
    """A solver found no answer that satisfies its own checks (exit code 1).

    Attributes:
        record: the ``Record`` of the history up to the leg that failed, if any.
    """

    record: object | None = None


class NotConverged(SolveError):
    """An iteration ran out of sweeps before its residual fell under the tolerance."""


class NoEquilibrium(SolveError):
    """No equilibrium exists beyond the load factor in the message: lift-off or gross sliding."""


class NoQuasiStaticContinuation(SolveError):
    """The rate problem has no solution at the load factor and nodes named in the message."""


class ToleranceNotMet(SolveError):
    """No mesh that was tried gives the numbers to within the tolerance; the run is kept."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or a signal that asks to end, during a run that can be resumed.

    Attributes:
        exit_code: 128 + the signal's number, by the shell's convention.
    """

    def __init__(self, message: str, exit_code: int = 130) -> None:
        """Set the message, which says what is kept and how to resume, and the exit code."""
        super().__init__(message)
        self.exit_code = exit_code
