"""Wear of a scene over many cycles: start, steps, ends; table, summary and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from receding_fenicsx import mpi
from receding_fenicsx.arrays import Array, check_types, described
from receding_fenicsx.errors import InputError, MeshMisfit, NoEquilibrium, SolveError
from receding_fenicsx.evolution.histories import with_corners
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.report.contact import CRITERIA
from receding_fenicsx.scene.model import Scene, WearOptions
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.store.workspace import Case
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy import meshes
from receding_fenicsx.studies.runner import Kind, Runner, Study, StudyOptions, digest_of, run_study
from receding_fenicsx.studies.wear.steps import Convected, NodePairs, Row, advance
from receding_fenicsx.timing import Countdown, Timer

COLUMNS = (
    *("cycles", "depth_max", "width", "volume", "dissipation"),
    *("contact_half_width", "stick_half_width"),
)
"""Columns of ``wear.csv``."""


class WearStudy:
    """The contact over the cycles: n rows, from 0 cycles, and the N nodes of the whole contact.

    Attributes:
        model: the mechanics.
        system: the unworn contact.
        rows: (n,) rows of :func:`~receding_fenicsx.studies.wear.steps.row_type`.
        end: why the last row is the last one.
        coarse: the study on a coarser mesh at the same cycles, where one fits.
        x: (N,) positions along the contact edge.
        cycles: (n,) numbers of cycles.
        depth: (n, N) depth that both bodies have lost together.
        depth_of_bodies: (n, 2, N) depth that each body has lost.
        pressure: (n, N) contact pressure at the turning point with the largest normal force.
        slip: (n, N) sliding distance of a cycle.
        zone: (n, N) state over a whole cycle: separation, stick, or (forward) slip.
        dissipation_per_cycle: (n,) dissipation of the limit cycle.
        dissipation: (n,) dissipation since the start.
        volume: (n,) worn volume of both bodies; of a plane problem that of unit thickness.
        depth_max: (n,) largest depth.
        width: (n,) width of the scar, the nodes deeper than a thousandth of the largest depth.
        contact_half_width: (n,) half the length that touches in a cycle; a radius where that begins
            on the axis.
        stick_half_width: (n,) half the length that sticks throughout a cycle.
        volume_estimate: (n,) estimated error of the volume by the steps and the mesh.
        depth_estimate: (n,) that of the largest depth; infinite at an end of a contact edge, whose
            corner makes it grow with every finer mesh.
    """

    def __init__(
        self,
        model: NodePairs,
        rows: Sequence[Row],
        share: float,
        end: str,
        coarse: WearStudy | None = None,
    ) -> None:
        """Collect the rows; ``share`` is the part of the wear that the first body takes."""
        self.model, self.system, self.end, self.coarse = model, model.whole.system, end, coarse
        self.rows: NDArray[Any] = np.stack(rows)
        row, system, mirror = self.rows, self.system, mirror_of(self.system)
        self.x, weight = mirror.odd(system.x), mirror.total(system.weight)
        self.cycles: Array = row["cycles"]
        self.depth, self.slip = mirror.even(row["depth"]), mirror.even(row["path"])
        self.depth_of_bodies = np.array([share, 1.0 - share])[:, None] * self.depth[:, None]
        if model.carried:
            self.depth_of_bodies = mirror.even(row["worn"])
        self.pressure = mirror.total(row["P"]) / np.where(weight > 0.0, weight, np.inf)
        self.zone: NDArray[np.int8] = row["zone"][:, mirror.index]
        self.dissipation_per_cycle = mirror.factor * row["energy"].sum(axis=1)
        self.dissipation = mirror.factor * row["dissipated"]
        self.volume = mirror.factor * (row["depth"] @ system.weight)
        self.depth_max = self.depth.max(axis=1)
        length = lengths(system)
        self.width = ((self.depth > 1e-3 * self.depth_max[:, None]) & (self.depth > 0.0)) @ length
        self.contact_half_width = 0.5 * ((self.zone != State.SEPARATION) @ length)
        self.stick_half_width = 0.5 * ((self.zone == State.STICK) @ length)
        by_mesh = np.zeros(len(rows))
        if coarse is not None and len(rows) > 1:
            # errors are of first order at zone ends; a single change may be small by chance
            ratio = (len(self.x) - 1) / (len(coarse.x) - 1)
            same = np.searchsorted(coarse.cycles, self.cycles[1:], side="right") - 1
            volume = np.abs(1.0 - coarse.volume[same] / self.volume[1:])
            depth = np.abs(1.0 - coarse.depth_max[same] / self.depth_max[1:])
            by_mesh[1:] = np.maximum(volume, depth) / (ratio - 1.0)
        steps: Array = row["estimate"]
        self.volume_estimate = mirror.factor * (steps @ system.weight) + by_mesh * self.volume
        # the deepest point lies between nodes: a parabola through three of them is deeper
        beside = np.pad(self.depth, ((0, 0), (1, 1)), mode="reflect")
        deepest = self.depth.argmax(axis=1)[:, None]
        bend = np.take_along_axis(np.abs(np.diff(beside, 2)), deepest, 1)[:, 0] / 8.0
        at_corner = ends_of_edges(system)[row["depth"].argmax(axis=1)] & (self.depth_max > 0.0)
        error = steps.max(axis=1) + by_mesh * self.depth_max + bend
        self.depth_estimate = np.where(at_corner, np.inf, error)

    @property
    def last(self) -> dict[str, float]:
        """The last row of ``wear.csv``."""
        return {name: float(getattr(self, name)[-1]) for name in COLUMNS}

    def record(self, row: int) -> Record:
        """Return the record of the cycle of a row: all that a run knows of the worn contact."""
        if self.model.carried:
            raise InputError("wear: profiles that a stroke carries along have no single cycle")
        return self.model.record(self.rows[row])

    def fatigue(self) -> list[dict[str, Any]]:
        """Return the fatigue parameters at some of the cycles, evenly by the depth."""
        scene = known_scene(self.system.scene_toml) if self.system.scene_toml else None
        if scene is None or scene.fatigue is None or self.model.carried:
            return []
        return [
            {"cycles": float(self.cycles[k]), **fatigue_summary(self.record(k))["fatigue"]}
            for k in self.shown(11)
        ]

    def shown(self, count: int) -> NDArray[np.int64]:
        """Return at most so many rows, the first and the last one among them, evenly by depth."""
        wanted = np.linspace(0.0, self.depth_max[-1], count)
        nearest = [np.argmin(np.abs(self.depth_max - value)) for value in wanted]
        return np.unique([*nearest, len(self.rows) - 1])

    def summary(self) -> dict[str, Any]:
        """Return the content of ``wear.json`` but for the scene and the costs."""
        profile = ("depth", "depth_of_bodies", "pressure", "slip")
        return {
            "end": self.end,
            "steps": len(self.rows) - 1,
            **self.last,
            "estimates": {
                "depth_max": float(self.depth_estimate[-1]),
                "volume": float(self.volume_estimate[-1]),
            },
            "carried": self.model.carried,
            "fatigue": self.fatigue(),
            "dissipation_per_cycle": self.dissipation_per_cycle.tolist(),
            "profile": {"x": self.x.tolist()}
            | {name: getattr(self, name)[-1].tolist() for name in profile},
        }

    def arrays(self) -> dict[str, Any]:
        """Return the contents of ``wear.csv`` and ``wear.npz``, fields over cycles and nodes."""
        names = ("x", "cycles", "depth", "depth_of_bodies", "pressure", "slip", "zone")
        more = ("dissipation_per_cycle", "volume", "volume_estimate")
        fields = {name: getattr(self, name) for name in names + more}
        return {"wear.csv": {name: getattr(self, name) for name in COLUMNS}, "wear.npz": fields}

    def __repr__(self) -> str:
        """Return the last row, its estimates, and the end."""
        last, by = self.last, " (steps)" if self.coarse is None else " (steps, mesh)"
        contact, stick = last["contact_half_width"], last["stick_half_width"]
        rows = [
            ("end", self.end),
            ("depth", f"{last['depth_max']:.6g} +- {self.depth_estimate[-1]:.1g}{by}"),
            ("volume", f"{last['volume']:.6g} +- {self.volume_estimate[-1]:.1g}{by}"),
            ("scar", f"{last['width']:.6g} wide"),
            ("half widths", f"contact {contact:.6g}, stick {stick:.6g}"),
            ("dissipation", f"{last['dissipation']:.6g}"),
        ]
        return described(f"Wear: {last['cycles']:.6g} cycles in {len(self.rows) - 1} steps", rows)


def lengths(system: ContactSystem) -> Array:
    """Return the length to each node of the whole contact, as zones end midway between nodes."""
    mirror = mirror_of(system)
    same = np.diff(system.edges[mirror.index]) == 0
    half = np.where(same, 0.5 * np.diff(mirror.odd(system.x)), 0.0)
    return np.append(half, 0.0) + np.append(0.0, half)


def ends_of_edges(system: ContactSystem) -> NDArray[np.bool_]:
    """Return which nodes are ends of contact edges, (N,), but not on an axis of symmetry."""
    apart = np.diff(system.edges, prepend=-1, append=-1) != 0
    found = apart[:-1] | apart[1:]
    if system.half or system.axisymmetric:
        found &= np.abs(system.points[:, 0]) > 1e-9 * np.abs(system.points).max()
    return found


def wear(
    scene: Scene, out: str | Path | None = None, options: StudyOptions = StudyOptions()
) -> WearStudy | None:
    """Wear a contact over the cycles of the table [wear]; all ranks of an MPI job call this.

    Args:
        scene: the scene, with cycles, whose number does not count.
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
    system, options, law = problem.system, scene.wear, problem.system.law
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
    sizes = [(strokes[system.edges == k].max(), touches[edge == k].sum()) for k in np.unique(edge)]
    # those of the edge on which the stroke is largest against the contact
    stroke, width = max(sizes, key=lambda size: size[0] / (size[1] or np.inf))
    small = 0.05  # of the width, up to which node pairs stay opposite each other
    if stroke <= small * width:
        return pairs, first
    slides = np.all(first["zone"] != State.STICK)
    coupled = np.abs(system.K[:n, n:]).max() > 1e-8 * np.abs(system.K).max()
    half_planes = len(scene.bodies) == 2 and all(body.is_half_plane for body in scene.bodies)
    alone = half_planes and len(scene.contacts) == 1 and not system.has_branches
    if not alone or coupled or not slides:
        raise MeshMisfit(
            f"[wear]: the stroke {stroke:.4g} is {stroke / width:.2g} of the contact's width "
            f"{width:.4g}, above {small:g}: nodes do not stay opposite each other; this is "
            "modelled for two half-planes of equal materials that slide grossly, by friction alone"
        )
    found = Convected(pairs, scene.wear.share, 0.5 * width)
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
            found = runner.kept(Case(digest_of("wear", *at), labels=at), cells)
            row = np.zeros((), first.dtype)
            for name, value in found.items():
                row[name] = value
            rows.append(row)

        add(lambda: first, 0.0, 0.0)
        for last in ends:
            while not (end := _end(model.problem.system, rows, last, depth)):
                row, until = rows[-1], last
                cycles, growth = float(row["cycles"]), model.rate * row["energy"]
                if (rate := growth[row["depth"].argmax()] or growth.max()) > 0.0:
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
        with suppress(SolveError, MeshMisfit):  # or the stroke is too long on it
            model, first = _begin(*other)
            ends = [float(row["cycles"]) for row in rows]
            found, *_ = chain(model, first, ends, np.inf, "coarser")
            coarse = WearStudy(model, found, options.share, "")
    study = WearStudy(begun[0], rows, options.share, end, coarse)

    def files() -> dict[str, Any]:
        summary, failed = study.summary(), {"failure": end} if failure else {}
        head = {"title": scene.title} | summary | failed | {"timings": timer.seconds}
        return study.arrays() | {"wear.json": head} | figures(study, summary["fatigue"])

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


