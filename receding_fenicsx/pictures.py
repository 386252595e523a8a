"""Pictures of a run: figures, snapshots of the body, films.

Drawing modules are imported when something is drawn: ``plots`` and ``snapshots`` load them then.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx import mpi, workers
from receding_fenicsx.arrays import over_largest, spread
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.replay import instant_of
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.measures.limit_nodes import shown_states
from receding_fenicsx.mpi import world
from receding_fenicsx.output import plots, snapshots
from receding_fenicsx.output.snapshots import render
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.run_folder import read_run
from receding_fenicsx.timing import Say, Timer

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.bulk.stack import Stack
    from receding_fenicsx.interface.branches.critical_friction import CriticalFriction
    from receding_fenicsx.interface.system import ContactSystem


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
        progress: called on rank 0 with the name of each stage.

    Returns:
        The files written, on rank 0; None on the others.
    """
    with _run_body(folder, lambda _: [(cycle, leg, at)], comm, progress) as (bulk, instants, say):
        return snapshots.draw.snapshots(bulk, instants, Path(folder) / "snapshots", say=say)


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
        frames: number of pictures, spread over the legs by the change of the loads in each.
        stress: quantity: "max_shear" (as fringes), "von_mises", "sxx", "syy" or "sxy".
        comm: communicator; all processes of the job when left out.
        progress: called on rank 0 with the name of each stage.

    Returns:
        The files written, .mp4 and .gif, on rank 0; None on the others.
    """
    quantity = snapshots.page.quantity_of(stress)
    file = Path(folder) / f"animations/cycle{cycle:04d}_{stress}"

    def spaced(scene: Scene) -> tuple[Any, Any, Any]:
        return history.evenly_spaced(history.history_from_scene(scene), cycle, frames)

    def places(scene: Scene) -> list[tuple[int, str, float]]:
        legs, at, _ = spaced(scene)
        return [(cycle, str(leg), float(s)) for leg, s in zip(legs, at, strict=True)]

    with _run_body(folder, places, comm, progress) as (bulk, instants, say):
        return snapshots.draw.animate(bulk, instants, spaced(bulk.scene)[2], quantity, file, say)


@contextlib.contextmanager
def _run_body(
    folder: str | Path,
    places: Callable[[Scene], list[tuple[int, str, float]]],
    comm: MPI.Comm | None,
    progress: Say | None,
) -> Iterator[tuple[Stack, list[Instant], Say | None]]:
    """Yield body, instants (cycle, leg, s) and progress on rank 0 of a finished run."""
    comm = comm or world()
    timer = Timer(progress if comm.rank == 0 else None)

    def find() -> tuple[Scene, list[Instant]]:
        scene, system, record = read_run(Path(folder))
        render.start()
        return scene, [shown_instant(scene, system, record, where) for where in places(scene)]

    scene, instants = comm.bcast(mpi.on_root(comm, find))
    with picture_body(scene, comm) as bulk, timer("pictures"):
        yield bulk, instants, timer.say


def draw_slip_mode(
    scene: Scene,
    critical: CriticalFriction | None,
    file: str | Path,
    comm: MPI.Comm | None = None,
) -> Path | None:
    """Draw the body deformed by rank 0's slip mode at critical friction; collective.

    The scene is that of the system that the mode is of. Rank 0 gets the file.
    """
    with picture_body(scene, comm or world()) as bulk:
        return snapshots.draw.draw_mode(bulk, critical, Path(file))


def start_drawing(body: bool) -> None:
    """Start the process that draws; it loads its libraries while this one computes."""
    workers.submit("pictures", lambda: len(plots.figures.FIGURES))
    if body:
        render.start()


def begin_figures(*drawn: Any) -> Callable[[], Any]:
    """Begin to draw figures (arguments of ``plot_all``) beside; return what finishes them."""
    draw = lambda: plots.figures.plot_all(*drawn)  # noqa: E731
    # this process alone knows the figures that its program has registered
    if f"{plots.__name__}.figures" in sys.modules:
        return draw
    job = workers.submit("pictures", draw)

    def finish() -> None:
        try:
            workers.result("pictures", job)
        except workers.WorkerEnded:  # VTK may crash
            draw()

    return finish


def draw_run(
    comm: MPI.Comm,
    scene: Scene,
    system: ContactSystem | None,
    record: Record | None,
    folder: Path | None,
    finish_figures: Callable[[], Any] | None,
    *,
    body: bool,
    everything: bool = True,
    say: Say | None = None,
) -> None:
    """Finish the figures of a run; with ``body`` draw snapshots of rank 0's record; collective.

    Not ``everything``: only the pictures that answer the scene's question.
    """

    def begin() -> list[Instant]:
        mpi.given(finish_figures)()
        found = mpi.given(record)
        return default_instants(scene, mpi.given(system), found, everything)

    if not body:
        mpi.on_root(comm, begin)
        return
    names = ("von_mises", "max_shear") if everything else ("max_shear",)
    # Matplotlib is loaded while the other process draws
    quantities = tuple(snapshots.page.quantity_of(name) for name in names)
    with picture_body(scene, comm) as fine:
        instants, place = comm.bcast((mpi.on_root(comm, begin), folder))
        snapshots.draw.snapshots(fine, instants, place / "snapshots", quantities, say)


@contextlib.contextmanager
def picture_body(scene: Scene, comm: MPI.Comm) -> Iterator[Stack]:
    """Yield the body on a mesh for pictures: the same contact nodes, finer inside for fringes."""
    # a mesh of the user's own is not refined, a half-plane has none
    if all(body.is_rectangle for body in scene.bodies):
        cells = scene.mesh.contact_elements**2 * scene.body.height / scene.body.width
        # size ratio of neighbouring layers: fewer cells than this fill the body ungraded
        growth = min(scene.mesh.growth, 1.1 if cells > 30_000 else 1.0)
        # places without a growth of their own have the mesh's
        own = [replace(p, growth=p.growth or scene.mesh.growth) for p in scene.mesh.places]
        refine = tuple(own) or scene.mesh.refine
        scene = replace(scene, mesh=replace(scene.mesh, growth=growth, refine=refine))
    bulk = bulk_of(scene, comm, Timer())
    try:
        yield bulk
    finally:
        bulk.destroy()


def default_instants(
    scene: Scene, system: ContactSystem, record: Record, everything: bool = True
) -> list[Instant]:
    """Return the instants at which a run draws the body: up to six of cycles 0, 1 and the last.

    Not ``everything``: the one of the last loaded cycle with the largest loads.
    """
    table = record.turning_points
    loaded = np.any(table.load != 0.0, axis=1)
    chosen = []
    if everything:
        for cycle in sorted({0, 1, int(table.cycle.max(initial=0))}):
            chosen += spread(np.flatnonzero((table.cycle == cycle) & loaded), 6).tolist()
    elif np.any(loaded):
        size = np.abs(over_largest(table.load, table.load)).sum(axis=1)
        here = loaded & (table.cycle == table.cycle[loaded].max())
        chosen = [int(np.argmax(np.where(here, size, 0.0)))]
    return [
        shown_instant(scene, system, record, (int(table.cycle[i]), str(int(table.leg[i])), 1.0))
        for i in chosen
    ]


def shown_instant(
    scene: Scene, system: ContactSystem, record: Record, where: tuple[int, str, float]
) -> Instant:
    """Return an instant with the states that zone maps show; ``where`` is cycle, leg and s."""
    found, own = instant_of(scene, system, record, *where), ~mirror_of(system).left
    return found._replace(shown=shown_states(record, found.cycle, found.state.state, own))


def plot(record: Record, folder: Path) -> list[Path]:
    """Draw all figures of a run into ``folder`` and write its report; return the files."""
    from receding_fenicsx.output.report.summary import write_report

    return [*plots.figures.plot_all(record, folder), write_report(folder.parent, record.scene_toml)]
