r"""Critical friction: the smallest factor of all coefficients at which a slip mode appears.

On a given contact (open nodes without reactions, all others closed) let $s_i = \pm 1$ be assumed
directions of slip, $S = \mathrm{diag}(s)$, $F = \mathrm{diag}(f)$, and all freedoms that move
freely be condensed. With coefficients $\varphi f$ the rates, $\dot Q = -\varphi s f \dot P$, have a
slip mode, a motion without any change of load, where

$$(K_{tt} + \varphi\, S F K_{nt})\, v = 0 ,$$

that is where $1/\varphi$ is a real eigenvalue of $S A$, $A = -F K_{nt} K_{tt}^{-1}$, with the
eigenvector $x = K_{tt} v$. The largest one over all signs is the sign-real spectral radius of $A$
(S. M. Rump, Theorems of Perron-Frobenius type for matrices without sign restrictions, Linear
Algebra and its Applications 266, 1997, 1-42); to compute it is NP-hard.

**From below**, by a search. With right and left eigenvectors $x, y$ of a simple eigenvalue $\mu$ of
$S A$, $\partial \mu / \partial s_i = \mu\, s_i\, y_i x_i / (y \cdot x)$: signs with $y_i x_i < 0$
are flipped (all, then fewer, then one by one and in pairs) while $\mu$ grows, from several
starts. Of few nodes all signs are tried.

**From above**, by proofs. With any $D = \mathrm{diag}(d) > 0$, $|\mu| \le \|D^{-1} A D\|_2$ for all
signs, since $S$ and $D$ commute: no slip mode of all these nodes exists below
$\varphi = 1 / \|D^{-1} A D\|_2$. Where some of the nodes stick, $A$ is another matrix. For every
$d > 0$ and $|s_i| \le 1$

$$-2\, v^T S F K_{nt} v \le v^T \left(D + K_{tn} F D^{-1} F K_{nt}\right) v ,$$

so that below $\varphi = 2 / \lambda$, $\lambda$ the largest eigenvalue of the matrix in brackets
with respect to $K_{tt}$, the symmetric part of $K_{tt} + \varphi S F K_{nt}$ is positive definite
for all signs, with any of the nodes stuck too: the rates of slipping nodes are unique. Both bounds
are convex, in $\log d$ and in $d$, and are minimised. The second one gets weaker on finer meshes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import scipy.linalg as sla
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.law import SEPARATION, STATE_NAMES
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import NO_STIFFNESS


@dataclass(frozen=True)
class CriticalFriction:
    """Bounds of the friction at which a slip mode appears, and the mode found.

    Attributes:
        factor: a slip mode exists at this multiple of f; infinite where none was found.
        lower_bound: below this multiple none exists, for any signs of all slipping nodes.
        unique_below: below this multiple none exists for any signs, with any nodes stuck, and the
            rates of slipping nodes are unique.
        exact: all signs were tried: the factor is the smallest one if no node sticks.
        signs: (N,) assumed direction of slip of each modelled node, 0 where it cannot slip.
        mode: (2N,) displacements [v; w] of the mode, largest entry 1; zero where none was found.
        reactions: (2N,) changes of the reactions [Q; P] of the mode.
        keeps_signs: every node slips in its assumed direction.
    """

    factor: float
    lower_bound: float
    unique_below: float
    exact: bool
    signs: Array
    mode: Array
    reactions: Array
    keeps_signs: bool


def critical_friction(
    system: ContactSystem,
    states: ArrayLike | None = None,
    starts: int = 8,
) -> CriticalFriction:
    """Return bounds of the common factor of f at which a slip mode appears on a contact.

    It says what is possible, not that it happens: the mode's directions of slip need not be those
    of its own motion, and a history may never come to these states.

    Args:
        system: the condensed body. That of half a body has mirror-symmetric modes only.
        states: (N,) states of the modelled nodes, or of the whole contact; separated nodes are
            open, all others are closed and may slip. Default: all are closed.
        starts: random starts of the search over signs.

    Raises:
        InputError: the system has no friction, the states are not those of its nodes, no node may
            slip, or the body slides freely.
    """
    n, state = system.n, _states(system, states)
    closed = state != SEPARATION
    slips = closed & system.friction.present & ~system.held[:n] & ~system.held[n:]
    if not slips.any():
        raise InputError(
            "critical_friction: no node can slip with friction in these states; give states with "
            "closed nodes, and friction"
        )
    if system.f_backward is not None:
        raise InputError("critical_friction: needs one coefficient for both directions of slip")
    nodes = np.flatnonzero(slips)
    loose_t = ~system.held[:n] & ~slips
    free = np.flatnonzero(np.concatenate([loose_t, ~closed & ~system.held[n:]]))
    # condensed of what moves freely with them
    K, follow = system.K, np.zeros((0, len(nodes)))
    if len(free):
        block = K[np.ix_(free, free)]
        if not _is_stiff(block):
            raise InputError(
                "critical_friction: nothing resists a motion of the open or frictionless nodes; "
                "close a node, or add a [[support]]"
            )
        follow = -np.linalg.solve(block, K[np.ix_(free, nodes)])
    rows = np.concatenate([nodes, n + nodes])
    K_tt, K_nt = np.split(K[np.ix_(rows, nodes)] + K[np.ix_(rows, free)] @ follow, 2)
    if not _is_stiff(K_tt):
        raise InputError(
            "critical_friction: the body slides freely along its contact; hold it by a [[support]],"
            " by symmetry, or by a node without friction that is held"
        )
    C = system.f[nodes, None] * K_nt
    A = -np.linalg.solve(K_tt, C.T).T
    exact = len(nodes) <= 12  # few: all signs are tried
    mu, s = try_all_signs(A) if exact else search_signs(A, starts)
    mode, signs = np.zeros(2 * n), np.zeros(n)
    if mu > 0.0:
        signs[nodes] = s
        v = np.linalg.solve(K_tt, eigenvectors(s, A, mu)[0])
        v *= np.sign(s @ v) or 1.0
        mode[nodes], mode[free] = v, follow @ v
        mode /= np.abs(mode).max()
    return CriticalFriction(
        factor=1.0 / mu if mu > 0.0 else np.inf,
        lower_bound=mode_bound(A),
        unique_below=uniqueness_bound(K_tt, C),
        exact=exact,
        signs=signs,
        mode=mode,
        reactions=system.K @ mode,
        keeps_signs=bool(mu > 0.0 and np.all(signs * mode[:n] >= -1e-9)),
    )


def _states(system: ContactSystem, states: ArrayLike | None) -> NDArray[np.int8]:
    """Return the states of the modelled nodes, checked."""
    if system.kind == "normal" or not np.any(system.friction.present):
        raise InputError("critical_friction: the system has no friction; set [contact] friction")
    given = np.ones(system.n) if states is None else np.asarray(states)
    whole = mirror_of(system)
    if given.shape == whole.index.shape and given.shape != (system.n,):
        # the modelled nodes are the images that are not mirrored
        own = np.flatnonzero(~whole.left)
        given = given[own[np.argsort(whole.index[own])]]
    if given.shape != (system.n,) or not np.isin(given, list(STATE_NAMES)).all():
        raise InputError(
            f"critical_friction: states must be {system.n} numbers from 1 to 4, one for each "
            "modelled node"
        )
    return given.astype(np.int8)


def _is_stiff(K: Array) -> bool:
    """Return whether a symmetric block resists every motion."""
    size = np.linalg.eigvalsh(0.5 * (K + K.T))
    return bool(size[0] > NO_STIFFNESS * size[-1])


def largest_real(matrices: Array) -> Array:
    """Return the largest real eigenvalue of each matrix (..., m, m); 0 where none is positive."""
    found = np.linalg.eigvals(matrices)
    size = np.abs(found).max(axis=-1, keepdims=True)
    real = np.where(np.abs(found.imag) <= 1e-9 * size, found.real, 0.0)
    return np.asarray(real.max(axis=-1, initial=0.0))


def try_all_signs(A: Array) -> tuple[float, Array]:
    """Return the largest real eigenvalue of S A over all signs, and the signs."""
    signs = np.array(list(product((1.0, -1.0), repeat=len(A))))
    parts = np.array_split(signs, len(signs) // 256 + 1)
    values = np.concatenate([largest_real(part[:, :, None] * A) for part in parts])
    best = int(np.argmax(values))
    return float(values[best]), signs[best]


def search_signs(A: Array, starts: int = 8) -> tuple[float, Array]:
    """Return a large real eigenvalue of S A, and its signs, by flips from several starts.

    Starts are the signs that make the diagonal of S A positive, and random ones.
    """
    random = np.random.default_rng(0).choice([-1.0, 1.0], (starts, len(A)))
    every = [_climb(A, s) for s in (np.where(np.diagonal(A) < 0.0, -1.0, 1.0), *random)]
    return max(every, key=lambda one: one[0])


def _climb(A: Array, s: Array) -> tuple[float, Array]:
    """Flip signs along the gradient while the largest real eigenvalue grows."""
    mu = float(largest_real(s[:, None] * A))
    if mu == 0.0:  # S A and -S A have opposite eigenvalues
        mu, s = float(largest_real(-s[:, None] * A)), -s
    while mu > 0.0:
        x, y = eigenvectors(s, A, mu)
        share = y * x / (y @ x)
        order = np.argsort(share)
        count = int(np.count_nonzero(share < 0.0))
        sets = [order[: max(1, count >> k)] for k in range(count.bit_length())]
        # those of least influence one by one, then in pairs
        sets += [order[[k]] for k in range(min(24, len(s)))]
        sets += [order] + [order[list(k)] for k in combinations(range(min(10, len(s))), 2)]
        for nodes in sets:
            flipped = s.copy()
            flipped[nodes] *= -1.0
            value = float(largest_real(flipped[:, None] * A))
            if value > mu * (1.0 + 1e-12):
                mu, s = value, flipped
                break
        else:
            break
    return mu, s


def eigenvectors(s: Array, A: Array, mu: float) -> tuple[Array, Array]:
    """Return the right and the left eigenvector of S A to a real eigenvalue."""
    left, _, right = np.linalg.svd(s[:, None] * A - mu * np.eye(len(s)))
    return right[-1], left[:, -1]


def mode_bound(A: Array) -> float:
    """Return 1 / |D^-1 A D|, maximised over D = diag(d) > 0."""
    if not np.any(A):
        return np.inf

    def largest(log_d: Array) -> tuple[float, Array]:
        B = A * np.exp(log_d - log_d[:, None])
        left, size, right = np.linalg.svd(B)
        value, weight = _smooth_maximum(size**2)
        slope = 2.0 * ((right.T**2 - left**2) @ (weight * size**2))
        return value, slope

    x = _minimised(largest, np.zeros(len(A)))
    return 1.0 / float(np.linalg.norm(A * np.exp(x - x[:, None]), 2))


def uniqueness_bound(K_tt: Array, C: Array) -> float:
    """Return 2 / lambda, maximised over d; C = F K_nt."""
    if not np.any(C):
        return np.inf
    # with K_tt = L L^T, U = L^-T: lambda is the largest eigenvalue of U^T d U + W^T d^-1 W
    root = sla.cholesky(0.5 * (K_tt + K_tt.T), lower=True)
    U = sla.solve_triangular(root, np.eye(len(C)), lower=True).T
    W = C @ U

    def largest(log_d: Array) -> tuple[float, Array]:
        d = np.exp(log_d)
        size, vectors = np.linalg.eigh((U.T * d) @ U + (W.T / d) @ W)
        value, weight = _smooth_maximum(size)
        return value, d * ((U @ vectors) ** 2 @ weight) - ((W @ vectors) ** 2 @ weight) / d

    sizes = (W**2).sum(axis=1)
    least = np.finfo(float).eps * sizes.max()
    start = 0.5 * np.log(np.maximum(sizes, least) / (U**2).sum(axis=1))
    d = np.exp(_minimised(largest, start))
    return 2.0 / float(np.linalg.eigvalsh((U.T * d) @ U + (W.T / d) @ W)[-1])


def _smooth_maximum(size: Array) -> tuple[float, Array]:
    """Return a smooth maximum of positive eigenvalues, and its derivatives with respect to them."""
    largest = float(size.max())
    weight = np.exp(200.0 * (size / largest - 1.0))
    total = float(weight.sum())
    return largest * (1.0 + np.log(total) / 200.0), weight / total


def _minimised(function: Callable[[Array], tuple[float, Array]], start: Array) -> Array:
    """Return where a function is small; every point gives a valid bound, so that any will do."""
    found = scipy.optimize.minimize(function, start, jac=True, method="L-BFGS-B")
    return min((start, np.asarray(found.x)), key=lambda x: function(x)[0])
