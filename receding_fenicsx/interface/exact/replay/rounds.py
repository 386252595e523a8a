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
from dataclasses import replace
from operator import is_

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.reduction import Reduction
from receding_fenicsx.interface.exact.replay.chain import leading
from receding_fenicsx.interface.exact.replay.known_leg import (
    KnownLeg,
    Played,
    are_of,
    displacements,
    dissipated,
    followings,
    keeps_law,
    known_leg,
    lengths,
    play,
)
from receding_fenicsx.interface.exact.round_off import LARGE_AT_ENDS, negligible_imbalance
from receding_fenicsx.interface.exact.segments import (
    Following,
    Segments,
)
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import SLIP_SIGN
from receding_fenicsx.interface.residual import law_residual, local_stiffness
from receding_fenicsx.interface.system import ContactState, Leg, reactions

FEWEST, MOST = 2, 16
"""Cycles foreseen at once; twice as many after those before have all held."""

LONGEST_CYCLE = 64
"""Legs of a cycle at most."""

Way = tuple[bytes, bytes]
"""Load factors at the start and at the end of a leg."""


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
        following, last = followings(walk) if walk.is_known else [], self._events.get(way, [])
        self._events[way] = following
        same = bool(following) and len(last) == len(following) and all(map(is_, last, following))
        same = same and are_of(walk, following)
        known = self._known.get(way)
        if not same:
            self._known.pop(way, None)
        elif known is None or not np.array_equal(known.start, walk.problem.start.state):
            self._known[way] = known_leg(walk, following, leg)

    def _foresee(self, start: ContactState, cycle: list[Way], force_scale: float) -> None:
        """Foresee several cycles; make the legs ready that hold."""
        known, segments = [self._known[way] for way in cycle], self.reduction.segments
        small = self.reduction.shrink(start)
        starts = [small.state, *(one.end for one in known)]
        meet = all(np.array_equal(at, known[k % len(known)].start) for k, at in enumerate(starts))
        if not meet or not self.reduction.fits(start):
            return
        y, first = segments.values(small), known[0]
        if lengths(first, y) is not None:
            y = _balanced(segments, small, y, first.ends[0], force_scale)
        rows = play(segments, self._count * known, y, force_scale)
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
        holds, ties = keeps_law(reduction, one, played, force_scale)
        # the ends, with all nodes and reactions evaluated afresh
        u = np.hstack([displacements(segments.system.g0, played.end), np.tile(b, (len(holds), 1))])
        u = reduction.displacements(u)
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
            slipped = dissipated(one, h, played.y[c], segments.shares)
            dissipation[reduction.nodes[one.slipping]] = slipped
            middle = a + (places - 0.5 * h)[:, None] * (b - a)
            work = (h @ (one.stroke * middle))[:-1].sum() + swing
            at = np.append(np.zeros(one.turned), places[one.chain.event_of])
            legs.append(
                Leg(
                    end=ContactState(u[c], r[c], state.copy()),
                    dissipation=dissipation,
                    work=float(work),
                    residual=float(error[c]),
                    force_scale=max(force_scale, float(np.abs(r[c]).max())),
                    events=replace(one.changes, s=at),
                    ties=replace(ties[c], node=reduction.nodes[ties[c].node]),
                )
            )
        return legs


def _balanced(
    segments: Segments, state: ContactState, y: Array, load: Array, force_scale: float
) -> Array:
    """Return quantities y (4n,) of a state, round-off removed from them if there is much."""
    n = segments.system.n
    if segments.balance.error(y, load) <= LARGE_AT_ENDS * negligible_imbalance(n) * force_scale:
        return y
    with suppress(SingularExchange):
        u = state.u + segments.tableau(state.state).correction(state.r)[: 2 * n]
        y = segments.values(ContactState(u, reactions(segments.system, load, u), state.state))
    return y
