"""Timelines of the contact nodes' states along one leg, from a record's events or samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State

FRICTION_STATES = (State.STICK, State.FORWARD_SLIP, State.BACKWARD_SLIP)


@dataclass(frozen=True)
class Timeline:
    """States of one node along a leg.

    Attributes:
        state: (n,) successive states, each different from the one before.
        s: (n + 1,) begins of the states and end of the last one, from 0 to 1.
    """

    state: NDArray[np.int8]
    s: Array

    def at(self, s: float | Array) -> NDArray[np.int8]:
        """Return the state at s; at a change the new state."""
        return self.state[np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.state) - 1)]

    @property
    def changes(self) -> list[tuple[float, int]]:
        """Changes of state (s, new state)."""
        return list(zip(self.s[1:-1].tolist(), self.state[1:].tolist(), strict=True))


def timelines_of(record: Record, cycle: int, leg: int) -> list[Timeline]:
    """Return the timelines of all nodes along a sampled leg.

    They come from the record's events for the exact method and from its samples for others.
    """
    if record.method == "events":
        return _from_events(record, cycle, leg)
    return _from_samples(record, cycle, leg)


def timeline(start: int, changes: list[tuple[float, int]]) -> Timeline:
    """Make a timeline from the first state and the changes (s, new state), in order of s."""
    states, begins = [start], [0.0]
    for s, new in [*changes, (1.0, -1)]:
        # part of a leg below which the duration of a state is round-off
        if s - begins[-1] <= 1e-9:
            # drop the state before: its duration is round-off
            states.pop()
            begins.pop()
        if new < 0:
            break
        if states and states[-1] == new:
            continue
        states.append(new)
        begins.append(s if len(states) > 1 else 0.0)
    return Timeline(np.array(states, dtype=np.int8), np.array([*begins, 1.0]))


def without_slip(line: Timeline) -> Timeline:
    """Return a timeline with stick in place of slip."""
    slips = np.isin(line.state, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
    state = np.where(slips, State.STICK, line.state)
    return timeline(int(state[0]), Timeline(state, line.s).changes)


def without_flicker(timelines: list[Timeline], longest: float) -> list[Timeline]:
    """Remove short changes between stick and slip that a single node makes and reverts.

    Args:
        timelines: timelines of all nodes, in order.
        longest: largest duration, as a part of the leg, of a removed state. It is removed if the
            states before and after are equal and no neighbour changes its state meanwhile.

    Returns:
        The timelines.
    """
    found = list(timelines)
    for i, line in enumerate(timelines):
        beside = [timelines[j] for j in (i - 1, i + 1) if 0 <= j < len(timelines)]
        changes = line.changes
        k = 0
        while k + 1 < len(changes):
            before = int(line.state[0]) if k == 0 else changes[k - 1][1]
            (begin, state), (end, after) = changes[k : k + 2]
            quiet = not any(np.any((t.s[1:-1] >= begin) & (t.s[1:-1] <= end)) for t in beside)
            friction = {before, state} <= set(FRICTION_STATES)
            if before == after and friction and quiet and end - begin <= longest:
                del changes[k : k + 2]
            else:
                k += 1
        if len(changes) + 1 < len(line.state):
            found[i] = timeline(int(line.state[0]), changes)
    return found


def _from_events(record: Record, cycle: int, leg: int) -> list[Timeline]:
    """Go back from the states at the end of the leg to those at its begin, event by event."""
    table, events = record.turning_points, record.events
    end = table.state[np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0]]
    here = np.flatnonzero((events.cycle == cycle) & (events.leg == leg))
    first = end.astype(int)
    changes: list[list[tuple[float, int]]] = [[] for _ in end]
    for k in here[::-1]:
        first[events.node[k]] = events.old[k]
    for k in here:
        changes[events.node[k]].append((float(events.s[k]), int(events.new[k])))
    return [timeline(int(a), b) for a, b in zip(first, changes, strict=True)]


def _from_samples(record: Record, cycle: int, leg: int) -> list[Timeline]:
    """Move each zone's end at constant speed from one sample to the next."""
    table = record.samples
    rows = np.flatnonzero((table.cycle == cycle) & (table.leg == leg))
    rows = rows[np.argsort(table.s[rows], kind="stable")]
    if np.any(table.P[rows] > 0.0) and not np.any(table.P[rows[-1]] > 0.0):
        # without any force every state is admissible: show the zones of the limit
        rows = rows[:-1]
    s, state = table.s[rows], table.state[rows]
    changes: list[list[tuple[float, int]]] = [[] for _ in record.x]
    for k in range(1, len(s)):
        for run in _runs(state[k - 1], state[k]):
            for i, part in zip(run, _order(run, state[k - 1], state[k]), strict=True):
                when = s[k - 1] + part * (s[k] - s[k - 1])
                changes[i].append((float(when), int(state[k][i])))
    return [timeline(int(a), b) for a, b in zip(state[0], changes, strict=True)]


def _runs(old: NDArray[np.int8], new: NDArray[np.int8]) -> list[NDArray[np.intp]]:
    """Return groups of neighbouring nodes that make the same change."""
    key = np.where(old == new, 0, 10 * old.astype(int) + new)
    groups = np.split(np.arange(len(key)), np.flatnonzero(np.diff(key)) + 1)
    return [g for g in groups if key[g[0]]]


def _order(run: NDArray[np.intp], old: NDArray[np.int8], new: NDArray[np.int8]) -> Array:
    """Return when, in [0, 1], the nodes of a group change, as the end of a zone passes them."""
    n = len(run)
    left, right = run[0] - 1, run[-1] + 1
    forward = (np.arange(n) + 0.5) / n
    joins_left = left >= 0 and old[left] == new[run[0]]
    joins_right = right < len(old) and old[right] == new[run[0]]
    leaves_left = left >= 0 and new[left] == old[run[0]]
    leaves_right = right < len(old) and new[right] == old[run[0]]
    if joins_left != joins_right:
        return forward if joins_left else forward[::-1]
    if joins_left:
        return np.minimum(forward, forward[::-1]) * 2.0
    if leaves_left != leaves_right:
        return forward[::-1] if leaves_left else forward
    return np.full(n, 0.5)
