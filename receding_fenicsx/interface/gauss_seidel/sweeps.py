"""The frictional Gauss-Seidel method of Ahn & Barber (2008), section 2.2 and Fig. 3.

The displacements of one node at a time are updated, those of the others held. At each node the last
state is assumed, its equations (4), (6), (8) or (10) are solved, the inequalities (5), (7), (9),
(10) are checked, and on a violation the state is changed and the node solved again. Sweeps end when
eq. (16) *and* the residual of the contact law, evaluated afresh, are under their tolerances.

Two optional accelerations leave the answer alone: over-relaxation of slipping and separated
nodes, and a polish: once the states have settled, one direct solve with these states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import daxpy

from receding_fenicsx.errors import NotConverged
from receding_fenicsx.interface.gauss_seidel.direct import solve_directly
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.residual import (
    largest_force,
    law_residual,
    local_stiffness,
    round_off,
)
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem, reactions

STICK, SEPARATION = int(State.STICK), int(State.SEPARATION)
FORWARD, BACKWARD = int(State.FORWARD_SLIP), int(State.BACKWARD_SLIP)

TRIED_AFTER = {
    STICK: (STICK, FORWARD, BACKWARD, SEPARATION),
    SEPARATION: (SEPARATION, STICK, FORWARD, BACKWARD),
    FORWARD: (FORWARD, STICK, SEPARATION, BACKWARD),
    BACKWARD: (BACKWARD, STICK, SEPARATION, FORWARD),
}
"""Order in which a node's states are assumed, by its last state: likely changes first."""

SETTLE_SWEEPS = 2
"""Sweeps without a change of state after which a polish is tried."""

POLISH_GAIN = 1e-1
"""Part of the residual that a polish may leave. One with wrong states may leave less than there was
but carry the body far away, from where sweeps take for ever."""

CHECK_SWEEPS = 10
"""Sweeps between two evaluations of the residual when eq. (16) alone is not yet met, and between
two polishes of the same states."""

STALLED_GAIN = 0.1
"""Part of the residual that is left after ``stalled_sweeps`` where sweeps lead to an end."""

SWEEPS_PER_NODE = 10
"""Sweeps for each node of a large contact that count as one gain: plain ones carry a change on by
about one node."""

SINGULAR = 4.0 * float(np.finfo(float).eps)
"""Stiffness of a node in a state, over the terms that it is the difference of, that is none."""

FORCE_ROUND_OFFS = 8.0
"""Round-offs of the history's largest nodal force below which a force that changes in a sweep does
not count: where the displacements themselves are round-off they never settle."""

ROUND_OFF_REACH = 100.0
"""A residual this many times its tolerance is still accepted where round-off leaves no better
one."""


@dataclass(frozen=True)
class GaussSeidelOptions:
    """Options of the sweeps.

    Attributes:
        over_relaxation: factor on the update of slipping and separated nodes; 1 is plain.
        polish: solve directly once the states have settled.
        change_tolerance: eq. (16), last change of a displacement over the step's largest
        displacement.
        residual_tolerance: residual of the contact law over the history's largest nodal force.
        max_sweeps: sweeps after which the step is given up with an error.
        stalled_sweeps: sweeps, or ``SWEEPS_PER_NODE``, that must cut the residual to
        ``STALLED_GAIN``; those that do not cycle or creep and are stopped before.
    """

    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-12
    max_sweeps: int = 20000
    stalled_sweeps: int = 1000


class Stalled(NotConverged):
    """The sweeps cycle or creep: with friction they may, though the step has a solution."""


@dataclass(frozen=True)
class Step:
    """An accepted load step.

    Attributes:
        end: displacements, reactions and states at the end of the step.
        dissipation: (N,) frictional dissipation, -(Q_old + Q_new)/2 (v_new - v_start).
        residual: residual of the contact law over ``force_scale``.
        force_scale: largest nodal force of the history so far.
        sweeps: number of sweeps.
    """

    end: ContactState
    dissipation: Array
    residual: float
    force_scale: float
    sweeps: int


