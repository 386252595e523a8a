"""Elimination of the rigid motion of a half-plane's far field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array


@dataclass(frozen=True)
class FarField:
    """What acts on the far field of a half-plane.

    The four motions are translations in x and y, the rotation about the contact's middle, and the
    uniform strain along the surface, which is never free.

    Attributes:
        free: (4,) motions that follow from the balance of forces; the others are given.
        force: (n_loads, 4) forces of unit loads in the free motions.
        moved: (n_loads, 4) given motions of unit loads.
        sign: (n_loads,) -1 for forces, +1 for displacements, 0 where none acts.
    """

    free: NDArray[np.bool_]
    force: Array
    moved: Array
    sign: Array


@dataclass(frozen=True)
class CondensedHalfPlane:
    """Contact stiffness of a half-plane, with r = r_star^T lambda + K u.

    Attributes:
        K: (2N, 2N) stiffness.
        r_star: (n_loads, 2N) reactions to unit loads, contact nodes held.
        compliance: (n_loads, n_loads) work-conjugate quantities, contact nodes held.
        motion: (4, 2N) and (4, n_loads): the motion of the far field is their sum for u and the
            load factors.
    """

    K: Array
    r_star: Array
    compliance: Array
    motion: tuple[Array, Array]


def condense_far_field(A: Array, modes: Array, far: FarField) -> CondensedHalfPlane:
    """Eliminate the free motions of the far field.

    The motions R = ``modes`` have amplitudes a, of which d is given. From r = A (u - R a) and
    the balance R_free^T r = -F,

        a_free = G [R_free^T A (u - R_given d) + F],   G = (R_free^T A R_free)^-1.

    Args:
        A: (2N, 2N) stiffness with the far field held.
        modes: (2N, 4) displacements [v; w] of the nodes in the four motions.
        far: what acts on the far field.
    """
    R = modes[:, far.free]
    AR = A @ R
    G = np.linalg.inv(R.T @ AR) if R.shape[1] else np.zeros((0, 0))
    half = AR @ G
    K = A - half @ AR.T
    K = 0.5 * (K + K.T)
    # a second projection takes away what cancellation left
    inverse = np.linalg.pinv(R)
    K = K - R @ (inverse @ K)
    K = K - (K @ R) @ inverse
    K = 0.5 * (K + K.T)
    given, force = far.moved @ modes.T, far.force[:, far.free]
    r_star = -given @ K - force @ half.T
    own = force @ G @ force.T
    held = given @ K @ given.T
    cross = given @ half @ force.T  # a force on the motion that a displacement causes
    compliance = own + held + cross - cross.T
    on_u, on_loads = np.zeros((len(far.free), len(A))), far.moved.T.copy()
    on_u[far.free] = half.T
    on_loads[far.free] = G @ force.T - half.T @ given.T
    return CondensedHalfPlane(K, r_star, compliance, (on_u, on_loads))
