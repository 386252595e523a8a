"""Elimination of the nodes that keep their state; they are watched for limits.

Far inside a stick zone or far outside the contact nodes keep their state through whole cycles. With
the active nodes' displacements u_S, the frozen constant ones u_C (stick) and the frozen free ones
u_O (separation, no reaction), eq. (11) gives

    u_O = -K_OO^-1 (K_OS u_S + K_OC u_C + sum lambda r*_O)
    r_S = sum lambda r*'_S + c + K' u_S,   K' = K_SS - K_SO K_OO^-1 K_OS,

a contact system of the active nodes alone, c being the reaction to one more load of factor 1.
Everything is linear between two events, so that the frozen nodes are checked at the events only: a
leg on which one of them reaches a limit is discarded and traced again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.accumulate import Watch
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.segments import LIMIT_TOLERANCE, Segments
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.residual import residual_at_rest
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg, reactions

LARGEST_ACTIVE_SHARE = 0.8
"""Largest share of active nodes with which a reduction saves time."""

WIDENING = 0.01
"""Part of all nodes by which the active ranges are widened on both sides of nodes that changed."""

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Reduction:
    """The contact system of the active nodes, and the way back.

    Attributes:
        full: the whole contact, 2N form.
        nodes: the active nodes.
        active: (2n,) degrees of freedom of the active nodes.
        constant, place: degrees of freedom of frozen nodes that keep their place, and the place.
        loose, moved: degrees of freedom of frozen nodes that move, and their displacements from
            [u_S; lambda; 1].
        segments: rates of the system of the active nodes, whose last load is a constant 1.
        frozen: (N,) states of the frozen nodes, 0 at active ones.
        watched: (k, 2n + n_loads + 1) quantities, as forces, that have to stay positive.
        watched_size: absolute values of ``watched``.
        watched_node: (k,) the node of each.
        swing: (n_loads, n_loads) work of the loads by the frozen free nodes: d work =
            lambda . swing . d lambda.
    """

    full: ContactSystem
    nodes: Indices
    active: Indices
    constant: Indices
    place: Array
    loose: Indices
    moved: Array
    segments: Segments
    frozen: NDArray[np.int8]
    watched: Array
    watched_size: Array
    watched_node: Indices
    swing: Array

    def shrink(self, state: ContactState) -> ContactState:
        """Return a state of all nodes for the active ones."""
        active = self.active
        return ContactState(state.u[active], state.r[active], state.state[self.nodes])

    def expand(self, state: ContactState, load: Array) -> ContactState:
        """Return a state of the active nodes for all, with reactions evaluated afresh."""
        u = self.displacements(np.concatenate([state.u, load, [1.0]]))
        states = self.frozen.copy()
        states[self.nodes] = state.state
        return ContactState(u, reactions(self.full, load, u), states)

    def displacements(self, given: Array) -> Array:
        """Return the displacements (2N,) of all nodes, or (k, 2N) at k instants.

        Args:
            given: (2n + n_loads + 1,) or (k, 2n + n_loads + 1) values of [u_S; lambda; 1].
        """
        u = np.empty((*given.shape[:-1], 2 * self.full.n))
        u[..., self.active] = given[..., : len(self.active)]
        u[..., self.constant] = self.place
        u[..., self.loose] = given @ self.moved.T
        return u

    def fits(self, start: ContactState) -> bool:
        """Return whether the frozen nodes are in the states and at the places they are to keep."""
        away = self.frozen != 0
        kept = np.array_equal(start.state[away], self.frozen[away])
        return kept and np.array_equal(start.u[self.constant], self.place)

    def follow(self, problem: LegProblem, check_all: bool) -> Walk:
        """Follow a leg with the active nodes, and watch the others.

        Args:
            problem: the leg of all nodes.
            check_all: evaluate the residual afresh after every event.

        Raises:
            SolveError: the path ends.
        """
        a, b = problem.ends
        reduced = replace(
            problem,
            start=self.shrink(problem.start),
            ends=(np.append(a, 1.0), np.append(b, 1.0)),
        )
        walk = Walk(self.segments, reduced, check_all, watch=Watch(self.watched, self.leaving))
        walk.run(1.0)
        return walk

    def finish(self, problem: LegProblem, walk: Walk) -> Leg | Indices:
        """Return what came of a leg.

        Args:
            problem: the leg of all nodes.
            walk: its walk on the active nodes.

        Returns:
            The leg of all nodes, or the frozen nodes that reach a limit on it.

        Raises:
            SolveError: the residual is above its tolerance.
        """
        (a, b), n, leg = problem.ends, self.full.n, walk.finish()
        if len(walk.sums.watched):
            return walk.sums.watched
        end, dissipation = self.expand(leg.end, b), np.zeros(n)
        dissipation[self.nodes] = leg.dissipation
        scale = max(leg.force_scale, float(np.abs(end.r).max()))
        residual = max(leg.residual, residual_at_rest(self.full, end, scale))
        return Leg(
            end=end,
            dissipation=dissipation,
            work=float(walk.sums.work[:-1].sum() + 0.5 * (a + b) @ self.swing @ (b - a)),
            residual=residual,
            force_scale=scale,
            samples=[(s, self.expand(state, problem.load(s))) for s, state in leg.samples],
            events=replace(leg.events, node=self.nodes[leg.events.node]),
            stops=self._expanded(leg.stops, problem),
            ties=replace(leg.ties, node=self.nodes[leg.ties.node]),
        )

    def _expanded(self, stops: list[tuple[float, Array]], problem: LegProblem) -> list[Any]:
        """Return stops of the active nodes, places and displacements, for all nodes."""
        if not stops:
            return []
        places = [s for s, _ in stops]
        loads = np.array([[*problem.load(s), 1.0] for s in places])
        u = self.displacements(np.hstack([np.array([u for _, u in stops]), loads]))
        return list(zip(places, u, strict=True))

    def leaving(self, u: Array, load: Array, force_scale: float) -> Indices:
        """Return the frozen nodes that reach a limit at one of several instants.

        With every u and load factor in its range m - h to m + h a quantity W u is at least
        W m - |W| h. Only those are followed from instant to instant for which that is too low.

        Args:
            u: (k, 2n) displacements of the active nodes.
            load: (k, n_loads + 1) load factors, the last of them 1.
            force_scale: largest nodal force of the history so far.
        """
        limit, m = LIMIT_TOLERANCE * force_scale, u.shape[1]
        low = np.concatenate([u.min(axis=0), load.min(axis=0)])
        high = np.concatenate([u.max(axis=0), load.max(axis=0)])
        least = self.watched @ (0.5 * (high + low)) - self.watched_size @ (0.5 * (high - low))
        near = (least <= limit).nonzero()[0]
        rows = self.watched[near]
        values = u @ rows[:, :m].T + load @ rows[:, m:].T
        reached = near[(values <= limit).any(axis=0)]
        return np.unique(self.watched_node[reached]) if len(reached) else reached


def widen(changed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the nodes that changed and those within ``WIDENING`` of them along the contact."""
    n = len(changed)
    reach = max(2, int(WIDENING * n))
    window = np.ones(2 * reach + 1)
    return np.convolve(changed, window, mode="full")[reach : reach + n] > 0.5


