"""Whether the drifts of a contact have one limit only.

The nodes that stick for good keep the slips from which they began. Other initial slips may lead to
other limits, also where the drifts have one limit only.
"""

from __future__ import annotations

from itertools import combinations

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


def _drifts(found: Candidate) -> tuple[Array, Array, Array, Array]:
    """Return drifts y, margins m towards the nearer limits, M = dm/dy, stiffnesses k of nodes."""
    frozen, solution = found.frozen, found.solution
    assert solution is not None
    m, nodes = solution.margins, frozen.shifted
    forward = (solution.active > 0) | ((solution.active == 0) & (m.A < m.B))
    signs, at = np.where(forward, 1.0, -1.0), np.where(forward, m.at_A, m.at_B)
    moved = frozen.periodic_change(solution.cycle)
    M = margin_derivatives(frozen, solution.cycle, moved, nodes, signs, at) * signs
    k = local_stiffness(frozen.system)[0][nodes]
    return np.maximum(signs * solution.shifts, 0.0), np.where(forward, m.A, m.B), M, k


def is_overshot(found: Candidate, part: float = 0.0) -> bool:
    """Return whether a node would slip beyond the limit on the way to it, and stay there.

    To first order each cycle adds max(-m, 0) / M_ii to the drifts y, with m = m* + M (y - y*), and
    nothing takes them back. From y = 0 they end at the limit y* where no M_ij > 0 (i other than j):
    it is the least solution. Elsewhere a node may pass it while others still drift. True also where
    they drift for more than ``MAX_DRIFTING`` cycles.

    Args:
        found: the limit.
        part: part of the largest drift by which nodes may pass it.
    """
    if found.solution is None or not len(found.frozen.shifted):
        return False
    limit, m, M, k = _drifts(found)
    bound, diagonal = OVERSHOT * found.frozen.force / k + part * limit.max(), np.diag(M)
    if np.any(diagonal <= 0.0):
        return True
    if np.all(M - np.diag(diagonal) <= 0.0):
        return False
    y, m = np.zeros_like(limit), m - M @ limit
    for _ in range(MAX_DRIFTING):
        step = np.maximum(-m, 0.0) / diagonal
        if np.all(step <= NO_STEP * bound):
            return False
        y, m = y + step, m + M @ step
        if np.any(y > limit + bound):
            break
    return True


def is_unique(found: Candidate) -> tuple[int, str]:
    """Return whether no other drifts satisfy the complementarity, to first order, and why.

    The block M of the derivatives of the smallest margins in the drifts, both towards the limit
    that is nearer, must be a P-matrix: then y >= 0, m = q + M y >= 0, y . m = 0 has one solution
    whatever q. M is that of the cycle found; other cycles may change state in another order.
    """
    if found.solution is None:
        return NOT_EXAMINED, "whether the body may walk otherwise is not examined"
    if not len(found.frozen.shifted):
        return YES, "no node drifts"
    M, k = _drifts(found)[2:]
    verdict = is_p_matrix(M / np.sqrt(k)[:, None] / np.sqrt(k))
    if verdict is None:
        return NOT_EXAMINED, "whether the drifts have one limit only is not decided"
    if verdict:
        return YES, "the derivatives of the margins in the drifts are a P-matrix"
    return NO, "the derivatives of the margins in the drifts are no P-matrix"
