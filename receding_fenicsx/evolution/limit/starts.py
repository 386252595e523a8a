"""Steady states that one load history reaches from many initial slips."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.histories.tightening import tightened
from receding_fenicsx.evolution.problem import Problem, problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import NOT_REACHED
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactSystem, reactions
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.history.polyline import ended_by
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions

SIZES = (0.1, 10.0)
"""Smallest and largest size of a random slip, over the slip under which friction is used up."""
EXTREME = 10.0
"""Size of the extreme slips, over the same; nodes slide back to their limits from there."""
SEED = 2008
"""Seed of the random slips."""
NEVER_SLIPS = 1e-9
"""Dissipation density over the largest of cycle 1 below which a node does not slip."""
FAILED = "failed"
"""Kind of a start whose path ends."""


@dataclass(frozen=True, repr=False)
class SteadyStates:
    """Steady states from n starts; arrays over the M nodes of the whole contact.

    Attributes:
        x: (M,) positions.
        names: names of the starts.
        slips: (n, N) their initial slips at the modelled nodes.
        dissipation: (n,) of the last cycle; NaN where the path ended.
        kind: kind of each steady state: "shakedown", "cyclic slip", "ratchetting", "not reached",
            "failed".
        state: (n, M) state of each node over the last cycle: a direction of slip (the last one)
            where it dissipates, separation where it opens, else stick.
        cycles: (n,) cycles played.
        errors: reason of each failed start, by its name.
    """

    x: Array
    names: tuple[str, ...]
    slips: Array
    dissipation: Array
    kind: tuple[str, ...]
    state: NDArray[np.int8]
    cycles: NDArray[np.int64]
    errors: Mapping[str, str]

    @property
    def interval(self) -> tuple[float, float]:
        """Smallest and largest dissipation per cycle of the steady states that were reached."""
        D = self.dissipation[[kind not in (NOT_REACHED, FAILED) for kind in self.kind]]
        return (float(D.min()), float(D.max())) if len(D) else (np.nan, np.nan)

    @property
    def counts(self) -> dict[str, int]:
        """Number of starts of each kind."""
        return dict(Counter(self.kind))

    @property
    def slips_for_ever(self) -> int:
        """Number of starts that do not shake down."""
        return sum(kind in ("cyclic slip", "ratchetting", NOT_REACHED) for kind in self.kind)

    def zones(self, start: int) -> list[tuple[str, float, float]]:
        """Return the zones of one steady state over its last cycle."""
        return zones(self.x, self.state[start])

    def __repr__(self) -> str:
        """Return the interval of dissipation and how many starts are of each kind."""
        low, high = self.interval
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.counts.items())
        rows = [("dissipation per cycle", f"{low:.6g} to {high:.6g}"), ("kinds", kinds)]
        return described(f"SteadyStates from {len(self.names)} starts", rows)


def steady_states(
    system: ContactSystem,
    history: Scene | History,
    starts: int = 41,
    safe: Array | None = None,
    solver: SolverOptions | None = None,
    until: str = "limit",
) -> SteadyStates:
    """Play one history from many initial slips, each to the limit of infinitely many cycles.

    Args:
        system: the condensed body.
        history: a scene of it, or a history; its cycles end when they are steady.
        starts: number of starts: rest, ``safe`` if given, extreme slips (all nodes forward, all
            backward, both ways about the middle), then random ones.
        safe: (N,) a safe slip, as ``shakedown_limits`` returns it.
        solver: method and tolerances; not with a scene.
        until: "limit" of infinitely many cycles, or "steady" within the solver's tolerance.

    Raises:
        InputError: no start, or the history has no cycles.
    """
    if isinstance(history, Scene):
        problem = problem_of_scene(system, tightened(system, history))
        system, history, solver = problem.system, problem.history, problem.solver
    if not history.cycles or not isinstance(starts, int) or starts < 1:
        raise InputError("steady_states: needs a history with cycles, and at least one start")
    history = ended_by(history, until)
    named = initial_slips(system, history, starts, safe)
    records: list[Record] = []
    errors: dict[str, str] = {}
    for name, slip in named.items():
        try:
            output = OutputOptions(1, ())
            records.append(evolve(system, history, solver, output, initial_slip=slip))
        except SolveError as error:
            if not isinstance(error.record, Record):
                raise
            errors[name] = str(error)
            records.append(error.record)
    lost = [name in errors for name in named]
    D = [r.cycles.dissipation[-1] if len(r.cycles.dissipation) else np.nan for r in records]
    kinds = [FAILED if bad else r.steady.kind for bad, r in zip(lost, records, strict=True)]
    return SteadyStates(
        records[0].x,
        tuple(named),
        np.array(list(named.values())),
        np.where(lost, np.nan, D),
        tuple(kinds),
        np.array([_states(record) for record in records]),
        np.array([len(record.cycles.dissipation) for record in records]),
        errors,
    )


def check_first_leg(problem: Problem, starts: int) -> None:
    """Play the first leg of a problem from the initial slips of so many starts.

    Raises:
        InputError: a node with an initial gap lands on it: where its slip begins is not defined.
    """
    system, history = problem.system, problem.history
    leg = replace(ended_by(history, None), path=history.path[:2], loop=history.loop[:0], cycles=0)
    _, *slips = initial_slips(system, history, starts, None).values()  # rest may land
    for slip in slips:
        with suppress(SolveError):  # of a start that fails the reason is told with the others
            evolve(system, leg, problem.solver, OutputOptions(1, ()), initial_slip=slip)


def initial_slips(
    system: ContactSystem, history: History, count: int, safe: Array | None
) -> dict[str, Array]:
    """Return initial slips by name; the first is rest.

    Their unit is the slip under which the springs of a node carry the friction f P of the largest
    held pressure.
    """
    n, friction = system.n, system.friction
    loads = np.vstack([history.path, history.loop])
    P = np.array([reactions(system, load, np.zeros(2 * n))[n:] for load in loads]).max(axis=0)
    stiffness = local_stiffness(system)[0]
    unit = float((friction.largest * np.maximum(P, 0.0) / stiffness).max()) or 1.0
    away = np.sign(system.x - 0.5 * (system.x.min() + system.x.max()))
    named = {"rest": np.zeros(n)}
    if safe is not None:
        named["safe"] = np.array(safe, dtype=float)
    ones = np.ones(n)
    for name, shape in (("forward", ones), ("backward", -ones), ("out", away), ("in", -away)):
        named[name] = EXTREME * unit * shape
    rng = np.random.default_rng(SEED)
    for k, size in enumerate(np.geomspace(*SIZES, max(count - len(named), 0)), 1):
        named[f"random {k}"] = size * unit * rng.uniform(-1.0, 1.0, n)
    return dict(list(named.items())[:count])


def _states(record: Record) -> NDArray[np.int8]:
    """Return the state of each node over the last cycle of a record."""
    table, cycles = record.turning_points, record.cycles
    state = np.full(len(record.x), State.STICK, dtype=np.int8)
    if not len(cycles.dissipation):
        return state
    cycle = len(cycles.dissipation)
    last = table.state[table.cycle == cycle]
    density = cycles.dissipation_density
    slips = density[-1] > NEVER_SLIPS * density.max()
    for rows in last:
        moving = np.isin(rows, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
        state = np.where(moving & slips, rows, state)
    opens = np.any(last == State.SEPARATION, axis=0)
    # a node that slips between the turning points only: v moves by slip alone
    moves = np.diff(table.v[np.flatnonzero(table.cycle == cycle)[0] - 1 :][: len(last) + 1], axis=0)
    largest = np.take_along_axis(moves, np.abs(moves).argmax(axis=0)[None], axis=0)[0]
    between = np.where(largest >= 0.0, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    state = np.where(slips & (state == State.STICK), between, state)
    return np.where(opens & ~slips, np.int8(State.SEPARATION), state).astype(np.int8)
