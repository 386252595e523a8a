"""Exact evolution: from one change of state to the next, without time steps.

Between two changes of state the discrete problem is linear in the load. On each segment the rates
of all quantities are known, the segment ends where a stuck node reaches its friction limit, a
pressure or a gap reaches zero, and the dissipation -integral Q dv is a sum of exact quadratics.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.equilibrium import Limit, furthest
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.reduction import Reduction, reduce, widen
from receding_fenicsx.interface.exact.rolling import at_rest
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.static import solve_static
from receding_fenicsx.interface.exact.walk import UNLOADED, UNLOADING_EVENTS, Walk
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION
from receding_fenicsx.interface.residual import (
    largest_force,
    local_stiffness,
    reachable,
    relative_residual,
)
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem, Leg, reactions

APEX = 1e-9
"""Load left, as a part of the leg's first load, at which a leg to complete unloading is closed."""

JUMP_STEP = 1e-7
"""Part of the leg beyond a jump at which the state to jump to is looked for: at the jump itself the
state before is still an equilibrium."""

FAINT = 1e-5
"""Friction below which a path that ends may have been lost in round-off: f P is too small."""

LAST_EVENTS = 1e-11
"""Part of a leg before its end in which what leads nowhere is left to the next leg."""

BEYOND_STATICS = 1e-7
"""Part of a leg by which no path may pass the place where statics say that equilibrium ends."""

JUMPS = 100
"""Jumps on one leg after which it is given up: they follow each other without end."""

REDUCTIONS = 3
"""Choices of the nodes left out that are tried on a leg."""


