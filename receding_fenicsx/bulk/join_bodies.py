"""Condensed bodies that meet at their contact nodes, joined to one contact system.

Each contact lies between a first and a second body, or between a first body and a rigid plane. With
u = u_first - u_second (on a plane u_first), n pointing into the first body, and r the force on it,
body b has the reactions +r at its contacts as first body, -r at those as second body:

    +-r = r*_b + K_b u_b.

At each contact between two bodies let e be the stiffer and s the softer side, and y = u_e, so that
u_s = y +- u. Then u_b = A_b u + Y_b y for every body, with Boolean Y_b and signs A_b, and

    K_uu = sum A_b^T K_b A_b,  C = sum Y_b^T K_b A_b,  H = sum Y_b^T K_b Y_b,  L = sum Y_b^T r*_b,
    y = -H^-1 (C u + L),   K = K_uu - C^T H^-1 C,   r* = sum A_b^T r*_b - C^T H^-1 L.

For two bodies a and b this is K = K_a S K_b, r* = K_b S r*_a - K_a S r*_b, S = (K_a + K_b)^-1:

>>> import numpy as np
>>> K_a, K_b = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([[5.0, -1.0], [-1.0, 4.0]])
>>> r_a, r_b = np.array([[0.3, -1.0]]), np.array([[-0.2, 0.5]])
>>> def body(K, r_star):  # one contact node, one load (a force), no rigid motion
...     return CondensedBody(K, r_star, compliance=np.zeros((1, 1)), sign=-np.ones(1),
...                          held=np.zeros(2, dtype=bool), driven=np.zeros((1, 2)),
...                          modes=np.eye(2, 3), constraints=np.eye(3))
>>> first, second = (Place(np.array([0]), np.array([side]), np.array([0])) for side in (1, -1))
>>> joined = join([body(K_a, r_a), body(K_b, r_b)], [first, second], ("p",))
>>> S = np.linalg.inv(K_a + K_b)
>>> np.allclose(joined.K, K_a @ S @ K_b)
True
>>> np.allclose(joined.r_star.T, K_b @ S @ r_a.T - K_a @ S @ r_b.T)
True
>>> u, load = np.array([0.1, 0.2]), np.array([2.0])
>>> np.allclose(joined.displacement(1, u, load), S @ (K_b @ u - (r_a + r_b).T @ load) - u)
True

K is thus the stiffness of the softer bodies less a correction by the stiffer ones. That loses no
digits when one body is much stiffer, and a node may be held on one body only.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, LinAlgWarning, solve

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.rigid_motions import common_motions, free_motions, independent, scaled
from receding_fenicsx.bulk.symmetric_matrix import block, norm, symmetrise
from receding_fenicsx.errors import InputError, SolveError

BALANCE_TOLERANCE = 1e-9
"""Largest resultant, over the sum of the reactions, of a load that counts as balanced."""


@dataclass(frozen=True)
class CondensedBody:
    """One body condensed to its contact nodes.

    Attributes:
        K: (2N, 2N) stiffness, order [v; w].
        r_star: (n_loads, 2N) reactions to each unit load, all contact nodes held.
        compliance: (n_loads, n_loads) work-conjugate displacements, all contact nodes held.
        sign: (n_loads,) -1 for forces, +1 for prescribed displacements, 0 where none acts.
        held: (2N,) contact degrees of freedom held by symmetry or supports, or prescribed.
        driven: (n_loads, 2N) displacements that the loads prescribe; u is relative to these.
        modes: (2N, 3) displacements of the contact nodes in the rigid motions of the body:
            translations in x and y, rotation about a pivot that all bodies have in common.
        constraints: (m, 3) components of these motions at all held degrees of freedom.
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    driven: Array
    modes: Array
    constraints: Array


@dataclass(frozen=True)
class Place:
    """Where the contact nodes of one body are among the N nodes of all contacts.

    Attributes:
        node: (N_b,) numbers of the body's nodes.
        side: (N_b,) +1 where it is the contact's first body, -1 where it is the second one.
        contact: (N_b,) numbers of the contacts.
    """

    node: Ints
    side: Ints
    contact: Ints

    def dofs(self, n: int) -> Ints:
        """Return the (2N_b,) numbers of the degrees of freedom in the 2n of all contacts."""
        return np.concatenate([self.node, n + self.node])


@dataclass(frozen=True)
class Motion:
    """Displacements of one body: u_b = factor * u[dofs], plus y[rest] at its freedoms ``on``."""

    dofs: Ints
    factor: Array
    on: Ints
    rest: Ints


