"""Cycles of a contact some of whose nodes are frozen: they stick whatever their margins."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen_cycle import FrozenCycle, MovedCycle, Stop, TracedWalk
from receding_fenicsx.evolution.limit.frozen_segments import FrozenSegments
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.unloading import carries_nothing
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.residual import residual_at_rest
from receding_fenicsx.interface.rigid_motions import neutral_motions
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

MAX_PASSES = 50
"""Passes of the derivative through a cycle after which it must repeat itself."""

SAME_DERIVATIVE = 1e-9
"""Change of a derivative over its size that counts as none."""

ROUND_OFF = 1e-13
"""Change of the displacements, over their largest, that is round-off."""

MAX_TERMS = 100
"""Cycles within which the start of a cycle must be forgotten, for them not to be played."""

MAX_GROWTH = 1e3
"""Change from cycle to cycle, over the first, beyond which the start is not forgotten."""


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
        before: contact with other frozen nodes, whose rates serve where they are known.
    """

    system: ContactSystem
    nodes: Ints
    shifted: Ints
    loop: Array
    force: float
    budget: Budget
    opening: NDArray[np.bool_] | None = None
    before: InitVar[Frozen | None] = None
    segments: FrozenSegments = field(init=False)

    def __post_init__(self, before: Frozen | None) -> None:
        """Hold the frozen nodes and add the loads of the shifts."""
        system = self.system
        held = system.held.copy()
        held[self.nodes] = True
        rigid = neutral_motions(system.rigid, held)
        largest = np.abs(rigid).max(axis=0, initial=0.0)
        self.segments = FrozenSegments(
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
            None if before is None else before.segments,
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
            opens[leg.events.node[leg.events.new == SEPARATION]] = True
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
        # lengths beside forces
        weight = self.segments.weight[events.label, None]
        summed = np.zeros_like(low)
        for _ in range(MAX_PASSES):
            ds = events.moved(low)
            gained = on_low @ ds
            low += gained
            size, change = (np.abs(weight * a).max(initial=0.0) for a in (low, gained))
            if change <= SAME_DERIVATIVE * size:
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
        allowed = self.allowed(there)
        return state if allowed is None else allowed

    def allowed(self, state: ContactState) -> ContactState | None:
        """Return a state at the start of a cycle, moved on where nodes stick beyond their limits.

        They slip back to their limits. None where the law does not allow what comes of it, or one
        of them would slip the other way.
        """
        if self._is_allowed(state):
            return state
        segments, n, states = self.segments, self.system.n, state.state.copy()
        passed = segments.margins(state) < -segments.limit * self.force
        stuck = segments.frictional & (state.state == STICK)
        states[stuck & passed[2 * n : 3 * n]] = FORWARD
        states[stuck & passed[3 * n :]] = BACKWARD
        try:
            change = segments.tableau(states).correction(state.r)[: 2 * n]
        except SingularExchange:
            return None
        if np.any((SLIP_SIGN[states] * change[:n])[states != state.state] < 0.0):
            return None
        slipped = ContactState(state.u + change, state.r + self.system.K @ change, states)
        return slipped if self._is_allowed(slipped) else None

    def _is_allowed(self, state: ContactState) -> bool:
        """Return whether the law allows a state at the start of a cycle."""
        return residual_at_rest(self.segments.system, state, self.force) <= EVENT_RESIDUAL