def solve_step(
    system: ContactSystem,
    start: ContactState,
    load: Array,
    options: GaussSeidelOptions,
    force_scale: float = 0.0,
    guess: ContactState | None = None,
) -> Step:
    """Advance the contact from ``start`` to the load factors ``load`` in one step.

    Args:
        system: the condensed body, ``kind = "frictional"``.
        start: state at the start of the step.
        load: (n_loads,) load factors at the end of the step.
        options: tolerances and accelerations.
        force_scale: largest nodal force of the history so far.
        guess: displacements and states that the sweeps begin with; ``start`` by default.

    Returns:
        The accepted step.

    Raises:
        NotConverged: the sweeps ran out; the message holds the residual and the worst node.
        Stalled: they have stopped gaining.
    """
    sweeper = _Sweeper(system, start, load, options, guess or start)
    stiffness = local_stiffness(system)
    largest = largest_force(system, load, start.r, force_scale)
    noise = FORCE_ROUND_OFFS * float(np.finfo(float).eps) * largest
    still = noise / max(float(np.max(stiffness)), float(np.finfo(float).tiny))
    omega = options.over_relaxation
    settled = since_check = 0
    residual, worst, best = np.inf, 0, np.inf
    gained, gained_at = np.inf, 0
    patience = max(options.stalled_sweeps, SWEEPS_PER_NODE * system.n)
    for sweep in range(1, options.max_sweeps + 1):
        changed, moved = sweeper.sweep(omega)
        span = float(np.abs(sweeper.u).max())
        change = moved / span if moved > still and span > 0.0 else 0.0
        settled = 0 if changed else settled + 1
        since_check += 1
        if options.polish and settled >= SETTLE_SWEEPS:
            sweeper.polish()
            settled = 0 if sweeper.polished else SETTLE_SWEEPS - CHECK_SWEEPS
        elif (
            change > options.change_tolerance
            and since_check < CHECK_SWEEPS
            and sweep < options.max_sweeps
        ):
            continue
        since_check = 0
        residual, worst, scale = sweeper.residual(stiffness, force_scale)
        if sweeper.reached(residual, scale) and (
            change <= options.change_tolerance or sweeper.polished
        ):
            return sweeper.accept(residual, scale, sweep)
        # over-relaxation has no convergence proof with friction: return to plain sweeps on growth
        if residual > 10 * best:
            omega = 1.0
        best = min(best, residual)
        if residual < STALLED_GAIN * gained:
            gained, gained_at = residual, sweep
        elif sweep - gained_at >= patience:
            break
    node = worst % system.n
    raise (NotConverged if sweep == options.max_sweeps else Stalled)(
        f"Gauss-Seidel stopped after {sweep} sweeps at load factors {load.tolist()}: "
        f"residual {residual:.1e} at node {node} (x = {system.x[node]:.6g}), tolerance "
        f"{options.residual_tolerance:.1e}; take more steps per leg, more sweeps, or method events"
    )


def local_solution(
    Q0: float,
    P0: float,
    k_t: float,
    k_n: float,
    c: float,
    f: float,
    w_c: float,
    v_ref: float,
    state: int,
    w: float = -np.inf,
) -> tuple[int, float, float]:
    """Solve one node by the paper's rule: assume the last state, check, change, solve again.

    With the other nodes held the reactions are Q = Q0 + k_t v + c w and P = P0 + c v + k_n w.

    Args:
        Q0: tangential reaction at v = w = 0.
        P0: normal reaction there.
        k_t: tangential diagonal entry of K.
        k_n: normal one.
        c: entry that couples the node's v and w.
        f: coefficient of friction.
        w_c: normal displacement at which the gap closes, -g0.
        v_ref: tangential displacement that the slip of this step is counted from.
        state: state assumed first.
        w: normal displacement before, which an open node without normal stiffness keeps.

    Returns:
        State, v and w of the first state whose inequalities all hold: the only one if f |c| < k_t.
        If none does, a node without stiffness along some motion is open unless loads press it. Any
        other node (possible only if f |c| >= k_t) is left sticking; the residual then keeps the
        step from being accepted.
    """
    for assumed in TRIED_AFTER[state]:
        if assumed == SEPARATION:
            det = k_t * k_n - c * c
            if det <= SINGULAR * k_t * k_n:
                continue  # nothing holds it, and no displacement balances the loads
            w = (-P0 * k_t + Q0 * c) / det
            if w >= w_c:
                return SEPARATION, (-Q0 * k_n + P0 * c) / det, w
        elif assumed == STICK:
            P = P0 + c * v_ref + k_n * w_c
            if P > 0.0 and abs(Q0 + k_t * v_ref + c * w_c) <= f * P:
                return STICK, v_ref, w_c
        else:
            sign = 1.0 if assumed == FORWARD else -1.0
            stiffness = k_t + sign * f * c
            if abs(stiffness) <= SINGULAR * k_t:
                continue  # slip does not change the distance from its limit
            v = -(Q0 + c * w_c + sign * f * (P0 + k_n * w_c)) / stiffness
            if sign * (v - v_ref) >= 0.0 and P0 + c * v + k_n * w_c > 0.0:
                return assumed, v, w_c
    if k_t * k_n - c * c <= SINGULAR * k_t * k_n:
        return _open_without_stiffness(Q0, P0, k_t, k_n, c, w_c, v_ref, w)
    return STICK, v_ref, w_c


