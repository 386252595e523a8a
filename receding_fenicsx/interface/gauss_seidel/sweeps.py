"""The frictional Gauss-Seidel method: the law of one node, and sweeps over all nodes.

With the displacements of all others held, the reactions of a node are Q = Q0 + k_t v + c w and
P = P0 + c v + k_n w. In the state that is assumed equations (4), (6), (8) or (10) are solved and
the inequalities (5), (7), (9), (10) checked (Fig. 3 of the paper).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import daxpy

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NotConverged
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, slips, sticks
from receding_fenicsx.interface.residual import largest_force, law_residual, round_off
from receding_fenicsx.interface.system import (
    ContactState,
    ContactSystem,
    Leg,
    neutral_motions,
    reactions,
)

TRIED_AFTER = {
    STICK: (STICK, FORWARD, BACKWARD, SEPARATION),
    SEPARATION: (SEPARATION, STICK, FORWARD, BACKWARD),
    FORWARD: (FORWARD, STICK, SEPARATION, BACKWARD),
    BACKWARD: (BACKWARD, STICK, SEPARATION, FORWARD),
}
"""Order in which a node's states are assumed, by its last state: likely changes first."""

SINGULAR = 4.0 * float(np.finfo(float).eps)
"""Stiffness of a node in a state, over the terms that it is the difference of, that is none."""

Solution = tuple[int, float, float]
"""State, v and w of a node."""


@dataclass(slots=True)
class NodeProblem:
    """Stiffness and law of one node."""

    k_t: float  # tangential diagonal entry of K
    k_n: float  # normal one
    c: float  # entry that couples the node's v and w
    f_forward: float  # coefficient of friction for forward slip
    f_backward: float  # the same for backward slip
    w_c: float  # normal displacement at which the gap closes, -g0
    det: float = field(init=False)  # determinant of the stiffness
    # the node has a motion without stiffness while the others are held
    singular: bool = field(init=False)

    def __post_init__(self) -> None:
        """Evaluate the determinant."""
        self.det = self.k_t * self.k_n - self.c * self.c
        self.singular = self.det <= SINGULAR * self.k_t * self.k_n

    def solve(self, Q0: float, P0: float, v_ref: float, state: int, w: float = -inf) -> Solution:
        """Return the first state whose inequalities all hold: the only one if f |c| < k_t.

        It is looked for from a state on, slip counted from v_ref; an open node without normal
        stiffness keeps its w. If no state holds, a singular node is open unless loads press it. Any
        other node (possible only if f |c| >= k_t) is left sticking; the residual then keeps the
        step from being accepted.
        """
        k_t, k_n, c, w_c = self.k_t, self.k_n, self.c, self.w_c
        for assumed in TRIED_AFTER[state]:
            if assumed == SEPARATION:
                if self.singular:
                    continue  # nothing holds it, and no displacement balances the loads
                w = (-P0 * k_t + Q0 * c) / self.det
                if w >= w_c:
                    return SEPARATION, (-Q0 * k_n + P0 * c) / self.det, w
            elif assumed == STICK:
                Q, P = Q0 + k_t * v_ref + c * w_c, P0 + c * v_ref + k_n * w_c
                if sticks(Q, P, self.f_forward, self.f_backward):
                    return STICK, v_ref, w_c
            else:
                f = self.f_forward if assumed == FORWARD else -self.f_backward
                stiffness = k_t + f * c
                if abs(stiffness) <= SINGULAR * k_t:
                    continue  # slip does not change the distance from its limit
                v = -(Q0 + c * w_c + f * (P0 + k_n * w_c)) / stiffness
                if slips(assumed, v - v_ref, P0 + c * v + k_n * w_c):
                    return assumed, v, w_c
        return self._open_if_free(Q0, P0, v_ref, w) if self.singular else (STICK, v_ref, w_c)

    def _open_if_free(self, Q0: float, P0: float, v_ref: float, w: float) -> Solution:
        """Open a singular node unless loads press it."""
        k_t, k_n, c, w_c = self.k_t, self.k_n, self.c, self.w_c
        if k_t > 0.0:
            coupled = c * Q0 / k_t
            if P0 - coupled <= SINGULAR * (abs(P0) + abs(coupled)):
                w = max(w, w_c)
                return SEPARATION, -(Q0 + c * w) / k_t, w
        elif P0 + k_n * w_c <= 0.0:
            return SEPARATION, v_ref, -P0 / k_n if k_n > 0.0 else max(w, w_c)
        return STICK, v_ref, w_c

    def solve_held_tangentially(self, P0: float, v: float, w: float) -> Solution:
        """Solve a node whose v is fixed by Signorini's law alone; without stiffness it keeps w."""
        if P0 + self.c * v + self.k_n * self.w_c > 0.0:
            return STICK, v, self.w_c
        if self.k_n == 0.0:
            return SEPARATION, v, max(self.w_c, w)
        return SEPARATION, v, -(P0 + self.c * v) / self.k_n

    def touch_down(self, Q0: float, P0: float, v: float, gap: float) -> float | None:
        """Return v where an open node first touches on a straight path, else None (section 2.2).

        With v and the gap g at the start of the step, the zero-traction displacement v0 and its
        gap g0t < 0: v + (v0 - v) g / (g - g0t).
        """
        if self.singular:
            # free to fall: without tangential force down to the plane
            return -(Q0 + self.c * self.w_c) / self.k_t if self.k_t > 0.0 else v
        trial_gap = (-P0 * self.k_t + Q0 * self.c) / self.det - self.w_c
        if trial_gap >= 0.0:
            return None
        v0 = (-Q0 * self.k_n + P0 * self.c) / self.det
        gap = max(gap, 0.0)
        return v + (v0 - v) * gap / (gap - trial_gap)


