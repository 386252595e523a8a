"""Mirror symmetry of a scene about x = 0."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import ArrayLike

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import FREE, Body, Contact, Joint, Load, Scene, Spring, Support
from receding_fenicsx.scene.options import KINDS
from receding_fenicsx.scene.profiles import directions, evaluate

EDGES = ("bottom", "top", "left", "right")
"""Edges of a rectangle; its position is the middle of "bottom"."""
HORIZONTAL = ("bottom", "top")
"""Edges along x."""


def is_cylinder(scene: Scene, body: Body) -> bool:
    """Return whether the axis of revolution is the rectangle's middle: only x >= 0 is modelled."""
    return scene.axisymmetric and body.position[0] == 0.0


def is_horizontal(scene: Scene, edge: str) -> bool:
    """Return whether an edge is the bottom or the top of a rectangle."""
    return scene.find_edge(edge)[1] in HORIZONTAL


def edge_range(scene: Scene, edge: str) -> tuple[float, float]:
    """Return the ends of a rectangle's edge from its middle, or as radii, as in ``span``."""
    body, name = scene.find_edge(edge)
    if name not in EDGES:
        raise InputError(f"'{edge}' is no edge of a rectangle; use one of {', '.join(EDGES)}")
    half = 0.5 * (body.width if name in HORIZONTAL else body.height)
    middle = body.position[0] if scene.axisymmetric and name in HORIZONTAL else 0.0
    on_axis = name in HORIZONTAL and is_cylinder(scene, body)
    return 0.0 if on_axis else middle - half, middle + half


def edge_points(scene: Scene, edge: str, along: ArrayLike) -> tuple[Array, Array]:
    """Return the coordinates (x, y) of points at positions along a rectangle's edge."""
    body, name = scene.find_edge(edge)
    t = np.asarray(along, dtype=float)
    x, y = body.position
    if name in HORIZONTAL:
        t = t + (0.0 if scene.axisymmetric else x)  # positions are radii
        return t, np.full(t.shape, y + (0.0 if name == "bottom" else body.height))
    side = -0.5 if name == "left" else 0.5
    return np.full(t.shape, x + side * body.width), t + (y + 0.5 * body.height)


def contact_samples(scene: Scene, contact: Contact) -> Array:
    """Return the nominal positions of the contact nodes on an edge, equally spaced."""
    low, high = contact.span or edge_range(scene, contact.edge)
    half_plane = scene.find_edge(contact.edge)[0].is_half_plane
    # a half-plane's tractions are linear between the nodes
    n = (1 if half_plane else scene.mesh.degree) * scene.mesh.contact_elements
    return 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-1.0, 1.0, n + 1)


def body_points(scene: Scene, body: Body) -> tuple[Array, Array]:
    """Return points (x, y) of a rectangle, each (n, n), row by row from left to right."""
    # none lies on an edge, where an expression such as 1/x may end
    s = (np.arange(41) + 0.5) / 41 - 0.5
    x, y = body.position[0] + body.width * s, body.position[1] + body.height * (s + 0.5)
    x, y = np.meshgrid(0.5 * body.width * (s + 0.5) if is_cylinder(scene, body) else x, y)
    return x, y


def load_samples(scene: Scene, load: Load) -> Array:
    """Return the positions along a load's span at which its profile is checked."""
    low, high = load.span or edge_range(scene, load.edge)
    # of an odd number one is at the centre
    return 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-1.0, 1.0, 401)


def is_mirror_symmetric(scene: Scene) -> bool:
    """Return whether a valid scene is mirror-symmetric about x = 0: half of it can be modelled.

    Initial slip and x-components must be odd, other profiles even, as far as sample points show.
    """
    if (
        scene.bolts
        or any(load.mode or load.travel for load in scene.loads)
        or any(m.young_2 and m.angle % 90.0 for m in (scene.material, *scene.materials))
        or any(spring.point or spring.against for spring in scene.springs)
        or any(not body.is_rectangle or body.position[0] != 0.0 for body in scene.bodies)
        or not all(_is_mirrored(scene, joint) for joint in scene.joints)
    ):
        return False
    for contact in scene.contacts:
        x = contact_samples(scene, contact)
        limits = (contact.shear_limit, contact.cohesion)
        profiles = (contact.initial_gap, contact.interference, *limits)
        if not all(_is_even(evaluate(p or 0.0, x)) for p in profiles):
            return False
        # the mirror image of forward slip is backward slip
        both = [evaluate(profile, x) for profile in directions(contact.friction)]
        slip = evaluate(scene.history.initial_slip or 0.0, x)
        if not (_is_even(np.concatenate(both)) and _is_even(slip, sign=-1.0)):
            return False
    for load in scene.loads:
        if load.on_body:
            body = next(body for body in scene.bodies if load.body in (None, body.name))
            # from left to right along the first axis
            x, y = (part.T for part in body_points(scene, body))
        elif _is_mirrored(scene, load):
            x, y = edge_points(scene, load.edge, load_samples(scene, load))
        else:
            return False
        value = next(getattr(load, kind) for kind in KINDS if getattr(load, kind) is not None)
        # the first of two components is odd
        parts = zip((-1.0, 1.0), value, strict=True) if isinstance(value, tuple) else [(1.0, value)]
        found = [(sign, evaluate(part, x, y)) for sign, part in parts if part != FREE]
        scale = max(float(np.abs(values).max()) for _, values in found)
        if not all(_is_even(values, sign, scale) for sign, values in found):
            return False
    held: list[Spring | Support] = [*scene.springs, *scene.supports]
    own, mirrored = (Counter(_key(scene, part, m) for part in held) for m in (False, True))
    return own == mirrored


def is_half_meshed(scene: Scene) -> bool:
    """Return whether only x >= 0 is meshed: axisymmetric, or half of a mirror-symmetric scene."""
    if scene.axisymmetric:
        return True
    return scene.solver.symmetry == "auto" and is_mirror_symmetric(scene)


def _is_even(values: Array, sign: float = 1.0, scale: float | None = None) -> bool:
    """Return whether values at points symmetric about 0 are even (sign 1) or odd (sign -1)."""
    scale = float(np.abs(values).max()) if scale is None else scale
    return bool(np.all(np.abs(values - sign * values[::-1]) <= 1e-12 * scale))  # round-off


def _is_mirrored(scene: Scene, part: Joint | Load) -> bool:
    """Return whether a part of a horizontal edge is its own mirror image."""
    if not is_horizontal(scene, part.edge):
        return False
    low, high = edge_range(scene, part.edge)
    return part.span is None or _is_even(np.array(part.span), -1.0, high - low)


def _key(scene: Scene, part: Spring | Support, mirrored: bool) -> tuple[object, ...]:
    """Return what a spring or support, or its mirror image, is and does."""
    swap = {"left": "right", "right": "left"} if mirrored else {}
    body, edge, at = part.body, "", part.point
    if part.edge:
        held, edge = scene.find_edge(part.edge)
        body, edge = held.name, swap.get(edge, edge)
    if mirrored and isinstance(at, tuple):
        at = (0.0 - at[0], at[1])
    if isinstance(part, Support):
        return body, edge, at, "".join(sorted(part.fix))
    low, high = part.span or edge_range(scene, part.edge)
    if mirrored and is_horizontal(scene, part.edge):
        low, high = 0.0 - high, 0.0 - low
    return body, edge, low, high, part.normal, part.tangential
