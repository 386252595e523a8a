r"""Largest load range round which a contact moves without slip while nodes open and close.

A steady motion without dissipation is piecewise linear in the loads. At its points $p$, the corners
of the range and the places between them at which the set of closed nodes changes,

$$r_p = r^*_m + \lambda\, r^*_a + \tau_p (r^*_b - r^*_a) + K u_p , \qquad
  0 \le \tau_p \le \tau_{p+1} \le \lambda \quad \text{on the leg from corner } a \text{ to } b,$$

reactions lie in the friction cone and no gap is negative. Between two points a node is closed
($z = 1$), with gap 0 and the same $v$ at both, or open ($z = 0$), without reactions at both. For
given sets all conditions are linear and hold between the points if they hold at them. So such
points are necessary and sufficient for a motion with as many changes of the set. One slip at all
corners is neither: a node must close where it opens, and need not close at the same slip each time.

The largest $\lambda$ is a mixed-integer linear program. Two corners need one leg, as a motion
without dissipation can be reversed. On a loop of more, a node with friction that opens would have
to lose both reactions at once at two places, which it does by chance only.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray
from scipy import sparse

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.residual import law_residual
from receding_fenicsx.interface.shakedown.margins import BINDS, LoadRange
from receding_fenicsx.interface.system import ContactSystem

LARGEST = 10.0
"""Largest reaction over that of the largest loads with all nodes held, and displacement over that
of such a force, that the programs look at (the big M of the binaries)."""


@dataclass(frozen=True)
class Opening:
    """Largest range round which a motion without slip was found, and the motion."""

    value: float  # lambda
    top: float  # the largest lambda that was looked at
    slip: Array  # (N,) tangential displacements at the first corner
    closed: NDArray[np.bool_]  # (intervals, N) nodes that are closed between the points
    # no such motion goes further with as many changes of the set as nodes may open (two on each leg
    # of a loop), these nodes, and numbers below ``LARGEST``
    best: bool
    cut: bool  # the search ended before its last program was solved
    residual: float  # largest violation of the contact law at the points, over the largest force
    # largest of exact cycles from ``slip`` at just below ``value``, over F^2 / K_ii of the largest
    # force F; NaN before they are played
    dissipation: float = np.nan


class _Motion(NamedTuple):
    """Answer of a program: mu, states (intervals, N), u (points, 2N) and tau at the points."""

    mu: float
    sets: Ints
    u: Array
    tau: Array
    proved: bool


class _Task(NamedTuple):
    """Scaled contact, nodes that may open, held reactions to mean loads and corners at mu = 1."""

    system: ContactSystem
    opens: NDArray[np.bool_]
    mean: Array
    D: Array

    @property
    def legs(self) -> int:
        """Number of legs: one to and fro between two corners, or a loop."""
        return len(self.D) if len(self.D) > 2 else 1

    def corners(self, p: int, intervals: int) -> tuple[Array, Array, int]:
        """Return the corners between which point p lies, and its place among the points there."""
        leg, inner = divmod(p, intervals // self.legs)
        return self.D[leg % len(self.D)], self.D[(leg + 1) % len(self.D)], inner


def largest_opening(
    system: ContactSystem, loads: LoadRange, opens: NDArray[np.bool_], top: float
) -> Opening:
    """Return the largest range up to ``top`` round which a motion without slip was found.

    First all nodes stay as they are; then the sequence of sets grows by one unknown set at either
    end while that helps. Where few nodes open, all its sets are unknown at last. ``opens`` are the
    (N,) nodes that may open; all others stay closed.
    """
    mean, D = loads.mean @ system.r_star, top * (loads.vertices @ system.r_star)
    force = float(np.abs(mean).max() + np.abs(D).max())
    slip = force / float(system.local_stiffness[0].max())
    opens = opens & ~system.held[system.n :]
    scaled = replace(system, K=system.K * (slip / force), g0=system.g0 / slip)
    task = _Task(scaled, opens, mean / force, D / force)
    unknown, many = np.where(opens, -1, 1)[None], int(opens.sum())
    found = _solved(task, np.repeat(unknown, task.legs, axis=0), None)
    proved = found.proved
    while task.legs == 1:
        changed = np.any(np.diff(found.sets, axis=0) != 0, axis=1)
        chain = found.sets[np.append(True, changed)]
        more = _solved(task, np.vstack([unknown, chain, unknown]), found)
        proved = more.proved
        if more.mu <= found.mu * (1.0 + 1e-6):
            break
        found = more
    # a loop has two changes of the set on each leg
    intervals = 3 * task.legs if task.legs > 1 else max(many + 1, len(found.sets))
    # all states chosen by one program of at most so many binaries
    best = intervals * many <= 30
    if best:
        found = _solved(task, np.repeat(unknown, intervals, axis=0), found)
        best = proved = found.proved
    residual = _residual(task, found)
    if residual > BINDS:
        raise SolveError(f"a motion without slip violates the contact law by {residual:.1e}")
    first = slip * found.u[0, : system.n]
    return Opening(found.mu * top, top, first, found.sets == 1, best, not proved, residual)


def _solved(task: _Task, pattern: Ints, known: _Motion | None) -> _Motion:
    """Return the motion of the largest range with given states, or what was known before."""
    chosen = _program(task, pattern, 0.0 if known is None else known.mu * (1.0 - BINDS))
    final = None if chosen is None else _program(task, chosen.sets, 0.0)
    if final is None or (known is not None and final.mu <= known.mu):
        final = known
    if final is None:
        raise SolveError("shakedown: no motion without slip was found at any load range")
    return final._replace(proved=chosen is not None and chosen.proved)


def _program(task: _Task, pattern: Ints, at_least: float) -> _Motion | None:
    """Solve one program for states (intervals, N), -1 where it chooses; None without an answer."""
    rows = _Rows(task, len(pattern))
    rows.choose(pattern)
    binary, unknown = slice(*rows.ends[4:6]), (pattern < 0).ravel()
    integral, cost = np.zeros((2, rows.ends[-1]))
    integral[binary], cost[-1] = unknown, -1.0
    found = scipy.optimize.milp(
        cost,
        integrality=integral,
        bounds=rows.bounds(pattern, at_least),
        constraints=scipy.optimize.LinearConstraint(
            sparse.vstack(rows.matrices, format="csr"), np.concatenate(rows.least), np.inf
        ),
        options={"node_limit": 10_000},  # the best motion found by then is taken, and said so
    )
    if found.x is None:
        return None
    u, tau = np.array([M @ found.x for M in rows.u]), found.x[slice(*rows.ends[3:5])]
    sets = np.rint(found.x[binary]).astype(int).reshape(pattern.shape)
    return _Motion(float(found.x[-1]), sets, u, tau, found.status == 0)


class _Rows:
    """Unknowns of a program, and its conditions M x >= b.

    Unknowns: displacements that are the same at all points and the forces K u that they cause;
    those that differ and tau, of each point; z of each interval; mu.
    """

    def __init__(self, task: _Task, intervals: int) -> None:
        """Set up the points between the intervals, and the laws that hold in any state there."""
        self.task, n = task, task.system.n
        points, mean = intervals + (task.legs == 1), task.mean
        (loose, normal), friction = ~task.system.held.reshape(2, n), task.system.friction
        varies = np.concatenate([task.opens | ~friction.present, task.opens])
        self.own = own = varies & ~task.system.held
        m, K = int(own.sum()), sparse.csr_matrix(task.system.K)
        self.ends = np.cumsum([0, 2 * n, 2 * n, points * m, points, intervals * n, 1])
        unit = sparse.identity(self.ends[-1], format="csr")
        common, forces, moved, tau, z, mu = (unit[a:b] for a, b in itertools.pairwise(self.ends))
        self.matrices, self.least = [forces - K @ common, K @ common - forces], [np.zeros(4 * n)]
        self.u, self.r, self.z = [], [], [z[k * n : (k + 1) * n] for k in range(intervals)]
        for p in range(points):
            a, b, inner = task.corners(p, intervals)
            its = sparse.identity(2 * n, format="csr")[:, own] @ moved[p * m : (p + 1) * m]
            load = [sparse.csr_matrix(c[:, None]) for c in (a, b - a)]
            self.u.append(common + its)
            self.r.append(forces + K @ its + load[0] @ mu + load[1] @ tau[p])
            if inner:
                self.add(mu - tau[p])
                self.add(tau[p] - tau[p - 1])  # tau = 0 at the corner before
            # friction limits, pressure and gap
            Q, P = self.r[p][:n], self.r[p][n:]
            for sign, f in ((1.0, friction.forward), (-1.0, friction.backward)):
                constant = sign * mean[:n] + f * mean[n:]
                self.add((sign * Q + sparse.diags(f) @ P)[loose], -constant[loose])
            self.add(P[normal], -mean[n:][normal])
            self.add(self.u[p][n:][normal], -task.system.g0[normal])

    def add(self, matrix: sparse.csr_matrix, least: Array | float = 0.0) -> None:
        """Add conditions."""
        self.matrices.append(matrix)
        self.least.append(np.broadcast_to(least, matrix.shape[:1]))

    def choose(self, pattern: Ints) -> None:
        """Require that nodes are closed or open; near a known set few of them differ from it."""
        system, n, mean = self.task.system, self.task.system.n, self.task.mean
        loose, normal = ~system.held.reshape(2, n)
        sticks = loose & system.friction.present
        for k, states in enumerate(pattern):
            z, pair = LARGEST * self.z[k], (k, (k + 1) % len(self.u))
            for p in pair:
                self.add((-self.u[p][n:] - z)[normal], (system.g0 - LARGEST)[normal])
                self.add((z - self.r[p][n:])[normal], mean[n:][normal])
            change = (self.u[pair[1]] - self.u[pair[0]])[:n]
            for sign in (1.0, -1.0):
                self.add((sign * change - z)[sticks], -LARGEST)
            for known in pattern[max(k - 1, 0) : k + 2]:
                nodes = (states < 0) & (known >= 0)
                sign = np.where(known == 1, 1.0, -1.0)[nodes]
                stay = sparse.csr_matrix(sign) @ self.z[k][nodes]
                # two nodes open or close at such a change
                self.add(stay, float((sign > 0.0).sum()) - 2)

    def bounds(self, pattern: Ints, at_least: float) -> scipy.optimize.Bounds:
        """Return the bounds of all unknowns."""
        system, n, points = self.task.system, self.task.system.n, len(self.u)
        fixed, shut = system.held | self.own, -system.g0
        large, many = np.full(n, LARGEST), np.full(self.ends[3] - self.ends[1], np.inf)
        inner = np.arange(points) % (len(self.z) // self.task.legs) > 0
        least, most = (
            [np.where(fixed, 0.0, np.append(sign * large, shut)), sign * many] for sign in (-1, 1)
        )
        least += [np.zeros(points), np.maximum(pattern, 0).ravel(), np.array([at_least])]
        most += [inner, np.abs(pattern).ravel(), np.ones(1)]
        return scipy.optimize.Bounds(np.concatenate(least), np.concatenate(most))


def _residual(task: _Task, found: _Motion) -> float:
    """Return the largest violation of the law at both ends of all intervals, over the force."""
    system, K, many = task.system, task.system.local_stiffness, len(found.sets)
    r = found.u @ system.K + task.mean
    for p, tau in enumerate(found.tau):
        a, b, _ = task.corners(p, many)
        r[p] += found.mu * a + tau * (b - a)
    worst = 0.0
    for k, closed in enumerate(found.sets == 1):
        pair = [k, (k + 1) % len(r)]
        slip = np.where(closed, np.diff(found.u[pair, : system.n], axis=0), 0.0)
        worst = max(worst, float(law_residual(system, r[pair], found.u[pair], slip, K).max()))
    return worst / float(np.abs(r).max())