def _open_without_stiffness(
    Q0: float, P0: float, k_t: float, k_n: float, c: float, w_c: float, v_ref: float, w: float
) -> tuple[int, float, float]:
    """Open a node whose K is singular unless loads press it; arguments of ``local_solution``."""
    if k_t > 0.0:
        coupled = c * Q0 / k_t
        if P0 - coupled <= SINGULAR * (abs(P0) + abs(coupled)):
            w = max(w, w_c)
            return SEPARATION, -(Q0 + c * w) / k_t, w
    elif P0 + k_n * w_c <= 0.0:
        return SEPARATION, v_ref, -P0 / k_n if k_n > 0.0 else max(w, w_c)
    return STICK, v_ref, w_c


class _Sweeper:
    """The working arrays of one step: displacements, reactions kept up by columns, states."""

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
        self.u = guess.u.copy()
        self.r = reactions(system, load, self.u)
        self.state = guess.state.astype(int).tolist()
        self.v_ref = start.v.tolist()
        self.gap = (system.g0 + start.w).tolist()
        self.was_open = (start.state == SEPARATION).tolist()
        diagonal = np.diagonal(system.K)
        self.k_t, self.k_n = diagonal[:n].tolist(), diagonal[n:].tolist()
        self.c = system.K[np.arange(n), np.arange(n) + n].tolist()
        self.f, self.w_c = system.f.tolist(), (-system.g0).tolist()
        self.held_t, self.held_n = system.held[:n].tolist(), system.held[n:].tolist()
        self.polished = False

    def sweep(self, omega: float) -> tuple[bool, float]:
        """Update every node once; return whether a state changed and the largest change of u."""
        u, r, K, n = self.u, self.r, self.system.K, self.system.n
        largest = 0.0
        changed = self.polished = False
        for i in range(n):
            v, w, last = float(u[i]), float(u[n + i]), self.state[i]
            if self.held_n[i] and self.held_t[i]:
                continue
            k_t, k_n, c = self.k_t[i], self.k_n[i], self.c[i]
            Q0 = float(r[i]) - k_t * v - c * w
            P0 = float(r[n + i]) - c * v - k_n * w
            if self.held_t[i]:
                state, v_new, w_new = self._held_tangentially(i, P0)
            elif self.held_n[i]:
                # the support carries it: it slides freely
                state, v_new, w_new = FORWARD, -(Q0 + c * w) / k_t if k_t else v, w
            else:
                if self.was_open[i]:
                    self._touch_down(i, Q0, P0)
                state, v_new, w_new = local_solution(
                    Q0, P0, k_t, k_n, c, self.f[i], self.w_c[i], self.v_ref[i], last, w
                )
            if state != last:
                self.state[i] = state
                changed = True
            elif omega != 1.0 and state != STICK:
                v_new, w_new = self._relax(i, state, omega, (v, w), (v_new, w_new))
            if v_new != v:
                daxpy(K[i], r, a=v_new - v)
                u[i] = v_new
                largest = max(largest, abs(v_new - v))
            if w_new != w:
                daxpy(K[n + i], r, a=w_new - w)
                u[n + i] = w_new
                largest = max(largest, abs(w_new - w))
        return changed, largest

    def _held_tangentially(self, i: int, P0: float) -> tuple[int, float, float]:
        """Solve a node whose tangential displacement is fixed: Signorini's law alone."""
        v, w = float(self.u[i]), self.w_c[i]
        if P0 + self.c[i] * v + self.k_n[i] * w > 0.0:
            return STICK, v, w
        if self.k_n[i] == 0.0:  # nothing but the contact holds it: it stays where it is
            return SEPARATION, v, max(w, float(self.u[self.system.n + i]))
        return SEPARATION, v, -(P0 + self.c[i] * v) / self.k_n[i]

    def _touch_down(self, i: int, Q0: float, P0: float) -> None:
        """Set v_ref to the estimated point of first contact on a straight path (section 2.2)."""
        k_t, k_n, c = self.k_t[i], self.k_n[i], self.c[i]
        det = k_t * k_n - c * c
        if det <= SINGULAR * k_t * k_n:
            # free to fall: without tangential force down to the plane
            self.v_ref[i] = -(Q0 + c * self.w_c[i]) / k_t if k_t > 0.0 else float(self.start.u[i])
            return
        v0 = (-Q0 * k_n + P0 * c) / det
        trial_gap = (-P0 * k_t + Q0 * c) / det - self.w_c[i]
        if trial_gap < 0.0:
            v, gap = float(self.start.u[i]), max(self.gap[i], 0.0)
            self.v_ref[i] = v + (v0 - v) * gap / (gap - trial_gap)

    def _relax(
        self, i: int, state: int, omega: float, old: tuple[float, float], new: tuple[float, float]
    ) -> tuple[float, float]:
        """Over-relax the update unless that breaks the state's own inequality."""
        v = old[0] + omega * (new[0] - old[0])
        if state == SEPARATION:
            w = old[1] + omega * (new[1] - old[1])
            return (v if not self.held_t[i] else new[0], w) if w >= self.w_c[i] else new
        forward = v >= self.v_ref[i]
        return (v, new[1]) if forward == (state == FORWARD) else new

    def polish(self) -> None:
        """Solve directly with the present states; keep what betters the residual much."""
        stiffness = local_stiffness(self.system)
        before = self.residual(stiffness, 0.0)[0]
        state, v_ref = np.array(self.state), np.array(self.v_ref)
        u = solve_directly(self.system, self.load, self.u, v_ref, state)
        if u is None:
            return
        kept = self.u, self.r, list(self.v_ref)
        self.u, self.r = u, reactions(self.system, self.load, u)
        for i in np.flatnonzero(self.was_open):
            if not self.held_t[i]:
                self._touch_down_at(int(i))
        if self.residual(stiffness, 0.0)[0] < POLISH_GAIN * before:
            self.polished = True
        else:
            self.u, self.r, self.v_ref = kept

    def _touch_down_at(self, i: int) -> None:
        """Recompute v_ref of node i from the present displacements."""
        n = self.system.n
        v, w = float(self.u[i]), float(self.u[n + i])
        Q0 = float(self.r[i]) - self.k_t[i] * v - self.c[i] * w
        P0 = float(self.r[n + i]) - self.c[i] * v - self.k_n[i] * w
        self._touch_down(i, Q0, P0)

    def reached(self, residual: float, scale: float) -> bool:
        """Return whether the residual is under its tolerance, or as small as round-off allows."""
        tolerance = self.options.residual_tolerance
        if residual <= tolerance:
            return True
        if residual > ROUND_OFF_REACH * tolerance:
            return False
        return residual <= round_off(self.system, self.u, scale)

    def residual(
        self, stiffness: tuple[Array, Array], force_scale: float
    ) -> tuple[float, int, float]:
        """Return the fresh relative residual, its worst entry, and the force scale."""
        r = reactions(self.system, self.load, self.u)
        scale = largest_force(self.system, self.load, r, force_scale)
        slip = self.u[: self.system.n] - np.array(self.v_ref)
        both = law_residual(self.system, r, self.u, slip, stiffness)
        worst = int(np.argmax(both))
        return (float(both[worst]) / scale if scale > 0.0 else 0.0), worst, scale

    def accept(self, residual: float, scale: float, sweeps: int) -> Step:
        """Return the step with fresh reactions and its dissipation."""
        n = self.system.n
        r = reactions(self.system, self.load, self.u)
        end = ContactState(self.u, r, np.array(self.state, dtype=np.int8))
        # without friction there is no slip to tell from stick
        end.state[(self.system.f == 0.0) & (end.state != SEPARATION)] = STICK
        v_start = np.array(self.v_ref)
        touched = np.array(self.was_open) & (end.state != SEPARATION)
        Q_old = np.where(touched, 0.0, self.start.Q)
        slip = np.where(end.state == SEPARATION, 0.0, end.v - v_start)
        # what no friction holds may drift far under forces of the size of round-off
        slip[self.system.held[:n] | (self.system.f == 0.0)] = 0.0
        return Step(end, -0.5 * (Q_old + end.Q) * slip, residual, scale, sweeps)
