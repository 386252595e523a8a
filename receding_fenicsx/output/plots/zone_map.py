"""Zone maps: states along the contact edge as areas over (x, s), for one leg or for a cycle.

The exact method knows when each node changes its state. A change that two neighbouring nodes both
make is drawn as a straight line between their instants. A change that only one of them makes ends
midway between them. Nothing is rounded to samples or pixels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.measures.limit_nodes import SLIP
from receding_fenicsx.output.plots.series import legs_of

Change = tuple[float, int]
"""Position s on the leg, and the new state."""


@dataclass(frozen=True)
class Timeline:
    """States of one node along a leg."""

    state: NDArray[np.int8]  # (n,) successive states, each different from the one before
    s: Array  # (n + 1,) begins of the states and end of the last one, from 0 on

    def at(self, s: float | Array) -> NDArray[np.int8]:
        """Return the state at s; at a change the new state."""
        return self.state[np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.state) - 1)]

    @property
    def changes(self) -> list[Change]:
        """The first state and its changes."""
        return list(zip(self.s[:-1].tolist(), self.state.tolist(), strict=True))


def timeline(changes: Iterable[Change], end: float = 1.0) -> Timeline:
    """Make a timeline from the first state and its changes, in order of s."""
    states: list[int] = []
    begins: list[float] = []
    for s, new in [*changes, (end, -1)]:
        # a state before it of this part of a leg is round-off
        if begins and s - begins[-1] <= 1e-9:
            states.pop()
            begins.pop()
        if new >= 0 and (not states or states[-1] != new):
            begins.append(s if states else 0.0)
            states.append(new)
    return Timeline(np.array(states, dtype=np.int8), np.array([*begins, end]))


def timelines_of(
    record: Record,
    cycle: int,
    leg: int,
    stuck: NDArray[np.bool_] | None = None,
    flicker: float = 0.0,
) -> list[Timeline]:
    """Return the timelines of all nodes along a sampled leg, from its events or its samples.

    Negligible slip of ``stuck`` nodes is shown as stick. A change between stick and slip that a
    single node reverts within the part ``flicker`` of the leg is removed.
    """
    read = _from_events if record.method == "events" else _from_samples
    held = np.zeros(len(record.x), dtype=bool) if stuck is None else stuck
    lines = [
        timeline((s, State.STICK if sticks and state in SLIP else state) for s, state in changes)
        for changes, sticks in zip(read(record, cycle, leg), held, strict=True)
    ]
    found = []
    for i, line in enumerate(lines):
        beside = [lines[j].s[1:-1] for j in (i - 1, i + 1) if 0 <= j < len(lines)]
        changes, k = line.changes, 1
        while k + 1 < len(changes):
            (_, before), (begin, state), (end, after) = changes[k - 1 : k + 2]
            quiet = not any(np.any((s >= begin) & (s <= end)) for s in beside)
            friction = {before, state} <= {State.STICK, *SLIP}
            if before == after and friction and quiet and end - begin <= flicker:
                del changes[k : k + 2]
            else:
                k += 1
        found.append(timeline(changes))
    return found


def _from_events(record: Record, cycle: int, leg: int) -> list[list[Change]]:
    """Go back from the states at the end of the leg to those at its begin, event by event."""
    table, events = record.turning_points, record.events
    end = table.state[np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0]]
    here = np.flatnonzero((events.cycle == cycle) & (events.leg == leg))
    first = end.astype(int)
    for k in here[::-1]:
        first[events.node[k]] = events.old[k]
    changes: list[list[Change]] = [[(0.0, state)] for state in first.tolist()]
    for k in here:
        changes[events.node[k]].append((float(events.s[k]), int(events.new[k])))
    return changes


def _from_samples(record: Record, cycle: int, leg: int) -> list[list[Change]]:
    """Move each zone's end at constant speed from one sample to the next."""
    table = record.samples
    rows = np.flatnonzero((table.cycle == cycle) & (table.leg == leg))
    rows = rows[np.argsort(table.s[rows], kind="stable")]
    if np.any(table.P[rows] > 0.0) and not np.any(table.P[rows[-1]] > 0.0):
        # without any force every state is admissible: show the zones of the limit
        rows = rows[:-1]
    s, state = table.s[rows], table.state[rows]
    changes: list[list[Change]] = [[(0.0, first)] for first in state[0].tolist()]
    for k in range(1, len(s)):
        old, new = state[k - 1], state[k]
        # neighbouring nodes that make the same change
        key = np.where(old == new, 0, 10 * old.astype(int) + new)
        for run in np.split(np.arange(len(key)), np.flatnonzero(np.diff(key)) + 1):
            for i, part in zip(run, _order(run, old, new), strict=True) if key[run[0]] else ():
                changes[i].append((float(s[k - 1] + part * (s[k] - s[k - 1])), int(new[i])))
    return changes


