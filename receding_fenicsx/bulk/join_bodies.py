"""Condensed bodies joined to one contact system by the relative displacements of their nodes.

With u the relative displacements at the contact points, r the forces there, and G_b, T_b the
operators of :mod:`~receding_fenicsx.bulk.contact_operator`, the displacements u_b of the contact
nodes of the bodies satisfy, with T_b of the ties,

    sum_b G_b u_b = u,   sum_b T_b u_b = 0,   r*_b + K_b u_b = G_b^T r + T_b^T r_tie.

Each row determines one freedom, its pivot, by the others y, so that u_b = A_b u + Y_b y, and

    K_uu = sum A_b^T K_b A_b,  C = sum Y_b^T K_b A_b,  H = sum Y_b^T K_b Y_b,  L = sum Y_b^T r*_b,
    y = -H^-1 (C u + L),   K = K_uu - C^T H^-1 C,   r* = sum A_b^T r*_b - C^T H^-1 L.

This is K = (sum G_b K_b^-1 G_b^T)^-1 without the inverses, which bodies free to move lack. For two
bodies a and b with matching nodes, K = K_a S K_b, r* = K_b S r*_a - K_a S r*_b and
S = (K_a + K_b)^-1:

>>> import numpy as np
>>> from scipy.sparse import csr_matrix
>>> K_a, K_b = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([[5.0, -1.0], [-1.0, 4.0]])
>>> r_a, r_b = np.array([[0.3, -1.0]]), np.array([[-0.2, 0.5]])
>>> def body(K, r_star):  # one contact node, one load (a force), no rigid motion
...     return CondensedBody(K, r_star, compliance=np.zeros((1, 1)), sign=-np.ones(1),
...                          held=np.zeros(2, dtype=bool), driven=np.zeros((1, 2)),
...                          modes=np.eye(2, 3), constraints=np.eye(3))
>>> one, links = csr_matrix(np.eye(2)), (frozenset({0}), frozenset({0}))
>>> pair = Relative((one, -one), 2, np.zeros(2, dtype=int), np.array([-1]), links, np.eye(2))
>>> joined = join([body(K_a, r_a), body(K_b, r_b)], pair, ("p",))
>>> S = np.linalg.inv(K_a + K_b)
>>> np.allclose(joined.K, K_a @ S @ K_b)
True
>>> np.allclose(joined.r_star.T, K_b @ S @ r_a.T - K_a @ S @ r_b.T)
True
>>> u, load = np.array([0.1, 0.2]), np.array([2.0])
>>> np.allclose(joined.displacement(1, u, load), S @ (K_b @ u - (r_a + r_b).T @ load) - u)
True

Where nodes match, pivots are on the softer side: K is then the stiffness of the softer bodies less
a correction by the stiffer ones, which loses no digits when one body is much stiffer.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, LinAlgWarning, qr, solve

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.contact_operator import Relative, eliminate
from receding_fenicsx.bulk.rigid_motions import common_motions, free_motions, scaled
from receding_fenicsx.bulk.schur import norm, symmetrise
from receding_fenicsx.errors import InputError, SolveError


@dataclass(frozen=True)
class CondensedBody:
    """One body condensed to its contact nodes."""

    K: Array  # (2N, 2N) stiffness, order [v; w]
    r_star: Array  # (n_loads, 2N) reactions to each unit load, all contact nodes held
    compliance: Array  # (n_loads, n_loads) work-conjugate displacements, all contact nodes held
    sign: Array  # (n_loads,) -1 for forces, +1 for prescribed displacements, 0 where none acts
    # (2N,) contact degrees of freedom held by symmetry or supports, or prescribed
    held: NDArray[np.bool_]
    driven: Array  # (n_loads, 2N) displacements that the loads prescribe; u is relative to these
    # (2N, 3) displacements of the contact nodes in the rigid motions of the body: translations in x
    # and y, rotation about a pivot that all bodies have in common
    modes: Array
    constraints: Array  # (m, 3) components of these motions at all held degrees of freedom


@dataclass(frozen=True)
class JoinedBodies:
    """Several bodies in one."""

    # K, r_star, compliance, sign, held: as of ``CondensedBody``, for u
    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    # (n_loads, 2N) relative displacements that the loads prescribe on one side; as joined, u is
    # relative to these
    driven: Array
    rigid: Array  # (2N, n) free relative motions of the bodies, each with largest entry 1
    rest: tuple[Array, Array]  # (m, 2N) and (m, n_loads): y = rest[0] u + rest[1] lambda, as joined
    # A and Y of each body, u_b = A u + Y y, as joined
    motions: tuple[tuple[sparse.csr_matrix, sparse.csr_matrix], ...]
    # factors, shift: T, G and D. Of the present u and lambda, the bodies as joined have the
    # displacements u + D^T lambda, and the load factors T lambda + G (u + D^T lambda)
    factors: tuple[Array, Array]
    shift: Array

    def as_joined(self, u: Array, load: Array) -> tuple[Array, Array]:
        """Return the displacements (2N,) and factors of all unit loads that the bodies have."""
        T, G = self.factors
        u = np.where(self.held, 0.0, u) + load @ self.shift
        return u, T @ load + G @ u

    def displacement(self, body: int, u: Array, load: Array) -> Array:
        """Return the contact displacements (2N_b,) of a body for u and load as joined."""
        A, Y = self.motions[body]
        moved: Array = A @ u + Y @ (self.rest[0] @ u + self.rest[1] @ load)
        return moved

    def rows(self, body: int, on_body: Array, on_loads: Array) -> Array:
        """Return rows for [u; lambda] of rows (..., 2N_b) of a body, and (..., all unit loads)."""
        (A, Y), (T, G) = self.motions[body], self.factors
        flat = on_body.reshape(-1, on_body.shape[-1])
        follow = flat @ Y
        on_u = (follow @ self.rest[0] + flat @ A).reshape(*on_body.shape[:-1], -1)
        on_u[..., self.held] = 0.0
        on_loads = on_loads + (follow @ self.rest[1]).reshape(on_loads.shape)
        on_u = on_u + on_loads @ G
        return np.concatenate([on_u, on_loads @ T + on_u @ self.shift.T], axis=-1)


def join(
    bodies: Sequence[CondensedBody], relative: Relative, load_names: tuple[str, ...]
) -> JoinedBodies:
    """Join bodies, with the same loads; the module's docstring has the equations."""
    # a load has the same form on each body that it acts on
    sign = np.sign(np.sum([body.sign for body in bodies], axis=0))
    size = relative.size
    diagonal = [np.diagonal(body.K) for body in bodies]
    every = np.concatenate([body.held for body in bodies])
    A, Y, rest, held = eliminate(relative, every, diagonal)
    held = held[:size]
    starts = np.cumsum([0, *(len(body.held) for body in bodies)])
    motions = tuple((A[i:j, :size], Y[i:j]) for i, j in pairwise(starts.tolist()))
    driven = np.zeros((len(sign), len(relative.joint)))
    for body, G in zip(bodies, relative.on, strict=True):
        driven += (G @ body.driven.T).T
    for k in np.flatnonzero(np.abs(driven[:, size:]).max(axis=1, initial=0.0)):
        raise InputError(
            f"load '{load_names[k]}': moves nodes of a [[tie]] on one side only; drive another "
            "edge, or both sides alike"
        )
    # one body on planes has K already
    first = motions[0][0]
    alone = len(bodies) == 1 and first.shape == (size, size)
    alone = alone and (first != sparse.identity(size)).nnz == 0
    K = bodies[0].K if alone else np.zeros((size, size))
    H, C = np.zeros((len(rest), len(rest))), np.zeros((len(rest), size))
    r_star, L = np.zeros((len(sign), size)), np.zeros((len(rest), len(sign)))
    for body, (A, Y) in zip(bodies, motions, strict=True):
        if A.nnz:
            r_star += body.r_star @ A
            if not alone:
                KA = body.K @ A
                K += A.T @ KA
                C += Y.T @ KA
        if Y.nnz:
            H += Y.T @ (body.K @ Y)
            L += Y.T @ body.r_star.T
    common = common_motions([body.constraints for body in bodies], relative.links)
    _pin(H, L, common, bodies, rest, load_names)
    y = np.zeros((0, size + len(sign)))
    if len(rest):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", LinAlgWarning)
                y = -solve(H, np.hstack([C, L]), assume_a="pos")
        except (LinAlgError, LinAlgWarning):
            raise SolveError(
                "the stiffness of the joined bodies is singular to round-off; bring their Young's "
                "moduli closer together or hold the stiffer one"
            ) from None
        K += C.T @ y[:, :size]
    if not alone:
        symmetrise(K)
    r_star += (C.T @ y[:, size:]).T
    compliance = sum(body.compliance for body in bodies) + sign[:, None] * (L.T @ y[:, size:])
    parts = zip(relative.on, bodies, strict=True)
    own = np.hstack([scaled(G @ (b.modes @ free_motions(b.constraints))) for G, b in parts])
    if len(relative.joint) > size:
        # the motions that part no tie
        own = own[:size] @ free_motions(own[size:], 1e-9)
    # one less for each common motion
    rank = own.shape[1] - sum(found.shape[1] for _, found in common)
    rigid = scaled(
        own[:, np.sort(qr(own, mode="economic", pivoting=True)[2][:rank])] if rank else own[:, :0]
    )
    error = np.abs((K @ rigid)[~held]).max(initial=0.0) / norm(K)
    if not error <= 1e-11:
        raise SolveError(
            f"the stiffness of the joined bodies resists a rigid motion by {error:.1e} of its size "
            f"(at most 1e-11); bring Young's moduli closer together or hold "
            "the stiffer one"
        )
    follow, none = (y[:, :size], y[:, size:]), np.zeros_like(r_star)
    known = K, r_star, compliance, sign, held, driven[:, :size]
    return JoinedBodies(*known, rigid, follow, motions, (np.eye(len(sign)), none), none)


def _pin(
    H: Array,
    L: Array,
    common: list[tuple[list[int], Array]],
    bodies: Sequence[CondensedBody],
    rest: Ints,
    load_names: tuple[str, ...],
) -> None:
    """Add stiffness to H, of the freedoms ``rest``, on common motions that nothing holds."""
    stiffness = np.trace(H) / max(len(H), 1)
    for group, together in common:
        parts = [b.modes if i in group else 0.0 * b.modes for i, b in enumerate(bodies)]
        R = np.linalg.qr(np.vstack(parts)[rest] @ together)[0]
        size = sum(np.abs(bodies[i].r_star).sum(axis=1) for i in group)
        # a resultant of 1e-9 of the sum of the reactions is round-off
        for k in np.flatnonzero(np.abs(R.T @ L).max(axis=0) > 1e-9 * size):
            raise InputError(
                f"load '{load_names[k]}' moves {'both' if len(group) == 2 else 'the'} bodies "
                "together, and nothing holds them: add a [[support]] to one of them, or balance it "
                "by its part on the other body (a [[load]] of the same name)"
            )
        H += R @ R.T * stiffness