@dataclass(frozen=True)
class GaussSeidelOptions:
    """Options of the sweeps.

    Attributes:
        over_relaxation: factor on the update of slipping and separated nodes; 1 is plain.
        polish: solve directly once the states have settled.
        change_tolerance: eq. (16), last change of a displacement over the step's largest one.
        residual_tolerance: residual of the contact law over the history's largest nodal force.
        max_sweeps: sweeps after which the step is given up with an error.
    """

    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-12
    max_sweeps: int = 20000


class Stalled(NotConverged):
    """The sweeps cycle or creep: with friction they may, though the step has a solution."""


def solve_step(
    system: ContactSystem,
    start: ContactState,
    load: Array,
    options: GaussSeidelOptions,
    force_scale: float = 0.0,
    guess: ContactState | None = None,
    patient: bool = False,
) -> Leg:
    """Advance the contact from ``start`` to the load factors (n_loads,) in one step.

    The sweeps begin with a ``guess``, by default ``start``. Unless ``patient``, those that cycle or
    creep are stopped. Each node dissipates -(Q_old + Q_new)/2 (v_new - v_start).

    Raises:
        NotConverged: the sweeps ran out; the message holds the residual and the worst node.
        Stalled: they have stopped gaining.
    """
    sweeper = _Sweeper(system, start, load, options, guess or start)
    largest = largest_force(system, load, start.r, force_scale)
    # forces that change by less than this do not count: displacements of round-off never settle
    noise = 8.0 * float(np.finfo(float).eps) * largest
    still = noise / max(float(np.max(sweeper.stiffness)), float(np.finfo(float).tiny))
    # that must cut the residual to a tenth; plain sweeps carry a change on by about one node
    patience = options.max_sweeps if patient else max(1000, 10 * system.n)
    settled = since_check = gained_at = 0
    best = gained = np.inf
    residual, worst = np.inf, 0
    for sweep in range(1, options.max_sweeps + 1):
        changed, moved = sweeper.sweep()
        span = float(np.abs(sweeper.u).max())
        change = moved / span if moved > still and span > 0.0 else 0.0
        small = change <= options.change_tolerance
        settled = 0 if changed else settled + 1
        since_check += 1
        # the residual is evaluated, and the same states are polished, every tenth sweep
        if options.polish and settled >= 2:
            sweeper.polish()
            settled = 0 if sweeper.polished else -8
        elif not small and since_check < 10 and sweep < options.max_sweeps:
            continue
        since_check = 0
        residual, worst, scale = sweeper.residual(force_scale)
        # under its tolerance, or as small as round-off allows
        tolerance = options.residual_tolerance
        reached = residual <= tolerance or (
            residual <= 100.0 * tolerance and residual <= round_off(system, sweeper.u, scale)
        )
        if reached and (small or sweeper.polished):
            return sweeper.accept(residual, scale, sweep)
        if residual > 10.0 * best:
            # over-relaxation has no convergence proof with friction
            sweeper.omega = 1.0
        best = min(best, residual)
        if residual < 0.1 * gained:
            gained, gained_at = residual, sweep
        elif sweep - gained_at >= patience:
            break
    node = worst % system.n
    raise (NotConverged if sweep == options.max_sweeps else Stalled)(
        f"Gauss-Seidel stopped after {sweep} sweeps at {system.load_text(load)}: "
        f"residual {residual:.1e} at node {node} (x = {system.x[node]:.6g}), tolerance "
        f"{options.residual_tolerance:.1e}; take more steps per leg, more sweeps, or method events"
    )


