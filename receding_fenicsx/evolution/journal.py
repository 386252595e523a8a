"""Journal of a run: the finished cycles, in memory and in a file from which a run is resumed.

The file grows by one block a checkpoint and is never rewritten, so its cost does not grow with the
history. A kill while a block is written leaves an incomplete tail. It is cut off when the file is
opened, and the run resumes from the checkpoint before.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from receding_fenicsx.atomic import unwritable
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.cycle_data import FinishedCycle
from receding_fenicsx.evolution.journal_format import HEAD, TITLE_BYTES, JournalFormat
from receding_fenicsx.interface.system import ContactSystem

WRITING_SHARE = 0.02
"""Largest part of the run's time spent on writing checkpoints. Where they come faster, as on small
systems, some are left out."""

FINISHED_PER_LOST_CYCLE = 10
"""Finished cycles per cycle that a kill may lose in long histories, at least: each checkpoint costs
the time of some cycles, as factors and rates are computed anew."""

JOURNAL = "journal.bin"
"""Name of the file in a run's folder."""


class Journal:
    """The finished cycles of a run, in memory.

    Attributes:
        checkpoint_cycles: cycles between two checkpoints, more in long histories; None for none.
        cycles: the finished cycles, from cycle 0.
    """

    def __init__(self, checkpoint_cycles: int | None = None) -> None:
        """Start at rest."""
        self.checkpoint_cycles = checkpoint_cycles
        self.cycles: list[FinishedCycle] = []

    def add(self, cycle: FinishedCycle) -> bool:
        """Add the next finished cycle; return whether there is a checkpoint at its end."""
        self.cycles.append(cycle)
        every = self.checkpoint_cycles
        return every is not None and is_checkpoint(len(self.cycles) - 1, every)

    def checkpoint(self) -> None:
        """Note that a run can resume from here: its solver is a new one."""

    def write(self) -> None:
        """Write all cycles up to the last checkpoint."""

    def close(self) -> None:
        """Close the file, if any."""


class JournalFile(Journal):
    """The finished cycles of a run, in memory and, up to a checkpoint, in a file."""

    def __init__(self, path: Path, system: ContactSystem, checkpoint_cycles: int) -> None:
        """Open the journal of a run and read its checkpoints, or create it.

        Args:
            path: the file; an incomplete block at its end is cut off.
            system: the condensed body.
            checkpoint_cycles: cycles between two checkpoints.

        Raises:
            InputError: it is the file of another program or of another system.
        """
        super().__init__(checkpoint_cycles)
        self.path = Path(path)
        self._format = JournalFormat(system)
        self._written = self._ready = 0
        self._cost, self._last = 0.0, -np.inf
        title = self._format.title
        try:
            whole = self._read()
            # unbuffered, so that no part of a block is written after a signal
            self._file = open(path, "ab", buffering=0)
            self._file.truncate(whole)
            if not whole:
                self._append(title)
        except OSError as error:
            raise unwritable(path, error) from None

    def checkpoint(self) -> None:
        """Write the new cycles, unless the last writing was too recent for its cost."""
        self._ready = len(self.cycles)
        if time.monotonic() - self._last >= self._cost / WRITING_SHARE:
            self.write()

    def write(self) -> None:
        """Write all cycles up to the last checkpoint.

        Raises:
            RecedingError: the disk is full, or the file cannot be written any more.
        """
        if self._ready == self._written:
            return
        begin = time.monotonic()
        block = self._format.pack(self.cycles[self._written : self._ready])
        try:
            self._append(block)
        except OSError as error:
            raise unwritable(self.path, error) from None
        self._written = self._ready
        self._last = time.monotonic()
        self._cost = self._last - begin

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _append(self, data: bytes) -> None:
        """Append data to the file, all of it or none."""
        before = os.fstat(self._file.fileno()).st_size
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except BaseException:
            self._file.truncate(before)
            raise

    def _read(self) -> int:
        """Read all complete blocks; return where they end."""
        if not self.path.exists():
            return 0
        with open(self.path, "rb") as file:
            head = file.read(TITLE_BYTES)
            if len(head) < TITLE_BYTES:
                return 0
            if head != self._format.title:
                raise InputError(
                    f"{self.path}: belongs to another system or version of this program; start the "
                    "run anew"
                )
            end = TITLE_BYTES
            while block := self._format.unpack(file):
                self.cycles += block
                end = file.tell()
        self._written = self._ready = len(self.cycles)
        return end


def is_checkpoint(cycle: int, every: int) -> bool:
    """Return whether there is a checkpoint at the end of a cycle, by its number alone.

    Checkpoints are ``every`` cycles apart at first. The spacing doubles with each doubling of the
    cycles beyond ``FINISHED_PER_LOST_CYCLE * every``.

    Args:
        cycle: number of the cycle, 0 for the first loading.
        every: cycles between two checkpoints at the beginning.
    """
    doublings = max(0, (cycle // (FINISHED_PER_LOST_CYCLE * every)).bit_length() - 1)
    return cycle % (every << doublings) == 0


def has_checkpoint(path: Path) -> bool:
    """Return whether a journal may hold a checkpoint."""
    return path.is_file() and path.stat().st_size > TITLE_BYTES + HEAD.itemsize
