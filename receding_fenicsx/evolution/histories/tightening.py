"""Shortenings of bolts that give their preloads.

Each bolt has a tightening leg. At its end the bolt has its preload; those that are tightened later
carry nothing, as if they were not fitted yet; those that were tightened before keep their length,
and their forces follow. The contact's path is piecewise linear in the shortenings s, so Newton's
method for the forces at the end of a leg, F(s) = F_wanted, ends after a few paths.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NotConverged
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.cycle_data import FinishedCycle
from receding_fenicsx.evolution.problem import Problem, problem_of_scene
from receding_fenicsx.evolution.run_state import RunState
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.history.kinds import preload_legs
from receding_fenicsx.scene.model import OutputOptions, Scene

FORCE_TOLERANCE = 1e-10
"""Largest error of a bolt's force over the largest preload."""
DIFFERENCE = 1e-6
"""Difference of a shortening, over that of a stuck joint, by which slopes of forces are found."""
MOST_STEPS = 30


def tightened(system: ContactSystem, scene: Scene) -> Scene:
    """Return a scene whose bolts with preloads have the shortenings that give them.

    Args:
        system: the condensed body.
        scene: the scene; one without such bolts, or with shortenings, is returned as it is.

    Raises:
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
    shortened = []
    for bolt in scene.bolts:
        s = path[1:, names.index(bolt.name)].tolist()
        found = replace(bolt, shortening=s[-1], tightening=tuple(s))
        shortened.append(bolt if bolt.preload is None else found)
    return replace(scene, bolts=tuple(shortened))


def _shortenings(
    problem: Problem, path: Array, at: list[int], wanted: Array, scale: float
) -> Array:
    """Return the shortenings for which bolts have given forces at the end of a path.

    Args:
        problem: the system.
        path: rows of load factors; the shortenings of the last row are found.
        at: numbers of the bolts' load factors.
        wanted: their forces.
        scale: the largest preload.
    """

    def forces(s: Array) -> Array:
        rows = path.copy()
        rows[-1, at] = s
        history = History(problem.system.load_names, rows, np.zeros((0, path.shape[1])))
        bare = replace(problem, history=history, output=OutputOptions(1, ()), judged=False)
        cycles: list[FinishedCycle] = []
        cycles.append(RunState(bare, cycles).trace_cycle(0))
        record = record_of(bare.system, bare.solver, cycles)
        return record.turning_points.load_displacement[-1, at]

    soft = np.linalg.inv(problem.system.load_compliance[np.ix_(at, at)])
    s, step = path[-2, at] + soft @ wanted, DIFFERENCE * scale * np.abs(soft).max()
    error = wanted
    for _ in range(MOST_STEPS):
        found = forces(s)
        error = wanted - found
        if np.abs(error).max() <= FORCE_TOLERANCE * scale:
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
