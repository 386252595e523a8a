"""Zone maps: which state holds where along the contact edge as the load goes along one leg.

The exact method knows when each node changes its state. Between two neighbouring nodes the change
that both make is drawn as a straight line from the one's instant to the other's; a change that only
one of them makes ends midway between them. Nothing is rounded to samples or to pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import Array

SHORTEST = 1e-9
"""Part of a leg that a state must last to be drawn."""
FLICKER = 0.08
"""Part of a leg that a node may stick amid slip, or slip amid stick, and back while its neighbours
keep their states, without its being a zone: elements of degree 2 let nodes do so at zone ends."""
STUCK_OR_SLIPPING = (State.STICK, State.FORWARD_SLIP, State.BACKWARD_SLIP)

Polygon = Array
"""(n, 2) corners (x, s)."""


@dataclass(frozen=True)
class Timeline:
    """States of one node along a leg.

    Attributes:
        state: (n,) states, no two neighbours equal.
        s: (n + 1,) when each begins and the last one ends, from 0 to 1.
    """

    state: NDArray[np.int8]
    s: Array

    def at(self, s: float | Array) -> NDArray[np.int8]:
        """State at s; where it changes, the new one."""
        return self.state[np.clip(np.searchsorted(self.s, s, "right") - 1, 0, len(self.state) - 1)]


@dataclass(frozen=True)
class ZoneMap:
    """Zones of one leg over (x, s).

    Attributes:
        x: (N,) nodes.
        timelines: N timelines.
        pieces: state and polygon of each piece; together they cover x[0] to x[-1], s from 0 to 1.
        boundaries: (n, 2, 2) line pieces [[x, s], [x, s]] where the state changes.
    """

    x: Array
    timelines: list[Timeline]
    pieces: list[tuple[State, Polygon]]
    boundaries: Array

    def states(self, s: float) -> NDArray[np.int8]:
        """(N,) states of the nodes at s."""
        return np.array([line.at(s) for line in self.timelines], dtype=np.int8)


def has_leg(record: Record, cycle: int, leg: int) -> bool:
    """Whether the record holds enough of a leg to map its zones."""
    return bool(np.any((record.samples.cycle == cycle) & (record.samples.leg == leg)))


def zone_map(
    record: Record,
    cycle: int,
    leg: int,
    stuck: NDArray[np.bool_] | None = None,
    flicker: float = 0.0,
) -> ZoneMap:
    """Map the zones of one leg.

    Args:
        record: the record; the leg must be among the sampled ones (:func:`has_leg`).
        cycle: cycle, 0 for the first loading.
        leg: leg within the cycle.
        stuck: (N,) nodes whose slip is too small to be drawn: shown as stuck where they slip.
        flicker: what is left out of a node's timeline, see :func:`steadied`; 0 leaves out nothing.

    Returns:
        The map, from the record's events for the exact method and from its samples for others.
    """
    if record.method == "events":
        timelines = _from_events(record, cycle, leg)
    else:
        timelines = _from_samples(record, cycle, leg)
    if stuck is not None:
        timelines = [_still(t) if i else t for t, i in zip(timelines, stuck, strict=True)]
    timelines = steadied(timelines, flicker)
    pieces: list[tuple[State, Polygon]] = []
    lines: list[Array] = []
    for i in range(len(record.x) - 1):
        fill_strip(timelines[i], timelines[i + 1], record.x[i], record.x[i + 1], pieces, lines)
    return ZoneMap(record.x, timelines, pieces, np.array(lines).reshape(-1, 2, 2))


def timeline(start: int, changes: list[tuple[float, int]]) -> Timeline:
    """Make a node's timeline from its first state and its changes (s, new state), s not falling."""
    states, begins = [start], [0.0]
    for s, new in [*changes, (1.0, -1)]:
        if s - begins[-1] <= SHORTEST:
            # the state before did not last
            states.pop()
            begins.pop()
        if new < 0:
            break
        if states and states[-1] == new:
            continue
        states.append(new)
        begins.append(s if len(states) > 1 else 0.0)
    return Timeline(np.array(states, dtype=np.int8), np.array([*begins, 1.0]))


