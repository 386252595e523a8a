"""Thermal strain alpha dT, free of stress: sigma = C (epsilon - sum_k lambda_k alpha dT_k 1)."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.profiles import evaluate_checked


def thermal_strain(scene: Scene, load_names: tuple[str, ...], points: Array) -> Array:
    """Return the thermal strain (..., n_loads) of each load with factor 1 at points (..., 2).

    Args:
        scene: the scene of one body.
        load_names: names of its loads.
        points: points of the body.
    """
    strain = np.zeros((*points.shape[:-1], len(load_names)))
    for load in scene.loads:
        if load.thermal_strain is not None:
            strain[..., load_names.index(load.name)] += strain_of(load, points)
    return strain


def strain_of(load: Load, points: Array) -> Array:
    """Return the thermal strain (...) of one load at points (..., 2)."""
    assert load.thermal_strain is not None
    x, y = np.moveaxis(points, -1, 0)
    return evaluate_checked(load.thermal_strain, x, y, f"{load.label} thermal_strain")
