"""Exact evolution: from one change of state to the next, without time steps.

Between two changes of state the discrete problem is linear in the load. On each segment the rates of
all quantities are known, the segment ends where a stuck node reaches its friction limit, a pressure
or a gap reaches zero, and the dissipation -integral Q dv is a sum of exact quadratics.

Quantities are kept in one vector y = [v, gap, A, B], A = Q + f P, B = f P - Q (P in place of A at nodes
without friction), see :mod:`receding_fenicsx.interface.rates`.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface import gauss_seidel
from receding_fenicsx.interface.contact import (
    Array,
    ContactState,
    ContactSystem,
    Leg,
    State,
    largest_force,
    law_residual,
    local_stiffness,
    reactions,
    round_off,
)
from receding_fenicsx.interface.contact_lcp import Undecided, solve_states
from receding_fenicsx.interface.rates import (
    BACKWARD,
    FORWARD,
    REACTION,
    SEPARATION,
    STICK,
    A,
    B,
    SingularExchange,
    Tableau,
    V,
)

States = NDArray[np.int8]

LIMIT_TOLERANCE = 1e-12
"""Distance from a limit, over the largest nodal force, up to which a node sits on it."""

RATE_TOLERANCE = 1e-11
"""Rate over the largest rate (both as forces) below which it is taken for zero."""

CLOSE_EVENTS = 1e-9
"""Part of the leg within which the next event makes all nodes on limits be looked at together."""

APEX = 1e-9
"""Load left, as a part of the leg's first load, at which a leg to complete unloading is closed."""

STANDING_EVENTS = 20
"""Events per node within ``CLOSE_EVENTS`` of one place after which the path counts as stuck there."""

ALL_AT_ONCE = 3
"""Rounds in which all violating nodes change state together; afterwards only the worst does."""

CACHED_BYTES = 2**26
"""Memory for the rates of sets of states that have been met before."""

REFINED_ABOVE = 1e-13
"""Round-off of the residual above which rates are refined once: stiff, nearly incompressible bodies."""

RIGID_TOLERANCE = 1e-8
"""Distance from a unit rigid motion within which a motion of the contact is rigid."""

EVENT_RESIDUAL = 1e-11
"""Largest residual of the contact law, freshly evaluated, that is accepted after any event."""

CORRECTED_LEGS = 10
"""Legs between two corrections of round-off once all sets of states on the way are known."""

CHECKED_EVENTS = 32
"""Events, evenly spread over a leg with new sets of states, whose residual is evaluated afresh.

The residual at the end of every leg is always evaluated afresh."""


@dataclass(frozen=True)
class Segment:
    """Rates along a leg in one set of states, ready for the event search.

    Attributes:
        q: (4N,) rates of y per unit of s.
        falling: labels of quantities that must stay >= 0 and fall.
        time: (len(falling),) -1 / rate of each.
        dissipating: (4N,) |rate of v|/2 at the label of 2 f P (B or A) of slipping nodes, else 0.
        reversed_nodes: slipping nodes whose rate contradicts their state.
        stroke: (n_loads,) rate of r*_k . u, for the work of the loads.
        next: by the label of the quantity that reached its limit, what came of it: states, segment
            and change (node, old, new).
    """

    q: Array
    falling: NDArray[np.intp]
    time: Array
    dissipating: Array
    reversed_nodes: NDArray[np.intp]
    stroke: Array
    next: dict[int, tuple[States, Segment, tuple[int, int, int]]] = field(default_factory=dict)


