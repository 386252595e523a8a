"""The whole way: mesh, assemble, condense, evolve, pictures, files; the time of each stage."""

from __future__ import annotations

import logging
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from receding_fenicsx import errors, estimate, history, long_run
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.interface.contact import friction_margin
from receding_fenicsx.output import files, summary
from receding_fenicsx.output.collect import Instant
from receding_fenicsx.output.record import Record
from receding_fenicsx.output.run_folder import SYSTEM, run_folder
from receding_fenicsx.replay import state_at
from receding_fenicsx.reuse import system_for
from receding_fenicsx.scene import Scene
from receding_fenicsx.scene_checks import is_half_meshed
from receding_fenicsx.scene_file import from_toml

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.pair import Pair
    from receding_fenicsx.interface.contact import ContactSystem

T = TypeVar("T")

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Told what is being done, on rank 0."""

PICTURE_GROWTH = (1.0, 1.1)
"""Largest size ratio between neighbouring layers of a mesh that pictures are drawn on: with up to
``PICTURE_CELLS`` cells of the contact elements' size, and with more."""
PICTURE_CELLS = 30_000

SMALL_CELLS = 30_000
"""Cells, about, up to which rank 0 condenses a rectangle by itself."""
SMALL_FILE = 10_000_000
"""The same for a user's mesh: bytes of its file."""

STAGES = ("mesh", "assemble", "condense", "evolve", "pictures")


class Timer:
    """Seconds spent in each stage."""

    def __init__(self, say: Say | None = None) -> None:
        """Start with nothing spent; ``say`` is told the name of each stage as it begins."""
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.say = say

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to a stage."""
        if self.say is not None:
            self.say(stage)
        begin = time.perf_counter()
        try:
            yield
        finally:
            spent = self.seconds.get(stage, 0.0)
            self.seconds[stage] = spent + time.perf_counter() - begin
            log.info("%s: %.3f s", stage, self.seconds[stage])


def run(
    scene: Scene,
    out: str | Path | None = None,
    comm: MPI.Comm | None = None,
    overwrite: bool = False,
    pictures: bool = True,
    progress: Say | None = None,
    resume: bool = False,
    system_file: str | Path | None = None,
    snapshots: bool | None = None,
    error: bool = False,
) -> Record | None:
    """Go the whole way from a scene to its record; all ranks call this together.

    Args:
        scene: what is modelled.
        out: folder for ``record.h5``, ``summary.json``, ``system.h5``, ``report.html`` and the
            pictures; it appears when all of it is written. Until then the run lives beside it, in
            ``OUT.part``. None writes nothing.
        comm: communicator; all processes of the job when left out.
        overwrite: replace the folder of an earlier run.
        pictures: draw figures and snapshots; needs ``out``.
        progress: told on rank 0 what is being done.
        resume: go on from the last checkpoint of an interrupted run in ``OUT.part``, or of a
            finished one in ``out`` for more cycles; begin where there is none.
        system_file: a saved system of the same body, material, mesh, contact edges, loads and
            supports, to be used instead of condensing again; the body is not touched.
        snapshots: draw the body too, which needs it meshed and factored; when left out, unless
            there is a ``system_file``.
        error: solve on coarser meshes too, and estimate the space errors of the headline numbers.

    Returns:
        The record on rank 0, None on the others.

    Raises:
        RecedingError: on all ranks alike. When the evolution fails on the way, ``out`` holds the
            record up to there, its summary the reason under "failure".
        Interrupted: a signal asked to end; ``OUT.part`` holds the record up to there and can be
            gone on with.
    """
    scene.validate()
    if error:
        estimate.check(scene)
    comm = comm or _world()
    timer = Timer(progress if comm.rank == 0 else None)
    if snapshots is None:
        snapshots = system_file is None
    with _folder(comm, out, scene, overwrite, resume) as folder:
        system, extra = _system(scene, comm, timer, folder, system_file)
        with timer("evolve"):
            evolved = errors.on_root(
                comm, lambda: long_run.run_history(scene, _given(system), folder, timer.say)
            )
        record, failure = evolved or (None, None)
        failure = comm.bcast(failure)
        if failure is not None:
            extra["failure"] = str(failure)
        if system is not None:
            extra["friction_margin"] = friction_margin(system)
        if error and failure is None:
            with timer("errors"):
                extra |= estimate.errors_of_run(scene, record, comm)
        if out is not None:
            # before the pictures, so that it is there whatever becomes of them
            errors.on_root(comm, lambda: _write_record(folder, record))
            _write_summary(comm, folder, record, extra, timer)
            with timer("pictures"):
                if pictures and failure is None:
                    _pictures(scene, comm, system, record, folder, snapshots)
            _write_summary(comm, folder, record, extra, timer)
            errors.on_root(comm, lambda: _write_report(folder, record))
    if failure is not None:
        raise failure
    return record


def _system(
    scene: Scene,
    comm: MPI.Comm,
    timer: Timer,
    folder: Path | None,
    system_file: str | Path | None,
) -> tuple[ContactSystem | None, dict[str, Any]]:
    """Return the scene's system on rank 0, saved or condensed, and what is known of the body."""

    def saved() -> ContactSystem | None:
        place = None if folder is None else folder / SYSTEM
        if place is not None and place.is_file():
            return files.read_system(place, scene)
        if system_file is None:
            return None
        whole = files.read_system(Path(system_file))
        system = files.read_system(Path(system_file), scene)
        if place is not None:
            whole = replace(whole, f=system.f, g0=system.g0, scene_toml=system.scene_toml)
            files.write_system(place, whole)
        return system

    system = errors.on_root(comm, saved)
    if comm.bcast(system is not None):
        return system, {}
    whole, dofs = _condensed(scene, comm, timer)

    def keep() -> ContactSystem:
        if folder is not None:
            files.write_system(folder / SYSTEM, _given(whole))
        return system_for(scene, _given(whole))

    return errors.on_root(comm, keep), {"bulk_dofs": dofs}


