"""Evolution with a journal: progress, a record that survives signals, going on from checkpoints."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from receding_fenicsx.errors import Interrupted, SolveError
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.journal import JOURNAL, Journal, JournalFile
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.report import summary
from receding_fenicsx.output.storage import hdf5, summary_file
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Scene

if TYPE_CHECKING:
    from receding_fenicsx.interface.system import ContactSystem

log = logging.getLogger(__name__)

INTERRUPTED = 130
"""Exit code after Ctrl-C, 128 + SIGINT."""
PACE_CYCLES = 20
"""Cycles that the time left is estimated from."""


def run_history(
    scene: Scene,
    system: ContactSystem,
    folder: Path | None,
    say: Callable[[str], None] | None = None,
) -> tuple[Record, SolveError | None]:
    """Evolve a scene's history, going on from the folder's last checkpoint if it has one.

    Args:
        scene: the scene.
        system: its condensed system.
        folder: where the run lives; None keeps nothing.
        say: told how far it is.

    Returns:
        The record, and the error that ended the history early if one did.

    Raises:
        Interrupted: a signal asked to end. The folder holds the record of the finished cycles.
        SolveError: the history failed in its very first leg.
    """
    every = scene.output.checkpoint_cycles
    journal: Journal = Journal(every)
    if folder is not None:
        journal = JournalFile(folder / JOURNAL, system, every)
        if journal.passed:
            log.info("goes on from the checkpoint after cycle %d", len(journal.passed) - 1)
    try:
        record = evolve(system, scene, progress=_Pace(say), journal=journal)
    except SolveError as error:
        # nothing of a history that fails at its very first load is worth keeping
        if not isinstance(error.record, Record) or not len(error.record.turning_points.s):
            raise
        record, error.record = error.record, None
        return record, error
    except (KeyboardInterrupt, SystemExit) as signalled:
        done = len(journal.passed) - 1
        if folder is None or done < 0:
            raise
        code = signalled.code if isinstance(signalled, SystemExit) else INTERRUPTED
        text = f"interrupted after cycle {done} of {history.from_scene(scene).cycles}"
        journal.write()
        record = record_of(system, scene.solver, journal.passed)
        hdf5.write_record(folder / "record.h5", record, overwrite=True)
        brief = summary.summarise(record, {"failure": text})
        summary_file.write_summary(folder / "summary.json", brief, overwrite=True)
        raise Interrupted(
            f"{text}; {folder} holds the record up to there, --resume goes on", int(code or 1)
        ) from None
    finally:
        journal.write()
        journal.close()
    return record, None


class _Pace:
    """Says and logs how far the evolution is, and how long the rest may take."""

    def __init__(self, say: Callable[[str], None] | None) -> None:
        self.say = say
        self.times = deque([time.monotonic()], maxlen=PACE_CYCLES + 1)

    def __call__(self, cycle: int, cycles: int, message: str) -> None:
        """Take note of a finished cycle."""
        self.times.append(time.monotonic())
        log.info("cycle %d of %d: %s", cycle, cycles, message)
        if self.say is None:
            return
        a_cycle = (self.times[-1] - self.times[0]) / (len(self.times) - 1)
        left = duration(a_cycle * (cycles - cycle))
        # the terminal's one line holds the counts and the time; the rest is logged
        events = message.partition(",")[0]
        self.say(f"evolve: cycle {cycle} of {cycles}, {events}, {left} left at most")


def duration(seconds: float) -> str:
    """Return a duration in the unit that suits it."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
