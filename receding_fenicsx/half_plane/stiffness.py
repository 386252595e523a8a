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

    Args:
        x: (N,) positions of the nodes, in units of about the length of all elements.
        elements: (E, 2) nodes at the lower and the upper end of each element; elements may not
            overlap.

    Returns:
        (N, N) integrals of phi_i(x) phi_j(s) ln|x - s| ds dx, symmetric, and those of
        phi_i(x) phi_j(s) sgn(x - s) ds dx, antisymmetric; both to the last bit.
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


def mixed_masses(x: Array, elements: Ints) -> Array:
    """Return the (N, N) integrals of phi_i phi_j."""
    mass = np.zeros((len(x), len(x)))
    length = np.diff(x[elements], axis=1)[:, 0]
    for i in range(2):
        for j in range(2):
            mass[elements[:, i], elements[:, j]] += length / (3.0 if i == j else 6.0)
    return mass


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
    """Return (n, 2, 2) integrals of ln|x - s| over pairs of elements, relative to [a, b]."""
    unit = b - a
    found = _closed(0.0 * a, unit / unit, (c - a) / unit, (d - a) / unit)
    mean = 0.25 * unit * (d - c) * np.log(unit)
    return np.asarray(found * (unit**2)[:, None, None] + mean[:, None, None])


def _closed(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return (n, 2, 2) integrals of N_i(x) N_j(s) ln|x - s| for x in [a, b], s in [c, d].

    By parts, with the antiderivatives G1, G2, ... of ln and the linear shape functions N,

        int_c^d N ln|x - s| ds = N(c) G1(x - c) - N(d) G1(x - d) + N' [G2(x - c) - G2(x - d)].
    """

    def over_x(i: int, n: int, s: Array) -> Array:
        """Return the integral of N_i(x) Gn(x - s)."""
        slope = (2 * i - 1) / (b - a)
        end = log_integral(n + 1, b - s) if i else -log_integral(n + 1, a - s)
        lower, upper = (log_integral(n + 2, edge - s) for edge in (a, b))
        return np.asarray(end - slope * (upper - lower))

    found = np.empty((*a.shape, 2, 2))
    for i in range(2):
        for j in range(2):
            slope = (2 * j - 1) / (d - c)
            end = -over_x(i, 1, d) if j else over_x(i, 1, c)
            found[..., i, j] = end + slope * (over_x(i, 2, c) - over_x(i, 2, d))
    return found


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
    """Return the surface of some nodes; see :class:`Surface`.

    Args:
        x: (N,) positions along t.
        elements: (E, 2) neighbouring nodes, the lower one first.
        order: order of the elements that interpolate the displacements; of order 2, each has two
            of ``elements``, in their order.
    """
    length = float(np.ptp(x))
    scaled = (x - x.min()) / length
    logs, signs = surface_integrals(scaled, elements)
    mass = mixed_masses(scaled, elements)
    weight = mass.sum(axis=1)
    B = _shifted(mass, scaled, elements) if order == 1 else _quadratic_masses(scaled, elements)
    return Surface(x, elements, length * B, logs, signs, length * weight, length)


def _shifted(mass: Array, x: Array, elements: Ints) -> Array:
    """Return B for linear shape functions: their integrals and the shortest element's correction.

    The form (h^2 / 12) int phi_i' phi_j' with the shortest length h makes the error of waves on
    equal elements one of fourth order. As h is the same for all elements, it vanishes where
    displacements are linear, also where neighbouring elements differ.
    """
    length = np.diff(x[elements], axis=1)[:, 0]
    size = float(length.min()) ** 2 / 12.0
    B = mass.copy()
    for i in range(2):
        for j in range(2):
            B[elements[:, i], elements[:, j]] += (size if i == j else -size) / length
    return B


def _quadratic_masses(x: Array, elements: Ints) -> Array:
    """Return the (N, N) integrals of a hat function and a quadratic shape function."""
    B = np.zeros((len(x), len(x)))
    # hats of the ends and the middle of [0, 1] with the shape functions (1 - s)(1 - 2 s),
    # 4 s (1 - s), s (2 s - 1)
    block = np.array([[7.0, 6.0, -1.0], [2.0, 20.0, 2.0], [-1.0, 6.0, 7.0]]) / 48.0
    for low, high in zip(elements[0::2], elements[1::2], strict=True):
        nodes = np.unique([*low, *high])
        nodes = nodes[np.argsort(x[nodes])]
        B[np.ix_(nodes, nodes)] += (x[nodes[2]] - x[nodes[0]]) * block
    return B


def compliance(surface: Surface, material: HalfPlaneMaterial, side: int, datum: float) -> Array:
    """Return D (2N, 2N) of Flamant's solution: work of unit nodal tractions on each other.

    Args:
        surface: the nodes.
        material: elastic constants.
        side: +1 where n points into the half-plane, -1 where it points out of it.
        datum: depth of the point at which displacements by the resultant vanish.
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
    """Stiffness of the nodes of a surface, the far field at rest.

    Attributes:
        A: (2N, 2N) stiffness B^T D^-1 B.
        tractions: (2N, 2N) nodal tractions D^-1 B of unit displacements.
    """

    def __init__(self, surface: Surface, D: Array) -> None:
        """Factor D.

        Raises:
            SolveError: D is not positive definite: the datum is too near.
        """
        n = len(surface.x)
        self.D, self.B = D, np.zeros((2 * n, 2 * n))
        self.B[:n, :n] = self.B[n:, n:] = surface.B
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


# -- far field -------------------------------------------------------------------------------------


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
