"""State of an evolving history: traces its legs, cycle by cycle, and takes samples."""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, NoEquilibrium, SolveError
from receding_fenicsx.evolution.instants import (
    FinishedCycle,
    Instant,
    Samples,
    Totals,
    event_rows,
    instant,
    rest_state,
    steady_watch,
)
from receding_fenicsx.evolution.probes import known_places, probed_at
from receding_fenicsx.evolution.problem import Problem
from receding_fenicsx.evolution.solvers import make_solver
from receding_fenicsx.interface.law import SLIP_SIGN, STATE_NAMES, STICK, State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.residual import is_carried_by_round_off
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg, frictional_form
from receding_fenicsx.interface.tolerances import ON_LIMIT
from receding_fenicsx.interface.uniqueness.watch import Uniqueness, UniquenessWatch
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions

log = logging.getLogger(__name__)


class Position(NamedTuple):
    """Where a history stands: state of the modelled nodes, load factors, totals up to there."""

    state: ContactState
    load: Array
    totals: Totals


class RunState:
    """State of an evolving history: its solver, what watches it, and where it stands.

    ``model`` is the condensed body in the 2N form of the solvers; ``corners`` are the ends of the
    finished legs of the cycle that is being traced.
    """

    def __init__(self, problem: Problem, cycles: list[FinishedCycle]) -> None:
        """Stand at the end of the last finished cycle, or at rest, with a new solver."""
        self.problem, self.cycles = problem, cycles
        self.model = replace(frictional_form(problem.system), probes=None)
        self.steady = steady_watch(problem.system, problem.solver, cycles)
        self.solver = make_solver(self.model, problem.solver, problem.chooser)
        self.position = self._end_of(len(cycles) - 1)
        begin = Uniqueness(certified=problem.judged, proved=problem.judged)
        found = cycles[-1].uniqueness if cycles else begin
        in_steps = problem.solver.method != "events"
        # what is not judged is watched by its friction alone
        watched = replace(self.model, cohesion=None, shear_limit=None)
        self.uniqueness = UniquenessWatch(watched, found, in_steps)
        self.corners: list[Instant] = []
        self._images = np.bincount(mirror_of(problem.system).index)

    def restart(self, after: int | None = None) -> None:
        """Restart with a new solver from the end of a finished cycle, of the last one if None."""
        self.solver = make_solver(self.model, self.problem.solver, self.problem.chooser)
        self.position = self._end_of(len(self.cycles) - 1 if after is None else after)
        self.uniqueness.forget_doubts()

    def trace_cycle(self, number: int, sampled: bool = False) -> FinishedCycle:
        """Trace the legs of the next cycle, ``sampled`` even where its number does not ask for it.

        SolveError: a leg has no solution; ``corners`` and ``position`` tell how far it came.
        """
        dissipation, chooser = np.zeros(self.problem.system.n), self.problem.chooser
        samples = Samples() if sampled or self.problem.is_sampled(number) else None
        start = instant(
            self.problem.system, (number, 0, 0.0), self.position.load, self.position.state
        )
        self.corners = []
        for k, (a, b) in enumerate(self._legs(number)):
            static = self._is_static(number, k)
            try:
                leg = self._trace(number, k, (a, b), samples)
                totals = self._totals_after((a, b), leg, static)
            except SolveError as error:
                error.args = (f"cycle {number}, leg {k}: {error}",)
                raise
            if self.problem.judged:
                self.uniqueness.add((number, k), self.position.state, (a, b), leg, static)
                if chooser is not None and self.uniqueness.floats:
                    chooser.unsure.add((number, k, 1.0))
                for choice in chooser.choices if chooser is not None else ():
                    if (choice.cycle, choice.leg) == (number, k):
                        doubt = (number, k, choice.s), choice.nodes, choice.solutions
                        self.uniqueness.found = self.uniqueness.found.with_doubt(*doubt)
            self.position = Position(leg.end, b, totals)
            dissipation += leg.dissipation
            self.corners.append(instant(self.problem.system, (number, k, 1.0), b, leg.end))
        corners, self.corners = self.corners, []
        slip, totals, found = corners[-1].v - start.v, self.position.totals, self.uniqueness.found
        made = () if chooser is None else chooser.choices
        choices = tuple(choice for choice in made if choice.cycle == number)
        return FinishedCycle(corners, dissipation, slip, totals, samples, found, choices)

    def sample_finished(self) -> None:
        """Keep the samples of those finished cycles for which they are asked for, and no others.

        A resumed run may ask for other cycles than it began with.
        """
        for number, cycle in enumerate(self.cycles):
            if not self.problem.is_sampled(number):
                self.cycles[number] = replace(cycle, samples=None)
            elif cycle.samples is None:
                self.restart(number - 1)
                self.cycles[number] = replace(cycle, samples=self._sample(number))
                self.restart()

    def sample_last(self) -> Samples | None:
        """Trace the last cycle once more for its samples, unless it has them or others were asked.

        By default the last cycle is sampled; which one that is, is known at the end only.
        """
        number = len(self.cycles) - 1
        if self.cycles[number].samples is not None or self.problem.output.cycles is not None:
            return None
        self.position = self._end_of(number - 1)
        return self._sample(number)

    def _end_of(self, number: int) -> Position:
        """Return the end of a finished cycle, or rest for -1."""
        if number < 0:
            rest = rest_state(self.problem.system, self.problem.initial_slip)
            return Position(rest, self.problem.history.path[0], Totals())
        cycle = self.cycles[number]
        return Position(cycle.corners[-1].state, cycle.corners[-1].load, cycle.totals)

    def _sample(self, number: int) -> Samples:
        """Trace a finished cycle once more from its start, for its samples and events."""
        samples = Samples()
        for k, (a, b) in enumerate(self._legs(number)):
            leg = self._trace(number, k, (a, b), samples)
            totals = self.position.totals._replace(force_scale=leg.force_scale)
            self.position = Position(leg.end, b, totals)
        return samples

    def _legs(self, number: int) -> list[tuple[Array, Array]]:
        return list(pairwise(self.problem.history.polyline(number)))

    def _is_static(self, number: int, k: int) -> bool:
        """Return whether a leg is one static problem: the first one after an initial slip."""
        return number == 0 and k == 0 and bool(np.any(self.problem.initial_slip))

    def _trace(
        self, number: int, k: int, ends: tuple[Array, Array], samples: Samples | None
    ) -> Leg:
        """Trace one leg; add its samples and events where they are wanted."""
        state, scale = self.position.state, self.position.totals.force_scale
        if self.problem.chooser is not None:
            self.problem.chooser.enter(number, k)
        static = self._is_static(number, k)
        if static and not np.any(ends[1]):
            # without pressure nothing holds the initial slip
            state, static = rest_state(self.problem.system, np.zeros(len(state.state))), False
        if static:
            leg = self.solver.static_leg(state, ends, scale)
            check_landing(self.model, leg.end)
        else:
            count = self.problem.samples_on(number) if samples is not None else 0
            leg = self.solver.trace_leg(state, ends, scale, count)
        if is_carried_by_round_off(self.model, leg.end.u, leg.force_scale):
            raise NoEquilibrium(
                f"nothing holds the body at {self.model.load_text(ends[1])}: it has moved by "
                f"{np.abs(leg.end.u).max():.3g}, where round-off alone balances the loads; add a "
                "[[support]], or check the signs of the loads"
            )
        stick_at_rest(self.model, state, leg)
        if samples is not None:
            a, b = ends
            samples.instants += [
                instant(self.problem.system, (number, k, s), (1 - s) * a + s * b, sampled)
                for s, sampled in leg.samples
            ]
            known = None if static else known_places(state, ends, leg)
            events, rows = leg.events, event_rows(self.problem.system, len(leg.events))
            rows["cycle"], rows["leg"], rows["s"], rows["node"] = number, k, events.s, events.node
            rows["old"], rows["new"] = events.old, events.new
            rows["load"] = (1 - events.s[:, None]) * a + events.s[:, None] * b
            rows["probed"] = probed_at(self.problem.system, known, events.s)
            samples.events.append(rows)
        return leg

    def _totals_after(self, ends: tuple[Array, Array], leg: Leg, is_static: bool) -> Totals:
        """Return the totals at the end of a leg; a static problem has no energy identity."""
        before = self.position.totals
        error, scale = 0.0, before.energy_scale
        if not is_static:
            error, scale = energy_error(self.model, self.position.state, ends, leg, scale)
            # correct legs of the exact path have up to 1e-8
            if error > 1e-6 and self.problem.solver.method == "events":
                raise SolveError(
                    f"the exact path breaks the energy identity before "
                    f"{self.model.load_text(ends[1])}: error {error:.1e} over 1e-06 of the leg's "
                    "energy; try the other solver method, and report this scene"
                )
        for s, node, old, new in leg.events if log.isEnabledFor(logging.DEBUG) else ():
            names = STATE_NAMES[State(old)], STATE_NAMES[State(new)]
            log.debug("s = %.9f: node %d, %s to %s", s, node, *names)
        log.debug("end of a leg: residual %.1e, energy error %.1e", leg.residual, error)
        return Totals(
            force_scale=leg.force_scale,
            energy_scale=scale,
            residual=max(before.residual, leg.residual),
            energy_error=max(before.energy_error, error),
            sweeps=before.sweeps + leg.sweeps,
            events=before.events + int(self._images[leg.events.node].sum()),
            jumps=before.jumps + len(leg.jumps),
            released=before.released + sum(energy for _, energy in leg.jumps),
        )


