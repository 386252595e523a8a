"""Wear of a scene over many cycles: start, steps, ends, folder."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from receding_fenicsx import mpi
from receding_fenicsx.arrays import Array, check_types
from receding_fenicsx.atomic import sync
from receding_fenicsx.environment import versions
from receding_fenicsx.errors import InputError, NoEquilibrium, SolveError
from receding_fenicsx.evolution.histories import with_corners
from receding_fenicsx.evolution.problem import Problem, problem_of_scene
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.plots.style import save
from receding_fenicsx.scene.model import Scene, WearOptions
from receding_fenicsx.store.run_folder import write_summary
from receding_fenicsx.store.workspace import interruption
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy.meshes import coarser
from receding_fenicsx.studies.runner import Runner, Study, StudyOptions, run_study
from receding_fenicsx.studies.wear.result import (
    WearStudy,
    ends_of_edges,
    fatigue_figure,
    profiles_figure,
    zones_figure,
)
from receding_fenicsx.studies.wear.steps import Convected, NodePairs, Row, advance
from receding_fenicsx.timing import Countdown, Timer

THROUGH = "stick zone worn through"
LARGEST_STROKE = 0.05
"""Stroke over the width of the contact up to which node pairs stay opposite each other."""
ROWS, COARSE = "steps.bin", "coarser.bin"
"""Files of the rows so far on both meshes, from which a study is continued."""


def wear(
    scene: Scene, out: str | Path | None = None, options: StudyOptions = StudyOptions()
) -> WearStudy | None:
    """Wear a contact over the cycles of the table [wear]; all ranks of an MPI job call this.

    Args:
        scene: the scene, with cycles; of its history the number of cycles does not count.
        out: folder for ``wear.csv``, ``wear.json``, ``wear.npz`` and the figures, from which an
            interrupted study, or one for fewer cycles, is continued. None writes nothing.
        options: overwrite, resume, progress.

    Returns:
        The study on rank 0, None on the others.

    Raises:
        InputError: the scene cannot wear, or node pairs do not stay opposite each other.
        SolveError: a step fails; the folder holds the record up to there.
    """
    comm = mpi.world()
    check_types("wear", scene=(scene, Scene), out=(out, str, Path, None))
    if scene.wear.coefficient is None and scene.wear.archard is None:
        raise InputError("[wear] coefficient: is missing; give it, or archard")
    timer = Timer(options.progress if comm.rank == 0 else None)
    system, partner, coarse = study.condense(scene, comm, timer.say), None, None
    with suppress(InputError):  # no coarser mesh fits
        partner = comm.bcast(mpi.on_root(comm, lambda: coarser(scene)))
        coarse = None if partner is None else study.condense(partner, comm)

    def begin() -> Study[WearStudy]:
        own, _ = with_corners(mpi.given(system), scene)
        begun = _begin(own, mpi.given(system))
        # a study for more cycles continues one for fewer
        same = replace(scene, wear=replace(scene.wear, cycles=WearOptions.cycles))

        def combine(runner: Runner) -> WearStudy:
            other = None
            if partner is not None and coarse is not None:
                other = replace(partner, history=own.history), coarse
            with timer("wear"):
                return _wear(own, begun, other, runner.folder, timer)

        files = (ROWS, COARSE, *(f"wear.{ending}" for ending in ("csv", "json", "npz")))
        pictures = "profiles.png", "zones.png", "fatigue.png"
        return Study("wear study", "wear_of.json", same, combine, results=(*files, *pictures))

    return run_study(begin, out, options=options)


def wear_numbers(system: ContactSystem, scene: Scene) -> dict[str, float | str]:
    """Return the end of the wear of a condensed scene, for the table of a sweep."""
    own, _ = with_corners(system, scene)
    found = _wear(own, _begin(own, system), None, None, Timer())
    last = found.table()[-1] | {"end": found.end, "volume_estimate": found.volume_estimate[-1]}
    return {f"wear_{name}": value for name, value in last.items()}


def _begin(scene: Scene, system: ContactSystem) -> tuple[NodePairs, Row]:
    """Return the mechanics of a scene and its first row.

    Raises:
        InputError: the scene cannot wear.
    """
    problem = problem_of_scene(system, scene)
    if not len(problem.history.loop):
        raise InputError(
            "[wear]: needs a history with cycles, this one is monotonic; use "
            'kind = "cyclic", "table" or "harmonic"'
        )
    system, options = problem.system, scene.wear
    law = system.law
    if system.kind == "normal" or not np.any(law.present):
        raise InputError("[wear]: nothing dissipates without friction; give [contact] friction")
    if options.coefficient is not None:
        return _model(scene, problem, np.full(system.n, options.coefficient))
    if system.has_branches or np.any(law.forward != law.backward):
        raise InputError(
            "[wear] archard: friction differs by direction, or has a shear limit or a cohesion; "
            "give coefficient instead"
        )
    archard = np.full(system.n, options.archard or 0.0)
    f = law.largest
    return _model(scene, problem, np.divide(archard, f, out=np.zeros(system.n), where=f > 0.0))


def _wear(
    scene: Scene,
    begun: tuple[NodePairs, Row],
    other: tuple[Scene, ContactSystem] | None,
    folder: Path | None,
    timer: Timer,
) -> WearStudy:
    """Take step after step on both meshes; write what there is, also where a step fails."""
    options, failure, coarse = scene.wear, None, None
    tell = Countdown(timer.say, "wear: cycle", "at most")

    def keep(name: str, row: Row) -> None:
        if folder is not None:
            with open(folder / name, "ab") as opened:
                opened.write(row.tobytes())
            sync(folder / name)

    def rows_of(first: Row, name: str) -> list[Row]:
        found = list[Row]()
        if folder is not None and (file := folder / name).exists():
            with open(file, "r+b") as opened:  # the last row may be torn
                opened.truncate(file.stat().st_size // first.nbytes * first.nbytes)
            found = list(np.fromfile(file, first.dtype))
        if not found:
            keep(name, first)
        return [row for row in found or [first] if row["cycles"] <= options.cycles]

    def steps(model: NodePairs, rows: list[Row], last: float, name: str) -> str:
        depth = np.inf if options.depth is None or name == COARSE else options.depth
        while not (end := _end(model.problem.system, rows, last, depth)):
            row, until = rows[-1], last
            growth = model.rate * row["energy"]
            if depth < np.inf and (rate := growth[row["depth"].argmax()] or growth.max()) > 0.0:
                until = min(last, float(row["cycles"] + (depth - row["depth"].max()) / rate))
            rows.append(advance(model, row, options.tolerance, until))
            keep(name, rows[-1])
            text = f"depth {rows[-1]['depth'].max():.4g}"
            tell(int(rows[-1]["cycles"]), options.cycles, text + (name == COARSE) * ", coarser")
        return end

    rows = rows_of(begun[1], ROWS)
    try:
        try:
            end = steps(begun[0], rows, float(options.cycles), ROWS)
        except SolveError as error:
            through = isinstance(error, NoEquilibrium) and np.any(rows[0]["zone"] == State.STICK)
            end, failure = (THROUGH, None) if through else (str(error), error)
        if other is not None and failure is None:
            # the same numbers of cycles, as far as the coarser mesh goes
            with suppress(SolveError, InputError):
                model, first = _begin(*other)
                others = rows_of(first, COARSE)
                with suppress(SolveError):
                    for row in rows:
                        steps(model, others, float(row["cycles"]), COARSE)
                coarse = WearStudy(model, others, options.share, "")
    except (KeyboardInterrupt, SystemExit) as signalled:
        if folder is None:
            raise
        where = f"after {rows[-1]['cycles']:.0f} of {options.cycles} cycles"
        raise interruption(signalled, where, folder, "the steps up to there") from None
    found = WearStudy(begun[0], rows, options.share, end, coarse)
    if folder is not None:
        head = {"title": scene.title, **found.summary()}
        head |= {"failure": end} if failure else {}
        costs = {"timings": dict(timer.seconds), "versions": versions()}
        found.write(folder)
        write_summary(folder / "wear.json", head | costs, overwrite=True)
        save(profiles_figure(found), folder / "profiles.png")
        save(zones_figure(found), folder / "zones.png")
        if head["fatigue"]:
            save(fatigue_figure(head["fatigue"]), folder / "fatigue.png")
    if failure is not None:
        raise failure
    return found


def _model(scene: Scene, problem: Problem, coefficient: Array) -> tuple[NodePairs, Row]:
    """Return node pairs, or profiles carried along by a stroke that is not small; the first row.

    Raises:
        InputError: the stroke is not small, and the profiles cannot be carried along.
    """
    pairs = NodePairs(problem, coefficient)
    first, system, n = pairs.begin(), problem.system, problem.system.n
    first["step"] = max(1.0, 1e-3 * scene.wear.cycles)
    on = first["P"] > 0.0
    width = 2.0 * float(WearStudy(pairs, [first], 0.5, "").contact_half_width[0])
    stroke = 0.5 * float(first["path"][on].max(initial=0.0))
    if stroke <= LARGEST_STROKE * width:
        return pairs, first
    slides = np.all(first["zone"] != State.STICK)
    coupled = np.abs(system.K[:n, n:]).max() > 1e-8 * np.abs(system.K).max()
    half_planes = len(scene.bodies) == 2 and all(body.is_half_plane for body in scene.bodies)
    alone = half_planes and len(scene.contacts) == 1 and not system.has_branches
    if not alone or coupled or not slides:
        raise InputError(
            f"[wear]: the stroke {stroke:.4g} is {stroke / width:.2g} of the contact's width "
            f"{width:.4g}, above {LARGEST_STROKE:g}: nodes do not stay opposite each other; this "
            "is modelled for two half-planes of equal materials that slide grossly, by "
            "friction alone"
        )
    found = Convected(pairs, scene.wear.share, pairs.slip_at_corners, 0.5 * width)
    return found, found.settled(first, np.zeros(2 * n))


def _end(system: ContactSystem, rows: list[Row], cycles: float, depth: float) -> str:
    """Return why a study ends with its last row, "" where it goes on."""
    first, last = rows[0], rows[-1]
    if last["depth"].max() >= (1.0 - 1e-3) * depth:  # within a thousandth
        return "depth reached"
    if last["energy"].sum() <= 1e-6 * first["energy"].sum():  # nothing more wears
        return "shakedown"
    if len(rows) > 1 and np.any(rows[-2]["zone"] == State.STICK):
        if not np.any(last["zone"] == State.STICK):
            return THROUGH
    begun, touches = (row["zone"] != State.SEPARATION for row in (first, last))
    apart = np.where(np.diff(system.edges) == 0, np.diff(system.x), 0.0)
    spacing = np.maximum(np.append(apart, 0.0), np.append(0.0, apart))
    coarse = spacing > 2.0 * spacing[begun].max(initial=0.0)
    if np.any(touches & ~begun & (ends_of_edges(system) | coarse)):
        return "contact past the fine mesh"
    return "cycles done" if last["cycles"] >= cycles else ""
