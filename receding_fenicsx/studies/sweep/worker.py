"""One case of a sweep: condense its body, unless that was done, evolve it and take its numbers."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import OutputOptions, Scene
from receding_fenicsx.store.hdf5 import read_system, write_system
from receding_fenicsx.store.workspace import locked
from receding_fenicsx.studies.run import condense
from receding_fenicsx.studies.sweep.measure import Cell, cells_of, measure_record

Measure = Callable[[Record], Mapping[str, Any]]
"""Function that takes the numbers of a case from its record."""

LEAST_OUTPUT = OutputOptions(samples_per_leg=1, cycles=())
"""Turning points only: enough for the columns of :func:`measure_record`."""
KEPT_SYSTEMS = 2
"""Condensed systems that a process keeps in memory."""
_systems: dict[str, ContactSystem] = {}
"""Last condensed systems of this process, by the digest of their scenes."""


@dataclass(frozen=True)
class Task:
    """Case to be played, by any process.

    Attributes:
        scene: its scene.
        body: digest of what determines its condensed system.
        systems: folder that all processes share their condensed systems in, or None.
        measure: function that takes the numbers of a record, or None for the default ones.
        taken: names of columns that the table has already.
    """

    scene: Scene
    body: str
    systems: Path | None = None
    measure: Measure | None = None
    taken: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """Result of a case.

    Attributes:
        cells: its numbers by the names of their columns; none where it failed.
        error: why it failed, "" where it did not.
        final: whether the case would fail again; False after a lack of memory or room, say.
    """

    cells: dict[str, Cell]
    error: str = ""
    final: bool = True


def play(task: Task) -> Outcome:
    """Play one case; an error is its outcome."""
    try:
        system, scene = _system_of(task), task.scene
        if task.measure is None:
            scene = replace(
                scene,
                output=replace(LEAST_OUTPUT, checkpoint_cycles=scene.output.checkpoint_cycles),
            )
        record = evolve(system, scene)
        return Outcome(cells_of((task.measure or measure_record)(record), task.taken))
    except (InputError, SolveError) as error:
        return Outcome({}, str(error).replace("\n", " "))
    except Exception as error:
        text = f"{type(error).__name__}: {error}".replace("\n", " ")
        return Outcome({}, text, final=False)


def _system_of(task: Task) -> ContactSystem:
    """Return the condensed system of a case from memory, from a file, or newly condensed."""
    key = task.body
    if key not in _systems:
        found = _condensed(task.scene) if task.systems is None else _shared(task)
        while len(_systems) >= KEPT_SYSTEMS:
            del _systems[next(iter(_systems))]
        _systems[key] = found
    return _systems[key]


def _shared(task: Task) -> ContactSystem:
    """Return a system from the shared folder; the first process that needs it condenses it."""
    assert task.systems is not None
    path = task.systems / f"{task.body}.h5"
    make_folder(task.systems)
    with locked(path.with_suffix(".lock"), wait=True):
        if path.is_file():
            with contextlib.suppress(InputError):  # a damaged file is replaced
                return read_system(path)
        system = _condensed(task.scene)
        write_system(path, system, overwrite=True)
    return read_system(path)


def _condensed(scene: Scene) -> ContactSystem:
    """Condense a scene on this process alone; the system serves any friction."""
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
