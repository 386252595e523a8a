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


class _Change(NamedTuple):
    node: int
    old: int
    new: int
    is_tie: bool


def instants(
    start: States, events: Changes, ties: Changes, finite: Callable[[float], bool] | None = None
) -> Iterator[tuple[float, Sides]]:
    """Yield the instants of a leg: its start and where states change.

    Each is its place s, and the sides on which every node that may slip does so. A node that was
    slipping, or that begins to, may slip or stick; so may a stuck one on a limit. One that comes
    into contact or leaves it, or whose slip turns round at once, may do anything. Ties are changes
    to other states that nodes on limits may take. Where states change by a load step or a jump, as
    ``finite`` says of a place, only the states after it are judged.
    """
    every = [(*row, is_tie) for rows, is_tie in ((ties, True), (events, False)) for row in rows]
    groups, last = [(0.0, list[_Change]())], 0.0
    for s, i, old, new, is_tie in sorted(every, key=lambda row: row[0]):
        if s - last > SIMULTANEOUS:
            groups.append((s, []))
        groups[-1][1].append(_Change(i, old, new, is_tie))
        last = s
    now = Sides.of(start)
    for s, group in groups:
        before = now
        for one in group:
            now = now if one.is_tie else now.put(1 << one.node, one.new)
        alone = [] if len(group) > 1 else [k for c in group if not c.is_tie for k in (c.old, c.new)]
        if finite is not None and finite(s):
            yield s, _loosest(now, [one for one in group if one.is_tie])
        elif STICK in alone and SEPARATION not in alone:
            # mostly one node begins or ends to slip: it may slip or stick
            yield s, before if alone[1] == STICK else now
        else:
            yield s, _loosest(before, group)


def _loosest(before: Sides, changes: Iterable[_Change]) -> Sides:
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
