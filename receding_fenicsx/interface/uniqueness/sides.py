"""Which nodes slip forward, slip backward and are open: three integers that hash and compare fast.

A set of nodes is an integer with bit i for node i, so that unions, differences and the question
whether one set contains another are single operations, for thousands of sets of states on a leg.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK

Change = tuple[int, int, int]
"""Node, old state, new state."""

States = NDArray[np.int8]

_SIDES = np.array([[FORWARD], [BACKWARD], [SEPARATION]], dtype=np.int8)


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
    """Disjoint sets of nodes; all others stick.

    Attributes:
        forward: nodes in forward slip.
        backward: nodes in backward slip.
        open: separated nodes.
        touching: nodes with neither gap nor pressure, which may take any state.
    """

    forward: int = 0
    backward: int = 0
    open: int = 0
    touching: int = 0

    @classmethod
    def of(cls, state: States) -> Sides:
        """Return the sides of (N,) states."""
        packed = np.packbits(state == _SIDES, axis=1, bitorder="little")
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

    def after(self, changes: Iterable[Change]) -> Sides:
        """Return the sides after several changes of state, of which the last of a node counts."""
        changed = [0] * (1 + max(STICK, FORWARD, BACKWARD, SEPARATION))
        for i, new in {i: new for i, _, new in changes}.items():
            changed[new] |= 1 << i
        others = ~sum(changed)
        return Sides(
            self.forward & others | changed[FORWARD],
            self.backward & others | changed[BACKWARD],
            self.open & others | changed[SEPARATION],
        )
