"""Collecting instants and events of the modelled nodes into the record's whole-contact tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Cycles, Events, States, Steady
from receding_fenicsx.interface.law import MIRRORED, State
from receding_fenicsx.interface.measures.steady import SteadyWatch
from receding_fenicsx.interface.mirror import AXIS_TOLERANCE, Mirror, mirror_of
from receding_fenicsx.interface.normal_form import frictional_form
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem, typical_stiffness
from receding_fenicsx.scene.model import SolverOptions


class Instant(NamedTuple):
    """One state of the modelled nodes and where on the load path it stands."""

    cycle: int
    leg: int
    s: float
    load: Array
    v: Array
    state: ContactState


class Change(NamedTuple):
    """One change of state of a modelled node and where on the load path it happened."""

    cycle: int
    leg: int
    s: float
    load: Array
    node: int
    old: int
    new: int


@dataclass
class Kept:
    """The instants and changes of one cycle."""

    instants: list[Instant] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)


class Totals(NamedTuple):
    """What is gathered over the whole history up to an instant.

    Attributes:
        force_scale: largest nodal force.
        energy_scale: largest energy of a leg.
        residual: largest residual of the contact law over the force scale.
        energy_error: largest relative error of a leg's energy identity.
        sweeps: Gauss-Seidel sweeps.
        events: changes of state of the whole contact.
        jumps: jumps stepped over.
        released: energy that the jumps have released, of the modelled body.
    """

    force_scale: float = 0.0
    energy_scale: float = 0.0
    residual: float = 0.0
    energy_error: float = 0.0
    sweeps: int = 0
    events: int = 0
    jumps: int = 0
    released: float = 0.0


@dataclass(frozen=True)
class Passed:
    """What one finished cycle leaves behind; all finished cycles together are the whole run so far.

    Attributes:
        corners: the ends of its legs.
        dissipation: (N,) frictional dissipation of the modelled nodes.
        slip: (N,) v at its end less v at its start.
        slip_range: largest range of v over its corners of a node that touches at one of them.
        totals: over the history up to its end.
        kept: its samples and events, where they were asked for.
    """

    corners: list[Instant]
    dissipation: Array
    slip: Array
    slip_range: float
    totals: Totals
    kept: Kept | None = None


def watch(watcher: SteadyWatch, passed: list[Passed], row: int) -> None:
    """Show a finished cycle to what watches for the steady state."""
    cycle, end = passed[row], passed[row].corners[-1]
    if row == 0:
        watcher.start(end.state.r, end.v)
    else:
        first, last = (float(p.dissipation.sum()) for p in (passed[1], cycle))
        force = cycle.totals.force_scale
        watcher.add(end.state.r, end.v, cycle.slip_range, last, first, force)


def record_of(
    system: ContactSystem,
    solver: SolverOptions,
    passed: list[Passed],
    unfinished: tuple[list[Instant], Totals] = ([], Totals()),
    last: Kept | None = None,
) -> Record:
    """Return the record of the whole contact.

    Args:
        system: the condensed body.
        solver: method and tolerances.
        passed: the finished cycles.
        unfinished: ends of the finished legs of a cycle that ended early, and the totals there.
        last: samples and events of the last finished cycle, where it has none of its own.
    """
    mirror = mirror_of(system)
    n_loads = len(system.load_names)
    weight = mirror.total(system.weight)
    D = np.array([p.dissipation for p in passed[1:]]).reshape(-1, system.n)
    slip = np.array([_slip(*pair) for pair in pairwise(passed)]).reshape(-1, system.n)
    flip = np.where(mirror.left, -1.0, 1.0)
    kept = [p.kept for p in passed if p.kept is not None] + ([last] if last else [])
    watcher = SteadyWatch(solver.steady_tolerance, typical_stiffness(system))
    for row in range(len(passed)):
        watch(watcher, passed, row)
    corners = [i for p in passed for i in p.corners] + unfinished[0]
    first_loading = sum(float(p.dissipation.sum()) for p in passed[:1])
    totals = unfinished[1] if unfinished[0] or not passed else passed[-1].totals
    return Record(
        x=flip * system.x[mirror.index],
        points=system.points[mirror.index] * np.stack([flip, np.ones_like(flip)], axis=1),
        f=mirror.even(system.f),
        g0=mirror.even(system.g0),
        weight=weight,
        edge=system.edges[mirror.index],
        edge_names=system.edge_names,
        load_names=system.load_names,
        scene_toml=system.scene_toml,
        method=solver.method,
        modelled_nodes=system.n,
        modelled_dofs=int(np.sum(~frictional_form(system).held)),
        half=system.half,
        axisymmetric=system.axisymmetric,
        load_sign=system.load_sign if system.load_sign.size else -np.ones(n_loads),
        turning_points=states_table(system, mirror, corners),
        samples=states_table(system, mirror, [i for k in kept for i in k.instants]),
        events=events_table(mirror, [c for k in kept for c in k.changes], n_loads),
        cycles=Cycles(
            dissipation=mirror.factor * D.sum(axis=1),
            dissipation_density=mirror.total(D) / np.where(weight > 0.0, weight, np.inf),
            slip_increment=mirror.odd(slip) + 0.0,  # no -0.0
        ),
        dissipation_first_loading=mirror.factor * first_loading,
        steady=Steady(
            reached=watcher.cycle >= 0,
            cycle=watcher.cycle,
            kind=watcher.kind,
            period=watcher.period,
            change=np.array(watcher.change),
        ),
        residual_max=totals.residual,
        energy_error_max=totals.energy_error,
        sweeps=totals.sweeps,
        n_events=totals.events,
        jumps=totals.jumps,
        released=mirror.factor * totals.released,
    )


def _slip(before: Passed, cycle: Passed) -> Array:
    """Return the slip (N,) of a cycle: what open nodes move between its ends is none."""
    ends = [passed.corners[-1].state.state for passed in (before, cycle)]
    touches = np.all(np.array(ends) != State.SEPARATION, axis=0)
    return np.where(touches, cycle.slip, 0.0)


def states_table(system: ContactSystem, mirror: Mirror, instants: list[Instant]) -> States:
    """Return the instants as the record's table for the whole contact."""
    n, n_loads = system.n, len(system.load_names)
    weight = mirror.total(system.weight)
    u = np.array([i.state.u for i in instants]).reshape(-1, 2 * n)
    r = np.array([i.state.r for i in instants]).reshape(-1, 2 * n)
    v = np.array([i.v for i in instants]).reshape(-1, n)
    load = np.array([i.load for i in instants]).reshape(-1, n_loads)
    state = np.array([i.state.state for i in instants], dtype=np.int8).reshape(-1, n)
    # an open node bears nothing; what the solvers leave there is round-off, but for what holds it
    r[np.tile(state == State.SEPARATION, 2) & ~system.held] = 0.0
    Q, P = mirror.odd_total(r[:, :n]), mirror.total(r[:, n:])
    if system.axisymmetric:
        # what holds the axis in its place is no traction
        Q[:, np.abs(system.x) <= AXIS_TOLERANCE * np.abs(system.x).max()] = 0.0
    weighted = weight > 0.0
    safe = np.where(weighted, weight, 1.0)
    return States(
        cycle=np.array([i.cycle for i in instants], dtype=np.int64),
        leg=np.array([i.leg for i in instants], dtype=np.int64),
        s=np.array([i.s for i in instants], dtype=float),
        load=load,
        state=mirror.states(state),
        P=P,
        Q=Q,
        p=np.where(weighted, P / safe, 0.0),
        q=np.where(weighted, Q / safe, 0.0),
        v=mirror.odd(v),
        w=mirror.even(u[:, n:]),
        load_displacement=mirror.factor * load_displacement(system, load, u),
    )


