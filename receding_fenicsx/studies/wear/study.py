"""Wear of a scene over many cycles: start, steps, ends, folder."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx import mpi
from receding_fenicsx.arrays import check_types
from receding_fenicsx.errors import InputError, MeshMisfit, NoEquilibrium, SolveError
from receding_fenicsx.evolution.histories import with_corners
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene, WearOptions
from receding_fenicsx.store.workspace import Case
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy import meshes
from receding_fenicsx.studies.runner import Kind, Runner, Study, StudyOptions, digest_of, run_study
from receding_fenicsx.studies.wear.result import WearStudy, ends_of_edges, figures, lengths
from receding_fenicsx.studies.wear.steps import Convected, NodePairs, Row, advance
from receding_fenicsx.timing import Countdown, Timer


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
    results = ("wear.csv", "wear.json", "wear.npz", "profiles.png", "zones.png", "fatigue.png")
    kind = Kind("wear study", "wear_of.json", results, shares=False)
    kind.check(out, None, options)
    timer = Timer(options.progress if comm.rank == 0 else None)
    system, partner, coarse = study.condense(scene, comm, timer.say), None, None
    with suppress(MeshMisfit):  # no coarser mesh fits
        partner = meshes.partner(scene, comm)
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
                return _wear(own, begun, other, runner, timer)

        return Study(same, combine)

    return run_study(kind, begin, out, None, options)


def wear_numbers(system: ContactSystem, scene: Scene) -> dict[str, float | str]:
    """Return the end of the wear of a condensed scene, for the table of a sweep."""
    own, _ = with_corners(system, scene)
    found = _wear(own, _begin(own, system), None, Runner(Kind("wear")), Timer())
    last = found.last | {"end": found.end, "volume_estimate": found.volume_estimate[-1]}
    return {f"wear_{name}": value for name, value in last.items()}


def _begin(scene: Scene, system: ContactSystem) -> tuple[NodePairs, Row]:
    """Return the mechanics of a scene and its first row; InputError: it cannot wear.

    Where the stroke is not small, profiles are carried along, if they can.
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
    if options.archard is not None and (system.has_branches or np.any(law.forward != law.backward)):
        raise InputError(
            "[wear] archard: friction differs by direction, or has a shear limit or a cohesion; "
            "give coefficient instead"
        )
    f = np.where(law.largest > 0.0, law.largest, np.inf)
    worn_by = (options.archard or 0.0) / f if options.coefficient is None else options.coefficient
    pairs = NodePairs(problem, worn_by)
    first, n = pairs.begin(), system.n
    first["step"] = max(1.0, 1e-3 * scene.wear.cycles)
    strokes = np.where(first["P"] > 0.0, 0.5 * first["path"], 0.0)
    touches = lengths(system) * (first["zone"] != State.SEPARATION)[mirror_of(system).index]
    edge = system.edges[mirror_of(system).index]
    sizes = [
        (float(strokes[system.edges == k].max()), float(touches[edge == k].sum()))
        for k in np.unique(edge)
    ]
    # that of the edge on which the stroke is largest against the contact
    stroke, width = max(sizes, key=lambda size: size[0] / (size[1] or np.inf))
    small = 0.05  # of the width, up to which node pairs stay opposite each other
    if stroke <= small * width:
        return pairs, first
    slides = np.all(first["zone"] != State.STICK)
    coupled = np.abs(system.K[:n, n:]).max() > 1e-8 * np.abs(system.K).max()
    half_planes = len(scene.bodies) == 2 and all(body.is_half_plane for body in scene.bodies)
    alone = half_planes and len(scene.contacts) == 1 and not system.has_branches
    if not alone or coupled or not slides:
        raise InputError(
            f"[wear]: the stroke {stroke:.4g} is {stroke / width:.2g} of the contact's width "
            f"{width:.4g}, above {small:g}: nodes do not stay opposite each other; this is "
            "modelled for two half-planes of equal materials that slide grossly, by friction alone"
        )
    found = Convected(pairs, scene.wear.share, pairs.slip_at_corners, 0.5 * width)
    return found, found.settled(first, np.zeros(2 * n))


