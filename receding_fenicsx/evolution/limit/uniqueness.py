"""Whether the drifts of a contact have one limit only.

The nodes that stick for good keep the slips from which they began. Other initial slips may lead to
other limits, also where the drifts have one limit only.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from receding_fenicsx.arrays import Array

ALL_MINORS = 12
"""Largest matrix all of whose principal minors are computed."""

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


def is_unique(M: Array, stiffness: Array) -> tuple[int, str]:
    """Return whether no other drifts satisfy the complementarity, to first order, and why.

    The derivatives M of the smallest margins in the drifts, both towards the limit that is nearer,
    must be a P-matrix: then y >= 0, m = q + M y >= 0, y . m = 0 has one solution whatever q. M is
    that of the cycle found; other cycles may change state in another order.
    """
    scale = 1.0 / np.sqrt(stiffness)
    verdict = is_p_matrix(scale[:, None] * M * scale)
    if verdict is None:
        return NOT_EXAMINED, "whether the drifts have one limit only is not decided"
    if verdict:
        return YES, "the derivatives of the margins in the drifts are a P-matrix"
    return NO, "the derivatives of the margins in the drifts are no P-matrix"
