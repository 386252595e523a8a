"""Replay of whole cycles whose legs keep their events: foreseen one by one, verified at once.

A leg on which the same nodes change state in the same order as last time is a known chain of
segments, and one more up to its end. With the lengths h of :mod:`.chain` and the rates Q of its
segments its end is

    y(1) = y(0) + h Q + (1 - sum h) q_last,

from which the next leg starts. So several cycles are foreseen by one triangular system and one
product a leg. Whether they are the path is checked for all of them together, by products of
matrices: the conditions of a replayed chain at its events, no event after its last one, nothing on
a limit that turns the other way at the start, and the residual of the whole contact, reactions
evaluated afresh, at every end. Legs are accepted up to the first one that fails.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from operator import is_
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.legs import Change, LegProblem
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.reduction import Reduction
from receding_fenicsx.interface.exact.replay.chain import Chain, leading
from receding_fenicsx.interface.exact.replay.events import floors, passed_by_round_off
from receding_fenicsx.interface.exact.round_off import negligible_imbalance
from receding_fenicsx.interface.exact.segments import (
    LIMIT_TOLERANCE,
    Following,
    Segment,
    Segments,
)
from receding_fenicsx.interface.exact.walk import END_TOLERANCE, Walk
from receding_fenicsx.interface.law import SLIP_SIGN
from receding_fenicsx.interface.residual import law_residual, local_stiffness
from receding_fenicsx.interface.system import ContactState, Leg, reactions

FEWEST, MOST = 2, 16
"""Cycles foreseen at once; twice as many after those before have all held."""

LARGE_AT_START = 0.25
"""Part of the negligible imbalance from which it is removed before cycles are foreseen."""

LONGEST_CYCLE = 64
"""Legs of a cycle at most."""

Way = tuple[bytes, bytes]
"""Load factors at the start and at the end of a leg."""


@dataclass
class KnownLeg:
    """A leg whose events came twice in the same order.

    Attributes:
        ends: load factors at its start and at its end, that of the frozen nodes included.
        start, end: (n,) states of the active nodes before it and at its end.
        turned: changes of state at its start.
        first, last: rates at its start and at its end.
        chain: its events.
        imbalance, stroke: rates along the chain's segments and the last one, as in ``Rates``.
        slipping: active nodes that slip against friction on it.
        slip, resisting: their rates, as in ``Rates``.
        changes: number in the whole contact, old and new state, of all changes in order.
    """

    ends: tuple[Array, Array]
    start: NDArray[np.int8]
    end: NDArray[np.int8]
    turned: int
    first: Segment
    last: Segment
    chain: Chain
    imbalance: Array
    stroke: Array
    slipping: NDArray[np.intp]
    slip: Array
    resisting: Array
    changes: tuple[list[int], ...]


class Played(NamedTuple):
    """Several passages of one leg, one a row.

    Attributes:
        y: (c, 4n) quantities at the start.
        h: (c, k + 1) lengths of the segments, the last one up to the end.
        at: (c, 4n) quantities at the last event.
        end: (c, 4n) quantities at the end.
    """

    y: Array
    h: Array
    at: Array
    end: Array


class Rounds:
    """Plays the legs of a periodic path on the active nodes of a reduction.

    Attributes:
        reduction: the contact without the nodes that keep their states.
    """

    def __init__(self, reduction: Reduction) -> None:
        """Start with nothing known."""
        self.reduction = reduction
        self._events: dict[Way, list[Following]] = {}
        self._known: dict[Way, KnownLeg] = {}
        self._course: deque[Way] = deque(maxlen=LONGEST_CYCLE)
        self._ready: deque[tuple[ContactState, Way, Leg]] = deque()
        self._end: ContactState | None = None
        self._count = FEWEST

    def leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg | None:
        """Return the leg from a state if it is one of a cycle that repeats its events, else None.

        Args:
            start: state at its start.
            ends: (n_loads,) load factors at its start and at its end.
            force_scale: largest nodal force of the history so far.
        """
        way = ends[0].tobytes(), ends[1].tobytes()
        if not self._ready or self._ready[0][0] is not start or self._ready[0][1] != way:
            self._ready.clear()
            if start is not self._end or way not in self._known:
                return None
            course = list(self._course)
            cycle = course[len(course) - 1 - course[::-1].index(way) :] if way in course else []
            if not cycle or not all(key in self._known for key in cycle):
                return None
            self._foresee(start, cycle, force_scale)
        if not self._ready:
            return None
        _, way, leg = self._ready.popleft()
        self._course.append(way)
        self._end = leg.end
        return leg

    def note(self, problem: LegProblem, walk: Walk, leg: Leg) -> None:
        """Note a leg that was followed from event to event.

        Args:
            problem: the leg of all nodes.
            walk: its walk on the active nodes.
            leg: what came of it, for all nodes.
        """
        way = problem.ends[0].tobytes(), problem.ends[1].tobytes()
        if problem.start is not self._end:
            self._course.clear()
        self._course.append(way)
        self._end = leg.end
        following = _events_of(walk)
        last = self._events.get(way)
        if not following:
            self._events.pop(way, None)
            self._known.pop(way, None)
            return
        self._events[way] = following
        if last is None or len(last) != len(following):
            self._known.pop(way, None)
            return
        if not all(map(is_, last, following)):
            self._known.pop(way, None)
        elif way not in self._known:
            self._known[way] = _known_leg(walk, following, leg)

    def _foresee(self, start: ContactState, cycle: list[Way], force_scale: float) -> None:
        """Foresee several cycles; make the legs ready that hold."""
        known, segments = [self._known[way] for way in cycle], self.reduction.segments
        small = self.reduction.shrink(start)
        if not (self.reduction.fits(start) and np.array_equal(small.state, known[0].start)):
            return
        y = _balanced(segments, small, known[0].ends[0], force_scale)
        rows = _play(segments, self._count * known, y, force_scale)
        legs = [
            self._verified(one, Played(*map(np.array, zip(*mine, strict=True))), force_scale)
            for k, one in enumerate(known)
            if (mine := rows[k :: len(known)])
        ]
        for i in range(len(rows)):
            c, k = divmod(i, len(known))
            if c >= len(legs[k]):
                break
            leg = legs[k][c]
            leg.force_scale = force_scale = max(force_scale, leg.force_scale)
            self._ready.append((start, cycle[k], leg))
            start = leg.end
        held = len(self._ready) // len(known)
        self._count = min(2 * self._count, MOST) if held == self._count else max(held, FEWEST)

    def _verified(self, one: KnownLeg, played: Played, force_scale: float) -> list[Leg]:
        """Verify passages of one leg; return the first ones as legs, up to one that fails."""
        reduction, system = self.reduction, self.reduction.full
        (a, b), segments = one.ends, reduction.segments
        holds = _keeps_law(reduction, one, played, force_scale)
        # the ends, with all nodes and reactions evaluated afresh
        u = np.hstack([_displacements(segments.system.g0, played.end), np.tile(b, (len(holds), 1))])
        u = u @ reduction.back.T
        r = u @ system.K + b[:-1] @ system.r_star
        state = reduction.frozen.copy()
        state[reduction.nodes] = one.end
        error = law_residual(system, r, u, np.zeros(system.n), local_stiffness(system)).max(axis=1)
        slips = np.flatnonzero(SLIP_SIGN[state])
        Q, P = r[:, slips], r[:, system.n + slips]
        off_limit = np.abs(Q + system.friction[slips].at_slip(state[slips]) * P)
        error = np.maximum(error, off_limit.max(axis=1, initial=0.0)) / force_scale
        holds &= error <= EVENT_RESIDUAL
        swing = 0.5 * float((a + b)[:-1] @ reduction.swing @ (b - a)[:-1])
        legs = []
        for c in range(leading(holds)):
            h, dissipation = played.h[c], np.zeros(system.n)
            places = h.cumsum()
            slipped = _dissipation(one, h, played.y[c], segments.shares)
            dissipation[reduction.nodes[one.slipping]] = slipped
            middle = a + (places - 0.5 * h)[:, None] * (b - a)
            work = (h @ (one.stroke * middle))[:-1].sum() + swing
            at = [0.0] * one.turned + places[one.chain.event_of].tolist()
            legs.append(
                Leg(
                    end=ContactState(u[c], r[c], state.copy()),
                    dissipation=dissipation,
                    work=float(work),
                    residual=float(error[c]),
                    force_scale=max(force_scale, float(np.abs(r[c]).max())),
                    events=list(zip(at, *one.changes, strict=True)),
                )
            )
        return legs


def _events_of(walk: Walk) -> list[Following]:
    """Return what came of the events of a walk; nothing where it is no chain of known segments."""
    segment, begun = walk.first
    made = [event[1:] for event in walk.course.events[begun:]]
    following, changes = list[Following](), list[Change]()
    while len(changes) < len(made) and segment.last is not None:
        following.append(segment.last)
        changes += segment.last.changes
        segment = segment.last.segment
    return following if segment is walk.last and changes == made else []


def _known_leg(walk: Walk, following: list[Following], leg: Leg) -> KnownLeg:
    """Return a leg with what its replay needs."""
    first, turned = walk.first
    chain = Chain([first, *(step.segment for step in following[:-1])], following)
    chain.complete(walk.sums)
    rates = walk.sums.rates(walk.sums.stacked([*chain.segments, walk.last]))
    slipping = np.flatnonzero((rates.slip != 0.0).any(axis=0) & walk.segments.frictional)
    a, b = walk.problem.ends
    return KnownLeg(
        ends=(a, b),
        start=walk.problem.start.state,
        end=walk.point.state.copy(),
        turned=turned,
        first=first,
        last=walk.last,
        chain=chain,
        imbalance=rates.imbalance,
        stroke=rates.stroke,
        slipping=slipping,
        slip=rates.slip[:, slipping],
        resisting=rates.resisting[:, slipping],
        changes=tuple(list(part) for part in list(zip(*leg.events, strict=True))[1:]),
    )


def _play(
    segments: Segments, course: list[KnownLeg], y: Array, force_scale: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Follow legs one after the other from quantities y (4n,), as far as the lengths are positive.

    Returns:
        For each leg the entries of :class:`Played`.
    """
    n, passed = segments.system.n, passed_by_round_off(segments, force_scale)
    rows = []
    for one in course:
        labels = one.chain.labels
        h, singular = dtrtrs(one.chain.triangle, -y[labels], lower=1)
        rest = 1.0 - h.sum()
        if singular or not (h.min() >= 0.0 and rest >= END_TOLERANCE):
            break
        at = y + h @ one.chain.rows[:, : 4 * n]
        # what has reached its limit and stays there is exactly zero
        at[labels[at[labels] <= passed[labels]]] = 0.0
        at[labels[-1]] = 0.0
        end = at + rest * one.last.q
        np.maximum(end[2 * n :], 0.0, out=end[2 * n :])
        rows.append((y, np.append(h, rest), at, end))
        y = end
    return rows


