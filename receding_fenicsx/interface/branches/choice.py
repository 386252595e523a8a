"""Choice among several continuations of a contact: found, made by a rule, and noted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.consistency import ConsistentStates
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.segments import Segment, Segments, States
from receding_fenicsx.interface.exact.static import end_in_states, static_problem
from receding_fenicsx.interface.exact.tableau import A, B
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.all_solutions import all_solutions
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.tolerances import SAME_MARGIN, SAME_RATES, SIMULTANEOUS
from receding_fenicsx.interface.uniqueness.certificate import Certificate, definite
from receding_fenicsx.interface.uniqueness.instants import Sides, bits_of

FIRST, LEAST, MOST = "first", "least dissipation", "most dissipation"
"""Rules by name; a number n takes the n-th continuation, or the last where there are fewer."""

Key = tuple[int, int, int]
"""Cycle, leg, and number of a choice on the leg."""


@dataclass(frozen=True)
class Choice:
    """An instant with several continuations."""

    # cycle, leg, s: place on the load path
    cycle: int
    leg: int
    s: float
    load: tuple[float, ...]  # load factors
    nodes: tuple[int, ...]  # modelled nodes whose states differ between the continuations
    solutions: int  # number of continuations
    taken: int  # the one that was taken, from 1; 1 is the one that is found first
    states: tuple[tuple[int, ...], ...]  # states of these nodes in each continuation


@dataclass
class _Option:
    """A continuation: states, change of [v, w] as forces, first and second rate of dissipation.

    ``end`` is what follows: rates of the segment, or the end of a leg from rest.
    """

    end: Any
    state: States
    change: Array
    dissipation: tuple[float, float]

    def equals(self, other: _Option) -> bool:
        scale = max(np.abs(self.change).max(), np.abs(other.change).max())
        return bool(np.abs(self.change - other.change).max() <= SAME_RATES * scale)


class Chooser:
    """Finds all continuations at each event and turning point, takes one, notes the choice."""

    def __init__(
        self, rule: str | int = FIRST, taken: Mapping[Key, int | Choice] | None = None
    ) -> None:
        """Prepare with a rule, and what to take at given choices.

        That is a continuation by its number, from 1, or that of a choice made before, by its states
        of the nodes: numbers depend on round-off where nodes come to their limits together.
        """
        self.rule, self.taken = rule, taken or {}
        self.log: dict[Key, Choice] = {}
        # places at which not all continuations could be searched
        self.unsure: set[tuple[int, int, float]] = set()
        self._leg, self._number = (0, 0), 0
        self._last: tuple[float, list[_Option]] | None = None
        self._certificate: Certificate | None = None
        self._certified: dict[Sides, bool] = {}

    def enter(self, cycle: int, leg: int) -> None:
        """Begin a leg; what is noted of it is forgotten."""
        self._leg, self._number, self._last = (cycle, leg), 0, None
        self.log = {key: choice for key, choice in self.log.items() if key[:2] != self._leg}

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The choices made, in their order."""
        return tuple(self.log[key] for key in sorted(self.log))

    def choose(self, found: ConsistentStates, before: States, segment: Segment) -> Segment:
        """Return the rates to go on with, and bring the path's states to theirs.

        ``found`` is the search for consistent states at the present point, ``before`` the (N,)
        states before it, ``segment`` the rates in the states that it has found.
        """
        segments, point = found.segments, found.point
        undecided, free = found.rate_problem(before)
        place = (*self._leg, point.problem.place(point.s))
        if not len(undecided.nodes) or self._is_certified(segments.system, before, undecided):
            return segment
        held = found.direction @ segments.system.r_star
        ways = [_option_of(segments, point.y, point.state, segment)]
        for row in self._solutions(place, segments.system, held, undecided, free):
            point.state = np.where(row > 0, row, before).astype(np.int8)
            try:
                other = segments.at(point.state, found.direction)
            except SingularExchange:
                self.unsure.add(place)
                continue
            option = _option_of(segments, point.y, point.state, other)
            known = any(np.array_equal(option.state, o.state) or option.equals(o) for o in ways)
            if not known and not len(found.violations(other)):
                ways.append(option)
        number = self._take(place, point.load, ways)
        point.state = ways[number].state
        if number > 0:
            # quantities of undecided nodes within round-off of their limits are zero
            for kind in (1, A, B):
                labels = kind * segments.system.n + undecided.nodes
                point.y[labels[point.y[labels] <= found.on_limit[labels]]] = 0.0
        return ways[number].end

    def _solutions(self, place: tuple[int, int, float], *problem: Any) -> NDArray[np.int8]:
        """Return (k, N) solutions of a rate problem; note the place where there may be others."""
        try:
            solutions = all_solutions(*problem)
        except np.linalg.LinAlgError:
            self.unsure.add(place)
            return np.zeros((0, 0), dtype=np.int8)
        if not solutions.complete:
            self.unsure.add(place)
        return solutions.states

    def _is_certified(self, system: ContactSystem, before: States, undecided: Undecided) -> bool:
        """Return whether the rates are proved to be unique: all sets of states are definite."""
        state = np.where(before == SEPARATION, SEPARATION, STICK).astype(np.int8)
        state[undecided.forward], state[undecided.backward] = FORWARD, BACKWARD
        touching = np.zeros(system.n, dtype=bool)
        touching[undecided.touching] = touching[undecided.smooth] = True
        sides = Sides.of(state).put(bits_of(touching), 0)
        if sides not in self._certified:
            judge = self._certificate = self._certificate or Certificate(system)
            self._certified[sides] = definite(judge, sides, 1.0 + SAME_MARGIN)
        return self._certified[sides]

    def choose_static(
        self, segments: Segments, problem: LegProblem, end: ContactState
    ) -> ContactState:
        """Return the end of a leg from rest to take, ``end`` being the one that was found."""
        start, load = problem.start, problem.ends[1]
        place = (*self._leg, problem.place(0.0))
        ways = [_static_option(segments, start, end)]
        for row in self._solutions(place, *static_problem(segments, start, load)):
            other = end_in_states(segments, start, load, row)
            if other is None:
                self.unsure.add(place)
                continue
            option = _static_option(segments, start, other)
            if not any(option.equals(known) for known in ways):
                ways.append(option)
        return ways[self._take(place, problem.ends[0], ways)].end

    def _take(self, place: tuple[int, int, float], load: Array, options: list[_Option]) -> int:
        """Return the index of the continuation to take; note the choice where there are several."""
        if len(options) == 1:
            return 0
        s = place[2]
        if self._last is not None and s - self._last[0] <= SIMULTANEOUS:
            before = self._last[1]
            known = [any(option.equals(other) for other in before) for option in options]
            if len(options) == len(before) and all(known):  # chosen already
                return 0
        self._last = s, options
        key = (*self._leg, self._number)
        self._number += 1
        states, taken = np.array([option.state for option in options]), self.taken.get(key, 0)
        if isinstance(taken, Choice):
            made = taken.states[taken.taken - 1]
            same = np.all(states[:, list(taken.nodes)] == made, axis=1)
            taken = int(np.argmax(same)) + 1 if same.any() else taken.taken
        taken = min(taken or self._by_rule(options), len(options))
        nodes = np.flatnonzero(np.any(states != states[0], axis=0))
        self.log[key] = Choice(
            *place,
            load=tuple(load.tolist()),
            nodes=tuple(nodes.tolist()),
            solutions=len(options),
            taken=taken,
            states=tuple(tuple(row) for row in states[:, nodes].tolist()),
        )
        return taken - 1

    def _by_rule(self, options: list[_Option]) -> int:
        """Return the number, from 1, of the continuation that the rule takes."""
        if not isinstance(self.rule, str):
            return self.rule
        if self.rule == FIRST:
            return 1
        left = list(range(len(options)))
        every = np.array([option.dissipation for option in options])
        for rates in (every if self.rule == LEAST else -every).T:
            # of equal rates the next term decides
            close = rates[left].min() + 1e-9 * np.abs(rates).max()
            left = [k for k in left if rates[k] <= close]
        return left[0] + 1

    def text(self) -> str:
        """Return in words which choices were made."""
        if not self.log:
            text = "no choice between several continuations was made on the way"
            place = "cycle {}, leg {}, s = {:.6g}".format(*min(self.unsure, default=(0, 0, 0.0)))
            return text + f", but not all were searched (first in {place})" * bool(self.unsure)
        parts = [
            f"cycle {c.cycle}, leg {c.leg}, s = {c.s:.6g} (nodes {list(c.nodes)[:3]}, "
            f"{c.taken} of {c.solutions})"
            for c in self.choices[:3]
        ]
        more = f" and {len(self.log) - 3} more" if len(self.log) > 3 else ""
        return (
            f"choices between several continuations were made before, in {'; '.join(parts)}{more}: "
            "another one may go on (solver.branch, or rf.branches for all)"
        )


