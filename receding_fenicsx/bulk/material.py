"""Elastic constants of the plane and axisymmetric problems."""

from __future__ import annotations

from receding_fenicsx.scene.model import Material


def lame_constants(material: Material) -> tuple[float, float]:
    """Return Lame's lambda and mu for E = 1; in plane stress, lambda as it acts in the plane.

    Plane strain and axisymmetric: lambda = nu / ((1 + nu)(1 - 2 nu)); plane stress:
    nu / (1 - nu^2); mu = 1 / (2 (1 + nu)).
    """
    nu = material.poisson
    mu = 0.5 / (1.0 + nu)
    if material.kinematics == "plane stress":
        return nu / (1.0 - nu**2), mu
    return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), mu