def _keeps_law(
    reduction: Reduction, one: KnownLeg, played: Played, force_scale: float
) -> NDArray[np.bool_]:
    """Return which passages of a leg are its path, event for event."""
    segments, chain = reduction.segments, one.chain
    (a, b), h, g0 = one.ends, played.h[:, :-1], segments.system.g0
    on_limit, watch = segments.limit * force_scale, LIMIT_TOLERANCE * force_scale
    floor = floors(segments, force_scale, len(reduction.watched))

    def watched(y: Array, load: Array) -> Array:
        u = _displacements(g0, y)
        return u @ reduction.watched[:, : u.shape[1]].T + reduction.watched[:, u.shape[1] :] @ load

    before = np.hstack([played.y, watched(played.y, a)])
    after = before[:, played.y.shape[1] :] + h @ chain.rows[:, played.y.shape[1] :]
    fall = one.first.falling
    holds = (played.y[:, fall] > on_limit[fall]).all(axis=1)
    holds &= (before[:, chain.low] + h @ chain.fall >= floor[chain.low]).all(axis=1)
    holds &= (np.hstack([played.at, after]) >= floor).all(axis=1)
    # no event on the way from the last one to the end
    first = (played.at[:, one.last.falling] * one.last.time).min(axis=1, initial=np.inf)
    holds &= first >= played.h[:, -1] - END_TOLERANCE
    holds &= (watched(played.end, b) > watch).all(axis=1)
    errors = (played.h[:, :, None] * one.imbalance).cumsum(axis=1)
    errors += segments.balance.errors(played.y, a)[:, None, :]
    holds &= np.abs(errors).max(axis=(1, 2)) <= negligible_imbalance(len(g0)) * force_scale
    return holds


