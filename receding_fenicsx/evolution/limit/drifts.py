"""How nodes drift to a limit, cycle by cycle, and whether some pass it: slip does not go back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, islice

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen import Frozen, NoLimit
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle, MovedCycle
from receding_fenicsx.evolution.limit.newton import (
    MarginRows,
    Solution,
    margin_rows,
)
from receding_fenicsx.interface.lcp import lemke
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import ContactState

OVERSHOT = 1e-10
"""Force by which a margin may be passed, over the largest nodal force, that is none."""

MAX_DRIFTING = 20_000
"""Cycles of drifts, to first order, after which a limit counts as passed: it is not shown."""

SAME_SHAPE = 0.01
"""Force, over ``OVERSHOT``, by which drifts of one shape may change but for their size."""

LOOKED_AT = 4
"""Cycles of drifts after which they are looked at."""

CLEAR = 0.02
""":func:`clearance` below which a node may pass its limit: the first order is not exact."""

DOUBT = 2.0
"""Factor by which what is foreseen after two or three cycles may be wrong."""

SURPRISE = 2.0
"""Error of the cycle before, over what a node still lacks, from which it may pass its limit."""

PARTS_OF_DOUBT = (1.0, 0.75, 0.5, 0.25)
"""Parts of the doubt, as exponents, of which the largest that agrees with what is seen is taken."""

WAVES = (1.0, 2.0)
"""Half waves along the contact of the errors of what nodes lack."""

SOON = 32
"""Cycles in which they are followed then: where nodes do pass their limits, they do so early."""

FORGOTTEN = 1e-7
"""Change of the margins from one cycle to the next, over the largest, that is none."""

MAX_MEMORY = 50
"""Cycles in which a slip must be forgotten."""

MAX_GUESSES = 50
"""Guesses which nodes slip in a cycle."""


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
        others: further frozen nodes that might slip while these drift.
    """

    limit: Array
    begun: Array
    margins: Array
    responses: Array
    towards: Ints
    stiffness: Array
    others: Ints

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


def drifts_of(
    frozen: Frozen, solution: Solution, *states: ContactState
) -> tuple[Drifts, ...] | None:
    """Return the drifts from states at the ends of cycles to a limit; None where none drifts."""
    nodes, cycle, x = frozen.shifted, solution.cycle, solution.shifts
    m = solution.margins.of(np.searchsorted(frozen.nodes, nodes))
    k = len(nodes)
    if not k:
        return None
    signs = np.repeat([1.0, -1.0], k)
    rows = margin_rows(frozen, cycle, np.tile(nodes, 2), signs, np.append(m.at_A, m.at_B))
    moved = frozen.periodic_change(cycle)
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
        "others": _at_risk(frozen, solution, moved),
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


def _at_risk(frozen: Frozen, solution: Solution, moved: MovedCycle) -> Ints:
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


def cycles_to_come(drifts: Drifts) -> Iterator[tuple[Array, Array]]:
    """Yield the drifts (2k,) after each cycle to come, and the margins (2k,) that they leave.

    In each cycle the drifts grow by slips s >= 0 that end where no margin is negative:

        m + R_0 s >= 0,  s . (m + R_0 s) = 0,   m = m_0 + sum over slips s' before of R_l s' ,

    m_0 being the margins without slips and R_l the response l cycles after a slip.

    Raises:
        NoLimit: the slips of a cycle were not found.
    """
    margins, M = drifts.margins, drifts.responses[-1]
    slips, memory = Slips(drifts.responses[0]), (drifts.responses[1:-1] - M).transpose(1, 0, 2)
    past, slipping = np.zeros(memory.shape[1:]), np.zeros(len(M), dtype=bool)
    remembered = memory[:, :, slipping].reshape(len(M), -1)
    y, left = drifts.begun.copy(), margins[-1].copy()
    for cycle in count():
        lasting = margins[min(cycle, len(margins) - 1)] - margins[-1]
        s = slips.of(left + lasting + remembered @ past[:, slipping].ravel())
        if np.any(s[~slipping]):
            slipping = slipping | (s > 0.0)
            remembered = memory[:, :, slipping].reshape(len(M), -1)
        y += s
        left += M @ s
        past = np.vstack([s, past])[: len(past)]
        yield y, left


def is_robust(drifts: Drifts, force: float, doubt: float = DOUBT) -> bool:
    """Return whether no node passes the limit soon though drifts are foreseen wrongly.

    The first order is not exact while the drifts are large. So what the nodes lack is taken larger
    at one end of the contact and smaller at the other, by the factor ``doubt``, and the reverse; by
    less where nodes would slip at once that are known to rest.
    """
    rest, none = drifts.limit <= 0.0, -OVERSHOT * force
    seen = np.minimum(drifts.margins[0], 0.0)[rest] + none
    wave = np.cos(np.pi * _places(drifts))
    for exponents in (wave, -wave):
        for part in PARTS_OF_DOUBT:
            wrong = drifts.lacking(doubt ** (part * exponents))
            if np.all(wrong.margins[0][rest] >= seen):
                break
        if clearance(wrong, force, least=0.0, cycles=SOON) < 0.0:
            return False
    return True


