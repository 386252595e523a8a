"""Changes of state along a leg, as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """Changes of state of single nodes, one a row, in order of place.

    Attributes:
        s: (k,) places on the leg.
        node: (k,) nodes.
        old, new: (k,) their states before and after.
    """

    s: Array
    node: NDArray[np.intp]
    old: NDArray[np.int8]
    new: NDArray[np.int8]

    @classmethod
    def none(cls) -> Changes:
        """Return no changes."""
        states = np.zeros((2, 0), dtype=np.int8)
        return cls(np.zeros(0), np.zeros(0, dtype=np.intp), *states)

    @classmethod
    def of(cls, rows: Iterable[tuple[float, int, int, int]]) -> Changes:
        """Return changes that were noted one by one: place, node, old state, new state."""
        s, node, old, new = list(zip(*rows, strict=True)) or [()] * 4
        states = (np.array(column, dtype=np.int8) for column in (old, new))
        return cls(np.array(s, dtype=float), np.array(node, dtype=np.intp), *states)

    @classmethod
    def between(cls, s: float, old: NDArray[np.int8], new: NDArray[np.int8]) -> Changes:
        """Return the changes between the states (N,) of all nodes before and after s."""
        node = (old != new).nonzero()[0]
        return cls(np.full(len(node), s), node, old[node], new[node])

    @classmethod
    def joined(cls, *parts: Changes) -> Changes:
        """Return the changes of several parts, one after the other."""
        some = [part for part in parts if len(part)]
        if len(some) < 2:
            return some[0] if some else cls.none()
        columns = zip(*((part.s, part.node, part.old, part.new) for part in some), strict=True)
        return cls(*map(np.concatenate, columns))

    def __len__(self) -> int:
        """Return the number k of changes."""
        return len(self.s)

    def __iter__(self) -> Iterator[tuple[float, int, int, int]]:
        """Yield place, node, old state and new state of one change after the other."""
        columns = self.s, self.node, self.old, self.new
        return zip(*(column.tolist() for column in columns), strict=True)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Changes:
        """Return some of the changes: a mask, numbers of rows in the order wanted, or a slice."""
        return Changes(self.s[rows], self.node[rows], self.old[rows], self.new[rows])

    def placed(self, scale: float, offset: float = 0.0) -> Changes:
        """Return the same changes at the places ``offset + scale * s``."""
        return Changes(offset + scale * self.s, self.node, self.old, self.new)
