"""Run a scene: mesh, assemble, condense, evolve, write files, draw pictures; time each stage."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx import environment, mpi
from receding_fenicsx.arrays import Array, check_types
from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.bulk.from_scene import condensed, is_small, probes_of
from receding_fenicsx.errors import (
    InputError,
    MeshMisfit,
    NoEquilibrium,
    NoQuasiStaticContinuation,
    SolveError,
    ToleranceNotMet,
)
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.evolve import continue_history, evolve, evolve_bare
from receding_fenicsx.evolution.histories import CORNERS, tightened, with_corners
from receding_fenicsx.evolution.journal import JOURNAL, Journal, JournalFolder
from receding_fenicsx.evolution.problem import problem_of_scene, system_for, with_profiles
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.mpi import world
from receding_fenicsx.output.report import summary
from receding_fenicsx.output.report.run import limit_summary
from receding_fenicsx.pictures import begin_figures, draw_run, start_drawing
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.validate import validate
from receding_fenicsx.store.hdf5 import read_system, write_record, write_system
from receding_fenicsx.store.run_folder import SYSTEM, shared_folder, write_probes, write_summary
from receding_fenicsx.store.workspace import CASES, CaseFile, interruption, locked, resumable
from receding_fenicsx.studies.accuracy import meshes, study
from receding_fenicsx.studies.accuracy.study import Solved
from receding_fenicsx.studies.runner import Kind, Runner, StudyOptions, check_workers, on_ranks
from receding_fenicsx.studies.starts import starts_summary, steady_states
from receding_fenicsx.timing import Countdown, Say, Timer

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True)
class RunOptions:
    """What a run writes and draws, and what it starts from.

    Attributes:
        overwrite: replace the folder of an earlier run.
        pictures: draw figures and snapshots that answer the scene's question; needs an output
            folder.
        snapshots: draw the body too, which needs it meshed and factored; None draws it unless there
            is a ``system_file``.
        resume: continue from the last checkpoint of an interrupted run in ``OUT.part``, or of a
            finished one in ``OUT`` for more cycles; start from rest where there is none.
        system_file: a saved system of the same body, material, mesh, contact edges, loads and
            supports, used instead of condensing again; the body is not meshed.
        all_pictures: draw all figures, and snapshots at the turning points of the first and the
            last cycles.
        pdf: draw the figures as PDF too.
        error: solve on coarser meshes too, and estimate the space errors of the headline numbers;
            needs an output folder.
        starts: number of initial slips from which the limit is found too; 0: only the scene's own.
            They need an output folder.
        workers: number of new processes that find these limits; default: this process.
        tolerance: choose the mesh by the errors of the numbers, as ``accuracy.tolerance`` of the
            scene, which it replaces.
        progress: called on rank 0 with a text about each stage and each cycle.
    """

    overwrite: bool = False
    pictures: bool = True
    snapshots: bool | None = None
    all_pictures: bool = False
    resume: bool = False
    system_file: str | Path | None = None
    pdf: bool = False
    error: bool = False
    starts: int = 0
    workers: int | None = None
    tolerance: float | None = None
    progress: Say | None = None


def run(
    scene: Scene,
    out: str | Path | None = None,
    options: RunOptions = RunOptions(),
    comm: MPI.Comm | None = None,
) -> Record | None:
    """Run a scene from its mesh to its record, files and pictures; all ranks call this together.

    Args:
        scene: what is modelled.
        out: folder of the results, see :mod:`receding_fenicsx.store`; None writes nothing.
        options: what is written and drawn, and what the run starts from.
        comm: communicator; all processes of the job when left out.

    Returns:
        The record on rank 0, None on the others.

    Raises:
        RecedingError: on all ranks alike. When the evolution fails on the way, ``out`` holds the
            record up to there, and its summary the reason under "failure".
        Interrupted: a signal asked to end; ``OUT.part`` can be resumed.
    """
    check_types(
        "run", scene=(scene, Scene), out=(out, str, Path, None), options=(options, RunOptions)
    )
    if out is None and (options.error or options.starts):
        raise InputError("run: errors and starts are results of its folder; give out")
    if options.tolerance is not None:
        scene = replace(scene, accuracy=replace(scene.accuracy, tolerance=options.tolerance))
    validate(scene)
    if options.starts and options.starts < 2:
        raise InputError(f"--starts: {options.starts} given; give at least 2, or leave it out")
    if options.starts and scene.history.until != "limit":
        raise InputError('--starts: needs [history] until = "limit"; set it, or leave out --starts')
    comm = comm or world()
    check_workers(options.workers, comm)
    if scene.accuracy.tolerance is not None and options.system_file is not None:
        raise InputError("--system: a search for a tolerance makes its own systems; leave it out")
    if options.error and scene.accuracy.tolerance is None:
        scene = study.with_coarser_partner(scene)
    timer = Timer(options.progress if comm.rank == 0 else None)
    body = options.system_file is None if options.snapshots is None else options.snapshots
    everything, formats = options.all_pictures, ("png", "pdf") if options.pdf else ("png",)
    with shared_folder(comm, out, scene, options.overwrite, options.resume) as folder:
        if options.pictures and out is not None:
            mpi.on_root(comm, lambda: start_drawing(body))
        found = _found(scene, comm, timer, folder, options)
        if options.starts and found.failure is None:
            found.extra.update(_starts(found, comm, timer, folder, options))
        record, failure = found.record, found.failure

        def begun() -> Callable[[], Any]:
            place = mpi.given(folder) / "figures"
            return begin_figures(mpi.given(record), place, formats, everything)

        def written() -> dict[str, Any]:
            place, own = mpi.given(folder), mpi.given(record)
            write_record(place / "record.h5", own, overwrite=True)
            write_probes(place / "probes", own)
            return summary.summarise(own, found.extra)

        def write_costs() -> None:
            costs = environment.costs(comm, timer.seconds)
            file = mpi.given(folder) / "summary.json" if comm.rank == 0 else Path()
            mpi.on_root(comm, lambda: write_summary(file, mpi.given(text) | costs, True))

        if out is not None:
            drawn = options.pictures and (failure is None or isinstance(failure, ToleranceNotMet))
            figures = mpi.on_root(comm, begun) if drawn else None
            # written before the pictures too, which may fail
            text = mpi.on_root(comm, written)
            write_costs()
            with resumable(folder, "while drawing"), timer("pictures"):
                if drawn:
                    run_of = (found.scene, found.system, record, folder, figures)
                    draw_run(comm, *run_of, body=body, everything=everything, say=timer.say)
                    if "accuracy" in found.extra:
                        from receding_fenicsx.output.plots.study_plots import draw_search

                        place = mpi.given(folder) / "figures" if comm.rank == 0 else Path()
                        mpi.on_root(comm, lambda: draw_search(found.extra["accuracy"], place))
            write_costs()
            scene_toml = "" if record is None else record.scene_toml
            mpi.on_root(comm, lambda: summary.write_report(mpi.given(folder), scene_toml))
    if failure is not None:
        raise failure
    return record


def _found(
    scene: Scene, comm: MPI.Comm, timer: Timer, folder: Path | None, options: RunOptions
) -> Solved:
    """Run a scene on its mesh, with or without errors, or on one that meets its tolerance."""

    def solve(meshed: Scene) -> Solved:
        system, extra = _system(meshed, comm, timer, folder, options.system_file)
        with timer("evolve"):
            record, failure = mpi.on_root(
                comm, lambda: run_history(meshed, mpi.given(system), folder, timer.say)
            ) or (None, None)
        failure = comm.bcast(failure)
        if meshed.history.kind == "harmonic" or meshed.bolts:
            # with the number of corners and the shortenings that were found
            meshed = comm.bcast(None if record is None else record.scene)
        if failure is not None:
            extra["failure"] = str(failure)
        return Solved(meshed, system, record, failure, extra)

    if scene.accuracy.tolerance is not None:
        with resumable(folder, "between meshes", "the meshes that are solved", CASES):
            found = study.within_tolerance(scene, comm, folder, solve, timer.say)
    else:
        found = solve(scene)

    def on_mesh(coarse: Scene, play: Callable[..., Record] = evolve_bare) -> Record | None:
        system = condense(coarse, comm)
        return mpi.on_root(comm, lambda: play(mpi.given(system), coarse))

    # bolts have their preloads on coarser meshes too, not the shortenings of this one
    own, coarse = replace(found.scene, bolts=scene.bolts), None
    errors = options.error and scene.accuracy.tolerance is None  # a search has its own
    failed = found.failure is not None and not isinstance(found.failure, ToleranceNotMet)
    if failed or not (errors or own.fatigue):
        return found
    with resumable(folder, "on a coarser mesh"), timer("errors"):
        if errors:
            kept = study.Meshes(comm, folder)
            found.extra |= study.errors_of_run(own, found.record, on_mesh, kept)
        if own.fatigue is not None:
            with suppress(MeshMisfit, NoEquilibrium, NoQuasiStaticContinuation):  # no estimate
                partner = meshes.partner(own, comm)
                coarse = None if partner is None else on_mesh(partner, evolve)
            more = mpi.on_root(comm, lambda: fatigue_summary(mpi.given(found.record), coarse))
            found.extra |= more or {}
    return found


def _starts(
    found: Solved, comm: MPI.Comm, timer: Timer, folder: Path | None, options: RunOptions
) -> dict[str, Any]:
    """Return the limits from further initial slips, on rank 0; collective."""

    def limits(executor: Executor | None) -> dict[str, Any]:
        file, progress = CaseFile(mpi.given(folder)), StudyOptions(progress=timer.say)
        runner = Runner(Kind("starts"), progress, file, options.workers, executor)
        system, record = mpi.given(found.system), mpi.given(found.record)
        states = steady_states(system, found.scene, options.starts, runner=runner)
        return {"limit": {**limit_summary(record)["limit"], "starts": starts_summary(states)}}

    with resumable(folder, "between starts"), timer("starts"):
        return on_ranks(comm, limits) or {}


def _system(
    scene: Scene,
    comm: MPI.Comm,
    timer: Timer,
    folder: Path | None,
    system_file: str | Path | None,
) -> tuple[ContactSystem | None, dict[str, Any]]:
    """Return the scene's system on rank 0, saved or newly condensed, and data for the summary."""
    place = None if folder is None else folder / SYSTEM
    saved = None if system_file is None else Path(system_file)

    def known() -> ContactSystem | None:
        resumed = place is not None and place.is_file()
        file = place if resumed else saved
        return None if file is None else read_system(file, scene)

    system = mpi.on_root(comm, known)
    found, lacks_probes = comm.bcast(
        (system is not None, system is not None and system.probes is None and bool(scene.probes))
    )
    more, bare = {}, None
    if not found:
        bare, dofs = condensed(scene, comm, timer)
        more = {"bulk_dofs": dofs}
    elif lacks_probes:  # meshed for them alone
        probes = probes_of(scene, comm, timer)
        system = None if system is None else replace(system, probes=probes)

    def kept() -> ContactSystem:
        own, new = system, place is not None and not place.is_file()
        if own is None:
            whole = with_profiles(scene, mpi.given(bare))
            own = system_for(scene, whole)
        elif new:
            whole = with_profiles(scene, read_system(mpi.given(saved)))
            whole = replace(whole, probes=own.probes)
        if new:
            write_system(mpi.given(place), whole)
        return own

    return mpi.on_root(comm, kept), more


