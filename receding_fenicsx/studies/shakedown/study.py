"""Shakedown limits of a scene, on two meshes, with their diagram.

The limits of the scene's mesh are found first. The cases after that are the second mesh, parts of
the diagram, exact cycles and the opening contact.
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

from receding_fenicsx import mpi
from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, RecedingError, SolveError
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.shakedown.limits import (
    CONJECTURE,
    Certificates,
    ShakedownLimits,
    lower_limit,
    shakedown_limits,
    upper_limit,
)
from receding_fenicsx.interface.shakedown.margins import (
    Margins,
    load_range,
    minimise,
    prepared,
    with_bound,
)
from receding_fenicsx.interface.shakedown.opening import Opening
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_text
from receding_fenicsx.scene.identity import body_of, identity_of
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import to_toml
from receding_fenicsx.store.workspace import Case, Outcome
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy import meshes
from receding_fenicsx.studies.run import shared_system
from receding_fenicsx.studies.runner import Kind, Runner, Study, StudyOptions, digest_of, run_study
from receding_fenicsx.studies.shakedown.exact_cycles import BELOW, limit_by_cycles, opening_limit
from receding_fenicsx.timing import Timer


@dataclass(frozen=True)
class Diagram:
    """Limits (n,) over the mean of one load, NaN where not found; ``given`` is the scene's."""

    load: str
    mean: Array
    lower: Array
    upper: Array
    given: float


def means(margins: Margins, load: int, width: float) -> Array:
    """Return changes of a mean load, up to a width, over which a slip holds the contact."""
    ends = []
    for sign in (-1.0, 1.0):
        G = np.hstack([margins.G, sign * width * margins.by_load[:, [load]]])[: len(margins.kind)]
        cost = np.append(np.zeros(margins.G.shape[1]), -1.0)
        ends.append(sign * width * -minimise(cost, G, margins.c[: len(G)], 1.0).value)
    low, high = ends
    room = 1e-3 * (high - low)  # the outermost means just can be held
    n = 25 if len(margins.targets) <= 60 else 9  # each node needs a program
    # a mean load that cannot vary leaves one point
    return np.linspace(low + room, high - room, n) if high > low else np.zeros(1)


def limits_at(
    margins: Margins, load: int, changes: Sequence[float]
) -> dict[str, list[tuple[float, float]]]:
    """Return "limits", both for changes of one mean load; NaN where they were not found."""
    found = []
    proofs: Certificates = {}
    for change in changes:
        moved = replace(margins, c=margins.c + change * margins.by_load[:, load])
        low = top = np.nan
        # a point whose programs fail, or that no slip holds, is left out of the diagram
        with suppress(SolveError, InputError):
            upper = upper_limit(moved)
            top = -upper.value if upper.value < np.inf else np.nan
            lower, proofs = lower_limit(moved, upper, certificates=proofs)
            low = top if lower is None else min(lower.value, top)
        found.append((low * margins.range_scale, top * margins.range_scale))
    return {"limits": found}


@mpl.rc_context(style.RC)
def diagram_figure(diagram: Diagram, opening: Opening | None = None) -> Figure:
    """Draw both limits: mean load along, load range up; a dot for the range with opening nodes."""
    x, lower, upper = diagram.mean, diagram.lower, diagram.upper
    figure = style.new_figure(style.COLUMN, 2.9)
    axes = figure.subplots()
    seen = np.append(upper[np.isfinite(upper)], 0.0 if opening is None else opening.value)
    top = 1.25 * float(seen.max()) or 1.0
    areas = (
        ("#bdbdbd", "shakes down", 0.0 * x, lower),
        ("#e6e6e6", "depends on the start", lower, upper),
    )
    for colour, _, low, high in areas:
        axes.fill_between(x, np.minimum(low, top), np.minimum(high, top), color=colour, lw=0)
    axes.plot(x, upper, color="black", label=r"$\lambda_2$")
    axes.plot(x, lower, color="black", ls=(0, (4, 2)), label=r"$\lambda_1$")
    axes.axvline(diagram.given, **style.GUIDE)
    if opening is not None:
        dot = [diagram.given], [opening.value]
        axes.plot(*dot, "o", color="black", ms=4, zorder=5, label="opens without slip")
    entries = (("white", "slips for ever, or opens"), *(area[:2] for area in areas[::-1]))
    handles = axes.get_legend_handles_labels()[0]
    handles += [mpl.patches.Patch(fc=c, ec="black", lw=0.4, label=text) for c, text in entries]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, columnspacing=1.0)
    axes.set(xlim=(x.min(), x.max()) if len(x) > 1 else None, ylim=(0.0, top))
    axes.set(
        xlabel=f"mean load factor of {load_text(diagram.load)}", ylabel=r"load range $\lambda$"
    )
    return figure


