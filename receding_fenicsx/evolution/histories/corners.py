"""Number of corners of a harmonic history, by doubling them and comparing the dissipation.

The condensed system stays; only the history is evolved anew. The deviation of the polygon from the
ellipse falls with the square of the number of corners n, and on average so does the error of the
dissipation D: each doubling divides it by 4, unevenly, as zones move from node to node. The error
estimate of a polygon is

    max(|D_n - D_n/2|, |D_n/2 - D_n/4| / 4) / max D,

over the first cycles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.cycle_data import FinishedCycle
from receding_fenicsx.evolution.histories.tightening import tightened
from receding_fenicsx.evolution.problem import Problem, problem_of_scene
from receding_fenicsx.evolution.run_state import RunState
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import ended_by, history_from_scene
from receding_fenicsx.scene.history.harmonic import DEFAULT_TOLERANCE, MOST_CORNERS, is_straight
from receding_fenicsx.scene.model import OutputOptions, Scene

COMPARED_CYCLES = 3
"""Largest number of first cycles whose dissipation is compared."""
SMALLEST_DISSIPATION = 1e-9
"""Dissipation of a cycle, over the largest energy of a leg, that counts as none."""

CORNERS = "corners.txt"
"""Name of the file in a run's folder that holds the polygons of a harmonic history."""


def with_corners(
    system: ContactSystem, scene: Scene, say: Callable[[str], None] | None = None
) -> tuple[Scene, Array | None]:
    """Return a scene with the number of corners that its harmonic history needs, bolts tightened.

    The corners are doubled until the error estimate of the dissipation meets the tolerance.

    Args:
        system: the condensed body.
        scene: a scene; one without a harmonic history, with a fixed number of corners, or with all
            loads in phase (where two corners are exact) is returned as it is.
        say: called with the progress.

    Returns:
        The scene with ``history.corners``, and a row for each polygon: (k, 2) its corners and its
        error estimate, NaN in the first two rows. None where nothing was doubled. Where a polygon
        cannot be followed to its end, the scene with that polygon.

    Raises:
        SolveError: the largest number of corners does not meet the tolerance.
    """
    scene, options = tightened(system, scene), scene.history
    if options.kind != "harmonic" or options.corners is not None or is_straight(options):
        return scene, None
    tolerance = options.tolerance or DEFAULT_TOLERANCE
    problem = problem_of_scene(system, scene)
    corners = len(problem.history.loop) - 1
    rows: list[tuple[float, float]] = []
    before, change = np.empty(0), math.nan
    while True:
        refined = replace(scene, history=replace(options, corners=corners))
        try:
            D, energy = _dissipation(problem, refined)
        except SolveError:
            # the run of this polygon fails in the same place, and keeps its record
            return refined, np.array([*rows, (corners, math.nan)])
        tiny = float(np.finfo(float).tiny)
        scale = max(float(D.max()), SMALLEST_DISSIPATION * energy, tiny)
        last, change = change, float(np.abs(D - before).max()) / scale if rows else math.nan
        error = float(np.maximum(change, 0.25 * last))  # NaN up to the third polygon
        rows.append((corners, error))
        if say is not None:
            words = "" if math.isnan(error) else f", error estimate {error:.1e}"
            say(f"harmonic: {corners} corners{words}")
        if error <= tolerance:
            return refined, np.array(rows)
        if 2 * corners > MOST_CORNERS:
            raise SolveError(
                f"[history] tolerance: with {corners} corners the error estimate of the "
                f"dissipation is {error:.1e}, above {tolerance:g}; enlarge it, or fix corners"
            )
        before, corners = D, 2 * corners


def _dissipation(problem: Problem, scene: Scene) -> tuple[Array, float]:
    """Return the dissipation of the first cycles, and the largest energy of a leg."""
    cycles = min(scene.history.cycles, COMPARED_CYCLES)
    history = replace(ended_by(history_from_scene(scene), None), cycles=cycles)
    bare = OutputOptions(samples_per_leg=1, cycles=())
    finished: list[FinishedCycle] = []
    run = RunState(replace(problem, history=history, output=bare, judged=False), finished)
    for number in range(cycles + 1):
        finished.append(run.trace_cycle(number))
    D = np.array([cycle.dissipation.sum() for cycle in finished[1:]])
    return D, finished[-1].totals.energy_scale
