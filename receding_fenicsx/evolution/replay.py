"""Replay of a recorded history: the state at any instant, from the turning point before it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.instants import Instant, instant, rest_state
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.solvers import make_solver
from receding_fenicsx.interface.branches.choice import chooser_for
from receding_fenicsx.interface.law import SLIP_SIGN, State
from receding_fenicsx.interface.measures.steady import RATCHETTING
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import (
    ContactState,
    ContactSystem,
    frictional_form,
    neutral_motions,
    reactions,
)
from receding_fenicsx.scene.history import History, history_from_scene, leg_number
from receding_fenicsx.scene.model import Scene, SolverOptions


def state_at(
    record: Record,
    system: ContactSystem,
    history: History,
    solver: SolverOptions,
    where: tuple[int, int, float],
) -> Instant:
    """Find the state of the modelled contact nodes at one instant.

    Args:
        record: the record of the history.
        system: the system it was evolved on.
        history: the history.
        solver: the method it was evolved with.
        where: cycle, leg within the cycle, and position s along the leg, in [0, 1].

    Returns:
        The instant; its ``v`` and ``state.w`` are what a back-substitution needs.

    Raises:
        InputError: the record holds no such cycle or leg, or s is not in [0, 1].
        SolveError: the replay failed.
    """
    cycle, leg, s = where
    if not 0.0 <= s <= 1.0:
        raise InputError(f"position {s:g} along the leg: must lie between 0 and 1")
    table = record.turning_points
    rows = np.flatnonzero((table.cycle == cycle) & (table.leg == leg))
    if not len(rows):
        last = int(table.cycle.max(initial=0))
        raise InputError(
            f"cycle {cycle}, leg {leg}: is not in the record, which holds cycles 0 to {last}"
        )
    row = int(rows[0])
    a, b = history.polyline(cycle)[leg : leg + 2]
    load = b if s == 1.0 else (1.0 - s) * a + s * b
    before = row - 1 if leg > 0 else record.start_row(cycle)
    if s == 1.0:
        state = turning_point(record, system, row)
    elif s == 0.0 and before is not None:
        state = _start(record, system, before, leg)
    else:
        start, scale = rest_state(system), 0.0
        if before is not None:
            start = _start(record, system, before, leg)
            scale = float(max(np.abs(table.P[:row]).max(), np.abs(table.Q[:row]).max()))
        state = start
        if s > 0.0:
            # load steps of the same size as in the recorded path
            steps = max(1, math.ceil(s * solver.steps_per_leg))
            chooser = chooser_for(solver.branch, record.choices)
            if chooser is not None:
                chooser.enter(cycle, leg)
            options = replace(solver, steps_per_leg=steps)
            tracer = make_solver(frictional_form(system), options, chooser)
            state = tracer.trace_leg(start, (a, load), scale).end
    return instant(system, where, load, state)


def _start(record: Record, system: ContactSystem, row: int, leg: int) -> ContactState:
    """Return the start of a leg from the turning point before it.

    The limit cycle of a body that walks starts by the walk behind the place where it ends.
    """
    start, table = turning_point(record, system, row), record.turning_points
    jumped = leg == 0 and row > 0 and row == len(table.s) - 1
    if jumped and record.steady.kind == RATCHETTING:
        slip = record.cycles.slip_increment[-1][~mirror_of(system).left]
        touches, kept = start.state != State.SEPARATION, system.held.copy()
        kept[system.n :] = True
        motions = neutral_motions(system.rigid, kept)[: system.n]
        walk = np.linalg.lstsq(motions[touches], slip[touches], rcond=None)[0]
        start.u[: system.n] -= motions @ walk
    return start


def turning_point(record: Record, system: ContactSystem, row: int) -> ContactState:
    """Return the modelled nodes' state at a recorded turning point, in the solvers' 2N layout.

    Displacements and states are the recorded ones. The reactions are evaluated from them (eq. 11)
    and set exactly on the limits of their states (eqs. 6, 9 and 10).
    """
    table, model = record.turning_points, frictional_form(system)
    right = ~mirror_of(system).left
    v, w, state = (getattr(table, key)[row][right] for key in ("v", "w", "state"))
    v = np.where(system.slip_map is None, v, 0.0)
    u = np.concatenate([v, w])
    r = reactions(model, table.load[row], u)
    Q, P = r[: system.n], r[system.n :]
    P[state == State.SEPARATION] = 0.0
    Q[(state == State.SEPARATION) & ~model.held[: system.n]] = 0.0
    slips = SLIP_SIGN[state] != 0.0
    Q[slips] = system.law.slip_force(state, P)[slips]
    return ContactState(u, r, state.astype(np.int8))


def instant_of(
    scene: Scene, system: ContactSystem, record: Record, cycle: int, leg: str, at: float = 1.0
) -> Instant:
    """Find the state of the modelled contact nodes at one instant of a scene's record.

    Args:
        scene: the scene.
        system: its condensed system.
        record: its record.
        cycle: cycle, 0 for the first loading.
        leg: "loading", "unloading" or the number of the leg in the cycle.
        at: position along the leg, in [0, 1].

    Returns:
        The instant, replayed from the turning point before it.
    """
    path = history_from_scene(scene)
    number = leg_number(path, leg, cycle)
    if scene.history.initial_slip is not None and (cycle, number) == (0, 0) and at < 1.0:
        raise InputError(
            "the first leg of a history with initial_slip is one jump; only its end (1) is known"
        )
    return state_at(record, system, path, scene.solver, (cycle, number, at))
