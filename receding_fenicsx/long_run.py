"""Evolution with a journal: progress, records of interrupted runs, resuming from checkpoints."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.evolve import continue_history
from receding_fenicsx.evolution.histories import CORNERS, tightened, with_corners
from receding_fenicsx.evolution.journal import JOURNAL, Journal, JournalFile
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report import summary
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.store import hdf5, summary_file
from receding_fenicsx.store.workspace import interruption
from receding_fenicsx.timing import Countdown

if TYPE_CHECKING:
    from receding_fenicsx.interface.system import ContactSystem

log = logging.getLogger(__name__)


def run_history(
    scene: Scene,
    system: ContactSystem,
    folder: Path | None,
    say: Callable[[str], None] | None = None,
) -> tuple[Record, SolveError | None]:
    """Evolve a scene's history, from the last checkpoint in the folder if there is one.

    Args:
        scene: the scene.
        system: its condensed system.
        folder: folder of the journal; None keeps no journal.
        say: called with the progress.

    Returns:
        The record, and the error that ended the history early if one did. The scene of the record
        has the number of corners of a harmonic history.

    Raises:
        Interrupted: a signal asked to end. The folder holds the record of the finished cycles.
        SolveError: the history failed in its very first leg.
    """
    every = scene.output.checkpoint_cycles
    journal: Journal = Journal(every)
    if folder is not None:
        journal = JournalFile(folder / JOURNAL, system, every)
        if journal.cycles:
            log.info("resumes from the checkpoint after cycle %d", len(journal.cycles) - 1)
    doubling = None
    tell = Countdown(say, "evolve: cycle", "at most")

    def progress(cycle: int, cycles: int, message: str) -> None:
        log.info("cycle %d: %s", cycle, message)
        # the terminal has one line for the counts and the time
        tell(cycle, cycles, message.partition(",")[0])

    try:
        scene, doubling = _with_corners(scene, system, folder, say)
        record = continue_history(problem_of_scene(system, scene), journal, progress)
        record.doubling = doubling
        return record, None
    except SolveError as error:
        # a history that fails in its very first leg leaves nothing worth keeping
        if not isinstance(error.record, Record) or not len(error.record.turning_points.s):
            raise
        record, error.record = error.record, None
        record.doubling = doubling
        return record, error
    except (KeyboardInterrupt, SystemExit) as signalled:
        if folder is None or not journal.cycles:
            raise
        last, cycles = len(journal.cycles) - 1, history.history_from_scene(scene).cycles
        where = f"after cycle {last} of {cycles}"
        journal.write()
        record = record_of(system, scene.solver, journal.cycles)
        hdf5.write_record(folder / "record.h5", record, overwrite=True)
        brief = summary.summarise(record, {"failure": f"interrupted {where}"})
        summary_file.write_summary(folder / "summary.json", brief, overwrite=True)
        raise interruption(signalled, where, folder, "the record up to there") from None
    finally:
        journal.write()
        journal.close()


def _with_corners(
    scene: Scene,
    system: ContactSystem,
    folder: Path | None,
    say: Callable[[str], None] | None,
) -> tuple[Scene, Array | None]:
    """Return the scene with the corners of its harmonic history, those of the run it resumes."""
    scene = tightened(system, scene)
    file = None if folder is None else folder / CORNERS
    if file is not None and file.is_file():
        try:
            doubling = np.loadtxt(file, ndmin=2)
            corners = int(doubling[-1, 0])
        except (OSError, ValueError, IndexError):
            raise InputError(f"{file}: is damaged; start a new run with --overwrite") from None
        return replace(scene, history=replace(scene.history, corners=corners)), doubling
    scene, found = with_corners(system, scene, say)
    if file is not None and found is not None:
        with new_file(file) as beside:
            np.savetxt(beside, found, header="corners, error estimate of the dissipation")
    return scene, found
