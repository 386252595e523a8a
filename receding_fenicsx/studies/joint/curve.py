r"""Curve of a joint: dissipation and secant stiffness over the amplitude of a driven load.

Between the events of the exact path the displacement q is linear in the load F. A second path with
a corner at every event therefore gives the work of the first loading exactly,

$$W(\alpha) = \int_0^{q(\alpha)} F \, dq .$$

By Masing's rule each branch of the loop is the first loading at twice its size, so that the loop
between $\pm\alpha$ dissipates

$$D_M(\alpha) = 8 W(\alpha) - 4 \alpha\, q(\alpha) .$$

It holds where contact and pressure stay as they are, as for uncoupled contacts that do not recede.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from scipy.stats import linregress

from receding_fenicsx import mpi
from receding_fenicsx.arrays import Array, as_numbers, check_types, described
from receding_fenicsx.errors import (
    InputError,
    MeshMisfit,
    NoEquilibrium,
    NoQuasiStaticContinuation,
    SolveError,
)
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import SHAKEDOWN
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.modal import mode_number, mode_system, preload_path
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_text
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import (
    Harmonic,
    HistoryOptions,
    Load,
    OutputOptions,
    Scene,
    SolverOptions,
    WearOptions,
)
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.scene.validate import validate
from receding_fenicsx.store.workspace import Case
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy import meshes
from receding_fenicsx.studies.runner import Kind, Runner, Study, StudyOptions, digest_of, run_study
from receding_fenicsx.studies.sweep import ERROR, Cell, Grid, SweepTable, grid_of, play_scene


@dataclass(frozen=True)
class Backbone:
    """First loading of a joint."""

    load: Array  # (n,) load factors of the drive, from 0
    # (n,) from 0; of a prescribed displacement the force along it times that at factor 1
    displacement: Array
    work: Array  # (n,) work of the drive
    # largest load factor with an equilibrium, to a relative 1e-6; infinite where all have one
    macroslip: float
    reason: str  # why there is none beyond it

    def masing(self, amplitude: Sequence[float] | Array) -> Array:
        """Return the dissipation per cycle by Masing's rule; NaN beyond macroslip."""
        found = np.full(len(amplitude), np.nan)
        for k, a in enumerate(amplitude):
            at = np.flatnonzero(self.load == a)
            if len(at):
                box = 4.0 * a * self.displacement[int(at[0])]
                D = 8.0 * self.work[int(at[0])] - box
                found[k] = D if D > 1e-10 * abs(box) else 0.0  # round-off
        return found


def first_loading(
    system: ContactSystem,
    drive: str,
    preload: Array,
    amplitudes: Sequence[float] | Array,
    solver: SolverOptions | None = None,
) -> Backbone:
    """Follow the first loading of a drive through all amplitudes, which are positive.

    ``preload`` are (k, n_loads) load factors from rest to the preload, those of the drive zero.
    SolveError: the preload has no equilibrium, or a solver fails.
    """
    names = system.load_names
    held = preload[-1]
    unit = np.array([float(name == drive) for name in names])
    reason = ""

    def played(load: Array) -> Record:
        path = np.vstack([preload, held + load[:, None] * unit])
        moves = np.append(True, np.any(np.diff(path, axis=0) != 0.0, axis=1))
        history = History(names, path[moves], np.zeros((0, len(names))))
        return evolve(system, history, solver, OutputOptions(1, "all"))

    if np.any(held):
        played(np.zeros(0))  # a preload that fails is no macroslip
    low, high = 0.0, float(max(amplitudes))
    least = 1e-6 * float(min(amplitudes))
    record: Record | None = None
    tried = high
    while high - low > 1e-6 * high and high > least:
        try:
            record, low = played(np.array([tried])), tried
        # any other failure is one of the solver
        except (NoEquilibrium, NoQuasiStaticContinuation) as failed:
            high, reason = tried, str(failed)
        # one that moves the contact at all is found at once
        tried = 0.5 * (low + high) if low > 0.0 else least
    if record is None or low == 0.0:
        raise SolveError(f"load '{drive}': moves the contact at any load factor: {reason}")
    at_events = record.events.load[:, names.index(drive)]
    given = np.array([a for a in amplitudes if a <= low])
    corners = np.unique(np.concatenate([[low], given, at_events[at_events > 0.0]]))
    table = played(corners).turning_points
    k, n = names.index(drive), len(corners)
    q = table.load_displacement[-n:, k]
    rest = table.load_displacement[-n - 1, k] if np.any(held) else 0.0
    load, displacement = np.append(0.0, corners), np.append(0.0, q - rest)
    if record.load_sign[k] > 0.0:
        # a prescribed displacement: its conjugate is the force
        steps = np.diff(load) * (displacement[1:] + displacement[:-1])
    else:
        steps = np.diff(displacement) * (load[1:] + load[:-1])
    work = np.append(0.0, 0.5 * np.cumsum(steps))
    return Backbone(load, displacement, work, low if reason else np.inf, reason)