def is_small(scene: Scene) -> bool:
    """Return whether rank 0 condenses a scene's body by itself.

    For small bodies that is quicker than together, and it gives the same bits at every start and
    on any number of ranks: several ranks number and add up in the order in which messages come.
    """
    n, growth = scene.mesh.contact_elements, scene.mesh.growth
    for body in scene.bodies:
        if body.mesh is not None:
            if Path(body.mesh).stat().st_size > SMALL_FILE:
                return False
            continue
        # a layer of size dx growth^k has n / growth^k elements side by side
        layers = n * body.height / body.width
        if growth > 1.0:
            layers = min(layers, growth / (growth - 1.0))
        if 2.0 * n * layers > SMALL_CELLS:
            return False
    return True


def _condensed(scene: Scene, comm: MPI.Comm, timer: Timer) -> tuple[ContactSystem | None, int]:
    """Mesh, assemble and condense; return the system on rank 0, and the body's freedoms."""
    from receding_fenicsx.bulk import condensation

    if comm.size > 1 and is_small(scene):
        from mpi4py import MPI

        alone = errors.on_root(comm, lambda: _condensed(scene, MPI.COMM_SELF, timer))
        return alone or (None, 0)
    bulk = _bulk(scene, comm, timer)
    try:
        with timer("condense"):
            return condensation.condense(bulk), bulk.dofs
    finally:
        bulk.destroy()


def condense(
    scene: Scene, comm: MPI.Comm | None = None, progress: Say | None = None, whole: bool = False
) -> ContactSystem | None:
    """Mesh, assemble and condense a scene; all ranks call this together.

    Args:
        scene: what is modelled.
        comm: communicator; all processes of the job when left out.
        progress: told on rank 0 what is being done.
        whole: keep the tangential displacements also of a contact without friction, so that the
            system may serve one with friction too.

    Returns:
        The condensed system on rank 0, None on the others.
    """
    scene.validate()
    comm = comm or _world()
    system, _ = _condensed(scene, comm, Timer(progress if comm.rank == 0 else None))
    if whole:
        return system
    return errors.on_root(comm, lambda: system_for(scene, _given(system)))


