"""Discretisation errors in space of a run's headline numbers, estimated with coarser meshes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from receding_fenicsx.accuracy.estimate import Estimate, Level, estimates_of
from receding_fenicsx.accuracy.meshes import (
    MIN_ELEMENTS,
    SEARCH_RATIO,
    elements_near,
    first_that_fits,
    is_graded,
    is_refined,
    scaled_mesh,
    to_limit,
)
from receding_fenicsx.accuracy.numbers import headline
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.scene.model import Scene

FACTORS = (2.0, 2.5, 4.0)
"""Approximate ratios of the mesh sizes. The second mesh is not nested in that of the run."""
UNRESOLVED_NODES = 2
"""Largest number of nodes of a zone that counts as not resolved."""
AT_LIMIT = 1e-9
"""Friction margin over the largest nodal force below which a stuck node is at its limit: whether it
slips is round-off. So are nodes that drift until they only touch their limit."""
NEGLIGIBLE_ZONE = 0.1
"""Width of a zone, over the mean node spacing, below which it is not counted: at a graded corner
the nodes are that close, and a zone there has no part in the numbers."""
SHARP_PRESSURE = 1.5
"""Pressure at an end of a contact edge, over the mean, from which the end is a sharp corner."""

Solve = Callable[[Scene], Record | None]
"""Goes from a scene to its record on rank 0; all ranks call it together, and it raises on all."""


def narrowest_zone(record: Record) -> int:
    """Count the nodes of the narrowest zone at turning points of cycles 0, 1 and the last.

    Stuck nodes at their friction limit are no zone of their own, nor are negligible zones.
    """
    table = record.turning_points
    rows = np.isin(table.cycle, (0, 1, table.cycle.max(initial=0)))
    P, state = table.P[rows], table.state[rows]
    margin = np.minimum(*record.friction.margins(table.Q[rows], P))
    round_off = AT_LIMIT * P.max(axis=1, initial=0.0)[:, None]
    at_limit = record.friction.present & (state == State.STICK) & (margin <= round_off)
    n, share = len(record.x), record.weight / record.weight.mean()
    narrowest = n
    for own, none in zip(state, at_limit, strict=True):
        ends = np.flatnonzero(np.diff(own[~none], prepend=-1, append=-1))
        seen = np.diff(np.append(0.0, np.cumsum(share[~none]))[ends]) > NEGLIGIBLE_ZONE
        narrowest = min(narrowest, int(np.diff(ends)[seen].min(initial=n)))
    return narrowest


def with_coarser_partner(scene: Scene) -> Scene:
    """Return a scene whose mesh can be made coarser.

    A mesh file that does not take ``contact_elements`` is refined once where it is not refined: its
    coarser partner is itself.

    Raises:
        InputError: the mesh is too coarse for an estimate.
    """
    if is_refined(scene):
        return (
            scene if scene.mesh.refinements else scaled_mesh(scene, 2 * scene.mesh.contact_elements)
        )
    if scene.mesh.contact_elements < FACTORS[0] * MIN_ELEMENTS:
        raise InputError(
            f"--error: mesh.contact_elements = {scene.mesh.contact_elements} is too coarse for an "
            f"estimate; use at least {FACTORS[0] * MIN_ELEMENTS:.0f}"
        )
    return scene


def level_of(record: Record | None, elements: int, seconds: float = 0.0) -> Level:
    """Return what a record says of its mesh; nothing on ranks without a record."""
    if record is None:
        return Level(elements, 0, seconds, {})
    resolved = narrowest_zone(record) > UNRESOLVED_NODES
    sharp = any(map(_ends_sharply, record.by_edge().values()))
    graded = record.scene is not None and is_graded(record.scene)
    return Level(elements, len(record.x), seconds, headline(record), resolved, sharp, graded)


def _ends_sharply(record: Record) -> bool:
    """Return whether a contact edge ends at a sharp corner in contact at some turning point."""
    table = record.turning_points
    ends = table.p[:, record.corner_ends].max(axis=1, initial=0.0)
    mean = table.P.sum(axis=1) / record.weight.sum()
    return bool(np.any((mean > 0.0) & (ends > SHARP_PRESSURE * mean)))


def space_errors(scene: Scene, record: Record | None, solve: Solve) -> dict[str, Estimate]:
    """Estimate the space error of each headline number; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: goes from a scene to its record on rank 0; all ranks call it together, and it raises
            on all of them.

    Returns:
        ``{name: Estimate}`` on rank 0, nothing on the others.

    Raises:
        RecedingError: the scene has no solution on the first coarser mesh.
    """
    most = scene.mesh.contact_elements
    levels = [level_of(record, most)]
    for factor in FACTORS:
        below = levels[-1].elements - 1
        limits = most / factor / SEARCH_RATIO, min(most / factor, below)
        try:
            numbers = elements_near(scene, most / factor, limits)
            # the run itself was accepted: a coarser mesh is refused for its vertices
            found = first_that_fits(
                scene, numbers, lambda coarser, _: solve(to_limit(coarser)), InputError
            )
        except RecedingError:
            if len(levels) == 1:
                raise
            break  # a mesh as coarse as this may have no solution
        if found is None:
            break
        levels.append(level_of(found[1], found[0]))
    return {} if record is None else estimates_of(levels)


def errors_of_run(scene: Scene, record: Record | None, solve: Solve) -> dict[str, Any]:
    """Return the summary's keys on space errors; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: as in :func:`space_errors`.

    Returns:
        ``{"errors": ...}``; with "errors_failure", the reason, where the scene has no answer on a
        coarser mesh, and "errors_warning" where a zone is so narrow that errors do not fall in
        order.
    """
    try:
        found = shown(space_errors(scene, record, solve))
    except RecedingError as error:
        return {"errors": {}, "errors_failure": f"on a coarser mesh: {error}"}
    return {"errors": found, **warning(record)}


def shown(estimates: dict[str, Estimate]) -> dict[str, dict[str, Any]]:
    """Return estimates for the summary: None where not known."""
    return {
        name: {
            "value": e.value if math.isfinite(e.value) else None,
            "error": e.error if math.isfinite(e.error) else None,
            "relative": e.relative if math.isfinite(e.relative) else None,
            "order": None if math.isnan(e.order) else e.order,
            "converges": e.error < math.inf if not math.isnan(e.error) else None,
            "size": e.size if math.isfinite(e.size) else None,
        }
        for name, e in estimates.items()
    }


def warning(record: Record | None) -> dict[str, str]:
    """Return the summary's warning about zones that a mesh does not resolve."""
    nodes = narrowest_zone(record) if record is not None else math.inf
    if nodes > UNRESOLVED_NODES:
        return {}
    return {
        "errors_warning": (
            f"a zone of stick, slip or separation is {nodes} node{'s' * (nodes > 1)} wide at the "
            "end of a leg: this mesh does not resolve it, and numbers that depend on it do not "
            "converge in order but in stairs; use more contact elements"
        )
    }