@dataclass(frozen=True)
class ShakedownStudy:
    """Shakedown limits of a scene, with what tells how far they hold.

    Attributes:
        system: the condensed system.
        limits: its limits.
        meshes: number of modelled nodes, lower and upper limit of each mesh, the scene's first.
        diagram: limits over one mean load.
        by_cycles: interval of lambda in which cycles from rest or the safe slip begin to slip for
            ever, where a node unloads at the upper limit; else None.
        notes: sentences about the validity of the limits.
        opening: largest range of the opening contact that a program found and cycles verified.
    """

    system: ContactSystem
    limits: ShakedownLimits
    meshes: tuple[tuple[int, float, float], ...]
    diagram: Diagram
    by_cycles: tuple[float, float] | None
    notes: tuple[str, ...]
    opening: Opening | None = None

    def __str__(self) -> str:
        """Return the study as lines for the terminal."""
        limits = self.limits
        beyond = " of the closed contact" if limits.opens else ": above, it never stops"
        if np.isinf(limits.upper):
            beyond = ": the range never makes it slip from the safe slip"
        lines = [
            f"lower limit   {limits.lower:.6g}  ({limits.lower_is}): below, the contact stops "
            "slipping",
            f"upper limit   {limits.upper:.6g}{beyond}",
            f"residual      {limits.residual:.1e} of the largest force, dual gap {limits.gap:.1e}",
        ]
        if len(self.meshes) > 1:
            (own, *_), (nodes, lower, upper) = self.meshes
            lines.append(
                f"second mesh   {lower:.6g} and {upper:.6g} with {nodes} nodes instead of {own}"
            )
        lines += [f"{limit} binds   {limits.binding(limit)}" for limit in ("lower", "upper")]
        if self.by_cycles is not None:
            low, high = self.by_cycles
            lines.append(
                f"exact cycles  from rest or the safe slip end without slip up to {low:.4g}, "
                f"not at {high:.4g}"
            )
        if self.opening is not None:
            found = self.opening
            more = " (none larger was looked at)" if found.value > (1.0 - 1e-6) * found.top else ""
            more += " (search cut short)" if found.cut else ""
            lines.append(
                f"with opening  {found.value:.6g}{more}: nodes open and close without slip, found "
                "by a mixed-integer program, verified by exact cycles"
            )
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def shakedown(
    scene: Scene,
    out: str | Path | None = None,
    workers: int | None = None,
    options: StudyOptions = StudyOptions(),
) -> ShakedownStudy | None:
    """Find the shakedown limits of a scene's table [shakedown]; all ranks call this together.

    Args:
        scene: the scene.
        out: folder for ``shakedown.json``, ``safe_slip.csv`` and the diagram; None writes nothing.
        workers: number of new processes for the second mesh, the diagram and exact cycles.
        options: further options; there are no shards.

    Returns:
        The study on rank 0, None on the others; a RecedingError is raised on all alike.
    """
    comm = mpi.world()
    timer = Timer(options.progress if comm.rank == 0 else None)
    given = scene.shakedown
    if not given.mean or not given.range:
        raise InputError("[shakedown]: mean and range are missing; give the load factors of both")
    if scene.preloads:
        raise InputError(f"[shakedown]: is for loads alone; remove {', '.join(scene.preloads)}")
    results = ("shakedown.json", "safe_slip.csv", "shakedown.png")
    kind = Kind("shakedown study", "shakedown_cases.json", results, shares=False)
    kind.check(out, workers, options)
    # whole: a contact without friction is refused as such
    system = study.condense(scene, comm, timer.say, whole=True)
    with timer("limits"):
        limits = mpi.on_root(comm, lambda: _limits(scene, mpi.given(system)))
    partner: Scene | None = None
    failures: list[str] = []
    if all(body.mesh is None for body in scene.bodies):
        try:
            partner = meshes.partner(scene, comm)
        except RecedingError as error:  # the scene's own limits stand
            failures.append(f"no limits on a coarser mesh: {error}")

    def combine(runner: Runner) -> ShakedownStudy:
        with timer("cases"):
            own, parts = (mpi.given(system), mpi.given(limits)), workers or comm.size
            result = _combined(scene, partner, *own, runner, parts, failures)
        runner.write(lambda: _files(scene, result, timer.seconds))
        return result

    return run_study(kind, lambda: Study(scene, combine), out, workers, options)