def clearance(
    drifts: Drifts,
    force: float,
    part: float = 0.0,
    least: float = CLEAR,
    cycles: int = MAX_DRIFTING,
) -> float:
    """Return how clear of passing the limit the nodes stay on the way to it; -1 where one does.

    Slip does not go back: where a node passes its limit while others still drift, their slips may
    leave it a margin. The distance from that after a cycle is given over what its margin changes
    if others lack more or less of their limits at the cycle's start, in waves along the contact:
    the smallest one, or the first below ``least``. -1 also for drifts of more than ``MAX_DRIFTING``
    cycles.

    Args:
        drifts: drifts to the limit.
        force: largest nodal force of the history.
        part: part of the largest drift by which nodes may pass it; then all else is clear.
        least: clearance that is enough.
        cycles: cycles that are followed.

    Raises:
        NoLimit: the slips of a cycle were not found.
    """
    if np.any(np.diagonal(drifts.M) <= 0.0):
        return -1.0
    limit, margins, M = drifts.limit, drifts.margins, drifts.responses[-1]
    stiffness, clear = np.abs(np.diagonal(M)), 1.0
    allowed = OVERSHOT * force + part * limit.max() * stiffness
    waves = np.cos(np.pi * np.outer(_places(drifts), WAVES))
    before, shape = _left(limit, drifts.begun), np.zeros_like(limit)
    for cycle, (y, m) in enumerate(islice(cycles_to_come(drifts), cycles)):
        left = _left(limit, y)
        if cycle % LOOKED_AT == 0:
            lack = np.maximum(before, 0.0)[:, None]
            unsure = np.abs(M @ (waves * lack) - waves * (M @ lack)).max(axis=1)
            unsure += np.abs(margins[min(cycle, len(margins) - 1)] - margins[-1])
            passed = stiffness * left + allowed
            distance = passed + np.maximum(m, 0.0)
            if np.any(passed < 0.0):
                return -1.0
            if not part:
                clear = min(clear, float((distance / np.maximum(unsure, allowed)).min()))
            largest = float((stiffness * left).max())
            last, shape = shape, stiffness * left / max(largest, OVERSHOT * force)
            # drifts of one shape that only become smaller stay as clear as they are
            settled = largest * np.abs(shape - last).max() <= SAME_SHAPE * OVERSHOT * force
            if clear < least or settled or np.all(unsure <= allowed):
                return clear
        before = left
    return clear if cycles < MAX_DRIFTING else -1.0


def _places(drifts: Drifts) -> Array:
    """Return (2k,) places of the drifts along the contact, from 0 to 1."""
    return np.tile(np.linspace(0.0, 1.0, len(drifts.stiffness)), 2)


def _left(limit: Array, y: Array) -> Array:
    """Return what the drifts y (2k,) lack of the limit.

    A node that drifts to it may slip back on the way; one that does not drift must not slip at all.
    """
    drifts, back = limit > 0.0, np.roll(limit, len(limit) // 2) > 0.0
    left: Array = limit - y + np.where(drifts, np.roll(y, len(y) // 2), 0.0)
    left[back] = 0.0
    return left


def errors_of(before: Drifts, now: Drifts) -> tuple[Array, Array]:
    """Return how far drifts (k,) were foreseen wrongly a cycle before, and what they still lack."""
    foreseen, _ = next(cycles_to_come(before))
    k = len(now.stiffness)
    then, made, limit = (y[:k] - y[k:] for y in (foreseen, now.begun, now.limit))
    return np.abs(made - then), np.abs(limit - made)


def error_of(before: Drifts, now: Drifts) -> float:
    """Return how far drifts were foreseen wrongly a cycle before, over what they still lack."""
    error, lacking = (float(of.max()) for of in errors_of(before, now))
    return error / lacking if lacking > 0.0 else 0.0


def is_as_foreseen(before: Drifts, now: Drifts, force: float) -> bool:
    """Return whether no node has slipped otherwise than foreseen by far more than it lacks now."""
    error, lacking = errors_of(before, now)
    return bool(np.all(now.stiffness * (error - SURPRISE * lacking) <= OVERSHOT * force))


class Slips:
    """Slips of a cycle: s >= 0 and m + R s >= 0 with s . (m + R s) = 0."""

    def __init__(self, R: Array) -> None:
        """Take the response of the margins to slips in the same cycle."""
        self.R = R
        self.active: NDArray[np.bool_] = np.zeros(len(R), dtype=bool)
        self._choose(self.active)

    def _choose(self, active: NDArray[np.bool_]) -> None:
        """Factor the response of the nodes that slip."""
        self.active, self._chosen = active, np.flatnonzero(active)
        self._columns = self.R[:, self._chosen]
        if len(self._chosen):
            self._factor = dgetrf(self._columns[self._chosen])

    def of(self, m: Array) -> Array:
        """Return the slips (k,) for the margins m without them.

        Raises:
            NoLimit: none were found.
        """
        for _ in range(MAX_GUESSES):
            s, left = np.zeros_like(m), m
            if len(self._chosen):
                lu, pivots, singular = self._factor
                if singular:
                    break
                slips = -dgetrs(lu, pivots, m[self._chosen])[0]
                s[self._chosen] = slips
                left = m + self._columns @ slips
            wanted = np.where(self.active, s > 0.0, left < 0.0)
            if np.array_equal(wanted, self.active):
                return s
            self._choose(wanted)
        found = lemke.solve(self.R, m, [np.ones(len(m))])
        if found is None:
            raise NoLimit("which nodes slip on the way to the limit is not decided")
        return found