def first_cycles(problem: Problem, history: History, last: int) -> list[FinishedCycle]:
    """Trace the cycles 0 to ``last`` of another history, without samples and uniqueness."""
    output, cycles = OutputOptions(samples_per_leg=1, cycles=()), list[FinishedCycle]()
    run = RunState(replace(problem, history=history, output=output, judged=False), cycles)
    for number in range(last + 1):
        cycles.append(run.trace_cycle(number))
    return cycles


def stick_at_rest(model: ContactSystem, start: ContactState, leg: Leg) -> None:
    """Let nodes stick at the end of a leg that come to their friction limit only there.

    Whether such a node sticks or begins to slip at the very end is decided by round-off, for half a
    body otherwise than for the whole one. It sticks as long as it has not moved on the leg; where
    the next leg moves it, it slips from that one's start.
    """
    if not len(leg.events):
        return
    still = (start.state == STICK) & (SLIP_SIGN[leg.end.state] != 0.0) & model.law.present
    if still.any():
        # its force changes by less than the distance at which a node counts as on its limit
        none = ON_LIMIT * leg.force_scale / model.local_stiffness[0]
        still &= np.abs(leg.end.v - start.v) <= none
        # after more than one change of state it may have slipped, or opened, and gone back
        still &= np.bincount(leg.events.node, minlength=model.n) <= 1
    if still.any():
        leg.events = leg.events.select(~still[leg.events.node])

        def stuck(one: ContactState) -> ContactState:
            return replace(one, state=np.where(still, STICK, one.state).astype(np.int8))

        leg.end, leg.samples = stuck(leg.end), [(s, stuck(one)) for s, one in leg.samples]