class JointCurve:
    """Dissipation and stiffness over the amplitude; arrays over the n amplitudes.

    Attributes:
        drive: name of the driven load.
        amplitude: (n,) load factors.
        dissipation: (n,) per cycle of the limit; NaN where the case failed.
        estimate: (n,) change of the dissipation from a mesh of half as many elements, relative,
            the largest of an amplitude and its neighbours, times the dissipation; NaN without.
        stiffness: (n,) secant: range of the load factor over that of its displacement; of a
            prescribed displacement the inverse, of its conjugate.
        masing: (n,) dissipation by Masing's rule from the first loading.
        slip: (n,) largest slip range of a node in contact.
        kind: kind of each steady state, or "failed".
        backbone: the first loading.
        table: the sweep, with the reasons of failed cases.
        linear: (k,) angular frequencies of the stuck joint, with a mode as drive; else empty.
    """

    def __init__(
        self,
        drive: str,
        tables: Sequence[SweepTable],
        backbone: Backbone,
        linear: Array = np.zeros(0),
    ) -> None:
        """Collect the sweep over the amplitude, and if there is one that on a coarser mesh."""
        self.drive, self.backbone, self.linear, self.table = drive, backbone, linear, tables[0]

        def column(name: str, table: SweepTable = tables[0]) -> Array:
            return np.array([row.get(name) for row in table.rows], dtype=float)

        self.amplitude: Array = np.array(self.table.labels[0], dtype=float)
        self.dissipation, self.stiffness = column("dissipation"), column("stiffness")
        self.slip, self.masing = column("slip"), backbone.masing(self.amplitude)
        self.kind = tuple(row.get("kind") or "failed" for row in self.table.rows)
        alive = np.where(self.dissipation > 0.0, self.dissipation, np.nan)
        coarse = column("dissipation", tables[1]) if tables[1:] else np.nan * alive
        # a single change may be small by chance
        change = np.pad(np.abs(1.0 - coarse / alive), 1, constant_values=np.nan)
        self.estimate = alive * np.fmax(np.fmax(change[:-2], change[1:-1]), change[2:])

    @property
    def masing_defect(self) -> Array:
        """(n,) |D - D_Masing| / D, NaN where nothing is dissipated."""
        D = np.where(self.dissipation > 0.0, self.dissipation, np.nan)
        return np.abs(D - self.masing) / D

    @property
    def omega(self) -> Array:
        """(n,) angular frequency of a driven mode, sqrt(alpha / q)."""
        return np.sqrt(self.stiffness)

    @property
    def zeta(self) -> Array:
        """(n,) damping ratio of a driven mode, D / (2 pi omega^2 q^2)."""
        return self.dissipation * self.stiffness / (2.0 * np.pi * self.amplitude**2)

    @property
    def is_mode(self) -> bool:
        """Whether the drive is a vibration mode."""
        return self.drive.startswith("mode:")

    @property
    def exponent(self) -> tuple[float, float]:
        """Slope of log D over log amplitude, and its standard error; NaN for too few points."""
        alive = self.dissipation > 0.0
        if np.count_nonzero(alive) < 3:
            return np.nan, np.nan
        line = linregress(np.log(self.amplitude[alive]), np.log(self.dissipation[alive]))
        return float(line.slope), float(line.stderr)

    def rows(self) -> list[dict[str, Any]]:
        """Return the table: a row for each amplitude."""
        names = ["amplitude", "dissipation", "estimate", "stiffness", "masing", "masing_defect"]
        names += ["slip", "omega", "zeta"] if self.is_mode else ["slip"]
        columns = [getattr(self, name).tolist() for name in names]
        return [
            dict(zip(names, row, strict=True))
            | {key: case.get(key) for key in self.table.columns if key.startswith("wear_")}
            | {"kind": self.kind[k], ERROR: case[ERROR]}
            for k, (*row, case) in enumerate(zip(*columns, self.table.rows, strict=True))
        ]

    def __repr__(self) -> str:
        """Return the range of amplitudes, the exponent, the defect and macroslip."""
        slope, error = self.exponent
        held = self.dissipation[np.isfinite(self.dissipation)]
        rows = [
            ("amplitudes", f"{self.amplitude.min():.6g} to {self.amplitude.max():.6g}"),
            ("dissipation", f"{held.min():.6g} to {held.max():.6g}" if len(held) else "none found"),
            ("exponent", f"{slope:.3f} +- {error:.3f} of log D over log amplitude"),
            ("Masing defect", f"at most {np.nanmax([0.0, *self.masing_defect]):.3g}"),
        ]
        alive = np.isfinite(self.estimate) & (self.dissipation > 0.0)
        if np.any(alive):
            worst = np.max(self.estimate[alive] / self.dissipation[alive])
            rows.append(("mesh", f"D changes by at most {worst:.2g} from half as many elements"))
        if np.isfinite(self.backbone.macroslip):
            rows.append(("macroslip", f"at {self.backbone.macroslip:.6g}"))
        if len(self.linear):
            found = ", ".join(f"{omega:.6g}" for omega in self.linear)
            rows.append(("stuck modes", f"omega = {found}"))
        return described(f"JointCurve of '{self.drive}', {len(self.amplitude)} amplitudes", rows)


