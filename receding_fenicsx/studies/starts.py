"""Steady states that one load history reaches from many initial slips: the cases are the slips."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.histories import tightened
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import NOT_REACHED
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem, reactions
from receding_fenicsx.scene.history import History, ended_by
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions
from receding_fenicsx.store.workspace import Case
from receding_fenicsx.studies.runner import Kind, Runner, digest_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
            where it dissipates, separation where it opens, else stick; 0 of a failed start.
        cycles: (n,) cycles played, 0 of a failed start.
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
        D = self.dissipation[[kind not in (NOT_REACHED, "failed") for kind in self.kind]]
        return (float(D.min()), float(D.max())) if len(D) else (np.nan, np.nan)

    @property
    def counts(self) -> dict[str, int]:
        """Number of starts of each kind."""
        return dict(Counter(self.kind))

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
    runner: Runner | None = None,
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
        runner: runs the starts in its processes and folder; default: in this process.

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
    body = digest_of(system, history, solver)
    cases = [
        Case(digest_of(body, slip), (system, history, solver, slip), (name,))
        for name, slip in named.items()
    ]
    outcomes = (runner or Runner(Kind("starts"))).outcomes(cases, play_start)
    lost = next((outcome.error for outcome in outcomes if not outcome.final), "")
    if lost:
        raise SolveError(lost)
    x = mirror_of(system).odd(system.x)
    none = {"kind": "failed", "dissipation": np.nan, "cycles": 0, "state": [0] * len(x)}
    found: list[dict[str, Any]] = [outcome.cells or none for outcome in outcomes]
    pairs = zip(named, outcomes, strict=True)
    return SteadyStates(
        x,
        tuple(named),
        np.array(list(named.values())),
        np.array([row["dissipation"] for row in found]),
        tuple(row["kind"] for row in found),
        np.array([row["state"] for row in found], dtype=np.int8),
        np.array([row["cycles"] for row in found]),
        {name: outcome.error for name, outcome in pairs if outcome.error},
    )


def play_start(
    system: ContactSystem, history: History, solver: SolverOptions | None, slip: Array
) -> dict[str, Any]:
    """Play a history from an initial slip."""
    record = evolve(system, history, solver, OutputOptions(1, ()), initial_slip=slip)
    D = record.cycles.dissipation
    return {
        "kind": record.steady.kind,
        "dissipation": float(D[-1]),
        "cycles": len(D),
        "state": _states(record).tolist(),
    }


def initial_slips(
    system: ContactSystem, history: History, count: int, safe: Array | None
) -> dict[str, Array]:
    """Return initial slips by name; the first is rest.

    Their unit is the slip under which the springs of a node carry the friction f P of the largest
    held pressure: extreme slips are 10, from which nodes slide back to their limits, random ones
    0.1 to 10.
    """
    n, friction = system.n, system.friction
    loads = np.vstack([history.path, history.loop])
    P = np.array([reactions(system, load, np.zeros(2 * n))[n:] for load in loads]).max(axis=0)
    stiffness = system.local_stiffness[0]
    unit = float((friction.largest * np.maximum(P, 0.0) / stiffness).max()) or 1.0
    away = np.sign(system.x - 0.5 * (system.x.min() + system.x.max()))
    named = {"rest": np.zeros(n)}
    if safe is not None:
        named["safe"] = np.array(safe, dtype=float)
    ones = np.ones(n)
    for name, shape in (("forward", ones), ("backward", -ones), ("out", away), ("in", -away)):
        named[name] = 10.0 * unit * shape
    rng = np.random.default_rng(2008)
    for k, size in enumerate(np.geomspace(0.1, 10.0, max(count - len(named), 0)), 1):
        named[f"random {k}"] = size * unit * rng.uniform(-1.0, 1.0, n)
    return dict(list(named.items())[:count])


def _states(record: Record) -> NDArray[np.int8]:
    """Return the state of each node over the last cycle of a record."""
    table, density = record.turning_points, record.cycles.dissipation_density
    rows = table.cycle == len(density)
    last, slips = table.state[rows], density[-1] > 1e-9 * density.max()
    # a node may slip between the turning points only: v moves by slip alone
    moves = np.diff(table.v[np.flatnonzero(rows)[0] - 1 :][: len(last) + 1], axis=0)
    round_off = 1e-9 * np.abs(moves).max()
    state = np.full(len(record.x), State.FORWARD_SLIP)  # there and back within a leg
    for move, at in zip(moves, last, strict=True):
        way = np.where(move > 0.0, State.FORWARD_SLIP, State.BACKWARD_SLIP)
        state = np.where(np.abs(move) > round_off, way, state)
        state = np.where(np.isin(at, (State.FORWARD_SLIP, State.BACKWARD_SLIP)), at, state)
    rest = np.where(np.any(last == State.SEPARATION, axis=0), State.SEPARATION, State.STICK)
    return np.where(slips, state, rest).astype(np.int8)


def steady_states_figure(states: SteadyStates) -> Figure:
    """Draw dissipation per cycle of each start, sorted, beside the states of the nodes."""
    # a run that draws nothing does without
    import matplotlib as mpl

    from receding_fenicsx.output.plots import style

    order = np.argsort(states.dissipation, kind="stable")
    rows = np.arange(len(order))
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 3.0)
        left, right = figure.subplots(1, 2, sharey=True)
        kinds = np.array(states.kind)[order]
        for kind, colour in zip(dict.fromkeys(kinds), style.SERIES_COLOURS, strict=False):
            of_kind = kinds == kind
            D = states.dissipation[order][of_kind]
            left.plot(D, rows[of_kind], "o", ms=3, color=colour, label=kind)
        style.ticks(left.xaxis, 4)
        left.legend(loc="lower right")
        left.set(xlabel="dissipation per cycle of the steady state", ylabel="starts, sorted")
        found = np.unique(states.state[states.state > 0])
        places = np.arange(len(states.x)) if len(states.x) < 2 else states.x
        shown = np.ma.masked_equal(states.state[order], 0)
        style.state_mesh(right, places, rows, shown)
        right.set(xlabel="$x$")
        figure.legend(
            handles=style.state_patches(found), loc="outside upper center", ncols=len(found)
        )
    return figure


def starts_summary(states: SteadyStates) -> dict[str, Any]:
    """Return how far steady states differ: dissipation, kinds and states of the nodes.

    The spread is the difference of the largest and smallest dissipation over the largest; None
    where none dissipates.
    """
    low, high = states.interval
    played = [k for k, kind in enumerate(states.kind) if kind != "failed"]
    patterns, of_start = np.unique(states.state[played], axis=0, return_inverse=True)
    first = [played[int(np.argmax(of_start == p))] for p in range(len(patterns))]
    kinds, spread = states.counts, (high - low) / high if high > 0.0 else None
    same = len({*kinds} - {"failed"}) <= 1 >= len(patterns) and (spread or 0.0) <= 1e-8
    return {
        "count": len(states.names),
        "same": None if same and states.errors else same,  # what failed might differ
        "dissipation": [low, high] if np.isfinite(low) else None,
        "spread": spread,
        "kinds": kinds,
        "nodes": len(states.x),
        "nodes_that_differ": int(np.ptp(patterns, axis=0).astype(bool).sum()) if played else 0,
        "zones": [
            {"starts": int(np.sum(of_start == p)), "zones": states.zones(k)}
            for p, k in enumerate(first)
        ],
        "errors": dict(states.errors),
    }