def energy_error(
    system: ContactSystem,
    start: ContactState,
    ends: tuple[Array, Array],
    leg: Leg,
    energy_scale: float,
) -> tuple[float, float]:
    """Return the relative error of D + change of (1/2 u K u) + integral lambda r* . du = 0.

    With K u = r - sum lambda r* at both ends of a leg. The largest energy of a leg so far is
    returned too.
    """
    forces = leg.end.r + start.r - (ends[0] + ends[1]) @ system.r_star
    stored = 0.5 * float((leg.end.u - start.u) @ forces)
    D = float(leg.dissipation.sum()) + sum(energy for _, energy in leg.jumps)
    largest = max(energy_scale, abs(D) + abs(stored))
    F, u = leg.force_scale, float(np.abs(leg.end.u).max())
    K, k = system.largest_stiffness, system.typical_stiffness or np.inf
    # smallest scale over (F + K u) (F / k + u): F the largest nodal force, u the largest
    # displacement, K and k the largest and a typical stiffness. Residuals up to 1e-11 stay below
    # the tolerance
    least = 1e-5 * (F + K * u) * (F / k + u)
    # smallest scale of a leg's energy error, over the largest energy of a leg so far
    scale = max(abs(D) + abs(stored), 1e-4 * largest, least)
    return (abs(D + stored + leg.work) / scale if scale > 0.0 else 0.0), largest


def check_force_range(model: ContactSystem, history: History, force: float) -> None:
    """Raise SolveError where the cycles change the forces by no more than their round-off."""
    way = (history.loop - history.loop[0]) @ model.r_star
    change = float(np.abs(way).max(initial=0.0))
    if change < 1e-7 * force:
        raise SolveError(
            f"[history]: a cycle changes the forces by {change / force:.1e} of the largest; "
            f"below 1e-07 its events cannot be told from round-off: enlarge "
            "the load range"
        )


def check_landing(model: ContactSystem, end: ContactState) -> None:
    """Raise InputError where an open node with friction lands in the static problem of a first leg.

    Its slip counts from the place of first contact, which a static problem does not give.
    """
    slips = model.law.present & ~model.held[: model.n] & ~model.held[model.n :]
    landed = np.flatnonzero(slips & (model.g0 > 0.0) & (end.state != State.SEPARATION))
    if len(landed):
        i = int(landed[0])
        raise InputError(
            f"initial_slip: node {i} (x = {model.x[i]:.6g}) has an initial gap, "
            f"{model.g0[i]:.3g}, and lands on the first leg, which an initial slip makes one "
            "static problem: where its slip begins is not defined; leave out the initial slip, "
            "or the gap"
        )
