"""Find the shakedown limits of a scene on all ranks, on two meshes, with their diagram."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx import mpi
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.interface.shakedown.limits import (
    CONJECTURE,
    ShakedownLimits,
    assembled,
    lower_limit,
    upper_limit,
)
from receding_fenicsx.interface.shakedown.margins import (
    LoadRange,
    Margins,
    load_range,
    prepared,
    with_bound,
)
from receding_fenicsx.interface.shakedown.programs import Answer
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.studies import run as study
from receding_fenicsx.studies.accuracy.meshes import coarser
from receding_fenicsx.studies.shakedown.cycles import limit_by_cycles
from receding_fenicsx.studies.shakedown.diagram import Diagram, limits_at, means
from receding_fenicsx.studies.shakedown.folder import STUDY, write
from receding_fenicsx.studies.shakedown.opening import opening_limit
from receding_fenicsx.studies.shakedown.result import ShakedownStudy
from receding_fenicsx.timing import Say, Timer

if TYPE_CHECKING:
    from mpi4py import MPI

EDGE_NOTE = (
    "at an edge where the contact is free to recede the continuum slips at any load range: both "
    "limits are those of the mesh, and fall on finer ones"
)
FALLS = 0.01
"""Fall of the upper limit from the second mesh to the scene's, over it, that is told."""
OPENS_NOTE = (
    "a node unloads at the upper limit, which is that of the closed contact: beyond, the contact "
    "may open and close without slip"
)
CYCLES_NOTE = "; what exact cycles from rest and from the safe slip find is given apart"
ZERO_NOTE = (
    "the lower limit is 0 because some residual slip unloads a node, or lets one touch, without "
    "any range; bound the slips of interest by [shakedown] largest_slip"
)
"""Sentences about the validity of the limits."""


def shakedown(
    scene: Scene,
    out: str | Path | None = None,
    overwrite: bool = False,
    comm: MPI.Comm | None = None,
    progress: Say | None = None,
) -> ShakedownStudy | None:
    """Find the shakedown limits of a scene's table [shakedown]; all ranks call this together.

    Args:
        scene: the scene.
        out: folder for ``shakedown.json``, ``safe_slip.csv`` and the diagram; None writes nothing.
        overwrite: replace an earlier study.
        comm: communicator; all processes of the job when left out.
        progress: called on rank 0 with the name of each stage.

    Returns:
        The study on rank 0, None on the others.

    Raises:
        RecedingError: on all ranks alike.
    """
    comm = comm or mpi.world()
    timer = Timer(progress if comm.rank == 0 else None)
    options = scene.shakedown
    if not options.mean or not options.range:
        raise InputError("[shakedown]: mean and range are missing; give the load factors of both")
    if scene.preloads:
        raise InputError(f"[shakedown]: is for loads alone; remove {', '.join(scene.preloads)}")
    if out is not None:
        mpi.on_root(comm, lambda: STUDY.check(Path(out), overwrite))
    # whole: a contact without friction is refused as such
    system = study.condense(scene, comm, timer.say, whole=True)
    with timer("limits"):
        limits, margins = _limits(scene, system, comm)
    meshes, failure = [limits], ""
    if all(body.mesh is None for body in scene.bodies):
        with timer("second mesh"):
            try:
                partner = comm.bcast(mpi.on_root(comm, lambda: coarser(scene)))
                if partner is not None:
                    coarse = study.condense(partner, comm, whole=True)
                    meshes.append(_limits(scene, coarse, comm)[0])
            except RecedingError as error:  # the same on all ranks; the scene's own limits stand
                failure = f"no limits on a coarser mesh: {error}"
    with timer("diagram"):
        diagram = _diagram(scene, margins, limits, comm)

    def finish() -> ShakedownStudy:
        own, found = mpi.given(system), mpi.given(limits)
        cycles, opening, failures = None, None, [failure] if failure else []
        if found.opens and found.upper > 0.0 and not np.any(own.g0 > 0.0):
            with timer("cycles"):
                start = found.safe_slip_modelled
                cycles = limit_by_cycles(own, options.mean, options.range, found.upper, start)
            with timer("opening"):
                try:
                    opening = opening_limit(own, options.mean, options.range, found, cycles[1])
                except RecedingError as error:  # cycles have told what they found
                    failures.append(f"no range with opening nodes: {error}")
        sizes = tuple((len(m.separated), m.lower, m.upper) for m in map(mpi.given, meshes))
        if sizes[-1][2] > (1.0 + FALLS) * found.upper:
            failures.append(
                "the upper limit falls as the mesh is refined: at a free edge the continuum may "
                "slip at any load range; both limits are those of the mesh"
            )
        notes = (*_notes(own, found, cycles is not None), *failures)
        result = ShakedownStudy(own, found, sizes, diagram, cycles, notes, opening)
        if out is not None:
            write(Path(out), scene, result, timer.seconds)
        return result

    return mpi.on_root(comm, finish)