def snapshot(
    folder: str | Path,
    cycle: int,
    leg: str,
    at: float = 1.0,
    comm: MPI.Comm | None = None,
    progress: Say | None = None,
) -> list[Path] | None:
    """Draw the body at one instant of a finished run; all ranks call this together.

    Args:
        folder: folder of the run; pictures go to its ``snapshots``.
        cycle: cycle, 0 for the first loading.
        leg: "loading", "unloading" or the number of the leg in the cycle.
        at: position along the leg, in [0, 1].
        comm: communicator; all processes of the job when left out.
        progress: told on rank 0 what is being done.

    Returns:
        The files that were made, on rank 0; None on the others.
    """
    snapshots = _drawing("snapshots")
    comm = comm or _world()
    folder = Path(folder)
    timer = Timer(progress if comm.rank == 0 else None)

    def find() -> tuple[str, Instant]:
        record = files.read_record(folder / "record.h5")
        scene = from_toml(record.scene_toml)
        system = files.read_system(folder / "system.h5", scene)
        return record.scene_toml, instant_of(scene, system, record, cycle, leg, at)

    text, instant = comm.bcast(errors.on_root(comm, find))
    bulk = picture_body(from_toml(text), comm)
    try:
        with timer("pictures"):
            return snapshots.snapshot(bulk, instant, folder / "snapshots")
    finally:
        bulk.destroy()


def animate(
    folder: str | Path,
    cycle: int,
    frames: int = 60,
    stress: str = "max_shear",
    comm: MPI.Comm | None = None,
    progress: Say | None = None,
) -> list[Path] | None:
    """Make a film of one cycle of a finished run; all ranks call this together.

    Args:
        folder: folder of the run; films go to its ``animations``.
        cycle: cycle, 0 for the first loading.
        frames: pictures, spread over the legs by the loads' way in each.
        stress: what is drawn: "max_shear" (as fringes), "von_mises", "sxx", "syy" or "sxy".
        comm: communicator; all processes of the job when left out.
        progress: told on rank 0 what is being done.

    Returns:
        The files that were made, .mp4 and .gif, on rank 0; None on the others.
    """
    animation, snapshots = _drawing("animation"), _drawing("snapshots")
    comm = comm or _world()
    folder = Path(folder)
    timer = Timer(progress if comm.rank == 0 else None)
    quantity = snapshots.quantity_of(stress)

    def find() -> tuple[str, Any]:
        record = files.read_record(folder / "record.h5")
        scene = from_toml(record.scene_toml)
        system = files.read_system(folder / "system.h5", scene)
        legs, at, time = history.spread(history.from_scene(scene), cycle, frames)
        instants = [
            instant_of(scene, system, record, cycle, str(leg), float(s))
            for leg, s in zip(legs, at, strict=True)
        ]
        return record.scene_toml, animation.Scenario(instants, time)

    text, scenario = comm.bcast(errors.on_root(comm, find))
    bulk = picture_body(from_toml(text), comm)
    try:
        with timer("pictures"):
            made: list[Path] | None = animation.animate(
                bulk, scenario, quantity, folder / "animations" / f"cycle{cycle:04d}_{stress}"
            )
            return made
    finally:
        bulk.destroy()


def instant_of(
    scene: Scene, system: ContactSystem, record: Record, cycle: int, leg: str, at: float = 1.0
) -> Instant:
    """Find the state of the modelled contact nodes at one instant of a scene's record.

    Args:
        scene: the scene.
        system: its condensed system.
        record: its record.
        cycle: cycle, 0 for the first loading.
        leg: "loading", "unloading" or the number of the leg in the cycle.
        at: position along the leg, in [0, 1].

    Returns:
        The instant, replayed from the turning point before it.
    """
    path = history.from_scene(scene)
    number = history.leg_number(path, leg, cycle)
    if scene.history.initial_slip is not None and (cycle, number) == (0, 0) and at < 1.0:
        raise InputError(
            "the first leg of a history with initial_slip is one jump; only its end is known, at 1"
        )
    return state_at(record, system, path, scene.solver, (cycle, number, at))


def _world() -> MPI.Comm:
    from mpi4py import MPI

    return MPI.COMM_WORLD


@contextmanager
def _folder(
    comm: MPI.Comm, out: str | Path | None, scene: Scene, overwrite: bool, resume: bool
) -> Iterator[Path | None]:
    """Open and close the run's folder on rank 0; its errors are raised on all ranks."""
    if out is None:
        yield None
        return
    with ExitStack() as stack:
        opened = run_folder(Path(out), scene, overwrite, resume)
        folder = errors.on_root(comm, lambda: stack.enter_context(opened))
        yield folder
        errors.on_root(comm, stack.close)