class EventPath:
    """Follows legs exactly; keeps the tableau and the rates of known states from leg to leg."""

    def __init__(self, system: ContactSystem, check_all: bool = False) -> None:
        """Prepare for ``system`` in 2N form.

        Args:
            system: the condensed body, ``kind = "frictional"``.
            check_all: evaluate the residual afresh after every event.
        """
        self.system, self.check_all = system, check_all
        n = system.n
        loose = ~system.held[:n]
        normal = ~system.held[n:]
        self.frictional = loose & normal & (system.f > 0.0)
        self.smooth = normal & ~self.frictional
        self.stiffness = local_stiffness(system)
        force = 1.0 / np.maximum(1.0, system.f)
        # brings every entry of y to the size of a nodal force
        self.weight = np.concatenate([*self.stiffness, force, force])
        self.tableau: Tableau | None = None
        self.cache: OrderedDict[bytes, Array] = OrderedDict()
        self.segments: OrderedDict[tuple[bytes, bytes], Segment] = OrderedDict()
        self.lifts_freely = _has_rigid(system, np.repeat([0.0, 1.0], n))
        self.slides_freely = _has_rigid(system, np.repeat([1.0, 0.0], n))
        self.ill_conditioned = False
        self.trials = self.legs_since_correction = 0

    # -- one leg ---------------------------------------------------------------------------------

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg from its start to its end.

        Args:
            start: state at the start.
            ends: (n_loads,) load factors at the start and at the end.
            force_scale: largest nodal force of the history so far.
            samples: number of evenly spaced states to keep, the last one at s = 1; 0 for none.

        Returns:
            The traced leg.

        Raises:
            NoEquilibrium: lift-off or gross sliding, with the load factor where it happens.
            NoQuasiStaticContinuation: the rate problem has no solution.
            SolveError: the residual of the contact law is above its tolerance.
        """
        a, b = ends
        if self._is_unloaded(a) and not np.any(start.r):
            return self._from_rest(start, b, force_scale, samples)
        crossing = self._crosses_zero(a, b)
        if crossing is not None:
            return self._through_zero(start, ends, crossing, force_scale, samples)
        walk = _Walk(self, start, a, b, force_scale, samples)
        apex = self._is_unloaded(b) and self.lifts_freely
        walk.run(1.0 - APEX if apex else 1.0)
        return walk.finish(apex)

    def static_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float
    ) -> Leg:
        """Jump to the end of a leg: a static problem with slip counted from ``start``."""
        return self._from_rest(start, ends[1], force_scale, 0)

    def _is_unloaded(self, load: Array) -> bool:
        """Return whether all loads vanish on a contact that fits without gaps."""
        return not np.any(load) and not np.any(self.system.g0)

    def _crosses_zero(self, a: Array, b: Array) -> float | None:
        """Return the s inside the leg at which all loads vanish together, or None."""
        if not self._is_unloaded(np.zeros_like(a)) or not self.lifts_freely:
            return None
        s = float(a @ (a - b)) / float((a - b) @ (a - b))
        at_s = (1.0 - s) * a + s * b
        return s if 0.0 < s < 1.0 and np.abs(at_s).max() <= APEX * np.abs(a).max() else None

    def _through_zero(
        self,
        start: ContactState,
        ends: tuple[Array, Array],
        s0: float,
        force_scale: float,
        samples: int,
    ) -> Leg:
        """Follow a leg through complete unloading as two."""
        zero = np.zeros_like(ends[0])
        first = self.trace_leg(start, (ends[0], zero), force_scale, samples)
        second = self.trace_leg(first.end, (zero, ends[1]), first.force_scale, samples)
        both = [(s * s0, state) for s, state in first.samples]
        both += [(s0 + s * (1.0 - s0), state) for s, state in second.samples]
        return Leg(
            end=second.end,
            dissipation=first.dissipation + second.dissipation,
            work=first.work + second.work,
            residual=max(first.residual, second.residual),
            force_scale=second.force_scale,
            samples=both,
            events=[(s * s0, *rest) for s, *rest in first.events]
            + [(s0 + s * (1.0 - s0), *rest) for s, *rest in second.events],
        )

    def _from_rest(self, start: ContactState, load: Array, force_scale: float, samples: int) -> Leg:
        """First loading from rest: the solution is proportional to the load (section 1.1)."""
        end = self.static(start, load)
        if end is None:
            raise NoEquilibrium(
                f"no equilibrium under the load factors {load.tolist()}: the loads lift or slide the body "
                "off the plane; check their signs, or add a [[support]]"
            )
        change = end.u - start.u
        n = self.system.n
        scale = largest_force(self.system, load, end.r, force_scale)
        slip = np.where(end.state == SEPARATION, 0.0, change[:n])
        self.ill_conditioned |= round_off(self.system, end.u, scale) > REFINED_ABOVE
        leg = Leg(
            end=end,
            dissipation=-0.5 * end.Q * np.where(self.system.held[:n], 0.0, slip),
            work=0.5 * float(load @ self.system.r_star @ change),
            residual=_relative_residual(self.system, end, change[:n], self.stiffness, scale),
            force_scale=scale,
        )
        for j in range(1, samples + 1):
            s = j / samples
            leg.samples.append((s, ContactState(start.u + s * change, s * end.r, end.state)))
        changed = np.flatnonzero(end.state != start.state)
        leg.events = [(0.0, int(i), int(start.state[i]), int(end.state[i])) for i in changed]
        return leg

    def static(self, start: ContactState, load: Array) -> ContactState | None:
        """Solve one static problem from ``start`` to ``load``; None when there is no solution found.

        Gauss-Seidel with polish comes first, the finite method when it does not converge.
        """
        system, n = self.system, self.system.n
        options = gauss_seidel.GaussSeidelOptions(max_sweeps=max(400, 4 * n), residual_tolerance=1e-13)
        try:
            return gauss_seidel.solve_step(system, start, load, options).end
        except SolveError:
            pass
        all_nodes = np.arange(n)
        nothing = np.zeros(0, dtype=np.intp)
        u0 = np.concatenate([start.v, np.where(system.held[n:], start.w, -system.g0)])
        kinds = Undecided(nothing, nothing, all_nodes[self.frictional], all_nodes[self.smooth])
        free_v = np.flatnonzero(~system.held[:n] & ~self.frictional)
        state = solve_states(system, reactions(system, load, u0), kinds, free_v)
        if state is None:
            return None
        state[state == 0] = STICK
        return self._settle(ContactState(u0, start.r, state), load)

    def _settle(self, trial: ContactState, load: Array) -> ContactState | None:
        """Return the state with displacements that satisfy its equations, None if the law is broken."""
        try:
            tableau = self._tableau(trial.state)
        except SingularExchange:
            return None
        u = trial.u.copy()
        for _ in range(2):
            u = u + self._correction(tableau, trial.state, reactions(self.system, load, u))
        end = ContactState(u, reactions(self.system, load, u), trial.state)
        slip = end.v - trial.v
        scale = largest_force(self.system, load, end.r, 0.0)
        residual = _relative_residual(self.system, end, slip, self.stiffness, scale)
        return end if residual <= EVENT_RESIDUAL else None

    # -- rates ---------------------------------------------------------------------------------------

    def _tableau(self, state: States) -> Tableau:
        if self.tableau is None:
            self.tableau = Tableau(self.system, state)
        else:
            self.tableau.move_to(state)
        return self.tableau

    def segment(self, state: States, direction: Array) -> Segment:
        """Return the rates in the given states along a leg whose loads change by ``direction``."""
        key = state.tobytes()
        known = self.segments.get((key, direction.tobytes()))
        if known is not None:
            return known
        rates = self.cache.get(key)
        if rates is None:
            self.trials += 1
            tableau = self._tableau(state)
            rates = tableau.rates()[: 4 * self.system.n]
            if self.ill_conditioned:
                rates = self._refined(tableau, state, rates)
            self.cache[key] = rates
            if len(self.cache) * rates.nbytes > CACHED_BYTES:
                self.cache.popitem(last=False)
        made = self._make_segment(state, rates @ direction)
        self.segments[key, direction.tobytes()] = made
        if len(self.segments) * 2 * made.q.nbytes > CACHED_BYTES:
            self.segments.popitem(last=False)
        return made

    def _make_segment(self, state: States, q: Array) -> Segment:
        n = self.system.n
        scale = float(np.abs(q * self.weight).max())
        threshold = RATE_TOLERANCE * scale / self.weight
        falling = np.flatnonzero(self.bounded(state) & (q < -threshold))
        sign = (state == FORWARD).astype(float) - (state == BACKWARD)
        slipping = np.flatnonzero(sign)
        speed = sign[slipping] * q[slipping]
        dissipating = np.zeros(4 * n)
        dissipating[slipping + np.where(sign[slipping] > 0.0, 3 * n, 2 * n)] = 0.5 * speed
        wrong = slipping[speed < -threshold[slipping]]
        stroke = self.system.r_star @ q[: 2 * n]
        return Segment(q, falling, -1.0 / q[falling], dissipating, wrong, stroke)

    def bounded(self, state: States) -> NDArray[np.bool_]:
        """Return (4N,) which quantities must stay >= 0 in the given states."""
        open_ = state == SEPARATION
        contact = (self.frictional | self.smooth) & ~open_
        return np.concatenate([
            np.zeros(len(state), dtype=bool),
            open_,
            contact & (state != FORWARD),
            contact & self.frictional & (state != BACKWARD),
        ])

    def _correction(self, tableau: Tableau, state: States, r: Array) -> Array:
        """Return the change of displacement that brings every input back to zero.

        Args:
            tableau: in these states.
            state: (N,) states.
            r: (2N,) reactions, or (2N, k) rates of reaction.

        Returns:
            (2N,) or (2N, k) change of displacement.
        """
        n = self.system.n
        f = self.system.f if r.ndim == 1 else self.system.f[:, None]
        Q, P = r[:n], r[n:]
        open_ = state == SEPARATION
        nodes = (
            np.flatnonzero(self.frictional & (open_ | (state == FORWARD))),
            np.flatnonzero(self.frictional & (open_ | (state == BACKWARD))),
            np.flatnonzero(self.smooth & open_),
            np.flatnonzero(~self.system.held[:n] & ~self.frictional),
        )
        quantities = (Q + f * P, f * P - Q, P, Q)
        kinds = (A, B, A, REACTION)
        labels = [kind * n + i for kind, i in zip(kinds, nodes, strict=True)]
        change = [-quantity[i] for quantity, i in zip(quantities, nodes, strict=True)]
        return tableau.response(np.concatenate(labels), np.concatenate(change))[: 2 * n]

    def correct(self, state: ContactState, load: Array) -> ContactState:
        """Return the state with round-off of the path removed: one step of iterative refinement."""
        tableau = self._tableau(state.state)
        r = reactions(self.system, load, state.u)
        u = state.u + self._correction(tableau, state.state, r)
        return ContactState(u, reactions(self.system, load, u), state.state)

    def _refined(self, tableau: Tableau, state: States, rates: Array) -> Array:
        """Return rates after one step of iterative refinement, for ill-conditioned bodies."""
        n = self.system.n
        du = rates[: 2 * n]
        dr = self.system.r_star.T + self.system.K @ du
        du = du + self._correction(tableau, state, dr)
        dr = self.system.r_star.T + self.system.K @ du
        f, contact = self.system.f[:, None], (state != SEPARATION)[:, None]
        forward = np.where(self.smooth[:, None], dr[n:], dr[:n] + f * dr[n:])
        backward = f * dr[n:] - dr[:n]
        stick_a = contact & (state != FORWARD)[:, None]
        stick_b = contact & (self.frictional & (state != BACKWARD))[:, None]
        return np.vstack([du, np.where(stick_a, forward, 0.0), np.where(stick_b, backward, 0.0)])

    def values(self, state: ContactState) -> Array:
        """Return y = [v, gap, A, B]; quantities that the states fix get their exact value."""
        n, f = self.system.n, self.system.f
        forward = np.where(self.smooth, state.P, state.Q + f * state.P)
        backward = f * state.P - state.Q
        contact = state.state != SEPARATION
        gap = np.where(contact & (self.frictional | self.smooth), 0.0, self.system.g0 + state.w)
        forward = np.where(contact & (state.state != FORWARD), forward, 0.0)
        backward = np.where(contact & self.frictional & (state.state != BACKWARD), backward, 0.0)
        y = np.concatenate([state.v, gap, forward, backward])
        mask = self.bounded(state.state)
        y[mask] = np.maximum(y[mask], 0.0)
        return y

    # -- changes of state ---------------------------------------------------------------------------

    def undecided(self, y: Array, state: States, force_scale: float) -> Undecided:
        """Return the nodes that sit on a limit, sorted by which limit."""
        n = self.system.n
        on = (y * self.weight <= LIMIT_TOLERANCE * force_scale).reshape(4, n)
        contact = state != SEPARATION
        touching = np.where(contact, on[2] & (on[3] | ~self.frictional), on[1])
        F = self.frictional & contact & ~touching
        return Undecided(
            np.flatnonzero(F & ((state == FORWARD) | (on[2] & (state == STICK)))),
            np.flatnonzero(F & ((state == BACKWARD) | (on[3] & (state == STICK)))),
            np.flatnonzero(self.frictional & touching),
            np.flatnonzero(self.smooth & touching),
        )


class _Walk:
    """One leg under way."""

    def __init__(
        self, path: EventPath, start: ContactState, a: Array, b: Array, force_scale: float, samples: int
    ) -> None:
        self.path, self.system, self.a, self.b = path, path.system, a, b
        self.direction = b - a
        self.s, self.trials_before = 0.0, path.trials
        self.progress_at, self.standing = 0.0, 0
        self.state = start.state.copy()
        self.y = path.values(start)
        self.force_scale = largest_force(self.system, a, start.r, force_scale)
        self.sample_at = [j / samples for j in range(1, samples + 1)]
        n = self.system.n
        self.leg = Leg(end=start, dissipation=np.zeros(n), force_scale=self.force_scale)
        self.to_check: list[tuple[float, Array, States, Array]] = []
        self.work = 0.0
        self.dissipation = np.zeros(4 * n)

    def load(self, s: float) -> Array:
        """Return the load factors at s."""
        return (1.0 - s) * self.a + s * self.b

    def run(self, s_end: float) -> None:
        """Go from event to event up to ``s_end``."""
        y = self.y
        segment = self._consistent()
        looked_at = True
        while True:
            times = y[segment.falling] * segment.time
            k = int(times.argmin()) if len(times) else -1
            first = float(times[k]) if k >= 0 else np.inf
            if first < CLOSE_EVENTS and not looked_at:
                segment, looked_at = self._consistent(), True
                continue
            ds = min(max(first, 0.0), s_end - self.s)
            if self.sample_at and self.sample_at[0] <= self.s + ds:
                self._sample(segment, self.s + ds)
            last = first >= s_end - self.s
            self._advance(segment, ds)
            if last:
                self.s = s_end
                return
            self._watch_progress()
            segment, looked_at = self._event(int(segment.falling[k]), segment)

    def _advance(self, segment: Segment, ds: float) -> None:
        """Move on by ds: values, exact dissipation and work."""
        y = self.y
        half = 0.5 * ds
        step = half * segment.q
        y += step
        # forward: Q = -B/2, backward: Q = A/2, so -Q dv = (2 f P)/2 |dv|, linear: its middle counts
        self.dissipation += ds * (segment.dissipating * y)
        y += step
        self.work += ds * float(self.load(self.s + half) @ segment.stroke)
        self.s += ds
        if self._wants_check():
            slip = ds * segment.q[: self.system.n]
            self.to_check.append((self.s, y.copy(), self.state.copy(), slip))

    def _event(self, label: int, segment: Segment) -> tuple[Segment, bool]:
        """Pass the event at which a quantity reached its limit; return the new rates.

        Returns:
            The next segment, and whether all nodes on limits have been looked at.
        """
        self.y[label] = 0.0
        known = segment.next.get(label)
        if known is not None:
            self.state, following, change = known
            self.leg.events.append((self.s, *change))
            return following, False
        count = len(self.leg.events)
        following = self._consistent(label, segment)
        changes = self.leg.events[count:]
        # other nodes may have changed because they sat on limits by chance: not to be repeated
        if len(changes) == 1 and changes[0][1] == label % self.system.n:
            segment.next[label] = self.state, following, changes[0][1:]
        return following, True

    def _watch_progress(self) -> None:
        """Raise when events follow each other without end at one place of the leg."""
        if self.s - self.progress_at > CLOSE_EVENTS:
            self.progress_at, self.standing = self.s, 0
        self.standing += 1
        if self.standing > STANDING_EVENTS * self.system.n:
            raise self._explain(self.state, np.zeros(0, dtype=np.intp))

    def _is_new(self) -> bool:
        """Return whether this leg has met sets of states without known rates."""
        return self.path.trials > self.trials_before

    def _wants_check(self) -> bool:
        if self.path.check_all:
            return True
        return self._is_new() and len(self.to_check) < CHECKED_EVENTS and self.s * CHECKED_EVENTS >= len(self.to_check)

    def _sample(self, segment: Segment, s_to: float) -> None:
        """Keep the states asked for on the present segment."""
        n = self.system.n
        while self.sample_at and self.sample_at[0] <= s_to:
            s = self.sample_at.pop(0)
            y = self.y + (s - self.s) * segment.q
            u = np.concatenate([y[:n], y[n : 2 * n] - self.system.g0])
            r = reactions(self.system, self.load(s), u)
            self.leg.samples.append((s, ContactState(u, r, self.state.copy())))

    # -- consistent rates ------------------------------------------------------------------------

    def _consistent(
        self, hit: int | None = None, segment: Segment | None = None
    ) -> Segment:
        """Change states until no node on a limit is driven across it.

        All violating nodes change at first, then the worst one; when a set of states comes back,
        the finite method decides.
        """
        path, before = self.path, self.state
        self.state = state = before.copy()
        seen = {state.tobytes()}
        rounds = 0
        if hit is not None and segment is not None:
            self._change(np.array([hit]), segment)
            seen.add(state.tobytes())
        try:
            while True:
                segment = path.segment(state, self.direction)
                violating = self._violations(segment)
                if len(violating) == 0:
                    break
                rounds += 1
                if rounds > ALL_AT_ONCE:
                    badness = np.abs(segment.q[violating]) * path.weight[violating]
                    violating = violating[[int(np.argmax(badness))]]
                self._change(violating, segment)
                if state.tobytes() in seen or rounds > len(state):
                    segment = self._finite(before)
                    break
                seen.add(state.tobytes())
        except SingularExchange:
            state[:] = before
            segment = self._finite(before)
        changed = np.flatnonzero(state != before)
        self.leg.events += [(self.s, int(i), int(before[i]), int(state[i])) for i in changed]
        return segment

    def _violations(self, segment: Segment) -> NDArray[np.intp]:
        """Return labels of quantities on their limit that are driven across it."""
        y, weight = self.y, self.path.weight
        fall = segment.falling
        on_limit = fall[y[fall] * weight[fall] <= LIMIT_TOLERANCE * self.force_scale]
        return np.concatenate([segment.reversed_nodes, on_limit])

    def _change(self, labels: NDArray[np.intp], segment: Segment) -> None:
        """Give each node of the violated quantities the state on the other side of its limit."""
        n, state, y = self.system.n, self.state, self.y
        chosen: dict[int, list[int]] = {}
        for label in labels.tolist():
            chosen.setdefault(label % n, []).append(label // n)
        for i, kinds in chosen.items():
            old = state[i]
            if not self.path.frictional[i]:
                state[i] = SEPARATION if old == STICK else STICK
            elif old == SEPARATION:
                state[i] = STICK
            elif old in (FORWARD, BACKWARD):
                state[i] = STICK if V in kinds else SEPARATION
            elif len(kinds) == 2:
                state[i] = SEPARATION
            else:
                state[i] = FORWARD if kinds[0] == A else BACKWARD
        # what the new states fix, and what is within round-off of its limit, is exactly zero
        nodes = np.fromiter(chosen, dtype=np.intp)
        open_ = state[nodes] == SEPARATION
        for kind in (A, B):
            at = kind * n + nodes
            on = y[at] * self.path.weight[at] <= LIMIT_TOLERANCE * self.force_scale
            y[at[on | open_]] = 0.0

    def _finite(self, before: States) -> Segment:
        """Decide the nodes on limits by linear complementarity; explain when nothing is possible."""
        path, system, n = self.path, self.system, self.system.n
        undecided = path.undecided(self.y, before, self.force_scale)
        free_v = np.flatnonzero(~system.held[:n] & ~path.frictional)
        decided_open = (before == SEPARATION) & ~np.isin(np.arange(n), undecided.nodes)
        open_n = np.flatnonzero(decided_open & ~system.held[n:])
        open_t = np.flatnonzero(decided_open & path.frictional)
        free = np.concatenate([open_t, free_v, n + open_n])
        try:
            found = solve_states(system, self.direction @ system.r_star, undecided, free)
        except np.linalg.LinAlgError:
            found = None
        if found is not None:
            self.state[:] = np.where(found > 0, found, before)
            try:
                segment = path.segment(self.state, self.direction)
                if len(self._violations(segment)) == 0:
                    return segment
            except SingularExchange:
                pass
        raise self._explain(before, undecided.nodes)

    def _explain(self, before: States, nodes: NDArray[np.intp]) -> SolveError:
        """Return the error for a load at which the path ends."""
        path = self.path
        load = ", ".join(f"{value:.9g}" for value in self.load(self.s))
        where = f"at load factors [{load}] (s = {self.s:.9g} of the leg)"
        contact = before != SEPARATION
        loose = contact & path.frictional
        reach = self.y.reshape(4, -1)[:, loose]
        limit = LIMIT_TOLERANCE * self.force_scale
        if path.lifts_freely and np.all(self.y.reshape(4, -1)[2:][:, contact].sum(axis=0) <= limit):
            return NoEquilibrium(f"lift-off {where}: no pressure is left on the contact; beyond it nothing holds")
        if path.slides_freely and loose.any() and (np.all(reach[2] <= limit) or np.all(reach[3] <= limit)):
            return NoEquilibrium(
                f"gross sliding {where}: every node in contact is at the friction limit in the same direction"
            )
        listed = ", ".join(str(i) for i in nodes[:12].tolist()) + (" ..." if len(nodes) > 12 else "")
        return NoQuasiStaticContinuation(
            f"no quasi-static continuation {where}: the rates of nodes [{listed}] have no solution; "
            "the body jumps here; reduce the friction or the load range"
        )

    # -- the end -------------------------------------------------------------------------------------

    def finish(self, apex: bool) -> Leg:
        """Return the leg: fresh reactions, round-off removed, residual checked."""
        path, leg, n, system = self.path, self.leg, self.system.n, self.system
        u = np.concatenate([self.y[:n], self.y[n : 2 * n] - system.g0])
        load = self.load(self.s)
        end = ContactState(u, reactions(system, load, u), self.state.copy())
        path.legs_since_correction += 1
        due = path.ill_conditioned or path.legs_since_correction >= CORRECTED_LEGS
        if self._is_new() or due:
            end = path.correct(end, load)
            path.legs_since_correction = 0
        self._check(end)
        if apex:
            end = ContactState(self._rest(end), np.zeros(2 * n), end.state)
            leg.samples += [(s, end) for s in self.sample_at]
        leg.dissipation = self.dissipation[2 * n : 3 * n] + self.dissipation[3 * n :]
        leg.end, leg.work, leg.force_scale = end, self.work, self.force_scale
        return leg

    def _rest(self, end: ContactState) -> Array:
        """Return the displacements of the unloaded body: the rigid sliding that has been reached."""
        n = self.system.n
        u = np.zeros(2 * n)
        if self.path.slides_freely:
            u[:n] = end.v.mean()
        u[:n][self.system.held[:n]] = end.v[self.system.held[:n]]
        return u

    def _check(self, end: ContactState) -> None:
        """Evaluate the residual afresh at the end and at the chosen events."""
        n, system = self.system.n, self.system
        self.force_scale = largest_force(system, self.load(self.s), end.r, self.force_scale)
        worst = self._slipless(end)
        for s, y, state, slip in self.to_check:
            u = np.concatenate([y[:n], y[n : 2 * n] - system.g0])
            r = reactions(system, self.load(s), u)
            moved = np.where((state == FORWARD) | (state == BACKWARD), slip, 0.0)
            self.force_scale = largest_force(system, self.load(s), r, self.force_scale)
            now = ContactState(u, r, state)
            worst = max(worst, _relative_residual(system, now, moved, self.path.stiffness, self.force_scale))
        self.leg.residual = worst
        if worst > EVENT_RESIDUAL:
            raise SolveError(
                f"the exact path lost accuracy before load factors {self.load(self.s).tolist()}: residual "
                f"{worst:.1e} over {EVENT_RESIDUAL:.0e}; use method gauss-seidel and report this scene"
            )

    def _slipless(self, end: ContactState) -> float:
        """Return the residual at the end, a slipping node being required to sit on its limit."""
        f = self.system.f
        sign = (end.state == FORWARD).astype(float) - (end.state == BACKWARD)
        worst = _relative_residual(
            self.system, end, np.zeros(self.system.n), self.path.stiffness, self.force_scale
        )
        on_limit = np.abs(end.Q + sign * f * end.P)[sign != 0.0]
        return max(worst, float(on_limit.max(initial=0.0)) / self.force_scale)


def _has_rigid(system: ContactSystem, motion: Array) -> bool:
    """Return whether ``motion`` of the contact nodes is a combination of the rigid ones left free."""
    if system.rigid.shape[1] == 0:
        return False
    weights = np.linalg.lstsq(system.rigid, motion, rcond=None)[0]
    return bool(np.abs(system.rigid @ weights - motion).max() <= RIGID_TOLERANCE)


def _relative_residual(
    system: ContactSystem, state: ContactState, slip: Array, stiffness: tuple[Array, Array], scale: float
) -> float:
    """Return the largest entry of the law's residual over the force scale."""
    if scale == 0.0:
        return 0.0
    return float(law_residual(system, state.r, state.u, slip, stiffness).max()) / scale
