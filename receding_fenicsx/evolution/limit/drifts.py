"""Drifts of nodes to a limit: what is made of them, what is lacking, and what a slip changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen import Frozen, NoLimit
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle, MovedCycle
from receding_fenicsx.evolution.limit.newton import (
    MarginRows,
    Solution,
    margin_rows,
)
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactState

OVERSHOT = 1e-10
"""Force by which a margin may be passed, over the largest nodal force, that is none."""

FORGOTTEN = 1e-7
"""Change of the margins from one cycle to the next, over the largest, that is none."""

MAX_MEMORY = 50
"""Cycles in which a slip must be forgotten."""


@dataclass(frozen=True)
class Drifts:
    """Drifts of k nodes to a limit, to first order: first those forward, then those backward.

    Attributes:
        limit: (2k,) drifts at the limit.
        begun: (2k,) drifts that have been made.
        margins: (L, 2k) smallest margins in the cycles to come without further drifts, A before B;
            the last ones in all later cycles.
        responses: (L, 2k, 2k) changes of the margins after a slip, in its own cycle and those to
            come; the last ones in all later cycles.
        towards: (k,) numbers of the drifts that the nodes make, or are nearer to.
        stiffness: (k,) local stiffnesses of the nodes.
        pace: part, or (2k,) parts, of the slips foreseen for a cycle that are made in it.
    """

    limit: Array
    begun: Array
    margins: Array
    responses: Array
    towards: Ints
    stiffness: Array
    pace: Array | float = 1.0

    def lacking(self, factor: Array) -> Drifts:
        """Return the same while (2k,) times as much of the limits is lacking."""
        less = (self.limit - self.begun) * (1.0 - factor)
        margins = self.margins + self.responses[-1] @ less
        return replace(self, begun=self.begun + less, margins=margins)

    @property
    def M(self) -> Array:
        """(k, k) derivatives of the margins in the drifts of cycles that repeat themselves."""
        M: Array = self.responses[-1][np.ix_(self.towards, self.towards)]
        return M


def at_risk(frozen: Frozen, solution: Solution, moved: MovedCycle) -> Ints:
    """Return frozen nodes without drift whose margins may vanish while others drift.

    While the others lack any parts of their drifts x, a margin is at least
    m* - sum over j of |dm/dx_j x_j|.
    """
    still = np.flatnonzero(~np.isin(frozen.nodes, frozen.shifted))
    rest, m = frozen.nodes[still], solution.margins.of(still)
    risk = np.zeros(len(rest), dtype=bool)
    for sign, margin, at in ((1.0, m.A, m.at_A), (-1.0, m.B, m.at_B)):
        rows = margin_rows(frozen, solution.cycle, rest, np.full(len(rest), sign), at)
        risk |= margin < np.abs(rows.moved(moved, frozen.shifted) * solution.shifts).sum(axis=1)
    return rest[risk]


def drifts_of(
    frozen: Frozen, solution: Solution, moved: MovedCycle, *states: ContactState
) -> tuple[Drifts, ...]:
    """Return the drifts from states at the ends of cycles to a limit, of at least one node.

    Args:
        frozen: the contact.
        solution: the limit.
        moved: derivatives of its cycle in the shifts.
        states: at the ends of cycles.

    Raises:
        NoLimit: the cycles remember a slip for too long.
    """
    nodes, cycle, x = frozen.shifted, solution.cycle, solution.shifts
    m = solution.margins.of(np.searchsorted(frozen.nodes, nodes))
    k = len(nodes)
    signs = np.repeat([1.0, -1.0], k)
    rows = margin_rows(frozen, cycle, np.tile(nodes, 2), signs, np.append(m.at_A, m.at_B))
    M = rows.moved(moved, nodes)
    far = np.array([now.u - cycle.start.u for now in states]).T
    begun = far[nodes].T.copy()
    far[nodes] -= x[:, None]
    margins, responses = _followed(frozen, cycle, rows, far)
    smallest = np.append(m.A, m.B)
    forward = (solution.active > 0) | ((solution.active == 0) & (m.A < m.B))
    common = {
        "limit": np.maximum(np.append(x, -x), 0.0),
        "responses": np.concatenate([responses, np.hstack([M, -M])[None]]),
        "towards": np.arange(k) + np.where(forward, 0, k),
        "stiffness": local_stiffness(frozen.system)[0][nodes],
    }
    return tuple(
        Drifts(
            begun=np.maximum(np.append(made, -made), 0.0),
            margins=smallest + np.vstack([margins[:, :, j], M @ (made - x)]),
            **common,
        )
        for j, made in enumerate(begun)
    )


def _followed(
    frozen: Frozen, cycle: FrozenCycle, rows: MarginRows, far: Array
) -> tuple[Array, Array]:
    """Return the changes of margins (L, 2k, j) without slips, and those after slips (L, 2k, 2k).

    A node slips where its margin is smallest, in the states on the way there. What it changes at
    once is followed through the rest of the cycle and the next ones, as the moved events change it.
    So are distances ``far`` (2N, j) from the limit at the start of the cycle.

    Raises:
        NoLimit: the cycles remember for too long.
    """
    system, n, events = frozen.system, frozen.system.n, cycle.events
    signs, nodes = np.repeat([1.0, -1.0], len(frozen.shifted)), np.tile(frozen.shifted, 2)
    k, of_far = len(nodes), far.shape[1]
    at_once = np.zeros((4 * n, k + of_far))
    for stop in np.unique(rows.at):
        here = np.flatnonzero(rows.at == stop)
        tableau = frozen.segments.tableau(cycle.stops[stop].state)
        at_once[:, here] = tableau.following(system.K[nodes[here]].T * signs[here])
    at_once[:, k:] = np.array([frozen.quantities(one) for one in far.T]).T
    low, m = at_once[events.label], rows.of_u @ at_once[: 2 * n]
    m[:, :k] += rows.of_u[:, nodes] * signs
    began = np.append(rows.at, np.full(of_far, -1))
    on_low = events.change[:, events.label].T
    on_m = rows.of_u @ events.change[:, : 2 * n].T
    ds = events.moved(np.where(began <= events.at[:, None], low, 0.0))
    followed = [np.where(began <= rows.at[:, None], m, 0.0) + rows.of_events @ ds]
    none = np.append(np.zeros(k), np.full(of_far, OVERSHOT * frozen.force))
    while len(followed) < MAX_MEMORY:
        low, m = low + on_low @ ds, m + on_m @ ds
        ds = events.moved(low)
        followed.append(m + rows.of_events @ ds)
        change, largest = (np.abs(of).max(axis=0) for of in (followed[-1] - followed[-2], m))
        if np.all(change <= np.maximum(FORGOTTEN * largest, none)):
            break
    else:
        raise NoLimit("the cycle with frozen nodes forgets a slip too slowly")
    every = np.array(followed)
    return every[:, :, k:], every[:, :, :k]
