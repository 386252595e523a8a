"""The command line, ``receding-fenicsx``; under ``mpirun`` all ranks run it together.

Each command is a function: its arguments, their types and defaults, and its docstring are the
options and the help. Libraries are imported when a command needs them: names of ``rf`` are lazy.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter
from rich.console import Console

import receding_fenicsx as rf
from receding_fenicsx.atomic import check_file
from receding_fenicsx.environment import MPI_VARIABLES
from receding_fenicsx.errors import InputError, SolveError, ToleranceNotMet
from receding_fenicsx.mpi import given, leave, on_root
from receding_fenicsx.terminal import (
    PROGRAM,
    catch_termination,
    ending,
    is_root,
    log_to_terminal,
    progress,
    require_mpi,
    world,
)
from receding_fenicsx.timing import Say

if TYPE_CHECKING:
    from mpi4py import MPI

app = App(
    name=PROGRAM,
    help="Frictional receding contact under cyclic loading.",
    version=rf.__version__,
    version_flags=["--version"],
    # no --no-OPTION; "default: False" tells nothing
    default_parameter=Parameter(negative="", show_default=lambda value: value or None),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, by default the process's; return the exit code.

    1: a solver failed, something is missing, or there is no room on the disk or in memory; 2: bad
    input; 130: interrupted.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    in_job = any(MPI_VARIABLES.match(name) for name in os.environ)
    comm = None if {"--help", "-h", "--version"} & {*words} and not in_job else world()
    catch_termination()
    atexit.register(gc.freeze)  # the search for garbage at the exit would take 0.3 s
    try:
        if not words:
            raise InputError(f"a COMMAND is missing; see {PROGRAM} --help")
        console = Console(quiet=not is_root(comm))  # of the help
        command, bound, _ = app.parse_args(
            words, console=console, exit_on_error=False, print_error=False
        )
        log_to_terminal(comm)
        code = int(command(*bound.args, **bound.kwargs) or 0)
        print(end="", flush=True)
        return code
    except BaseException as error:
        if isinstance(error, SystemExit) and not (isinstance(error.code, int) and error.code > 128):
            raise  # no signal, which may have come to this rank alone
        code, text = ending(error)
        if text and is_root(comm):
            lines = [f"{PROGRAM}: {line}" for line in text.splitlines()]
            print("\n".join(lines), file=sys.stderr, flush=True)
        if comm is not None and comm.size > 1:
            leave(comm, code, text)  # a rank that fails alone aborts the job
        if isinstance(error, SystemExit):
            raise
        return code


# -- options of several commands -----------------------------------------------------------------

Verbose = Annotated[int, Parameter(alias="-v", count=True)]
Overwrite = Annotated[bool, Parameter(help="replace what an earlier command wrote there")]
Cycle = Annotated[int, Parameter(help="cycle number; 0 is the first loading")]
Leg = Annotated[str, Parameter(help="leg of the cycle: loading, unloading, or its number from 0")]
SceneFile = Annotated[str, Parameter(name="SCENE", help="scene file (TOML)")]
Folder = Annotated[Path, Parameter(name="DIR", help="run folder")]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Study:
    """Options of commands that model a scene."""

    set: Sequence[str] = ()
    """table.key=value: change a value of the scene (load.NAME.key=value for loads); repeatable"""
    out: Path
    """folder of the results; an HDF5 file of condense"""
    overwrite: Overwrite = False
    verbose: Verbose = 0
    """log stages, cycles, residuals and timings; twice: every change of state too"""

    @contextlib.contextmanager
    def started(self, scene: str) -> Iterator[tuple[rf.Scene, MPI.Comm, Say]]:
        """Yield the scene, all ranks, and what shows the progress."""
        with progress(self.verbose) as say:
            read = rf.read_scene(scene, self.set)
            yield read, require_mpi(), say


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Cases(Study):
    """Options of commands that run many cases of a scene."""

    resume: bool = False
    """continue an interrupted study; cases may have been added"""
    workers: int | None = None
    """run the cases on this number of new processes of this machine (default: on this one). On
    several machines start the command under mpirun instead: rank 0 hands out the cases"""
    shard: str = "1/1"
    """i/n: run the i-th of n shares of the cases only; other jobs run the others in the same
    folder, and the last one writes the results"""

    def options(self, scene: str, say: Say) -> rf.StudyOptions:
        """Return the options of the study; files among values are in the folder of the scene."""
        share = re.fullmatch(r"([0-9]+)/([0-9]+)", self.shard)
        if share is None:
            raise InputError(f"--shard {self.shard}: must be i/n, such as 1/4")
        shares = None if self.shard == "1/1" else (int(share[1]), int(share[2]))
        return rf.StudyOptions(
            self.overwrite, self.resume, None, Path(scene).parent, shares, progress=say
        )

    def show(self, found: object, file: str) -> None:
        """Print the result, which rank 0 has, and where it is, or which share is finished."""
        path, share = self.out / file, f"share {self.shard} is finished; the last one writes"
        if found is not None:
            print(f"{found}\n{'written to' if path.is_file() else share} {path}")


# -- commands ------------------------------------------------------------------------------------


@app.command
def run(
    scene: SceneFile,
    /,
    study: Study,
    *,
    resume: bool = False,
    system: Path | None = None,
    pictures: Literal["all", "figures", "none"] | None = None,
    pdf: bool = False,
    error: bool = False,
    starts: int = 0,
    workers: int | None = None,
    tolerance: float | None = None,
) -> None:
    """Run a study: mesh, condense, evolve, write results, draw pictures.

    Args:
        resume: continue an interrupted run, or extend a finished one by more cycles
        system: reuse a saved system (from condense, or a run's system.h5) without condensing again
        pictures: all: every figure, and snapshots of the body at the turning points of the first
            and the last cycles; figures: every figure, no snapshots, which need the body's mesh.
            Default: the few that answer the scene's question, without the body with --system
        pdf: draw the figures as PDF too
        error: solve on three coarser meshes too and estimate the discretisation error in space
        starts: find the limit (until = "limit") from this number of initial slips too: rest, four
            extreme ones, then random ones; report how far they differ
        workers: find these limits on this number of new processes of this machine
        tolerance: choose the mesh so that the relative errors of the numbers are below it (the
            table [accuracy] names the numbers and the budget)
    """
    with study.started(scene) as (read, comm, say):
        from receding_fenicsx.output.report.run import unmet
        from receding_fenicsx.store.run_folder import has_run, is_finished

        out, finished = study.out, False
        if tolerance is not None:
            read = replace(read, accuracy=replace(read.accuracy, tolerance=tolerance))
            rf.validate(read)
        if resume:
            if study.overwrite or system is not None:
                other = "overwrite" if study.overwrite else "system"
                raise InputError(f"--resume and --{other}: give one of them")
            finished = comm.bcast(on_root(comm, lambda: is_finished(out, read)))
            if finished and (error or starts):
                raise InputError(
                    f"{out}: the run is finished, --{'error' if error else 'starts'} needs a new "
                    "one; give --overwrite, not --resume"
                )
            if is_root(comm) and not has_run(out):
                print(f"{PROGRAM}: {out}: nothing to resume, starting from rest", file=sys.stderr)
        if not finished:
            options = rf.RunOptions(
                overwrite=study.overwrite,
                pictures=pictures != "none",
                snapshots=None if pictures is None else pictures == "all",
                all_pictures=pictures in ("all", "figures"),
                resume=resume,
                system_file=system,
                pdf=pdf,
                error=error,
                starts=starts,
                workers=workers,
                progress=say,
            )
            with contextlib.suppress(ToleranceNotMet):  # raised below, after the table
                rf.run(read, out, options, comm)
    summary = rf.read_summary(out / "summary.json") if is_root(comm) else {}
    if is_root(comm):
        print(rf.run_table(summary))
        print(f"{out}: this run was finished already" if finished else f"written to {out}")
    reason = comm.bcast(unmet(summary))
    if reason:
        raise ToleranceNotMet(reason)


@app.command
def condense(scene: SceneFile, /, study: Study) -> None:
    """Condense the body to its contact nodes and save the system."""
    with study.started(scene) as (read, comm, say):
        on_root(comm, lambda: check_file(study.out, study.overwrite))
        system = rf.condense(read, comm, say, whole=True)
        on_root(comm, lambda: rf.write_system(study.out, given(system), study.overwrite))
    if system is not None:
        which = "half" if system.half else "whole"
        print(f"{system.n} contact nodes of the {which} body, written to {study.out}")


@app.command
def sweep(scene: SceneFile, /, study: Cases, *, over: Sequence[str]) -> int:
    """Run a scene for every combination of values; write a table.

    The folder gets sweep.csv (a row for each case), sweep.json (scene, keys, versions) and
    cases.jsonl (finished cases, to resume from).

    Args:
        over: table.key=values, values of one key, as for --set: a list 0,0.25,0.5 or a range
            first:last:number, as in contact.friction=0.1:0.9:9; repeatable for all combinations
    """
    with study.started(scene) as (read, comm, say):
        from receding_fenicsx.studies.sweep import read_over

        options = study.options(scene, say)
        table = rf.sweep(read, read_over(list(over)), study.out, study.workers, options=options)
    study.show(table, "sweep.csv")
    none_left = table is not None and len(table.failed) == len(table.rows)
    return int(comm.bcast(none_left))


@app.command
def shakedown(scene: SceneFile, /, study: Cases) -> None:
    """Find the load range up to which the contact stops slipping."""
    with study.started(scene) as (read, _, say):
        found = rf.shakedown(read, study.out, study.workers, study.options(scene, say))
    study.show(found, "shakedown.json")


@app.command
def wear(scene: SceneFile, /, study: Study, *, resume: bool = False) -> None:
    """Wear the contact over many cycles (table [wear] of the scene).

    The folder gets wear.csv (a row for each step), wear.json, wear.npz and figures.

    Args:
        resume: continue an interrupted study, or one for fewer cycles
    """
    with study.started(scene) as (read, _, say):
        options = rf.StudyOptions(study.overwrite, resume, progress=say)
        found = rf.wear(read, study.out, options)
    if found is not None:
        print(f"{found}\nwritten to {study.out}")


@app.command
def joint(
    scene: SceneFile,
    /,
    study: Cases,
    *,
    drive: str,
    smallest: Annotated[float, Parameter(name="--from")],
    largest: Annotated[float, Parameter(name="--to")],
    count: int = 30,
) -> None:
    """Find dissipation and stiffness over the amplitude of a driven load.

    The folder gets joint.csv (a row for each amplitude), joint.json and joint.png.

    Args:
        scene: scene file (TOML), or a saved system
        drive: driven load, or mode:1, mode:2
        smallest: smallest amplitude, as a load factor
        largest: largest amplitude, as a load factor
        count: number of amplitudes, log spaced
    """
    with progress(study.verbose) as say:
        import numpy as np

        is_system = scene.endswith(".h5") and not study.set
        read: Any = rf.read_system(Path(scene)) if is_system else rf.read_scene(scene, study.set)
        if not 0.0 < smallest <= largest < np.inf or count < 1:
            raise InputError("joint: needs 0 < --from <= --to, and a --count of at least 1")
        amplitudes, comm = np.geomspace(smallest, largest, count), require_mpi()
        options = study.options(scene, say)
        curve = rf.joint_curve(read, drive, amplitudes, study.out, study.workers, options)
    study.show(curve, "joint.csv")
    failed = [] if curve is None else [row["error"] for row in curve.table.failed]
    reason = failed[0] if curve is not None and len(failed) == len(curve.table) else ""
    if reason := comm.bcast(reason):
        raise SolveError(f"joint: all amplitudes failed, the smallest with: {reason}")


@app.command
def plot(folder: Folder, /) -> None:
    """Draw the figures of a finished run again, as PNG and PDF."""
    record = rf.read_record(folder / "record.h5")
    if is_root(world()):
        print(*rf.plot(record, folder / "figures"), sep="\n")


@app.command
def snapshot(
    folder: Folder, /, *, cycle: Cycle, leg: Leg, at: float = 1.0, verbose: Verbose = 0
) -> None:
    """Draw the body of a finished run at one instant.

    Args:
        at: position along the leg, 0 to 1
        verbose: log stages and timings
    """
    with progress(verbose) as say:
        made = rf.snapshot(folder, cycle, leg, at, require_mpi(), say)
    if made:
        print(*made, sep="\n")


@app.command
def animate(
    folder: Folder,
    /,
    *,
    cycle: Cycle,
    frames: int = 60,
    stress: Literal["max_shear", "von_mises", "sxx", "syy", "sxy"] = "max_shear",
) -> None:
    """Make an animation of one cycle of a finished run.

    Args:
        frames: number of frames
        stress: quantity shown; max_shear is drawn as fringes
    """
    with progress() as say:
        made = rf.animate(folder, cycle, frames, stress, require_mpi(), say)
    if made:
        print(*made, sep="\n")


@app.command
def export(
    source: Annotated[Path, Parameter(name="SOURCE")],
    /,
    *,
    out: Path,
    overwrite: Overwrite = False,
    matrices: bool = False,
    reduced: bool = False,
    cycle: Cycle = 0,
    leg: Leg = "0",
    at: float = 1.0,
    since: float | None = None,
) -> None:
    """Export a load step in FCLIB's format, or the matrices, for other programs.

    Args:
        source: run folder, file of a saved system, or with --reduced a scene
        out: HDF5 file; folder of --matrices
        matrices: write K, r* and the nodes of the system as MatrixMarket and CSV
        reduced: write mass, stiffness and contact of the joint, reduced to its contact nodes and
            [mode] count modes (Craig and Bampton)
        at: end of the load step along the leg, 0 to 1
        since: start of the load step; default: 1 / solver.steps_per_leg before its end
    """
    from receding_fenicsx.exchange.importing import export_matrices

    if reduced:
        # PETSc starts on all ranks together
        from receding_fenicsx.exchange.reduced import export_reduced

    def work() -> None:
        if reduced:
            export_reduced(source, out, overwrite)
        elif matrices:
            export_matrices(source, out, overwrite)
        else:
            told = rf.export(source, out, (cycle, leg, at), since, overwrite)
            print(f"{told}, written to {out}")

    on_root(require_mpi() if reduced else world(), work)


@app.command(name="import")
def import_(
    specification: Annotated[str, Parameter(name="IMPORT")],
    /,
    *,
    out: str,
    overwrite: Overwrite = False,
) -> None:
    """Make a system of matrices of Abaqus, CalculiX or others (MatrixMarket).

    Args:
        specification: names of matrices and nodes (TOML)
        out: HDF5 file of the system
    """
    from receding_fenicsx.exchange.importing import import_file

    on_root(world(), lambda: import_file(specification, out, overwrite))


@app.command
def check(scene: SceneFile, /, *, set: Sequence[str] = ()) -> None:
    """Validate a scene without running it.

    Args:
        set: table.key=value: change a value of the scene; repeatable
    """
    from receding_fenicsx.scene.symmetry import is_mirror_symmetric
    from receding_fenicsx.studies import run as study

    read, comm = rf.read_scene(scene, set), require_mpi()
    half = read.solver.symmetry == "auto" and is_mirror_symmetric(read)
    nodes = study.check(read, comm)
    if is_root(comm):
        print(
            f"{scene}: can be modelled; {nodes} contact nodes, "
            f"{'half of the' if half else 'the whole'} body, loads {', '.join(read.load_names)}, "
            f"{rf.history_from_scene(read).cycles} cycles"
        )
        for text in rf.scene_warnings(read):
            print(f"warning: {text}")


@app.command
def schema() -> None:
    """Print the JSON Schema of scene files, by which editors complete and check them."""
    import json

    from receding_fenicsx.scene.toml_reader import scene_schema

    if is_root(world()):
        print(json.dumps(scene_schema(), indent=2))


@app.command
def doctor() -> int:
    """List installed versions and test the installation."""
    from receding_fenicsx.arrays import aligned
    from receding_fenicsx.environment import examine

    comm, missing = world(), False
    with contextlib.suppress(Exception):
        import petsc4py.PETSc  # noqa: F401 - it must start on all ranks together
    if is_root(comm):
        findings = examine()
        rows = [[f.name, f.version or f"MISSING: {f.advice}"] for f in findings]
        print(*aligned(rows), sep="\n")
        missing = any(finding.version is None for finding in findings)
        print("some requirements are missing" if missing else "all requirements are met")
    return int(missing if comm is None else comm.bcast(missing))
