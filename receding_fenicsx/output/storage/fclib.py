"""Load steps in the HDF5 layout of FCLIB, the Friction Contact Library, for other solvers.

``/fclib_local`` holds the matrix W (and V, R for a body that only the contact holds) as compressed
rows, ``vectors`` q, mu (and s), ``spacedim`` 2, and ``info``; ``/solution`` holds u, r (and l).
See https://frictionalcontactlibrary.github.io and
:mod:`receding_fenicsx.interface.gauss_seidel.compliance_form`.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from receding_fenicsx.atomic import new_hdf5
from receding_fenicsx.interface.gauss_seidel.compliance_form import StepProblem, StepSolution
from receding_fenicsx.interface.system import Array

COMPRESSED_ROWS = -2
"""What FCLIB's ``nz`` is for a matrix in compressed rows."""


def write_fclib(
    path: Path,
    problem: StepProblem,
    solution: StepSolution | None = None,
    title: str = "",
    description: str = "",
    overwrite: bool = False,
) -> None:
    """Write a step's problem, and its solution where it is known.

    Args:
        path: the file.
        problem: the step.
        solution: its solution.
        title: title of the problem.
        description: what it is.
        overwrite: replace a file that is there already.

    Raises:
        InputError: the file is there already or cannot be written.
    """
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
        about = {
            "title": title or "frictional contact",
            "description": description or "one load step",
            "math_info": "W symmetric, positive semi-definite; u_N gap at the end of the step, "
            "u_T slip in the step, r reactions on the body",
        }
        for key, text in about.items():
            info[key] = np.bytes_(text.encode("ascii", "replace"))
        info["contact_nodes"] = problem.nodes.astype(np.intc)
        if solution is not None:
            found = file.create_group("solution")
            found["u"], found["r"] = solution.u, solution.r
            if free:
                found["l"] = solution.rho


def _matrix(group: h5py.Group, matrix: Array) -> None:
    """Write a full matrix in compressed rows."""
    rows, columns = matrix.shape
    for key, value in (
        ("nzmax", matrix.size),
        ("m", rows),
        ("n", columns),
        ("nz", COMPRESSED_ROWS),
    ):
        group[key] = np.array([value], dtype=np.intc)
    group["p"] = (columns * np.arange(rows + 1)).astype(np.intc)
    group["i"] = np.tile(np.arange(columns), rows).astype(np.intc)
    group["x"] = matrix.ravel()
