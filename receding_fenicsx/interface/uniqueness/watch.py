"""Uniqueness of a path, leg after leg, and of static problems from rest."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.legs import direction_key
from receding_fenicsx.interface.exact.rest import carries_nothing, zero_crossing
from receding_fenicsx.interface.exact.segments import Segments, ties_at
from receding_fenicsx.interface.exact.static import end_in_states, states_by_newton, static_problem
from receding_fenicsx.interface.law import BACKWARD, FORWARD, STICK
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import Problem
from receding_fenicsx.interface.residual import largest_force
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg
from receding_fenicsx.interface.tolerances import JUMP_STEP, SAME_MARGIN, SAME_RATES, SIMULTANEOUS
from receding_fenicsx.interface.uniqueness.certificate import (
    Certificate,
    Pattern,
    certify,
    definite,
)
from receding_fenicsx.interface.uniqueness.instants import Instants, Sides, States, bits_of, mask_of

LARGE_MARGIN = 1.5
"""Margin beyond which sets of states are measured at the ends of legs only."""


@dataclass(frozen=True)
class Uniqueness:
    """Whether a path is the only one from its start, as far as it has gone."""

    # at every instant the rates are proved to be unique, and no static problem was found to have
    # several solutions
    certified: bool = True
    # factor phi by which all friction could grow before definiteness fails, the smallest of all
    # instants. Above ``LARGE_MARGIN`` it is the smallest at the ends of legs, where slip zones are
    # largest; infinite where nothing slips there. Sets of states in which something slips without
    # stiffness have none: their solutions are counted
    margin: float = np.inf
    # largest number of rates found at one instant, or of solutions of a static problem
    solutions: int = 1
    # cycle, leg, s: place of the first doubt, -1 without one. A path that is not certified and has
    # no such place began before uniqueness was judged
    cycle: int = -1
    leg: int = -1
    s: float = -1.0
    # nodes of the first doubt, at most as many as here, filled up with -1
    nodes: tuple[int, ...] = (-1,) * 8
    static: int = 0  # largest number of solutions found of a static problem, 0 without one
    proved: bool = True  # static problems are proved to have no other solution

    def with_doubt(
        self, place: tuple[int, int, float], nodes: tuple[int, ...], solutions: int = 1
    ) -> Uniqueness:
        """Return what remains where an instant is not certified."""
        changed = replace(self, certified=False, solutions=max(self.solutions, solutions))
        if not self.certified:
            return changed
        named = (nodes + self.nodes)[: len(self.nodes)]  # none so far: all are -1
        return replace(changed, cycle=place[0], leg=place[1], s=place[2], nodes=named)


class UniquenessWatch:
    """Judges the legs of a path one after the other.

    What it remembers of the legs before saves work, and changes no answer but which of the doubtful
    instants are counted: these are forgotten at checkpoints.
    """

    def __init__(self, system: ContactSystem, found: Uniqueness, in_steps: bool = False) -> None:
        """Continue; ``in_steps`` if events are ends of load steps, not where states change."""
        self.found, self.in_steps = found, in_steps
        self.certificate, self._segments = Certificate(system), Segments(system)
        # instants met before, by direction of the leg
        self._met: dict[bytes, set[Sides]] = {}
        self._legs: set[int] = set()  # hashes of whole legs, which mostly come again
        self._patterns: list[Pattern] = []
        # met, and not proved to be definite
        self.indefinite: set[Sides] = set()
        self._measured: set[Sides] = set()
        # of no smaller margin than the one that is found: eigenvalues take far longer
        self._larger: list[Pattern] = []
        self._jumps: list[float] = []
        self._doubtful: list[tuple[bytes, Sides]] = []
        # static problems that were judged
        self._judged: set[tuple[bytes, bytes]] = set()
        self.floats = False  # the last leg has left a free body without any contact force
        # doubtful instants whose solutions are counted before the next checkpoint
        self._left = 8

    def forget_doubts(self) -> None:
        """Judge and count doubtful instants anew, as a run does that is resumed here."""
        for way, sides in self._doubtful:
            self._met[way].discard(sides)
        self._doubtful, self._left = [], 8
        self._judged.clear()
        self._legs.clear()

    def add(
        self,
        place: tuple[int, int],
        start: ContactState,
        ends: tuple[Array, Array],
        leg: Leg,
        static: bool = False,
    ) -> None:
        """Judge a leg, given with cycle and number, state and load factors at its start.

        ``static``: it is one static problem, with slip counted from the start.
        """
        system, n, (a, b) = self.certificate.system, self.certificate.system.n, ends
        segments, scale = self._segments, leg.force_scale
        self._jumps = [s for s, _ in leg.jumps]
        for s in self._jumps:
            changed = {i for at, i, *_ in leg.events if self._is_finite(at)}
            self.found = self.found.with_doubt((*place, s), tuple(sorted(changed)))
        state, events, ties = start.state, leg.events, leg.ties
        if self.in_steps or not a.any():
            values = segments.values(start)
            ties = Changes.joined(ties_at(segments, 0.0, values, state, scale), ties)
        crossing = zero_crossing(system, ends)
        if crossing is not None:
            before, after = crossing - SIMULTANEOUS, crossing + SIMULTANEOUS
            events, ties = (some.select(some.s < before) for some in (events, ties))
            self._rates(place, a - b, (state, events, ties))
            if np.any(system.g0) or np.any(leg.events.s > after):
                self.found = self.found.with_doubt((*place, crossing), ())
                return
            start = ContactState(np.zeros(2 * n), np.zeros(2 * n), state)
        at_rest = static or crossing is not None
        if not at_rest and not a.any():
            gap = segments.values(start)[n : 2 * n]
            near = system.held[n:] | (gap <= segments.limit[n : 2 * n] * scale)
            at_rest = bool(near.all()) and carries_nothing(system, start, a, scale)
        if at_rest:
            key = start.u.tobytes(), b.tobytes()
            if key not in self._judged:
                self._judged.add(key)
                states, proved = solutions_from_rest(segments, start, leg.end.state, b)
                count = max(1, len(states))  # the path has found one
                most, proved = max(self.found.static, count), self.found.proved and proved
                self.found = replace(self.found, static=most, proved=proved)
                if count > 1:
                    at = *place, crossing or 0.0
                    self.found = self.found.with_doubt(at, _differing(states), count)
            state, events, ties = leg.end.state, *[Changes.none()] * 2
        new = self._rates(place, b - a, (state, events, ties))
        free = system.rigid.shape[1] > 0 and bool(b.any())
        self.floats = free and carries_nothing(system, leg.end, b, scale)
        if self.floats:  # nothing says where
            self.found = self.found.with_doubt((*place, 1.0), ())
        if new:
            end = Sides.of(leg.end.state).of_nodes(self.certificate.rubbing)
            if (end.forward or end.backward) and end not in self._measured:
                self._measured.add(end)
                self._measure(end)
        unknown = self.in_steps and len(leg.events) and self.found.certified
        if unknown and not self._is_always_definite:
            self.found = self.found.with_doubt((*place, float(leg.events.s[0])), ())

    @cached_property
    def _is_always_definite(self) -> bool:
        """Whether all sets of states are definite: what happens within load steps is not known."""
        n, normal = self.certificate.system.n, ~self.certificate.system.held
        stuck = Sides.of(np.full(n, STICK, dtype=np.int8))
        every = stuck.put(self.certificate.rubbing | bits_of(normal[n:]), 0)
        return definite(self.certificate, every, 1.0 + SAME_MARGIN)

    def _is_finite(self, s: float) -> bool:
        """Return whether states change at s by a load step or a jump."""
        return self.in_steps or any(0.0 <= s - at <= 2.0 * JUMP_STEP for at in self._jumps)

    def _rates(
        self,
        place: tuple[int, int],
        direction: Array,
        path: tuple[States, Changes, Changes],
    ) -> bool:
        """Judge the rates along a leg, or a part of it: its start, events and ties.

        Returns:
            Whether it is not known that there was a leg like it before.
        """
        way, (start, events, ties), finite = direction_key(direction), path, None
        if self._jumps or self.in_steps:
            # what an event has decided is no tie
            seen = {(s, i, state) for s, i, *states in events for state in states}
            ties = Changes.of(one for one in ties if (*one[:2], one[3]) not in seen)
            finite = self._is_finite
        instants = Instants.of(start, events, ties)
        if finite is None:
            leg = hash((way, instants.key))
            if leg in self._legs:
                return False
            self._legs.add(leg)
        rubbing, met = self.certificate.rubbing, self._met.setdefault(way, set())
        new = dict[Sides, float]()
        for s, sides in instants.sides(finite):
            if sides not in met:
                met.add(sides)
                new[sides] = s
        sets = {sides: sides.of_nodes(rubbing) for sides in new}
        self.judge(
            [one for one in sets.values() if (one.forward | one.backward | one.touching) & rubbing]
        )
        for sides, one in sets.items():
            if one in self.indefinite:
                self._doubtful.append((way, sides))
                self._doubt((*place, new[sides]), direction, sides)
        return True

    def _is_new(self, one: Sides) -> bool:
        """Return whether nothing is known of a set of states."""
        for k, pattern in enumerate(self._patterns):
            if pattern.holds(one):
                # the next one is likely to be held by it too
                self._patterns.insert(0, self._patterns.pop(k))
                return False
        return one not in self.indefinite

    def judge(self, sets: list[Sides]) -> None:
        """Certify sets of states in which something slips; note those that are not definite.

        They are certified all together, in halves, at last each alone.
        """
        while sets := [one for one in sets if self._is_new(one)]:
            pattern = certify(self.certificate, sets, LARGE_MARGIN)
            if pattern is not None and pattern.holds(sets[0]):
                self._patterns.insert(0, pattern)
            elif len(sets) > 1:
                # those with fewer open nodes, and the others
                ranked = sorted(range(len(sets)), key=lambda k: sets[k].open.bit_count())
                for half in np.split(ranked, [len(sets) // 2]):
                    self.judge([sets[k] for k in sorted(half)])
                return
            else:
                if not self._is_definite(sets[0]):
                    self.indefinite.add(sets[0])
                return

    def _is_definite(self, one: Sides) -> bool:
        """Return whether the sets of states that the nodes may take are definite, one by one."""
        if not one.touching:
            self._measure(one)
            pattern = certify(self.certificate, [one], 1.0 + SAME_MARGIN)
            if pattern is not None:
                self._patterns.insert(0, pattern)
            return pattern is not None
        if not one.touches_few:
            return False
        sides = list(one.explicit(self.certificate.rubbing))
        self.judge(sides)
        return self.indefinite.isdisjoint(sides)

    def _measure(self, one: Sides) -> None:
        """Lower the margin to that of a set of states, if it is smaller."""
        judge, least = self.certificate, self.found.margin
        if any(larger.holds(one) for larger in self._larger):
            return
        if np.isfinite(least):
            pattern = certify(judge, [one], least * (1.0 - SAME_MARGIN))
            if pattern is not None:
                self._larger.append(pattern)
                return
        margin, _ = judge.margin(one.states(judge.system.n))
        if margin > 0.0:  # what slips without stiffness does so whatever the friction
            self.found = replace(self.found, margin=min(least, margin))

    def _doubt(self, place: tuple[int, int, float], direction: Array, sides: Sides) -> None:
        """Count the solutions of an instant whose matrices are not all definite."""
        judge, states = self.certificate, np.zeros((0, 0), dtype=np.int8)
        system, state = judge.system, sides.states(judge.system.n)
        if self._left:
            self._left -= 1
            free = judge.free(mask_of(sides.open, system.n))
            with suppress(np.linalg.LinAlgError):
                held = direction @ system.r_star
                found = all_solutions(system, held, judge.undecided(sides), free)
                if found.complete and len(found.states) == 1:
                    return
                states = found.states
        nodes = _differing(states) if len(states) > 1 else judge.margin(state)[1]
        self.found = self.found.with_doubt(place, nodes, len(states))


def _differing(states: NDArray[np.int8]) -> tuple[int, ...]:
    """Return the nodes whose states differ between solutions."""
    return tuple(np.flatnonzero(np.any(states != states[0], axis=0)).tolist())


def solutions_from_rest(
    segments: Segments, start: ContactState, known: States, load: Array
) -> tuple[NDArray[np.int8], bool]:
    """Return (k, N) states of the solutions of a static problem, and whether there are no others.

    Without friction there is one, the problem being convex. All sets of states of few nodes are
    tried. For more, where no certificate is known, Newton's method starts from slip of all nodes
    either way, and Lemke's from several covering vectors. Slip is counted from ``start``, a state
    without reactions; ``known`` are the (N,) states that the path has found. Each row has other
    reactions.
    """
    if not segments.frictional.any():
        return start.state[None], True
    problem, ends = static_problem(segments, start, load), [known]
    system, _, undecided, _ = problem
    try:
        # six nodes with friction
        if undecided.sets <= 4**6:
            found = all_solutions(*problem)
            return found.states, found.complete
        for first in (FORWARD, BACKWARD):
            end = states_by_newton(system, start, load, first)
            ends += [] if end is None else [end.state]
        if len(undecided.touching) <= 40:
            of_nodes = Problem.of(*problem)
            ends += map(of_nodes.whole, of_nodes.by_covers())
    except np.linalg.LinAlgError:
        return np.zeros((0, system.n), dtype=np.int8), False
    kept, forces = list[States](), list[Array]()
    for state in {state.tobytes(): state for state in ends}.values():
        solution = end_in_states(segments, start, load, np.where(state > 0, state, STICK))
        if solution is None:
            continue
        different = SAME_RATES * largest_force(system, load, solution.r, 0.0)
        if all(np.abs(solution.r - other).max() > different for other in forces):
            kept.append(solution.state)
            forces.append(solution.r)
    return np.array(kept, dtype=np.int8).reshape(-1, system.n), False
