"""Wear of two half-planes that slide grossly: known profiles, carried along by the stroke."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.studies.wear.steps import SLIPS, NodePairs, Row, pressures

POSITIONS_PER_HALF_WIDTH = 10
"""Positions along the stroke on half the width of the contact."""


class Convected(NodePairs):
    r"""Wear under a given stroke s of the first body, in gross slip without coupling.

    With the depths $h_1$, $h_2$ of the bodies the gap of the node at x is
    $g_0(x) + h_1(x) + h_2(x + s)$, and each position s a normal contact problem with the same
    stiffness, as half-planes look the same everywhere. The rates

    $$\dot h_1 = \alpha c f \int p\, |ds| ,\qquad \dot h_2 = (1-\alpha) c f \int p(x - s)\, |ds|$$

    are integrated by linearly implicit Euler steps: $(1 - \Delta N\, J) \Delta h = \Delta N \dot h$
    with $J = \partial \dot h / \partial h$ from the closed nodes of all positions. The profile
    $g_0$ is that of the first body; the second one is flat.

    Attributes:
        positions: (load factors, s, sliding distance a cycle) along the stroke.
    """

    carried = True

    def __init__(self, pairs: NodePairs, share: float, slip: Array, half_width: float) -> None:
        """Place the positions along the loop of load factors.

        Args:
            pairs: the contact.
            share: part of the wear that the first body takes.
            slip: mean slips at the corners of the loop.
            half_width: half the width of the contact.
        """
        self.whole, self.problem = pairs.whole, pairs.problem
        self.rate, self.share = pairs.rate, share
        self.system = system = pairs.problem.system
        self._known: tuple[bytes, Any] = (b"", None)
        loop, found = pairs.problem.history.loop, dict[tuple[bytes, int], list[Any]]()
        for k, (a, b) in enumerate(pairwise(slip)):
            count = int(np.ceil(POSITIONS_PER_HALF_WIDTH * abs(b - a) / half_width))
            for part in (np.arange(count) + 0.5) / max(count, 1):
                normal = (1.0 - part) * loop[k] + part * loop[k + 1]
                s = (1.0 - part) * a + part * b
                pressed = normal @ system.r_star[:, system.n :]
                pressed = np.round(pressed / (np.abs(pressed).max() or 1.0), 9)
                # there and back alike
                key = pressed.tobytes(), round(s / half_width * 1e9)
                found.setdefault(key, [normal, s, 0.0])[2] += abs(b - a) / count
        self.positions = [(normal, s, way) for normal, s, way in found.values()]

    def increments(self, row: Row, cycles: float) -> Array:
        """Return the depths (2N,) worn off each body by one linearly implicit step."""
        rate, jacobian, _ = self._linearised(row)
        matrix = np.eye(len(rate)) + cycles * jacobian
        return np.asarray(np.linalg.solve(matrix, cycles * rate))

    def settled(self, row: Row, worn: Array) -> Row:
        """Return the row with more worn off."""
        found = row.copy()
        found["worn"] += worn.reshape(2, -1)
        found["depth"] += self.depth(worn)
        _, _, values = self._linearised(found)
        P, ways = np.array([p for p, _ in values]), np.array([way for *_, way in self.positions])
        friction = self.system.friction.mean
        found["energy"], found["path"] = friction * (ways @ P), ways.sum()
        found["P"] = P[int(np.argmin([abs(s) for _, s, _ in self.positions]))]
        slips = found["energy"] > SLIPS * found["energy"].max()
        found["zone"] = np.where(slips, State.FORWARD_SLIP, State.SEPARATION)
        return found

    def depth(self, worn: Array) -> Array:
        """Return the depth (N,) of both bodies, opposite each other at no slip."""
        return np.asarray(worn.reshape(2, -1).sum(axis=0))

    def _linearised(self, row: Row) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Return rates (2N,), minus their derivatives, and pressures with theirs by position."""
        key = row["worn"].tobytes()
        if self._known[0] == key:
            return self._known[1]
        system, n = self.system, self.system.n
        K, shares = system.K[n:, n:], (self.share, 1.0 - self.share)
        rate, jacobian, values = np.zeros(2 * n), np.zeros((2 * n, 2 * n)), []
        closed = row["P"] > 0.0
        for load, s, way in self.positions:
            carried = self._carried(s)
            gap = system.g0 + row["worn"][0] + carried @ row["worn"][1]
            P = pressures(
                K, load @ system.r_star[:, n:], gap, np.zeros(n), closed, np.zeros(n, dtype=bool)
            )
            closed = P > 0.0
            stiff = np.zeros((n, n))
            on, off = np.flatnonzero(closed), np.flatnonzero(~closed)
            to_open = np.linalg.solve(K[np.ix_(off, off)], K[np.ix_(off, on)])
            stiff[np.ix_(on, on)] = K[np.ix_(on, on)] - K[np.ix_(on, off)] @ to_open
            # what wears off, and by its transpose where the gap grows
            factor = way * system.friction.mean[:, None]
            grows = np.vstack(
                [shares[0] * np.diag(self.rate), shares[1] * self.rate[:, None] * carried.T]
            )
            opens = np.hstack([np.eye(n), carried])
            rate += grows @ (factor[:, 0] * P)
            jacobian += (grows * factor[:, 0]) @ (stiff @ opens)
            values.append((P, stiff))
        self._known = key, (rate, jacobian, values)
        return rate, jacobian, values

    def _carried(self, s: float) -> Array:
        """Return the (N, N) interpolation of values on the second body at the nodes moved by s."""
        x, n = self.system.x, self.system.n
        at = np.clip(x + s, x[0], x[-1])
        low = np.clip(np.searchsorted(x, at, side="right") - 1, 0, n - 2)
        part = (at - x[low]) / (x[low + 1] - x[low])
        rows = np.zeros((n, n))
        rows[np.arange(n), low], rows[np.arange(n), low + 1] = 1.0 - part, part
        return rows
