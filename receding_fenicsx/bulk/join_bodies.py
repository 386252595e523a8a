"""Two condensed bodies that meet at their contact nodes, joined to one contact system.

With u = u_a - u_b, n pointing from b into a, and r the force of b on a,

    r = r*_a + K_a u_a,    -r = r*_b + K_b u_b,

so that r = r* + K u and u_a, u_b follow with S = (K_a + K_b)^-1 from

    K = K_a S K_b,    r* = K_b S r*_a - K_a S r*_b,
    u_a = S (K_b u - r*_a - r*_b),    u_b = u_a - u:

>>> import numpy as np
>>> K_a, K_b = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([[5.0, -1.0], [-1.0, 4.0]])
>>> r_a, r_b = np.array([[0.3, -1.0]]), np.array([[-0.2, 0.5]])
>>> def body(K, r_star):  # one contact node, one load (a force), no rigid motion
...     return CondensedBody(K, r_star, compliance=np.zeros((1, 1)), sign=-np.ones(1),
...                          held=np.zeros(2, dtype=bool), modes=np.eye(2, 3),
...                          constraints=np.eye(3))
>>> joined = join(body(K_a, r_a), body(K_b, r_b), ("p",))
>>> S = np.linalg.inv(K_a + K_b)
>>> np.allclose(joined.K, K_a @ S @ K_b)
True
>>> np.allclose(joined.r_star.T, K_b @ S @ r_a.T - K_a @ S @ r_b.T)
True
>>> u, load = np.array([0.1, 0.2]), np.array([2.0])
>>> u_b = joined.back[0] @ u + joined.back[1] @ load
>>> np.allclose(u_b, S @ (K_b @ u - (r_a + r_b).T @ load) - u)
True

The equations are evaluated as the stiffness of the softer body less a correction by the stiffer
one. That loses no digits when one body is much stiffer, and a node may be held on one body only.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, LinAlgWarning, solve

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.rigid_motions import free_motions, scaled
from receding_fenicsx.errors import InputError, SolveError

JOINED_RIGID_RESISTANCE = 1e-11
"""Largest force of a common or relative rigid motion over the largest row sum of |K|."""
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
        held: (2N,) contact degrees of freedom held by symmetry or supports.
        modes: (2N, 3) displacements of the contact nodes in the rigid motions of the body:
            translations in x and y, rotation about a pivot. A pair has those of its first body.
        constraints: (m, 3) components of these motions at all held degrees of freedom.
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    modes: Array
    constraints: Array


@dataclass(frozen=True)
class JoinedBodies:
    """Two bodies in one.

    Attributes:
        K, r_star, compliance, sign, held: as of ``CondensedBody``, for u = u_a - u_b.
        rigid: (2N, n) free relative motions of the bodies, each with largest entry 1.
        back: (2N, 2N) and (2N, n_loads): u_b = back[0] u + back[1] lambda.
        links: (m, n_loads) and (m, 2N): factors links[0] lambda + links[1] u of the unit loads of
            springs between the bodies.
    """

    K: Array
    r_star: Array
    compliance: Array
    sign: Array
    held: NDArray[np.bool_]
    rigid: Array
    back: tuple[Array, Array]
    links: tuple[Array, Array] | None = None


def join(a: CondensedBody, b: CondensedBody, load_names: tuple[str, ...]) -> JoinedBodies:
    """Join two bodies; the module's docstring has the equations.

    With e the stiffer body and s the softer one, u_s - u_e = direction * u. Where neither body is
    held, u_e = y is eliminated; where only s is held u_e = -direction * u, and where e is held
    u_s = direction * u.

    Args:
        a: the body that n points into.
        b: the other one, in the same coordinates, with the same loads (zero where they act on a).
        load_names: names of the loads.

    Returns:
        The joined system.

    Raises:
        InputError: a load moves the pair in a motion that no support holds, or is a force on one
            body and a displacement on the other.
        SolveError: K does not keep the rigid motions.
    """
    sign = _common_sign(a, b, load_names)
    stiffer_b = np.trace(b.K) >= np.trace(a.K)
    e, s = (b, a) if stiffer_b else (a, b)
    direction = 1.0 if stiffer_b else -1.0
    free = ~(e.held | s.held)
    # u_e = t (direction u) and u_s = v (direction u), plus y where free
    t = np.where(s.held & ~e.held, -1.0, 0.0)
    v = t + 1.0
    C = e.K[free] * t + s.K[free] * v
    L = (e.r_star + s.r_star)[:, free].T
    H = (e.K + s.K)[np.ix_(free, free)]
    solution = _solve(_pinned(H, L, e, s, a.modes, load_names), np.hstack([C, L]))
    y, y_load = -solution[:, : C.shape[1]], -solution[:, C.shape[1] :]
    K = t[:, None] * e.K * t + v[:, None] * s.K * v + C.T @ y
    K = 0.5 * (K + K.T)
    r_star = direction * (e.r_star * t + s.r_star * v + (C.T @ y_load).T)
    compliance = e.compliance + s.compliance + sign[:, None] * (L.T @ y_load)
    u_e, u_e_load = np.diag(direction * t), np.zeros((len(t), L.shape[1]))
    u_e[free] += direction * y
    u_e_load[free] = y_load
    held = a.held & b.held
    relative = np.hstack([free_motions(part.constraints) for part in (a, b)])
    rigid = scaled(a.modes @ _span(relative))
    _check_rigid(K, rigid, held)
    u_b = u_e if stiffer_b else u_e - np.eye(len(t))
    return JoinedBodies(K, r_star, compliance, sign, held, rigid, (u_b, u_e_load))


def _common_sign(a: CondensedBody, b: CondensedBody, load_names: tuple[str, ...]) -> Array:
    """Return the signs of the loads on both bodies."""
    opposite = a.sign * b.sign < 0.0
    if np.any(opposite):
        name = load_names[int(np.argmax(opposite))]
        raise InputError(
            f"load '{name}': is a force on one body and a displacement on the other; give it the "
            "same form on both"
        )
    return np.where(a.sign == 0.0, b.sign, a.sign)


def _pinned(
    H: Array,
    L: Array,
    e: CondensedBody,
    s: CondensedBody,
    modes: Array,
    load_names: tuple[str, ...],
) -> Array:
    """Return H = K_e + K_s with stiffness added on the common rigid motions that nothing holds.

    Raises:
        InputError: a load L is not balanced in one of these motions.
    """
    common = free_motions(np.vstack([e.constraints, s.constraints]))
    if not common.shape[1]:
        return H
    free = ~(e.held | s.held)
    R = np.linalg.qr((modes @ common)[free])[0]
    size = np.abs(e.r_star).sum(axis=1) + np.abs(s.r_star).sum(axis=1)
    out = np.abs(R.T @ L).max(axis=0) > BALANCE_TOLERANCE * size
    if np.any(out):
        raise InputError(
            f"load '{load_names[int(np.argmax(out))]}' moves both bodies together, and nothing "
            "holds them: add a [[support]] to one of them, or balance it by its part on the "
            "other body (a [[load]] of the same name)"
        )
    return H + R @ R.T * (np.trace(H) / len(H))


def _solve(H: Array, columns: Array) -> Array:
    """Solve with the positive definite stiffness of both bodies; singular ones are an error."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            return np.asarray(solve(H, columns, assume_a="pos"))
    except (LinAlgError, LinAlgWarning):
        raise SolveError(
            "the stiffness of the joined bodies is singular to round-off; bring their Young's "
            "moduli closer together or hold the stiffer one"
        ) from None


def _check_rigid(K: Array, rigid: Array, held: NDArray[np.bool_]) -> None:
    """Check that K has no force against the rigid motions."""
    error = np.abs((K @ rigid)[~held]).max(initial=0.0) / np.abs(K).sum(axis=1).max()
    if not error <= JOINED_RIGID_RESISTANCE:
        raise SolveError(
            f"the stiffness of the joined bodies resists a rigid motion by {error:.1e} of its "
            f"size (at most {JOINED_RIGID_RESISTANCE:g}); bring Young's moduli closer together "
            "or hold the stiffer one"
        )


def _span(motions: Array) -> Array:
    """Return a basis (3, n), in echelon form, of the motions that the columns span."""
    # the orthogonal complement of the orthogonal complement
    return free_motions(free_motions(motions.T).T)
