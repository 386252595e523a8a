"""Condensed systems that the cases of a study share, and the cells of a table."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store.hdf5 import read_system, write_system
from receding_fenicsx.store.workspace import locked
from receding_fenicsx.studies.run import condense

Cell = float | int | str | bool | None
"""Value in a table; None where a case has no such number."""

_systems: dict[str, ContactSystem] = {}
"""Last condensed systems of this process, by the digest of their scenes."""


def shared_system(scene: Scene, body: str, folder: Path | None = None) -> ContactSystem:
    """Return the condensed system of a case from memory, from a file, or newly condensed.

    It serves any friction. ``body`` is the scene's
    :func:`~receding_fenicsx.scene.identity.body_of`. In a folder all processes share their systems:
    the first that needs one condenses it.
    """
    if body not in _systems:
        found = _from_folder(scene, body, folder) if folder else _condensed(scene)
        while len(_systems) >= 2:  # a process keeps two
            del _systems[next(iter(_systems))]
        _systems[body] = found
    return _systems[body]


def _from_folder(scene: Scene, body: str, folder: Path) -> ContactSystem:
    """Return a system from a file, which is written first where it is missing or damaged."""
    path = folder / f"{body}.h5"
    make_folder(folder)
    with locked(path.with_suffix(".lock"), wait=True):
        if path.is_file():
            with contextlib.suppress(InputError):
                return read_system(path)
        write_system(path, _condensed(scene), overwrite=True)
    return read_system(path)


def _condensed(scene: Scene) -> ContactSystem:
    """Condense a scene on this process alone."""
    with contextlib.suppress(ImportError):
        import dolfinx_solver  # noqa: F401 - PyPI's stack must be loaded before mpi4py
    from mpi4py import MPI

    if "petsc4py.PETSc" not in sys.modules:
        import petsc4py

        # PETSc's start is collective, and the other ranks may be elsewhere
        petsc4py.init(comm=MPI.COMM_SELF)
    system = condense(scene, MPI.COMM_SELF, whole=True)
    assert system is not None
    return system


def cells_of(measured: Any, taken: Iterable[str]) -> dict[str, Cell]:
    """Return what a function of the user's has measured as plain numbers and texts.

    InputError: it is no dictionary of such, or names a column that is taken.
    """
    if not isinstance(measured, Mapping):
        raise InputError(f"measure: must return a dictionary, not a {type(measured).__name__}")
    cells: dict[str, Cell] = {}
    for name, given in measured.items():
        value = given.item() if isinstance(given, np.generic) else given
        if not isinstance(name, str) or name in taken:
            raise InputError(f"measure: {name!r} cannot be the name of a column; choose another")
        if not (value is None or isinstance(value, str | bool | int | float)):
            kind = type(value).__name__
            raise InputError(f"measure: '{name}' must be a number or a text, not a {kind}")
        cells[name] = value
    return cells
