"""Arrows of the loads on the edges of rectangular bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.output.snapshots.vertices import edge_values
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.one_body import in_order
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.rectangle_edges import HORIZONTAL, edge_points, edge_range

OUTWARD = {"bottom": (0.0, -1.0), "top": (0.0, 1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


@dataclass(frozen=True)
class Arrows:
    """Arrows of the tractions of one load.

    Attributes:
        tails, heads: (n, 2) ends of the arrows.
        joined: whether a line through the tails is drawn.
    """

    tails: Array
    heads: Array
    joined: bool


def load_arrows(
    scene: Scene,
    names: tuple[str, ...],
    fields: Fields,
    factors: Array,
    exaggeration: float,
    size: float,
) -> list[Arrows]:
    """Return the arrows of the loads on rectangles, at the deformed edges.

    Args:
        scene: the scene.
        names: names of the loads.
        fields: fields of the whole body.
        factors: (n_loads,) load factors.
        exaggeration: factor of the displacements.
        size: size of the view, to which lengths of arrows are proportional.

    Returns:
        The arrows of each load that has a traction, in the scene's units of length.
    """
    largest = dict(zip(names, largest_factors(scene), strict=True))
    # largest distance between arrows, over the size of the view
    found = [
        (load, *_traction(scene, load, 0.22 * size))
        for load in scene.loads
        if not load.on_body and scene.find_edge(load.edge)[0].is_rectangle
    ]
    sizes = [largest[load.name] * np.linalg.norm(t, axis=1).max() for load, _, t in found]
    if not any(sizes):
        return []
    bodies, arrows = in_order(scene), []
    for load, points, traction in found:
        part = float(factors[names.index(load.name)]) / max(sizes)
        # length of the arrow of the largest traction, over the size of the view
        vector = 0.24 * size * part * traction
        if not np.any(vector):
            continue
        body, edge = scene.find_edge(load.edge)
        outward = np.array(OUTWARD[edge])
        number = bodies.index(body)
        moved = edge_values(fields, fields.displacement, points, outward, number)
        at = points + exaggeration * moved
        inward = vector @ outward < 0.0
        # distance between the arrows and the edge, over the size of the view
        tails = np.where(inward[:, None], at - vector, at) + 0.02 * size * outward
        arrows.append(Arrows(tails, tails + vector, bool(inward.all())))
    return arrows


def largest_factors(scene: Scene) -> Array:
    """Return (n_loads,) the largest absolute load factors over the history, 1 in place of 0."""
    path = history.history_from_scene(scene)
    largest = np.abs(np.vstack([path.path, path.loop])).max(axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def _traction(scene: Scene, load: Load, spacing: float) -> tuple[Array, Array]:
    """Return points of the edge and tractions there, (n, 2) each, of a load with factor 1.

    The traction of a platen is its mean value, that of a prescribed displacement is zero. Loads
    that begin on the axis of revolution are continued to its other side.
    """
    begin, end = load.span or edge_range(scene, load.edge)
    edge = scene.find_edge(load.edge)[1]
    level = scene.axisymmetric and edge in HORIZONTAL
    area = np.pi * (end**2 - begin**2) if level else end - begin
    begin = -end if level and begin == 0.0 else begin
    along = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / spacing)) + 1))
    x, y = edge_points(scene, load.edge, along)
    side = np.where(level & (x < 0.0), -1.0, 1.0)
    if load.pressure is not None:
        size = evaluate(load.pressure, side * x, y)
        traction = -size[:, None] * np.array(OUTWARD[edge])
    else:
        mean = (load.force[0] / area, load.force[1] / area) if load.force else (0.0, 0.0)
        parts = load.traction or mean
        traction = np.stack([evaluate(part, side * x, y) for part in parts], axis=1)
        traction[:, 0] *= side
    return np.stack([x, y], axis=1), traction
