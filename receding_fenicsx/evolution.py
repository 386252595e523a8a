"""Evolve a condensed contact along a load history, cycle after cycle, into a Record."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.history import History
from receding_fenicsx.interface.contact import (
    Array,
    ContactState,
    ContactSystem,
    Leg,
    State,
    frictional_form,
)
from receding_fenicsx.interface.cycles import SteadyWatch
from receding_fenicsx.interface.events import EventPath
from receding_fenicsx.interface.gauss_seidel import GaussSeidelOptions, GaussSeidelPath
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.output.collect import Change, Instant, Kept, events_table, states_table
from receding_fenicsx.output.record import Cycles, Record, Steady
from receding_fenicsx.scene import OutputOptions, SolverOptions

Progress = Callable[[int, int, str], None]
"""Called as progress(cycle, cycles, message) after every cycle."""

DEFAULT_KEPT = (0, 1, 2, 9)
"""Cycles that get samples and events by default, beside the last one."""

ENERGY_FLOOR = 1e-4
"""Energy of a leg, over the largest of any leg so far, under which its identity is not relative to
itself."""


def evolve(
    system: ContactSystem,
    history: History,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
    initial_slip: Array | None = None,
    progress: Progress | None = None,
) -> Record:
    """Evolve the contact from rest along the history (eqs. 4 to 15 of Ahn & Barber 2008).

    Args:
        system: the condensed body.
        history: path from rest, then cycles.
        solver: method and tolerances.
        output: which cycles get samples and events, and how many samples a leg.
        initial_slip: (N,) tangential displacement at rest from which the first slip is counted.
        progress: called after every cycle.

    Returns:
        The record of the whole contact.

    Raises:
        InputError: the history's loads are not the system's, or an array has the wrong length.
        SolveError: a solver found no answer that satisfies the contact law.
    """
    if history.load_names != system.load_names:
        raise InputError(
            f"the history drives loads {list(history.load_names)}, the system has "
            f"{list(system.load_names)}: name the same loads in the same order"
        )
    run = _Run(system, history, solver or SolverOptions(), output or OutputOptions())
    run.rest(initial_slip)
    try:
        run.cycle(0)
        for number in range(1, history.cycles + 1 if len(history.loop) else 1):
            run.cycle(number)
            if progress is not None:
                progress(number, history.cycles, f"change {run.watch.change[-1]:.1e}")
            if run.watch.cycle >= 0 and history.until_steady:
                break
    except SolveError as error:
        error.record = run.record()
        raise
    run.sample_last()
    return run.record()


class _Run:
    """The evolving state, and what has been collected for the record."""

    def __init__(
        self, system: ContactSystem, history: History, solver: SolverOptions, output: OutputOptions
    ) -> None:
        self.system, self.history, self.solver, self.output = system, history, solver, output
        self.model = frictional_form(system)
        self.tracer = make_tracer(self.model, solver)
        self.multiplicity = np.bincount(mirror_of(system).index)
        self.turning: list[Instant] = []
        self.kept: dict[int, Kept] = {}
        self.dissipation: list[Array] = []
        self.slip: list[Array] = []
        self.residual = self.energy_error = self.force_scale = self.energy_scale = 0.0
        self.sweeps = self.n_events = 0
        self.watch = SteadyWatch(solver.steady_tolerance)

    def rest(self, initial_slip: Array | None) -> None:
        """Lay the unloaded body on the plane."""
        n = self.system.n
        self.has_initial_slip = initial_slip is not None
        v = np.zeros(n) if initial_slip is None else np.array(initial_slip, dtype=float)
        if v.shape != (n,):
            raise InputError(f"initial_slip has shape {v.shape}, expected ({n},)")
        v[self.system.held[:n]] = 0.0
        state = np.where(self.system.g0 > 0.0, State.SEPARATION, State.STICK).astype(np.int8)
        self.now = ContactState(np.concatenate([v, np.zeros(n)]), np.zeros(2 * n), state)
        self.load = self.history.path[0]

    def cycle(self, number: int) -> None:
        """Trace the legs of one cycle and collect its quantities."""
        dissipation = np.zeros(self.system.n)
        wanted = self._wanted(number)
        self.last = number, self.now, self.load, self.force_scale
        kept = Kept()
        corners = [self._instant(number, 0, 0.0, self.load, self.now)]
        for k, (a, b) in enumerate(self._legs(number)):
            try:
                leg = self._trace(number, k, a, b, self.output.samples_per_leg if wanted else 0)
            except SolveError as error:
                error.args = (f"cycle {number}, leg {k}: {error}",)
                raise
            self._take(leg, jump=number == 0 and k == 0 and self.has_initial_slip)
            dissipation += leg.dissipation
            self.now, self.load = leg.end, b
            corners.append(self._instant(number, k, 1.0, b, leg.end))
            self.turning.append(corners[-1])
            self._keep(kept, number, k, (a, b), leg)
        if wanted:
            self.kept[number] = kept
        self.dissipation.append(dissipation)
        v = np.array([corner.v for corner in corners])
        self.slip.append(v[-1] - v[0])
        if number == 0:
            self.watch.start(self.now.r, v[-1])
        else:
            first, last = self.dissipation[1].sum(), dissipation.sum()
            slip_range = float(np.ptp(v, axis=0).max())
            self.watch.add(self.now.r, v[-1], slip_range, float(last), float(first))

    def sample_last(self) -> None:
        """Trace the last cycle once more from its start, for its samples, unless they are kept."""
        number, state, load, scale = self.last
        if number in self.kept or self.output.cycles is not None:
            return
        kept = Kept()
        end = self.now, self.load, self.force_scale
        self.now, self.load, self.force_scale = state, load, scale
        for k, (a, b) in enumerate(self._legs(number)):
            leg = self._trace(number, k, a, b, self.output.samples_per_leg)
            self._keep(kept, number, k, (a, b), leg)
            self.now, self.load, self.force_scale = leg.end, b, leg.force_scale
        self.kept[number] = kept
        self.now, self.load, self.force_scale = end

    def _legs(self, number: int) -> list[tuple[Array, Array]]:
        polyline = self.history.path if number == 0 else self.history.loop
        return list(pairwise(polyline))

    def _wanted(self, number: int) -> bool:
        """Return whether the cycle's samples were asked for by number."""
        wanted = DEFAULT_KEPT if self.output.cycles is None else self.output.cycles
        return wanted == "all" or number in wanted

    def _keep(self, kept: Kept, number: int, k: int, ends: tuple[Array, Array], leg: Leg) -> None:
        """Add a leg's samples and events to what is kept of its cycle."""
        a, b = ends
        for s, state in leg.samples:
            kept.instants.append(self._instant(number, k, s, (1 - s) * a + s * b, state))
        kept.changes += [
            Change(number, k, s, (1 - s) * a + s * b, *rest) for s, *rest in leg.events
        ]

    def _instant(self, cycle: int, leg: int, s: float, load: Array, state: ContactState) -> Instant:
        v = state.v
        if self.system.slip_map is not None:
            v = self.system.slip_map @ np.concatenate([state.w, load])
        return Instant(cycle, leg, s, load, v, state)

    def _trace(self, number: int, k: int, a: Array, b: Array, samples: int) -> Leg:
        """Trace one leg by the chosen method."""
        if number == 0 and k == 0 and self.has_initial_slip:
            return self.tracer.static_leg(self.now, (a, b), self.force_scale)
        return self.tracer.trace_leg(self.now, (a, b), self.force_scale, samples)

    def _take(self, leg: Leg, jump: bool) -> None:
        """Take over a leg's checks: residual, energy identity (not for a jump), counts."""
        self.force_scale = leg.force_scale
        self.residual = max(self.residual, leg.residual)
        if not jump:
            self.energy_error = max(self.energy_error, self._energy_error(leg))
        self.sweeps += leg.sweeps
        self.n_events += int(sum(self.multiplicity[event[1]] for event in leg.events))

    def _energy_error(self, leg: Leg) -> float:
        """Return the relative error of D + change of (1/2 u K u) + integral lambda r* . du = 0."""
        K = self.model.K
        stored = 0.5 * float((leg.end.u - self.now.u) @ K @ (leg.end.u + self.now.u))
        D = float(leg.dissipation.sum())
        self.energy_scale = max(self.energy_scale, abs(D) + abs(stored))
        scale = max(abs(D) + abs(stored), ENERGY_FLOOR * self.energy_scale)
        return abs(D + stored + leg.work) / scale if scale > 0.0 else 0.0

    def record(self) -> Record:
        """Return everything collected, for the whole contact."""
        system, mirror = self.system, mirror_of(self.system)
        n_loads = len(system.load_names)
        weight = mirror.total(system.weight)
        D = np.array(self.dissipation[1:]).reshape(-1, system.n)
        slip = np.array(self.slip[1:]).reshape(-1, system.n)
        flip = np.where(mirror.left, -1.0, 1.0)
        instants = [i for kept in self.kept.values() for i in kept.instants]
        changes = [c for kept in self.kept.values() for c in kept.changes]
        return Record(
            x=flip * system.x[mirror.index],
            points=system.points[mirror.index] * np.stack([flip, np.ones_like(flip)], axis=1),
            f=mirror.even(system.f),
            g0=mirror.even(system.g0),
            weight=weight,
            load_names=system.load_names,
            scene_toml=system.scene_toml,
            method=self.solver.method,
            modelled_nodes=system.n,
            modelled_dofs=int(np.sum(~self.model.held)),
            half=system.half,
            turning_points=states_table(system, mirror, self.turning),
            samples=states_table(system, mirror, instants),
            events=events_table(mirror, changes, n_loads),
            cycles=Cycles(
                dissipation=mirror.factor * D.sum(axis=1),
                dissipation_density=mirror.total(D) / np.where(weight > 0.0, weight, np.inf),
                slip_increment=mirror.odd(slip),
            ),
            dissipation_first_loading=mirror.factor * float(np.sum(self.dissipation[:1])),
            steady=Steady(
                reached=self.watch.cycle >= 0,
                cycle=self.watch.cycle,
                kind=self.watch.kind,
                period=self.watch.period,
                change=np.array(self.watch.change),
            ),
            residual_max=self.residual,
            energy_error_max=self.energy_error,
            sweeps=self.sweeps,
            n_events=self.n_events,
        )


def make_tracer(system: ContactSystem, solver: SolverOptions) -> GaussSeidelPath | EventPath:
    """Return what follows the legs by the method asked for."""
    if solver.method == "events":
        return EventPath(system)
    options = GaussSeidelOptions(
        over_relaxation=solver.over_relaxation,
        polish=solver.polish,
        change_tolerance=solver.change_tolerance,
        residual_tolerance=solver.residual_tolerance,
        max_sweeps=solver.max_sweeps,
    )
    return GaussSeidelPath(system, options, solver.steps_per_leg)
