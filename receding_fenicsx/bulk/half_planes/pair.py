"""Two half-planes in contact, joined by their compliance."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from receding_fenicsx.bulk.half_planes.body import HalfPlane
from receding_fenicsx.bulk.join_bodies import (
    BALANCE_TOLERANCE,
    JoinedBodies,
    Motion,
    common_sign,
)
from receding_fenicsx.bulk.rigid_motions import scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.half_plane.stiffness import FarField, SurfaceStiffness, condense_far_field


def join_half_planes(a: HalfPlane, b: HalfPlane, load_names: tuple[str, ...]) -> JoinedBodies:
    """Join two half-planes on the same nodes to one system, for u = u_a - u_b; n points into a.

    With the force r of b on a, tractions t and the far fields a_a, a_b, B^T t = r and

        (D_a + D_b) t + B R (a_a - a_b) = B u,    u_b = - B^-T D_b t + R a_b:

    a pair behaves as one half-plane of the compliance D_a + D_b, in which the coupling of equal
    materials cancels exactly. A motion that is free on either side is free; free on both sides, its
    forces must balance, and that of b is zero.
    """
    n = len(load_names)
    force, moved, sign = np.zeros((2, n, 4)), np.zeros((2, n, 4)), np.zeros((2, n))
    for k, part in enumerate((a, b)):
        rows = [load_names.index(name) for name in part.load_names]
        force[k, rows], moved[k, rows] = part.far.force, part.far.moved
        sign[k, rows] = part.far.sign
    together = a.far.free & b.far.free
    size = np.abs(force).sum(axis=(0, 2))
    lost = np.abs((force[0] + force[1]) * together).max(axis=1) > BALANCE_TOLERANCE * size
    # a displacement of one body that the other one follows freely
    lost |= np.any(moved[0] * b.far.free, axis=1) | np.any(moved[1] * a.far.free, axis=1)
    for k in np.flatnonzero(lost):
        raise InputError(
            f"load '{load_names[k]}' moves both half-planes together, and nothing holds them: add "
            "a [[support]] to the far edge of one of them, or balance it by its part on the other"
        )
    free = a.far.free | b.far.free
    relative = FarField(
        free,
        np.where(a.far.free, force[0], -force[1]),
        moved[0] - moved[1],
        common_sign(sign, load_names),
    )
    stiffness = SurfaceStiffness(a.surface, a.compliance + b.compliance)
    modes = a.far_modes
    found = condense_far_field(stiffness.A, modes, relative)
    on_u, on_loads = found.motion
    count = len(modes)
    # a_b: given, or that of a less the relative motion; zero where both are free
    follows = (b.far.free & ~a.far.free)[:, None]
    b_on_u = np.where(follows, -on_u, 0.0)
    b_on_loads = np.where(follows, moved[0].T - on_loads, moved[1].T)

    # u_b = -moved (u - R a) + R a_b
    moved_b = stiffness.moved_by(b.compliance)
    turned = moved_b @ modes
    every = sparse.identity(count, format="csr")
    none = np.zeros_like(found.r_star)
    return JoinedBodies(
        found.K,
        found.r_star,
        found.compliance,
        relative.sign,
        np.zeros(count, dtype=bool),
        none,
        scaled(modes[:, free]),
        (turned @ on_u - moved_b + modes @ b_on_u, turned @ on_loads + modes @ b_on_loads),
        (Motion(every, every), Motion(0.0 * every, every)),
        (np.eye(n), none),
        none,
    )
