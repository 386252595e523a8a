"""Sets of states, and the instants of a leg at which the states are decided anew.

A set of nodes is an integer with bit i for node i, so that unions, differences and the question
whether one set contains another are single operations, for thousands of sets of states on a leg.

The states at the start of a leg, its events, and the ties of its path tell all: nodes that are on a
limit at an instant, whether they change their state there or not. The solvers are not involved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Ints
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.system import Changes
from receding_fenicsx.interface.tolerances import SIMULTANEOUS

States = NDArray[np.int8]


def bits_of(chosen: NDArray[np.bool_]) -> int:
    """Return the integer of a set of nodes, given as a mask."""
    return int.from_bytes(np.packbits(chosen, bitorder="little").tobytes(), "little")


def mask_of(bits: int, n: int) -> NDArray[np.bool_]:
    """Return the mask of a set among n nodes."""
    packed = np.frombuffer(bits.to_bytes((n + 7) // 8, "little"), dtype=np.uint8)
    return np.unpackbits(packed, count=n, bitorder="little").view(np.bool_)


def nodes_of(bits: int) -> list[int]:
    """Return the nodes of a set."""
    nodes = list[int]()
    while bits:
        nodes.append((bits & -bits).bit_length() - 1)
        bits &= bits - 1
    return nodes


class Sides(NamedTuple):
    """Disjoint sets of nodes; all others stick."""

    forward: int = 0  # nodes in forward slip
    backward: int = 0  # nodes in backward slip
    open: int = 0  # separated nodes
    touching: int = 0  # nodes with neither gap nor pressure, which may take any state

    @classmethod
    def of(cls, state: States) -> Sides:
        """Return the sides of (N,) states."""
        every = np.array([[FORWARD], [BACKWARD], [SEPARATION]], dtype=np.int8)
        packed = np.packbits(state == every, axis=1, bitorder="little")
        return cls(*(int.from_bytes(row.tobytes(), "little") for row in packed))

    def states(self, n: int) -> States:
        """Return the (N,) states; touching nodes stick."""
        state = np.full(n, STICK, dtype=np.int8)
        for bits, side in zip(self[:3], (FORWARD, BACKWARD, SEPARATION), strict=True):
            state[mask_of(bits, n)] = side
        return state

    def of_nodes(self, nodes: int) -> Sides:
        """Return the sides with slip of these nodes only."""
        return self._replace(forward=self.forward & nodes, backward=self.backward & nodes)

    def put(self, nodes: int, side: int) -> Sides:
        """Return the sides after nodes have taken a state; 0 for touching ones."""
        others = ~nodes
        return Sides(
            self.forward & others | (nodes if side == FORWARD else 0),
            self.backward & others | (nodes if side == BACKWARD else 0),
            self.open & others | (nodes if side == SEPARATION else 0),
            self.touching & others | (nodes if side == 0 else 0),
        )

    @property
    def touches_few(self) -> bool:
        """Whether some nodes touch, so few that all their sides are judged one by one."""
        return 0 < self.touching.bit_count() <= 6

    def explicit(self, rubbing: int) -> Iterator[Sides]:
        """Yield the sets of states with each touching node on each of its sides.

        These are open, forward and backward slip of the ``rubbing`` nodes; closed and open of the
        others.
        """
        nodes = nodes_of(self.touching)
        sides = [
            (SEPARATION, FORWARD, BACKWARD) if rubbing >> i & 1 else (STICK, SEPARATION)
            for i in nodes
        ]
        for chosen in product(*sides):
            one = self
            for i, side in zip(nodes, chosen, strict=True):
                one = one.put(1 << i, side)
            yield one


Change = tuple[int, int, int, bool]
"""Node, old and new state, and whether it is a tie."""

_BEGINS_OR_ENDS = {
    (*states, False) for slip in (FORWARD, BACKWARD) for states in ((STICK, slip), (slip, STICK))
}


class Instants(NamedTuple):
    """Instants of a leg: its start, and where states change."""

    start: States  # (N,) states at the start
    every: Changes  # ties, changes that nodes on limits may make, then events
    ties: int  # number of ties
    order: Ints  # (k,) all of them in order
    apart: NDArray[np.bool_]  # (k,) which begin another instant than the one before

    @classmethod
    def of(cls, start: States, events: Changes, ties: Changes) -> Instants:
        """Group the events and ties of a leg by instants; the first one is its start."""
        every = Changes.joined(ties, events)
        order = every.s.argsort(kind="stable")
        places = np.concatenate([[0.0], every.s[order]])
        apart = places[1:] - places[:-1] > SIMULTANEOUS
        return cls(start, every, len(ties), order, apart)

    @property
    def key(self) -> tuple[int | bytes, ...]:
        """What tells one leg from another, wherever on it its instants are."""
        every = self.every
        parts = self.start, every.node, every.old, every.new, self.order, self.apart
        return self.ties, *(part.tobytes() for part in parts)

    def sides(self, finite: Callable[[float], bool] | None = None) -> Iterator[tuple[float, Sides]]:
        """Yield the place s of each instant, and the sides with all slip that may be.

        A node that was slipping, or that begins to, may slip or stick; so may a stuck one on a
        limit. One that comes into contact or leaves it, or whose slip turns round at once, may do
        anything. Where states change by a load step or a jump, as ``finite`` says of a place, only
        the states after it are judged.
        """
        every, number = self.every.select(self.order), np.cumsum(self.apart)
        first = number.searchsorted(np.arange(number.max(initial=0) + 2)).tolist()
        columns = every.node, every.old, every.new, self.order < self.ties
        rows = list(zip(*(column.tolist() for column in columns), strict=True))
        now = Sides.of(self.start)
        for k in range(len(first) - 1):
            s = float(every.s[first[k]]) if k else 0.0
            before, group = now, rows[first[k] : first[k + 1]]
            for i, _, new, tie in group:
                now = now if tie else now.put(1 << i, new)
            if finite is not None and finite(s):
                yield s, _loosest(now, [one for one in group if one[3]])
            elif len(group) == 1 and group[0][1:] in _BEGINS_OR_ENDS:
                # mostly one node begins or ends to slip: it may slip or stick
                yield s, before if group[0][2] == STICK else now
            else:
                yield s, _loosest(before, group)


def _loosest(before: Sides, changes: Iterable[Change]) -> Sides:
    """Return the states in which all slip that may at simultaneous changes, and who touch."""
    sides, slipped = before, dict[int, int]()
    for i, old, new, _ in changes:
        if max(old, new) == STICK:
            continue
        turned = slipped.setdefault(i, max(old, new)) != max(old, new)
        if SEPARATION in (old, new) or STICK not in (old, new) or turned:
            slipped[i] = 0
            sides = sides.put(1 << i, 0)
        elif slipped[i] and new != STICK:
            sides = sides.put(1 << i, new)
    return sides
