"""Evolve a condensed contact along a load history, cycle after cycle, into a Record."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.collect import (
    Change,
    Instant,
    Kept,
    Passed,
    Totals,
    record_of,
    watch,
)
from receding_fenicsx.evolution.journal import Journal
from receding_fenicsx.evolution.prepare import system_for
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.solvers import make_solver
from receding_fenicsx.interface.law import STATE_NAMES, State
from receding_fenicsx.interface.measures.steady import SteadyWatch
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.normal_form import frictional_form
from receding_fenicsx.interface.system import (
    Array,
    ContactState,
    ContactSystem,
    Leg,
    typical_stiffness,
)
from receding_fenicsx.interface.system_checks import check_range, check_system
from receding_fenicsx.scene.history import History, check_history, from_scene
from receding_fenicsx.scene.identity import body_difference
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.toml_file import from_toml
from receding_fenicsx.scene.validate import validate

log = logging.getLogger(__name__)

Progress = Callable[[int, int, str], None]
"""Called as progress(cycle, cycles, message) after every cycle."""

DEFAULT_KEPT = (0, 1, 2, 9)
"""Cycles that get samples and events by default, beside the last one."""

ENERGY_FLOOR = 1e-4
"""Energy of a leg, over the largest of any leg so far, under which its identity is not relative to
itself."""


def evolve(
    system: ContactSystem,
    history: Scene | History,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
    initial_slip: Array | None = None,
    progress: Progress | None = None,
    journal: Journal | None = None,
) -> Record:
    """Evolve the contact from rest along a history (eqs. 4 to 15 of Ahn & Barber 2008).

    ``evolve(system, scene)`` plays all of a scene on the body that the system was condensed from:
    friction, gap, history, initial slip, solver and output are the scene's, and the record is that
    of :func:`~receding_fenicsx.study.run`, bit by bit.

    ``evolve(system, History(...))`` plays a path of load factors on the system as it is. No scene
    tells what was played, and the record's ``scene_toml`` is empty.

    Args:
        system: the condensed body.
        history: a scene; or a path from rest, then cycles.
        solver: method and tolerances; not with a scene.
        output: which cycles get samples and events, and how many samples a leg; not with a scene.
        initial_slip: (N,) tangential displacement at rest from which the first slip is counted; the
            first leg is then one static problem. At nodes that are open it counts for nothing. Not
            with a scene.
        progress: called after every cycle.
        journal: finished cycles to go on from, and where further ones go. At each of its
            checkpoints all that is remembered of the way (factor, rates) is made anew, so that
            going on from there changes no bit.

    Returns:
        The record of the whole contact.

    Raises:
        InputError: the scene's body is not the system's, the history's loads are not, an array has
            a wrong length or values without meaning, or an open node lands where the first leg is
            one static problem.
        SolveError: a solver found no answer that satisfies the contact law.
    """
    if isinstance(history, Scene):
        if solver is not None or output is not None or initial_slip is not None:
            raise InputError(
                "evolve: a scene brings its own solver, output and initial slip; change the scene "
                "by dataclasses.replace"
            )
        scene, system = history, _system_of(history, system)
        history, solver, output = from_scene(scene), scene.solver, scene.output
        slip = scene.history.initial_slip
        initial_slip = None if slip is None else evaluate(slip, system.x)
        journal = journal or Journal(scene.output.checkpoint_cycles)
    else:
        system = replace(system, scene_toml="")
    check_system(system)
    check_history(history, system.load_names)
    check_range(system, np.vstack([history.path, history.loop]))
    journal = journal or Journal()
    passed = journal.passed
    run = _Run(system, history, solver or SolverOptions(), output or OutputOptions(), passed)
    run.lay(initial_slip)
    run.sample_passed()
    run.go_on()
    try:
        for number in range(len(passed), history.cycles + 1 if len(history.loop) else 1):
            if run.watch.cycle >= 0 and history.until_steady:
                break
            if number == 1:
                run.check_range()
            if journal.add(run.cycle(number)):
                run.go_on()
                journal.checkpoint()
            watch(run.watch, passed, number)
            if progress is not None and number > 0:
                progress(number, history.cycles, run.brief(number))
    except SolveError as error:
        error.record = record_of(system, run.solver, passed, (run.corners, run.totals))
        raise
    return record_of(system, run.solver, passed, last=run.sample_last())


def _system_of(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return the system with the scene's friction and gap; refuse another body's."""
    validate(scene)
    if not system.scene_toml:
        raise InputError(
            "evolve: the system was made by hand, for no scene; give a History, or condense the "
            "scene"
        )
    other = body_difference(from_toml(system.scene_toml), scene)
    if other is not None:
        raise InputError(
            f"evolve: the system was condensed from a scene with another {other}; condense this "
            "scene"
        )
    return system_for(scene, system)


