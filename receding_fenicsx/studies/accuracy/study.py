"""Errors of a run by meshes of a family, and the mesh that meets a tolerance; the cases are meshes.

Finished meshes are lines of ``cases.jsonl`` in the run's folder, by which an interrupted study
continues.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from receding_fenicsx import mpi
from receding_fenicsx.errors import (
    InputError,
    MeshMisfit,
    RecedingError,
    SolveError,
    ToleranceNotMet,
)
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report.run import unmet
from receding_fenicsx.scene.identity import identity_of
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.hdf5 import read_system
from receding_fenicsx.store.run_folder import SYSTEM, forget_system
from receding_fenicsx.store.workspace import Case, CaseFile, Outcome
from receding_fenicsx.studies.accuracy.estimate import (
    MIN_RATIO,
    ORDERS,
    Estimate,
    Level,
    Number,
    asked_numbers,
    estimates_of,
    level_of,
    nonconvergence,
    shown,
    warning,
)
from receding_fenicsx.studies.accuracy.meshes import (
    MIN_ELEMENTS,
    doublings,
    graded_at_ends,
    is_graded,
    is_refined,
    scaled_mesh,
    solve_near,
    to_limit,
)
from receding_fenicsx.timing import Say

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.interface.system import ContactSystem


log = logging.getLogger(__name__)

MOST_NODES = 8000
"""Largest number of contact nodes: their condensed stiffness takes 2 GB."""


@dataclass
class Search:
    """A search: the scene of the last mesh, all meshes from the coarsest, and how it ended.

    ``failures`` are (elements, reason) of meshes without an answer, ``way`` holds the estimates of
    the asked numbers for each mesh, and ``reason`` is why the tolerance is not met, "" where it is.
    """

    scene: Scene
    levels: list[Level] = field(default_factory=list)
    failures: list[tuple[int, str]] = field(default_factory=list)
    way: list[dict[str, Estimate]] = field(default_factory=list)
    met: bool = False
    reason: str = ""

    def shown(self) -> dict[str, Any]:
        """Return the key "accuracy" of the summary."""
        options = self.scene.accuracy
        return {
            "tolerance": options.tolerance,
            "budget_seconds": options.budget_seconds,
            "met": self.met,
            "graded": is_graded(self.scene),
            "reason": self.reason,
            "seconds": sum(level.seconds for level in self.levels),
            "failures": [list(failure) for failure in self.failures],
            "way": [
                {key: getattr(level, key) for key in ("elements", "nodes", "seconds")}
                | {"numbers": shown(found)}
                for level, found in zip(self.levels, self.way, strict=True)
            ],
        }


def search(
    scene: Scene,
    solve: Callable[[Scene, int], Level],
    graded: Callable[[Scene], Scene | None] = lambda _: None,
) -> Search:
    """Solve a scene on finer and finer meshes until its numbers meet its tolerance; collective.

    ``solve`` runs a scene of so many elements, on all ranks alike; it raises MeshMisfit where its
    vertices do not fit the scene. Where the first mesh has sharp corners in contact, the search
    begins anew with what ``graded`` returns, a scene on graded meshes, unless they are impossible.

    Raises:
        InputError: no mesh fits the scene, or the run has no such number.
        SolveError: the scene has no answer on a mesh as fine as its own.
    """
    tolerance = scene.accuracy.tolerance or 0.0
    scene, own = to_limit(scene), scene.mesh.contact_elements
    found = Search(scene)
    while True:
        wanted = next_elements(scene, found)
        found.reason = _too_much(scene, found.levels, wanted)
        if found.reason:
            # the numbers that keep it from its tolerance, with the meshes that they need
            for name, e in found.way[-1].items():
                if tolerance < 2.0 * e.relative < math.inf and not math.isnan(e.order):
                    least = f"{found.levels[-1].elements * _needed(e, tolerance):.2g}"
                    order = f"it converges with order {e.order:.1f}"
                    found.reason += f"; {name} needs about {float(least):g} elements, {order}"
            return found
        try:
            level = _solved(scene, wanted, solve)
        except SolveError as error:
            if found.levels or wanted >= own:
                raise
            # a mesh as coarse as this may have no answer
            found.failures.append((wanted, str(error)))
            continue
        found.scene = scaled_mesh(scene, level.elements)
        anew = level.sharp and not found.levels and not is_graded(scene)
        finer = graded(found.scene) if anew else None
        if finer is not None:
            log.info("sharp corners in contact: meshes are graded")
            scene = finer
            continue
        found.levels.append(level)
        found.way.append(asked_numbers(scene, found.levels))
        for name, e in found.way[-1].items():
            log.info("%d elements: %s %.6g, error %.1e", level.elements, name, e.value, e.relative)
        errors = [e.relative for e in found.way[-1].values()]
        # of at least three meshes
        found.met = bool(errors) and len(found.levels) > 2 and 2.0 * max(errors) <= tolerance
        found.reason = "" if found.met else nonconvergence(found.way)
        if found.met or found.reason:
            return found


def next_elements(scene: Scene, found: Search) -> int:
    """Choose the next mesh from what was found: the one that is predicted to meet the tolerance.

    The error of a number falls with elements^-p, p its observed order. A mesh much finer than the
    last is approached in equal ratios. The finest is tried where no other could follow the next.
    """
    levels = found.levels
    if not levels:
        first = doublings(scene)[0] if is_refined(scene) else 24
        return max([first, *(2 * elements for elements, _ in found.failures)])
    last = levels[-1].elements
    if is_refined(scene):
        return 2 * last
    ratio = 2.5  # from which the orders are seen
    if len(levels) > 2:
        asked, tolerance = found.way[-1].values(), scene.accuracy.tolerance or 1.0
        # smaller ratios repeat work, larger ones leave the estimate no meshes to compare with
        needed = max([1.6, *(_needed(e, 0.75 * tolerance) for e in asked)])
        # coarse meshes may have shown too little: mostly the next one shows a higher order
        slow = any(e.order < 1.0 and 2.0 * e.relative > tolerance for e in asked)
        ratio = needed ** (1.0 / math.ceil(math.log(needed) / math.log(1.8 if slow else 2.8)))
        finest = MOST_NODES / max(levels[-1].nodes, 1)
        does = max((_needed(e, tolerance) for e in asked), default=1.0) <= finest < ratio
        # after another mesh the finest would be too near to it
        is_last = ratio < needed and ratio <= finest < MIN_RATIO * ratio
        if finest >= MIN_RATIO and (does or is_last):
            return 2 * int(0.5 * finest * last)
    return 2 * math.ceil(0.5 * ratio * last)


def _needed(e: Estimate, tolerance: float) -> float:
    """Return how many times as many elements a number needs, as errors fall with p."""
    if not math.isfinite(e.error):
        return 2.8
    order = 1.0 if math.isnan(e.order) else min(max(e.order, ORDERS[0]), ORDERS[1])
    return float((2.0 * e.relative / tolerance) ** (1.0 / order))


def _too_much(scene: Scene, levels: Sequence[Level], wanted: int) -> str:
    """Return why a mesh is not begun: beyond the finest mesh or the budget; "" where it is."""
    if not levels:
        return ""
    last, budget = levels[-1], scene.accuracy.budget_seconds
    ratio = wanted / last.elements
    if is_refined(scene) and wanted > _finest(scene):
        return "the tolerance needs more refinements of the mesh file than there are"
    if ratio * last.nodes > MOST_NODES or wanted > _finest(scene):
        return f"the tolerance needs a mesh finer than the finest of {MOST_NODES} contact nodes"
    power = 2.0  # of the elements, with which the time of a run grows
    if len(levels) > 1 and levels[-2].seconds > 0.0 and last.seconds > levels[-2].seconds:
        seen = math.log(last.seconds / levels[-2].seconds)
        power = min(seen / math.log(last.elements / levels[-2].elements), 3.0)
    spent, more = sum(level.seconds for level in levels), last.seconds * ratio**power
    if spent + more <= budget:
        return ""
    needs = f"a mesh of {wanted} elements needs about {more:.2g} s"
    return f"the budget of {budget:g} s ends first: {spent:.3g} s are spent, and {needs}"


def _finest(scene: Scene) -> int:
    return doublings(scene)[-1] if is_refined(scene) else 4000


def _solved(scene: Scene, wanted: int, solve: Callable[[Scene, int], Level]) -> Level:
    """Solve on the mesh nearest to a wanted one whose vertices fit the scene, or on a finer one."""
    near, reason = 1.0 if is_refined(scene) else 1.3, ""
    while wanted <= _finest(scene):
        try:
            found = solve_near(scene, wanted, wanted * near, solve, near)
            if found is not None:
                return found
        except MeshMisfit as error:
            reason = str(error)
        wanted *= 2
    raise InputError(f"[mesh]: no mesh that was tried fits the scene; on the last one: {reason}")


@dataclass
class Solved:
    """A scene of one mesh and its run.

    System and record are those of rank 0. ``failure``, on all ranks, is why the record ends early
    or the tolerance is not met; ``extra`` are further keys of the summary.
    """

    scene: Scene
    system: ContactSystem | None
    record: Record | None
    failure: SolveError | None = None
    extra: dict[str, Any] = field(default_factory=dict)


class Meshes:
    """Finished meshes of a study in a run's folder, none of which is solved again; collective."""

    def __init__(self, comm: MPI.Comm, folder: Path | None) -> None:
        """Read the finished meshes on rank 0."""
        self.comm = comm
        self.file = mpi.on_root(comm, lambda: None if folder is None else CaseFile(folder))
        read = None if self.file is None else self.file.read
        self.finished = comm.bcast(mpi.on_root(comm, lambda: read and read(final=True))) or {}

    def level(self, scene: Scene, elements: int, solve: Callable[[Scene, int], Level]) -> Level:
        """Return what is found on a mesh."""
        # without keys that change none of its numbers
        plain = {key: getattr(Scene(), key) for key in ("accuracy", "shakedown", "mode", "units")}
        bare = replace(scene, output=replace(scene.output, cycles=None), **plain)
        name = self.comm.bcast(mpi.on_root(self.comm, lambda: identity_of(bare)))
        if name in self.finished:
            row = self.finished[name].cells
            return Level(**{**row, "numbers": {k: Number(**v) for k, v in row["numbers"].items()}})
        found = solve(scene, elements)
        add = None if self.file is None else self.file.add
        case, outcome = Case(name, labels=(elements,)), Outcome(asdict(found))
        mpi.on_root(self.comm, lambda: add and add(case, outcome))
        return found


