"""Path along a leg from one change of branch to the next."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.jumps import (
    check_jumps,
    jump_between,
    lost_by_loose_motion,
    no_state_beyond,
)
from receding_fenicsx.interface.exact.legs import LegProblem, evenly_spaced
from receding_fenicsx.interface.exact.path import LEFT_TO_NEXT_LEG, EventPath
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.rest import carries_nothing, zero_crossing
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.load_steps.path import GaussSeidelPath
from receding_fenicsx.interface.residual import largest_force, reachable, residual_at_rest
from receding_fenicsx.interface.shear_branches.cones import BREAKS, FORMS, Branches, Cones
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg, reactions
from receding_fenicsx.interface.tolerances import (
    ACCEPTED_RESIDUAL,
    END_TOLERANCE,
    JUMP_STEP,
    STEP_ON_LIMIT,
)

CACHE_BYTES = 2**28
"""Memory for the paths of sets of branches that have been met before."""

TRIES = 4
"""Changes of branch per node at one place after which none is taken."""


class BranchedPath:
    """Follows legs of a contact with a shear limit or cohesion.

    Attributes:
        system: the condensed body in 2N form.
        cones: its law, branch by branch.
    """

    def __init__(
        self,
        system: ContactSystem,
        on_jump: str = "stop",
        sweeps: GaussSeidelOptions | None = None,
        steps: int = 0,
    ) -> None:
        """Prepare for ``system``.

        Args:
            system: the condensed body, ``kind = "frictional"``.
            on_jump: "stop" where no quasi-static path continues, or pass the jump by one "static"
                problem.
            sweeps: options of the load steps; None for the exact path.
            steps: load steps a leg.
        """
        self.system, self.cones, self.on_jump = system, Cones(system), on_jump
        self.sweeps, self.steps = sweeps, steps
        self._paths: dict[bytes, tuple[EventPath | GaussSeidelPath, Array]] = {}
        # that of a set of branches: matrices of its tableau, rates of its first sets of states
        size = 96 * system.n**2 + 2**13 * system.n
        self._kept = max(4, CACHE_BYTES // size)
        self._exact = self if sweeps is None else BranchedPath(system, on_jump)

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg, as :meth:`EventPath.trace_leg` does."""
        scale = max(largest_force(self.system, load, start.r, force_scale) for load in ends)
        places = evenly_spaced(samples)
        if self.steps:
            stored = {round((j + 1) * self.steps / samples) for j in range(samples)}
            places = tuple(k / self.steps for k in sorted(stored))
        whole = LegProblem(start, ends, scale, places)
        crossing = zero_crossing(ends)
        targets = {k / self.steps for k in range(1, self.steps + 1)} | {crossing or 1.0, 1.0}
        leg = Leg(start, np.zeros(self.system.n), force_scale=scale, stops=[(0.0, start.u)])
        s = 0.0
        for target in sorted(targets):
            unloaded = not np.any(whole.load(s)) and carries_nothing(leg.end, scale)
            if unloaded and (s == 0.0 or self.sweeps is None):
                # a body with gaps rolls to where it rests
                resting = at_rest(self.system, leg.end, ends[1])
                turned = Changes.between(s, leg.end.state, resting.state)
                leg.events = Changes.joined(leg.events, turned)
                leg.stops.append((s, resting.u))
                leg.end = resting
            follow = self._follow if self.sweeps is None else self._step
            follow(leg, whole, (s, target))
            s = target
        if leg.samples:
            leg.samples[-1] = (places[-1], leg.end)
        return leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Solve one static problem at the end of a leg, slip counted from ``start``.

        Raises:
            SolveError: no state that satisfies the contact law was found.
        """
        scale = max(largest_force(self.system, load, start.r, force_scale) for load in ends)
        problem, now = LegProblem(start, ends, scale), self.cones.branches_of(start)
        tried: set[bytes] = set()
        while True:
            path, force, inner = self._inner(now, problem)
            tried.add(now.key)
            found = path.static_leg(inner.start, inner.ends, scale)
            found = self._outer(found, problem, force, 1.0)
            wrong = self._violated(now, found.end, scale)
            lands = self.cones.cohesive & ~now.bonded & (found.end.state != SEPARATION)
            if not wrong and not lands.any():
                touches = (found.end.state != SEPARATION) & ~self.system.held[: self.system.n]
                slip = np.where(touches, found.end.v - start.v, 0.0)
                found.dissipation = -0.5 * (start.Q + found.end.Q) * slip
                self._check(found)
                return found
            wrong += [(FORMS, i) for i in np.flatnonzero(lands).tolist()]
            now = self._passed(now, wrong, tried, ends[1])

    # -- exact path

    def _follow(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> None:
        """Add the exact path between two places of a leg to what has been followed."""
        (s, target), tried = part, set[bytes]()
        now = self.cones.branches_of(leg.end)
        while s < target:
            tried.add(now.key)
            problem = replace(whole, start=leg.end, s_start=s, force_scale=leg.force_scale)
            trial, end, error = self._piece(now, problem, target)
            no_way = isinstance(error, NoQuasiStaticContinuation)
            at, wrong, ahead = self._first_passed(now, problem, (trial, end), no_way)
            # the branches in use may be changed before as well: fewer pieces
            new = self.cones.passed(now, ahead)
            if ahead and new.key not in tried and len(tried) <= TRIES * self.system.n:
                now = new
                continue
            ends = error is not None and not wrong
            try:
                if ends or at > s + END_TOLERANCE:
                    if not ends and at >= target - END_TOLERANCE:
                        at, error = target, None
                    elif not ends:
                        trial, at, error = self._piece(now, problem, at)
                    self._add(leg, trial, (s, at))
                    s, tried = at, {now.key}
                    if error is not None:
                        raise error
                if s < target:
                    now = self._changed(leg, s, now, wrong, (tried, whole.load(s)))
            except NoQuasiStaticContinuation as lost:
                s = self._jump(leg, whole, (s, target), lost)
                now, tried = self.cones.branches_of(leg.end), set()

    def _jump(
        self, leg: Leg, whole: LegProblem, part: tuple[float, float], error: SolveError
    ) -> float:
        """Pass a jump, where that is asked for, by a static problem; return the place after it."""
        (s, target), start = part, leg.end
        if self.on_jump != "static":
            raise error
        place, beyond = whole.load(s), s + JUMP_STEP
        check_jumps(self.system, len(leg.jumps), place)
        load = whole.load(beyond)
        try:
            if beyond >= target:
                raise error
            end = self.static_leg(start, (place, load), leg.force_scale).end
        except SolveError as lost:
            raise no_state_beyond(self.system, place) from lost
        jump = jump_between(self.system, start, end, load)
        jumped = Changes.between(beyond, start.state, end.state)
        leg.events = Changes.joined(leg.events, jumped)
        leg.stops.append((beyond, end.u))
        leg.jumps.append((s, jump.released))
        leg.end, leg.work = end, leg.work + jump.work
        return beyond

    def _piece(
        self, now: Branches, problem: LegProblem, target: float
    ) -> tuple[Leg, float, SolveError | None]:
        """Follow a piece of a leg in given branches; return it, its end, and why it ends early."""
        path, force, inner = self._inner(now, problem)
        assert isinstance(path, EventPath)
        s, begun, scale = problem.s_start, inner.start, problem.force_scale
        turned = Changes.between(s, problem.start.state, begun.state)
        for load in (inner.load(s), inner.load(target)):
            scale = largest_force(path.system, load, begun.r, scale)
        places = tuple(place for place in problem.samples if s < place < target)
        inner = replace(inner, force_scale=scale, samples=(*places, target))
        found, end, error = None, target, None
        if not np.any(force) and not (np.any(inner.load(s)) and np.any(inner.load(target))):
            # from no load or to none, which a walk does not end at
            whole = inner.piece(begun, (inner.load(s), inner.load(target)), scale, (s, target))
            part = tuple((place - s) / (target - s) for place in inner.samples)
            with suppress(SolveError):
                found = path.trace(replace(whole, samples=part))
                found.events = found.events.placed(target - s, s)
                one = (state for _, state in found.samples)
                found.samples = list(zip(inner.samples, one, strict=False))
                found.stops = [(s + at * (target - s), u) for at, u in found.stops]
        if found is None:
            walk = path.walk(inner)
            try:
                walk.run(target)
            except SingularExchange as lost:
                error = lost_by_loose_motion(self.system, problem.ends[1])
                error.__cause__ = lost
            except SolveError as lost:
                error = lost
            ends = error is not None
            if isinstance(error, NoQuasiStaticContinuation) and walk.s >= 1.0 - LEFT_TO_NEXT_LEG:
                # at the end itself only round-off decides: left to the next leg
                walk.path.place[0], error = 1.0, None
            end, found = walk.s, walk.stop_here() if ends else walk.finish()
        found.events = Changes.joined(turned, found.events)
        found = self._outer(found, problem, force, end)
        found.samples = [(at, one) for at, one in found.samples if at in problem.samples]
        return found, end, error

    def _first_passed(
        self, now: Branches, problem: LegProblem, piece: tuple[Leg, float], no_way: bool
    ) -> tuple[float, list[tuple[int, int]], list[tuple[int, int]]]:
        """Return where another margin first passes zero or a bond forms, its kind and its nodes.

        Where no way leads on from the end of the piece, margins that just reach zero there are
        passed too. The last value names all margins that are passed by nodes which stick until
        then, if the first is one of them.
        """
        found, end = piece
        stops = [(problem.s_start, problem.start.u), *found.stops, (end, found.end.u)]
        s, u = np.array([at for at, _ in stops]), np.array([one for _, one in stops])
        load = (1.0 - s)[:, None] * problem.ends[0] + s[:, None] * problem.ends[1]
        r = load @ self.system.r_star + u @ self.system.K
        margins, in_use = self.cones.other_margins(now, r)
        slack = self._slack(found.end, found.force_scale)
        below = margins < -slack
        first, wrong, ahead = np.inf, list[tuple[int, int]](), list[tuple[int, int]]()
        rows = np.flatnonzero(below.any(axis=(1, 2)))
        if len(rows):
            j = int(rows[0])
            i = max(j - 1, 0)
            before, after = np.maximum(margins[i], 0.0), margins[j]
            with np.errstate(invalid="ignore", divide="ignore"):
                at = np.where(below[j], s[i] + before / (before - after) * (s[j] - s[i]), np.inf)
            first = float(at.min())
            wrong = [(int(k), int(n)) for k, n in np.argwhere(at <= first + END_TOLERANCE)]
            row = np.argmax(below, axis=0)[:2]
            from_stick = below[:, :2].any(axis=0) & (problem.start.state == STICK)
            from_stick &= np.take_along_axis(in_use, row[None], axis=0)[0] > slack
            from_stick &= in_use[0] > slack
            ahead = [(int(k), int(n)) for k, n in np.argwhere(from_stick)]
            if not set(wrong) <= set(ahead):
                ahead = []
        elif no_way:
            tied = (margins[-1, :2] <= slack) & (found.end.state != SEPARATION)
            wrong = [(int(k), int(n)) for k, n in np.argwhere(tied)]
        events = found.events
        forms = self.cones.cohesive[events.node] & ~now.bonded[events.node]
        forms &= events.new != SEPARATION
        if forms.any() and (begin := float(events.s[forms].min())) <= first:
            forms &= events.s <= begin + END_TOLERANCE
            return begin, [(FORMS, node) for node in set(events.node[forms].tolist())], []
        return min(first, end), wrong, ahead

    def _changed(
        self,
        leg: Leg,
        s: float,
        now: Branches,
        wrong: list[tuple[int, int]],
        tried: tuple[set[bytes], Array],
    ) -> Branches:
        """Return the branches beyond a place; form and break bonds there."""
        new = self._passed(now, wrong, *tried)
        opened, bonds = now.bonded & ~new.bonded, new.bonded & ~now.bonded
        state = np.where(bonds, STICK, np.where(opened, SEPARATION, leg.end.state)).astype(np.int8)
        sheared = opened & (np.abs(leg.end.Q) > self._slack(leg.end, leg.force_scale))
        if sheared.any():
            node = int(np.flatnonzero(sheared)[0])
            raise NoQuasiStaticContinuation(
                f"no quasi-static continuation at {self.system.load_text(tried[1])}: node {node} "
                f"(x = {self.system.x[node]:.6g}) opens under the shear force of its cohesion, "
                "which it loses at once; reduce [contact] cohesion or the load range"
            )
        if not np.array_equal(state, leg.end.state):
            leg.events = Changes.joined(leg.events, Changes.between(s, leg.end.state, state))
            leg.end = replace(leg.end, state=state)
        return new

    def _passed(
        self,
        now: Branches,
        wrong: list[tuple[int, int]],
        tried: set[bytes],
        load: Array,
    ) -> Branches:
        """Return branches that were not tried: changed where margins are passed, or at one node.

        Raises:
            NoQuasiStaticContinuation: all of them were tried.
        """
        if not wrong:
            return now
        for some in (wrong, *([one] for one in wrong)):
            new = self.cones.passed(now, some)
            if new.key not in tried and len(tried) <= TRIES * self.system.n + 16:
                return new
        node = wrong[0][1]
        raise NoQuasiStaticContinuation(
            f"no quasi-static continuation at {self.system.load_text(load)}: no branch of the "
            f"shear limit of node {node} (x = {self.system.x[node]:.6g}) leads on; reduce the "
            "friction or the load range"
        )

    # -- load steps

    def _step(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> None:
        """Add one load step: solved in the branches at its end, or exactly where bonds change."""
        found, target = self._solved(leg, whole, part), part[1]
        if found is not None:
            self._add(leg, found, part)
        else:
            events, leg.events = leg.events, Changes.none()
            self._exact._follow(leg, whole, part)
            # those at its start belong to the step too
            at = np.maximum(leg.events.s, np.nextafter(part[0], 1.0))
            leg.events = Changes.joined(events, replace(leg.events, s=at))
        if any(abs(target - place) <= END_TOLERANCE for place in whole.samples):
            leg.samples = [(at, one) for at, one in leg.samples if at < target - END_TOLERANCE]
            leg.samples.append((target, leg.end))

    def _solved(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> Leg | None:
        """Return one load step, None where bonds change or no step is found."""
        (s, target), tried = part, set[bytes]()
        start, scale, load = leg.end, leg.force_scale, whole.load(target)
        now = self.cones.branches_of(start)
        problem = replace(whole, start=start, s_start=s, force_scale=scale)
        # a node that lands begins on its friction
        while not np.any(now.branch[start.state == SEPARATION]):
            tried.add(now.key)
            path, force, inner = self._inner(now, problem)
            assert isinstance(path, GaussSeidelPath)
            steps = path.begin(replace(inner, samples=(), s_start=0.0))
            try:
                path.advance(steps, s, target)
            except (NoEquilibrium, NoQuasiStaticContinuation):
                return None
            found = self._outer(steps.leg, problem, force, target)
            if not np.array_equal(inner.start.state, start.state):
                found.events = Changes.between(target, start.state, found.end.state)
            wrong = self._violated(now, found.end, scale)
            touched = found.end.state != SEPARATION
            if np.any(self.cones.cohesive & (now.bonded != touched)) or BREAKS in dict(wrong):
                return None
            if not wrong:
                return found
            now = self._passed(now, wrong, tried, load)
        return None

    # -- both

    def _inner(
        self, now: Branches, problem: LegProblem
    ) -> tuple[EventPath | GaussSeidelPath, Array, LegProblem]:
        """Return the path of a set of branches, its constant force (2N,), and the problem of it."""
        if now.key not in self._paths:
            if len(self._paths) >= self._kept:
                del self._paths[next(iter(self._paths))]
            system, force = self.cones.coulomb(now)
            path: EventPath | GaussSeidelPath = EventPath(system)
            if self.sweeps is not None:
                path = GaussSeidelPath(system, self.sweeps, 1)
            self._paths[now.key] = path, force
        path, force = self._paths[now.key]
        start, (a, b) = problem.start, problem.ends
        state = self.cones.on_branches(now, start, STEP_ON_LIMIT * problem.force_scale)
        if np.any(force):
            a, b = np.append(a, 1.0), np.append(b, 1.0)
        if np.any(force) or not np.array_equal(state, start.state):
            start = ContactState(start.u, start.r + force, state)
        return path, force, replace(problem, start=start, ends=(a, b))

    def _outer(self, found: Leg, problem: LegProblem, force: Array, end: float) -> Leg:
        """Return a piece up to an end as one of the contact: without the force of its cones."""
        if not np.any(force):
            return found
        n, change = self.system.n, found.end.u - problem.start.u

        def outer(s: float, one: ContactState) -> ContactState:
            r = reactions(self.system, problem.load(s), one.u)
            return ContactState(one.u, r, one.state)

        return replace(
            found,
            end=outer(end, found.end),
            dissipation=found.dissipation + force[:n] * change[:n],
            work=found.work - float(force @ change),
            samples=[(s, outer(s, one)) for s, one in found.samples],
        )

    def _violated(self, now: Branches, end: ContactState, scale: float) -> list[tuple[int, int]]:
        """Return kind and node of the other margins that are passed at the end of a step."""
        margins = self.cones.other_margins(now, end.r[None])[0][0]
        return [(int(k), int(i)) for k, i in np.argwhere(margins < -self._slack(end, scale))]

    def _slack(self, state: ContactState, scale: float) -> float:
        """Return a force of round-off."""
        return scale * max(ACCEPTED_RESIDUAL, reachable(self.system, state.u, scale))

    def _add(self, leg: Leg, found: Leg, part: tuple[float, float]) -> None:
        """Add a piece between two places to what has been followed."""
        leg.end = found.end
        leg.dissipation = leg.dissipation + found.dissipation
        leg.work += found.work
        leg.sweeps += found.sweeps
        leg.events = Changes.joined(leg.events, found.events)
        leg.stops += [(s, u) for s, u in found.stops if s > part[0]] + [(part[1], found.end.u)]
        leg.samples += found.samples
        leg.force_scale = max(leg.force_scale, float(np.abs(found.end.r).max(initial=0.0)))
        self._check(leg)

    def _check(self, leg: Leg) -> None:
        """Note the residual of the end of a piece.

        Raises:
            SolveError: it is above its tolerance.
        """
        scale = leg.force_scale or 1.0  # nothing presses
        residual = residual_at_rest(self.system, leg.end, scale)
        leg.residual = max(leg.residual, residual)
        accepted = ACCEPTED_RESIDUAL if self.sweeps is None else STEP_ON_LIMIT
        if residual > max(accepted, reachable(self.system, leg.end.u, scale)):
            raise SolveError(
                f"the path from branch to branch of the shear limit lost accuracy: residual "
                f"{residual:.1e} over {accepted:.0e}; try the other solver method"
            )
