"""Geometry of a rectangle's edges: ranges, points and sample positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Load, Scene

EDGES = ("bottom", "top", "left", "right")
"""Edges of a rectangle; its position is the middle of "bottom"."""
FAR = "far"
"""The far field of a half-plane, on which loads and supports act."""
HORIZONTAL = ("bottom", "top")
"""Edges along x."""
BODY_SAMPLES = 41
"""Points along each side of a rectangle at which loads on bodies are checked."""


def is_cylinder(scene: Scene, body: Body) -> bool:
    """Return whether the axis of revolution is the rectangle's middle: only x >= 0 is modelled."""
    return scene.axisymmetric and body.position[0] == 0.0


def is_horizontal(scene: Scene, edge: str) -> bool:
    """Return whether an edge is the bottom or the top of a rectangle."""
    return scene.find_edge(edge)[1] in HORIZONTAL


def edge_range(scene: Scene, edge: str) -> tuple[float, float]:
    """Return the ends of a rectangle's edge in the coordinate of ``span``.

    This is the position from the edge's middle, or the radius on a horizontal edge of a body of
    revolution.
    """
    body, name = scene.find_edge(edge)
    if name not in EDGES:
        raise InputError(f"'{edge}' is no edge of a rectangle; use one of {', '.join(EDGES)}")
    half = 0.5 * (body.width if name in HORIZONTAL else body.height)
    if scene.axisymmetric and name in HORIZONTAL:
        middle = body.position[0]
        return 0.0 if is_cylinder(scene, body) else middle - half, middle + half
    return -half, half


def edge_points(scene: Scene, edge: str, along: ArrayLike) -> tuple[Array, Array]:
    """Return the coordinates (x, y) of points at positions along a rectangle's edge."""
    body, name = scene.find_edge(edge)
    t = np.asarray(along, dtype=float)
    x, y = body.position
    if name in HORIZONTAL:
        if not scene.axisymmetric:  # there positions are radii
            t = t + x
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
    """Return points (x, y) of a rectangle, each (n, n), row by row from left to right.

    None lies on an edge, where an expression such as 1/x may end.
    """
    s = (np.arange(BODY_SAMPLES) + 0.5) / BODY_SAMPLES - 0.5
    x, y = body.position[0] + body.width * s, body.position[1] + body.height * (s + 0.5)
    x, y = np.meshgrid(0.5 * body.width * (s + 0.5) if is_cylinder(scene, body) else x, y)
    return x, y


def load_samples(scene: Scene, load: Load) -> Array:
    """Return the positions along a load's span at which its profile is checked."""
    low, high = load.span or edge_range(scene, load.edge)
    # points along an edge at which load profiles are checked (odd: one lies at the centre)
    return 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-1.0, 1.0, 401)
