"""Cycles of a contact some of whose nodes are frozen: they stick whatever their margins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import Segment, Segments
from receding_fenicsx.interface.exact.unloading import carries_nothing
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.residual import residual_at_rest
from receding_fenicsx.interface.rigid_motions import neutral_motions
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

DOUBLE = {(STICK, SEPARATION)}
"""Changes of state of one node at which two quantities vanish."""

MAX_PASSES = 50
"""Passes of the derivative through a cycle after which it must repeat itself."""

SAME_DERIVATIVE = 1e-9
"""Change of a derivative over its size that counts as none."""

ROUND_OFF = 1e-14
"""Change of the displacements, over their largest, that is round-off."""

MAX_TERMS = 100
"""Cycles within which the start of a cycle must be forgotten, for them not to be played."""

MAX_GROWTH = 1e3
"""Change from cycle to cycle, over the first, beyond which the start is not forgotten."""


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
        self.replay.active = False

    def _advance(self, segment: Segment, ds: float) -> None:
        super()._advance(segment, ds)
        point, way = self.point, self.states.direction
        u = point.displacements(point.y)
        self.trace.append(Stop(point.load, way, u, segment.q, -1, point.state))

    def _event(self, label: int, segment: Segment) -> tuple[Segment, bool]:
        self.trace[-1] = self.trace[-1]._replace(label=label)
        return super()._event(label, segment)


class NoLimit(Exception):
    """The search for the limit has failed; the text says why."""


@dataclass
class Budget:
    """Cycles that one search may play, and has played, the last one perhaps in part."""

    allowed: int
    played: int = 0

    def take(self) -> None:
        """Count a cycle that is about to be played; raise NoLimit if none is left."""
        if self.played >= self.allowed:
            raise NoLimit(f"the search has played {self.played} cycles, and may play no more")
        self.played += 1


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
        return replace(self, stops=stops)

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
        for j, stop in enumerate(self.stops):
            if stop.label >= 0 and stop.q[stop.label] < 0.0:
                change = stop.q - self.stops[j + 1].q
                found.append((j, stop.label, stop.q[stop.label], change))
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
        i = label % len(before)
        alone = np.count_nonzero(before != after) == 1
        if alone and (before[i], after[i]) not in DOUBLE:
            return []
        reached = self.segments.tableau(before).limits_reached(after)
        tableau, one = self.segments.tableau(after), np.ones(1)
        return [
            (other, tableau.response(np.array([other]), one)[: 4 * len(before)])
            for other in reached
            if other != label
        ]


@dataclass
class Frozen:
    """Contact system with frozen nodes, of which some can be shifted tangentially.

    A frozen node is held tangentially: it carries any Q and may open. The shift y_d of a node d
    enters eq. (11) as one more load, r = sum lambda r* + sum_d y_d K_d + K u, with the column K_d
    of its tangential displacement. Rates and stored segments depend on the states only, so that
    they serve for all shifts.

    Attributes:
        system: the whole system in 2N form.
        nodes: frozen nodes.
        shifted: those that can be shifted.
        loop: (m + 1, n_loads) load factors of a cycle.
        force: largest nodal force of the history.
        budget: counts the cycles.
        opening: (N,) nodes expected to open; None for all.
    """

    system: ContactSystem
    nodes: Ints
    shifted: Ints
    loop: Array
    force: float
    budget: Budget
    opening: NDArray[np.bool_] | None = None
    segments: Segments = field(init=False)

    def __post_init__(self) -> None:
        """Hold the frozen nodes and add the loads of the shifts."""
        system = self.system
        held = system.held.copy()
        held[self.nodes] = True
        rigid = neutral_motions(system.rigid, held)
        largest = np.abs(rigid).max(axis=0, initial=0.0)
        self.segments = Segments(
            replace(
                system,
                held=held,
                rigid=rigid / np.where(largest > 0.0, largest, 1.0),
                r_star=np.vstack([system.r_star, system.K[self.shifted]]),
                load_names=(*system.load_names, *(f"shift {d}" for d in self.shifted)),
                load_compliance=np.zeros((0, 0)),
                load_sign=np.zeros(0),
            ),
            self.opening,
            len(system.load_names),
        )

    def shift(self, state: ContactState, old: Array, new: Array) -> ContactState:
        """Follow the contact at the start of a cycle while the shifts (k,) grow to new ones."""
        if np.array_equal(old, new):
            return state
        start = self.loop[0]
        walk = self._walked(state, (np.append(start, old), np.append(start, new)))
        return walk.finish().end

    def cycle(self, state: ContactState, shifts: Array) -> FrozenCycle:
        """Play one cycle.

        Raises:
            SolveError: the path ends, or its residual is above its tolerance.
            NoLimit: no cycle may be played any more, or the contact is unloaded in it.
        """
        self.budget.take()
        stops: list[Stop] = []
        start, opens = state, state.state == SEPARATION
        for a, b in pairwise(self.loop):
            walk = self._walked(state, (np.append(a, shifts), np.append(b, shifts)))
            leg = walk.finish()
            if carries_nothing(leg.end, self.force):
                raise NoLimit("the contact is unloaded in the cycle, and begins anew")
            state, stops = leg.end, stops + walk.trace
            opens[[node for _, node, _, new in leg.events if new == SEPARATION]] = True
        return FrozenCycle(start, state, stops, opens, self.segments)

    def _walked(self, state: ContactState, ends: tuple[Array, Array]) -> TracedWalk:
        walk = TracedWalk(self.segments, LegProblem(state, ends, self.force))
        walk.run(1.0)
        return walk

    def start_change(self, state: ContactState) -> Array:
        """Return the derivatives (4N, k) of [v, gap, A, B] in the shifts, the states kept."""
        tableau = self.segments.tableau(state.state)
        return tableau.following(self.system.K[self.shifted].T)

    def quantities(self, u: Array) -> Array:
        """Return [v, gap, A, B] (4N,) of displacements (2N,) without loads and initial gaps."""
        n, segments = self.system.n, self.segments
        r = self.system.K @ u
        A, B = self.system.friction.margins(r[:n], r[n:])
        A = np.where(segments.smooth, r[n:], np.where(segments.frictional, A, 0.0))
        return np.concatenate([u, A, np.where(segments.frictional, B, 0.0)])

    def periodic_change(self, cycle: FrozenCycle) -> MovedCycle:
        """Return the derivatives in the shifts of a cycle that repeats itself.

        The map from S at the start of the cycle to S at its end is applied until it repeats: where
        a node slips, it forgets. The quantities that reach zero tell how the events move.

        Raises:
            NoLimit: it does not repeat.
        """
        n, events, start = self.system.n, cycle.events, self.start_change(cycle.start)
        low, S = start[events.label], start[: 2 * n]
        on_u, on_low = events.change[:, : 2 * n].T, events.change[:, events.label].T
        summed = np.zeros_like(low)
        for _ in range(MAX_PASSES):
            ds = events.moved(low)
            gained = on_low @ ds
            low += gained
            if np.abs(gained).max(initial=0.0) <= SAME_DERIVATIVE * np.abs(low).max(initial=0.0):
                if np.any(summed):
                    S = start[: 2 * n] + on_u @ summed
                left = np.abs(on_u @ ds).max(initial=0.0)
                if left <= SAME_DERIVATIVE * np.abs(S).max(initial=0.0):
                    return MovedCycle(S, ds)
            summed += ds
        raise NoLimit("the cycle with frozen nodes forgets its start too slowly")

    def to_forget(self, cycle: FrozenCycle) -> MovedCycle | None:
        """Return how the cycle that repeats itself differs from one that does not yet (k = 1).

        With the map P from a change of the start to that of the end, the start still moves by
        (1 + P + P^2 + ...) (end - start), to first order. None where the states at the start and
        the end differ, or where the sum does not converge.
        """
        if not np.array_equal(cycle.start.state, cycle.end.state):
            return None
        events, change = cycle.events, cycle.change
        weight, on_low = self.segments.weight[events.label], events.change[:, events.label].T
        low = self.quantities(change)[events.label, None]
        total, moved, every = low.copy(), np.zeros_like(low), np.zeros_like(low)
        first, none = weight @ np.abs(low[:, 0]), ROUND_OFF * self.force
        for terms in range(1, MAX_TERMS):
            ds = events.moved(low)
            low = low + on_low @ ds
            total += low
            moved += ds
            every += moved
            size = weight @ np.abs(low[:, 0])
            if size <= max(SAME_DERIVATIVE * first, none) or not size <= MAX_GROWTH * first:
                break
        on_u = events.change[:, : len(change)].T
        last, S = change + (on_u @ moved)[:, 0], (terms + 1) * change + (on_u @ every)[:, 0]
        none = ROUND_OFF * np.abs(cycle.end.u).max()
        if not np.abs(last).max() <= max(SAME_DERIVATIVE * np.abs(S).max(), none):
            return None
        return MovedCycle(S[:, None], events.moved(total))

    def displaced(self, state: ContactState, by: Array, shifts: Array) -> ContactState:
        """Return a state at the start of a cycle displaced by (2N,) where the law allows that."""
        system, u = self.segments.system, state.u + by
        there = ContactState(u, reactions(system, np.append(self.loop[0], shifts), u), state.state)
        return there if self.allows(there) else state

    def allows(self, state: ContactState) -> bool:
        """Return whether the law allows a state at the start of a cycle."""
        return residual_at_rest(self.segments.system, state, self.force) <= EVENT_RESIDUAL