def chooser_for(rule: str | int, choices: tuple[Choice, ...] = ()) -> Chooser | None:
    """Return a chooser with a rule that repeats given choices; None for the first continuation."""
    return None if rule == FIRST and not choices else Chooser(rule, by_key(choices))


def by_key(choices: Iterable[Choice]) -> dict[Key, Choice]:
    """Return choices in their order by cycle, leg, and number on the leg."""
    found: dict[Key, Choice] = {}
    for choice in choices:
        number = sum(key[:2] == (choice.cycle, choice.leg) for key in found)
        found[choice.cycle, choice.leg, number] = choice
    return found


def _option_of(segments: Segments, y: Array, state: States, segment: Segment) -> _Option:
    """Return a continuation along a leg with its dissipation -Q dv, -dQ dv / 2."""
    n = segments.system.n
    a, b = segments.shares
    touches = segments.frictional & (state >= 3)
    rate = np.where(touches, segment.q[:n], 0.0)
    Q, dQ = (a * z[A * n : B * n] - b * z[B * n :] for z in (y, segment.q))
    change = segment.q[: 2 * n] * segments.weight[: 2 * n]
    return _Option(segment, state, change, (-float(Q @ rate), -0.5 * float(dQ @ rate)))


def _static_option(segments: Segments, start: ContactState, end: ContactState) -> _Option:
    """Return the end of a leg from rest with its dissipation."""
    change, n = end.u - start.u, segments.system.n
    slip = np.where(segments.frictional & (end.state != 2), change[:n], 0.0)
    dissipation = -0.5 * float(end.Q @ slip)
    return _Option(end, end.state, change * segments.weight[: 2 * n], (dissipation, 0.0))
