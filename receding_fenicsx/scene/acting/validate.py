"""Validation of loads on whole bodies."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import SMALLEST
from receding_fenicsx.scene.model import Body, Load, Scene
from receding_fenicsx.scene.profiles import evaluate_checked
from receding_fenicsx.scene.rectangle_edges import body_points

ON_EDGES = ("edge", "span", "platen", "pressure", "traction", "displacement", "force", "tension")
"""Keys of a load on an edge."""


def check_body_load(scene: Scene, load: Load, where: str) -> None:
    """Check a body force or thermal strain: its body, and that its profile is finite, not zero."""
    given = [key for key in ON_EDGES if getattr(load, key)]
    if load.body_force is not None and load.thermal_strain is not None:
        given.append("thermal_strain")
    kind = "thermal_strain" if load.body_force is None else "body_force"
    if given:
        raise InputError(f"{where}: {kind} acts on a whole body; remove {given[0]}")
    body = body_named(scene, load.body, where, "load")
    if body.is_half_plane:
        raise InputError(f"{where} {kind}: a half-plane has no mesh to act on; give it a shape")
    value = getattr(load, kind)
    parts = value if isinstance(value, tuple) else (value,)
    if any(isinstance(part, dict) for part in parts):
        raise InputError(f"{where} {kind}: a table runs along an edge; write an expression in x, y")
    if body.mesh is not None:
        # its points are known when it is meshed
        return
    x, y = body_points(scene, body)
    values = [evaluate_checked(part, x, y, f"{where} {kind}") for part in parts]
    if np.abs(values).max() < SMALLEST:
        raise InputError(f"{where} {kind}: is zero everywhere; give it a value or remove the load")


def body_named(scene: Scene, name: str | None, where: str, what: str = "point") -> Body:
    """Return the body that a point or load names; a name is for scenes of two bodies only."""
    names = [body.name for body in scene.bodies]
    if (name is None) == bool(scene.others) or name not in (None, *names):
        raise InputError(
            f"{where} body: must name the body of the {what}; give one of {', '.join(names)}"
            if scene.others
            else f"{where} body: the scene has one body only; remove it"
        )
    return scene.bodies[names.index(name) if name is not None else 0]
