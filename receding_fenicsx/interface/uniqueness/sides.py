"""Which nodes slip forward, slip backward and are open: three integers that hash and compare fast.

A set of nodes is an integer with bit i for node i, so that unions, differences and the question
whether one set contains another are single operations, for thousands of sets of states on a leg.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.exact.legs import Change
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK

States = NDArray[np.int8]

_SIDES = np.array([[FORWARD], [BACKWARD], [SEPARATION]], dtype=np.int8)


def bits_of(chosen: NDArray[np.bool_]) -> int:
    """Return the integer of a set of nodes, given as a mask."""
    return int.from_bytes(np.packbits(chosen, bitorder="little").tobytes(), "little")


def mask_of(bits: int, n: int) -> NDArray[np.bool_]:
    """Return the mask of a set among n nodes."""
    packed = np.frombuffer(bits.to_bytes((n + 7) // 8, "little"), dtype=np.uint8)
    return np.unpackbits(packed, count=n, bitorder="little").view(np.bool_)


class Sides(NamedTuple):
    """A set of states: disjoint sets of nodes, all others stick.

    Attributes:
        forward: nodes in forward slip.
        backward: nodes in backward slip.
        open: separated nodes.
    """

    forward: int = 0
    backward: int = 0
    open: int = 0

    @classmethod
    def of(cls, state: States) -> Sides:
        """Return the sides of (N,) states."""
        packed = np.packbits(state == _SIDES, axis=1, bitorder="little")
        return cls(*(int.from_bytes(row.tobytes(), "little") for row in packed))

    def states(self, n: int) -> States:
        """Return the (N,) states."""
        state = np.full(n, STICK, dtype=np.int8)
        for bits, side in zip(self, (FORWARD, BACKWARD, SEPARATION), strict=True):
            state[mask_of(bits, n)] = side
        return state

    def of_nodes(self, nodes: int) -> Sides:
        """Return the sides with slip of these nodes only."""
        return Sides(self.forward & nodes, self.backward & nodes, self.open)

    def put(self, nodes: int, side: int) -> Sides:
        """Return the sides after nodes have taken a state."""
        others = ~nodes
        return Sides(
            self.forward & others | (nodes if side == FORWARD else 0),
            self.backward & others | (nodes if side == BACKWARD else 0),
            self.open & others | (nodes if side == SEPARATION else 0),
        )

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
