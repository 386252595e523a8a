"""Rigid motions that supports leave, and those that a contact leaves as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.tolerances import RIGID_TOLERANCE


def neutral_motions(rigid: Array, kept: NDArray[np.bool_]) -> Array:
    """Return (2N, k) orthonormal rigid motions that leave the kept freedoms where they are.

    Args:
        rigid: (2N, n) rigid motions that supports leave.
        kept: (2N,) freedoms whose displacement is given.
    """
    if rigid.shape[1] == 0:
        return rigid
    given = rigid[kept]
    _, size, right = np.linalg.svd(given, full_matrices=len(given) < rigid.shape[1])
    motions = rigid @ right[int(np.count_nonzero(size > RIGID_TOLERANCE)) :].T
    return np.linalg.qr(motions)[0] if motions.size else motions


def has_rigid(rigid: Array, motion: Array) -> bool:
    """Return whether a motion (2N,) of the contact nodes is among the rigid ones left free."""
    if rigid.shape[1] == 0:
        return False
    weights = np.linalg.lstsq(rigid, motion, rcond=None)[0]
    return bool(np.abs(rigid @ weights - motion).max() <= RIGID_TOLERANCE)


def softest_motion(K: Array, held: NDArray[np.bool_], rigid: Array) -> float:
    """Return the stiffness of the softest motion that is not free, over that of the stiffest.

    Args:
        K: (2N, 2N) stiffness.
        held: (2N,) freedoms that supports hold.
        rigid: (2N, n) rigid motions that supports leave.
    """
    stiffness = np.linalg.eigvalsh(K[np.ix_(~held, ~held)])[rigid.shape[1] :]
    largest = float(stiffness.max(initial=0.0))
    return float(stiffness[0]) / largest if largest > 0.0 else 1.0
