"""Data of figures: legs, slip per cycle, nodes at the friction limit that do not slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import PowerLaw, fit_power_law
from receding_fenicsx.reference.ahn_barber import SLIP_CYCLES, SLIP_FLOOR, SLIP_NODES

AT_LIMIT = 1e-6
"""Largest relative difference of |Q| and f P of a node at its friction limit."""
NEGLIGIBLE_SLIP = 1e-4
"""Largest range of v over a cycle, over that of any node, that counts as no slip."""
MIN_CYCLES = 5
"""Smallest number of cycles for the fit of a power law."""
MAX_LINES = 4
"""Largest number of nodes in the figure of slip per cycle."""


@dataclass(frozen=True)
class SlipLine:
    """Slip per cycle of one node.

    Attributes:
        node: the node.
        x: its position over the length scale.
        N: cycles in which it slips by more than round-off.
        slip: its absolute slip in them, over the slip scale.
        fit: power law over the fitted cycles.
        factor: value of the fit at N = 1.
    """

    node: int
    x: float
    N: Array
    slip: Array
    fit: PowerLaw
    factor: float

    def at(self, N: Array) -> Array:
        """Values of the fit."""
        return self.factor * N**self.fit.exponent


@dataclass(frozen=True)
class Still:
    """Nodes that reach the friction limit within a cycle and do not slip.

    Attributes:
        stuck: (N,) all nodes whose slip over the cycle is negligible.
        node, leg, s: (n,) node, and where it first reaches the limit; nodes increase.
        strict: none of them slips at all; else some slip by less than ``NEGLIGIBLE_SLIP``.
    """

    stuck: NDArray[np.bool_]
    node: Ints
    leg: Ints
    s: Array
    strict: bool


def leg_ends(record: Record, cycle: int, leg: int) -> tuple[Array, Array]:
    """Return load factors (n_loads,) at the start and the end of a leg."""
    row = leg_row(record, cycle, leg)
    end = record.turning_points.load[row]
    return record.turning_points.load[row - 1] if row else np.zeros_like(end), end


def leg_row(record: Record, cycle: int, leg: int) -> int:
    """Return the row of the turning points at which a leg ends."""
    table = record.turning_points
    return int(np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0])


def legs_of(record: Record, cycle: int) -> list[tuple[int, int]]:
    """Return (cycle, leg) of the legs of a cycle that have samples."""
    table = record.samples
    return [(cycle, int(leg)) for leg in np.unique(table.leg[table.cycle == cycle])]


def is_unloading(record: Record, cycle: int, leg: int) -> bool:
    """Return whether the sum of the absolute loads falls along a leg."""
    begin, end = leg_ends(record, cycle, leg)
    return bool(np.abs(end).sum() < np.abs(begin).sum())


def first_unloading(record: Record) -> tuple[int, int] | None:
    """Return cycle and leg of the first unloading; None without one."""
    table = record.turning_points
    for where in zip(table.cycle.tolist(), table.leg.tolist(), strict=True):
        if is_unloading(record, *where):
            return where
    return None


def slip_lines(record: Record, length: float = 1.0, unit: float = 1.0) -> list[SlipLine]:
    """Return slip per cycle at representative nodes with fitted powers of N (Fig. 8).

    Args:
        record: the record.
        length: length scale; nodes with 0.5 <= |x|/length <= 0.8 are representative where any of
            them slips in every fitted cycle, otherwise all that do.
        unit: what slip is divided by.

    Returns:
        Up to ``MAX_LINES`` nodes spread evenly; none when there are too few cycles.
    """
    cycles = fitted_cycles(record)
    size = np.abs(record.cycles.slip_increment)
    if len(cycles) < MIN_CYCLES or not size.any():
        return []
    seen = size > SLIP_FLOOR * size.max()
    moving = np.all(seen[cycles - 1], axis=0)
    distance = record.x / length
    wanted = (
        moving & (distance >= SLIP_NODES[0] - AT_LIMIT) & (distance <= SLIP_NODES[1] + AT_LIMIT)
    )
    nodes = np.flatnonzero(wanted if wanted.any() else moving)
    if not len(nodes):
        return []
    chosen = nodes[np.unique(np.linspace(0, len(nodes) - 1, MAX_LINES).round().astype(int))]
    lines = []
    for i in chosen:
        values = size[cycles - 1, i] / unit
        fit = fit_power_law(cycles.astype(float), values)
        factor = np.exp(np.mean(np.log(values) - fit.exponent * np.log(cycles)))
        N = np.flatnonzero(seen[:, i]) + 1
        slip = size[N - 1, i] / unit
        lines.append(
            SlipLine(int(i), float(distance[i]), N.astype(float), slip, fit, float(factor))
        )
    return lines


def fitted_cycles(record: Record) -> Ints:
    """Return the cycles of the fits: those of the paper's comparison, or the later half."""
    n = len(record.cycles.slip_increment)
    first, last = SLIP_CYCLES
    return np.arange(first, last + 1) if n >= last else np.arange(n // 2, n + 1)[n // 2 == 0 :]


def limit_without_slip(record: Record, cycle: int) -> Still:
    """Find the nodes that reach |Q| = f P within a sampled cycle and yet do not slip.

    Slip that is a negligible part of the largest counts as none, because slip decays to zero only
    in the limit of the steady state.
    """
    table = record.samples
    rows = np.flatnonzero(table.cycle == cycle)
    before = np.flatnonzero(record.turning_points.cycle == cycle - 1)[-1:]
    v = np.vstack([record.turning_points.v[before], table.v[rows]])
    state = table.state[rows]
    span = np.ptp(v, axis=0)
    slips = np.any(np.isin(state, (State.FORWARD_SLIP, State.BACKWARD_SLIP)), axis=0)
    opens = np.any(state == State.SEPARATION, axis=0)
    stuck = ~opens & (span <= NEGLIGIBLE_SLIP * span.max(initial=0.0)) & record.friction.present
    at_limit = stuck & (table.P[rows] > 0.0) & _is_at_limit(record, table.Q[rows], table.P[rows])
    reached = at_limit.any(axis=0)
    if record.method == "events":
        # a node may reach the limit and leave it between two samples
        events = record.events
        slip = np.isin(events.new, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
        reached[events.node[(events.cycle == cycle) & slip]] = True
    node = np.flatnonzero(reached & stuck)
    row = rows[np.argmax(at_limit[:, node], axis=0)]
    leg, s = table.leg[row], table.s[row].copy()
    if record.method == "events":
        for k, i in enumerate(node):
            found = _first_slip(record, cycle, int(i))
            if found is not None:
                leg[k], s[k] = found
    return Still(stuck, node, leg, s, not bool(np.any(slips[node])))


def _is_at_limit(record: Record, Q: Array, P: Array) -> NDArray[np.bool_]:
    """Return whether the tangential reactions Q reach a limit at the pressures P."""
    low, high = record.friction.limits((1.0 - AT_LIMIT) * P)
    return (Q <= low) | (Q >= high)


def _first_slip(record: Record, cycle: int, node: int) -> tuple[int, float] | None:
    """Return leg and exact position at which a node begins to slip in a cycle."""
    events = record.events
    here = (events.cycle == cycle) & (events.node == node)
    here &= np.isin(events.new, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
    found = np.flatnonzero(here)
    return (int(events.leg[found[0]]), float(events.s[found[0]])) if len(found) else None
