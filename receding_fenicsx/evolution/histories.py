"""Histories that depend on the condensed system: corners of harmonic ones, tightened bolts.

**Corners.** The condensed system stays; only the history is evolved anew. The deviation of the
polygon from the ellipse falls with the square of the number of corners n, and on average so does
the error of the dissipation D: each doubling divides it by 4, unevenly, as zones move from node to
node. The error estimate of a polygon is

    max(|D_n - D_n/2|, |D_n/2 - D_n/4| / 4) / max D,

over the first cycles.

**Bolts.** Each bolt has a tightening leg. At its end the bolt has its preload; those that are
tightened later carry nothing, as if they were not fitted yet; those that were tightened before keep
their length, and their forces follow. The contact's path is piecewise linear in the shortenings s,
so Newton's method for the forces at the end of a leg, F(s) = F_wanted, ends after a few paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NotConverged, SolveError
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.problem import Problem, problem_of_scene
from receding_fenicsx.evolution.run_state import first_cycles
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import (
    MOST_CORNERS,
    History,
    ended_by,
    history_from_scene,
    is_straight,
    preload_legs,
)
from receding_fenicsx.scene.model import Scene

CORNERS = "corners.txt"
"""Name of the file in a run's folder that holds the polygons of a harmonic history."""


def with_corners(
    system: ContactSystem, scene: Scene, say: Callable[[str], None] | None = None
) -> tuple[Scene, Array | None]:
    """Return a scene with the number of corners that its harmonic history needs, bolts tightened.

    The corners are doubled until the error estimate of the dissipation meets the tolerance;
    SolveError where the largest number does not. A scene with a fixed number of corners, or with
    all loads in phase (where two are exact), is returned as it is. Where a polygon cannot be
    followed to its end, the scene has that polygon. With the scene comes a row (k, 2) for each
    polygon, its corners and error estimate, NaN in the first two; None where nothing was doubled.
    """
    scene, options = tightened(system, scene), scene.history
    if options.kind != "harmonic" or options.corners is not None or is_straight(options):
        return scene, None
    tolerance = options.tolerance or 1e-3
    problem = problem_of_scene(system, scene)
    corners = len(problem.history.loop) - 1
    rows: list[tuple[float, float]] = []
    before, change = np.empty(0), math.nan
    while True:
        refined = replace(scene, history=replace(options, corners=corners))
        try:
            # the first cycles are compared, three at most
            whole, last = ended_by(history_from_scene(refined), None), min(options.cycles, 3)
            finished = first_cycles(problem, replace(whole, cycles=last), last)
        except SolveError:
            # the run of this polygon fails in the same place, and keeps its record
            return refined, np.array([*rows, (corners, math.nan)])
        D = np.array([cycle.dissipation.sum() for cycle in finished[1:]])
        # dissipation of a cycle, over the largest energy of a leg, that counts as none
        energy = 1e-9 * finished[-1].totals.energy_scale
        scale = max(float(D.max()), energy, float(np.finfo(float).tiny))
        earlier, change = change, float(np.abs(D - before).max()) / scale if rows else math.nan
        error = float(np.maximum(change, 0.25 * earlier))  # NaN up to the third polygon
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


def tightened(system: ContactSystem, scene: Scene) -> Scene:
    """Return a scene whose bolts with preloads have the shortenings that give them.

    SolveError: there is no equilibrium on the way, or Newton's method does not converge.
    """
    names = scene.load_names
    free = [bolt for bolt in scene.bolts if bolt.shortening is None]
    if not free:
        return scene
    bolts = tuple(replace(b, preload=None, shortening=b.shortening or 1.0) for b in scene.bolts)
    problem = problem_of_scene(system, replace(scene, bolts=bolts))
    scale = max(bolt.preload or 0.0 for bolt in free)
    path = np.zeros((1, len(names)))
    for leg in preload_legs(scene):
        path = np.vstack([path, path[-1]])
        path[-1, names.index(leg)] += scene.preloads[leg]
        wanted = [bolt.preload or 0.0 if bolt.name == leg else 0.0 for bolt in free]
        at = [names.index(bolt.name) for bolt in free]
        if free:
            path[-1, at] = _shortenings(problem, path, at, np.array(wanted), scale)
        free = [bolt for bolt in free if bolt.name != leg]
    ways = [tuple(path[1:, names.index(bolt.name)].tolist()) for bolt in scene.bolts]
    shortened = tuple(
        bolt if bolt.preload is None else replace(bolt, shortening=s[-1], tightening=s)
        for bolt, s in zip(scene.bolts, ways, strict=True)
    )
    return replace(scene, bolts=shortened)


def _shortenings(
    problem: Problem, path: Array, at: list[int], wanted: Array, scale: float
) -> Array:
    """Return the shortenings for which bolts have given forces at the end of a path."""

    def forces(s: Array) -> Array:
        rows = path.copy()
        rows[-1, at] = s
        history = History(problem.system.load_names, rows, np.zeros((0, path.shape[1])))
        record = record_of(problem.system, problem.solver, first_cycles(problem, history, 0))
        return record.turning_points.load_displacement[-1, at]

    soft = np.linalg.inv(problem.system.load_compliance[np.ix_(at, at)])
    # difference of a shortening, over that of a stuck joint, by which slopes of forces are found
    s, step = path[-2, at] + soft @ wanted, 1e-6 * scale * np.abs(soft).max()
    error = wanted
    for _ in range(30):
        found = forces(s)
        error = wanted - found
        # largest error of a bolt's force over the largest preload
        if np.abs(error).max() <= 1e-10 * scale:
            return s
        columns = [(forces(s + step * unit) - found) / step for unit in np.eye(len(at))]
        try:
            s = s + np.linalg.solve(np.array(columns).T, error)
        except np.linalg.LinAlgError:
            # parts that nothing else holds float until they touch
            break
    raise NotConverged(
        f"bolt '{problem.system.load_names[at[0]]}': the shortening for its preload was not found, "
        f"the force is off by {np.abs(error).max():.1e}; give the shortening instead, or hold "
        "parts with a gap"
    )
