"""Errors of a run by meshes of a family, and the mesh that meets a tolerance; one study.

Its cases are the meshes. Those of ``run --error`` are coarser than that of the run; those of
``run --tolerance`` are finer and finer, and the last one is that of the run. Finished meshes are
lines of ``cases.jsonl`` in the run's folder, by which an interrupted study continues.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from receding_fenicsx import mpi
from receding_fenicsx.errors import InputError, RecedingError, SolveError, ToleranceNotMet
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.run import unmet
from receding_fenicsx.pictures import drawing_modules
from receding_fenicsx.scene.identity import identity_of
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.hdf5 import read_system
from receding_fenicsx.store.run_folder import SYSTEM, forget_system
from receding_fenicsx.store.workspace import Case, CaseFile, Outcome
from receding_fenicsx.studies.accuracy.estimate import (
    Estimate,
    Level,
    Number,
    estimates_of,
    level_of,
    shown,
    warning,
)
from receding_fenicsx.studies.accuracy.meshes import (
    MIN_ELEMENTS,
    SEARCH_RATIO,
    elements_near,
    first_that_fits,
    graded_at_ends,
    is_refined,
    scaled_mesh,
    to_limit,
)
from receding_fenicsx.studies.accuracy.search import search
from receding_fenicsx.timing import Say

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.interface.system import ContactSystem

FACTORS = (2.0, 2.5, 4.0)
"""Approximate ratios of the mesh sizes of ``--error``; the second mesh is not nested in the run's.
"""


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


class Meshes:
    """Finished meshes of a study in a run's folder."""

    def __init__(self, comm: MPI.Comm, folder: Path | None) -> None:
        """Read the finished meshes on rank 0; collective."""

        def read() -> tuple[CaseFile | None, Mapping[str, Outcome]]:
            file = None if folder is None else CaseFile(folder)
            return file, {} if file is None else file.read(final=True)

        self.comm = comm
        self.file, finished = mpi.on_root(comm, read) or (None, {})
        self.finished: Mapping[str, Outcome] = comm.bcast(finished)

    def case_of(self, scene: Scene, elements: int) -> Case:
        """Return the case of a mesh; keys that change none of its numbers are left out."""
        plain = {
            name: getattr(Scene(), name) for name in ("accuracy", "shakedown", "mode", "units")
        }
        bare = replace(scene, output=replace(scene.output, cycles=None), **plain)
        name = self.comm.bcast(mpi.on_root(self.comm, lambda: identity_of(bare)))
        return Case(name, labels=(elements,))

    def known(self, case: Case) -> Level | None:
        """Return what was found on a mesh, if it is finished."""
        if case.identity not in self.finished:
            return None
        row = self.finished[case.identity].cells
        return Level(**{**row, "numbers": {k: Number(**v) for k, v in row["numbers"].items()}})

    def keep(self, case: Case, level: Level) -> None:
        """Write what was found on a mesh; collective."""
        file = self.file
        mpi.on_root(
            self.comm, lambda: None if file is None else file.add(case, Outcome(asdict(level)))
        )


# -- a run on the scene's mesh -------------------------------------------------------------------


def with_coarser_partner(scene: Scene) -> Scene:
    """Return a scene whose mesh can be made coarser; InputError where it is too coarse for it.

    A mesh file that is neither refined nor takes ``contact_elements`` is refined once: its coarser
    partner is itself.
    """
    if is_refined(scene):
        return (
            scene if scene.mesh.refinements else scaled_mesh(scene, 2 * scene.mesh.contact_elements)
        )
    if scene.mesh.contact_elements < FACTORS[0] * MIN_ELEMENTS:
        raise InputError(
            f"--error: mesh.contact_elements = {scene.mesh.contact_elements} is too coarse for an "
            f"estimate; use at least {FACTORS[0] * MIN_ELEMENTS:.0f}"
        )
    return scene


Solve = Callable[[Scene], Record | None]
"""Goes from a scene to its record on rank 0; all ranks call it together, and it raises on all."""


