"""Compliance and stiffness of the surface nodes of a half-plane, or of two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import SolveError
from receding_fenicsx.half_plane.kernels import mixed_masses, surface_integrals


@dataclass(frozen=True)
class HalfPlaneMaterial:
    """Elastic constants of a half-plane.

    Attributes:
        mu: shear modulus, a stress.
        kappa: Kolosov's constant: 3 - 4 nu in plane strain, (3 - nu) / (1 + nu) in plane stress.
        nu_out: s_zz / (s_xx + s_yy): nu in plane strain, 0 in plane stress.
    """

    mu: float
    kappa: float
    nu_out: float

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
    """Nodes and elements on the surface of a half-plane.

    Attributes:
        x: (N,) positions along t.
        elements: (E, 2) nodes at the lower and the upper end of each element.
        B: (N, N) work of the traction of one node on the displacement of another one.
        logs, signs: (N, N) integrals of :func:`kernels.surface_integrals` for lengths in units of
            ``length``.
        weight: (N,) integral of each hat function.
        length: length of the surface between its first and its last node.
    """

    x: Array
    elements: Ints
    B: Array
    logs: Array
    signs: Array
    weight: Array
    length: float


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