def condense(
    scene: Scene, comm: MPI.Comm | None = None, progress: Say | None = None, whole: bool = False
) -> ContactSystem | None:
    """Mesh, assemble and condense a scene; all ranks call this together.

    Args:
        scene: what is modelled.
        comm: communicator; all processes of the job when left out.
        progress: called on rank 0 with the name of each stage.
        whole: keep the tangential displacements of a contact without friction too, so that the
            system can be used with friction later.

    Returns:
        The condensed system on rank 0, None on the others.
    """
    validate(scene)
    comm = comm or world()
    if any(load.mode for load in scene.loads):
        from receding_fenicsx.modal import mode_system

        return mpi.on_root(comm, lambda: mode_system(scene)[0])
    system, _ = condensed(scene, comm, Timer(progress if comm.rank == 0 else None))
    prepare = with_profiles if whole else system_for
    return mpi.on_root(comm, lambda: prepare(scene, mpi.given(system)))


def check(scene: Scene, comm: MPI.Comm | None = None) -> int:
    """Do what a run does before its first leg, and return the number of contact nodes; collective.

    A large scene is condensed on a coarser mesh.
    """
    # PETSc starts on all ranks together
    import receding_fenicsx.bulk.mesh.meshing  # noqa: F401

    validate(scene)
    comm = comm or world()

    def meshed() -> tuple[int, Scene | None]:
        coarse: Scene | None
        nodes, coarse = meshes.count_nodes(scene), scene
        # the finest mesh that is condensed takes a second or so
        while coarse is not None and (coarse.mesh.contact_elements > 320 or not is_small(coarse)):
            try:
                coarse = meshes.coarser(coarse)
            except MeshMisfit:
                coarse = None
        return nodes, coarse

    nodes, coarse = comm.bcast(mpi.on_root(comm, meshed))
    if coarse is not None:
        system = condense(coarse, comm)
        bolts = tuple(replace(b, preload=None, shortening=b.shortening or 1.0) for b in scene.bolts)
        mpi.on_root(comm, lambda: problem_of_scene(mpi.given(system), replace(coarse, bolts=bolts)))
    return int(nodes)


