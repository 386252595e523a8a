"""Assemble the record of the whole contact from the finished cycles of the modelled nodes."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.instants import (
    FinishedCycle,
    Instant,
    Samples,
    Totals,
    events_of,
    steady_watch,
)
from receding_fenicsx.evolution.probes import probes_table
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import Cycles, Events, PathUniqueness, States, Steady
from receding_fenicsx.interface.law import MIRRORED, State
from receding_fenicsx.interface.measures.steady import SteadyWatch
from receding_fenicsx.interface.mirror import Mirror, mirror_of
from receding_fenicsx.interface.system import ContactSystem, frictional_form
from receding_fenicsx.interface.uniqueness.watch import Uniqueness
from receding_fenicsx.scene.model import SolverOptions


def record_of(
    system: ContactSystem,
    solver: SolverOptions,
    cycles: list[FinishedCycle],
    unfinished: tuple[list[Instant], Totals, Uniqueness] = ([], Totals(), Uniqueness()),
    last: Samples | None = None,
    watch: SteadyWatch | None = None,
) -> Record:
    """Return the record of the whole contact from the finished cycles.

    ``unfinished`` has the ends of the finished legs of a cycle that ended early, the totals and the
    uniqueness there; ``last`` has samples and events of the last finished cycle, where it has none.
    ``watch`` has seen the cycles.
    """
    mirror = mirror_of(system)
    samples = [c.samples for c in cycles if c.samples is not None] + ([last] if last else [])
    corners = [corner for c in cycles for corner in c.corners] + unfinished[0]
    totals, unique = unfinished[1:]
    if cycles and not unfinished[0]:
        totals, unique = cycles[-1].totals, cycles[-1].uniqueness
    watch, weight = watch or steady_watch(system, solver, cycles), mirror.total(system.weight)
    sign = system.load_sign if system.load_sign.size else -np.ones(len(system.load_names))
    D = np.array([cycle.dissipation for cycle in cycles[1:]]).reshape(-1, system.n)
    # what open nodes move between the ends of a cycle is no slip
    open_ = [cycle.corners[-1].state.state == State.SEPARATION for cycle in cycles]
    steps = zip(pairwise(open_), cycles[1:], strict=False)
    slip = np.reshape([np.where(a | b, 0.0, c.slip) for (a, b), c in steps], (-1, system.n))
    same = "certified", "solutions", "cycle", "leg", "s"
    return Record(
        **_nodes(system, mirror),
        load_names=system.load_names,
        scene_toml=system.scene_toml,
        method=solver.method,
        modelled_nodes=system.n,
        modelled_dofs=int(np.sum(~frictional_form(system).held)),
        half=system.half,
        axisymmetric=system.axisymmetric,
        load_sign=sign.copy(),
        turning_points=states_table(system, mirror, corners),
        samples=states_table(system, mirror, [i for part in samples for i in part.instants]),
        events=events_table(mirror, events_of(system, samples)),
        cycles=Cycles(
            dissipation=mirror.factor * D.sum(axis=1),
            dissipation_density=mirror.total(D) / np.where(weight > 0.0, weight, np.inf),
            slip_increment=mirror.odd(slip) + 0.0,  # no -0.0
        ),
        dissipation_first_loading=mirror.factor
        * sum(float(c.dissipation.sum()) for c in cycles[:1]),
        steady=Steady(
            watch.cycle >= 0, watch.cycle, watch.kind, watch.period, np.array(watch.change)
        ),
        residual_max=totals.residual,
        energy_error_max=totals.energy_error,
        sweeps=totals.sweeps,
        n_events=totals.events,
        jumps=totals.jumps,
        released=mirror.factor * totals.released,
        probes=probes_table(system, corners, samples),
        choices=tuple(choice for cycle in cycles for choice in cycle.choices),
        uniqueness=PathUniqueness(
            **{key: getattr(unique, key) for key in same},
            margin=unique.margin if unique.certified or unique.cycle >= 0 else np.nan,
            nodes=np.sort(mirror.nodes(np.array([i for i in unique.nodes if i >= 0], np.intp))[1]),
            first_loading=unique.static,
            first_loading_proved=unique.proved,
        ),
    )


def _nodes(system: ContactSystem, mirror: Mirror) -> dict[str, Any]:
    """Return the fields of the record about the contact nodes."""
    sign = np.where(mirror.left, -1.0, 1.0)
    friction = mirror.friction(system.law)
    held = system.held[mirror.index] & ~mirror.axis
    return {
        "x": sign * system.x[mirror.index],
        "points": system.points[mirror.index] * np.stack([sign, np.ones_like(sign)], axis=1),
        "f": friction.forward,
        "f_backward": None if system.f_backward is None else friction.backward,
        "g0": mirror.even(system.g0),
        "weight": mirror.total(system.weight),
        "edge": system.edges[mirror.index],
        "edge_names": system.edge_names,
        "held": held if held.any() else None,
        **{
            name: None if (part := getattr(system, name)) is None else mirror.even(part)
            for name in ("cohesion", "shear_limit")
        },
    }


def states_table(system: ContactSystem, mirror: Mirror, instants: list[Instant]) -> States:
    """Return the instants as the record's table for the whole contact."""
    n, n_loads = system.n, len(system.load_names)
    weight = mirror.total(system.weight)
    u, r = (np.reshape([getattr(i.state, k) for i in instants], (-1, 2 * n)) for k in "ur")
    v = np.reshape([i.v for i in instants], (-1, n))
    load = np.reshape([i.load for i in instants], (-1, n_loads))
    state = np.array([i.state.state for i in instants], dtype=np.int8).reshape(-1, n)
    # open nodes carry no force, the rest is round-off; reactions of supports are no tractions
    r[np.tile(state == State.SEPARATION, 2) | system.held] = 0.0
    Q, P = mirror.odd_total(r[:, :n]), mirror.total(r[:, n:])
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


def events_table(mirror: Mirror, events: NDArray[np.void]) -> Events:
    """Return rows of events as the record's table; a mirror pair has two rows."""
    rows, node = mirror.nodes(events["node"])
    events, left = events[rows], mirror.left[node]
    return Events(
        cycle=events["cycle"].astype(np.int64),
        leg=events["leg"].astype(np.int64),
        s=events["s"].copy(),
        load=events["load"].copy(),
        node=node.astype(np.int64),
        old=np.where(left, MIRRORED[events["old"]], events["old"]),
        new=np.where(left, MIRRORED[events["new"]], events["new"]),
    )