# -- a run on the scene's mesh -------------------------------------------------------------------


def with_coarser_partner(scene: Scene) -> Scene:
    """Return a scene whose mesh can be made coarser; InputError where it is too coarse for it.

    A mesh file that is neither refined nor takes ``contact_elements`` is refined once: its coarser
    partner is itself.
    """
    if is_refined(scene):
        own = scene.mesh
        return scene if own.refinements else scaled_mesh(scene, 2 * own.contact_elements)
    if scene.mesh.contact_elements < 2 * MIN_ELEMENTS:
        raise InputError(
            f"--error: mesh.contact_elements = {scene.mesh.contact_elements} is too coarse for an "
            f"estimate; use at least {2 * MIN_ELEMENTS}"
        )
    return scene


def space_errors(
    scene: Scene,
    record: Record | None,
    solve: Callable[[Scene], Record | None],
    meshes: Meshes | None = None,
) -> dict[str, Estimate]:
    """Estimate the space error of each headline number, on rank 0; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: goes from a scene to its record on rank 0; all ranks call it together, and it raises
            on all of them.
        meshes: finished meshes, which are not solved again.

    Raises:
        RecedingError: the scene has no solution on the first coarser mesh.
    """

    def coarse(coarser: Scene, elements: int) -> Level:
        return level_of(solve(coarser), elements)

    def level(coarser: Scene, elements: int) -> Level:
        once = coarse if meshes is None else partial(meshes.level, solve=coarse)
        return once(to_limit(coarser), elements)

    most = scene.mesh.contact_elements
    levels = [level_of(record, most)]
    for factor in (2.0, 2.5, 4.0):  # the second mesh is not nested in the run's
        below = min(most / factor, levels[-1].elements - 1)
        try:
            found = solve_near(scene, most / factor, below, level)
        except RecedingError:
            if len(levels) == 1:
                raise
            break  # a mesh as coarse as this may have no solution
        if found is None:
            break
        levels.append(found)
    return {} if record is None else estimates_of(levels)