log = logging.getLogger(__name__)


def run_history(
    scene: Scene,
    system: ContactSystem,
    folder: Path | None,
    say: Say | None = None,
) -> tuple[Record, SolveError | None]:
    """Evolve a scene's history, from the last checkpoint in its folder if there is one.

    Returns the record, whose scene has the number of corners of a harmonic history, and the error
    that ended the history early if one did; one of the very first leg is raised. Interrupted: a
    signal asked to end; the folder holds the record of the finished cycles.
    """
    every = scene.output.checkpoint_cycles
    journal: Journal = Journal(every)
    if folder is not None:
        journal = JournalFolder(folder / JOURNAL, system, every)
        if journal.cycles:
            log.info("resumes from the checkpoint after cycle %d", len(journal.cycles) - 1)
    doubling = problem = None
    tell = Countdown(say, "evolve: cycle", "at most")

    try:
        scene, doubling = _with_corners(scene, system, folder, say)
        problem = problem_of_scene(system, scene)
        record = continue_history(problem, journal, tell)
        record.doubling = doubling
        return record, None
    except SolveError as error:
        # a history that fails in its very first leg leaves nothing worth keeping
        if not isinstance(error.record, Record) or not len(error.record.turning_points.s):
            raise
        record, error.record = error.record, None
        record.doubling = doubling
        return record, error
    except (KeyboardInterrupt, SystemExit) as signalled:
        if folder is None or problem is None or not journal.cycles:
            raise
        last, cycles = len(journal.cycles) - 1, history.history_from_scene(scene).cycles
        where = f"after cycle {last} of {cycles}"
        record = record_of(problem.system, problem.solver, journal.cycles)
        record.doubling = doubling
        write_record(folder / "record.h5", record, overwrite=True)
        brief = summary.summarise(record, {"failure": f"interrupted {where}"})
        write_summary(folder / "summary.json", brief, overwrite=True)
        raise interruption(signalled, where, folder, "the record up to there") from None
    finally:
        journal.write()


