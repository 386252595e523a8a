"""Events in sets of states not met before, found in the rows of the tableau and verified together.

Most new sets of states follow one another without any doubt: one node reaches a limit and changes
its state, some others may cease to slip. Such events are found in the order of the tableau's rows,

    h = min value / -rate,    value <- value + h rate,    one exchange,

without a look at anything else. Then the conditions of the walk are evaluated for all sets at once:
the rates balance, no slip is against its direction, what sits on its limit does not fall, no
quantity has passed its limit, and displacements and forces balance at the events. Events are
accepted up to the first that does not hold; from there the walk goes on by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import daxpy

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Sums, sum_rows
from receding_fenicsx.interface.exact.consistency import ConsistentStates, state_after
from receding_fenicsx.interface.exact.legs import SIMULTANEOUS, Change, Course, PathPoint
from receding_fenicsx.interface.exact.replay.chain import leading
from receding_fenicsx.interface.exact.replay.events import passed_by_round_off
from receding_fenicsx.interface.exact.round_off import RoundOff
from receding_fenicsx.interface.exact.segments import (
    EPSILON,
    RATE_IMBALANCE,
    RATE_TOLERANCE,
    SHORTEST_REACH,
    UNREFINABLE_ROUND_OFFS,
    Following,
    Segment,
    Segments,
)
from receding_fenicsx.interface.exact.tableau import EXCHANGES, SMOOTH_EXCHANGES, Tableau, V
from receding_fenicsx.interface.law import SEPARATION, SLIP_SIGN

LONGEST = 128
"""Events verified together at most."""

WORTH_WHILE, PER_KNOWN, PER_LOST = 5, 0.6, 1.5
"""New sets of states from which the search takes less time than to look at each by itself; so many
more for each known one among them, and for each event found that is not accepted."""

MOST_KNOWN = 8
"""Known sets at which the search ends, twice the new ones between them taken off: what is known is
passed in less time by what is known of it, but a few are not worth the way back of the tableau."""

LONGEST_PAUSE = 256
"""New sets looked at by themselves after searches that were not worth while, at most."""

MOST_CHANGES = 5
"""Changes of state at one event up to which it is passed here."""

ZERO = 1e-30
"""What counts as zero, over the largest nodal force: a value below it would divide by zero."""

INFINITE = 1e40
"""Factor on a rate of slip, so that it is taken for violated at once where it is reversed."""

VIOLATED = 1e16
"""Inverse time to the next event, per leg, from which a condition is violated here and now."""


@dataclass
class Found:
    """Events found, not verified yet: k events and the k + 1 sets of states between them.

    Attributes:
        h: k lengths up to each event from the one before.
        labels: k quantities that reach their limits.
        changes: changes of state at each event.
        known: rates in the set of states after each event where they were known before, else None.
        rates: (k + 1 or more, m) rates of the rows in each set.
        rows: (k + 1 or more, m) labels of the rows.
        states: (k + 1 or more, N) states.
    """

    rates: Array
    rows: NDArray[np.intp]
    states: NDArray[np.int8]
    h: list[float] = field(default_factory=list)
    labels: list[int] = field(default_factory=list)
    changes: list[list[Change]] = field(default_factory=list)
    known: list[Segment | None] = field(default_factory=list)

    def rates_by_label(self, n_labels: int) -> Array:
        """Return the rates in all sets, (k + 1, n_labels)."""
        k = len(self.h) + 1
        rates = np.zeros((k, n_labels))
        rates.ravel()[self.rows[:k] + n_labels * np.arange(k)[:, None]] = self.rates[:k]
        return rates


class Rows:
    """Quantities in the order of the tableau's rows, and how they change.

    Attributes:
        rate: (m,) rates, displacements multiplied by the unit of the tableau.
        value: (m,) quantities, of no meaning for a slip.
    """

    def __init__(self, tableau: Tableau, direction: Array, y: Array, force_scale: float) -> None:
        """Take them from quantities y (4N,) at the states of the tableau.

        Args:
            tableau: the tableau, whose states are changed.
            direction: (n_loads,) change of the load factors along the leg.
            y: (4N,) quantities.
            force_scale: largest nodal force of the history so far.
        """
        self.tableau, self.matrix = tableau, tableau.matrix
        self.state = tableau.state.copy()
        labels, n = self.matrix.row_label, len(self.state)
        self.rate = self.matrix.of_loads(direction[: tableau.n_carried])
        self._scale, self._small = force_scale, RATE_TOLERANCE * sqrt(self.rate.dot(self.rate))
        self.value = y[labels]
        self.value[labels < 2 * n] *= tableau.unit
        self._factor, self._least = np.full(len(labels), -1.0), np.full(len(labels), ZERO)
        self._tolerance = np.full(len(labels), self._small)
        slips = (labels < n).nonzero()[0]
        self._factor[slips] = -INFINITE * SLIP_SIGN[self.state[labels[slips]]]
        self._least[slips], self._tolerance[slips] = 1.0, INFINITE * self._small
        self._least *= force_scale
        self._above = np.maximum(self.value, self._least)
        self._inverse = np.empty_like(self.rate)

    def first(self) -> tuple[int, float]:
        """Return the row of the quantity that reaches its limit first, and one over the length."""
        inverse = self._inverse
        np.multiply(self.rate, self._factor, inverse)
        np.subtract(inverse, self._tolerance, inverse)
        np.divide(inverse, self._above, inverse)
        k = int(inverse.argmax())
        return k, inverse.item(k)

    def new_state(self, k: int) -> int:
        """Return the state of the node whose quantity in row k is at its limit, or reversed."""
        kind, i = divmod(self.matrix.row_label.item(k), len(self.state))
        old, slip = int(self.state[i]), 0.0
        frictional = bool(self.tableau.frictional[i])
        if frictional and old == SEPARATION:
            slip = self.rate.item(self.matrix.row_of.item(V * len(self.state) + i))
        return state_after(old, 1 << kind, frictional, slip)

    def change(self, k: int, new: int) -> Change | None:
        """Change the state of the node whose quantity in row k is at its limit, or reversed.

        Returns:
            The change; None where it takes more than one exchange, or is singular.
        """
        n, matrix, frictional = len(self.state), self.matrix, self.tableau.frictional
        hit = matrix.row_label.item(k)
        i = hit % n
        old = int(self.state[i])
        pairs = (EXCHANGES if frictional[i] else SMOOTH_EXCHANGES).get((old, new), ())
        if len(pairs) != 1 or not matrix.exchange(hit, pairs[0][1] * n + i):
            return None
        self.state[i] = new
        daxpy(matrix.last_column, self.rate, a=self.rate.item(k))  # in place
        self.value[k] = 0.0
        if pairs[0][1] == V:
            self._factor[k] = -INFINITE * SLIP_SIGN.item(new)
            self._tolerance[k], least = INFINITE * self._small, self._scale
        else:
            self._factor[k], self._tolerance[k], least = -1.0, self._small, ZERO * self._scale
        self._least[k] = self._above[k] = least
        if frictional[i] and SEPARATION in (old, new):
            self._factor[matrix.row_of.item(V * n + i)] = -INFINITE * SLIP_SIGN.item(new)
        return i, old, new

    def move(self, h: float) -> None:
        """Move on by h."""
        daxpy(self.rate, self.value, a=h)  # in place
        self._above = np.maximum(self.value, self._least, out=self._above)


class Ahead:
    """Passes events in new sets of states along one leg.

    Attributes:
        active: whether to do so at all; not where every event is to be looked at by itself.
    """

    def __init__(
        self, segments: Segments, states: ConsistentStates, sums: Sums, round_off: RoundOff
    ) -> None:
        """Prepare for one leg.

        Args:
            segments: rates in known sets of states.
            states: search for consistent states at the present point, which is moved on.
            sums: integrals along the leg.
            round_off: imbalance of displacements and forces.
        """
        self._segments, self._states, self._sums = segments, states, sums
        self._point: PathPoint = states.point
        self._round_off = round_off
        problem = self._point.problem
        unloading = not np.any(problem.ends[1])
        self.active = not (sums.check_all or unloading or problem.chooser is not None)

    def follow(self, segment: Segment, s_end: float, course: Course) -> Segment | None:
        """Pass all events that are found and hold, those near ``s_end`` left out.

        Args:
            segment: rates at the present point, whose states are consistent.
            s_end: place before which the events have to be.
            course: takes the events.

        Returns:
            The rates after the last event passed; None where none was.
        """
        segments, point = self._segments, self._point
        segments.until_ahead -= 1
        if not self.active or segments.until_ahead > 0:
            return None
        tableau = segments.tableau_for(point.state, self._states.direction)
        if tableau is None or not len(tableau.matrix.row_label):  # a body that is held all over
            return None
        self._round_off.remove_if_grown()
        found = self._search(tableau, s_end)
        before = segments.trials
        steps = self._accept(tableau, segment, found, course) if found.h else []
        new, m = segments.trials - before, len(steps)
        lost = len(found.h) - m
        if new >= WORTH_WHILE + PER_KNOWN * (m - new) + PER_LOST * lost:
            segments.pause_ahead = 0
        else:
            segments.pause_ahead = min(2 * segments.pause_ahead + 4, LONGEST_PAUSE)
        segments.until_ahead = segments.pause_ahead
        reach = 2 * m if lost else 2 * segments.reach_ahead
        segments.reach_ahead = min(max(reach, SHORTEST_REACH), LONGEST)
        return steps[-1].segment if steps else None

    def _search(self, tableau: Tableau, s_end: float) -> Found:
        """Find the next events; leave the tableau at the states behind the last one."""
        point, direction, segments = self._point, self._states.direction, self._segments
        rows = Rows(tableau, direction, point.y, self._sums.force_scale)
        m, n, most = len(rows.rate), len(point.state), segments.reach_ahead
        found = Found(
            np.empty((most + 1, m)),
            np.empty((most + 1, m), dtype=np.intp),
            np.empty((most + 1, n), dtype=np.int8),
        )
        left, made, many_known = s_end - point.s, list[Change](), 0
        h, label = 0.0, -1
        while True:
            k, inverse = rows.first()
            if inverse > VIOLATED:
                # at an event some nodes may cease to slip
                i = rows.matrix.row_label.item(k)
                if not made or len(made) == MOST_CHANGES or i >= n or i == made[0][0]:
                    break
                change = rows.change(k, rows.new_state(k))
                if change is None:
                    break
                made.append(change)
                continue
            e = len(found.h)
            if made:
                found.h.append(h)
                found.labels.append(label)
                found.changes.append(sorted(made))
                found.known.append(segments.known(rows.state, direction))
                many_known = max(many_known - 2, 0) if found.known[-1] is None else many_known + 1
                e += 1
            found.rates[e], found.rows[e] = rows.rate, rows.matrix.row_label
            found.states[e] = rows.state
            if e == most or many_known == MOST_KNOWN or inverse * left <= 1.0:
                break
            h, label = -rows.value.item(k) / rows.rate.item(k), rows.matrix.row_label.item(k)
            if h < SIMULTANEOUS or h > left - SIMULTANEOUS:
                break
            left -= h
            rows.move(h)
            change = rows.change(k, rows.new_state(k))
            if change is None:
                break
            made = [change]
        tableau.state = rows.state
        return found

    def _accept(
        self, tableau: Tableau, segment: Segment, found: Found, course: Course
    ) -> list[Following]:
        """Verify events; move on to the last one that holds; return what came of them."""
        segments, point, sums = self._segments, self._point, self._sums
        n, e, s = len(point.state), len(found.h), point.s
        h, labels, event = np.array(found.h), np.array(found.labels), np.arange(e)
        q = found.rates_by_label(4 * n)
        q[:, : 2 * n] *= 1.0 / tableau.unit  # a power of two
        q[0] = segment.q
        y = np.empty_like(q)
        y[0] = point.y
        np.multiply(h[:, None], q[:-1], out=y[1:])
        sum_rows(y)
        passed = passed_by_round_off(segments, sums.force_scale)
        at_event = np.abs(y[event + 1, labels])
        y[event + 1, labels] = 0.0
        errors = segments.balance.errors(q, self._states.direction, of_rates=True)
        below, holds = self._are_consistent(q, y, found.states, errors)
        holds = holds[1:] & below[event, labels] & (at_event <= passed[labels])
        holds &= (y[1:, n:] >= -passed[n:]).all(axis=1)
        balanced = leading(self._round_off.balanced(h, errors))
        m = min(leading(holds), balanced)
        steps = self._remembered(segment, found, m, q, below)
        m = len(steps)
        if m == 0:
            return steps
        places = (point.s + h[:m].cumsum()).tolist()
        for k, (place, step) in enumerate(zip(places, steps, strict=True)):
            if course.sample_at and course.sample_at[0] <= place:
                point.s, point.y[:], point.state = places[k - 1] if k else s, y[k], found.states[k]
                course.sample(point, q[k], place)
            if point.problem.samples:
                course.stops.append((place, point.displacements(y[k + 1])))
            course.add_events(place, step.changes)
        sums.add_stops(places, y[1 : m + 1], found.states[:m])
        point.s, point.y[:], point.state = places[-1], y[m], steps[-1].state
        # what has reached its limit and stays there is exactly zero
        reached = labels[:m]
        point.y[reached[point.y[reached] <= passed[reached]]] = 0.0
        self._round_off.note_balanced()
        if m == balanced < e:
            self._round_off.clear()
        return steps

    def _are_consistent(
        self, q: Array, y: Array, states: NDArray[np.int8], errors: Array
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which of the rates fall, and which sets of states are consistent.

        Args:
            q: (k, 4N) rates in each set.
            y: (k, 4N) quantities at its start.
            states: (k or more, N) states.
            errors: (k, sums) imbalance of the rates.

        Returns:
            (k, 4N) what falls, as in ``Segments.segment``; (k,) sets that hold.
        """
        segments, n = self._segments, len(self._point.state)
        forces = q * segments.weight
        norm, imbalance = norms(forces), np.abs(errors).max(axis=1)
        holds = imbalance <= UNREFINABLE_ROUND_OFFS * EPSILON * norm
        if not holds.all():
            holds |= imbalance <= RATE_IMBALANCE * norms(forces[:, 2 * n :])
        forces[:, :n] *= SLIP_SIGN.take(states[: len(q)], mode="clip")
        below: NDArray[np.bool_] = forces < -RATE_TOLERANCE * norm[:, None]
        on_limit = y[:, n:] <= self._states.on_limit[n:]
        on_limit &= below[:, n:]
        holds &= ~(on_limit.any(axis=1) | below[:, :n].any(axis=1))
        return below, holds

    def _remembered(
        self, segment: Segment, found: Found, m: int, q: Array, below: NDArray[np.bool_]
    ) -> list[Following]:
        """Remember the first m sets of states and what came of their events.

        Args:
            segment: rates at the present point.
            found: the events.
            m: how many of them hold.
            q: (m + 1 or more, 4N) rates in each set.
            below: (m + 1 or more, 4N) what falls.

        Returns:
            What came of the events; fewer than m where something else is known of one.
        """
        segments, direction, steps = self._segments, self._states.direction, list[Following]()
        width = q.shape[1]
        # nonzero takes far less time on a flat array
        flat = below[: m + 1].ravel().nonzero()[0]
        time, falling = -1.0 / q.ravel()[flat], flat % width
        begin = flat.searchsorted(width * np.arange(m + 2)).tolist()
        # the rates of all are kept in one piece
        q, states, nothing = q[1 : m + 1].copy(), found.states[1 : m + 1].copy(), falling[:0]
        for k, (label, changes) in enumerate(zip(found.labels[:m], found.changes, strict=False)):
            state, step, following = states[k], segment.next.get(label), found.known[k]
            if step is not None and step.segment is not following:
                break
            if following is None:
                part = slice(begin[k + 1], begin[k + 2])
                following = Segment(q[k], falling[part], time[part], nothing)
                segments.trials += 1
                segments.keep(state, direction, following)
            elif len(following.reversed_nodes):
                break
            if step is None:
                step = segment.next[label] = Following(label, state, following, changes)
            segment.last, segment = step, following
            steps.append(step)
        return steps


def norms(rows: Array) -> Array:
    """Return the Euclidean norms of rows."""
    norm: Array = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return norm
