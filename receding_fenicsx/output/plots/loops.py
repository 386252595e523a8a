"""Paths through a cycle: loads with their displacements, tractions and displacements of nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import States
from receding_fenicsx.interface.law import State

MAX_NODES = 4
"""Largest number of representative nodes."""
NEGLIGIBLE_FORCE = 1e-6
"""Part of the largest nodal force below which a node counts as not in contact."""
MAX_CYCLES = 3
"""Largest number of cycles shown by default."""


@dataclass(frozen=True)
class Loop:
    """n instants of one cycle in order of time, from the end of the cycle before.

    Attributes:
        cycle: the cycle.
        load, displacement: (n, n_loads) load factors and their work-conjugate displacements.
        load_sign: (n_loads,) -1 for forces, +1 for prescribed displacements, whose conjugates are
            forces times the displacements at factor 1.
        p, q, v, w: (n, N) tractions and displacements.
        turning: (n,) True at turning points.
    """

    cycle: int
    load: Array
    displacement: Array
    load_sign: Array
    p: Array
    q: Array
    v: Array
    w: Array
    turning: NDArray[np.bool_]

    def area(self) -> Array:
        r"""(n_loads,) work of each load over the closed cycle.

        For a force it is the integral of the load factor over its displacement; for a prescribed
        displacement, the integral of its conjugate over the load factor. The sum over the loads is
        the dissipation of the closed cycle. The trapezoidal rule on the samples is exact if no node
        changes its state between two samples.
        """
        mean = 0.5 * (self.load[1:] + self.load[:-1])
        return -self.load_sign * np.sum(mean * np.diff(self.displacement, axis=0), axis=0)


def sampled_cycles(record: Record) -> list[int]:
    """Return the cycles that the record holds samples of."""
    return [int(cycle) for cycle in np.unique(record.samples.cycle)]


def check_sampled(record: Record, cycle: int) -> None:
    """Raise InputError where a record has no samples of a cycle."""
    known = sampled_cycles(record)
    if cycle not in known:
        raise InputError(
            f"cycle {cycle}: the record has no samples of it, only of {known}; name it in [output] "
            "cycles"
        )


def shown_cycles(record: Record) -> list[int]:
    """Return first loading, first and last cycle, as far as there are samples."""
    cycles = sampled_cycles(record)
    return sorted({*cycles[:2], *cycles[-1:]})[:MAX_CYCLES]


def loop_of(record: Record, cycle: int) -> Loop:
    """Return a sampled cycle's path.

    Raises:
        InputError: the record holds no samples of the cycle.
    """
    points, samples = record.turning_points, record.samples
    check_sampled(record, cycle)
    parts: list[tuple[States, NDArray[np.intp], bool]] = []
    before = np.flatnonzero(points.cycle < cycle)[-1:]
    parts.append((points, before, True))
    for end in np.flatnonzero(points.cycle == cycle):
        leg = points.leg[end]
        here = np.flatnonzero((samples.cycle == cycle) & (samples.leg == leg) & (samples.s < 1.0))
        here = here[samples.s[here] > 0.0] if parts[0][1].size else here
        parts.append((samples, here[np.argsort(samples.s[here], kind="stable")], False))
        parts.append((points, np.array([end]), True))

    def join(name: str) -> Array:
        return np.vstack([getattr(table, name)[rows] for table, rows, _ in parts])

    return Loop(
        cycle=cycle,
        load=join("load"),
        displacement=join("load_displacement"),
        load_sign=record.load_sign,
        p=join("p"),
        q=join("q"),
        v=join("v"),
        w=join("w"),
        turning=np.concatenate([np.full(len(rows), turns) for _, rows, turns in parts]),
    )


def representative_nodes(record: Record) -> list[int]:
    """Choose nodes with different paths, with x > 0 if half of the body was modelled.

    Returns:
        Up to ``MAX_NODES`` nodes in order of x, in contact in the last sampled cycle: the one with
        the largest dissipation, the middle one of those that also separate, the middle one of those
        that always stick, and others evenly between them.
    """
    rows = np.isin(record.samples.cycle, sampled_cycles(record)[-1:])
    state = record.samples.state[rows]
    force = record.samples.P[rows]
    pressed = force > NEGLIGIBLE_FORCE * force.max(initial=0.0)
    usable = np.any(pressed, axis=0) & (record.weight > 0.0)
    if record.half and np.any(usable & (record.x > 0.0)):
        usable &= record.x > 0.0
    if not np.any(usable):
        return []
    chosen = set()
    density = record.cycles.dissipation_density[-1:]
    if np.any(density > 0.0):
        chosen.add(int(np.argmax(np.where(usable, density[0], -1.0))))
    for kind in (np.any(state == State.SEPARATION, axis=0), np.all(state == State.STICK, axis=0)):
        nodes = np.flatnonzero(usable & kind)
        chosen |= {int(nodes[len(nodes) // 2])} if len(nodes) else set()
    between = np.flatnonzero(usable)
    if len(chosen) > 1:
        between = between[(between > min(chosen)) & (between < max(chosen))]
    missing = min(MAX_NODES - len(chosen), len(between))
    for part in (np.arange(missing) + 1.0) / (missing + 1.0):
        chosen.add(int(between[round(part * (len(between) - 1))]))
    return sorted(chosen, key=lambda i: float(record.x[i]))