def _limits(scene: Scene, system: ContactSystem) -> ShakedownLimits:
    """Return the limits of a scene on a mesh."""
    given = scene.shakedown
    return shakedown_limits(system, given.mean, given.range, given.separated, given.largest_slip)


def second_mesh(scene: Scene, body: str, systems: Path | None) -> dict[str, Any]:
    """Return number of modelled nodes and limits on another mesh."""
    found = _limits(scene, shared_system(scene, body, systems))
    return {"nodes": len(found.separated), "lower": found.lower, "upper": found.upper}


def opening_of(
    scene: Scene, system: ContactSystem, limits: ShakedownLimits, seen: float
) -> dict[str, Any]:
    """Return the largest range with opening nodes."""
    given = scene.shakedown
    found = vars(opening_limit(system, given.mean, given.range, limits, seen))
    return found | {name: found[name].tolist() for name in ("slip", "closed")}


def measure(work: Any, *arguments: Any) -> dict[str, Any]:
    """Measure one case by its own function."""
    found = work(*arguments)
    return dict(found) if isinstance(found, dict) else {"interval": found}


def _combined(
    scene: Scene,
    partner: Scene | None,
    system: ContactSystem,
    limits: ShakedownLimits,
    runner: Runner,
    parts: int,
    failures: list[str],
) -> ShakedownStudy:
    """Run the cases and return the study of their outcomes."""
    given, key = scene.shakedown, digest_of(identity_of(scene), system)
    loads = load_range(system, given.mean, given.range)
    margins = with_bound(prepared(system, loads, given.separated)[0], given.largest_slip)
    first = next(name for vertex in given.range for name in vertex if vertex[name] != 0.0)
    name = given.diagram or first
    load, own = scene.driven_names.index(name), given.mean.get(name, 0.0)
    size = max(abs(vertex.get(name, 0.0)) for vertex in given.range)
    width = max(1.5 * size * limits.upper if np.isfinite(limits.upper) else 0.0, abs(own)) or 1.0
    changes = means(margins, load, width)

    def outcomes(work: dict[str, tuple[Any, ...]]) -> dict[str, Outcome]:
        cases = [Case(digest_of(key, label), what, (label,)) for label, what in work.items()]
        return dict(zip(work, runner.outcomes(cases, measure), strict=True))

    work: dict[str, tuple[Any, ...]] = {
        f"diagram {k} of {parts}": (limits_at, margins, load, changes[k::parts].tolist())
        for k in range(min(parts, len(changes)))
    }
    pieces = list(work)
    plays = limits.opens and limits.upper > 0.0 and not np.any(system.g0 > 0.0)
    if partner is not None:
        work["second mesh"] = (second_mesh, partner, body_of(partner), runner.systems)
    if plays:
        range_of = given.mean, given.range, limits.upper, limits.safe_slip_modelled
        work["exact cycles"] = (limit_by_cycles, system, *range_of)
    found = outcomes(work)
    for reason in (each.error for name, each in found.items() if name != "second mesh"):
        if reason:
            raise SolveError(reason)
    both = np.zeros((len(changes), 2))
    for k, piece in enumerate(pieces):
        both[k :: len(pieces)] = found[piece].cells["limits"]
    diagram = Diagram(name, own + changes, both[:, 0], both[:, 1], own)
    sizes = [(len(limits.separated), limits.lower, limits.upper)]
    if partner is not None:
        second = found["second mesh"]
        if second.error:
            failures.append(f"no limits on a coarser mesh: {second.error}")
        else:
            sizes.append(tuple(second.cells[key] for key in ("nodes", "lower", "upper")))
    cycles, opening = None, None
    if plays:
        low, high = found["exact cycles"].cells["interval"]
        cycles = low, high
        last = outcomes({"opening": (opening_of, scene, system, limits, high)})["opening"]
        if last.error:  # cycles have told what they found
            failures.append(f"no range with opening nodes: {last.error}")
        else:
            arrays = {key: np.array(last.cells[key]) for key in ("slip", "closed")}
            opening = Opening(**(last.cells | arrays))
    if sizes[-1][2] > 1.01 * limits.upper:
        failures.append(
            "the upper limit falls as the mesh is refined: at a free edge the continuum may slip "
            "at any load range; both limits are those of the mesh"
        )
    notes = (*_notes(system, limits, cycles is not None), *failures)
    return ShakedownStudy(system, limits, tuple(sizes), diagram, cycles, notes, opening)


