"""Commands of the command line: ``run``, ``condense``, ``plot``, ``snapshot`` and others."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from receding_fenicsx.cli_parser import PROGRAM
from receding_fenicsx.errors import InputError, RecedingError, SolveError, ToleranceNotMet

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.interface.system import ContactSystem
    from receding_fenicsx.parameter_sweep.sweep import SweepOptions
    from receding_fenicsx.scene.model import Scene


def is_root(comm: MPI.Comm | None) -> bool:
    """Return whether this process prints: rank 0, or a process without MPI."""
    return comm is None or comm.rank == 0


def catch_termination() -> None:
    """Make SIGTERM raise SystemExit, so that unfinished files are removed."""
    with contextlib.suppress(ValueError):  # signals belong to the main thread
        signal.signal(signal.SIGTERM, _terminated)


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)


def _require_mpi(comm: MPI.Comm | None) -> MPI.Comm:
    if comm is None:
        raise RecedingError("mpi4py is not installed; see receding-fenicsx doctor")
    with contextlib.suppress(ImportError):
        from petsc4py import PETSc  # noqa: F401 - its start replaces the handler of SIGTERM
    catch_termination()
    return comm


class _Progress:
    """Progress line on the terminal, overwritten at each step; silent where there is none."""

    def __init__(self, comm: MPI.Comm | None, verbose: int = 0) -> None:
        self.shown = is_root(comm) and sys.stderr.isatty() and not verbose

    def __enter__(self) -> Callable[[str], None]:
        return self.say

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def say(self, text: str) -> None:
        """Show the present stage."""
        if self.shown:
            print(f"\r\033[K{text[:78]}", end="", file=sys.stderr, flush=True)


def _run(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import study
    from receding_fenicsx.output.report.accuracy import unmet
    from receding_fenicsx.output.report.text import run_table
    from receding_fenicsx.output.storage.summary_file import read_summary
    from receding_fenicsx.scene.toml_file import read_scene
    from receding_fenicsx.scene.validate import validate

    scene, out = read_scene(options.scene, options.overrides), options.out
    if options.tolerance is not None:
        scene = replace(scene, accuracy=replace(scene.accuracy, tolerance=options.tolerance))
        validate(scene)
    comm, pictures = _require_mpi(comm), options.pictures
    finished = options.resume and _is_finished(options, scene, comm)
    if not finished:
        with _Progress(comm, options.verbose) as say:
            chosen = study.RunOptions(
                overwrite=options.overwrite,
                pictures=pictures != "none",
                snapshots=None if pictures is None else pictures == "all",
                all_pictures=pictures in ("all", "figures"),
                resume=options.resume,
                system_file=options.system,
                pdf=options.pdf,
                error=options.error,
                starts=options.starts,
                progress=say,
            )
            with contextlib.suppress(ToleranceNotMet):  # raised below, after the table
                study.run(scene, out, chosen, comm)
    summary = read_summary(Path(out) / "summary.json") if is_root(comm) else {}
    if is_root(comm):
        print(run_table(summary))
        print(f"{out}: this run was finished already" if finished else f"written to {out}")
    reason = comm.bcast(unmet(summary))
    if reason:
        raise ToleranceNotMet(reason)


def _is_finished(options: argparse.Namespace, scene: Scene, comm: MPI.Comm) -> bool:
    """Check the options that go with --resume; return whether nothing is left to compute."""
    from receding_fenicsx import mpi
    from receding_fenicsx.output.storage.run_folder import has_run, is_finished

    out = Path(options.out)
    if options.overwrite:
        raise InputError("--resume and --overwrite: give one of them")
    if options.system is not None:
        raise InputError("--resume and --system: the run has its own system; give one of them")
    finished: bool = comm.bcast(mpi.on_root(comm, lambda: is_finished(out, scene)))
    if finished and (options.error or options.starts):
        raise InputError(
            f"{out}: the run is finished, --{'error' if options.error else 'starts'} needs a new "
            "one; give --overwrite, not --resume"
        )
    if is_root(comm) and not has_run(out):
        print(f"{PROGRAM}: {out}: nothing to resume, starting from rest", file=sys.stderr)
    return finished


def _sweep_options(options: argparse.Namespace, say: Callable[[str], None]) -> SweepOptions:
    from receding_fenicsx.parameter_sweep.sweep import SweepOptions

    return SweepOptions(
        overwrite=options.overwrite,
        resume=options.resume,
        folder=Path(options.scene).parent,
        progress=say,
    )


def _sweep(options: argparse.Namespace, comm: MPI.Comm | None) -> int:
    from receding_fenicsx.parameter_sweep.sweep import sweep
    from receding_fenicsx.parameter_sweep.values import read_over
    from receding_fenicsx.scene.toml_file import read_scene

    scene, over = read_scene(options.scene, options.overrides), read_over(options.over)
    comm = _require_mpi(comm)
    with _Progress(comm, options.verbose) as say:
        chosen = _sweep_options(options, say)
        table = sweep(scene, over, options.out, options.workers, options=chosen)
    if table is not None:
        print(f"{table!r}\nwritten to {Path(options.out) / 'sweep.csv'}")
    none_left = table is not None and len(table.failed) == len(table.rows)
    return int(comm.bcast(none_left))


def _shakedown(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx.scene.toml_file import read_scene
    from receding_fenicsx.shakedown_study.study import shakedown

    scene = read_scene(options.scene, options.overrides)
    comm = _require_mpi(comm)
    with _Progress(comm, options.verbose) as say:
        found = shakedown(scene, options.out, options.overwrite, comm, say)
    if found is not None:
        print(f"{found}\nwritten to {options.out}")


def _joint(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    import numpy as np

    from receding_fenicsx.joints.curve import joint_curve
    from receding_fenicsx.output.storage.hdf5 import read_system
    from receding_fenicsx.scene.toml_file import read_scene

    scene: Scene | ContactSystem
    if options.scene.endswith(".h5") and not options.overrides:
        scene = read_system(Path(options.scene))
    else:
        scene = read_scene(options.scene, options.overrides)
    if not 0.0 < options.smallest <= options.largest < np.inf or options.count < 1:
        raise InputError("joint: needs 0 < --from <= --to, and a --count of at least 1")
    amplitudes = np.geomspace(options.smallest, options.largest, options.count)
    comm = _require_mpi(comm)
    with _Progress(comm, options.verbose) as say:
        chosen = _sweep_options(options, say)
        curve = joint_curve(scene, options.drive, amplitudes, options.out, options.workers, chosen)
    if curve is not None:
        print(f"{curve!r}\nwritten to {Path(options.out) / 'joint.csv'}")
    failed = [] if curve is None else [row["error"] for row in curve.table.failed]
    if comm.bcast(curve is not None and len(failed) == len(curve.table)):
        raise SolveError(
            f"joint: all amplitudes failed, the smallest with: {comm.bcast(failed)[0]}"
        )


def _condense(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi, study
    from receding_fenicsx.atomic import check_file
    from receding_fenicsx.output.storage.hdf5 import write_system
    from receding_fenicsx.scene.toml_file import read_scene

    scene = read_scene(options.scene, options.overrides)
    comm, path = _require_mpi(comm), Path(options.out)
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
    if is_root(comm):
        for path in pictures.plot(record, Path(options.folder) / "figures"):
            print(path)


def _snapshot(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import pictures

    with _Progress(comm, options.verbose) as say:
        made = pictures.snapshot(
            options.folder, options.cycle, options.leg, options.at, _require_mpi(comm), say
        )
    for path in made or ():
        print(path)


def _animate(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import pictures

    with _Progress(comm) as say:
        made = pictures.animate(
            options.folder, options.cycle, options.frames, options.stress, _require_mpi(comm), say
        )
    for path in made or ():
        print(path)


def _export(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi
    from receding_fenicsx.exchange.command import export_matrices, export_reduced
    from receding_fenicsx.output.storage.fclib import export

    if options.reduced:
        # PETSc starts on all ranks together
        import receding_fenicsx.exchange.reduced  # noqa: F401

    def work() -> None:
        where = options.cycle, options.leg, options.at
        source, out = Path(options.source), Path(options.out)
        if options.reduced:
            export_reduced(source, out, options.overwrite)
            return
        if options.matrices:
            export_matrices(source, out, options.overwrite)
            return
        print(f"{export(source, out, where, options.since, options.overwrite)}, written to {out}")

    if comm is None:
        work()
    else:
        mpi.on_root(comm, work)


def _import(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx import mpi
    from receding_fenicsx.exchange.command import import_file

    given = options.specification, options.out, options.overwrite
    mpi.on_root(_require_mpi(comm), lambda: import_file(*given))


def _check(options: argparse.Namespace, comm: MPI.Comm | None) -> None:
    from receding_fenicsx.scene.history import history_from_scene
    from receding_fenicsx.scene.symmetry import is_mirror_symmetric
    from receding_fenicsx.scene.toml_file import read_scene
    from receding_fenicsx.scene.validate import scene_warnings
    from receding_fenicsx.study import check

    scene = read_scene(options.scene, options.overrides)
    half = scene.solver.symmetry == "auto" and is_mirror_symmetric(scene)
    nodes = check(scene, _require_mpi(comm))
    loads = ", ".join(scene.load_names)
    if is_root(comm):
        print(
            f"{options.scene}: can be modelled; {nodes} contact nodes, "
            f"{'half of the' if half else 'the whole'} body, loads {loads}, "
            f"{history_from_scene(scene).cycles} cycles"
        )
        for text in scene_warnings(scene):
            print(f"warning: {text}")


def _doctor(options: argparse.Namespace, comm: MPI.Comm | None) -> int:
    from receding_fenicsx.environment import examine

    missing = False
    with contextlib.suppress(Exception):
        import petsc4py.PETSc  # noqa: F401 - it must start on all ranks together
    if is_root(comm):
        findings = examine()
        width = max(len(f.name) for f in findings)
        for finding in findings:
            text = finding.version if finding.version is not None else f"MISSING: {finding.advice}"
            print(f"{finding.name:{width}}  {text}")
        missing = any(finding.version is None for finding in findings)
        print("some requirements are missing" if missing else "all requirements are met")
    if comm is not None:
        missing = comm.bcast(missing, root=0)
    return 1 if missing else 0


COMMANDS: dict[str, Callable[[argparse.Namespace, MPI.Comm | None], int | None]] = {
    "run": _run,
    "condense": _condense,
    "sweep": _sweep,
    "shakedown": _shakedown,
    "joint": _joint,
    "plot": _plot,
    "snapshot": _snapshot,
    "animate": _animate,
    "export": _export,
    "import": _import,
    "check": _check,
    "doctor": _doctor,
}
"""The function of each command; it returns an exit code, None for 0."""
