"""Cycle of a contact with frozen nodes: its events, and how they move with its start."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segment, Segments
from receding_fenicsx.interface.exact.tableau import exchanges
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.system import ContactState, reactions

DOUBLE = {(STICK, SEPARATION)}
"""Changes of state of one node at which two quantities vanish."""


class Stop(NamedTuple):
    """Event or corner of a frozen cycle.

    Attributes:
        load: (n_loads,) load factors, those of the shifts included.
        way: (n_loads,) their changes over the leg.
        u: (2N,) displacements, those of frozen nodes without their shifts.
        q: (4N,) rates of [v, gap, A, B] on the way there, over the leg.
        label: quantity that reached its limit, -1 at a corner.
        state: (N,) states on the way there.
    """

    load: Array
    way: Array
    u: Array
    q: Array
    label: int
    state: NDArray[np.int8]


class TracedWalk(Walk):
    """Path along one leg that keeps its stops."""

    def __init__(self, segments: Segments, problem: LegProblem) -> None:
        """Start at the beginning of a leg."""
        super().__init__(segments, problem)
        self.trace: list[Stop] = []

    def _advance(self, segment: Segment, ds: float) -> None:
        super()._advance(segment, ds)
        point, way = self.point, self.states.direction
        u = point.displacements(point.y)
        self.trace.append(Stop(point.load, way, u, segment.q, -1, point.state))

    def _event(self, label: int, segment: Segment) -> Segment:
        self.trace[-1] = self.trace[-1]._replace(label=label)
        return super()._event(label, segment)


class MovingEvents(NamedTuple):
    """Events of a cycle that move with the shifts.

    Attributes:
        at: (E,) number of the stop of each.
        label: (E,) quantity that reaches zero there.
        moves: (E,) whether the stop moves by ds; else ds is the part of a further quantity that
            vanishes there, too.
        change: (E, 4N) change of all quantities over ds: rates before it less those after it.
        triangle: (E, E) rate of each quantity at its own event, its changes at those before.
    """

    at: Ints
    label: Ints
    moves: NDArray[np.bool_]
    change: Array
    triangle: Array

    def moved(self, low: Array) -> Array:
        """Return how far the events move, (E, k), if ``label`` has the derivatives (E, k)."""
        if not len(self.at):
            return low
        ds: Array = sla.solve_triangular(self.triangle, -low, lower=True, check_finite=False)
        return ds


class MovedCycle(NamedTuple):
    """Derivatives of a cycle in the shifts.

    Attributes:
        S: (2N, k) of the displacements at its start.
        ds: (E, k) of the places of its events.
    """

    S: Array
    ds: Array


@dataclass(frozen=True)
class FrozenCycle:
    """One cycle with frozen nodes.

    Attributes:
        start, end: states at its start and end.
        stops: its events and corners.
        opens: (N,) nodes that are open somewhere.
        segments: makes the rates.
    """

    start: ContactState
    end: ContactState
    stops: list[Stop]
    opens: NDArray[np.bool_]
    segments: Segments

    @property
    def change(self) -> Array:
        """(2N,) change of the displacements from its start to its end."""
        change: Array = self.end.u - self.start.u
        return change

    def moved(self, by: MovedCycle) -> FrozenCycle:
        """Return the cycle, to first order, after its start and events have moved (k = 1)."""
        events, stops, u = self.events, [], by.S[:, 0].copy()
        ds = dict.fromkeys(range(len(self.stops)), 0.0)
        of: dict[int, Array] = {}
        for e, j in enumerate(events.at.tolist()):
            if events.moves[e]:
                ds[j] = float(by.ds[e, 0])
            of[j] = of.get(j, 0.0) + events.change[e, : len(u)] * by.ds[e, 0]
        for j, stop in enumerate(self.stops):
            here = stop.u + u + stop.q[: len(u)] * ds[j]
            stops.append(stop._replace(load=stop.load + ds[j] * stop.way, u=here))
            u = u + of.get(j, 0.0)
        now = stops[-1].u
        r = reactions(self.segments.system, stops[-1].load, now)
        start, end = (ContactState(now, r, at.state) for at in (self.start, self.end))
        return replace(self, start=start, end=end, stops=stops)

    @cached_property
    def events(self) -> MovingEvents:
        """The events that move with the shifts.

        The rates q in given states do not depend on the shifts, so that the derivative S (4N, k) of
        the quantities [v, gap, A, B] at a fixed load is constant between events. An event e, where
        quantity l(e) reaches zero, moves by ds_e, and so S changes there:

            q_l ds_e = -S_l,    S <- S + (q_before - q_after) ds_e,

        one triangular system for all events of the cycle. A corner does not move. Where a node that
        sticks opens, both margins vanish: the second one is brought to zero in the states that
        follow. This is right to first order though it may slip on the way.
        """
        found: list[tuple[int, int, float, Array]] = []
        states = np.array([stop.state for stop in self.stops])
        changed = np.append(np.count_nonzero(states[1:] != states[:-1], axis=1), 0)
        for j, stop in enumerate(self.stops):
            if stop.label >= 0 and stop.q[stop.label] < 0.0:
                change = stop.q - self.stops[j + 1].q
                found.append((j, stop.label, stop.q[stop.label], change))
                i = stop.label % states.shape[1]
                if changed[j] != 1 or (states[j, i], states[j + 1, i]) in DOUBLE:
                    found += [(j, label, 0.0, change) for label, change in self._vanishing(j)]
        at = np.array([j for j, *_ in found], dtype=np.intp)
        label = np.array([label for _, label, *_ in found], dtype=np.intp)
        rate = np.array([rate for *_, rate, _ in found])
        width = len(self.stops[0].q)
        change = np.array([change for *_, change in found]).reshape(len(at), width)
        triangle = np.tril(change[:, label].T, -1)
        np.fill_diagonal(triangle, np.where(rate < 0.0, rate, 1.0))
        return MovingEvents(at, label, rate < 0.0, change, triangle)

    def _vanishing(self, j: int) -> list[tuple[int, Array]]:
        """Return further quantities that vanish at a stop, with what brings them to zero (4N,)."""
        before, label, after = self.stops[j].state, self.stops[j].label, self.stops[j + 1].state
        segments, n = self.segments, len(before)
        changed = np.flatnonzero((before != after) & (segments.frictional | segments.smooth))
        reached, _ = exchanges(segments.frictional, changed, before, after)
        others = [other for other in reached if other >= n and other != label]
        if not others:
            return []
        tableau, one = segments.tableau(after), np.ones(1)
        return [(other, tableau.response(np.array([other]), one)[: 4 * n]) for other in others]
