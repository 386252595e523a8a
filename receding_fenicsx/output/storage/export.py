"""A load step of a run, or of a condensed system, exported for other solvers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from receding_fenicsx.atomic import check_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.replay import state_at
from receding_fenicsx.interface.gauss_seidel.compliance_form import solve_problem, step_problem
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem
from receding_fenicsx.output.storage.fclib import write_fclib
from receding_fenicsx.output.storage.hdf5 import read_record, read_system
from receding_fenicsx.scene import history
from receding_fenicsx.scene.toml_file import from_toml


def export(
    source: Path,
    out: Path,
    where: tuple[int, str, float] = (0, "0", 1.0),
    since: float | None = None,
    overwrite: bool = False,
) -> str:
    """Write a step's problem and this program's solution of it in FCLIB's layout.

    Args:
        source: folder of a run, or file of a condensed system; of a system it is the step from rest
            to load factors 1.
        out: the HDF5 file.
        where: cycle, leg ("loading", "unloading" or its number) and place on it, in [0, 1], of the
            end of the step.
        since: place on the leg of its start; a load step of the scene's ``steps_per_leg`` before
            its end when left out, rest for the first leg of all.
        overwrite: replace a file that is there already.

    Returns:
        What was exported, in a line.

    Raises:
        InputError: there is no such run, system or instant, or the file cannot be written.
        SolveError: the step could not be solved.
    """
    check_file(out, overwrite)
    if source.is_dir():
        system, load, start, text = _step(source, where, since)
    else:
        system, start = read_system(source), None
        load = np.ones(len(system.load_names))
        text = "from rest to load factors 1"
    problem, solution = step_problem(system, load, start), solve_problem(system, load, start)
    title = from_toml(system.scene_toml).title if system.scene_toml else ""
    write_fclib(out, problem, solution, title, text, overwrite)
    free = problem.V.shape[1]
    return f"{text}: {len(problem.mu)} contacts, {free} rigid motion(s) left to the contact"


def _step(
    folder: Path, where: tuple[int, str, float], since: float | None
) -> tuple[ContactSystem, Array, ContactState | None, str]:
    """Return system, load at the end, state at the start and a description of a run's step."""
    record = read_record(folder / "record.h5")
    scene = from_toml(record.scene_toml)
    system = read_system(folder / "system.h5", scene)
    path = history.from_scene(scene)
    cycle, name, at = where
    number = history.leg_number(path, name, cycle)
    if not 0.0 < at <= 1.0:
        raise InputError(f"--at {at:g}: the end of a step lies above 0 and up to 1 on its leg")
    first = (cycle, number) == (0, 0)
    if first and scene.history.initial_slip is not None:
        raise InputError("the first leg of a history with initial_slip is no step from rest")
    if since is None:
        since = 0.0 if first else max(0.0, at - 1.0 / scene.solver.steps_per_leg)
    if not 0.0 <= since < at:
        raise InputError(f"--since {since:g}: a step starts on its leg, before its end at {at:g}")
    polyline = path.path if cycle == 0 else path.loop
    a, b = polyline[number], polyline[number + 1]
    start = state_at(record, system, path, scene.solver, (cycle, number, since)).state
    text = f"cycle {cycle}, leg {number}, from s = {since:g} to {at:g}"
    return system, b if at == 1.0 else (1.0 - at) * a + at * b, start, text