def _balanced(segments: Segments, state: ContactState, load: Array, force_scale: float) -> Array:
    """Return the quantities (4n,) of a state, from which round-off is removed if there is much."""
    y, n = segments.values(state), segments.system.n
    if segments.balance.error(y, load) <= LARGE_AT_START * negligible_imbalance(n) * force_scale:
        return y
    with suppress(SingularExchange):
        u = state.u + segments.tableau(state.state).correction(state.r)[: 2 * n]
        y = segments.values(ContactState(u, reactions(segments.system, load, u), state.state))
    return y


def _displacements(g0: Array, y: Array) -> Array:
    """Return the displacements (c, 2n) that belong to quantities (c, 4n)."""
    n = len(g0)
    return np.hstack([y[:, :n], y[:, n : 2 * n] - g0])


def _dissipation(one: KnownLeg, h: Array, y: Array, shares: list[Array]) -> Array:
    """Return the dissipation of the slipping nodes along segments of lengths h from y (4n,)."""
    n, at = len(y) // 4, one.slipping
    start = y[3 * n + at] * shares[1][at] - y[2 * n + at] * shares[0][at]
    grown = h[:, None] * one.resisting
    middle = grown.cumsum(axis=0)
    middle -= 0.5 * grown
    middle += start
    middle *= one.slip
    dissipation: Array = h @ middle
    return dissipation