@dataclass(frozen=True)
class JoinedBodies:
    """Several bodies in one.

    Attributes:
        K, r_star, compliance, sign, held: as of ``CondensedBody``, for u.
        driven: (n_loads, 2N) relative displacements that the loads prescribe on one side; as
            joined, u is relative to these.
        rigid: (2N, n) free relative motions of the bodies, each with largest entry 1.
        rest: (m, 2N) and (m, n_loads): y = rest[0] u + rest[1] lambda, as joined.
        motions: how each body follows u and y, as joined.
        factors, shift: T, G and D. Of the present u and lambda, the bodies as joined have the
            displacements u + D^T lambda, and the load factors T lambda + G (u + D^T lambda).
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    driven: Array
    rigid: Array
    rest: tuple[Array, Array]
    motions: tuple[Motion, ...]
    factors: tuple[Array, Array]
    shift: Array

    def as_joined(self, u: Array, load: Array) -> tuple[Array, Array]:
        """Return the displacements (2N,) and factors of all unit loads that the bodies have."""
        T, G = self.factors
        u = np.where(self.held, 0.0, u) + load @ self.shift
        return u, T @ load + G @ u

    def displacement(self, body: int, u: Array, load: Array) -> Array:
        """Return the contact displacements (2N_b,) of a body for u and load as joined."""
        motion, y = self.motions[body], self.rest[0] @ u + self.rest[1] @ load
        moved = motion.factor * u[motion.dofs]
        moved[motion.on] += y[motion.rest]
        return moved

    def rows(self, body: int, on_body: Array, on_loads: Array) -> Array:
        """Return rows for [u; lambda] of rows for the displacements of a body and all unit loads.

        Args:
            body: number of the body.
            on_body: (..., 2N_b) rows.
            on_loads: (..., unit loads) rows.
        """
        motion, (T, G) = self.motions[body], self.factors
        follow = on_body[..., motion.on]
        on_u = follow @ self.rest[0][motion.rest]
        on_u[..., motion.dofs] += on_body * motion.factor
        on_u[..., self.held] = 0.0
        on_loads = on_loads + follow @ self.rest[1][motion.rest]
        on_u = on_u + on_loads @ G
        return np.concatenate([on_u, on_loads @ T + on_u @ self.shift.T], axis=-1)


def join(
    bodies: Sequence[CondensedBody], places: Sequence[Place], load_names: tuple[str, ...]
) -> JoinedBodies:
    """Join bodies; the module's docstring has the equations.

    Args:
        bodies: the bodies, with the same loads (zero where they act on others).
        places: the contact nodes of each.
        load_names: names of the loads.

    Raises:
        InputError: a load moves bodies in a motion that no support holds, or is a force on one
            body and a displacement on another.
        SolveError: K does not keep the rigid motions.
    """
    sign = common_sign(np.array([body.sign for body in bodies]), load_names)
    motions, held = _motions(bodies, places)
    size, free = len(held), 1 + max(motion.rest.max(initial=-1) for motion in motions)
    # one body on planes has K already
    alone = len(bodies) == 1 and not free
    K = bodies[0].K if alone else np.zeros((size, size))
    H, C = np.zeros((free, free)), np.zeros((free, size))
    r_star, L = np.zeros((len(sign), size)), np.zeros((free, len(sign)))
    driven = np.zeros_like(r_star)
    for body, motion, place in zip(bodies, motions, places, strict=True):
        at, on, rest = motion.dofs, motion.on, motion.rest
        driven[:, at] += np.tile(place.side, 2) * body.driven
        H[block(rest, rest)] += body.K[block(on, on)]
        L[rest] += body.r_star[:, on].T
        if motion.factor.any():
            if not alone:
                K[block(at, at)] += motion.factor[:, None] * body.K * motion.factor
            C[block(rest, at)] += body.K[on] * motion.factor
            r_star[:, at] += body.r_star * motion.factor
    sides = [dict(zip(p.contact.tolist(), p.side.tolist(), strict=True)) for p in places]
    common = common_motions([body.constraints for body in bodies], sides)
    _pin(H, L, common, bodies, motions, load_names)
    y = -_solve(H, np.hstack([C, L])) if free else np.zeros((0, size + len(sign)))
    if free:
        K += C.T @ y[:, :size]
        symmetrise(K)
    r_star += (C.T @ y[:, size:]).T
    compliance = sum(body.compliance for body in bodies) + sign[:, None] * (L.T @ y[:, size:])
    own = [body.modes @ free_motions(body.constraints) for body in bodies]
    for k, (motion, place) in enumerate(zip(motions, places, strict=True)):
        moved = np.zeros((size, own[k].shape[1]))
        moved[motion.dofs] = np.tile(place.side, 2)[:, None] * own[k]
        own[k] = scaled(moved)
    # one less for each common motion
    rigid = independent(np.hstack(own), sum(found.shape[1] for _, found in common))
    error = np.abs((K @ rigid)[~held]).max(initial=0.0) / norm(K)
    if not error <= 1e-11:
        raise SolveError(
            f"the stiffness of the joined bodies resists a rigid motion by {error:.1e} of its size "
            f"(at most 1e-11); bring Young's moduli closer together or hold "
            "the stiffer one"
        )
    follow = y[:, :size], y[:, size:]
    factors = np.eye(len(sign)), np.zeros_like(r_star)
    return JoinedBodies(
        K, r_star, compliance, sign, held, driven, rigid, follow, motions, factors, 0.0 * r_star
    )


def _motions(
    bodies: Sequence[CondensedBody], places: Sequence[Place]
) -> tuple[tuple[Motion, ...], NDArray[np.bool_]]:
    """Return how each body follows u and y, and the (2N,) degrees of freedom held on both sides.

    Where neither side is held y = u_e is free; where only s is held u_e = -+ u; where e is held, as
    a plane is, u_s = +- u.
    """
    n = 1 + max(place.node.max() for place in places)
    # of the first and the second side; a plane is held and stiff
    held = np.stack([np.zeros(2 * n, dtype=bool), np.ones(2 * n, dtype=bool)])
    stiffness = np.outer([0.0, np.inf], np.ones(1 + max(p.contact.max() for p in places)))
    where = np.zeros(n, dtype=int)
    for body, place in zip(bodies, places, strict=True):
        second = (place.side < 0).astype(int)
        held[np.tile(second, 2), place.dofs(n)] = body.held
        own = np.diagonal(body.K).reshape(2, -1).sum(axis=0)
        for k in np.unique(place.contact):
            on = place.contact == k
            stiffness[second[on][0], k] = own[on].sum()
        where[place.node] = place.contact
    stiffer = np.tile((stiffness[1] >= stiffness[0])[where], 2)  # the second side
    held_e, held_s = np.where(stiffer, held[1], held[0]), np.where(stiffer, held[0], held[1])
    t = np.where(held_s & ~held_e, -1.0, 0.0)
    free = ~(held_e | held_s)
    number = np.cumsum(free) - 1
    found = []
    for place in places:
        at = place.dofs(n)
        is_e = (np.tile(place.side, 2) < 0) == stiffer[at]
        factor = np.where(stiffer, 1.0, -1.0)[at] * np.where(is_e, t[at], t[at] + 1.0)
        found.append(Motion(at, factor, np.flatnonzero(free[at]), number[at[free[at]]]))
    return tuple(found), held[0] & held[1]


def common_sign(signs: Array, load_names: tuple[str, ...]) -> Array:
    """Return the signs of the loads on all bodies from those on each (bodies, n_loads)."""
    low, high = signs.min(axis=0), signs.max(axis=0)
    for k in np.flatnonzero(low * high < 0.0):
        raise InputError(
            f"load '{load_names[k]}': is a force on one body and a displacement on the other; give "
            "it the same form on both"
        )
    return np.where(low < 0.0, low, high)


def _pin(
    H: Array,
    L: Array,
    common: list[tuple[list[int], Array]],
    bodies: Sequence[CondensedBody],
    motions: Sequence[Motion],
    load_names: tuple[str, ...],
) -> None:
    """Add stiffness to H on the common rigid motions that nothing holds.

    Raises:
        InputError: a load L is not balanced in one of these motions.
    """
    stiffness = np.trace(H) / max(len(H), 1)
    for group, together in common:
        R = np.zeros((len(H), together.shape[1]))
        for i in group:
            R[motions[i].rest] = bodies[i].modes[motions[i].on] @ together
        R = np.linalg.qr(R)[0]
        size = sum(np.abs(bodies[i].r_star).sum(axis=1) for i in group)
        for k in np.flatnonzero(np.abs(R.T @ L).max(axis=0) > BALANCE_TOLERANCE * size):
            raise InputError(
                f"load '{load_names[k]}' moves {'both' if len(group) == 2 else 'the'} bodies "
                "together, and nothing holds them: add a [[support]] to one of them, or balance it "
                "by its part on the other body (a [[load]] of the same name)"
            )
        H += R @ R.T * stiffness


def _solve(H: Array, columns: Array) -> Array:
    """Solve with the positive definite stiffness of the bodies; singular ones are an error."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            return np.asarray(solve(H, columns, assume_a="pos"))
    except (LinAlgError, LinAlgWarning):
        raise SolveError(
            "the stiffness of the joined bodies is singular to round-off; bring their Young's "
            "moduli closer together or hold the stiffer one"
        ) from None