def _with_corners(
    scene: Scene, system: ContactSystem, folder: Path | None, say: Say | None
) -> tuple[Scene, Array | None]:
    """Return the scene with the corners of its harmonic history, those of the run it resumes."""
    scene = tightened(system, scene)
    file = None if folder is None else folder / CORNERS
    if file is not None and file.is_file():
        try:
            doubling = np.loadtxt(file, ndmin=2)
            corners = int(doubling[-1, 0])
        except (OSError, ValueError, IndexError):
            raise InputError(f"{file}: is damaged; start a new run with --overwrite") from None
        return replace(scene, history=replace(scene.history, corners=corners)), doubling
    scene, found = with_corners(system, scene, say)
    if file is not None and found is not None:
        with new_file(file) as beside:
            np.savetxt(beside, found, header="corners, error estimate of the dissipation")
    return scene, found


# -- condensed systems that the cases of a study share -------------------------------------------

_systems: dict[str, ContactSystem] = {}
"""Last condensed systems of this process, by the digest of their scenes."""


def shared_system(scene: Scene, body: str, folder: Path | None = None) -> ContactSystem:
    """Return the condensed system of a case from memory, from a file, or newly condensed.

    It serves any friction. ``body`` is the scene's
    :func:`~receding_fenicsx.scene.identity.body_of`. In a folder all processes share their systems:
    the first that needs one condenses it.
    """
    if body in _systems:
        return _systems[body]

    def condensed_here() -> ContactSystem:
        with suppress(ImportError):
            import dolfinx_solver  # noqa: F401 - PyPI's stack must be loaded before mpi4py
        from mpi4py import MPI

        if "petsc4py.PETSc" not in sys.modules:
            import petsc4py

            # PETSc's start is collective, and the other ranks may be elsewhere
            petsc4py.init(comm=MPI.COMM_SELF)
        return mpi.given(condense(scene, MPI.COMM_SELF, whole=True))

    found = None
    if folder is None:
        found = condensed_here()
    else:
        path = folder / f"{body}.h5"
        make_folder(folder)
        with locked(path.with_suffix(".lock"), wait=True):
            with suppress(InputError):  # missing or damaged
                found = read_system(path)
            if found is None:
                write_system(path, condensed_here(), overwrite=True)
                found = read_system(path)
    while len(_systems) >= 2:  # a process keeps two
        del _systems[next(iter(_systems))]
    _systems[body] = found
    return found