def reduce(
    full: Segments,
    start: ContactState,
    active: NDArray[np.bool_],
    opening: NDArray[np.bool_] | None = None,
) -> Reduction | None:
    """Leave the nodes that are not active out of a contact.

    Args:
        full: rates of the whole contact.
        start: a state of it; the frozen nodes keep their states and the stuck ones their place.
        active: (N,) nodes that may change.
        opening: (N,) nodes expected to open; None for all.

    Returns:
        The reduction; None where it is not worth while.
    """
    system, n = full.system, full.system.n
    if not active.any() or np.count_nonzero(active) > LARGEST_ACTIVE_SHARE * n:
        return None
    slipping = (start.state != SEPARATION) & full.frictional & (start.state != STICK)
    if np.any(slipping & ~active):
        return None
    nodes = np.flatnonzero(active)
    open_ = start.state == SEPARATION
    # freedoms without reaction: of open nodes, and tangentially of nodes without friction
    free = np.concatenate([open_ | ~full.frictional, open_]) & ~system.held
    S = np.concatenate([nodes, n + nodes])
    frozen = np.tile(~active, 2)
    loose, fixed = np.flatnonzero(frozen & free), np.flatnonzero(frozen & ~free)
    K, r_star = system.K, system.r_star
    # columns: u_S, the loads, 1
    held = np.hstack([K[:, S], r_star.T, (K[:, fixed] @ start.u[fixed])[:, None]])
    try:
        factor = np.linalg.cholesky(K[np.ix_(loose, loose)])
    except np.linalg.LinAlgError:
        return None
    moved = -sla.cho_solve((factor, True), held[loose]) if len(loose) else held[loose]
    reaction = held + K[:, loose] @ moved
    m, loads, K_red = len(S), len(system.load_names), reaction[S, : len(S)]
    reduced = replace(
        system,
        x=system.x[nodes],
        points=system.points[nodes],
        weight=system.weight[nodes],
        K=0.5 * (K_red + K_red.T),
        r_star=np.ascontiguousarray(reaction[S, m:].T),
        load_names=(*system.load_names, "frozen nodes"),
        f=system.f[nodes],
        f_backward=None if system.f_backward is None else system.f_backward[nodes],
        g0=system.g0[nodes],
        held=system.held[S],
        rigid=system.rigid[S] if len(fixed) == 0 else np.zeros((m, 0)),
        load_compliance=np.zeros((0, 0)),
        load_sign=np.zeros(0),
    )
    swing = r_star[:, loose] @ moved[:, m : m + loads]
    watched, watched_node = _watch(full, start, ~active, reaction, (loose, moved))
    states = np.where(active, 0, start.state).astype(np.int8)
    segments = Segments(reduced, None if opening is None else opening[nodes])
    return Reduction(
        full=system,
        nodes=nodes,
        active=S,
        constant=fixed,
        place=start.u[fixed],
        loose=loose,
        moved=moved,
        segments=segments,
        frozen=states,
        watched=watched,
        watched_size=np.abs(watched),
        watched_node=watched_node,
        swing=swing,
    )


def _watch(
    full: Segments,
    start: ContactState,
    frozen: NDArray[np.bool_],
    reaction: Array,
    motion: tuple[Indices, Array],
) -> tuple[Array, Indices]:
    """Return what has to stay positive at the frozen nodes, as forces, and the node of each."""
    system, n = full.system, full.system.n
    open_ = start.state == SEPARATION
    stuck = np.flatnonzero(frozen & ~open_ & full.frictional)
    smooth = np.flatnonzero(frozen & ~open_ & full.smooth)
    gaps = np.flatnonzero(frozen & open_ & (full.frictional | full.smooth))
    margins = system.friction[stuck, None].margins(reaction[stuck], reaction[n + stuck])
    loose, moved = motion
    gap = moved[loose.searchsorted(n + gaps)]
    gap[:, -1] += system.g0[gaps]
    rows = [*margins, reaction[n + smooth], gap]
    labels = np.concatenate([2 * n + stuck, 3 * n + stuck, 2 * n + smooth, n + gaps])
    watched = np.vstack(rows) * full.weight[labels, None]
    return watched, labels % n
