"""Elastic constants of the plane and axisymmetric problems."""

from __future__ import annotations

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Material


def lame_constants(material: Material) -> tuple[float, float]:
    """Return Lame's lambda and mu for E = 1; in plane stress, lambda as it acts in the plane.

    Plane strain and axisymmetric: lambda = nu / ((1 + nu)(1 - 2 nu)); plane stress:
    nu / (1 - nu^2); mu = 1 / (2 (1 + nu)).

    Raises:
        InputError: constants or kinematics that cannot be modelled.
    """
    nu = material.poisson
    if not material.young > 0.0:
        raise InputError(f"material.young = {material.young:g} must be positive")
    if not -1.0 < nu < material.poisson_limit:
        raise InputError(
            f"material.poisson = {nu:g} must lie between -1 and {material.poisson_limit:g}"
        )
    mu = 0.5 / (1.0 + nu)
    if material.kinematics in ("plane strain", "axisymmetric"):
        return nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), mu
    if material.kinematics == "plane stress":
        return nu / (1.0 - nu**2), mu
    raise InputError(
        f"material.kinematics = '{material.kinematics}' is not available; "
        'use "plane strain", "plane stress" or "axisymmetric"'
    )
