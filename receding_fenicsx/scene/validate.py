"""Validation of a scene: errors for what cannot be modelled, warnings for what is inaccurate.

Every message is one line: the table and key, what is wrong, what to do.
"""

from __future__ import annotations

import math

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import check_count, check_size
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.scene.model import TABLE_OF, Harmonic, Load, Scene
from receding_fenicsx.scene.units import check_units
from receding_fenicsx.scene.validate_bodies import check_bodies, check_half_planes, check_mesh
from receding_fenicsx.scene.validate_contacts import (
    check_contacts,
    check_initial_slip,
    gap_warnings,
)
from receding_fenicsx.scene.validate_loads import check_loads, check_supports
from receding_fenicsx.scene.validate_options import (
    MAX_MODES,
    check_accuracy,
    check_output,
    check_probes,
    check_shakedown,
    check_solver,
)

LOCKING_POISSON = 0.45
"""Poisson's ratio above which elements of order 1 are too stiff. On the paper's block with 81
contact nodes, the error of their dissipation is 3 to 8 % at 0.49 and 11 to 30 % at 0.499; that of
order 2 is 1 %."""


def validate(scene: Scene) -> None:
    """Check that a scene can be modelled.

    Args:
        scene: the scene.

    Raises:
        InputError: a value has no meaning, contradicts another one, or needs a feature that is not
            available.
    """
    if not isinstance(scene, Scene):
        kind = type(scene).__name__
        raise InputError(f'a scene is needed, as read_scene("block.toml") returns it, not a {kind}')
    check_accuracy(scene)
    _check_finite(scene, "scene")
    check_bodies(scene)
    check_mesh(scene)
    check_contacts(scene)
    check_half_planes(scene)
    check_loads(scene)
    check_supports(scene)
    check_probes(scene)
    check_solver(scene.solver)
    check_shakedown(scene)
    check_count(scene.mode.count, MAX_MODES, "[mode] count")
    check_units(scene.units)
    history = history_from_scene(scene)
    check_initial_slip(scene)
    check_output(scene, history)


def scene_warnings(scene: Scene) -> list[str]:
    """Return one line for each option that makes the results inaccurate without any error."""
    lines = []
    largest = max(
        (
            material.poisson
            for material in (scene.material, *scene.materials)
            if material.kinematics != "plane stress"
        ),
        default=0.0,
    )
    if scene.mesh.degree == 1 and largest > LOCKING_POISSON:
        lines.append(
            f"[mesh] degree: elements of order 1 lock near incompressibility (Poisson's ratio "
            f"{largest:g}), which the residual does not show; use degree = 2"
        )
    return lines + gap_warnings(scene)


def _check_finite(value: object, where: str) -> None:
    """Refuse NaN, infinity and huge numbers; scenes made in Python may hold them."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f"{where}: must be a finite number, not {value}")
        check_size(value, where)
    if isinstance(value, dict):
        for key, item in value.items():
            _check_finite(item, f"{where}.{key}")
    elif isinstance(value, list | tuple):
        for item in value:
            _check_finite(item, where)
    elif hasattr(value, "__dataclass_fields__"):
        label = f"[{TABLE_OF.get(where, where)}]"
        if isinstance(value, Load | Harmonic):
            label = f"load '{value.name}'" if isinstance(value, Load) else where
        for key in value.__dataclass_fields__:
            _check_finite(getattr(value, key), key if where == "scene" else f"{label} {key}")
