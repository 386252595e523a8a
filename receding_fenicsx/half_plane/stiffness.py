"""Stiffness of the surface of half-planes, with their far field at rest or eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import SolveError

NEAR = 8.0
"""Distance of the middles of two elements, over the longer one, up to which integrals are taken in
closed form; beyond, these lose digits and Gauss's rule has an error below 1e-13."""
GAUSS_POINTS = 4
"""Points of Gauss's rule on an element."""


def log_integral(n: int, z: Array) -> Array:
    """Return the n-th antiderivative of ln|z|: z^n / n! (ln|z| - 1 - 1/2 - ... - 1/n)."""
    size = np.abs(z)
    harmonic = sum(1.0 / k for k in range(1, n + 1))
    return np.asarray(z**n / factorial(n) * (np.log(np.where(size > 0.0, size, 1.0)) - harmonic))


def surface_integrals(x: Array, elements: Ints) -> tuple[Array, Array]:
    """Return the integrals of both kernels over pairs of hat functions.

    For nodes x (N,), in units of about the length of all elements, and the lower and upper ends of
    elements (E, 2) that do not overlap, the (N, N) integrals of phi_i(x) phi_j(s) ln|x - s|,
    symmetric to the last bit, and of phi_i(x) phi_j(s) sgn(x - s), antisymmetric.
    """
    a, b = x[elements].T
    log_matrix, sign_matrix = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
    # kernels of 200,000 pairs of elements together
    step = max(1, 200_000 // len(a))
    for first in range(0, len(a), step):
        rows = slice(first, first + step)
        logs, signs = _far_pairs(a[rows], b[rows], a, b)
        middles = 0.5 * (a + b)
        reach = NEAR * np.maximum((b - a)[rows, None], b - a)
        e, f = np.nonzero(np.abs(middles[rows, None] - middles) <= reach)
        logs[e, f] = _near_pairs(a[rows][e], b[rows][e], a[f], b[f])
        # the sign is antisymmetric on an element itself
        itself = np.arange(len(logs)), first + np.arange(len(logs))
        on_element = np.array([[0.0, -1.0], [1.0, 0.0]]) / 6.0
        signs[itself] = ((b - a)[rows] ** 2)[:, None, None] * on_element
        for i in range(2):
            for j in range(2):
                # a node is the lower end of one element at most, and the upper end of one
                at = np.ix_(elements[rows, i], elements[:, j])
                log_matrix[at] += logs[:, :, i, j]
                sign_matrix[at] += signs[:, :, i, j]
    return 0.5 * (log_matrix + log_matrix.T), 0.5 * (sign_matrix - sign_matrix.T)


def _plus(matrix: Array, nodes: Ints, blocks: Array) -> Array:
    """Return a matrix plus blocks (E, k, k) for the nodes (E, k) of elements.

    A node has one place in one element at most: it is the lower end of one, the upper end of one.
    """
    found = matrix.copy()
    for i, row in enumerate(nodes.T):
        for j, column in enumerate(nodes.T):
            found[row, column] += blocks[:, i, j]
    return found


def _far_pairs(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Return (E, F, 2, 2) integrals of both kernels over pairs of elements apart."""
    point, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    upper, weight = 0.5 * (1.0 + point), 0.5 * weight
    shape = np.stack([1.0 - upper, upper]) * weight
    x, s = (low[:, None] + np.outer(high - low, upper) for low, high in ((a, b), (c, d)))
    apart = np.abs(x[:, None, :, None] - s[None, :, None, :])
    kernel = np.log(np.where(apart > 0.0, apart, 1.0))
    size = np.outer(b - a, d - c)[:, :, None, None]
    logs = size * np.einsum("ip,efpq,jq->efij", shape, kernel, shape, optimize=True)
    side = np.sign((a + b)[:, None] - (c + d))[:, :, None, None]
    return logs, 0.25 * size * side * np.ones((2, 2))


def _near_pairs(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return (n, 2, 2) integrals of N_i(x) N_j(s) ln|x - s| for x in [a, b], s in [c, d].

    In units of b - a, by parts with the antiderivatives G1, G2, ... of ln and the linear shape
    functions N,

        int_c^d N ln|x - s| ds = N(c) G1(x - c) - N(d) G1(x - d) + N' [G2(x - c) - G2(x - d)].
    """
    unit = b - a
    mean = 0.25 * unit * (d - c) * np.log(unit)
    c, d = (c - a) / unit, (d - a) / unit

    def over_x(i: int, n: int, s: Array) -> Array:
        """Return the integral of N_i(x) Gn(x - s)."""
        end = log_integral(n + 1, 1.0 - s) if i else -log_integral(n + 1, -s)
        change = log_integral(n + 2, 1.0 - s) - log_integral(n + 2, -s)
        return np.asarray(end - (2 * i - 1) * change)

    found = np.empty((*unit.shape, 2, 2))
    for i in range(2):
        for j in range(2):
            slope = (2 * j - 1) / (d - c)
            end = -over_x(i, 1, d) if j else over_x(i, 1, c)
            found[..., i, j] = end + slope * (over_x(i, 2, c) - over_x(i, 2, d))
    return np.asarray(found * (unit**2)[:, None, None] + mean[:, None, None])


@dataclass(frozen=True)
class HalfPlaneMaterial:
    """Elastic constants of a half-plane."""

    mu: float  # shear modulus, a stress
    # Kolosov's constant: 3 - 4 nu in plane strain, (3 - nu) / (1 + nu) in plane stress
    kappa: float
    nu_out: float  # s_zz / (s_xx + s_yy): nu in plane strain, 0 in plane stress

    @property
    def c1(self) -> float:
        """Displacement by a unit force along itself, over -ln(distance)."""
        return (self.kappa + 1.0) / (4.0 * np.pi * self.mu)

    @property
    def c2(self) -> float:
        """Displacement by a unit force across itself, the same at all distances."""
        return (self.kappa - 1.0) / (8.0 * self.mu)

    @property
    def stretch(self) -> float:
        """Stress over strain along a surface without tractions: E / (1 - nu^2) in plane strain."""
        return 8.0 * self.mu / (self.kappa + 1.0)

    @property
    def contraction(self) -> float:
        """Strain across, negative, over strain along: nu / (1 - nu) in plane strain."""
        return (3.0 - self.kappa) / (self.kappa + 1.0)


def plane_material(young: float, poisson: float, plane_stress: bool) -> HalfPlaneMaterial:
    """Return the constants of a material in plane strain or plane stress."""
    mu = 0.5 * young / (1.0 + poisson)
    if plane_stress:
        return HalfPlaneMaterial(mu, (3.0 - poisson) / (1.0 + poisson), 0.0)
    return HalfPlaneMaterial(mu, 3.0 - 4.0 * poisson, poisson)


@dataclass(frozen=True)
class Surface:
    """Nodes and elements on the surface of a half-plane."""

    x: Array  # (N,) positions along t
    elements: Ints  # (E, 2) nodes at the lower and the upper end of each element
    B: Array  # (N, N) work of the traction of one node on the displacement of another one
    # logs, signs: (N, N) integrals of :func:`surface_integrals` for lengths in units of ``length``
    logs: Array
    signs: Array
    weight: Array  # (N,) integral of each hat function
    length: float  # length of the surface between its first and its last node


def surface_of(x: Array, elements: Ints, order: int = 1) -> Surface:
    """Return the surface of nodes x (N,) along t and elements (E, 2), the lower node first.

    On elements of order 1, B is the integral of phi_i phi_j and (h^2 / 12) phi_i' phi_j' with the
    shortest length h: the error of waves on equal elements is one of fourth order then. As h is the
    same for all, this vanishes where displacements are linear, also where neighbours differ. Of
    order 2, each has two of ``elements``, in their order.
    """
    length, none = float(np.ptp(x)), np.zeros((len(x), len(x)))
    scaled = (x - x.min()) / length
    logs, signs = surface_integrals(scaled, elements)
    h = np.diff(scaled[elements], axis=1)[:, :, None]
    mass = _plus(none, elements, h / np.array([[3.0, 6.0], [6.0, 3.0]]))
    if order == 1:
        size = float(h.min()) ** 2 / 12.0
        B = _plus(mass, elements, size * np.array([[1.0, -1.0], [-1.0, 1.0]]) / h)
    else:
        # hats of the ends and the middle of [0, 1] with the shape functions (1 - s)(1 - 2 s),
        # 4 s (1 - s), s (2 s - 1)
        block = np.array([[7.0, 6.0, -1.0], [2.0, 20.0, 2.0], [-1.0, 6.0, 7.0]]) / 48.0
        four = elements.reshape(-1, 4)
        four = np.take_along_axis(four, scaled[four].argsort(axis=1), axis=1)
        three, size = four[:, [0, 1, 3]], np.ptp(scaled[four], axis=1)[:, None, None]
        B = _plus(none, three, size * block)
    weight = mass.sum(axis=1)
    return Surface(x, elements, length * B, logs, signs, length * weight, length)


def compliance(surface: Surface, material: HalfPlaneMaterial, side: int, datum: float) -> Array:
    """Return D (2N, 2N) of Flamant's solution: work of unit nodal tractions on each other.

    ``side`` is +1 where n points into the half-plane, else -1; displacements by the resultant
    vanish at the depth ``datum``.
    """
    weight = surface.weight / surface.length
    total = np.outer(weight, weight)
    coupling = side * material.c2 * surface.signs
    level = -material.c1 * (surface.logs - np.log(datum / surface.length) * total)
    rest = total / (2.0 * np.pi * material.mu)
    return np.asarray(
        surface.length**2 * np.block([[level + rest, -coupling], [coupling, level - rest]])
    )


class SurfaceStiffness:
    """Stiffness A = B^T D^-1 B (2N, 2N) of the nodes of a surface, the far field at rest.

    ``tractions`` are the nodal tractions D^-1 B (2N, 2N) of unit displacements.
    """

    def __init__(self, surface: Surface, D: Array) -> None:
        """Factor D; SolveError: it is not positive definite, the datum is too near."""
        zero = np.zeros_like(surface.B)
        self.B = np.block([[surface.B, zero], [zero, surface.B]])
        try:
            factor = cho_factor(D, lower=True)
        except LinAlgError:
            raise SolveError(
                "the compliance of the half-plane's surface is not positive definite; choose a "
                "deeper datum"
            ) from None
        self.tractions = np.asarray(cho_solve(factor, self.B))
        A = self.B.T @ self.tractions
        self.A = 0.5 * (A + A.T)

    def moved_by(self, D: Array) -> Array:
        """Return the displacements (2N, 2N) by a compliance D under the tractions of unit ones."""
        return np.asarray(np.linalg.solve(self.B, D @ self.tractions))


@dataclass(frozen=True)
class FarField:
    """What acts on the far field of a half-plane.

    The four motions are translations in x and y, the rotation about the contact's middle, and the
    uniform strain along the surface, which is never free.
    """

    # (4,) motions that follow from the balance of forces; the others are given
    free: NDArray[np.bool_]
    force: Array  # (n_loads, 4) forces of unit loads in the free motions
    moved: Array  # (n_loads, 4) given motions of unit loads
    sign: Array  # (n_loads,) -1 for forces, +1 for displacements, 0 where none acts


@dataclass(frozen=True)
class CondensedHalfPlane:
    """Contact stiffness of a half-plane, with r = r_star^T lambda + K u."""

    K: Array  # (2N, 2N) stiffness
    r_star: Array  # (n_loads, 2N) reactions to unit loads, contact nodes held
    compliance: Array  # (n_loads, n_loads) work-conjugate quantities, contact nodes held
    # (4, 2N) and (4, n_loads): the motion of the far field is their sum for u and the load factors
    motion: tuple[Array, Array]


def condense_far_field(A: Array, modes: Array, far: FarField) -> CondensedHalfPlane:
    """Eliminate the free motions of the far field.

    The motions R = ``modes`` (2N, 4) have amplitudes a, of which d is given. From r = A (u - R a)
    with A (2N, 2N), and the balance R_free^T r = -F,

        a_free = G [R_free^T A (u - R_given d) + F],   G = (R_free^T A R_free)^-1.
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
