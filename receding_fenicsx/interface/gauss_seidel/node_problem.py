"""The contact law of one node, the displacements of all others held (Fig. 3 of the paper).

The reactions of the node are Q = Q0 + k_t v + c w and P = P0 + c v + k_n w. In the state that is
assumed the equations (4), (6), (8) or (10) are solved and the inequalities (5), (7), (9), (10)
checked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, slips, sticks
from receding_fenicsx.interface.system import ContactSystem

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


def node_problems(system: ContactSystem) -> list[NodeProblem]:
    """Return the problems of all nodes of a system, ``kind = "frictional"``."""
    n, K, friction = system.n, system.K, system.friction
    stiffness = np.diagonal(K)[:n], np.diagonal(K)[n:], np.diagonal(K[:n, n:])
    rows = zip(*stiffness, friction.forward, friction.backward, -system.g0, strict=True)
    return [NodeProblem(*map(float, row)) for row in rows]
