"""Legs followed by the compiled loop, and what it asks for on its way.

The loop has the tableau of :class:`~receding_fenicsx.interface.exact.segments.Segments`. Rates that
it cannot make (singular exchanges, columns that are left out, imbalance) are made there, round-off
is removed on the way, and ends are refined and checked by reactions evaluated afresh. A leg that it
cannot follow to its end is left to :class:`~receding_fenicsx.interface.exact.walk.Walk`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact import kernel
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.legs import LegProblem, widen
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.round_off import IMBALANCE_GROWTH, NODAL_IMBALANCE, summed
from receding_fenicsx.interface.exact.segments import (
    CACHE_BYTES,
    EPSILON,
    RATE_TOLERANCE,
    UNREFINABLE_ROUND_OFFS,
    Segments,
    States,
)
from receding_fenicsx.interface.exact.tableau import EXCHANGES, MAX_AGE, SMOOTH_EXCHANGES
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.residual import reachable, residual_at_rest
from receding_fenicsx.interface.system import ContactState, Leg, reactions

FIRST_ENTRIES = 256
"""Sets of states for which there is memory at first."""

WORTH_LEAVING_OUT = 0.1
"""Part of the columns that can be left out in addition, from which the tableau is made anew."""

ENDS_KEPT = 4
"""Ends of legs whose factors are kept."""

SINGULAR_FACTOR = 1e-9
"""Pivot of a factor over the largest one up to which it is singular."""

ON_THE_WAY = 0.1
"""Part of the residual accepted at an event up to which errors of nodal forces stay on the way."""


class ActiveSet(NamedTuple):
    """Freedoms that the states at an end of a leg leave free, and the forces that vanish there.

    Attributes:
        free: (m,) tangential freedoms of nodes that do not stick, then normal ones of open nodes.
        friction: (k,) coefficients c of the k tangential ones, whose forces Q + c P vanish.
    """

    free: Ints
    friction: Array

    def forces(self, state: ContactState) -> Array:
        """Return the (m,) forces that vanish but for round-off."""
        wrong, k = state.r[self.free], len(self.friction)
        wrong[:k] += self.friction * state.P[self.free[:k]]
        return wrong


class ActiveSets:
    """Factors of the stiffness in the states at ends of legs, which return from cycle to cycle."""

    def __init__(self, segments: Segments) -> None:
        """Start with none."""
        self._segments = segments
        self._sets: dict[bytes, ActiveSet] = {}
        self._factors: dict[bytes, Any] = {}

    def of(self, state: States) -> ActiveSet:
        """Return what the given states (N,) leave free."""
        key = state.tobytes()
        if key not in self._sets:
            segments, n = self._segments, self._segments.system.n
            loose, limited = ~segments.system.held[:n], segments.frictional | segments.smooth
            t = np.flatnonzero(loose & (~segments.frictional | (state != STICK)))
            free = np.append(t, n + np.flatnonzero(limited & (state == SEPARATION)))
            slip = segments.system.friction.at_slip(state)
            friction = np.where(segments.frictional, slip, 0.0)[t]
            _keep(self._sets, key, ActiveSet(free, friction))
        return self._sets[key]

    def correction(self, state: ContactState) -> Array:
        """Return the change (2N,) of displacements that brings the forces to zero.

        Raises:
            SingularExchange: the states leave a motion without stiffness.
        """
        key, (free, friction) = state.state.tobytes(), self.of(state.state)
        n, change = self._segments.system.n, np.zeros(len(state.u))
        if not len(free):
            return change
        if key not in self._factors:
            K, k = self._segments.system.K, len(friction)
            M = K[np.ix_(free, free)]
            M[:k] += friction[:, None] * K[np.ix_(n + free[:k], free)]
            factor = sla.lu_factor(M, overwrite_a=True, check_finite=False)
            size = np.abs(np.diagonal(factor[0]))
            if size.min() <= SINGULAR_FACTOR * size.max():
                raise SingularExchange
            _keep(self._factors, key, factor)
        forces = self.of(state.state).forces(state)
        change[free] = -sla.lu_solve(self._factors[key], forces, check_finite=False)
        return change


def _keep(some: dict[bytes, Any], key: bytes, one: Any) -> None:
    """Keep one more, at most ``ENDS_KEPT`` of them."""
    if len(some) == ENDS_KEPT:
        del some[next(iter(some))]
    some[key] = one


class CompiledPath:
    """Follows legs by the compiled loop; keeps the rates of known states from leg to leg."""

    def __init__(self, segments: Segments) -> None:
        """Prepare for the contact of ``segments``, whose tableau is shared."""
        self.segments, self.system = segments, segments.system
        system, n = segments.system, segments.system.n
        exchanges = np.full((2, 5, 5, 4), -1)
        for table, smooth_or_not in ((SMOOTH_EXCHANGES, 0), (EXCHANGES, 1)):
            for (old, new), pairs in table.items():
                kinds = [kind for pair in pairs for kind in pair]
                exchanges[smooth_or_not, old, new, : len(kinds)] = kinds
        random = np.random.default_rng(0)
        self._random = random
        self._contact = kernel.Contact(
            frictional=segments.frictional.copy(),
            smooth=segments.smooth.copy(),
            weight=segments.weight.copy(),
            share_A=np.array(segments.shares[0]),
            share_B=np.array(segments.shares[1]),
            sums_of_y=np.array(segments.balance.on_y.T, order="C"),
            sums_of_load=np.array(segments.balance.on_load.T, order="C"),
            r_star=np.array(system.r_star, order="C"),
            exchanges=exchanges,
            marks=random.integers(0, 2**63, (n, 5), dtype=np.uint64),
            stiffness=1.0,
            rate_tolerance=RATE_TOLERANCE,
            imbalances=(UNREFINABLE_ROUND_OFFS * EPSILON, RATE_TOLERANCE),
        )
        self._ways: dict[bytes, Any] = {}
        self._memory = self._new_memory(FIRST_ENTRIES)
        self._unlimited = np.tile(~(segments.frictional | segments.smooth), 4)
        self._accepted = ON_THE_WAY * summed(n, EVENT_RESIDUAL)
        self._sets = ActiveSets(segments)
        self._last: tuple[ContactState, Array] | None = None
        self._asked: set[bytes] = set()
        self._room = 8 * n
        self._rate_of_rows: Array | None = None

    @property
    def trials(self) -> int:
        """Sets of states whose rates were computed, as far as they are remembered."""
        return int(self._memory.used[0])

    def _new_memory(self, entries: int) -> kernel.Memory:
        n, loads = self.system.n, len(self.system.r_star)
        return kernel.Memory(
            table=np.full(4 * entries, -1, dtype=np.int32),
            used=np.zeros(1, dtype=np.int64),
            mark=np.empty(entries, dtype=np.uint64),
            state=np.empty((entries, n), dtype=np.int8),
            rates=np.empty((entries, 4 * n)),
            threshold=np.empty(entries),
            reversed_nodes=np.empty(entries, dtype=np.int32),
            hit=np.empty(entries, dtype=np.int32),
            stroke=np.empty((entries, loads)),
            imbalance=np.empty((entries, len(self._contact.sums_of_y))),
            resting=np.empty(entries, dtype=np.int32),
        )

    def _enlarge(self) -> None:
        """Make room for more sets of states; forget all where the memory is full."""
        old = self._memory
        entries = len(old.rates)
        if 2 * old.rates.nbytes > CACHE_BYTES:
            old.table[:], old.used[0] = -1, 0
            return
        self._memory = new = self._new_memory(2 * entries)
        for name in kernel.Memory._fields[2:]:
            getattr(new, name)[:entries] = getattr(old, name)
        new.used[0], last = entries, len(new.table) - 1
        places = (old.mark & np.uint64(last)).astype(np.int64)
        for entry, place in enumerate(places.tolist()):
            while new.table[place] >= 0:
                place = (place + 1) & last
            new.table[place] = entry

    def _way(self, problem: LegProblem) -> kernel.Way:
        a, b = problem.ends
        marks = []
        for direction in (b - a, a - b):
            key = (direction + 0.0).tobytes()
            if key not in self._ways:
                self._ways[key] = self._random.integers(0, 2**63, dtype=np.uint64)
            marks.append(self._ways[key])
        return kernel.Way(
            start=a.copy(),
            direction=b - a,
            mark=marks[0],
            back=marks[1],
            on_limit=np.where(self._unlimited, -1.0, self.segments.limit * problem.force_scale),
            accepted=self._accepted * problem.force_scale,
            sample_at=np.array(problem.samples),
        )

    def _path(self, problem: LegProblem) -> kernel.Path:
        start, n, samples = problem.start, self.system.n, len(problem.samples)
        if self._last is not None and self._last[0] is start:
            y = self._last[1]
        else:
            y = self.segments.values(start)
        room, stops = self._room, self._room if samples else 0
        return kernel.Path(
            y=y,
            state=start.state.astype(np.int8),
            place=np.zeros(2),
            counts=np.zeros(8, dtype=np.int64),
            dissipation=np.zeros(n),
            work=np.zeros(len(self.system.r_star)),
            imbalance=self.segments.balance.errors(y, problem.ends[0]),
            violated=np.zeros(n, dtype=np.int64),
            event_at=np.empty(room),
            event=np.empty((room, 3), dtype=np.int64),
            tie_at=np.empty(room),
            tie=np.empty((room, 3), dtype=np.int64),
            stop_at=np.empty(stops),
            stop=np.empty((stops, 4 * n)),
            sample=np.empty((samples, 4 * n)),
            sample_state=np.empty((samples, n), dtype=np.int8),
        )

    def follow(self, problem: LegProblem) -> Leg | None:
        """Follow a leg on which forces act from its start to its end.

        Args:
            problem: the leg; its force scale includes the held reactions at both ends.

        Returns:
            The leg, without its ties at the start; None where it is left to the cold path.
        """
        way, path = self._way(problem), self._path(problem)
        try:
            path = self._run(problem, way, path)
            scale, load = problem.force_scale, problem.ends[1]
            if np.abs(path.imbalance).max() > summed(self.system.n, EVENT_RESIDUAL) * scale:
                return None
            reached = self._at(path, load)
            end = self._refined(reached, load, scale)
        except (SingularExchange, _GivenUp):
            return None
        scale = max(scale, float(np.abs(end.r).max(initial=0.0)))
        residual = residual_at_rest(self.system, end, scale)
        if residual > EVENT_RESIDUAL and residual > reachable(self.system, end.u, scale):
            return None
        self._last = (end, path.y if end is reached else self.segments.values(end))
        return self._leg(problem, path, end, residual, scale)

    def leave_out(
        self, state: NDArray[np.int8], changed: NDArray[np.bool_], opened: NDArray[np.bool_]
    ) -> None:
        """Leave out the columns of nodes that stick and have not changed, where they are many.

        Args:
            state: (N,) present states.
            changed: (N,) nodes that have changed their states.
            opened: (N,) those that have opened or closed.
        """
        asked = state.tobytes() + changed.tobytes() + opened.tobytes()
        if asked in self._asked:
            return
        self._asked.add(asked)
        stay_v = (state == STICK) & ~widen(changed)
        stay_w = (state != SEPARATION) & ~widen(opened)
        inputs = np.flatnonzero(np.concatenate([stay_v, stay_w]))
        if len(inputs) > self.segments.left_out + WORTH_LEAVING_OUT * 2 * self.system.n:
            self.segments.leave_out(state, inputs)

    def _run(self, problem: LegProblem, way: kernel.Way, path: kernel.Path) -> kernel.Path:
        """Run the loop up to the end of the leg; answer what it asks for."""
        segments, up_to_date = self.segments, 0
        while True:
            tableau = segments.tableau_at_hand(path.state)
            if segments.is_special:  # it is one with pinned motions
                raise _GivenUp
            pivots = tableau.matrix
            count = np.array([pivots.pending, pivots.age, up_to_date])
            matrix = kernel.Matrix(
                T=pivots.T,
                U=pivots.U.T,
                V=pivots.V,
                counts=count,
                rate=self._rate(len(pivots.T)),
                row_label=pivots.row_label,
                column_label=pivots.column_label,
                row_of=pivots.row_of,
                column_of=pivots.column_of,
                state=tableau.state,
                singular=pivots.singular,
                oldest=MAX_AGE * len(pivots.T),
            )
            contact = self._contact._replace(stiffness=tableau.unit)
            request = kernel.follow(contact, matrix, self._memory, way, path)
            pivots.pending, pivots.age, up_to_date = count.tolist()
            if request == kernel.DONE:
                return path
            if request == kernel.PENDING:
                pivots.apply_pending()
            elif request == kernel.MEMORY:
                self._enlarge()
            elif request == kernel.ROOM:
                self._room *= 2
                path = _enlarged(path, self._room)
            elif request == kernel.BALANCE:
                way = self._balanced(problem, way, path)
            elif request == kernel.RATES:
                self._rates(way, path)
                up_to_date = 0
            else:
                raise _GivenUp

    def _rate(self, m: int) -> Array:
        """Return the array of the rates of the tableau's outputs, kept from call to call."""
        if self._rate_of_rows is None or len(self._rate_of_rows) != m:
            self._rate_of_rows = np.empty(m)
        return self._rate_of_rows

    def _rates(self, way: kernel.Way, path: kernel.Path) -> None:
        """Take the rates of the present states from the cold path, which refines them."""
        segments = self.segments
        if np.any(segments.tableau_at_hand(path.state).state == kernel.HALF_WAY):
            segments.tableau(path.state, renew=True)
        segment = segments.at(path.state.copy(), way.direction)
        if self._memory.used[0] == len(self._memory.rates):
            self._enlarge()
        mark = way.mark ^ np.bitwise_xor.reduce(
            self._contact.marks[np.arange(self.system.n), path.state]
        )
        self._memory.rates[self._memory.used[0]] = segment.q
        kernel.kept(self._contact, self._memory, way, mark, path.state)
        self._memory.used[0] += 1

    def _balanced(self, problem: LegProblem, way: kernel.Way, path: kernel.Path) -> kernel.Way:
        """Remove the imbalance of forces and displacements; return the leg with what is left."""
        load = problem.load(path.place[0])
        state = self._refined(self._at(path, load), load, problem.force_scale)
        path.y[:] = self.segments.values(state)
        path.imbalance[:] = self.segments.balance.errors(path.y, load)
        left = float(np.abs(path.imbalance).max())
        accepted = max(self._accepted * problem.force_scale, IMBALANCE_GROWTH * left)
        if accepted > EVENT_RESIDUAL * problem.force_scale:
            raise _GivenUp
        return way._replace(accepted=accepted)

    def _at(self, path: kernel.Path, load: Array) -> ContactState:
        """Return the state at the present place, with reactions evaluated afresh."""
        return self._of(path.y, path.state, load)

    def _of(self, y: Array, state: NDArray[np.int8], load: Array) -> ContactState:
        n = self.system.n
        u = np.concatenate([y[:n], y[n : 2 * n] - self.system.g0])
        return ContactState(u, reactions(self.system, load, u), state.copy())

    def _refined(self, state: ContactState, load: Array, scale: float) -> ContactState:
        """Return a state, refined by one step unless the forces that vanish are round-off."""
        if np.abs(self._sets.of(state.state).forces(state)).max(initial=0.0) <= (
            NODAL_IMBALANCE * scale
        ):
            return state
        if self.segments.is_near(state.state):
            n = self.system.n
            change = self.segments.tableau(state.state).correction(state.r)[: 2 * n]
        else:
            change = self._sets.correction(state)
        u = state.u + change
        return ContactState(u, reactions(self.system, load, u), state.state)

    def _leg(
        self,
        problem: LegProblem,
        path: kernel.Path,
        end: ContactState,
        residual: float,
        scale: float,
    ) -> Leg:
        """Return what has been followed."""
        counts = path.counts.tolist()
        events, ties = counts[kernel.EVENTS], counts[kernel.TIES]
        stops, samples = counts[kernel.STOPS], counts[kernel.SAMPLES]
        places = problem.samples[:samples]
        states = [
            self._of(y, state, problem.load(s))
            for s, y, state in zip(places, path.sample, path.sample_state, strict=True)
        ]
        n, made = self.system.n, []
        if problem.samples:
            gaps = np.concatenate([np.zeros(n), self.system.g0])
            made = [(0.0, problem.start.u)] + [
                (s, y[: 2 * n] - gaps)
                for s, y in zip(path.stop_at[:stops].tolist(), path.stop[:stops], strict=True)
            ]
            states[-1] = end if places[-1] == 1.0 else states[-1]
        return Leg(
            end=end,
            dissipation=path.dissipation,
            work=float(path.work.sum()),
            residual=residual,
            force_scale=scale,
            samples=list(zip(places, states, strict=True)),
            events=_changes(path.event_at[:events], path.event[:events]),
            stops=made,
            ties=_changes(path.tie_at[:ties], path.tie[:ties]),
        )


class _GivenUp(Exception):
    """The leg is left to the cold path."""


def _changes(at: Array, what: NDArray[np.int64]) -> Changes:
    """Return changes given by places (k,) and (k, 3) nodes, old and new states, as copies."""
    states = what[:, 1:].astype(np.int8)
    return Changes(at.copy(), what[:, 0].copy(), states[:, 0], states[:, 1])


def _enlarged(path: kernel.Path, room: int) -> kernel.Path:
    """Return the same with room for more events."""

    def larger(array: NDArray[Any]) -> NDArray[Any]:
        new = np.empty((room, *array.shape[1:]), dtype=array.dtype)
        new[: len(array)] = array
        return new

    names = ["event_at", "event", "tie_at", "tie"]
    if len(path.stop_at):
        names += ["stop_at", "stop"]
    larger_ones: dict[str, Any] = {name: larger(getattr(path, name)) for name in names}
    return path._replace(**larger_ones)