SMALLEST_RANGE = 1e-7
"""Change of the held reactions in a cycle, over the largest force so far, below which its events
are lost in round-off."""


class _Run:
    """The evolving state of the modelled nodes."""

    def __init__(
        self,
        system: ContactSystem,
        history: History,
        solver: SolverOptions,
        output: OutputOptions,
        passed: list[Passed],
    ) -> None:
        self.system, self.history, self.solver, self.output = system, history, solver, output
        self.passed = passed
        self.model = frictional_form(system)
        self.multiplicity = np.bincount(mirror_of(system).index)
        self.watch = SteadyWatch(solver.steady_tolerance, typical_stiffness(system))
        self.corners: list[Instant] = []
        for row in range(len(passed)):
            watch(self.watch, passed, row)

    def lay(self, initial_slip: Array | None) -> None:
        """Lay the unloaded body on the plane."""
        n = self.system.n
        v = np.zeros(n) if initial_slip is None else np.array(initial_slip, dtype=float)
        if v.shape != (n,):
            raise InputError(f"initial_slip has shape {v.shape}, expected ({n},)")
        if not np.all(np.isfinite(v)):
            raise InputError(f"initial_slip of node {np.argmin(np.isfinite(v))} is not finite")
        v[self.system.held[:n]] = 0.0
        self.has_initial_slip = bool(np.any(v))
        state = np.where(self.system.g0 > 0.0, State.SEPARATION, State.STICK).astype(np.int8)
        self.rest = ContactState(np.concatenate([v, np.zeros(n)]), np.zeros(2 * n), state)

    def go_on(self) -> None:
        """Stand at the end of the last finished cycle, nothing of the way there remembered."""
        self._go_on_after(len(self.passed) - 1)

    def _go_on_after(self, number: int) -> None:
        self.tracer = make_solver(self.model, self.solver)
        self._stand_after(number)

    def check_range(self) -> None:
        """Raise where the cycles change the forces too little to be told from round-off."""
        way = (self.history.loop - self.history.loop[0]) @ self.model.r_star
        change, force = float(np.abs(way).max(initial=0.0)), self.totals.force_scale
        if change < SMALLEST_RANGE * force:
            raise SolveError(
                f"[history]: a cycle changes the forces by {change / force:.1e} of the largest; "
                f"below {SMALLEST_RANGE:.0e} its events cannot be told from round-off: enlarge "
                "the load range"
            )

    def _stand_after(self, number: int) -> None:
        """Stand at the end of a finished cycle, or at rest for -1."""
        self.now, self.load, self.totals = self.rest, self.history.path[0], Totals()
        if number >= 0:
            end = self.passed[number].corners[-1]
            self.now, self.load = end.state, end.load
            self.totals = self.passed[number].totals

    def cycle(self, number: int) -> Passed:
        """Trace the legs of one cycle; return what it leaves behind."""
        dissipation = np.zeros(self.system.n)
        kept = Kept() if self._wanted(number) else None
        start = self._instant(number, 0, 0.0, self.load, self.now)
        self.corners = []
        for k, (a, b) in enumerate(self._legs(number)):
            try:
                leg = self._trace(number, k, a, b, kept)
            except SolveError as error:
                error.args = (f"cycle {number}, leg {k}: {error}",)
                raise
            self._take(leg, jump=number == 0 and k == 0 and self.has_initial_slip)
            dissipation += leg.dissipation
            self.now, self.load = leg.end, b
            self.corners.append(self._instant(number, k, 1.0, b, leg.end))
        corners, self.corners = self.corners, []
        v = np.array([start.v, *(corner.v for corner in corners)])
        states = np.array([corner.state.state for corner in (start, *corners)])
        touches = np.any(states != State.SEPARATION, axis=0)
        return Passed(
            corners=corners,
            dissipation=dissipation,
            slip=v[-1] - v[0],
            slip_range=float(np.ptp(v[:, touches], axis=0).max(initial=0.0)),
            totals=self.totals,
            kept=kept,
        )

    def brief(self, number: int) -> str:
        """Return what a cycle has brought, for those who watch."""
        now, before = self.passed[number].totals, self.passed[number - 1].totals
        sweeps = f"{now.sweeps - before.sweeps} sweeps, " if now.sweeps else ""
        D = self.passed[number].dissipation.sum()
        return (
            f"{now.events - before.events} events, {sweeps}residual {now.residual:.1e}, "
            f"dissipation {D:.6g}, change {self.watch.change[-1]:.1e}"
        )

    def sample_passed(self) -> None:
        """Keep the samples of those finished cycles for which they are asked for, and no others.

        A run that is gone on with may ask for other cycles than it began with.
        """
        for number, cycle in enumerate(self.passed):
            if not self._wanted(number):
                self.passed[number] = replace(cycle, kept=None)
            elif cycle.kept is None:
                self._go_on_after(number - 1)
                self.passed[number] = replace(cycle, kept=self._sample(number))

    def sample_last(self) -> Kept | None:
        """Trace the last cycle once more from its start, for its samples, unless they are kept."""
        number = len(self.passed) - 1
        if self.passed[number].kept is not None or self.output.cycles is not None:
            return None
        self._stand_after(number - 1)
        return self._sample(number)

    def _sample(self, number: int) -> Kept:
        """Trace a finished cycle once more, standing at its start, for its samples and events."""
        kept = Kept()
        for k, (a, b) in enumerate(self._legs(number)):
            leg = self._trace(number, k, a, b, kept)
            self.now, self.totals = leg.end, self.totals._replace(force_scale=leg.force_scale)
        return kept

    def _legs(self, number: int) -> list[tuple[Array, Array]]:
        polyline = self.history.path if number == 0 else self.history.loop
        return list(pairwise(polyline))

    def _wanted(self, number: int) -> bool:
        """Return whether the cycle's samples were asked for by number."""
        wanted = DEFAULT_KEPT if self.output.cycles is None else self.output.cycles
        return wanted == "all" or number in wanted

    def _trace(self, number: int, k: int, a: Array, b: Array, kept: Kept | None) -> Leg:
        """Trace one leg by the chosen method; keep its samples and events where wanted."""
        scale = self.totals.force_scale
        if number == 0 and k == 0 and self.has_initial_slip:
            leg = self.tracer.static_leg(self.now, (a, b), scale)
            self._refuse_landing(leg.end)
        else:
            samples = self.output.samples_per_leg if kept is not None else 0
            leg = self.tracer.trace_leg(self.now, (a, b), scale, samples)
        if kept is not None:
            for s, state in leg.samples:
                kept.instants.append(self._instant(number, k, s, (1 - s) * a + s * b, state))
            kept.changes += [
                Change(number, k, s, (1 - s) * a + s * b, *rest) for s, *rest in leg.events
            ]
        return leg

    def _refuse_landing(self, end: ContactState) -> None:
        """Raise where an open node has landed with friction in the static problem of a first leg.

        Its slip counts from where it touched, which a jump from one state to another leaves open.
        """
        model = self.model
        rubs = model.friction.present & ~model.held[: model.n] & ~model.held[model.n :]
        landed = np.flatnonzero(rubs & (model.g0 > 0.0) & (end.state != State.SEPARATION))
        if len(landed):
            i = int(landed[0])
            raise InputError(
                f"initial_slip: node {i} (x = {model.x[i]:.6g}) has an initial gap, "
                f"{model.g0[i]:.3g}, and lands on the first leg, which an initial slip makes one "
                "static problem: where its slip begins is not defined; leave out the initial slip, "
                "or the gap"
            )

    def _instant(self, cycle: int, leg: int, s: float, load: Array, state: ContactState) -> Instant:
        v = state.v
        if self.system.slip_map is not None:
            v = self.system.slip_map @ np.concatenate([state.w, load])
        return Instant(cycle, leg, s, load, v, state)

    def _take(self, leg: Leg, jump: bool) -> None:
        """Take over a leg's checks: residual, energy identity (not for a jump), counts."""
        before = self.totals
        error, scale = (0.0, before.energy_scale) if jump else self._energy_error(leg)
        if log.isEnabledFor(logging.DEBUG):
            for s, i, old, new in leg.events:
                log.debug(
                    "s = %.9f: node %d, %s to %s",
                    s,
                    i,
                    STATE_NAMES[State(old)],
                    STATE_NAMES[State(new)],
                )
            log.debug("end of a leg: residual %.1e, energy error %.1e", leg.residual, error)
        self.totals = Totals(
            force_scale=leg.force_scale,
            energy_scale=scale,
            residual=max(before.residual, leg.residual),
            energy_error=max(before.energy_error, error),
            sweeps=before.sweeps + leg.sweeps,
            events=before.events + int(sum(self.multiplicity[event[1]] for event in leg.events)),
            jumps=before.jumps + len(leg.jumps),
            released=before.released + sum(energy for _, energy in leg.jumps),
        )

    def _energy_error(self, leg: Leg) -> tuple[float, float]:
        """Return the relative error of D + change of (1/2 u K u) + integral lambda r* . du = 0.

        The second value is the largest energy of a leg so far.
        """
        K = self.model.K
        stored = 0.5 * float((leg.end.u - self.now.u) @ K @ (leg.end.u + self.now.u))
        D = float(leg.dissipation.sum()) + sum(energy for _, energy in leg.jumps)
        largest = max(self.totals.energy_scale, abs(D) + abs(stored))
        scale = max(abs(D) + abs(stored), ENERGY_FLOOR * largest)
        return (abs(D + stored + leg.work) / scale if scale > 0.0 else 0.0), largest