def _bulk(scene: Scene, comm: MPI.Comm, timer: Timer) -> Bulk | Pair:
    from receding_fenicsx.bulk import meshing, pair

    half = is_half_meshed(scene)
    with timer("mesh"), _signals_kept():
        bodies = meshing.make_meshes(comm, scene, half)
    with timer("assemble"):
        return pair.build_all(scene, bodies, half)


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Put Python's handlers back afterwards: gmsh sets that of SIGTERM to its default."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


def _pictures(
    scene: Scene,
    comm: MPI.Comm,
    system: ContactSystem | None,
    record: Record | None,
    folder: Path | None,
    body: bool,
) -> None:
    """Draw the figures on rank 0 and, of the body, the default snapshots on all ranks together."""
    figures = _drawing("figures")
    errors.on_root(comm, lambda: figures.plot_all(_given(record), _given(folder) / "figures"))
    if not body:
        return
    snapshots = _drawing("snapshots")

    def choose() -> list[Instant]:
        return default_instants(scene, _given(system), _given(record))

    instants, place = comm.bcast((errors.on_root(comm, choose), folder))
    fine = picture_body(scene, comm)
    try:
        for instant in instants:
            snapshots.snapshot(fine, instant, place / "snapshots", snapshots.IN_EVERY_RUN)
    finally:
        fine.destroy()


def picture_body(scene: Scene, comm: MPI.Comm) -> Bulk | Pair:
    """Return the body on a mesh for pictures: the same contact nodes, finer inside.

    Fringes and the fields beside the ends of the load ask for more than the contact does.
    """
    if any(body.mesh is not None for body in scene.bodies):
        # what a user's file makes of another growth is not known
        return _bulk(scene, comm, Timer())
    cells = scene.mesh.contact_elements**2 * scene.body.height / scene.body.width
    growth = min(scene.mesh.growth, PICTURE_GROWTH[cells > PICTURE_CELLS])
    return _bulk(replace(scene, mesh=replace(scene.mesh, growth=growth)), comm, Timer())


def default_instants(scene: Scene, system: ContactSystem, record: Record) -> list[Instant]:
    """Loaded turning points of first loading and of the first and last cycles, for snapshots."""
    table = record.turning_points
    chosen = sorted({0, 1, int(table.cycle.max(initial=0))})
    loaded = np.any(table.load != 0.0, axis=1)
    return [
        instant_of(scene, system, record, int(table.cycle[i]), str(int(table.leg[i])))
        for i in np.flatnonzero(np.isin(table.cycle, chosen) & loaded)
    ]


def plot(record: Record, folder: Path) -> list[Path]:
    """Draw all figures of a run into its folder ``figures``, write its report; return the files."""
    made: list[Path] = _drawing("figures").plot_all(record, folder)
    return [*made, _drawing("report").write_report(folder.parent, record.scene_toml)]


def _drawing(name: str) -> ModuleType:
    """Load a module that draws, only when something is drawn: it may load VTK."""
    place = f"receding_fenicsx.output.{name}"
    try:
        return import_module(place)
    except ModuleNotFoundError as error:
        if error.name != place:
            raise RecedingError(f"{name}: {error}; see receding-fenicsx doctor") from None
        raise InputError(f"{name} are not available yet") from None


def _costs(comm: MPI.Comm, timer: Timer) -> dict[str, Any]:
    """Timings, memory of all ranks together, versions; collective."""
    from receding_fenicsx import environment

    # Linux counts in kB, macOS in bytes
    unit = 2.0**20 if sys.platform == "darwin" else 2.0**10
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)
    return {
        "ranks": comm.size,
        "timings": dict(timer.seconds),
        "peak_memory_MB": memory,
        "versions": environment.versions(),
    }


def _write_record(folder: Path | None, record: Record | None) -> None:
    files.write_record(_given(folder) / "record.h5", _given(record), overwrite=True)


def _write_report(folder: Path | None, record: Record | None) -> None:
    _drawing("report").write_report(_given(folder), _given(record).scene_toml)


def _write_summary(
    comm: MPI.Comm,
    folder: Path | None,
    record: Record | None,
    extra: dict[str, Any],
    timer: Timer,
) -> None:
    """Write the summary with what the run has cost so far; collective."""
    whole = {**extra, **_costs(comm, timer)}

    def write() -> None:
        text = summary.summarise(_given(record), whole)
        summary.write_summary(_given(folder) / "summary.json", text, overwrite=True)

    errors.on_root(comm, write)


def _given(value: T | None) -> T:
    assert value is not None
    return value
