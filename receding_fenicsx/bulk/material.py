"""Elastic constants of the plane and axisymmetric problems."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
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


def linear_stresses(material: Material, gradient: Array) -> Array:
    """Return (..., [sxx, syy, szz, sxy]) from gradients (..., [xx, xy, yx, yy, zz])."""
    lam, mu = (material.young * constant for constant in lame_constants(material))
    exx, eyy, ezz = gradient[..., 0], gradient[..., 3], gradient[..., 4]
    dilation = exx + eyy + ezz
    sxx = lam * dilation + 2.0 * mu * exx
    syy = lam * dilation + 2.0 * mu * eyy
    sxy = mu * (gradient[..., 1] + gradient[..., 2])
    szz = lam * dilation + 2.0 * mu * ezz
    if material.kinematics == "plane stress":
        szz = np.zeros_like(sxx)
    return np.stack([sxx, syy, szz, sxy], axis=-1)


def free_gradient(material: Material) -> Array:
    """Return the gradient [xx, xy, yx, yy, zz] of a unit thermal strain.

    In plane stress the strain along z is free and does not enter. In plane strain and axisymmetric
    it does: in plane strain the stress then has the factor 1 + nu of its free strain in the plane.
    """
    return np.array([1.0, 0.0, 0.0, 1.0, float(material.kinematics != "plane stress")])


def unit_stress(material: Material) -> Array:
    """Return the stress [sxx, syy, szz, sxy] that a unit thermal strain takes away."""
    return linear_stresses(material, free_gradient(material))