def joint_figure(curve: JointCurve) -> Figure:
    """Draw D and the secant stiffness over the amplitude, with Masing's rule and the exponent."""
    a, D, stiffness = curve.amplitude, curve.dissipation, curve.stiffness
    labels, unit = ("dissipation per cycle $D$", "secant stiffness"), np.ones(len(a))
    if curve.is_mode:
        labels = (r"damping ratio $\zeta$", r"angular frequency $\omega$")
        stiffness, unit = curve.omega, stiffness / (2.0 * np.pi * a**2)
    slope, _ = curve.exponent
    blue, orange = style.SERIES_COLOURS[:2]
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 2.9)
        left, right = figure.subplots(1, 2)
        fit = f", exponent of D {slope:.2f}" if np.isfinite(slope) else ""
        bars = np.nan_to_num(unit * curve.estimate)
        left.errorbar(a, unit * D, bars, fmt="o", ms=3, color=blue, label=f"limit cycle{fit}")
        left.plot(a, unit * curve.masing, color=orange, label="Masing's rule")
        left.set(xscale="log", ylabel=labels[0])
        if np.any(D > 0.0):
            left.set_yscale("log")
        right.plot(a, stiffness, "o-", ms=3, color=blue, label="limit cycle")
        right.set(xscale="log", ylabel=labels[1])
        for axes in (left, right):
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_xlabel(f"amplitude of {load_text(curve.drive)}")
            if np.isfinite(curve.backbone.macroslip):
                axes.axvline(curve.backbone.macroslip, label="macroslip", **style.GUIDE)
        left.legend(loc="upper left")
    return figure