def errors_of_run(
    scene: Scene,
    record: Record | None,
    solve: Callable[[Scene], Record | None],
    meshes: Meshes | None = None,
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
    scene: Scene,
    comm: MPI.Comm,
    folder: Path | None,
    run: Callable[[Scene], Solved],
    say: Say | None,
) -> Solved:
    """Run a scene on finer and finer meshes until its numbers meet its tolerance; collective.

    ``run`` runs the scene of one mesh. The last of these runs is returned, with the summary's keys
    on its errors and on the search.
    """
    meshes = Meshes(comm, folder)
    last: Solved | None = None
    ran, reached = Scene(), scene  # on the last mesh that was run here, and on the last of all

    def forget_another_mesh(meshed: Scene) -> None:
        if folder is not None and (folder / SYSTEM).is_file():
            try:
                read_system(folder / SYSTEM, meshed)
            except InputError:
                forget_system(folder)

    def solved(meshed: Scene, elements: int = 0) -> Level:
        nonlocal last, ran
        if say is not None and elements:
            say(f"accuracy: mesh of {elements} contact elements")
        begin = time.perf_counter()
        mpi.on_root(comm, lambda: forget_another_mesh(meshed))
        last, ran = run(meshed), meshed
        if last.failure is not None:
            raise last.failure
        seconds, record = time.perf_counter() - begin, last.record
        return comm.bcast(mpi.on_root(comm, lambda: level_of(record, elements, seconds)))

    def level(meshed: Scene, elements: int) -> Level:
        nonlocal reached
        reached = meshed
        return meshes.level(meshed, elements, solved)

    def graded(coarse: Scene) -> Scene | None:
        if scene.mesh.refine is not None or coarse.mesh.cell != "triangle":
            return None

        def finer() -> Scene | None:
            from receding_fenicsx.bulk.stack import contact_of

            with suppress(InputError):  # they are impossible
                found = graded_at_ends(coarse, contact_of(coarse)[1])
                contact_of(found)
                return found
            return None

        return comm.bcast(mpi.on_root(comm, finer))

    try:
        found = search(scene, level, graded)
    except SolveError:
        if last is None or last.failure is None:
            raise
        return last
    except InputError:
        mpi.on_root(comm, lambda: None if folder is None else forget_system(folder))
        raise
    if ran is not reached:  # the last mesh was finished before
        solved(reached)
    assert last is not None
    last.extra["errors"] = shown(estimates_of(found.levels))
    last.extra |= warning(last.record) | {"accuracy": found.shown()}
    if not found.met:
        last.failure = ToleranceNotMet(unmet(last.extra))
    return last