# -- figures --------------------------------------------------------------------------------------


@mpl.rc_context(style.RC)
def figures(study: WearStudy, fatigue: list[dict[str, Any]]) -> dict[str, Figure]:
    """Draw a study: profiles and zones, and fatigue parameters where there are some."""
    touches = study.x[np.any(study.zone != State.SEPARATION, axis=0)]
    touches = touches if len(touches) else study.x
    # what touches in any row, with some room
    room = 0.1 * np.ptp(touches)
    seen = touches.min() - room, touches.max() + room
    found = {"profiles.png": _profiles(study, seen), "zones.png": _zones(study, seen)}
    return found | ({"fatigue.png": fatigue_figure(fatigue)} if fatigue else {})


def _profiles(study: WearStudy, seen: tuple[float, float]) -> Figure:
    """Draw worn depth and pressure over x at some numbers of cycles, evenly by the depth."""
    figure = style.new_figure(style.COLUMN, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for row, colour in zip(study.shown(5), style.SERIES_COLOURS, strict=False):
        upper.plot(study.x, study.pressure[row], color=colour)
        label = f"{study.cycles[row]:,.0f} cycles"
        lower.plot(study.x, -study.depth[row], color=colour, label=label)
    upper.set(ylabel="$p$", ylim=(0.0, None))
    lower.set(xlabel="$x$", ylabel="worn depth, downwards", xlim=seen)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


@mpl.rc_context(style.RC)
def fatigue_figure(found: list[dict[str, Any]]) -> Figure:
    """Draw what :meth:`WearStudy.fatigue` returns, each parameter over its value at the start."""
    figure = style.new_figure(style.COLUMN, 2.8)
    axes = figure.subplots()
    cycles = [one["cycles"] for one in found]
    for name, marker, colour in zip(
        found[0]["parameters"], "os^vDx", style.SERIES_COLOURS, strict=False
    ):
        value = np.array([one["parameters"][name]["max"] for one in found])
        if value[0] > 0.0:
            (line,) = axes.plot(cycles, value / value[0], color=colour, label=CRITERIA[name])
            line.set(marker=marker, mfc="none")
    axes.set(xlabel="cycles", ylabel="worst value over that at the start", ylim=(0.0, None))
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def _zones(study: WearStudy, seen: tuple[float, float]) -> Figure:
    """Draw stick, slip and separation over the cycles upwards."""
    x, cycles = study.x, np.append(study.cycles, study.cycles[-1])
    edges = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    figure = style.new_figure(style.COLUMN, 3.2)
    axes = figure.subplots()
    style.state_mesh(axes, edges, cycles, study.zone)
    axes.set(xlabel="$x$", ylabel="cycles", xlim=seen)
    if cycles[-1] > 0.0:
        # a power of ten, below which no tick but 0 stands
        linear = 10.0 ** np.ceil(np.log10(max(1.0, 1e-3 * cycles[-1])))
        axes.set_yscale("symlog", linthresh=linear)
    patches = style.state_patches(np.unique(study.zone))
    for patch in patches:  # of a whole cycle, which slips both ways
        patch.set_label(str(patch.get_label())[3:].removeprefix("forward "))
    figure.legend(handles=patches, loc="outside upper center", ncols=len(patches))
    return figure