def loop_numbers(record: Record, drive: str = "") -> dict[str, Cell]:
    """Return dissipation, secant stiffness, largest slip and kind of the last cycle.

    The drive is by default the load with an amplitude in the record's scene.
    """
    if not drive:
        harmonic = mpi.given(record.scene).history.harmonic
        drive = next(name for name, h in harmonic.items() if h.amplitude > 0.0)
    table, k = record.turning_points, record.load_names.index(drive)
    rows = np.flatnonzero(table.cycle == table.cycle.max())
    load, conjugate = table.load[rows, k], table.load_displacement[rows, k]
    low, high = int(np.argmin(load)), int(np.argmax(load))
    with np.errstate(divide="ignore"):  # a system may be rigid
        ratio = (load[high] - load[low]) / (conjugate[high] - conjugate[low])
    D, work = float(record.cycles.dissipation[-1]), np.ptp(load) * np.ptp(conjugate)
    energy = np.abs(table.load * table.load_displacement).sum(axis=1).max()
    # less is round-off
    still = record.steady.kind == SHAKEDOWN and D <= max(1e-10 * work, 1e-12 * energy)
    touching = np.all(table.state[rows] != State.SEPARATION, axis=0)
    return {
        "dissipation": 0.0 if still else D,
        "stiffness": float(1.0 / ratio if record.load_sign[k] > 0.0 else ratio),
        "slip": float(np.max(np.ptp(table.v[rows], axis=0)[touching], initial=0.0)),
        "kind": record.steady.kind,
        "cycles": len(record.cycles.dissipation),
        "residual_max": record.residual_max,
    }


def joint_curve(
    scene: Scene | ContactSystem,
    drive: str,
    amplitudes: Sequence[float] | Array,
    out: str | Path | None = None,
    workers: int | None = None,
    options: StudyOptions = StudyOptions(),
) -> JointCurve | None:
    """Find the limit cycles of a joint over the amplitude; all ranks of an MPI job call this.

    Args:
        scene: the joint; of its history only ``constant`` counts, the factors of the other loads
            (default 1). Or a condensed system, whose other loads have factor 1; without estimate.
        drive: name of the driven load, or "mode:1", "mode:2", ...: a vibration mode of a scene.
        amplitudes: load factors, positive; the drive goes between plus and minus each.
        out: folder for the table, the figure and the finished cases. None writes nothing.
        workers: number of new processes that play the cases.
        options: further options.

    Returns:
        The curve on rank 0, None on the others.

    Raises:
        InputError: the drive or the amplitudes cannot be used, or the folder holds another curve.
        SolveError: the preload has no equilibrium, or the smallest amplitude already moves all.
    """
    comm = mpi.world()
    check_types(
        "joint_curve",
        scene=(scene, Scene, ContactSystem),
        drive=(drive, str),
        out=(out, str, Path, None),
        options=(options, StudyOptions),
    )
    values, omega, partner = as_numbers(amplitudes, "joint_curve: amplitudes"), np.zeros(0), None
    system = given = scene if isinstance(scene, ContactSystem) else None
    held = {} if given is None else _preload(given, drive, values)
    cyclic = _driven(scene, drive, values) if isinstance(scene, Scene) else None
    kind = Kind("curve", "joint_cases.json", ("joint.csv", "joint.json", "joint.png"))
    kind.check(out, workers, options)
    if cyclic is not None and mode_number(drive):
        validate(cyclic)
        system, omega = mpi.on_root(comm, lambda: mode_system(cyclic)) or (None, omega)
    elif cyclic is not None:
        system = study.condense(cyclic, comm, options.progress, whole=True)

    def loaded() -> tuple[Array, Backbone]:
        own, played = mpi.given(system), cyclic
        if played is None and own.scene_toml:
            # bolts and interference have legs of their own
            known = replace(known_scene(own.scene_toml), history=HistoryOptions())
            played = _driven(known, drive, values)
        if played is not None:
            start = preload_path(own, played, drive)
        else:
            factors = np.array([held.get(name, 0.0) for name in own.load_names])
            start = np.array([0.0 * factors, factors] if np.any(factors) else [factors])
        solver = None if cyclic is None else cyclic.solver
        return start, first_loading(own, drive, start, values, solver)

    # the preload or the first loading may fail: before anything is written
    first = mpi.on_root(comm, loaded)
    if cyclic is not None:
        with suppress(MeshMisfit):  # without estimate where no coarser mesh fits
            partner = meshes.partner(replace(cyclic, wear=WearOptions()), comm)

    def begin() -> Study[JointCurve]:
        start, backbone = mpi.given(first)
        over = {f"history.harmonic.{drive}.amplitude": values.tolist()}
        scenes = [each for each in (cyclic, partner) if each is not None]
        grids = [grid_of(each, over, options.folder) for each in scenes]
        cases = []
        if given is not None:
            grids = [Grid(("amplitude",), (tuple(values.tolist()),), ())]
            body, unit = digest_of(given), np.array([name == drive for name in given.load_names])
            for value in values.tolist():
                loop = start[-1] + np.outer([value, -value, value], unit)
                history = History(given.load_names, np.vstack([start, loop[0]]), loop, 1000)
                cases.append(Case(digest_of(body, drive, value), (given, history, drive), (value,)))

        def combine(runner: Runner) -> JointCurve:
            for grid in grids if given is None else ():
                cases.extend(grid.cases(runner.systems, loop_numbers, True))
            outcomes = runner.outcomes(cases, play_scene if given is None else _play_system)
            n = len(values)
            tables = [g.table(outcomes[k * n : k * n + n]) for k, g in enumerate(grids)]
            curve = JointCurve(drive, tables, backbone, omega)
            runner.write(lambda: _files(scene.title if isinstance(scene, Scene) else "", curve))
            return curve

        same = {"drive": drive, "system": "" if given is None else digest_of(given)}
        # amplitudes may be added, or left out
        whose = _driven(scene, drive, np.ones(1)) if isinstance(scene, Scene) else None
        return Study(whose, combine, same, {"amplitudes": values.tolist()})

    return run_study(kind, begin, out, workers, options)