def _order(run: NDArray[np.intp], old: NDArray[np.int8], new: NDArray[np.int8]) -> Array:
    """Return when, in [0, 1], the nodes of a group change, as the end of a zone passes them."""
    n = len(run)
    forward = (np.arange(n) + 0.5) / n
    both = (run[0] - 1, forward), (run[-1] + 1, forward[::-1])
    sides = [(k, s) for k, s in both if 0 <= k < len(old)]
    if joins := [s for k, s in sides if old[k] == new[run[0]]]:
        return np.asarray(np.minimum.reduce(joins) * len(joins))
    leaves = [s[::-1] for k, s in sides if new[k] == old[run[0]]]
    return leaves[0] if len(leaves) == 1 else np.full(n, 0.5)


@dataclass(frozen=True)
class ZoneMap:
    """Zones of n legs over (x, s): leg k at k <= s <= k + 1."""

    timelines: list[Timeline]  # timelines of the nodes
    pieces: list[tuple[State, Array]]  # states and polygons that cover all x, and s from 0 to n
    boundaries: Array  # (m, 2, 2) segments [[x, s], [x, s]] along which the state changes

    def states(self, s: float | Array) -> NDArray[np.int8]:
        """Return (N,) or (N, k) states of the nodes at s."""
        return np.array([line.at(s) for line in self.timelines], dtype=np.int8)


def zone_map(
    record: Record,
    cycle: int,
    leg: int | None = None,
    stuck: NDArray[np.bool_] | None = None,
    flicker: float = 0.0,
) -> ZoneMap:
    """Map the zones of one leg, or those of all legs of a cycle; see :func:`timelines_of`."""
    legs, x = legs_of(record, cycle) if leg is None else [(cycle, leg)], record.x
    lines, pieces, found = list[list[Timeline]](), list[tuple[State, Array]](), list[Array]()
    for n, where in enumerate(legs):
        row = [Timeline(t.state, n + t.s) for t in timelines_of(record, *where, stuck, flicker)]
        lines.append(row)
        for (a, x0), (b, x1) in pairwise(zip(row, x.tolist(), strict=True)):
            # between two neighbouring nodes, from one change that both make to the next
            matched = [(0, 0), *_matches(a, b), (len(a.state), len(b.state))]
            found += [np.array([[x0, a.s[j]], [x1, b.s[k]]]) for j, k in matched[1:-1]]
            for (j0, k0), (j1, k1) in pairwise(matched):
                left = Timeline(a.state[j0:j1], a.s[j0 : j1 + 1]), x0
                right = Timeline(b.state[k0:k1], b.s[k0 : k1 + 1]), x1
                _fill_block(left, right, pieces, found)
    # lines where nodes change their state at the turning point between two legs
    ends = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    for k, (before, after) in enumerate(pairwise(lines), start=1):
        pairs = zip(before, after, strict=True)
        changed = np.flatnonzero([a.state[-1] != b.state[0] for a, b in pairs])
        for run in np.split(changed, np.flatnonzero(np.diff(changed) > 1) + 1):
            if len(run):
                found.append(np.array([[ends[run[0]], k], [ends[run[-1] + 1], k]]))
    whole = [
        timeline((change for line in node for change in line.changes), float(len(legs)))
        for node in zip(*lines, strict=True)
    ]
    return ZoneMap(whole, pieces, np.array(found).reshape(-1, 2, 2))


