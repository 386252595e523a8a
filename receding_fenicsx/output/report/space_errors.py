"""Discretisation errors in space of a run's headline numbers, estimated with coarser meshes.

Every size of the mesh is enlarged by the same factors: fewer contact elements, and a growth whose
distance from 1 is larger in proportion (the mesh size is dx + (growth - 1) depth). With numbers
a_0 of the run and a_1, a_2, ... of meshes coarser by r_1 < r_2 < ... (r_0 = 1) the error of a_0 is
taken to be

    e = max |a_i - a_j| / (r_j - r_i)  over the pairs of which one is twice as coarse as the other.

For errors of first order in the mesh size each pair gives the error of a_0; for higher orders it
gives more. The largest value is taken because numbers may agree on two meshes by chance, or stay
constant over several meshes until a narrow zone is resolved. Estimates of higher order would miss
such steps. Meshes of nearly the same size are not compared: they differ by noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.axis import begins_on_axis, on_axis
from receding_fenicsx.output.report.half_widths import contact_betas, estimates
from receding_fenicsx.scene.model import Scene

FACTORS = (2.0, 2.5, 4.0)
"""Approximate ratios of the mesh sizes. The second mesh is not nested in that of the run."""

MIN_RATIO = 1.8
"""Smallest ratio of the sizes of two meshes that are compared."""

MIN_RELATIVE_ERROR = 1e-6
"""Smallest relative error that is returned."""

UNRESOLVED_NODES = 2
"""Largest number of nodes of a zone that counts as not resolved."""

MIN_ELEMENTS = 8
"""Smallest number of contact elements of a coarser mesh."""

SEARCH_RATIO = 1.6
"""Largest ratio to the wanted mesh size in the search for a mesh whose vertices fit the scene."""

LARGEST_GROWTH = 3.0
"""Largest growth of a coarser mesh."""

NAMES = {
    "centre_pressure": "centre pressure at the maximum",
    "contact_half_width": "contact half-width at the maximum",
    "stick_half_width": "stick half-width at the maximum",
    "dissipation_first_cycle": "dissipation of cycle 1",
    "dissipation_ratio": "dissipation of the last cycle over cycle 1",
}
"""Headline numbers and their descriptions."""
WIDTHS = ("contact_half_width", "stick_half_width")


@dataclass(frozen=True)
class Number:
    """A headline number and its uncertainty on its own mesh."""

    value: float
    known_to: float = 0.0


def headline(record: Record) -> dict[str, Number]:
    """Return the headline numbers that a record has.

    The maximum is the end of cycle 0. The centre pressure is that on the axis, extrapolated, if the
    contact edge begins there, else that at the middle of the edge. Half-widths are the fitted ones,
    with half their interval as uncertainty.
    """
    table = record.turning_points
    first = np.flatnonzero(table.cycle == 0)
    if not len(first):
        return {}
    row, x = int(first[-1]), record.x
    if record.axisymmetric and begins_on_axis(x):
        centre = float(on_axis(x, table.p[row]))
    else:
        centre = float(np.interp(0.5 * (x[0] + x[-1]), x, table.p[row]))
    found = {"centre_pressure": Number(centre)}
    widths = estimates(record, row, contact_betas(record))
    for name in WIDTHS:
        width = widths[f"{name}_estimate"]
        if width is not None:
            low, high = width["interval"]
            found[name] = Number(width["value"], 0.5 * (high - low))
    D = record.cycles.dissipation
    if record.dissipates:
        found["dissipation_first_cycle"] = Number(float(D[0]))
        found["dissipation_ratio"] = Number(float(D[-1] / D[0]))
    return found


def narrowest_zone(record: Record) -> int:
    """Count the nodes of the narrowest zone at turning points of cycles 0, 1 and the last."""
    table = record.turning_points
    rows = np.isin(table.cycle, (0, 1, table.cycle.max(initial=0)))
    ends = (np.flatnonzero(np.diff(state, prepend=-1, append=-1)) for state in table.state[rows])
    return min((int(np.diff(at).min()) for at in ends), default=len(record.x))


def check(scene: Scene) -> None:
    """Raise InputError where a scene's mesh cannot be made coarser."""
    if any(body.mesh is not None for body in scene.bodies):
        raise InputError(
            "--error: a mesh from a file cannot be made coarser; omit --error, or compare runs on "
            "meshes of your own"
        )
    if len(scene.contacts) > 1:
        raise InputError("--error: a scene of several contact edges has no headline numbers yet")
    if scene.mesh.contact_elements < FACTORS[0] * MIN_ELEMENTS:
        raise InputError(
            f"--error: mesh.contact_elements = {scene.mesh.contact_elements} is too coarse for an "
            f"estimate; use at least {FACTORS[0] * MIN_ELEMENTS:.0f}"
        )