def _wear(
    scene: Scene,
    begun: tuple[NodePairs, Row],
    other: tuple[Scene, ContactSystem] | None,
    runner: Runner,
    timer: Timer,
) -> WearStudy:
    """Take step after step on both meshes; write what there is, also where a step fails."""
    options, coarse = scene.wear, None
    depth = np.inf if options.depth is None else options.depth
    tell = Countdown(timer.say, "wear: cycle", "at most")

    def chain(
        model: NodePairs, first: Row, ends: list[float], depth: float, mesh: str
    ) -> tuple[list[Row], str, SolveError | None]:
        """Return the rows up to some numbers of cycles, why they end, and the error of a step."""
        rows, end = list[Row](), ""

        def add(work: Callable[[], Row], cycles: float, step: float) -> None:
            """Add a row; one of the same steps before is read from the folder."""

            def cells() -> dict[str, Any]:
                row = work()
                return {name: row[name].tolist() for name in row.dtype.names}

            at = mesh, len(rows), cycles, step
            found = runner.cells_of(Case(digest_of("wear", *at), labels=at), cells)
            if "lost" in found:  # in a folder of an earlier version
                raise NoEquilibrium(found["lost"])
            row = np.zeros((), first.dtype)
            for name, value in found.items():
                row[name] = value
            rows.append(row)

        add(lambda: first, 0.0, 0.0)
        for last in ends:
            while not (end := _end(model.problem.system, rows, last, depth)):
                row, until = rows[-1], last
                cycles, growth = float(row["cycles"]), model.rate * row["energy"]
                if depth < np.inf and (rate := growth[row["depth"].argmax()] or growth.max()) > 0.0:
                    until = min(last, float(cycles + (depth - row["depth"].max()) / rate))
                step = partial(advance, model, row, options.tolerance, until)
                try:
                    add(step, cycles, min(float(row["step"]), until - cycles))
                except SolveError as error:
                    return rows, str(error), error
                text = f"depth {rows[-1]['depth'].max():.4g}{mesh and ', '}{mesh}"
                tell(int(rows[-1]["cycles"]), options.cycles, text)
        return rows, end, None

    rows, end, failure = chain(*begun, [float(options.cycles)], depth, "")
    if isinstance(failure, NoEquilibrium) and np.any(rows[0]["zone"] == State.STICK):
        end, failure = "stick zone worn through", None
    if other is not None and failure is None:
        # the same numbers of cycles, as far as the coarser mesh goes
        with suppress(SolveError, InputError):
            model, first = _begin(*other)
            ends = [float(row["cycles"]) for row in rows]
            found, *_ = chain(model, first, ends, np.inf, "coarser")
            coarse = WearStudy(model, found, options.share, "")
    study = WearStudy(begun[0], rows, options.share, end, coarse)

    def files() -> dict[str, Any]:
        failed = {"failure": end} if failure else {}
        head = {"title": scene.title} | study.summary() | failed | {"timings": timer.seconds}
        return study.arrays() | {"wear.json": head} | figures(study)

    runner.write(files)
    if failure is not None:
        raise failure
    return study


def _end(system: ContactSystem, rows: list[Row], cycles: float, depth: float) -> str:
    """Return why a study ends with its last row, "" where it goes on."""
    first, last = rows[0], rows[-1]
    if last["depth"].max() >= (1.0 - 1e-3) * depth:  # within a thousandth
        return "depth reached"
    if last["energy"].sum() <= 1e-6 * first["energy"].sum():  # nothing more wears
        return "shakedown"
    if len(rows) > 1 and np.any(rows[-2]["zone"] == State.STICK):
        if not np.any(last["zone"] == State.STICK):
            return "stick zone worn through"
    begun, touches = (row["zone"] != State.SEPARATION for row in (first, last))
    apart = np.where(np.diff(system.edges) == 0, np.diff(system.x), 0.0)
    spacing = np.maximum(np.append(apart, 0.0), np.append(0.0, apart))
    coarse = spacing > 2.0 * spacing[begun].max(initial=0.0)
    if np.any(touches & ~begun & (ends_of_edges(system) | coarse)):
        return "contact past the fine mesh"
    return "cycles done" if last["cycles"] >= cycles else ""