def _still(line: Timeline) -> Timeline:
    """The timeline with stick in the place of slip."""
    slips = np.isin(line.state, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
    state = np.where(slips, State.STICK, line.state)
    changes = list(zip(line.s[1:-1].tolist(), state[1:].tolist(), strict=True))
    return timeline(int(state[0]), changes)


def steadied(timelines: list[Timeline], longest: float) -> list[Timeline]:
    """Leave out what single nodes do between stick and slip for no longer than a part of the leg.

    Args:
        timelines: of all nodes, in their order.
        longest: an excursion is left out when it lasts no longer, begins and ends in the same
            state, and neither neighbour changes its state meanwhile.

    Returns:
        The timelines, most of them as they were.
    """
    found = list(timelines)
    for i, line in enumerate(timelines):
        beside = [timelines[j] for j in (i - 1, i + 1) if 0 <= j < len(timelines)]
        changes = list(zip(line.s[1:-1].tolist(), line.state[1:].tolist(), strict=True))
        k = 0
        while k + 1 < len(changes):
            before = int(line.state[0]) if k == 0 else changes[k - 1][1]
            (begin, state), (end, after) = changes[k : k + 2]
            quiet = not any(np.any((t.s[1:-1] >= begin) & (t.s[1:-1] <= end)) for t in beside)
            friction = {before, state} <= set(STUCK_OR_SLIPPING)
            if before == after and friction and quiet and end - begin <= longest:
                del changes[k : k + 2]
            else:
                k += 1
        if len(changes) + 1 < len(line.state):
            found[i] = timeline(int(line.state[0]), changes)
    return found


def _from_events(record: Record, cycle: int, leg: int) -> list[Timeline]:
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
    """Let each zone's end move steadily from where one sample has it to where the next does."""
    table = record.samples
    rows = np.flatnonzero((table.cycle == cycle) & (table.leg == leg))
    rows = rows[np.argsort(table.s[rows], kind="stable")]
    if np.any(table.P[rows] > 0.0) and not np.any(table.P[rows[-1]] > 0.0):
        # without any force all states hold at once: the zones are those of the limit
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
    """Neighbouring nodes that all make the same change."""
    key = np.where(old == new, 0, 10 * old.astype(int) + new)
    groups = np.split(np.arange(len(key)), np.flatnonzero(np.diff(key)) + 1)
    return [g for g in groups if key[g[0]]]


def _order(run: NDArray[np.intp], old: NDArray[np.int8], new: NDArray[np.int8]) -> Array:
    """When, in [0, 1], each node of a run changes: the zone it joins, or leaves, moves over it."""
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


def fill_strip(
    a: Timeline,
    b: Timeline,
    x0: float,
    x1: float,
    pieces: list[tuple[State, Polygon]],
    lines: list[Array],
) -> None:
    """Fill the strip between two neighbouring nodes.

    Args:
        a: timeline of the left one.
        b: timeline of the right one.
        x0: position of the left one.
        x1: position of the right one.
        pieces: zones are added to it.
        lines: boundaries of zones are added to it.
    """
    matched = [(0, 0), *_matches(a, b), (len(a.state), len(b.state))]
    for n, ((i0, j0), (i1, j1)) in enumerate(pairwise(matched)):
        if n:
            lines.append(np.array([[x0, a.s[i0]], [x1, b.s[j0]]]))
        part_a = Timeline(a.state[i0:i1], a.s[i0 : i1 + 1])
        part_b = Timeline(b.state[j0:j1], b.s[j0 : j1 + 1])
        _block(part_a, part_b, x0, x1, pieces, lines)


def _matches(a: Timeline, b: Timeline) -> list[tuple[int, int]]:
    """Pair the changes of state that two neighbours both make, in their order.

    The k-th change of a timeline is that to its k-th state. As many are paired as can be; among
    equal numbers, the pairs nearest to each other in s.
    """
    na, nb = len(a.state), len(b.state)
    best = np.zeros((na + 1, nb + 1))
    for i in range(na - 1, 0, -1):
        for j in range(nb - 1, 0, -1):
            best[i, j] = max(best[i + 1, j], best[i, j + 1], _gain(a, b, i, j) + best[i + 1, j + 1])
    found, i, j = [], 1, 1
    while i < na and j < nb:
        gain = _gain(a, b, i, j)
        if gain > 0.0 and best[i, j] == gain + best[i + 1, j + 1]:
            found.append((i, j))
            i, j = i + 1, j + 1
        elif best[i, j] == best[i + 1, j]:
            i += 1
        else:
            j += 1
    return found


def _gain(a: Timeline, b: Timeline, i: int, j: int) -> float:
    same = a.state[i - 1] == b.state[j - 1] and a.state[i] == b.state[j]
    return 2.0 - abs(a.s[i] - b.s[j]) if same else -1.0


def _block(
    a: Timeline,
    b: Timeline,
    x0: float,
    x1: float,
    pieces: list[tuple[State, Polygon]],
    lines: list[Array],
) -> None:
    """Fill the part of a strip between two paired changes, in which no change is paired."""
    middle = 0.5 * (x0 + x1)
    whole = np.array([[x0, a.s[0]], [x1, b.s[0]], [x1, b.s[-1]], [x0, a.s[-1]]])
    for here, other, x in ((a, b, x0), (b, a, x1)):
        if len(other.state) == 1 and other.state[0] in here.state:
            pieces.append((State(other.state[0]), whole))
            _islands(here, other, x, middle, pieces, lines)
            return
    # the two sides meet midway, at instants that lie between the sides' own
    ends = 0.5 * (a.s[[0, -1]] + b.s[[0, -1]])
    inner = [ends[0] + (t.s - t.s[0]) / (t.s[-1] - t.s[0]) * (ends[1] - ends[0]) for t in (a, b)]
    for t, m, x in ((a, inner[0], x0), (b, inner[1], x1)):
        for k, state in enumerate(t.state):
            corners = [[x, t.s[k]], [middle, m[k]], [middle, m[k + 1]], [x, t.s[k + 1]]]
            pieces.append((State(state), np.array(corners)))
            if k:
                lines.append(np.array([[x, t.s[k]], [middle, m[k]]]))
    cuts = np.unique(np.concatenate(inner))
    for low, high in pairwise(cuts):
        half = 0.5 * (low + high)
        states = [t.state[np.searchsorted(m, half) - 1] for t, m in zip((a, b), inner, strict=True)]
        if states[0] != states[1]:
            lines.append(np.array([[middle, low], [middle, high]]))


def _islands(
    here: Timeline,
    other: Timeline,
    x: float,
    middle: float,
    pieces: list[tuple[State, Polygon]],
    lines: list[Array],
) -> None:
    """Let what only one side does taper to a point midway, or to a block's begin or end there."""
    ends = 0.5 * (here.s[[0, -1]] + other.s[[0, -1]])
    scale = (ends[1] - ends[0]) / (here.s[-1] - here.s[0])
    odd = here.state != other.state[0]
    for group in np.split(np.arange(len(odd)), np.flatnonzero(np.diff(odd)) + 1):
        if not odd[group[0]]:
            continue
        s = here.s[group[0] : group[-1] + 2]
        tip = [middle, ends[0] + scale * (0.5 * (s[0] + s[-1]) - here.s[0])]
        changes = s
        if group[0] == 0:
            tip[1], changes = ends[0], s[1:]
        elif group[-1] == len(odd) - 1:
            tip[1], changes = ends[1], s[:-1]
        for k, state in enumerate(here.state[group]):
            pieces.append((State(state), np.array([[x, s[k]], tip, [x, s[k + 1]]])))
        lines.extend(np.array([[x, when], tip]) for when in changes)
