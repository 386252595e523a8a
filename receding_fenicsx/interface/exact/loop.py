"""The compiled loop of one contact: its memory, its tableau, and factors of the states at ends."""

from __future__ import annotations

from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.exact import kernel, kernel_data
from receding_fenicsx.interface.exact.legs import LegProblem, widen
from receding_fenicsx.interface.exact.pivot_matrix import Matrix, SingularExchange, apply_pending
from receding_fenicsx.interface.exact.segments import (
    EPSILON,
    UNREFINABLE_ROUND_OFFS,
    Segments,
    States,
    keep,
)
from receding_fenicsx.interface.exact.tableau import KINDS
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.system import ContactState
from receding_fenicsx.interface.tolerances import RATE_TOLERANCE

FIRST_ENTRIES = 256
"""Sets of states for which there is memory at first."""

CACHE_BYTES = 2**28
"""Memory for the rates of sets of states that have been met before."""

_none, _no_labels = np.zeros((1, 1)), np.zeros(1, dtype=np.intp)
NO_MATRIX = Matrix(
    *(_none, _none, _none, np.zeros(3, dtype=np.intp), np.zeros(1), *4 * (_no_labels,)),
    *(np.zeros(1, dtype=np.int8), 1.0, 0.0, 0),
)
"""Stands for a tableau where all rates are asked for."""


class ActiveSet(NamedTuple):
    """Freedoms that the states at an end of a leg leave free, and the forces that vanish there."""

    # (m,) tangential freedoms of nodes that do not stick, then normal ones of open nodes
    free: Ints
    friction: Array  # (k,) coefficients c of the k tangential ones, whose forces Q + c P vanish

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
            keep(self._sets, key, ActiveSet(free, friction))
        return self._sets[key]

    def correction(self, state: States, forces: Array) -> Array:
        """Return the change (2N,) of displacements that brings the (m,) forces to zero.

        Raises:
            SingularExchange: the states leave a motion without stiffness.
        """
        key, (free, friction), n = state.tobytes(), self.of(state), len(state)
        change = np.zeros(2 * n)
        if not len(free):
            return change
        if key not in self._factors:
            K, k = self._segments.system.K, len(friction)
            M = K[np.ix_(free, free)]
            M[:k] += friction[:, None] * K[np.ix_(n + free[:k], free)]
            # lu_factor, which warns of what is checked here
            *factor, _ = sla.lapack.dgetrf(M, overwrite_a=True)
            size = np.abs(np.diagonal(factor[0]))
            if size.min() <= 1e-9 * size.max():
                raise SingularExchange
            keep(self._factors, key, tuple(factor))
        change[free] = sla.lapack.dgetrs(*self._factors[key], -forces)[0]
        return change


def _mark(direction: Array) -> Any:
    """Return a number that tells a direction of loading (n_loads,) from others."""
    digest = blake2b((direction + 0.0).tobytes(), digest_size=8).digest()
    return np.frombuffer(digest, dtype=np.uint64)[0]