def _limits(
    scene: Scene, system: ContactSystem | None, comm: MPI.Comm
) -> tuple[ShakedownLimits | None, Margins]:
    """Return the limits on rank 0 and the margins on all; the nodes' programs are shared."""
    options = scene.shakedown

    def begin() -> tuple[LoadRange, Margins, Any, Answer]:
        own = mpi.given(system)
        loads = load_range(own, options.mean, options.range)
        margins, away = prepared(own, loads, options.separated)
        return loads, margins, away, upper_limit(margins)

    loads, margins, away, upper = comm.bcast(mpi.on_root(comm, begin))
    mine = range(comm.rank, len(margins.targets), comm.size)
    bounded = with_bound(margins, options.largest_slip)
    part = mpi.on_all(comm, lambda: lower_limit(bounded, upper, mine)[0])
    parts = [found for found in comm.allgather(part) if found is not None]
    lower = min(parts, key=lambda found: found.value, default=None)

    def end() -> ShakedownLimits:
        return assembled(mpi.given(system), loads, margins, upper, lower, away)

    return mpi.on_root(comm, end), bounded


def _diagram(
    scene: Scene, margins: Margins, limits: ShakedownLimits | None, comm: MPI.Comm
) -> Diagram:
    """Return the diagram on all ranks, each of which has found some of its points."""
    options, names = scene.shakedown, scene.driven_names
    first = next(name for vertex in options.range for name in vertex if vertex[name] != 0.0)
    name = options.diagram or first
    size = max(abs(vertex.get(name, 0.0)) for vertex in options.range)
    own = options.mean.get(name, 0.0)

    def span() -> Any:
        top = mpi.given(limits).upper
        width = max(1.5 * size * top if np.isfinite(top) else 0.0, abs(own)) or 1.0
        return means(margins, names.index(name), width)

    changes = comm.bcast(mpi.on_root(comm, span))
    mine: Sequence[float] = changes[comm.rank :: comm.size]
    part = mpi.on_all(comm, lambda: limits_at(margins, names.index(name), mine))
    both = np.zeros((len(changes), 2))
    for rank, found in enumerate(comm.allgather(part)):
        if found:
            both[rank :: comm.size] = found
    return Diagram(name, own + changes, both[:, 0], both[:, 1], own)


def _notes(system: ContactSystem, limits: ShakedownLimits, played: bool) -> tuple[str, ...]:
    """Return sentences about what the limits are limits of."""
    notes = []
    if np.any(limits.separated) or np.any(system.g0 > 0.0):
        notes.append(EDGE_NOTE)
    if system.half:
        notes.append("half of the body is modelled: the limits are those of mirror-symmetric slip")
    if limits.opens:
        notes.append(OPENS_NOTE + (CYCLES_NOTE if played else ""))
    if limits.lower == 0.0:
        notes.append(ZERO_NOTE)
    elif limits.lower_is == CONJECTURE:
        notes.append("the lower limit is proved for two nodes only; for more it is a conjecture")
    return tuple(notes)
