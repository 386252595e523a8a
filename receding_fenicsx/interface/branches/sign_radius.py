r"""Largest real eigenvalue of S A over all signs S = diag(+-1), bounded from both sides.

It is the sign-real spectral radius of $A$ (S. M. Rump, Theorems of Perron-Frobenius type for
matrices without sign restrictions, Linear Algebra and its Applications 266, 1997, 1-42); to compute
it is NP-hard.

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
from itertools import combinations, product

import numpy as np
import scipy.linalg as sla
import scipy.optimize

from receding_fenicsx.arrays import Array

ALL_SIGNS = 12
"""Largest number of nodes for which all signs are tried."""

STARTS = 8
"""Random starts of the search by default."""

SINGLE_FLIPS = 24
"""Nodes that are flipped one by one at the end of a search, those of least influence first."""

PAIRED = 10
"""Nodes that are flipped in pairs after that."""

REAL = 1e-9
"""Imaginary part of an eigenvalue, over the largest eigenvalue, up to which it is real."""

GROWTH = 1e-12
"""Relative growth of the eigenvalue below which a flip gains nothing."""

SHARPNESS = 200.0
"""Exponent of the smooth maximum of eigenvalues, over the largest, that is minimised."""


def largest_real(matrices: Array) -> Array:
    """Return the largest real eigenvalue of each matrix (..., m, m); 0 where none is positive."""
    found = np.linalg.eigvals(matrices)
    size = np.abs(found).max(axis=-1, keepdims=True)
    real = np.where(np.abs(found.imag) <= REAL * size, found.real, 0.0)
    best: Array = np.maximum(real.max(axis=-1), 0.0)
    return best


def try_all_signs(A: Array) -> tuple[float, Array]:
    """Return the largest real eigenvalue of S A over all signs, and the signs."""
    signs = np.array(list(product((1.0, -1.0), repeat=len(A))))
    values = np.concatenate(
        [
            largest_real(part[:, :, None] * A)
            for part in np.array_split(signs, len(signs) // 256 + 1)
        ]
    )
    best = int(np.argmax(values))
    return float(values[best]), signs[best]


def search_signs(A: Array, starts: int = STARTS) -> tuple[float, Array]:
    """Search the largest real eigenvalue of S A over signs by flips from several starts.

    Args:
        A: (m, m) matrix.
        starts: random signs to start from, beside those that make the diagonal of S A positive.

    Returns:
        A lower bound of the largest eigenvalue, and its signs.
    """
    random = np.random.default_rng(0).choice([-1.0, 1.0], (starts, len(A)))
    best, signs = 0.0, np.ones(len(A))
    for start in (np.where(np.diagonal(A) < 0.0, -1.0, 1.0), *random):
        mu, s = _climb(A, start)
        if mu > best:
            best, signs = mu, s
    return best, signs


def _climb(A: Array, s: Array) -> tuple[float, Array]:
    """Flip signs along the gradient while the largest real eigenvalue grows."""
    mu = float(largest_real(s[:, None] * A))
    if mu == 0.0:  # S A and -S A have opposite eigenvalues
        s = -s
        mu = float(largest_real(s[:, None] * A))
    while mu > 0.0:
        x, y = eigenvectors(s, A, mu)
        share = y * x / (y @ x)
        order = np.argsort(share)
        count = int(np.count_nonzero(share < 0.0))
        sets = [order[: max(1, count >> k)] for k in range(count.bit_length())]
        sets += [order[[k]] for k in range(min(SINGLE_FLIPS, len(s)))]
        sets += [order] + [order[list(k)] for k in combinations(range(min(PAIRED, len(s))), 2)]
        for nodes in sets:
            flipped = s.copy()
            flipped[nodes] *= -1.0
            value = float(largest_real(flipped[:, None] * A))
            if value > mu * (1.0 + GROWTH):
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
    weight = np.exp(SHARPNESS * (size / largest - 1.0))
    total = float(weight.sum())
    return largest * (1.0 + np.log(total) / SHARPNESS), weight / total


def _minimised(function: Callable[[Array], tuple[float, Array]], start: Array) -> Array:
    """Return where a function is small; every point gives a valid bound, so that any will do."""
    found = scipy.optimize.minimize(function, start, jac=True, method="L-BFGS-B")
    best: Array = min((start, found.x), key=lambda x: function(x)[0])
    return best
