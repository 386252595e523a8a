"""One leg under way: segment after segment, with consistent rates after every change of state."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL, Sums, Watch
from receding_fenicsx.interface.exact.failures import explain
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.rolling import middle
from receding_fenicsx.interface.exact.segments import EPSILON, Segment, Segments, States
from receding_fenicsx.interface.exact.tableau import A, B, V
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import Undecided, is_exhaustible, solve_states
from receding_fenicsx.interface.residual import REACHABLE_AT_MOST, ROUND_OFFS, residual_at_rest
from receding_fenicsx.interface.system import Array, ContactState, Leg, reactions

CLOSE_EVENTS = 1e-9
"""Part of the leg within which the next event makes all nodes on limits be looked at together."""

END_EVENTS = 1e-13
"""Part of the leg before its end in which events are left to the next leg: round-off decides there
whether a closed cycle comes back to where it reversed or just past it."""

UNLOADED = 1e-11
"""Force, over the largest so far, that round-off leaves at the end of complete unloading."""

UNLOADING_EVENTS = 1e-9
"""The same of a leg to no load at all, where all pressures have vanished within round-off."""

INHERITED = 2.0
"""Growth of the residual that a leg may add to that of its start."""

UNCERTAIN_SIGNS, UNCERTAIN_STATES = 8, 64
"""Sets of random signs of round-off by which its effect on the displacements is estimated, and the
last sets of states on a leg in which it is."""

STANDING_EVENTS = 20
"""Events per node within ``CLOSE_EVENTS`` of one place after which the path counts as stuck
there."""

ALL_AT_ONCE = 3
"""Rounds in which all violating nodes change state together; afterwards only the worst does."""

MEASURED_EVENTS = 16
"""Events between two looks at the round-off that the walk has gathered, fewer while it grows
fast."""

IMBALANCE = 1e-12
"""Error of the forces, over the force scale, above which it is cleared."""

CLEARED_GAIN = 2.0
"""How many times what clearing has left it must be as well."""


class Walk:
    """One leg under way.

    Attributes:
        sums: dissipation, work and residual so far.
        equilibrium_ends: place on the leg beyond which statics know of no equilibrium.
        part: where the leg lies on the one that errors tell of.
        excusing: what round-off does to displacements excuses a residual; not where friction so
            small that it is lost in round-off is all that holds them.
    """

    def __init__(
        self,
        segments: Segments,
        start: ContactState,
        ends: tuple[Array, Array],
        force_scale: float,
        samples: int,
        check_all: bool,
        watch: Watch | None = None,
    ) -> None:
        """Stand at the start of a leg.

        Args:
            segments: rates in known sets of states.
            start: state at the start.
            ends: (n_loads,) load factors at the start and at the end.
            force_scale: largest nodal force of the history so far, this leg's held reactions
                included.
            samples: number of evenly spaced states to keep.
            check_all: evaluate the residual afresh after every event.
            watch: looks at every event and at the end; what it finds stands in ``sums.found``.
        """
        self.segments, self.system = segments, segments.system
        self.a, self.b = a, b = ends
        self.direction = b - a
        self.s, self.trials_before = 0.0, segments.trials
        self.progress_at, self.standing = 0.0, 0
        self.unmeasured, self.measured_after, self.cleared_to = 0, MEASURED_EVENTS, 0.0
        self.equilibrium_ends, self.part, self.excusing = np.inf, (0.0, 1.0), True
        self.state = start.state.copy()
        self.y = segments.values(start)
        self.sample_at = [j / samples for j in range(1, samples + 1)]
        n = self.system.n
        self.leg = Leg(end=start, dissipation=np.zeros(n), force_scale=force_scale)
        self.sums = Sums(segments, ends, force_scale, (0.0, self.y, self.state), check_all, watch)
        self._on_limit = segments.limit * force_scale
        self._unloading = not np.any(b)
        self._step = np.zeros(4 * n)

    def load(self, s: float | Array) -> Array:
        """Return the load factors at s: (n_loads,), or (k, n_loads) for s of shape (k, 1)."""
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
            last = first >= s_end - self.s - END_EVENTS
            if self._unloading and not last:
                last = self._unloads(segment, first, s_end)
            ds = s_end - self.s if last else max(first, 0.0)
            if self.sample_at and self.sample_at[0] <= self.s + ds:
                self._sample(segment, self.s + ds)
            self._advance(segment, ds)
            if last:
                self.s = s_end
                return
            if ds <= CLOSE_EVENTS:
                self._watch_progress()
            segment, looked_at = self._event(int(segment.falling[k]), segment)

    def _unloads(self, segment: Segment, first: float, s_end: float) -> bool:
        """Return whether what happens just before a leg ends unloaded is within round-off."""
        left = s_end - self.s
        if left - first > UNLOADING_EVENTS:
            return False
        n, weight = self.system.n, self.segments.weight
        passed = (self.y + left * segment.q) * weight
        # gaps keep the round-off of the displacements that the leg began with
        began = float(np.abs(self.sums.start * weight[: 2 * n]).max())
        allowed = UNLOADED * self.sums.force_scale
        gaps = max(allowed, ROUND_OFFS * EPSILON * began)
        return bool(passed[2 * n :].min() >= -allowed and passed[n : 2 * n].min() >= -gaps)

    def _advance(self, segment: Segment, ds: float) -> None:
        """Move on by ds."""
        self.y += np.multiply(segment.q, ds, out=self._step)
        self.s += ds
        self.sums.pass_stop(self.s, self.y, self.state)

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
            self.unmeasured += 1
            if self.unmeasured >= self.measured_after:
                self._clear_if_due()
            return following, False
        before = self.state
        self.state = before.copy()
        self._change([label])
        try:
            following = self.segments.at(self.state, self.direction)
            alone = len(self._violations(following)) == 0
        except SingularExchange:
            alone = False
        if alone:
            i = label % len(before)
            change = i, int(before[i]), int(self.state[i])
            self.leg.events.append((self.s, *change))
            # where others change too they may sit on limits by chance: not to be repeated
            segment.next[label] = self.state, following, change
        else:
            self.state = before
            following = self._consistent(label)
        self.unmeasured += 1
        if self.unmeasured >= self.measured_after:
            self._clear_if_due()
        return following, True

    def _clear_if_due(self) -> None:
        """Clear the round-off of the walk where it has grown.

        Only in the new states: in the old ones the round-off of all nodes at their limit would be
        laid upon the one that has just reached it.
        """
        self.unmeasured = 0
        accepted = max(IMBALANCE * self.sums.force_scale, CLEARED_GAIN * self.cleared_to)
        due = self._imbalance() > accepted
        self.measured_after = self.measured_after // 2 if due else 2 * self.measured_after
        self.measured_after = min(max(self.measured_after, 1), MEASURED_EVENTS)
        if due:
            # what is cleared is no slip
            self.sums.add_up()
            self._clear()
            self.sums.go_on_from(self.s, self.y, self.state)

    def _clear(self) -> ContactState:
        """Clear the round-off of the walk by one step of iterative refinement; return the state."""
        n, system, load = self.system.n, self.system, self.load(self.s)
        u = np.concatenate([self.y[:n], self.y[n : 2 * n] - system.g0])
        u += self.segments.tableau(self.state).correction(reactions(system, load, u))[: 2 * n]
        now = ContactState(u, reactions(system, load, u), self.state.copy())
        self.y[:] = self.segments.values(now)
        self.cleared_to = self._imbalance()
        return now

    def _imbalance(self) -> float:
        """Return by how much forces and displacements do not belong together."""
        return self.segments.imbalance(self.y, self.load(self.s))

    def _watch_progress(self) -> None:
        """Raise when events follow each other without end at one place of the leg."""
        if self.s - self.progress_at > CLOSE_EVENTS:
            self.progress_at, self.standing = self.s, 0
        self.standing += 1
        if self.standing > STANDING_EVENTS * self.system.n:
            raise self._explain(self.state, np.zeros(0, dtype=np.intp))

    def _is_new(self) -> bool:
        """Return whether this leg has met sets of states without known rates."""
        return self.segments.trials > self.trials_before

    def _sample(self, segment: Segment, s_to: float) -> None:
        """Keep the states asked for on the present segment."""
        n = self.system.n
        while self.sample_at and self.sample_at[0] <= s_to:
            s = self.sample_at.pop(0)
            y = self.y + (s - self.s) * segment.q
            u = np.concatenate([y[:n], y[n : 2 * n] - self.system.g0])
            r = reactions(self.system, self.load(s), u)
            self.leg.samples.append((s, ContactState(u, r, self.state.copy())))

    def _consistent(self, hit: int | None = None) -> Segment:
        """Change states until no node on a limit is driven across it.

        All violating nodes change at first, then the worst one; when a set of states comes back,
        the finite method decides.
        """
        segments, before = self.segments, self.state
        self.state = state = before.copy()
        seen = {state.tobytes()}
        rounds = 0
        if hit is not None:
            self._change([hit])
            seen.add(state.tobytes())
        try:
            while True:
                segment = segments.at(state, self.direction)
                violating = self._violations(segment)
                if len(violating) == 0:
                    break
                rounds += 1
                if rounds > ALL_AT_ONCE:
                    badness = np.abs(segment.q[violating]) * segments.weight[violating]
                    violating = violating[[int(np.argmax(badness))]]
                self._change(violating.tolist())
                if state.tobytes() in seen or rounds > len(state):
                    segment = self._finite(before)
                    break
                seen.add(state.tobytes())
        except SingularExchange:
            state[:] = before
            segment = self._finite(before)
        for i in (state != before).nonzero()[0].tolist():
            self.leg.events.append((self.s, i, int(before[i]), int(state[i])))
        return segment

    def _violations(self, segment: Segment) -> NDArray[np.intp]:
        """Return labels of quantities on their limit that are driven across it."""
        fall = segment.falling
        on_limit = fall[self.y[fall] <= self._on_limit[fall]]
        if not len(segment.reversed_nodes):
            return on_limit
        return np.concatenate([segment.reversed_nodes, on_limit])

    def _change(self, labels: list[int]) -> None:
        """Give each node of the violated quantities the state on the other side of its limit."""
        n, state, y, on_limit = len(self.state), self.state, self.y, self._on_limit
        kinds_of: dict[int, int] = {}
        for label in labels:
            kind, i = divmod(label, n)
            kinds_of[i] = kinds_of.get(i, 0) | 1 << kind
        frictional = self.segments.frictional
        for i, kinds in kinds_of.items():
            old = int(state[i])
            if not frictional[i]:
                new = SEPARATION if old == STICK else STICK
            elif old == SEPARATION:
                new = STICK
            elif old >= FORWARD:
                new = STICK if kinds & 1 << V else SEPARATION
            elif kinds == 1 << A:
                new = FORWARD
            else:
                new = BACKWARD if kinds == 1 << B else SEPARATION
            state[i] = new
            # what the new states fix, and what is within round-off of its limit, is exactly zero
            a, b = A * n + i, B * n + i
            if new == SEPARATION or y[a] <= on_limit[a]:
                y[a] = 0.0
            if new == SEPARATION or y[b] <= on_limit[b]:
                y[b] = 0.0

    def _finite(self, before: States) -> Segment:
        """Decide the nodes on limits by linear complementarity, or say why that cannot be."""
        if self.s >= self.equilibrium_ends - CLOSE_EVENTS:
            raise self._explain(before, self._undecided(before).nodes)
        segment, exhausted = self._pivoted(before)
        if segment is None and self._roll(before):
            self.state[:] = before
            with suppress(SingularExchange):  # the loads turn the body on
                segment = self.segments.at(self.state, self.direction)
            if segment is not None and len(self._violations(segment)):
                segment, exhausted = self._pivoted(before)
        if segment is None:
            raise self._explain(before, self._undecided(before).nodes, exhausted)
        return segment

    def _undecided(self, before: States) -> Undecided:
        """Return the nodes that sit on a limit."""
        return self.segments.undecided(self.y, before, self.sums.force_scale)

    def _pivoted(self, before: States) -> tuple[Segment | None, bool]:
        """Return the segment that linear complementarity finds, None where it finds none.

        The second value tells whether all sets of states were tried.
        """
        segments, system, n = self.segments, self.system, self.system.n
        undecided = self._undecided(before)
        free_v = np.flatnonzero(~system.held[:n] & ~segments.frictional)
        decided_open = (before == SEPARATION) & ~np.isin(np.arange(n), undecided.nodes)
        open_n = np.flatnonzero(decided_open & ~system.held[n:])
        open_t = np.flatnonzero(decided_open & segments.frictional)
        free = np.concatenate([open_t, free_v, n + open_n])
        try:
            found = solve_states(system, self.direction @ system.r_star, undecided, free)
        except np.linalg.LinAlgError:
            return None, False
        if found is None:
            return None, is_exhaustible(undecided)
        self.state[:] = np.where(found > 0, found, before)
        try:
            segment = segments.at(self.state, self.direction)
        except SingularExchange:
            return None, False
        return (None if len(self._violations(segment)) else segment), False

    def _roll(self, before: States) -> bool:
        """Roll a body that balances on its contact away from the nodes that it is about to touch.

        Which way it leans nothing says: it is laid in the middle, where nodes on both sides are
        equally far.

        Returns:
            Whether there is such a rolling.
        """
        n = self.system.n
        motion = self.segments.neutral(np.where(before == SEPARATION, before, STICK))
        open_ = (before == SEPARATION) & ~self.system.held[n:]
        rolled = middle(motion, self.y[n : 2 * n], open_)
        if rolled is None:
            return False
        self.sums.add_up()
        self.y[: 2 * n] += rolled
        self.y[n : 2 * n][~open_] = 0.0
        self.sums.go_on_from(self.s, self.y, before)
        return True

    def _explain(
        self, before: States, nodes: NDArray[np.intp], exhausted: bool = False
    ) -> SolveError:
        """Return the error for the place at which the path ends."""
        place = self.load(self.s), self.part[0] + self.s * (self.part[1] - self.part[0])
        return explain(
            self.segments, before, self.y, place, self.sums.force_scale, nodes, exhausted
        )

    def finish(self, apex: bool) -> Leg:
        """Return the leg: fresh reactions, residual checked.

        The round-off of the walk is cleared after a leg with new sets of states, and where it has
        grown.

        Args:
            apex: the leg ends at complete unloading.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        leg, n, system, sums = self.leg, self.system.n, self.system, self.sums
        sums.add_up()
        if self._is_new() or self._imbalance() > IMBALANCE * sums.force_scale:
            end, last = self._cleared_end()
        else:
            u = np.concatenate([self.y[:n], self.y[n : 2 * n] - system.g0])
            end = ContactState(u, reactions(system, self.load(self.s), u), self.state.copy())
            last = self._residual_of(end)
            if last > EVENT_RESIDUAL and last > sums.accepted(end.u):
                end, last = self._cleared_end()
        leg.residual = max(sums.residual, last)
        beyond = last > EVENT_RESIDUAL and last > sums.accepted(end.u)
        doubtful = sums.excess > 0.0 or beyond
        if doubtful and not (self.excusing and leg.residual <= self._uncertainty(leg.end, end)):
            raise SolveError(
                f"the exact path lost accuracy before load factors {self.load(self.s).tolist()}: "
                f"residual {leg.residual:.1e} over {EVENT_RESIDUAL:.0e}; use method gauss-seidel"
            )
        if apex:
            end = ContactState(self._rest(end), np.zeros(2 * n), end.state)
            leg.samples += [(s, end) for s in self.sample_at]
        leg.dissipation, leg.work = sums.dissipation, float(sums.work.sum())
        leg.end, leg.force_scale = end, sums.force_scale
        return leg

    def _cleared_end(self) -> tuple[ContactState, float]:
        """Clear the round-off of the walk; return the state and its residual."""
        end = self._clear()
        return end, self._residual_of(end)

    def _residual_of(self, end: ContactState) -> float:
        """Return the residual at one instant; of a part of a contact, the whole is looked at."""
        scale = max(self.sums.force_scale, float(np.abs(end.r).max(initial=0.0)))
        self.sums.force_scale = scale
        return residual_at_rest(self.system, end, scale) if self.sums.watch is None else 0.0

    def _uncertainty(self, *states: ContactState) -> float:
        """Return the residual that round-off may leave in gaps and slips, over the force scale.

        Displacements are uncertain by what round-off of the reactions does to them: in a nearly
        singular body far more than the forces are. Stuck nodes keep what the leg began with.

        Args:
            states: at the leg's start and at its end.
        """
        n, largest, now = self.system.n, 0.0, states[0].state.copy()
        reach = np.abs(self.system.K) @ np.max([np.abs(state.u) for state in states], axis=0)
        signs = np.random.default_rng(0).choice([-EPSILON, EPSILON], (UNCERTAIN_SIGNS, 2 * n))
        met = {now.tobytes(): now.copy()}
        for _, i, _, new in self.leg.events:
            now[i] = new
            met[now.tobytes()] = now.copy()
        for state in list(met.values())[-UNCERTAIN_STATES:]:
            tableau = self.segments.tableau(state)
            for error in signs * reach:
                change = tableau.correction(error)[: 2 * n] * self.segments.weight[: 2 * n]
                largest = max(largest, float(np.abs(change).max()))
        scale = self.sums.force_scale
        kept = INHERITED * residual_at_rest(self.system, states[0], scale)
        return min(max(kept, ROUND_OFFS * largest / scale), REACHABLE_AT_MOST)

    def stop_here(self) -> Leg:
        """Return what was followed up to the place where no way on was found.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        self.state = self.sums.state.copy()
        return self.finish(False)

    def _rest(self, end: ContactState) -> Array:
        """Return the displacements of the unloaded body, the rigid sliding reached.

        Stuck nodes tell it; all others are still displaced by the load that is left, and by
        round-off.
        """
        n = self.system.n
        u = np.zeros(2 * n)
        if self.segments.slides_freely:
            stuck = self.segments.frictional & (end.state == STICK)
            u[:n] = (end.v[stuck] if stuck.any() else end.v).mean()
        u[:n][self.system.held[:n]] = end.v[self.system.held[:n]]
        return u