def space_errors(
    scene: Scene, record: Record | None, solve: Solve, meshes: Meshes | None = None
) -> dict[str, Estimate]:
    """Estimate the space error of each headline number; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: goes from a scene to its record on rank 0; all ranks call it together, and it raises
            on all of them.
        meshes: finished meshes, which are not solved again.

    Returns:
        ``{name: Estimate}`` on rank 0, nothing on the others.

    Raises:
        RecedingError: the scene has no solution on the first coarser mesh.
    """

    def level(coarser: Scene, elements: int) -> Level:
        coarser = to_limit(coarser)
        case = None if meshes is None else meshes.case_of(coarser, elements)
        known = None if meshes is None or case is None else meshes.known(case)
        if known is not None:
            return known
        found = level_of(solve(coarser), elements)
        if meshes is not None and case is not None:
            meshes.keep(case, found)
        return found

    most = scene.mesh.contact_elements
    levels = [level_of(record, most)]
    for factor in FACTORS:
        below = levels[-1].elements - 1
        limits = most / factor / SEARCH_RATIO, min(most / factor, below)
        try:
            numbers = elements_near(scene, most / factor, limits)
            # the run itself was accepted: a coarser mesh is refused for its vertices
            found = first_that_fits(scene, numbers, level, InputError)
        except RecedingError:
            if len(levels) == 1:
                raise
            break  # a mesh as coarse as this may have no solution
        if found is None:
            break
        levels.append(found[1])
    return {} if record is None else estimates_of(levels)


def errors_of_run(
    scene: Scene, record: Record | None, solve: Solve, meshes: Meshes | None = None
) -> dict[str, Any]:
    """Return the summary's keys on space errors; collective. Arguments as :func:`space_errors`.

    With "errors_failure", the reason, where the scene has no answer on a coarser mesh, and
    "errors_warning" where a zone is so narrow that errors do not fall in order.
    """
    try:
        found = shown(space_errors(scene, record, solve, meshes))
    except RecedingError as error:
        return {"errors": {}, "errors_failure": f"on a coarser mesh: {error}"}
    return {"errors": found, **warning(record)}


# -- a run within a tolerance --------------------------------------------------------------------


def within_tolerance(
    scene: Scene, comm: MPI.Comm, folder: Path | None, run: Run, say: Say | None
) -> Solved:
    """Run a scene on finer and finer meshes until its numbers meet its tolerance; collective.

    ``run`` runs the scene of one mesh. The last of these runs is returned, with the summary's keys
    on its errors and on the search.
    """
    meshes = Meshes(comm, folder)
    last: Solved | None = None
    unwritten: tuple[Case, Level] | None = None
    reached: Scene | None = None

    def keep_only(meshed: Scene) -> None:
        """Remove the system of another mesh from the folder."""
        if folder is not None and (folder / SYSTEM).is_file():
            try:
                read_system(folder / SYSTEM, meshed)
            except InputError:
                forget_system(folder)

    def solved(meshed: Scene) -> Solved:
        nonlocal last
        mpi.on_root(comm, lambda: keep_only(meshed))
        last = run(meshed)
        if last.failure is not None:
            raise last.failure
        return last

    def level(meshed: Scene, elements: int) -> Level:
        nonlocal unwritten, reached
        case, reached = meshes.case_of(meshed, elements), meshed
        known = meshes.known(case)
        if known is not None:
            return known
        if unwritten is not None:  # only now another mesh takes its place in the folder
            meshes.keep(*unwritten)
            unwritten = None
        if say is not None:
            say(f"accuracy: mesh of {elements} contact elements")
        begin = time.perf_counter()
        record = solved(meshed).record
        seconds = time.perf_counter() - begin
        found: Level = comm.bcast(mpi.on_root(comm, lambda: level_of(record, elements, seconds)))
        unwritten = case, found
        return found

    def graded(coarse: Scene) -> Scene | None:
        if scene.mesh.refine is not None:
            return None
        return comm.bcast(mpi.on_root(comm, lambda: _graded(coarse)))

    try:
        found = search(scene, level, graded)
    except SolveError:
        if last is None or last.failure is None:
            raise
        return last
    except InputError:
        mpi.on_root(comm, lambda: None if folder is None else forget_system(folder))
        raise
    if unwritten is None:  # the last mesh was finished before
        assert reached is not None
        solved(reached)
    assert last is not None
    last.extra["errors"] = shown(estimates_of(found.levels))
    last.extra |= warning(last.record) | {"accuracy": found.shown()}
    if not found.met:
        last.failure = ToleranceNotMet(unmet(last.extra))
    return last


def _graded(scene: Scene) -> Scene | None:
    """Return the scene on graded meshes, None where they are impossible."""
    from receding_fenicsx.bulk.mesh.meshing import contact_nodes_of, contact_sizes_of

    if scene.mesh.cell != "triangle":
        return None
    try:
        found = graded_at_ends(scene, contact_sizes_of(scene))
        contact_nodes_of(found)
    except InputError:
        return None
    return found


def draw_way(folder: Path, extra: dict[str, Any]) -> None:
    """Draw the search of a run among its figures."""
    with drawing_modules():
        from receding_fenicsx.output.plots.study_plots import draw_search
    draw_search(extra["accuracy"], folder / "figures")
