"""The command line, ``receding-fenicsx``; under ``mpirun`` all ranks run it together."""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from receding_fenicsx import __version__
from receding_fenicsx.errors import NO_ROOM, InputError, Interrupted, RecedingError
from receding_fenicsx.mpi import POLL_SECONDS

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.scene.model import Scene

PROGRAM = "receding-fenicsx"
RANK_WAIT_SECONDS = 10.0
"""How long a failing rank waits for the others to fail too before it ends the whole job."""
LAUNCHER_SECONDS = 0.5
"""A rank's pause before it ends the job: MPICH's launcher drops what it has not passed on yet."""
UNUSABLE = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ELOOP)
"""What the system says of paths that the user has to change."""
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
    _catch_termination()
    try:
        options = _parser(comm).parse_args(argv)
        _log_to_terminal(comm, options.verbose)
        code = int(options.work(options, comm) or 0)
        print(end="", flush=True)
        return code
    except RecedingError as error:
        return _fail(comm, f"error: {error}".replace("\n", " "), error.exit_code)
    except Interrupted as error:
        return _fail(comm, str(error), error.exit_code)
    except KeyboardInterrupt:
        return _fail(comm, "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # whoever read the output has enough of it
        sys.stdout = None
        return 0
    except MemoryError:
        return _fail(comm, "error: out of memory; use fewer contact_elements or samples", 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            # what is still to be printed has no room either
            sys.stdout = None
            where = error.filename or "what is printed"
            return _fail(comm, f"error: {where}: cannot be written ({error.strerror})", 1)
        if isinstance(error, OSError) and error.errno in UNUSABLE:
            return _fail(comm, f"error: {error.filename}: cannot be used ({error.strerror})", 2)
        traceback.print_exc()
        text = f"internal error: {type(error).__name__}: {error}; please report the lines above"
        return _fail(comm, text, 1)


def _log_to_terminal(comm: MPI.Comm | None, verbose: int) -> None:
    """Show what is logged, on rank 0: stages and cycles, or with two -v every event too."""
    logger = logging.getLogger("receding_fenicsx")
    for handler in logger.handlers[:]:
        logger.removeHandler(handler)
    logger.propagate = False
    shown = verbose > 0 and _is_root(comm)
    logger.addHandler(logging.StreamHandler() if shown else logging.NullHandler())
    logger.handlers[0].setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logger.setLevel(logging.DEBUG if verbose > 1 else logging.INFO)


def _world() -> MPI.Comm | None:
    """All processes of the job; None where there is no MPI (some commands do without)."""
    with contextlib.suppress(ImportError):
        import dolfinx_solver  # noqa: F401 - PyPI's stack wants to be loaded before mpi4py
    try:
        from mpi4py import MPI
    except ImportError:
        return None
    return MPI.COMM_WORLD


def _catch_termination() -> None:
    with contextlib.suppress(ValueError):  # signals belong to the main thread
        signal.signal(signal.SIGTERM, _terminated)


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    """Leave through the clean-up of unfinished files."""
    raise SystemExit(128 + number)


def _fail(comm: MPI.Comm | None, text: str, code: int) -> int:
    """Say why on rank 0 and return the exit code; a rank that failed alone ends the job."""
    if comm is None or comm.size == 1:
        print(f"{PROGRAM}: {text}", file=sys.stderr)
        return code
    if comm.rank == 0:
        print(f"{PROGRAM}: {text}", file=sys.stderr, flush=True)
    together = comm.Ibarrier()
    end = time.monotonic() + RANK_WAIT_SECONDS
    while not together.Test():
        if time.monotonic() > end:
            if comm.rank != 0:
                print(f"{PROGRAM}: rank {comm.rank}: {text}", file=sys.stderr)
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError):
                    stream.flush()
            time.sleep(LAUNCHER_SECONDS)
            comm.Abort(code)
        time.sleep(POLL_SECONDS)
    return code


class _Parser(argparse.ArgumentParser):
    """Raises instead of printing on every rank; prints help on rank 0 only."""

    root = True

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")

    def _print_message(self, message: str, file: Any = None) -> None:
        if self.root and message:
            print(message, end="", file=file or sys.stderr)


def _parser(comm: MPI.Comm | None) -> argparse.ArgumentParser:
    kind = type("Parser", (_Parser,), {"root": comm is None or comm.rank == 0})
    parser = kind(
        prog=PROGRAM,
        description="Frictional receding contact under cyclic loading.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")

    def command(name: str, work: Callable[..., int | None], text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        added.set_defaults(work=work, verbose=0)
        return added

    def verbose_argument(added: argparse.ArgumentParser) -> None:
        added.add_argument(
            "-v",
            "--verbose",
            action="count",
            help="log stages, cycles, residuals and timings; twice: every change of state too",
        )

    def scene_arguments(added: argparse.ArgumentParser) -> None:
        added.add_argument("scene", metavar="SCENE.toml", help="what is modelled")
        added.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="TABLE.KEY=VALUE",
            dest="overrides",
            help="change a value of the scene (load.NAME.key=value for loads); may be repeated",
        )

    added = command("run", _run, "go the whole way: mesh, condense, evolve, write and draw")
    scene_arguments(added)
    added.add_argument("--out", required=True, metavar="DIR", help="folder for what is found")
    added.add_argument("--overwrite", action="store_true", help="replace an earlier run")
    added.add_argument(
        "--resume",
        action="store_true",
        help="go on with an interrupted run, or with a finished one for more cycles",
    )
    added.add_argument(
        "--system",
        metavar="FILE",
        help="use a saved system (of condense, or a run's system.h5) instead of condensing again",
    )
    added.add_argument(
        "--pictures",
        choices=("all", "figures", "none"),
        help="all draws the body too, which needs it meshed again; figures is what --system draws",
    )
    added.add_argument(
        "--error",
        action="store_true",
        help="solve on three coarser meshes too; estimate the space error of the headline numbers",
    )
    verbose_argument(added)

    added = command("condense", _condense, "condense the body to its contact nodes and save that")
    scene_arguments(added)
    added.add_argument("--out", required=True, metavar="FILE", help="HDF5 file of the system")
    added.add_argument("--overwrite", action="store_true", help="replace the file")
    verbose_argument(added)

    added = command("plot", _plot, "draw the figures of a finished run again")
    added.add_argument("folder", metavar="DIR", help="folder of the run")

    added = command("snapshot", _snapshot, "draw the body of a finished run at one instant")
    added.add_argument("folder", metavar="DIR", help="folder of the run")
    added.add_argument("--cycle", type=int, required=True, metavar="N", help="0: first loading")
    added.add_argument(
        "--leg", required=True, metavar="loading|unloading|K", help="part of the cycle"
    )
    added.add_argument("--at", type=float, default=1.0, metavar="S", help="0 to 1 along the leg")
    verbose_argument(added)

    added = command("animate", _animate, "make a film of one cycle of a finished run")
    added.add_argument("folder", metavar="DIR", help="folder of the run")
    added.add_argument("--cycle", type=int, required=True, metavar="N", help="0: first loading")
    added.add_argument("--frames", type=int, default=60, metavar="N", help="pictures (60)")
    added.add_argument(
        "--stress",
        default="max_shear",
        metavar="NAME",
        help="max_shear (fringes), von_mises, sxx, syy or sxy",
    )

    added = command("export", _export, "write a load step in FCLIB's layout, for other solvers")
    added.add_argument("source", metavar="DIR|SYSTEM", help="folder of a run, or a saved system")
    added.add_argument("--out", required=True, metavar="FILE", help="HDF5 file of the step")
    added.add_argument("--overwrite", action="store_true", help="replace the file")
    added.add_argument("--cycle", type=int, default=0, metavar="N", help="0: first loading")
    added.add_argument(
        "--leg", default="0", metavar="loading|unloading|K", help="part of the cycle"
    )
    added.add_argument("--at", type=float, default=1.0, metavar="S", help="end of the step, 0 to 1")
    added.add_argument(
        "--since", type=float, metavar="S", help="its start; a load step of the scene before"
    )

    scene_arguments(command("check", _check, "look whether a scene can be modelled, no more"))
    command("doctor", _doctor, "show what is installed and whether it works")
    return parser


def _is_root(comm: MPI.Comm | None) -> bool:
    return comm is None or comm.rank == 0


def _needed(comm: MPI.Comm | None) -> MPI.Comm:
    if comm is None:
        raise RecedingError("mpi4py is not installed; see receding-fenicsx doctor")
    with contextlib.suppress(ImportError):
        from petsc4py import PETSc  # noqa: F401 - its start takes the signal for itself
    _catch_termination()
    return comm


class _Progress:
    """One line on the terminal that is written over again and again; nothing elsewhere."""

    def __init__(self, comm: MPI.Comm | None, verbose: int = 0) -> None:
        self.shown = _is_root(comm) and sys.stderr.isatty() and not verbose

    def __enter__(self) -> Callable[[str], None]:
        return self.say

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def say(self, text: str) -> None:
        """Show what is being done."""
        if self.shown:
            print(f"\r\033[K{text[:78]}", end="", file=sys.stderr, flush=True)


def _run(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi, study
    from receding_fenicsx.output.report.text import run_table
    from receding_fenicsx.output.storage.run_folder import has_run, is_finished
    from receding_fenicsx.output.storage.summary_file import read_summary
    from receding_fenicsx.scene.toml_file import read_scene

    scene, out, pictures = (
        read_scene(options.scene, options.overrides),
        options.out,
        options.pictures,
    )
    comm, finished = _needed(comm), False
    if options.resume:
        if options.overwrite:
            raise InputError("--resume and --overwrite: give one of them")
        if options.system is not None:
            raise InputError("--resume and --system: the run has its own system; give one of them")
        finished = comm.bcast(mpi.on_root(comm, lambda: is_finished(Path(out), scene)))
        if finished and options.error:
            raise InputError(
                f"{out}: is finished; errors belong to a run: give --overwrite instead"
            )
        if _is_root(comm) and not has_run(Path(out)):
            print(f"{PROGRAM}: {out}: nothing to resume, starting from rest", file=sys.stderr)
    if not finished:
        with _Progress(comm, options.verbose) as say:
            study.run(
                scene,
                out,
                comm,
                options.overwrite,
                pictures != "none",
                say,
                options.resume,
                options.system,
                None if pictures is None else pictures == "all",
                options.error,
            )
    if _is_root(comm):
        print(run_table(read_summary(Path(out) / "summary.json")))
        print(f"{out}: this run was finished already" if finished else f"written to {out}")


def _condense(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi, study
    from receding_fenicsx.atomic import check_file
    from receding_fenicsx.output.storage.hdf5 import write_system
    from receding_fenicsx.scene.toml_file import read_scene

    scene = read_scene(options.scene, options.overrides)
    comm, path = _needed(comm), Path(options.out)
    mpi.on_root(comm, lambda: check_file(path, options.overwrite))
    with _Progress(comm, options.verbose) as say:
        system = study.condense(scene, comm, say, whole=True)

    def write() -> None:
        assert system is not None
        write_system(path, system, options.overwrite)
        which = "half" if system.half else "whole"
        print(f"{system.n} contact nodes of the {which} body, written to {path}")

    mpi.on_root(comm, write)


def _plot(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import pictures
    from receding_fenicsx.output.storage.hdf5 import read_record

    record = read_record(Path(options.folder) / "record.h5")
    if _is_root(comm):
        for path in pictures.plot(record, Path(options.folder) / "figures"):
            print(path)


def _snapshot(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import pictures

    with _Progress(comm, options.verbose) as say:
        made = pictures.snapshot(
            options.folder, options.cycle, options.leg, options.at, _needed(comm), say
        )
    for path in made or ():
        print(path)


def _animate(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import pictures

    with _Progress(comm) as say:
        made = pictures.animate(
            options.folder, options.cycle, options.frames, options.stress, _needed(comm), say
        )
    for path in made or ():
        print(path)


def _contact_nodes(scene: Scene) -> int:
    """Count the contact nodes; meshes of the user's own and pairs are read and checked for it."""
    plain = len(scene.contacts) == 1 and scene.contacts[0].span is None
    if plain and scene.body.mesh is None and not scene.others and not scene.axisymmetric:
        return scene.mesh.degree * scene.mesh.contact_elements + 1
    from receding_fenicsx.bulk.mesh.meshing import contact_nodes_of

    return sum(contact_nodes_of(scene))


def _export(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi
    from receding_fenicsx.output.storage.export import export

    def work() -> None:
        where = options.cycle, options.leg, options.at
        source, out = Path(options.source), Path(options.out)
        print(f"{export(source, out, where, options.since, options.overwrite)}, written to {out}")

    if comm is None:
        work()
    else:
        mpi.on_root(comm, work)


def _check(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx.mpi import on_root
    from receding_fenicsx.scene.cautions import warnings
    from receding_fenicsx.scene.history import from_scene
    from receding_fenicsx.scene.symmetry import is_mirror_symmetric
    from receding_fenicsx.scene.toml_file import read_scene

    scene = read_scene(options.scene, options.overrides)
    half = scene.solver.symmetry == "auto" and is_mirror_symmetric(scene)
    # commands of a .geo file shall run once
    nodes = _contact_nodes(scene) if comm is None else on_root(comm, lambda: _contact_nodes(scene))
    loads = ", ".join(scene.load_names)
    if _is_root(comm):
        print(
            f"{options.scene}: can be modelled; {nodes} contact nodes, "
            f"{'half of the' if half else 'the whole'} body, loads {loads}, "
            f"{from_scene(scene).cycles} cycles"
        )
        for text in warnings(scene):
            print(f"warning: {text}")


def _doctor(options: argparse.Namespace, comm: MPI.Comm | None) -> int:
    from receding_fenicsx.environment import examine

    missing = False
    with contextlib.suppress(Exception):
        import petsc4py.PETSc  # noqa: F401 - it starts on all ranks together
    if _is_root(comm):
        findings = examine()
        width = max(len(f.name) for f in findings)
        for finding in findings:
            text = finding.version if finding.version is not None else f"MISSING: {finding.advice}"
            print(f"{finding.name:{width}}  {text}")
        missing = any(finding.version is None for finding in findings)
        print("something that is needed is missing" if missing else "all that is needed is there")
    if comm is not None:
        missing = comm.bcast(missing, root=0)
    return 1 if missing else 0
