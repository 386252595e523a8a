"""Validation of loads on whole bodies, of points and of springs."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.acting.tables import ON_BODY
from receding_fenicsx.scene.checks import SMALLEST
from receding_fenicsx.scene.model import Body, Load, Scene, Spring, Support
from receding_fenicsx.scene.profiles import evaluate_checked
from receding_fenicsx.scene.rectangle_edges import body_points, is_cylinder
from receding_fenicsx.scene.validate_contacts import LENGTH_TOLERANCE, check_edge, check_span

ON_EDGES = ("edge", "span", "platen", "pressure", "traction", "displacement", "force", "tension")
"""Keys of a load on an edge."""


def check_body_load(scene: Scene, load: Load, where: str) -> None:
    """Check a body force or thermal strain: its body, and that its profile is finite, not zero."""
    kind, *others = [kind for kind in ON_BODY if getattr(load, kind) is not None]
    given = [key for key in ON_EDGES if getattr(load, key)] + others
    if given:
        raise InputError(f"{where}: {kind} acts on a whole body; remove {given[0]}")
    if load.mode is not None:
        if load.mode < 1:
            raise InputError(f"{where} mode: must be at least 1, not {load.mode}")
        check_modes(scene, where)
        return
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


def check_modes(scene: Scene, where: str) -> None:
    """Check that the bodies of a scene have vibration modes."""
    if any(body.is_half_plane for body in scene.bodies):
        raise InputError(f"{where}: half-planes have no vibration modes; use bodies with a mesh")
    if any(bolt.stiffness is None for bolt in scene.bolts):
        raise InputError(f"{where}: vibration modes need elastic bolts; give them a stiffness")
    if any(scene.material_of(body).density <= 0.0 for body in scene.bodies):
        raise InputError("[material] density: vibration modes need one of every body; give it")


def body_named(scene: Scene, name: str | None, where: str, what: str = "point") -> Body:
    """Return the body that a point or load names; a name is for scenes of several bodies only."""
    names = [body.name for body in scene.bodies]
    if (name is None) == bool(scene.others) or name not in (None, *names):
        raise InputError(
            f"{where} body: must name the body of the {what}; give one of {', '.join(names)}"
            if scene.others
            else f"{where} body: the scene has one body only; remove it"
        )
    return scene.bodies[names.index(name) if name is not None else 0]


def check_spring(scene: Scene, spring: Spring) -> None:
    """Check where a spring acts, and that its stiffness is positive."""
    where = spring.label
    if bool(spring.edge) == (spring.point is not None):
        have = "both" if spring.edge else "neither"
        raise InputError(f"{where}: has {have} of edge and point; give exactly one of them")
    keys, excluded = ["normal", "tangential"], ["body", "x", "y"]
    if spring.point is not None:
        keys, excluded = ["x", "y"], ["span", "against", "normal", "tangential"]
    for key in excluded:
        if getattr(spring, key):
            what = "an edge" if spring.edge else "a point"
            raise InputError(f"{where} {key}: is not for {what}; give {' and '.join(keys)}")
    if spring.point is not None:
        check_point(scene, spring, where)
    else:
        check_edge(scene, spring.edge, f"{where} edge", ())
        check_span(scene, spring.edge, spring.span, f"{where} span")
    if spring.against is not None:
        check_edge(scene, spring.against, f"{where} against", ())
        if scene.find_edge(spring.edge)[0] == scene.find_edge(spring.against)[0]:
            raise InputError(f"{where} against: must be an edge of another body")
    for key in keys:
        if getattr(spring, key) < 0.0:
            raise InputError(f"{where} {key}: is {getattr(spring, key):g}; must not be negative")
    if max(getattr(spring, key) for key in keys) < SMALLEST:
        raise InputError(f"{where}: has no stiffness; give {keys[0]}, {keys[1]} or both")


def check_point(scene: Scene, support: Support | Spring, where: str) -> None:
    """Check that the point of a support or spring lies on its body."""
    body = body_named(scene, support.body, where)
    if body.is_half_plane:
        raise InputError(f'{where} point: hold the edge "far" of a half-plane instead')
    if body.mesh is not None:
        return
    if not isinstance(support.point, tuple):
        raise InputError(f"{where} point: a rectangle has no named points; write [x, y]")
    check_inside(scene, body, support.point, f"{where} point")


def check_inside(scene: Scene, body: Body, point: tuple[float, ...], where: str) -> None:
    """Check that a point lies on a rectangle."""
    x, y = point
    if body.is_half_plane:
        # the side is checked where the nodes are known
        return
    left, right = (body.position[0] + side * body.width for side in (-0.5, 0.5))
    low, high = (body.position[1] + part for part in (0.0, body.height))
    if is_cylinder(scene, body):
        left = 0.0
    slack = LENGTH_TOLERANCE * max(body.width, body.height)
    if not (left - slack <= x <= right + slack and low - slack <= y <= high + slack):
        raise InputError(
            f"{where}: ({x:g}, {y:g}) lies outside the body, {left:g} <= x <= {right:g}, "
            f"{low:g} <= y <= {high:g}; move it"
        )
