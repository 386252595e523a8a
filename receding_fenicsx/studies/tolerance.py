"""A search in a run's folder: it can be interrupted, and continues from its last mesh."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from receding_fenicsx import mpi
from receding_fenicsx.accuracy.estimate import Level, estimates_of
from receding_fenicsx.accuracy.meshes import graded_at_ends
from receding_fenicsx.accuracy.numbers import Number
from receding_fenicsx.accuracy.search import search
from receding_fenicsx.accuracy.space_errors import level_of, shown, warning
from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError, SolveError, ToleranceNotMet
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.run import unmet
from receding_fenicsx.pictures import drawing_modules
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.hdf5 import read_system
from receding_fenicsx.store.run_folder import SEARCH, SYSTEM, forget_system
from receding_fenicsx.timing import Say

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.interface.system import ContactSystem


@dataclass
class Solved:
    """A scene and its run.

    Attributes:
        scene: the scene of the mesh.
        system: its condensed system, on rank 0.
        record: its record, on rank 0.
        failure: why the record ends early, or the tolerance is not met; on all ranks.
        extra: further keys of the summary.
    """

    scene: Scene
    system: ContactSystem | None
    record: Record | None
    failure: SolveError | None = None
    extra: dict[str, Any] = field(default_factory=dict)


Run = Callable[[Scene], Solved]
"""Runs a scene in the working folder, from the checkpoints there; collective."""


def within_tolerance(
    scene: Scene, comm: MPI.Comm, folder: Path | None, run: Run, say: Say | None
) -> Solved:
    """Run a scene on finer and finer meshes until its numbers meet its tolerance; collective.

    Args:
        scene: a scene with ``accuracy.tolerance``.
        comm: communicator.
        folder: working folder, on rank 0; None writes nothing.
        run: runs the scene of one mesh.
        say: called with the progress.

    Returns:
        The run of the last mesh, with the summary's keys on its errors and on the search.
    """

    def graded(coarse: Scene) -> Scene | None:
        if scene.accuracy.grading is False:
            return None
        return comm.bcast(mpi.on_root(comm, lambda: _graded(coarse)))

    if scene.accuracy.grading:
        scene = graded(scene) or scene
    attempts = _Attempts(scene, comm, folder, run, say)
    known = comm.bcast(mpi.on_root(comm, attempts.known))
    try:
        found = search(scene, attempts.solve, known, attempts.move_on, graded)
    except SolveError:
        if attempts.last is None or attempts.last.failure is None:
            raise
        return attempts.last
    except InputError:
        mpi.on_root(comm, attempts.forget)
        raise
    last = attempts.last
    assert last is not None
    last.extra["errors"] = shown(estimates_of(found.levels))
    last.extra |= warning(last.record) | {"accuracy": found.shown()}
    if not found.met:
        last.failure = ToleranceNotMet(unmet(last.extra))
    return last


def _graded(scene: Scene) -> Scene | None:
    """Return the scene on graded meshes, None where they are impossible and not asked for."""
    from receding_fenicsx.bulk.mesh.meshing import contact_nodes_of, contact_sizes_of

    if not scene.accuracy.grading and scene.mesh.cell != "triangle":
        return None
    try:
        found = graded_at_ends(scene, contact_sizes_of(scene))
        contact_nodes_of(found)
    except InputError:
        if scene.accuracy.grading:
            raise
        return None
    return found


def draw_way(folder: Path, extra: dict[str, Any]) -> None:
    """Draw the search of a run among its figures."""
    with drawing_modules():
        from receding_fenicsx.output.plots.accuracy_plots import draw_search
    draw_search(extra["accuracy"], folder / "figures")


class _Attempts:
    """The runs of a search; those on finer meshes replace those before in the folder."""

    def __init__(
        self, scene: Scene, comm: MPI.Comm, folder: Path | None, run: Run, say: Say | None
    ) -> None:
        self.scene, self.comm, self.folder, self.run, self.say = scene, comm, folder, run, say
        self.last: Solved | None = None

    def solve(self, scene: Scene, elements: int) -> Level:
        """Run the scene of a mesh; return what was found, on all ranks."""
        if self.say is not None:
            self.say(f"accuracy: mesh of {elements} contact elements")
        mpi.on_root(self.comm, lambda: self._keep_only(scene))
        begin = time.perf_counter()
        self.last = self.run(scene)
        if self.last.failure is not None:
            raise self.last.failure
        seconds = time.perf_counter() - begin
        record = self.last.record
        found: Level = self.comm.bcast(
            mpi.on_root(self.comm, lambda: level_of(record, elements, seconds))
        )
        return found

    def move_on(self, levels: Sequence[Level]) -> None:
        """Store the meshes so far; remove the last one's system from the folder."""
        mpi.on_root(self.comm, lambda: self._store(levels))

    def forget(self) -> None:
        """Remove the runs from the folder, which is not kept."""
        if self.folder is not None:
            forget_system(self.folder)

    def _keep_only(self, scene: Scene) -> None:
        """Remove a system of another mesh."""
        if self.folder is None or not (self.folder / SYSTEM).is_file():
            return
        try:
            read_system(self.folder / SYSTEM, scene)
        except InputError:
            forget_system(self.folder)

    def _store(self, levels: Sequence[Level]) -> None:
        if self.folder is None:
            return
        data = {"cycles": self.scene.history.cycles, "levels": [asdict(each) for each in levels]}
        with new_file(self.folder / SEARCH, overwrite=True) as beside:
            beside.write_text(json.dumps(data, indent=1), encoding="utf-8")
        forget_system(self.folder)

    def known(self) -> list[Level]:
        """Return the meshes of an interrupted search of the same history."""
        file = None if self.folder is None else self.folder / SEARCH
        if file is None or not file.is_file():
            return []
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            if data["cycles"] != self.scene.history.cycles:
                return []
            return [
                Level(**{**row, "numbers": {k: Number(**v) for k, v in row["numbers"].items()}})
                for row in data["levels"]
            ]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{file}: is damaged; start a new run with --overwrite") from None
