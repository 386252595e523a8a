"""One cycle traced from event to event, and how its events move from cycle to cycle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.system import ContactState

Mask = NDArray[np.bool_]


class Stop(NamedTuple):
    """Event or corner of a cycle.

    Attributes:
        leg, s: leg of the cycle and place on it.
        load: (n_loads,) load factors.
        u: (2N,) displacements.
        q: (4N,) rates of y = [v, gap, A, B] on the way there, over the leg.
        label: quantity that reached its limit, -1 at a corner.
        state: (N,) states on the way there.
    """

    leg: int
    s: float
    load: Array
    u: Array
    q: Array
    label: int
    state: NDArray[np.int8]


class MovingEvents(NamedTuple):
    """How the events of a cycle move where the cycle starts from other displacements.

    Attributes:
        at: (E,) number of the stop of each.
        label: (E,) quantity that reaches zero there.
        change: (E, 4N) rates of all quantities before it less those after it.
        triangle: (E, E) rate of each quantity at its own event, its changes at those before.
    """

    at: Ints
    label: Ints
    change: Array
    triangle: Array


@dataclass(frozen=True)
class TracedCycle:
    """One cycle, event by event.

    Attributes:
        start, end: states at its start and end.
        stops: its events and corners.
        segments: makes the rates.
    """

    start: ContactState
    end: ContactState
    stops: list[Stop]
    segments: Segments

    @cached_property
    def events(self) -> MovingEvents:
        """How its events move.

        In given states the rates q do not depend on the displacements, so that a change S (4N,) of
        the quantities at a fixed load is constant between events. An event e, where quantity l(e)
        reaches zero, moves by ds_e, and so S changes there:

            q_l ds_e = -S_l,    S <- S + (q_before - q_after) ds_e,

        one triangular system for all events of the cycle. A corner does not move.
        """
        at = np.array([j for j, stop in enumerate(self.stops) if stop.label >= 0], dtype=np.intp)
        label = np.array([self.stops[j].label for j in at], dtype=np.intp)
        q = np.array([stop.q for stop in self.stops])
        change = q[at] - q[at + 1]
        triangle = np.tril(change[:, label].T, -1)
        np.fill_diagonal(triangle, q[at, label])
        return MovingEvents(at, label, change, triangle)

    def values(self) -> Array:
        """Return the quantities (J, 4N) at its stops, from displacements and loads."""
        u, load = (np.array([getattr(stop, name) for stop in self.stops]) for name in ("u", "load"))
        system = self.segments.system
        y = quantities(self.segments, u, load @ system.r_star + u @ system.K.T)
        y[:, system.n : 2 * system.n] += system.g0
        return y

    @cached_property
    def _changes(self) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """States (J, N) on the way to the stops and after them; the same after the last one."""
        states = np.array([stop.state for stop in self.stops])
        return states, np.vstack([states[1:], states[-1:]])

    @cached_property
    def releases(self) -> Mask:
        """Stops (J,) at which one node begins to slip or opens, and no other one changes."""
        old, new = self._changes
        held = (old == SEPARATION) | (new == STICK) | (SLIP_SIGN[old] * SLIP_SIGN[new] < 0.0)
        events = np.array([stop.label >= 0 for stop in self.stops])
        one = np.count_nonzero(old != new, axis=1) == 1
        releases: Mask = events & one & ~np.any((old != new) & held, axis=1)
        return releases

    @cached_property
    def runs(self) -> Ints:
        """Number (J,) of each stop's run of releases, the stop that ends the run included."""
        return np.append(0, np.cumsum(~self.releases)[:-1])

    def unlimited_and_zero(self) -> tuple[Mask, Mask]:
        """Return which gaps and margins (J, 3N) need not stay above zero at a stop, and may not.

        Those that the states keep at zero do so, and nodes released in a run are on either side in
        it. Where several quantities reach zero at once all but the first one have to stay there.
        """
        rubs, smooth = self.segments.frictional, self.segments.smooth
        fixed = []
        for states in self._changes:
            contact = states != SEPARATION
            A, B = (rubs & (~contact | (states == slip)) for slip in (FORWARD, BACKWARD))
            gap, A = contact & (rubs | smooth), A | (smooth & ~contact)
            fixed.append(np.concatenate([gap, A, B], axis=1))
        zero = fixed[1] & ~fixed[0]
        at, label = self.events.at, self.events.label
        zero[at, label - self.segments.system.n] = False
        old, new = self._changes
        released = np.zeros((self.runs[-1] + 1, old.shape[1]), dtype=bool)
        np.logical_or.at(released, self.runs, (old != new) & self.releases[:, None])
        loose = np.tile(released[self.runs] & self.releases[:, None], 3)
        return fixed[0] | loose | ~np.tile(rubs | smooth, 3), zero & ~loose


def quantities(segments: Segments, u: Array, r: Array) -> Array:
    """Return [v, gap, A, B] (..., 4N) of displacements and reactions (..., 2N) without gaps."""
    n, friction = segments.system.n, segments.friction
    A, B = friction.margins(r[..., :n], r[..., n:])
    A = np.where(segments.smooth, r[..., n:], np.where(segments.frictional, A, 0.0))
    return np.concatenate([u, A, np.where(segments.frictional, B, 0.0)], axis=-1)


def trace(segments: Segments, start: ContactState, loop: Array, force: float) -> TracedCycle:
    """Trace one cycle.

    Args:
        segments: makes the rates.
        start: state at its start.
        loop: (m + 1, n_loads) load factors of a cycle.
        force: largest nodal force of the history so far.

    Raises:
        SolveError: the path ends, or its residual is above its tolerance.
        SingularExchange: a motion without stiffness is left.
    """
    # loads Numba, which takes longer than all the rest
    from receding_fenicsx.interface.exact.compilation import loop_of
    from receding_fenicsx.interface.exact.walk import Walk

    state, stops, follows = start, list[Stop](), loop_of(segments)
    for k, ends in enumerate(pairwise(loop)):
        problem = LegProblem(state, ends, force)
        walk = Walk(follows, problem, traced=True)
        walk.run(1.0)
        state = walk.finish().end
        for s, u, q, label, on_the_way in walk.stops():
            stops.append(Stop(k, s, problem.load(s), u, q, label, on_the_way))
    return TracedCycle(start, state, stops, segments)
