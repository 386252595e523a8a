"""Export of one load step to FCLIB, the HDF5 format of the Friction Contact Library.

``/fclib_local`` holds the matrix W (and V, R for a body that only the contact holds) in compressed
rows, ``vectors`` q, mu (and s), ``spacedim`` 2, and ``info``; ``/solution`` holds u, r (and l).
See https://frictionalcontactlibrary.github.io and
:mod:`receding_fenicsx.interface.gauss_seidel.compliance_form`.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import check_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.replay import state_at
from receding_fenicsx.interface.gauss_seidel import compliance_form as form
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.scene import history
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.store.hdf5 import new_hdf5, read_system
from receding_fenicsx.store.run_folder import read_run


def export(
    source: Path,
    out: Path,
    where: tuple[int, str, float] = (0, "0", 1.0),
    since: float | None = None,
    overwrite: bool = False,
) -> str:
    """Write the problem of one load step and its solution for FCLIB; return a line about it.

    Args:
        source: folder of a run, or file of a condensed system, then from rest to load factors 1.
        out: the HDF5 file.
        where: end of the step: cycle, leg ("loading", "unloading" or its number) and position s on
            the leg, in [0, 1].
        since: position s of the step's start. Default: rest on the first leg of cycle 0, else one
            load step of the scene's ``steps_per_leg`` before the end.
        overwrite: replace an existing file.

    Raises:
        InputError: run, system or instant does not exist, or the file cannot be written.
        SolveError: the step has no solution, or none was found.
    """
    check_file(out, overwrite)
    if source.is_dir():
        system, load, start, text = _step(source, where, since)
    else:
        system, start = read_system(source), None
        load = np.ones(len(system.load_names))
        text = "from rest to load factors 1"
    problem = form.step_problem(system, load, start)
    title = known_scene(system.scene_toml).title if system.scene_toml else ""
    write_fclib(out, problem, form.solve_problem(system, load, start), title, text, overwrite)
    free = problem.V.shape[1]
    return f"{text}: {len(problem.mu)} contacts, {free} rigid motion(s) left to the contact"


def _step(
    folder: Path, where: tuple[int, str, float], since: float | None
) -> tuple[ContactSystem, Array, ContactState | None, str]:
    """Return system, load at the end, state at the start and description of a step of a run."""
    scene, system, record = read_run(folder)
    path = history.history_from_scene(scene)
    cycle, name, at = where
    number = history.leg_number(path, name, cycle)
    if not 0.0 < at <= 1.0:
        raise InputError(f"--at {at:g}: must lie on the leg, 0 < s <= 1")
    first = (cycle, number) == (0, 0)
    if first and scene.history.initial_slip is not None:
        raise InputError("initial_slip: the first leg does not start from rest; use a later leg")
    if since is None:
        since = 0.0 if first else max(0.0, at - 1.0 / scene.solver.steps_per_leg)
    if not 0.0 <= since < at:
        raise InputError(f"--since {since:g}: must lie on the leg, 0 <= s < {at:g} (--at)")
    polyline = path.path if cycle == 0 else path.loop
    a, b = polyline[number], polyline[number + 1]
    start = state_at(record, system, path, scene.solver, (cycle, number, since)).state
    text = f"cycle {cycle}, leg {number}, from s = {since:g} to {at:g}"
    return system, b if at == 1.0 else (1.0 - at) * a + at * b, start, text


def write_fclib(
    path: Path,
    problem: form.StepProblem,
    solution: form.StepSolution | None = None,
    title: str = "",
    description: str = "",
    overwrite: bool = False,
) -> None:
    """Write the problem of a load step, and its solution if given."""
    free = problem.V.shape[1]
    with new_hdf5(path, overwrite) as file:
        local = file.create_group("fclib_local")
        local["spacedim"] = np.array([2], dtype=np.intc)
        _matrix(local.create_group("W"), problem.W)
        vectors = local.create_group("vectors")
        vectors["q"], vectors["mu"] = problem.q, problem.mu
        if free:
            _matrix(local.create_group("V"), problem.V)
            _matrix(local.create_group("R"), np.zeros((free, free)))
            vectors["s"] = problem.s
        info = local.create_group("info")
        meaning = "u_N gap at the end of the step, u_T slip in the step, r reactions on the body"
        about = {"title": title or "frictional contact"}
        about["description"] = description or "one load step"
        about["math_info"] = f"W symmetric, positive semi-definite; {meaning}"
        for key, text in about.items():
            info[key] = np.bytes_(text.encode("ascii", "replace"))
        info["contact_nodes"] = problem.nodes.astype(np.intc)
        if solution is not None:
            found = file.create_group("solution")
            found["u"], found["r"] = solution.u, solution.r
            if free:
                found["l"] = solution.rho


def _matrix(group: h5py.Group, matrix: Array) -> None:
    """Write a dense matrix in compressed rows."""
    rows, columns = matrix.shape
    # -2: compressed rows
    for key, value in {"nzmax": matrix.size, "m": rows, "n": columns, "nz": -2}.items():
        group[key] = np.array([value], dtype=np.intc)
    group["p"] = (columns * np.arange(rows + 1)).astype(np.intc)
    group["i"] = np.tile(np.arange(columns), rows).astype(np.intc)
    group["x"] = matrix.ravel()