def _matches(a: Timeline, b: Timeline) -> list[tuple[int, int]]:
    """Pair the changes of state that two neighbouring nodes both make, in order."""
    na, nb = len(a.state), len(b.state)

    def gain(i: int, j: int) -> float:
        same = a.state[i - 1] == b.state[j - 1] and a.state[i] == b.state[j]
        return 2.0 - abs(a.s[i] - b.s[j]) if same else -1.0

    best = np.zeros((na + 1, nb + 1))
    for i in range(na - 1, 0, -1):
        for j in range(nb - 1, 0, -1):
            best[i, j] = max(best[i + 1, j], best[i, j + 1], gain(i, j) + best[i + 1, j + 1])
    found, i, j = [], 1, 1
    while i < na and j < nb:
        if gain(i, j) > 0.0 and best[i, j] == gain(i, j) + best[i + 1, j + 1]:
            found.append((i, j))
            i, j = i + 1, j + 1
        elif best[i, j] == best[i + 1, j]:
            i += 1
        else:
            j += 1
    return found


def _fill_block(
    left: tuple[Timeline, float],
    right: tuple[Timeline, float],
    pieces: list[tuple[State, Array]],
    lines: list[Array],
) -> None:
    """Fill the part of a strip between two paired changes, which holds unpaired changes only."""
    (a, x0), (b, x1) = left, right
    middle = 0.5 * (x0 + x1)
    # the two sides meet midway, at instants between those of the sides
    ends = 0.5 * (a.s[[0, -1]] + b.s[[0, -1]])
    inner = [ends[0] + (t.s - t.s[0]) / (t.s[-1] - t.s[0]) * (ends[1] - ends[0]) for t in (a, b)]
    for (here, x), (other, _), m in ((left, right, inner[0]), (right, left, inner[1])):
        if len(other.state) == 1 and other.state[0] in here.state:
            whole = np.array([[x0, a.s[0]], [x1, b.s[0]], [x1, b.s[-1]], [x0, a.s[-1]]])
            pieces.append((State(other.state[0]), whole))
            # zones of one side only are triangles with a corner midway
            odd = here.state != other.state[0]
            for group in np.split(np.arange(len(odd)), np.flatnonzero(np.diff(odd)) + 1):
                if not odd[group[0]]:
                    continue
                s, inside = here.s[group[0] : group[-1] + 2], m[group[0] : group[-1] + 2]
                tip, changes = [middle, 0.5 * (inside[0] + inside[-1])], s
                if group[0] == 0:
                    tip[1], changes = ends[0], s[1:]
                elif group[-1] == len(odd) - 1:
                    tip[1], changes = ends[1], s[:-1]
                for k, state in enumerate(here.state[group]):
                    pieces.append((State(state), np.array([[x, s[k]], tip, [x, s[k + 1]]])))
                lines.extend(np.array([[x, when], tip]) for when in changes)
            return
    for t, m, x in ((a, inner[0], x0), (b, inner[1], x1)):
        for k, state in enumerate(t.state):
            corners = [[x, t.s[k]], [middle, m[k]], [middle, m[k + 1]], [x, t.s[k + 1]]]
            pieces.append((State(state), np.array(corners)))
            if k:
                lines.append(np.array([[x, t.s[k]], [middle, m[k]]]))
    for low, high in pairwise(np.unique(np.concatenate(inner))):
        half = 0.5 * (low + high)
        states = [t.state[np.searchsorted(m, half) - 1] for t, m in zip((a, b), inner, strict=True)]
        if states[0] != states[1]:
            lines.append(np.array([[middle, low], [middle, high]]))
