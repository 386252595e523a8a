"""Nodes at the friction limit without slip: contact states with negligible slip shown as stick.

Where slip has decayed, the exact path still finds changes between stick and slip with slips of
1e-9 of the largest. :func:`shown_states` shows them as stick: in zone maps, above the tractions and
under the fringes. Zone maps mark with a dashed line where :func:`limit_nodes` finds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State

NEGLIGIBLE_SLIP = 1e-4
"""Largest range of v over a cycle, over that of any node of the edge, that counts as no slip."""
SLIP = (State.FORWARD_SLIP, State.BACKWARD_SLIP)


@dataclass(frozen=True)
class LimitNodes:
    """Nodes that reach the friction limit within a cycle and do not slip."""

    stuck: NDArray[np.bool_]  # (N,) all nodes whose slip over the cycle is negligible
    # node, leg, s: (n,) node, and where it first reaches the limit; nodes increase
    node: Ints
    leg: Ints
    s: Array
    strict: bool  # none of them slips at all; else some slip by less than ``NEGLIGIBLE_SLIP``


def is_settled(record: Record, cycle: int) -> bool:
    """Return whether a cycle is steady; without a steady state, whether it is the last one."""
    last = int(record.turning_points.cycle.max(initial=0))
    first = record.steady.cycle if record.steady.reached else last
    return cycle > 1 and cycle >= first


def stuck_nodes(record: Record, cycle: int) -> NDArray[np.bool_]:
    """Return (N,) closed nodes with friction whose slip over a cycle is negligible."""
    points, samples = record.turning_points, record.samples
    start = record.start_row(cycle)
    before = [] if start is None else [start]
    ends, rows = (np.flatnonzero(table.cycle == cycle) for table in (points, samples))
    span = np.ptp(np.vstack([points.v[before], points.v[ends], samples.v[rows]]), axis=0)
    state = np.vstack([points.state[ends], samples.state[rows]])
    largest = np.zeros(len(span))
    for k in np.unique(record.edge):
        largest[record.edge == k] = span[record.edge == k].max()
    closed = ~np.any(state == State.SEPARATION, axis=0)
    return closed & (span <= NEGLIGIBLE_SLIP * largest) & record.friction.present


def shown_states(
    record: Record,
    cycle: int,
    state: NDArray[np.integer],
    nodes: NDArray[np.bool_] | slice = slice(None),
) -> NDArray[np.int8]:
    """Return states of some nodes at an instant of a cycle as pictures show them.

    In a settled cycle the nodes of :func:`stuck_nodes` stick.
    """
    shown = np.asarray(state, dtype=np.int8)
    if not is_settled(record, cycle):
        return shown
    stuck = stuck_nodes(record, cycle)[nodes]
    return np.where(np.isin(shown, SLIP) & stuck, State.STICK, shown).astype(np.int8)


def limit_nodes(record: Record, cycle: int) -> LimitNodes:
    """Find the nodes that reach |Q| = f P within a sampled cycle and yet do not slip.

    Slip that is a negligible part of the largest counts as none, because slip decays to zero only
    in the limit of the steady state.
    """
    table = record.samples
    rows = np.flatnonzero(table.cycle == cycle)
    state = table.state[rows]
    slips = np.any(np.isin(state, SLIP), axis=0)
    stuck = stuck_nodes(record, cycle)
    # of a node at its limit |Q| and f P differ by so much at most
    low, high = record.friction.limits((1.0 - 1e-6) * table.P[rows])
    beyond = (table.Q[rows] <= low) | (table.Q[rows] >= high)
    at_limit = stuck & (table.P[rows] > 0.0) & beyond
    reached = at_limit.any(axis=0)
    # a node may reach the limit and leave it between two samples
    events = record.events
    here = (events.cycle == cycle) & np.isin(events.new, SLIP) & (record.method == "events")
    reached[events.node[here]] = True
    node = np.flatnonzero(reached & stuck)
    row = rows[np.argmax(at_limit[:, node], axis=0)]
    leg, s = table.leg[row], table.s[row].copy()
    for k, i in enumerate(node):
        for first in np.flatnonzero(here & (events.node == i))[:1]:
            leg[k], s[k] = events.leg[first], events.s[first]
    return LimitNodes(stuck, node, leg, s, not bool(np.any(slips[node])))