def _play_system(system: ContactSystem, history: History, drive: str) -> dict[str, Cell]:
    """Play a condensed system to its limit cycle."""
    record = evolve(system, history, None, OutputOptions(1, ()), until="limit")
    return loop_numbers(record, drive)


def _preload(scene: Scene | ContactSystem, drive: str, values: Array) -> dict[str, float]:
    """Check drive and amplitudes; return the load factors of the other loads."""
    names = scene.load_names if isinstance(scene, ContactSystem) else scene.driven_names
    if drive not in names:
        raise InputError(f"drive: no load is named '{drive}'; {suggestion(drive, names)}")
    if values.ndim != 1 or not len(values) or not np.all(np.isfinite(values) & (values > 0.0)):
        raise InputError("amplitudes: must be positive numbers, at least one")
    given = {} if isinstance(scene, ContactSystem) else scene.history.constant
    return {name: given.get(name, 1.0) for name in names if name != drive}


def _driven(scene: Scene, drive: str, values: Array) -> Scene:
    """Return the scene with a harmonic drive and the other loads constant."""
    if mode_number(drive):
        mode = Load(drive, mode=mode_number(drive))
        scene = replace(scene, loads=(*scene.loads, mode), probes=())
    held = _preload(scene, drive, values)
    # most cycles that are played where the limit is not found at once
    history = HistoryOptions("harmonic", constant=held, cycles=1000, until="limit")
    harmonic = {drive: Harmonic(amplitude=float(values[0]))}
    return replace(scene, history=replace(history, harmonic=harmonic), output=OutputOptions(1, ()))


def _files(title: str, curve: JointCurve) -> dict[str, Any]:
    """Return table, figure and summary."""
    rows, backbone = curve.rows(), curve.backbone
    first = ("load", "displacement", "work")
    summary = {
        "title": title,
        "drive": curve.drive,
        **dict(zip(("exponent", "exponent_error"), curve.exponent, strict=True)),
        "stuck_modes": curve.linear.tolist(),
        "macroslip": backbone.macroslip,
        "macroslip_reason": backbone.reason,
        "amplitudes": rows,
        "first_loading": {name: getattr(backbone, name).tolist() for name in first},
    }
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    return {"joint.csv": columns, "joint.png": joint_figure(curve), "joint.json": summary}
