"""Rates of a contact with frozen nodes, taken from those with other frozen nodes.

A frozen node that sticks has the same rates as one that sticks by itself: only its margins are
looked at, or not. Where nodes are sorted anew, most sets of states of the next cycle are those of
the cycle before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.exact.tableau import A, B
from receding_fenicsx.interface.law import STICK
from receding_fenicsx.interface.system import ContactSystem


class FrozenSegments(Segments):
    """Makes and remembers segments; takes the rates of other ones where they are known."""

    def __init__(
        self,
        system: ContactSystem,
        opening: NDArray[np.bool_] | None,
        carried: int,
        other: FrozenSegments | None,
    ) -> None:
        """Start with nothing remembered.

        Args:
            system: the condensed body in 2N form, its frozen nodes held tangentially.
            opening: (N,) nodes expected to open; None for all.
            carried: the first loads, by which legs mostly differ.
            other: segments of the same body with other frozen nodes.
        """
        super().__init__(system, opening, carried)
        self._other = other
        if other is not None:
            other._other = None  # rates of two sortings before would only take memory
            self._changed = np.flatnonzero(other.frictional != self.frictional)
            both = np.append(self._changed, system.n + self._changed)
            self._K, self._r_star = system.K[both], system.r_star[:, both]

    def _rates(self, state: States, direction: Array) -> Array:
        q = self._taken_over(state, direction)
        if q is not None and self.balances(q, direction, q * self.weight):
            return q
        return super()._rates(state, direction)

    def _taken_over(self, state: States, direction: Array) -> Array | None:
        """Return the rates that the others know, None if they do not."""
        other, carried = self._other, self._carried
        if other is None or other.is_loose or direction[carried:].any():
            return None
        way = np.zeros(len(other.system.r_star))
        way[:carried] = direction[:carried]
        known, i = other.known(state, way), self._changed
        if known is None or np.any(state[i] != STICK):
            return None
        q, n = known.q.copy(), len(state)
        r = direction @ self._r_star + self._K @ q[: 2 * n]
        Q, P = r[: len(i)], r[len(i) :]
        margins = self.friction[i].margins(Q, P)
        q[A * n + i] = np.where(self.frictional[i], margins[0], P)
        q[B * n + i] = np.where(self.frictional[i], margins[1], 0.0)
        return q