def _notes(system: ContactSystem, limits: ShakedownLimits, played: bool) -> tuple[str, ...]:
    """Return sentences about what the limits are limits of."""
    notes = []
    if np.any(limits.separated) or np.any(system.g0 > 0.0):
        notes.append(
            "at an edge where the contact is free to recede the continuum slips at any load range: "
            "both limits are those of the mesh, and fall on finer ones"
        )
    if system.half:
        notes.append("half of the body is modelled: the limits are those of mirror-symmetric slip")
    if limits.opens:
        found = "; what exact cycles from rest and from the safe slip find is given apart"
        notes.append(
            "a node unloads at the upper limit, which is that of the closed contact: beyond, the "
            f"contact may open and close without slip{found if played else ''}"
        )
    if limits.lower == 0.0:
        notes.append(
            "the lower limit is 0 because some residual slip unloads a node, or lets one touch, "
            "without any range; bound the slips of interest by [shakedown] largest_slip"
        )
    elif limits.lower_is == CONJECTURE:
        notes.append("the lower limit is proved for two nodes only; for more it is a conjecture")
    return tuple(notes)


# -- files ---------------------------------------------------------------------------------------


def _files(scene: Scene, result: ShakedownStudy, timings: dict[str, float]) -> dict[str, Any]:
    """Return the contents of the files; several edges have no profile of safe slip."""
    system, profile = result.system, {}
    if len(np.unique(system.edges)) == 1:
        x = mirror_of(system).odd(system.x)
        profile = {"safe_slip.csv": {"x": x, "value": result.limits.safe_slip}}
    limits, options, diagram = result.limits, scene.shakedown, result.diagram
    opening, found = None, result.opening
    if found is not None:
        opening = {
            **{key: value for key, value in vars(found).items() if key not in ("slip", "closed")},
            "found": "by a mixed-integer program, verified by exact cycles",
            "verified_at": BELOW * found.value,
            "opening_nodes": np.flatnonzero(~found.closed.all(axis=0)).tolist(),
            "slip": mirror_of(system).odd(found.slip).tolist(),
        }
    summary = {
        "title": scene.title,
        "mean": options.mean,
        "range": list(options.range),
        "modelled_nodes": system.n,
        "symmetry": "half" if system.half else "none",
        **{key: getattr(limits, key) for key in ("lower", "lower_is", "upper", "opens")},
        "active": [vars(active) for active in limits.active],
        "largest_slip": options.largest_slip,
        "separated": system.x[limits.separated].tolist(),
        "safe_slip": limits.safe_slip.tolist(),
        "residual": limits.residual,
        "gap": limits.gap,
        "meshes": [dict(zip(("nodes", "lower", "upper"), m, strict=True)) for m in result.meshes],
        "by_cycles": result.by_cycles,
        "opening": opening,
        "diagram": {"load": diagram.load}
        | {name: getattr(diagram, name).tolist() for name in ("mean", "lower", "upper")},
        "notes": list(result.notes),
        "timings": timings,
    }
    pictures = {"shakedown.png": diagram_figure(diagram, found)}
    return {"scene.toml": to_toml(scene)} | profile | pictures | {"shakedown.json": summary}