def load_displacement(system: ContactSystem, load: Array, u: Array) -> Array:
    """Return the work-conjugate displacement of each load, for (n, n_loads) loads and (n, 2N) u."""
    if system.load_compliance.size == 0:
        return np.full(load.shape, np.nan)
    moved = u[:, system.n :] if system.kind == "normal" else u
    return load @ system.load_compliance.T + system.load_sign * (moved @ system.r_star.T)


def events_table(mirror: Mirror, changes: list[Change], n_loads: int) -> Events:
    """Return the changes as the record's table; a mirror pair stands in two rows."""
    rows = [
        (c, j, int(MIRRORED[c.old]) if left else c.old, int(MIRRORED[c.new]) if left else c.new)
        for c in changes
        for j, left in mirror.nodes(c.node)
    ]
    return Events(
        cycle=np.array([c.cycle for c, *_ in rows], dtype=np.int64),
        leg=np.array([c.leg for c, *_ in rows], dtype=np.int64),
        s=np.array([c.s for c, *_ in rows], dtype=float),
        load=np.array([c.load for c, *_ in rows]).reshape(-1, n_loads),
        node=np.array([j for _, j, _, _ in rows], dtype=np.int64),
        old=np.array([old for *_, old, _ in rows], dtype=np.int8),
        new=np.array([new for *_, new in rows], dtype=np.int8),
    )