class _Sweeper:
    """One step under way."""

    def __init__(
        self,
        system: ContactSystem,
        start: ContactState,
        load: Array,
        options: GaussSeidelOptions,
        guess: ContactState,
    ) -> None:
        self.system, self.start, self.load, self.options = system, start, load, options
        n = system.n
        K, friction = system.K, system.friction
        stiffness = *system.diagonal.reshape(2, n), np.diagonal(K[:n, n:])
        rows = zip(*stiffness, friction.forward, friction.backward, -system.g0, strict=True)
        self.nodes = [NodeProblem(*map(float, row)) for row in rows]
        self.stiffness = system.local_stiffness
        self.omega = options.over_relaxation
        self.polished = False  # whether u is that of an accepted direct solve
        self.u = guess.u.copy()
        self.r = reactions(system, load, self.u)  # kept up by columns of K
        self.state = guess.state.astype(int).tolist()
        self.v_ref = start.v.tolist()  # where the slip of each node is counted from
        self.gap = (system.g0 + start.w).tolist()
        self.was_open = (start.state == SEPARATION).tolist()
        self.held_t, self.held_n = system.held[:n].tolist(), system.held[n:].tolist()

    def sweep(self) -> tuple[bool, float]:
        """Update every node once; return whether a state changed and the largest change of u."""
        u, r, K, n, omega = self.u, self.r, self.system.K, self.system.n, self.omega
        held_t, held_n, states, v_ref = self.held_t, self.held_n, self.state, self.v_ref
        largest = 0.0
        changed = self.polished = False
        for i, node in enumerate(self.nodes):
            v, w, last = u.item(i), u.item(n + i), states[i]
            if held_n[i] and held_t[i]:
                continue
            Q0 = r.item(i) - node.k_t * v - node.c * w
            P0 = r.item(n + i) - node.c * v - node.k_n * w
            if held_t[i]:
                state, v_new, w_new = node.solve_held_tangentially(P0, v, w)
            elif held_n[i]:
                # the support carries it: it slides freely
                v_new, w_new = -(Q0 + node.c * w) / node.k_t if node.k_t else v, w
                state = FORWARD
            else:
                if self.was_open[i]:
                    self._touch_down(i)
                state, v_new, w_new = node.solve(Q0, P0, v_ref[i], last, w)
            if state != last:
                states[i] = state
                changed = True
            elif omega != 1.0 and state != STICK:
                # over-relaxed unless that breaks the state's own inequality
                v_far, w_far = v + omega * (v_new - v), w + omega * (w_new - w)
                if state == SEPARATION and w_far >= node.w_c:
                    v_new, w_new = (v_new if held_t[i] else v_far), w_far
                elif state != SEPARATION and (v_far >= v_ref[i]) == (state == FORWARD):
                    v_new = v_far
            if v_new != v:
                daxpy(K[i], r, a=v_new - v)
                u[i] = v_new
                largest = max(largest, abs(v_new - v))
            if w_new != w:
                daxpy(K[n + i], r, a=w_new - w)
                u[n + i] = w_new
                largest = max(largest, abs(w_new - w))
        return changed, largest

    def _touch_down(self, i: int) -> None:
        """Count the slip of an open node from where it first touches, if it does."""
        node, n, v, w = self.nodes[i], self.system.n, self.u.item(i), self.u.item(self.system.n + i)
        Q0 = self.r.item(i) - node.k_t * v - node.c * w
        P0 = self.r.item(n + i) - node.c * v - node.k_n * w
        touched = node.touch_down(Q0, P0, float(self.start.u[i]), self.gap[i])
        if touched is not None:
            self.v_ref[i] = touched

    def polish(self) -> None:
        """Solve directly with the present states; keep what betters the residual much."""
        before = self.residual(0.0)[0]
        state, v_ref = np.array(self.state), np.array(self.v_ref)
        u = solve_directly(self.system, self.load, self.u, v_ref, state)
        if u is None:
            return
        old = self.u, self.r, list(self.v_ref)
        self.u, self.r = u, reactions(self.system, self.load, u)
        for i in np.flatnonzero(self.was_open).tolist():
            if not self.held_t[i]:
                self._touch_down(i)
        # with wrong states it may leave less residual but carry the body far away
        if self.residual(0.0)[0] < 0.1 * before:
            self.polished = True
        else:
            self.u, self.r, self.v_ref = old

    def residual(self, force_scale: float) -> tuple[float, int, float]:
        """Return the fresh relative residual, its worst entry, and the force scale."""
        r = reactions(self.system, self.load, self.u)
        scale = largest_force(self.system, self.load, r, force_scale)
        slip = self.u[: self.system.n] - np.array(self.v_ref)
        both = law_residual(self.system, r, self.u, slip, self.stiffness)
        worst = int(np.argmax(both))
        return (float(both[worst]) / scale if scale > 0.0 else 0.0), worst, scale

    def accept(self, residual: float, scale: float, sweeps: int) -> Leg:
        """Return the step with fresh reactions and its dissipation."""
        frictionless = ~self.system.friction.present
        r = reactions(self.system, self.load, self.u)
        end = ContactState(self.u, r, np.array(self.state, dtype=np.int8))
        # without friction stick and slip do not differ
        end.state[frictionless & (end.state != SEPARATION)] = STICK
        touched = np.array(self.was_open) & (end.state != SEPARATION)
        Q_old = np.where(touched, 0.0, self.start.Q)
        slip = np.where(end.state == SEPARATION, 0.0, end.v - np.array(self.v_ref))
        # without friction, forces of round-off may move a node far
        slip[frictionless] = 0.0
        dissipation = -0.5 * (Q_old + end.Q) * slip
        return Leg(end, dissipation, 0.0, residual, scale, sweeps=sweeps)


