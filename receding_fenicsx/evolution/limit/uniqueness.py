"""Whether the drifts of a contact have one limit only.

The nodes that stick for good keep the slips from which they began. Other initial slips may lead to
other limits, also where the drifts have one limit only.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.limit.newton import margin_derivatives
from receding_fenicsx.evolution.limit.search import Candidate
from receding_fenicsx.interface.residual import local_stiffness

ALL_MINORS = 12
"""Largest matrix all of whose principal minors are computed."""

OVERSHOT = 1e-10
"""Slip beyond the limit, as a force over the largest nodal force, that is none."""

NO_STEP = 1e-2
"""Slip of a cycle, over that, with which the drifts have come to their end."""

MAX_DRIFTING = 20_000
"""Cycles of drifts, to first order, after which a limit counts as passed: it is not shown."""

LOOKED_AT = 16
"""Cycles of drifts after which they are looked at."""

YES, NO, NOT_EXAMINED = 1, 0, -1


def is_p_matrix(M: Array) -> bool | None:
    """Return whether all principal minors are positive; None where that is not decided.

    A positive definite symmetric part is enough. Elsewhere the minors are computed, up to
    ``ALL_MINORS`` rows.

        >>> is_p_matrix(np.array([[1.0, -3.0], [0.0, 1.0]]))
        True
        >>> is_p_matrix(np.array([[1.0, 2.0], [2.0, 1.0]]))
        False
    """
    n = len(M)
    if n == 0 or np.linalg.eigvalsh(0.5 * (M + M.T)).min() > 0.0:
        return True
    if n > ALL_MINORS:
        return None
    subsets = (list(s) for k in range(1, n + 1) for s in combinations(range(n), k))
    return all(np.linalg.det(M[np.ix_(s, s)]) > 0.0 for s in subsets)


class Drifts(NamedTuple):
    """Drifts at a limit, to first order.

    Attributes:
        y: (k,) drifts.
        m: (k,) smallest margins towards the limits that are nearer.
        M: (k, k) dm/dy.
        stiffness: (k,) local stiffnesses of the nodes.
    """

    y: Array
    m: Array
    M: Array
    stiffness: Array


def drifts_of(found: Candidate) -> Drifts | None:
    """Return the drifts at a limit; None where none are counted."""
    frozen, solution = found.frozen, found.solution
    if solution is None or not len(frozen.shifted):
        return None
    m, nodes = solution.margins, frozen.shifted
    forward = (solution.active > 0) | ((solution.active == 0) & (m.A < m.B))
    signs, at = np.where(forward, 1.0, -1.0), np.where(forward, m.at_A, m.at_B)
    moved = frozen.periodic_change(solution.cycle)
    M = margin_derivatives(frozen, solution.cycle, moved, nodes, signs, at) * signs
    k = local_stiffness(frozen.system)[0][nodes]
    y = np.maximum(signs * solution.shifts, 0.0)
    return Drifts(y, np.where(forward, m.A, m.B), M, k)


def is_overshot(drifts: Drifts, force: float, part: float = 0.0) -> bool:
    """Return whether a node would slip beyond the limit on the way to it, and stay there.

    To first order each cycle adds max(-m, 0) / M_ii to the drifts y, with m = m* + M (y - y*), and
    nothing takes them back. From y = 0 they end at the limit y* where no M_ij > 0 (i other than j):
    it is the least solution. Elsewhere a node may pass it while others still drift. True also where
    they drift for more than ``MAX_DRIFTING`` cycles.

    Args:
        drifts: drifts at the limit.
        force: largest nodal force of the history.
        part: part of the largest drift by which nodes may pass it.
    """
    limit, m, M, k = drifts
    bound, diagonal = OVERSHOT * force / k + part * limit.max(), np.diag(M)
    if np.any(diagonal <= 0.0):
        return True
    if np.all(M - np.diag(diagonal) <= 0.0):
        return False
    y, violated = np.zeros_like(limit), M @ limit - m
    for cycle in range(MAX_DRIFTING):
        step = np.maximum(violated, 0.0)
        step /= diagonal
        y += step
        violated -= M.dot(step)
        if cycle % LOOKED_AT == 0:  # y only grows
            if np.any(y > limit + bound):
                break
            if np.all(step <= NO_STEP * bound):
                return False
    return True


def is_unique(drifts: Drifts) -> tuple[int, str]:
    """Return whether no other drifts satisfy the complementarity, to first order, and why.

    The block M of the derivatives of the smallest margins in the drifts, both towards the limit
    that is nearer, must be a P-matrix: then y >= 0, m = q + M y >= 0, y . m = 0 has one solution
    whatever q. M is that of the cycle found; other cycles may change state in another order.
    """
    scale = 1.0 / np.sqrt(drifts.stiffness)
    verdict = is_p_matrix(scale[:, None] * drifts.M * scale)
    if verdict is None:
        return NOT_EXAMINED, "whether the drifts have one limit only is not decided"
    if verdict:
        return YES, "the derivatives of the margins in the drifts are a P-matrix"
    return NO, "the derivatives of the margins in the drifts are no P-matrix"
