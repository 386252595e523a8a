"""Smaller elements where zones of a coarser run end, and at sharp corners in contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Ints
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.measures.half_widths import contact_betas, estimated_ends
from receding_fenicsx.scene.model import Refinement, Scene
from receding_fenicsx.scene.rectangle_edges import is_cylinder, is_horizontal

ZONE_RATIO = 4.0
"""Size of the elements of the coarse run over that at zone ends: it knows them not well enough for
more, which pays at those of a graded run."""
CORNER_RATIO = 100.0
"""Size of the elements of the coarse run over that at corners, where tractions may be singular."""
GROWTH = 1.5
"""Growth of the elements away from these places: slower ones cost nodes and gain little."""
UNLOADED = 1e-9
"""Largest nodal force of a turning point, over the record's, at which zone ends mean nothing."""


def refined_at_zone_ends(
    scene: Scene,
    record: Record,
    ratio: float = ZONE_RATIO,
    corner_ratio: float = CORNER_RATIO,
    growth: float = GROWTH,
) -> Scene:
    """Return a scene with smaller elements where zones end in a coarser run of it, and at corners.

    Zone ends are those at the turning points of cycles 0, 1 and the last one. Where an end was not
    fitted below the node spacing, the whole interval in which it lies is refined. Corners are ends
    of a contact edge that touch at one of these turning points.

    Args:
        scene: the scene; places in its ``mesh.refine`` are kept.
        record: a record of the scene, on this or on another mesh.
        ratio: size of the largest contact elements of the record over that at zone ends.
        corner_ratio: the same at corners.
        growth: size ratio of neighbouring elements away from the new places.

    Raises:
        InputError: a ratio is not positive, or the record belongs to other contact edges.
    """
    if not (ratio > 0.0 and corner_ratio > 0.0):
        raise InputError(f"refined_at_zone_ends: ratios must be positive, not {ratio:g}")
    parts = record.by_edge()
    numbers = np.unique(record.edge)
    if numbers[-1] >= len(scene.contacts):
        raise InputError("refined_at_zone_ends: the record has more contact edges than the scene")
    places = list(scene.mesh.refine)
    for part, number in zip(parts.values(), numbers, strict=True):
        edge = scene.contacts[number].edge if len(scene.contacts) > 1 else None
        size = float(np.diff(part.x).max()) * scene.mesh.degree
        rows = _loaded_rows(part)
        for at in _zone_ends(scene, part, rows, size / ratio):
            places.append(Refinement(size / ratio, at, growth, edge))
        for k in _corners(part, rows):
            places.append(Refinement(size / corner_ratio, float(part.x[k]), growth, edge))
    return replace(scene, mesh=replace(scene.mesh, refine=tuple(places)))


def _loaded_rows(record: Record) -> Ints:
    """Return the turning points of cycles 0, 1 and the last one at which the contact is loaded."""
    table = record.turning_points
    chosen = np.isin(table.cycle, (0, 1, table.cycle.max(initial=0)))
    force = np.abs(table.P).max(axis=1, initial=0.0)
    return np.flatnonzero(chosen & (force > UNLOADED * force.max(initial=0.0)))


def _zone_ends(
    scene: Scene, record: Record, rows: Ints, size: float
) -> list[float | tuple[float, float]]:
    """Return where zones end, or the ranges; those closer than two elements to another left out."""
    edge = scene.contacts[int(record.edge[0])].edge
    body, _ = scene.find_edge(edge)
    # a rectangle is graded alike on both sides of its middle
    ring = scene.axisymmetric and is_horizontal(scene, edge) and not is_cylinder(scene, body)
    mirrored = body.mesh is None and not ring
    betas = contact_betas(record)
    found: list[tuple[float, float]] = []
    for row in rows:
        for end in estimated_ends(record, int(row), betas):
            low, high = [end["value"]] * 2 if end["fitted"] else end["interval"]
            low, high = max(low, float(record.x[0])), min(high, float(record.x[-1]))
            pair = (-high, -low) if mirrored and low + high < 0.0 else (low, high)
            if all(max(abs(a - b) for a, b in zip(pair, p, strict=True)) > 2 * size for p in found):
                found.append(pair)
    return [low if low == high else (low, high) for low, high in sorted(found)]


def _corners(record: Record, rows: Ints) -> list[int]:
    """Return the ends of the contact edge, 0 or -1, that touch at one of the turning points."""
    states = record.turning_points.state[rows]
    return [k for k in record.corner_ends if np.any(states[:, k] != State.SEPARATION)]