class Loop:
    """The compiled loop of one contact; keeps the rates of known states from leg to leg.

    Attributes:
        segments: rates made one by one; their tableau is shared.
        contact: what does not change along a path.
        memory: rates of the sets of states met.
        sets: what the states at ends of legs leave free.
        last: end of the last leg with its quantities y (4N,) and their imbalance, from which the
            next one begins.
        room: number of events for which a path has room at first.
    """

    def __init__(self, segments: Segments) -> None:
        """Prepare for the contact of ``segments``, whose tableau is shared."""
        self.segments, self.system = segments, segments.system
        system, n = segments.system, segments.system.n
        self.contact = kernel_data.Contact(
            frictional=segments.frictional.copy(),
            smooth=segments.smooth.copy(),
            weight=segments.weight.copy(),
            share_A=np.array(segments.shares[0]),
            share_B=np.array(segments.shares[1]),
            sums_of_y=np.array(segments.balance.on_y.T, order="C"),
            sums_of_load=np.array(segments.balance.on_load.T, order="C"),
            r_star=np.array(system.r_star, order="C"),
            exchanges=KINDS,
            marks=np.random.default_rng(0).integers(0, 2**63, (n, 5), dtype=np.uint64),
            rate_tolerance=RATE_TOLERANCE,
            imbalances=(UNREFINABLE_ROUND_OFFS * EPSILON, RATE_TOLERANCE),
        )
        self.memory = self._new_memory(FIRST_ENTRIES)
        self._unlimited = np.tile(~(segments.frictional | segments.smooth), 4)
        # errors of a hundred round-offs a freedom stay on the way
        self._accepted = 100.0 * EPSILON * 2 * n
        self.sets = ActiveSets(segments)
        self.last: tuple[ContactState, Array, Array] | None = None
        self._asked: set[bytes] = set()
        self.room = 8 * n

    def _new_memory(self, entries: int) -> kernel_data.Memory:
        n, loads = self.system.n, len(self.contact.r_star)
        return kernel_data.Memory(
            table=np.full(4 * entries, -1, dtype=np.int32),
            used=np.zeros(1, dtype=np.int64),
            mark=np.empty(entries, dtype=np.uint64),
            state=np.empty((entries, n), dtype=np.int8),
            rates=np.empty((entries, 4 * n)),
            threshold=np.empty(entries),
            reversed_nodes=np.empty(entries, dtype=np.int32),
            hit=np.empty(entries, dtype=np.int32),
            stroke=np.empty((entries, loads)),
            imbalance=np.empty((entries, len(self.contact.sums_of_y))),
            resting=np.empty(entries, dtype=np.int32),
        )

    def enlarge(self) -> None:
        """Make room for more sets of states; forget all where the memory is full."""
        old = self.memory
        entries = len(old.rates)
        if 2 * old.rates.nbytes > CACHE_BYTES:
            old.table[:], old.used[0] = -1, 0
            return
        self.memory = new = self._new_memory(2 * entries)
        for name in kernel_data.Memory._fields[2:]:
            getattr(new, name)[:entries] = getattr(old, name)
        new.used[0], last = entries, len(new.table) - 1
        places = (old.mark & np.uint64(last)).astype(np.int64)
        for entry, place in enumerate(places.tolist()):
            while new.table[place] >= 0:
                place = (place + 1) & last
            new.table[place] = entry

    def way(self, problem: LegProblem, end: float) -> kernel_data.Way:
        """Return a leg up to a place, as the loop takes it."""
        a, b = problem.ends
        return kernel_data.Way(
            start=a.copy(),
            direction=b - a,
            mark=_mark(b - a),
            back=_mark(a - b),
            on_limit=np.where(self._unlimited, -1.0, self.segments.limit * problem.force_scale),
            accepted=self._accepted * problem.force_scale,
            sample_at=np.array(problem.samples),
            end=end,
            unloading=0.0,
            asks_rates=False,
            asks_choice=problem.chooser is not None,
        )

    def path(self, problem: LegProblem, traced: bool) -> kernel_data.Path:
        """Return a path that stands at the start of a leg."""
        start, n, samples = problem.start, self.system.n, len(problem.samples)
        load, accepted = problem.load(problem.s_start), self._accepted * problem.force_scale
        if self.last is not None and self.last[0] is start:
            y, imbalance = (part.copy() for part in self.last[1:])  # another walk may begin here
        else:
            y = self.segments.values(start)
            imbalance = self.segments.balance.errors(y, load)
        room, stops = self.room, self.room if samples or traced else 0
        counts = np.zeros(len(kernel_data.COUNTS), dtype=np.int64)
        counts[kernel_data.HIT] = -1
        return kernel_data.Path(
            y=y,
            state=start.state.astype(np.int8),
            place=np.array([problem.s_start, problem.s_start, 0.0, accepted, 0.0]),
            counts=counts,
            dissipation=np.zeros(n),
            work=np.zeros(len(load)),
            imbalance=imbalance,
            violated=np.zeros(n, dtype=np.int64),
            event_at=np.empty(room),
            event=np.empty((room, 3), dtype=np.int64),
            tie_at=np.empty(room),
            tie=np.empty((room, 3), dtype=np.int64),
            stop_at=np.empty(stops),
            stop=np.empty((stops, 4 * n)),
            stop_label=np.empty(stops if traced else 0, dtype=np.int64),
            stop_state=np.empty((stops if traced else 0, n), dtype=np.int8),
            stop_rate=np.empty((stops if traced else 0, 4 * n)),
            sample=np.empty((samples, 4 * n)),
            sample_state=np.empty((samples, n), dtype=np.int8),
        )

    def enlarged(self, path: kernel_data.Path) -> kernel_data.Path:
        """Return a path with room for twice as many events."""
        self.room *= 2

        def larger(array: NDArray[Any]) -> NDArray[Any]:
            new = np.empty((self.room, *array.shape[1:]), dtype=array.dtype)
            new[: len(array)] = array
            return new

        names = ["event_at", "event", "tie_at", "tie", "stop_at", "stop"]
        names += ["stop_label", "stop_state", "stop_rate"]
        parts: dict[str, Any] = {name: getattr(path, name) for name in names}
        return path._replace(**{name: larger(old) for name, old in parts.items() if len(old)})

    def advance(self, way: kernel_data.Way, path: kernel_data.Path) -> int:
        """Go on until the end or a request that only others can answer, which is returned.

        Raises:
            SingularExchange: the tableau is not made in the states of the path.
        """
        segments, begun = self.segments, False
        while True:
            matrix = NO_MATRIX
            if not segments.is_loose:
                matrix = segments.tableau_at_hand(path.state).matrix
            if segments.is_loose:  # rates are not those of the tableau as they are
                way = way._replace(asks_rates=True)
            if not begun:
                matrix.counts[2], begun = 0, True
            request: int = kernel.follow(self.contact, matrix, self.memory, way, path)
            if request == kernel.PENDING:
                apply_pending(matrix)
            elif request == kernel.MEMORY:
                self.enlarge()
            else:
                return request

    def ask(self, way: kernel_data.Way, path: kernel_data.Path) -> None:
        """Take the rates of the present states from the segments, which refine them.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        segments, state = self.segments, path.state.copy()
        if not segments.is_loose and np.any(
            segments.tableau_at_hand(state).state == kernel.HALF_WAY
        ):
            segments.tableau(state, renew=True)
        self.fill(way, path, segments.at(state, way.direction).q)
        nodes = np.arange(self.system.n)
        mark = way.mark ^ np.bitwise_xor.reduce(self.contact.marks[nodes, state])
        kernel.kept(self.memory, mark, state)

    def fill(self, way: kernel_data.Way, path: kernel_data.Path, q: Array) -> int:
        """Write rates q (4N,) of the path's states into a new entry of the memory; return it."""
        if self.memory.used[0] == len(self.memory.rates):
            self.enlarge()
        entry = int(self.memory.used[0])
        self.memory.rates[entry] = q
        kernel.filled(self.contact, self.memory, way, path)
        return entry

    def leave_out(
        self, state: NDArray[np.int8], changed: NDArray[np.bool_], opened: NDArray[np.bool_]
    ) -> None:
        """Leave out the columns of nodes that stick and have not changed, where they are many."""
        asked = state.tobytes() + changed.tobytes() + opened.tobytes()
        if asked in self._asked:
            return
        self._asked.add(asked)
        stay_v = (state == STICK) & ~widen(changed)
        stay_w = (state != SEPARATION) & ~widen(opened)
        inputs = np.flatnonzero(np.concatenate([stay_v, stay_w]))
        # a new tableau pays from a tenth of the columns
        if len(inputs) > self.segments.left_out + 0.2 * self.system.n:
            self.segments.leave_out(state, inputs)