def coarser(scene: Scene, elements: int) -> Scene:
    """Return the scene on a mesh of so many contact elements, all sizes enlarged alike."""
    factor = scene.mesh.contact_elements / elements
    growth = min(1.0 + factor * (scene.mesh.growth - 1.0), LARGEST_GROWTH)
    refine = tuple(
        replace(
            place,
            size=factor * place.size,
            growth=place.growth and min(1.0 + factor * (place.growth - 1.0), LARGEST_GROWTH),
        )
        for place in scene.mesh.refine
    )
    mesh = replace(scene.mesh, contact_elements=elements, growth=growth, refine=refine)
    return replace(scene, mesh=mesh)


def space_errors(
    scene: Scene, record: Record | None, solve: Callable[[Scene], Record | None]
) -> dict[str, dict[str, float]]:
    """Estimate the space error of each headline number; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: goes from a scene to its record on rank 0; all ranks call it together, and it raises
            on all of them.

    Returns:
        ``{name: {"value", "error"}}`` on rank 0, nothing on the others.

    Raises:
        RecedingError: the scene has no solution on the first coarser mesh.
    """
    most = elements = scene.mesh.contact_elements
    levels: list[tuple[float, dict[str, Number]]] = []
    for wanted in FACTORS:
        try:
            solved = _solve_coarser(scene, wanted, elements, solve)
        except RecedingError:
            if not levels:
                raise
            break  # a mesh as coarse as this may have no solution
        if solved is None:
            break
        elements, coarser_record = solved
        found = headline(coarser_record) if coarser_record is not None else {}
        levels.append((most / elements, found))
    if record is None:
        return {}
    errors = {}
    for name, number in headline(record).items():
        coarse = [(factor, found[name].value) for factor, found in levels if name in found]
        least = max(number.known_to, MIN_RELATIVE_ERROR * abs(number.value))
        errors[name] = {"value": number.value, "error": max(estimate(number.value, coarse), least)}
    return errors


def errors_of_run(
    scene: Scene, record: Record | None, solve: Callable[[Scene], Record | None]
) -> dict[str, Any]:
    """Return the summary's keys on space errors; collective.

    Args:
        scene: the scene of the run.
        record: its record on rank 0, None on the others.
        solve: as in :func:`space_errors`.

    Returns:
        ``{"errors": ...}`` as of :func:`space_errors`; with "errors_failure", the reason, where the
        scene has no answer on a coarser mesh, and "errors_warning" where a zone is so narrow that
        errors do not fall in order.
    """
    try:
        found: dict[str, Any] = {"errors": space_errors(scene, record, solve)}
    except RecedingError as error:
        return {"errors": {}, "errors_failure": f"on a coarser mesh: {error}"}
    nodes = narrowest_zone(record) if record is not None else math.inf
    if nodes <= UNRESOLVED_NODES:
        found["errors_warning"] = (
            f"a zone of stick, slip or separation is {nodes} node{'s' * (nodes > 1)} wide at the "
            "end of a leg: this mesh does not resolve it, and numbers that depend on it do not "
            "converge in order but in stairs; use more contact elements"
        )
    return found


def estimate(value: float, coarse: Sequence[tuple[float, float]]) -> float:
    """Return the estimated error of ``value``; NaN when nothing is known of coarser meshes.

    Args:
        value: a_0.
        coarse: (r_k, a_k) of coarser meshes, r_k increasing from above 1.
    """
    pairs = combinations([(1.0, value), *coarse], 2)
    slopes = [abs(a - b) / (s - r) for (r, a), (s, b) in pairs if s >= MIN_RATIO * r]
    return max(slopes, default=math.nan)


def _solve_coarser(
    scene: Scene, wanted: float, below: int, solve: Callable[[Scene], Record | None]
) -> tuple[int, Record | None] | None:
    """Solve on the finest mesh, at least ``wanted`` times coarser, whose vertices fit the scene.

    Returns:
        Its contact elements, fewer than ``below``, and the record; None where no mesh is left.
    """
    most = scene.mesh.contact_elements
    for elements in range(min(int(most / wanted), below - 1) // 2 * 2, 0, -2):
        if elements < max(MIN_ELEMENTS, most / wanted / SEARCH_RATIO):
            return None
        try:
            return elements, solve(coarser(scene, elements))
        except InputError:
            continue  # loads or supports need a vertex where this mesh has none
    return None
