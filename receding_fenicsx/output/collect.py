"""Collecting instants and events of the modelled nodes into the record's whole-contact tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from receding_fenicsx.interface.contact import Array, ContactState, ContactSystem
from receding_fenicsx.interface.mirror import SWAPPED, Mirror
from receding_fenicsx.output.record import Events, States


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


def states_table(system: ContactSystem, mirror: Mirror, instants: list[Instant]) -> States:
    """Return the instants as the record's table for the whole contact."""
    n, n_loads = system.n, len(system.load_names)
    weight = mirror.total(system.weight)
    u = np.array([i.state.u for i in instants]).reshape(-1, 2 * n)
    r = np.array([i.state.r for i in instants]).reshape(-1, 2 * n)
    v = np.array([i.v for i in instants]).reshape(-1, n)
    load = np.array([i.load for i in instants]).reshape(-1, n_loads)
    state = np.array([i.state.state for i in instants], dtype=np.int8).reshape(-1, n)
    Q, P = mirror.odd(r[:, :n]), mirror.total(r[:, n:])
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
        (c, j, int(SWAPPED[c.old]) if left else c.old, int(SWAPPED[c.new]) if left else c.new)
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
