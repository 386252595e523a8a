"""Instants, events and finished cycles of the modelled nodes, and the state at rest.

From the data of finished cycles a history is resumed and its record assembled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import CycleEnd, SteadyWatch
from receding_fenicsx.interface.system import ContactState, ContactSystem, frictional_form
from receding_fenicsx.interface.tolerances import STEADY_TOLERANCE
from receding_fenicsx.interface.uniqueness.watch import Uniqueness
from receding_fenicsx.scene.model import SolverOptions


class Instant(NamedTuple):
    """State of the modelled nodes at one place of the load path."""

    cycle: int  # cycle, 0 for the path from rest
    leg: int  # leg of the cycle, from 0
    s: float  # position along the leg, in [0, 1]
    load: Array  # (n_loads,) load factors
    v: Array  # (N,) tangential displacement, also where the solvers work without it
    state: ContactState  # state in the 2N layout of the solvers
    # (N,) states that pictures show where they differ from those of ``state``
    shown: NDArray[np.int8] | None = None


def event_rows(system: ContactSystem, count: int = 0) -> NDArray[np.void]:
    """Return rows for so many changes of state of modelled nodes, of fields as in `Instant`.

    ``probed`` are displacements and stresses (6 m,) at the m points of the probes, NaN if unknown.
    """
    probed = 0 if system.probes is None else 6 * len(system.probes.names)
    whole = [(key, "<i4") for key in ("cycle", "node", "leg")]
    loads = ("load", "<f8", (len(system.load_names),))
    states = [("old", "i1"), ("new", "i1")]
    return np.zeros(count, [*whole, *states, ("s", "<f8"), loads, ("probed", "<f8", (probed,))])


def instant(
    system: ContactSystem, place: tuple[int, int, float], load: Array, state: ContactState
) -> Instant:
    """Return a state, in the 2N layout, with its place on the load path: cycle, leg and position s.

    Without friction v is no unknown: v = slip_map @ [w; lambda].
    """
    v = state.v
    if system.slip_map is not None:
        v = system.slip_map @ np.concatenate([state.w, load])
    return Instant(*place, load, v, state)


def rest_state(system: ContactSystem, slip: Array | None = None) -> ContactState:
    """Return the state without loads: u = [slip; 0], r = 0, open nodes where there is a gap."""
    n = system.n
    v = np.zeros(n) if slip is None else slip
    state = np.where(system.g0 > 0.0, State.SEPARATION, State.STICK).astype(np.int8)
    return ContactState(np.concatenate([v, np.zeros(n)]), np.zeros(2 * n), state)


@dataclass
class Samples:
    """Instants and events along the legs of one cycle; rows of events in parts, as `event_rows`."""

    instants: list[Instant] = field(default_factory=list)
    events: list[NDArray[np.void]] = field(default_factory=list)


def events_of(system: ContactSystem, samples: Iterable[Samples]) -> NDArray[np.void]:
    """Return all rows of events."""
    parts = [part for one in samples for part in one.events]
    return np.concatenate([event_rows(system), *parts])


class Totals(NamedTuple):
    """Maxima and sums over the history up to an instant."""

    force_scale: float = 0.0  # largest nodal force
    energy_scale: float = 0.0  # largest energy of a leg
    residual: float = 0.0  # largest residual of the contact law over the force scale
    energy_error: float = 0.0  # largest relative error of a leg's energy identity
    sweeps: int = 0  # Gauss-Seidel sweeps
    events: int = 0  # changes of state of the whole contact
    jumps: int = 0  # jumps stepped over
    released: float = 0.0  # energy released by the jumps, of the modelled body


@dataclass(frozen=True)
class FinishedCycle:
    """Results of one finished cycle."""

    corners: list[Instant]  # the ends of its legs
    dissipation: Array  # (N,) frictional dissipation of the modelled nodes
    slip: Array  # (N,) v at its end less v at its start
    totals: Totals  # over the history up to its end
    samples: Samples | None = None  # its samples and events, where they were asked for
    # whether the path up to its end is the only one
    uniqueness: Uniqueness = field(default_factory=Uniqueness)
    choices: tuple[Choice, ...] = ()  # among several continuations, made in it


def steady_watch(
    system: ContactSystem, solver: SolverOptions, cycles: Iterable[FinishedCycle]
) -> SteadyWatch:
    """Return the watch for the steady state after some finished cycles."""
    model = frictional_form(system)
    tolerance = solver.steady_tolerance or STEADY_TOLERANCE
    watch = SteadyWatch(tolerance, model.K[: model.n], model.law)
    for cycle in cycles:
        watch.add(end_of(cycle))
    return watch


def end_of(cycle: FinishedCycle) -> CycleEnd:
    """Return what a cycle leaves for the watch."""
    corners, totals = cycle.corners, cycle.totals
    return CycleEnd(
        r=corners[-1].state.r,
        v=corners[-1].v,
        dissipation=cycle.dissipation,
        pressed=np.max([corner.state.P for corner in corners], axis=0),
        reach=np.max([np.abs(corner.state.u) for corner in corners], axis=0),
        force=totals.force_scale,
        residual=totals.residual,
    )
