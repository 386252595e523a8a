"""Path along a leg from one change of branch to the next."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.exact.jumps import (
    add_jump,
    check_jumps,
    jump_between,
    no_state_beyond,
)
from receding_fenicsx.interface.exact.legs import LegProblem, evenly_spaced, unchanged
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.exact.rest import zero_crossing
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.load_steps.path import GaussSeidelPath
from receding_fenicsx.interface.residual import largest_force, reachable, residual_at_rest
from receding_fenicsx.interface.shear_branches.cones import BREAKS, FORMS, Branches, Cones
from receding_fenicsx.interface.system import Changes, ContactState, ContactSystem, Leg, reactions
from receding_fenicsx.interface.tolerances import (
    ACCEPTED_RESIDUAL,
    END_TOLERANCE,
    JUMP_STEP,
    STEP_ON_LIMIT,
    UNLOADING_ROUND_OFF,
)


class Tried:
    """Sets of branches that were tried at one place, and others that are left to try there."""

    def __init__(self, cones: Cones) -> None:
        """Start with nothing tried."""
        self.cones, self.keys, self.left = cones, set[bytes](), list[Branches]()
        self.most = 4 * cones.system.n + 16  # sets to try

    def following(self, now: Branches, wrong: list[tuple[int, int]]) -> Branches | None:
        """Return a set of branches that was not tried, None where all of them were.

        Margins that are passed change it, all of them or one; then those left over are tried.
        """
        self.keys.add(now.key)
        if wrong:
            choices = wrong, *([one] for one in wrong)
            self.left += [self.cones.passed(now, some) for some in reversed(choices)]
        while self.left and len(self.keys) <= self.most:
            new = self.left.pop()
            if new.key not in self.keys:
                return new
        return None


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
        """Prepare for ``system`` of ``kind = "frictional"``.

        ``on_jump`` is that of :class:`EventPath`, ``sweeps`` and ``steps`` are options of load
        steps and their number on a leg; without sweeps the path is exact.
        """
        self.system, self.cones, self.on_jump = system, Cones(system), on_jump
        self.sweeps, self.steps = sweeps, steps
        self._paths: dict[bytes, tuple[EventPath | GaussSeidelPath, Array]] = {}

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg, as :meth:`EventPath.trace_leg` does."""
        scale = largest_force(self.system, np.array(ends), start.r, force_scale)
        places = evenly_spaced(samples)
        whole = LegProblem(start, ends, scale, () if self.steps else places)
        stored = {round(place * self.steps) / self.steps for place in places if self.steps}
        targets = {k / self.steps for k in range(1, self.steps + 1)}
        leg = Leg(start, np.zeros(self.system.n), force_scale=scale, stops=[(0.0, start.u)])
        s = 0.0
        for target in sorted(targets | {zero_crossing(self.system, ends) or 1.0, 1.0}):
            resting = leg.end
            if s == 0.0 or self.sweeps is None:
                resting = at_rest(self.system, leg.end, (whole.load(s), ends[1]), scale)
            if resting is not leg.end:
                turned = Changes.between(s, leg.end.state, resting.state)
                leg.events = Changes.joined(leg.events, turned)
                leg.stops.append((s, resting.u))
                leg.end = resting
            follow = self._follow if self.sweeps is None else self._step
            follow(leg, whole, (s, target))
            s = target
            if s in stored:
                leg.samples.append((s, leg.end))
        if leg.samples:  # unloading may end just before its end
            leg.samples = [*(one for one in leg.samples if one[0] < 1.0), (1.0, leg.end)]
        return leg

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Solve one static problem at the end of a leg, slip counted from ``start``."""
        scale = largest_force(self.system, np.array(ends), start.r, force_scale)
        problem, now = LegProblem(start, ends, scale), self.cones.branches_of(start)
        tried = Tried(self.cones)
        while True:
            path, force, inner = self._inner(now, problem)
            found = path.static_leg(inner.start, inner.ends, scale)
            found = self._outer(found, problem, force, 1.0)
            wrong = self._violated(now, found.end, scale)
            if not wrong:
                touches = (found.end.state != SEPARATION) & ~self.system.held[: self.system.n]
                slip = np.where(touches, found.end.v - start.v, 0.0)
                found.dissipation = -0.5 * (start.Q + found.end.Q) * slip
                self._check(found)
                return found
            new = tried.following(now, wrong)
            if new is None:
                raise self._no_branch(wrong[0][1], ends[1])
            now = new

    # -- exact path

    def _follow(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> None:
        """Add the exact path between two places of a leg to what has been followed."""
        s, target = part
        now, tried = self.cones.branches_of(leg.end), Tried(self.cones)
        lost: SolveError | None = None
        while s < target:
            problem = replace(whole, start=leg.end, s_start=s, force_scale=leg.force_scale)
            trial, end, error = self._piece(now, problem, target)
            at, wrong = self._first_passed(now, problem, (trial, end), error)
            # said where no other branch leads on
            ended = error if isinstance(error, NoEquilibrium) and at == end else None
            error = None if wrong else error
            unloads = at >= target - UNLOADING_ROUND_OFF and not np.any(whole.load(target))
            if error is not None and unloads:
                at, error = target, None
            if at > s + END_TOLERANCE or (error is None and not wrong):
                if error is None and at >= target - END_TOLERANCE:
                    at = target
                elif error is None:
                    trial, at, error = self._piece(now, problem, at)
                    # round-off may let nodes land at its end: they do so with their bonds
                    lands = self.cones.cohesive & ~now.bonded & (trial.end.state != SEPARATION)
                    if lands.any():
                        state = np.where(lands, np.int8(SEPARATION), trial.end.state)
                        trial.end = replace(trial.end, state=state)
                        rest = [e for e in trial.events if not lands[e[1]] or e[3] == SEPARATION]
                        trial.events = Changes.of(rest)
                self._add(leg, trial, (s, at))
                s, tried, lost = at, Tried(self.cones), ended
            if error is None and (not wrong or s >= target):
                continue
            if error is not None:
                wrong = []
            Q, none, load = leg.end.Q, self._slack(leg.end, leg.force_scale), whole.load(s)
            for node in (i for kind, i in wrong if kind == BREAKS and abs(Q[i]) > none):
                wrong = [one for one in wrong if one != (BREAKS, node)]
                error = NoQuasiStaticContinuation(
                    f"no quasi-static continuation at {self.system.load_text(load)}: node {node} "
                    f"(x = {self.system.x[node]:.6g}) opens under the shear force of its "
                    "cohesion, which it loses at once; reduce [contact] cohesion or the load range"
                )
            lost = lost or error or ended
            new = tried.following(now, wrong)
            if new is None:
                slack = self._slack(leg.end, leg.force_scale)
                sets = self._sets_of_bonds(now, leg.end, slack)
                tried.left, tried.most = sets, tried.most + len(sets)
                new = tried.following(now, [])
            if new is None:
                lost = lost or self._no_branch(wrong[0][1], load)
                s = self._jump(leg, whole, (s, target), lost)
                new, tried, lost = self.cones.branches_of(leg.end), Tried(self.cones), None
            now = new

    def _jump(
        self, leg: Leg, whole: LegProblem, part: tuple[float, float], error: SolveError
    ) -> float:
        """Pass a jump, where that is asked for, by a static problem; return the place after it."""
        (s, target), start = part, leg.end
        if self.on_jump != "static" or not isinstance(error, NoQuasiStaticContinuation):
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
        add_jump(leg, (s, beyond), jump_between(self.system, start, end, load), whole.samples)
        return beyond

    def _piece(
        self, now: Branches, problem: LegProblem, target: float
    ) -> tuple[Leg, float, SolveError | None]:
        """Follow a piece of a leg in given branches; return it, its end, and why it ends early."""
        path, force, inner = self._inner(now, problem)
        assert isinstance(path, EventPath)
        s, begun = problem.s_start, inner.start
        turned = Changes.between(s, problem.start.state, begun.state)
        ends = inner.load(s), inner.load(target)
        scale = largest_force(path.system, np.array(ends), begun.r, problem.force_scale)
        places = tuple(place for place in problem.samples if s < place < target)
        inner = replace(inner, force_scale=scale, samples=(*places, target))
        found, end, error = None, target, None
        if not np.any(force) and not (np.any(ends[0]) and np.any(ends[1])):
            # from no load or to none, which a walk does not end at
            whole = inner.piece(begun, ends, scale, (s, target))
            with suppress(SolveError):
                found = path.trace(whole).placed(target - s, s)
                one = (state for _, state in found.samples)
                found.samples = list(zip(inner.samples, one, strict=False))
        if found is None:
            walk = path.walk(inner)
            try:
                walk.run(target)
            except SolveError as lost:
                error = lost
            end, found = walk.s, walk.stop_here() if error else walk.finish()
        found.events = Changes.joined(turned, found.events)
        found = self._outer(found, problem, force, end)
        found.samples = [(at, one) for at, one in found.samples if at in problem.samples]
        return found, end, error

    def _first_passed(
        self, now: Branches, problem: LegProblem, piece: tuple[Leg, float], error: SolveError | None
    ) -> tuple[float, list[tuple[int, int]]]:
        """Return where another margin first passes zero or a bond forms, its kind and its nodes.

        Where no way leads on from the end of the piece, margins that just reach zero there are
        passed too.
        """
        found, end = piece
        stops = [(problem.s_start, problem.start.u), *found.stops, (end, found.end.u)]
        s, u = np.array([at for at, _ in stops]), np.array([one for _, one in stops])
        load = (1.0 - s)[:, None] * problem.ends[0] + s[:, None] * problem.ends[1]
        r = load @ self.system.r_star + u @ self.system.K
        margins = self.cones.other_margins(now, r)
        slack = self._slack(found.end, found.force_scale)
        below = margins < -slack
        first, wrong = np.inf, list[tuple[int, int]]()
        rows = np.flatnonzero(below.any(axis=(1, 2)))
        if len(rows):
            j = int(rows[0])
            i = max(j - 1, 0)
            before, after = np.maximum(margins[i], 0.0), margins[j]
            with np.errstate(invalid="ignore", divide="ignore"):
                at = np.where(below[j], s[i] + before / (before - after) * (s[j] - s[i]), np.inf)
            first = float(at.min())
            wrong = [(int(k), int(n)) for k, n in np.argwhere(at <= first + END_TOLERANCE)]
        elif isinstance(error, NoEquilibrium | NoQuasiStaticContinuation):
            tied = (margins[-1, :2] <= slack) & (found.end.state != SEPARATION)
            # a stuck node may leave a shear limit that friction has fallen below
            tied |= now.on_limit & ~self.cones.branches_of(found.end).on_limit
            wrong = [(int(k), int(n)) for k, n in np.argwhere(tied)]
        events = found.events
        forms = self.cones.cohesive[events.node] & ~now.bonded[events.node]
        forms &= events.new != SEPARATION
        if forms.any() and (begin := float(events.s[forms].min())) <= first:
            forms &= events.s <= begin + END_TOLERANCE
            return begin, [(FORMS, node) for node in set(events.node[forms].tolist())]
        return min(first, end), wrong

    def _sets_of_bonds(self, now: Branches, here: ContactState, slack: float) -> list[Branches]:
        """Return all sets of bonds of the nodes without force and gap, where they are few."""
        system = self.system
        gap = np.diagonal(system.K)[system.n :] * (system.g0 + here.w)
        loose = np.maximum(np.abs([here.Q, here.P]).max(axis=0), gap) <= slack
        nodes = np.flatnonzero(self.cones.cohesive & loose)
        kinds = product((FORMS, BREAKS), repeat=len(nodes)) if len(nodes) <= 8 else ()
        return [self.cones.passed(now, list(zip(some, nodes, strict=True))) for some in kinds]

    def _no_branch(self, node: int, load: Array) -> NoQuasiStaticContinuation:
        """Return the error where all branches were tried."""
        return NoQuasiStaticContinuation(
            f"no quasi-static continuation at {self.system.load_text(load)}: no branch of the "
            f"shear limit of node {node} (x = {self.system.x[node]:.6g}) leads on; reduce the "
            "friction or the load range"
        )

    # -- load steps

    def _step(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> None:
        """Add one load step: solved in the branches at its end, or exactly where bonds change."""
        assert self.sweeps is not None
        found = self._solved(leg, whole, part)
        # sweeps are exact in proportion to the forces of the cones, which may be far larger
        accepted = max(ACCEPTED_RESIDUAL, self.sweeps.residual_tolerance)
        if found is not None and found.residual <= accepted:
            with suppress(SolveError):  # the exact path takes over
                self._add(leg, found, part)
                return
        events, leg.events = leg.events, Changes.none()
        self._follow(leg, whole, part)
        # those at its start belong to the step too
        at = np.maximum(leg.events.s, np.nextafter(part[0], 1.0))
        leg.events = Changes.joined(events, replace(leg.events, s=at))

    def _solved(self, leg: Leg, whole: LegProblem, part: tuple[float, float]) -> Leg | None:
        """Return one load step, None where bonds change or no step is found."""
        (s, target), tried = part, Tried(self.cones)
        now: Branches | None = self.cones.branches_of(leg.end)
        problem = replace(whole, start=leg.end, s_start=s, force_scale=leg.force_scale)
        # a node that lands begins on its friction
        while now is not None and not np.any(now.branch[leg.end.state == SEPARATION]):
            path, force, inner = self._inner(now, problem, self.sweeps)
            assert isinstance(path, GaussSeidelPath)
            try:
                found = path.advance(inner, unchanged(inner), s, target)
            except (NoEquilibrium, NoQuasiStaticContinuation):
                return None
            found = self._outer(found, problem, force, target)
            if not np.array_equal(inner.start.state, leg.end.state):
                found.events = Changes.between(target, leg.end.state, found.end.state)
            wrong = self._violated(now, found.end, leg.force_scale)
            if any(kind in (BREAKS, FORMS) for kind, _ in wrong):
                return None
            if not wrong:
                return found
            now = tried.following(now, wrong)
        return None

    # -- both

    def _inner(
        self, now: Branches, problem: LegProblem, sweeps: GaussSeidelOptions | None = None
    ) -> tuple[EventPath | GaussSeidelPath, Array, LegProblem]:
        """Return the path of a set of branches, its constant force (2N,), and the problem of it."""
        key, n = (b"" if sweeps is None else b"steps") + now.key, self.system.n
        if key not in self._paths:
            # 256 MiB of them: matrices of a tableau, rates of its first sets of states
            if len(self._paths) >= max(4, 2**28 // (96 * n**2 + 2**13 * n)):
                del self._paths[next(iter(self._paths))]
            system, force = self.cones.coulomb(now)
            self._paths[key] = (
                EventPath(system) if sweeps is None else GaussSeidelPath(system, sweeps, 1),
                force,
            )
        path, force = self._paths[key]
        start, (a, b) = problem.start, problem.ends
        state = self.cones.on_branches(now, start, STEP_ON_LIMIT * problem.force_scale)
        if np.any(force):
            a, b = np.append(a, 1.0), np.append(b, 1.0)
        if np.any(force) or not np.array_equal(state, start.state):
            start = ContactState(start.u, start.r + force, state)
        return path, force, replace(problem, start=start, ends=(a, b))

    def _outer(self, found: Leg, problem: LegProblem, force: Array, end: float) -> Leg:
        """Return a piece up to an end as one of the contact: without the force of its cones."""
        n, change = self.system.n, found.end.u - problem.start.u

        def outer(s: float, one: ContactState) -> ContactState:
            r = reactions(self.system, problem.load(s), one.u)
            return ContactState(one.u, r, one.state)

        last = outer(end, found.end)
        # the constant force is none of the contact
        scale = max(problem.force_scale, float(np.abs(last.r).max(initial=0.0)))
        return replace(
            found,
            end=last,
            dissipation=found.dissipation + force[:n] * change[:n],
            work=found.work - float(force @ change),
            samples=[(s, outer(s, one)) for s, one in found.samples],
            force_scale=scale,
            residual=found.residual * found.force_scale / (scale or 1.0),
            ties=Changes.none(),
        )

    def _violated(self, now: Branches, end: ContactState, scale: float) -> list[tuple[int, int]]:
        """Return kind and node of the margins passed and the bonds formed at the end of a step."""
        margins = self.cones.other_margins(now, end.r[None])[0]
        lands = self.cones.cohesive & ~now.bonded & (end.state != SEPARATION)
        wrong = np.argwhere(margins < -self._slack(end, scale)).tolist()
        return [(k, i) for k, i in wrong] + [(FORMS, i) for i in np.flatnonzero(lands).tolist()]

    def _slack(self, state: ContactState, scale: float) -> float:
        """Return a force of round-off."""
        return scale * max(ACCEPTED_RESIDUAL, reachable(self.system, state.u, scale))

    def _add(self, leg: Leg, found: Leg, part: tuple[float, float]) -> None:
        """Add a piece between two places to what has been followed."""
        stops = [(s, u) for s, u in found.stops if s > part[0]] + [(part[1], found.end.u)]
        self._check(found)
        leg.add(replace(found, stops=stops))

    def _check(self, piece: Leg) -> None:
        """Note the residual of the end of a piece; raise SolveError above its tolerance."""
        scale, in_cones = piece.force_scale, piece.residual
        residual = residual_at_rest(self.system, piece.end, scale)
        piece.residual = max(in_cones, residual)
        # places where other limits are reached have the round-off of displacements on the way
        places = piece.end.u, *(u for _, u in piece.stops)
        if residual > max(ACCEPTED_RESIDUAL, 2.0 * in_cones) and all(
            residual > reachable(self.system, u, scale) for u in places
        ):
            raise SolveError(
                f"the path from branch to branch of the shear limit lost accuracy: residual "
                f"{residual:.1e} over {ACCEPTED_RESIDUAL:.0e}; try the other solver method"
            )