def solve_directly(
    system: ContactSystem, load: Array, u: Array, v_ref: Array, state: NDArray[np.integer]
) -> Array | None:
    """Return the displacements in given states, from eqs. (4), (6), (8) and (10) at once.

    Along a rigid motion that the states leave free, where K is round-off, the body stays where it
    is in ``u``. Stuck nodes stick at ``v_ref`` (N,). None if the states leave another motion free.
    """
    n, K, held = system.n, system.K, system.held
    u = u.copy()
    grounded = (state != SEPARATION) & ~held[n:]
    u[n:][grounded] = -system.g0[grounded]
    stuck = (state == STICK) & ~held[:n]
    u[:n][stuck] = v_ref[stuck]
    free_t = np.flatnonzero((state != STICK) & ~held[:n])
    free_n = np.flatnonzero((state == SEPARATION) & ~held[n:])
    free = np.concatenate([free_t, n + free_n])
    if len(free) == 0:
        return u
    motions = neutral_motions(system.rigid, np.concatenate([stuck, grounded]))
    if motions.shape[1]:
        K = K + float(np.abs(np.diagonal(K)).max()) * motions @ motions.T
    f = system.friction.at_slip(state)[free_t]
    rows = K.take(free, axis=0)
    rows[: len(f)] += f[:, None] * K.take(n + free_t, axis=0)
    matrix = rows.take(free, axis=1)
    r = reactions(system, load, u)
    rhs = r[free]
    rhs[: len(f)] += f * r[n + free_t]
    try:
        u[free] -= np.linalg.solve(matrix, rhs)
    except np.linalg.LinAlgError:
        return None
    return u
