"""The command line, ``receding-fenicsx``; under ``mpirun`` all ranks run it together."""

from __future__ import annotations

import contextlib
import errno
import logging
import sys
import traceback
from collections.abc import Sequence
from typing import TYPE_CHECKING

from receding_fenicsx.cli_commands import COMMANDS, catch_termination, is_root
from receding_fenicsx.cli_parser import PROGRAM, make_parser
from receding_fenicsx.errors import NO_ROOM, Interrupted, RecedingError
from receding_fenicsx.mpi import leave

if TYPE_CHECKING:
    from mpi4py import MPI

UNUSABLE_PATH = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ELOOP)
"""System errors of paths that the user has to change."""
INTERRUPTED = 130
"""Exit code after Ctrl-C, by the shell's convention 128 + SIGINT."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: arguments; those of the process when left out.

    Returns:
        The exit code. 1: a solver failed, something is missing, or there is no room on the disk or
        in memory; 2: bad input; 130: interrupted.
    """
    comm = _world()
    catch_termination()
    try:
        options = make_parser(is_root(comm)).parse_args(argv)
        _log_to_terminal(comm, options.verbose)
        code = int(COMMANDS[options.command](options, comm) or 0)
        print(end="", flush=True)
        return code
    except RecedingError as error:
        return _fail(comm, f"error: {error}".replace("\n", " "), error.exit_code)
    except Interrupted as error:
        return _fail(comm, str(error), error.exit_code)
    except KeyboardInterrupt:
        return _fail(comm, "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # the reader of the output has closed the pipe
        sys.stdout = None
        return _fail(comm, "", 0)
    except SystemExit as stop:
        if isinstance(stop.code, int) and stop.code > 128:  # a signal, maybe to this rank alone
            _fail(comm, "", stop.code)
        raise
    except MemoryError:
        return _fail(comm, "error: out of memory; use fewer contact_elements or samples", 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            # buffered output cannot be written either
            sys.stdout = None
            where = error.filename or "standard output"
            return _fail(comm, f"error: {where}: cannot be written ({error.strerror})", 1)
        if isinstance(error, OSError) and error.errno in UNUSABLE_PATH:
            return _fail(comm, f"error: {error.filename}: cannot be used ({error.strerror})", 2)
        traceback.print_exc()
        text = f"internal error: {type(error).__name__}: {error}; please report the lines above"
        return _fail(comm, text, 1)


def _log_to_terminal(comm: MPI.Comm | None, verbose: int) -> None:
    """Show warnings on rank 0: with -v stages and cycles too, with -vv every event."""
    logger = logging.getLogger("receding_fenicsx")
    for handler in logger.handlers[:]:
        logger.removeHandler(handler)
    logger.propagate = False
    logger.addHandler(logging.StreamHandler() if is_root(comm) else logging.NullHandler())
    # on a terminal in place of the progress line
    clear = "\r\033[K" if sys.stderr.isatty() else ""
    logger.handlers[0].setFormatter(
        logging.Formatter(f"{clear}%(asctime)s %(message)s", "%H:%M:%S")
    )
    logger.setLevel((logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)])


def _world() -> MPI.Comm | None:
    """Return all processes of the job, or None without mpi4py (some commands do not need it)."""
    with contextlib.suppress(ImportError):
        import dolfinx_solver  # noqa: F401 - PyPI's stack must be loaded before mpi4py
    try:
        from mpi4py import MPI
    except ImportError:
        return None
    return MPI.COMM_WORLD


def _fail(comm: MPI.Comm | None, text: str, code: int) -> int:
    """Print an error on rank 0 and return the exit code; a rank failing alone aborts the job."""
    if text and is_root(comm):
        print(f"{PROGRAM}: {text}", file=sys.stderr, flush=True)
    if comm is not None and comm.size > 1:
        leave(comm, code, text)
    return code
