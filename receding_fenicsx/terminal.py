"""What the command line does with the terminal and the job: ranks, signals, log, progress."""

from __future__ import annotations

import contextlib
import errno
import logging
import signal
import sys
import traceback
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from cyclopts import CycloptsError
from rich.console import Console

from receding_fenicsx.errors import NO_ROOM, InputErrors, RecedingError
from receding_fenicsx.timing import Say, Step

if TYPE_CHECKING:
    from mpi4py import MPI

PROGRAM = "receding-fenicsx"


def world() -> MPI.Comm | None:
    """Return all processes of the job, or None without mpi4py (some commands do not need it)."""
    with contextlib.suppress(ImportError):
        import dolfinx_solver  # noqa: F401 - PyPI's stack must be loaded before mpi4py
    try:
        from mpi4py import MPI
    except ImportError:
        return None
    return MPI.COMM_WORLD


def require_mpi() -> MPI.Comm:
    """Return all processes of the job, ready for PETSc."""
    comm = world()
    if comm is None:
        raise RecedingError(f"mpi4py is not installed; see {PROGRAM} doctor")
    with contextlib.suppress(ImportError):
        from petsc4py import PETSc  # noqa: F401 - its start replaces the handler of SIGTERM
    catch_termination()
    return comm


def is_root(comm: MPI.Comm | None) -> bool:
    """Return whether this process prints: rank 0, or a process without MPI."""
    return comm is None or comm.rank == 0


def catch_termination() -> None:
    """Make SIGTERM raise SystemExit, so that unfinished files are removed."""

    def terminated(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    with contextlib.suppress(ValueError):  # signals belong to the main thread
        signal.signal(signal.SIGTERM, terminated)


def log_to_terminal(comm: MPI.Comm | None) -> None:
    """Show warnings on rank 0; commands with -v show more."""
    logger, handler = logging.getLogger("receding_fenicsx"), _Lines()
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logger.handlers, logger.propagate = [handler if is_root(comm) else logging.NullHandler()], False
    logger.setLevel(logging.WARNING)


class _Lines(logging.Handler):
    """Writes log lines above the progress, which replaces ``sys.stderr`` while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)


@contextlib.contextmanager
def progress(verbose: int = 0) -> Iterator[Say]:
    """Show the present stage on a terminal, erased at the end; with -v log lines in its place."""
    levels = logging.WARNING, logging.INFO, logging.DEBUG
    logger = logging.getLogger("receding_fenicsx")
    logger.setLevel(levels[min(verbose, 2)])
    logger.info("starting")
    if not is_root(world()) or not sys.stderr.isatty() or verbose:
        yield lambda text: None
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    text = TextColumn("{task.description}", markup=False)
    columns = SpinnerColumn(), TimeElapsedColumn(), BarColumn(bar_width=16), text
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("starting", total=None)

        def say(text: str) -> None:
            step = text if isinstance(text, Step) else Step(text)
            total = step.total or None  # without it the bar only says that work goes on
            shown.update(task, description=text, completed=step.done, total=total, refresh=True)

        yield say


def ending(error: BaseException) -> tuple[int, str]:
    """Return the exit code and the line to print for what ended a command."""
    # errors of paths that the user has to change
    unusable = errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ELOOP
    match error:
        case InputErrors():
            return error.exit_code, "\n".join(f"error: {line}" for line in error.args)
        case CycloptsError():
            see = " ".join([PROGRAM, *(error.command_chain or ()), "--help"])
            return 2, f"error: {' '.join(str(error).split())} See {see}"
        case RecedingError():
            return error.exit_code, f"error: {error}".replace("\n", " ")
        case KeyboardInterrupt():  # 128 + SIGINT, as shells have it
            return getattr(error, "exit_code", 130), str(error) or "interrupted"
        case SystemExit():
            return int(error.code or 0), ""
        case ImportError():
            return 1, f"error: {error}; see {PROGRAM} doctor"
        case BrokenPipeError():  # the reader of the output has closed the pipe
            sys.stdout = None
            return 0, ""
        case MemoryError():
            return 1, "error: out of memory; use fewer contact_elements or samples"
        case OSError() if error.errno in NO_ROOM:
            sys.stdout = None  # buffered output cannot be written either
            where = error.filename or "standard output"
            return 1, f"error: {where}: cannot be written ({error.strerror})"
        case OSError() if error.errno in unusable:
            return 2, f"error: {error.filename}: cannot be used ({error.strerror})"
    traceback.print_exception(error)
    text = f"internal error: {type(error).__name__}: {error}; please report the lines above"
    return 1, text
