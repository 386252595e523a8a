"""Elastic constants of the plane and axisymmetric problems, of one material or cell by cell."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.scene.model import Material, Scene


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


def stiffness_of(material: Material) -> Array:
    """Return C (4, 4) in [sxx, syy, szz, sxy] = C [exx, eyy, ezz, 2 exy].

    In plane stress szz and ezz are left out. An orthotropic material has along its directions 1 and
    2 the compliances 1 / E_1, 1 / E_2, -nu_12 / E_1 and 1 / G_12.
    """
    plane = material.kinematics == "plane stress"
    C = np.zeros((4, 4))
    if material.young_2 is None or material.shear is None:
        lam, mu = (material.young * constant for constant in lame_constants(material))
        C[:3, :3] = lam + 2.0 * mu * np.eye(3)
        C[3, 3] = mu
        if plane:
            C[2], C[:, 2] = 0.0, 0.0
        return C
    across = -material.poisson / material.young
    soft = np.array([[1.0 / material.young, across], [across, 1.0 / material.young_2]])
    Q = np.zeros((3, 3))
    Q[:2, :2], Q[2, 2] = np.linalg.inv(soft), material.shear
    c, s = np.cos(np.radians(material.angle)), np.sin(np.radians(material.angle))
    # strains [11, 22, 2 12] from [xx, yy, 2 xy]
    turn = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    C[np.ix_([0, 1, 3], [0, 1, 3])] = turn.T @ Q @ turn
    return C


def stiffness_in(scene: Scene, body: BodyMesh) -> Array:
    """Return C (4, 4) of a body of one material, (owned cells, 4, 4) of one with several."""
    if body.materials is None:
        return stiffness_of(scene.material)
    return np.array([stiffness_of(material) for material in scene.materials])[body.materials]


def linear_stresses(C: Array, strain: Array) -> Array:
    """Return (..., [sxx, syy, szz, sxy]) from strains (..., [exx, eyy, ezz, 2 exy]).

    C is (4, 4), or (cells, 4, 4) for strains (cells, ..., 4).
    """
    if C.ndim == 2:
        return strain @ C.T
    return np.asarray(np.einsum("cij,c...j->c...i", C, strain))


def free_strain(material: Material) -> Array:
    """Return [exx, eyy, ezz, 2 exy] of a unit thermal strain.

    In plane stress the strain along z is free and does not enter. In plane strain and axisymmetric
    it does: in plane strain the stress then has the factor 1 + nu of its free strain in the plane.
    """
    return np.array([1.0, 1.0, float(material.kinematics != "plane stress"), 0.0])