class EventPath:
    """Follows legs exactly; keeps the tableau and the rates of known states from leg to leg."""

    def __init__(
        self, system: ContactSystem, check_all: bool = False, on_jump: str = "stop"
    ) -> None:
        """Prepare for ``system`` in 2N form.

        Args:
            system: the condensed body, ``kind = "frictional"``.
            check_all: evaluate the residual afresh after every event.
            on_jump: "stop" where no quasi-static path leads on, or step over by one "static"
                problem.
        """
        self.system, self.check_all, self.on_jump = system, check_all, on_jump
        self.segments = Segments(system)
        rubbing = np.flatnonzero(self.segments.frictional)
        f = system.friction.mean
        least = int(rubbing[np.argmin(f[rubbing])]) if len(rubbing) else 0
        self.faint = least if len(rubbing) and f[least] < FAINT else None
        self.jumps = 0
        self.part = 0.0, 1.0
        self.changed: dict[bytes, NDArray[np.bool_]] = {}
        self.reduction: Reduction | None = None
        self.limits: dict[tuple[bytes, bytes], Limit | None] = {}

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
        if not np.any(a) and np.abs(start.r).max(initial=0.0) <= UNLOADED * force_scale:
            if not np.any(b):
                return self._still(start, force_scale, samples)
            if self._is_unloaded(a):
                return self._from_rest(start, b, force_scale, samples)
            laid = self._laid(start, ends)
            leg = self._held_leg(laid, ends, force_scale, samples)
            leg.events = [*changes(0.0, start.state, laid.state), *leg.events]
            return leg
        crossing = self._crosses_zero(a, b)
        if crossing is not None:
            return self._through_zero(start, ends, crossing, force_scale, samples)
        return self._held_leg(start, ends, force_scale, samples)

    def _still(self, start: ContactState, force_scale: float, samples: int) -> Leg:
        """Return a leg on which an unloaded contact stays unloaded."""
        kept = [(j / samples, start) for j in range(1, samples + 1)]
        nothing = np.zeros(self.system.n)
        return Leg(end=start, dissipation=nothing, force_scale=force_scale, samples=kept)

    def _laid(self, start: ContactState, ends: tuple[Array, Array]) -> ContactState:
        """Let an unloaded body with a gap roll to where it rests under the load of a leg."""
        laid = at_rest(self.system, start, ends[1])
        if laid is not start:
            with suppress(SingularExchange):
                # K R is zero up to the round-off of the condensation only
                r = reactions(self.system, ends[0], laid.u)
                laid.u += self.segments.tableau(laid.state).correction(r)[: 2 * self.system.n]
        return laid

    def _held_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int
    ) -> Leg:
        """Follow one leg that begins where the contact holds the body; say where it ends to."""
        a, b = ends
        force_scale = max(largest_force(self.system, load, start.r, force_scale) for load in ends)
        if force_scale == 0.0:  # loads that bear on nothing
            return self._still(start, force_scale, samples)
        try:
            leg = self._trace(start, ends, force_scale, samples)
        except SingularExchange as error:
            raise SolveError(
                f"the exact path is lost on the way to load factors {b.tolist()}: a motion of the "
                "body is left that nothing resists; add a [[support]], or use method gauss-seidel"
            ) from error
        except SolveError as error:
            limit = self._limit(a, b)
            if isinstance(error, NoEquilibrium) and (limit is not None or self.faint is None):
                raise
            if limit is not None:
                raise NoEquilibrium(limit.text) from error
            if self.faint is None:
                raise
            f = float(self.system.friction.mean[self.faint])
            raise SolveError(
                f"the exact path is lost on the way to load factors {b.tolist()}: the friction "
                f"f = {f:.2g} of node {self.faint} is so small that its limit cannot be told "
                f"from round-off; make it 0, or {FAINT:.0e} at least"
            ) from error
        limit = self._limit(a, b)
        if limit is not None and limit.s < 1.0 - BEYOND_STATICS:
            # round-off of a vanishing stiffness has carried the loads
            raise NoEquilibrium(limit.text)
        return leg

    def _trace(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int
    ) -> Leg:
        """Follow one leg that does not begin at rest, in the quickest way that holds."""
        if not self._is_unloaded(ends[1]):
            reduced = self._walk_reduced(start, ends, force_scale, samples)
            if reduced is not None:
                return reduced
        return self._walk(start, ends, force_scale, samples)

    def _walk(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int
    ) -> Leg:
        """Follow one leg from event to event."""
        walk = Walk(self.segments, start, ends, force_scale, samples, self.check_all)
        walk.part, walk.excusing = self.part, self.faint is None
        limit = self._limit(*ends)
        if limit is not None:
            walk.equilibrium_ends = limit.s
        apex = self._is_unloaded(ends[1]) and self.segments.lifts_freely
        try:
            walk.run(1.0 - APEX if apex else 1.0)
        except NoQuasiStaticContinuation:
            unloads = not np.any(ends[1])
            if walk.s >= 1.0 - (UNLOADING_EVENTS if unloads else LAST_EVENTS):
                # nodes come to their limits at the end itself: only round-off is left to decide,
                # and the next leg to say where they go
                walk.s = 1.0
                leg = walk.stop_here()
                leg.samples += [(s, leg.end) for s in walk.sample_at]
                return leg
            if self.on_jump != "static" or self.faint is not None:
                raise
            return self._jump(walk, samples)
        leg = walk.finish(apex)
        self._remember(ends[1] - ends[0], leg)
        return leg

    def _jump(self, walk: Walk, samples: int) -> Leg:
        """Step over the place where a walk has found no way on, and follow the rest of the leg.

        A static problem with slip counted from there is solved at a load just beyond. What the
        jump releases, -(change of 1/2 u K u + sum lambda r* . change of u), is friction and motion
        together and is kept apart from the dissipation.
        """
        a, b, system = walk.a, walk.b, self.system
        factors = ", ".join(f"{value:.9g}" for value in walk.load(walk.s))
        if self.jumps >= JUMPS:
            raise NoQuasiStaticContinuation(
                f"the contact has jumped {JUMPS} times on one leg and jumps again at load factors "
                f"[{factors}]; reduce the friction or the load range"
            )
        before = walk.stop_here()
        s = walk.s + JUMP_STEP
        load = walk.load(s)
        end = solve_static(self.segments, before.end, load) if s < 1.0 else None
        if end is None:
            raise NoQuasiStaticContinuation(
                f"no quasi-static continuation at load factors [{factors}], and no state was found "
                "to jump to; reduce the friction or the load range"
            )
        change = end.u - before.end.u
        stored = 0.5 * float(change @ system.K @ (end.u + before.end.u))
        work = float(load @ system.r_star @ change)
        released = -stored - work
        self.jumps += 1
        try:
            with self._on_part(s, 1.0):
                rest = self.trace_leg(end, (load, b), before.force_scale, samples)
        finally:
            self.jumps -= 1
        before.events += changes(s, before.end.state, end.state)
        leg = joined(before, rest, s)
        leg.work += work
        leg.jumps = [(walk.s, released), *leg.jumps]
        self._remember(b - a, leg)
        return leg

    def _remember(self, direction: Array, leg: Leg) -> None:
        """Remember which nodes changed state on a leg in this direction."""
        changed = self.changed.setdefault(direction.tobytes(), np.zeros(self.system.n, dtype=bool))
        changed[[event[1] for event in leg.events]] = True

    def _walk_reduced(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int
    ) -> Leg | None:
        """Follow a leg with the nodes left out that kept their states on every such leg before.

        Returns:
            The leg; None where there is nothing to leave out, or where that has failed.
        """
        if (ends[1] - ends[0]).tobytes() not in self.changed:
            return None
        for _ in range(REDUCTIONS):
            if self.reduction is None or not self.reduction.fits(start):
                changed = np.logical_or.reduce(list(self.changed.values()))
                slips = (start.state == FORWARD) | (start.state == BACKWARD)
                self.reduction = reduce(self.segments, start, widen(changed | slips))
            if self.reduction is None:
                return None
            reduction = self.reduction
            extended = tuple(np.append(load, 1.0) for load in ends)
            walk = Walk(
                reduction.segments,
                reduction.shrink(start),
                (extended[0], extended[1]),
                force_scale,
                samples,
                self.check_all,
                reduction.leaving,
            )
            try:
                walk.run(1.0)
                leg = walk.finish(False)
            except (SolveError, SingularExchange):
                # found again, and said of the whole contact, by the way without reduction
                return None
            finished = reduction.finish(walk, leg, ends)
            if isinstance(finished, Leg):
                self._remember(ends[1] - ends[0], finished)
                scale, residual = finished.force_scale, finished.residual
                if residual <= EVENT_RESIDUAL:
                    return finished
                return (
                    finished if residual <= reachable(self.system, finished.end.u, scale) else None
                )
            for changed in self.changed.values():
                changed[finished] = True
            self.reduction = None
        return None

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Jump to the end of a leg: a static problem with slip counted from ``start``."""
        return self._from_rest(start, ends[1], force_scale, 0)

    @contextmanager
    def _on_part(self, s_a: float, s_b: float) -> Iterator[None]:
        """Trace a part of the present leg as a leg of its own, places being told of the whole."""
        whole, size = self.part, self.part[1] - self.part[0]
        self.part = whole[0] + s_a * size, whole[0] + s_b * size
        try:
            yield
        finally:
            self.part = whole

    def _is_unloaded(self, load: Array) -> bool:
        """Return whether all loads vanish on a contact that fits without gaps."""
        return not np.any(load) and not np.any(self.system.g0)

    def _crosses_zero(self, a: Array, b: Array) -> float | None:
        """Return the s inside the leg at which all loads vanish together, or None."""
        if np.array_equal(a, b):
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
        with self._on_part(0.0, s0):
            first = self.trace_leg(start, (ends[0], zero), force_scale, samples)
        with self._on_part(s0, 1.0):
            second = self.trace_leg(first.end, (zero, ends[1]), first.force_scale, samples)
        return joined(first, second, s0, s0)

    def _limit(self, a: Array, b: Array) -> Limit | None:
        """Return where equilibrium ends on a leg, None where it does not."""
        key = a.tobytes(), b.tobytes()
        if key not in self.limits:
            self.limits[key] = furthest(self.system, a, b)
        return self.limits[key]

    def _from_rest(self, start: ContactState, load: Array, force_scale: float, samples: int) -> Leg:
        """First loading from rest: the solution is proportional to the load (section 1.1)."""
        limit = self._limit(np.zeros_like(load), load)
        if limit is not None and limit.kind == "lift-off":
            raise NoEquilibrium(
                f"lift-off at load factors {[0] * len(load)}: the load factors {load.tolist()} "
                "pull the body off; check their signs, or add a [[support]]"
            )
        if limit is not None:
            raise NoEquilibrium(limit.text)
        end = solve_static(self.segments, start, load)
        if end is None:
            raise NoEquilibrium(
                f"no equilibrium was found under the load factors {load.tolist()}: they may lift, "
                "tip or slide the body (check their signs, or add a [[support]]), or friction and "
                "Poisson's ratio may be so high that none exists"
            )
        change = end.u - start.u
        n = self.system.n
        scale = largest_force(self.system, load, end.r, force_scale)
        slip = np.where(end.state == SEPARATION, 0.0, change[:n])
        leg = Leg(
            end=end,
            dissipation=-0.5 * end.Q * np.where(self.system.held[:n], 0.0, slip),
            work=0.5 * float(load @ self.system.r_star @ change),
            residual=relative_residual(
                self.system, end, change[:n], local_stiffness(self.system), scale
            ),
            force_scale=scale,
        )
        for j in range(1, samples + 1):
            s = j / samples
            leg.samples.append((s, ContactState(start.u + s * change, s * end.r, end.state)))
        leg.events = changes(0.0, start.state, end.state)
        return leg


def changes(
    s: float, old: NDArray[np.int8], new: NDArray[np.int8]
) -> list[tuple[float, int, int, int]]:
    """Return the events (s, node, old, new) between two sets of states at one place of a leg."""
    return [(s, int(i), int(old[i]), int(new[i])) for i in np.flatnonzero(old != new)]


def joined(first: Leg, second: Leg, s0: float, scale: float = 1.0) -> Leg:
    """Return two legs as one, of which the first takes the part up to s0.

    Args:
        first: its places on the leg are to be multiplied by ``scale``.
        second: its own places run from 0 to 1.
        s0: where the second one begins.
        scale: s0 where the first one's own places run from 0 to 1 as well.
    """

    def late(s: float) -> float:
        return s0 + s * (1.0 - s0)

    return Leg(
        end=second.end,
        dissipation=first.dissipation + second.dissipation,
        work=first.work + second.work,
        residual=max(first.residual, second.residual),
        force_scale=second.force_scale,
        samples=[(s * scale, state) for s, state in first.samples]
        + [(late(s), state) for s, state in second.samples],
        events=[(s * scale, i, old, new) for s, i, old, new in first.events]
        + [(late(s), i, old, new) for s, i, old, new in second.events],
        jumps=[(s * scale, energy) for s, energy in first.jumps]
        + [(late(s), energy) for s, energy in second.jumps],
    )
