"""Journal of a run: the finished cycles, in memory and in a file from which a run is resumed.

The file grows by one block a checkpoint and is never rewritten, so its cost does not grow with the
history. A kill while a block is written leaves an incomplete tail. It is cut off when the file is
opened, and the run resumes from the checkpoint before.

The file begins with a title: its kind, its format version, and the numbers of nodes and loads. Each
block is a head (counts and a checksum) and three tables of fixed rows: cycles, instants (ends of
legs, then samples, of each cycle) and events.
"""

from __future__ import annotations

import dataclasses
import os
import time
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.atomic import unwritable
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.instants import (
    FinishedCycle,
    Instant,
    Samples,
    Totals,
    event_rows,
    events_of,
)
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.uniqueness.watch import Uniqueness

WRITING_SHARE = 0.02
"""Largest part of the run's time spent on writing checkpoints. Where they come faster, as on small
systems, some are left out."""


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

        An incomplete block at its end is cut off. InputError: it is of another system or program.
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
        """Write all cycles up to the last checkpoint."""
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
    """
    # finished cycles per cycle that a kill may lose in long histories, at least: each checkpoint
    # costs the time of some cycles, as factors and rates are computed anew
    doublings = max(0, (cycle // (10 * every)).bit_length() - 1)
    return cycle % (every << doublings) == 0


def has_checkpoint(path: Path) -> bool:
    """Return whether a journal may hold a checkpoint."""
    return path.is_file() and path.stat().st_size > TITLE_BYTES + HEAD.itemsize


MAGIC = b"recedingjournal4"
"""First bytes of the file: its kind and its format version."""

TITLE_BYTES = len(MAGIC) + 16
"""Length of the title."""

HEAD = np.dtype([("cycles", "<i8"), ("instants", "<i8"), ("changes", "<i8"), ("crc", "<u4")])
UNIQUENESS = np.dtype(
    [(k, np.asarray(v).dtype, np.shape(v)) for k, v in dataclasses.asdict(Uniqueness()).items()]
)


class JournalFormat:
    """Finished cycles as bytes and back, for a number of modelled nodes and of loads.

    Attributes:
        title: first bytes of the file.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Lay out the tables for a system."""
        n, loads = system.n, len(system.load_names)
        self._system = system
        self.title = MAGIC + np.array((n, loads), "<i8").tobytes()
        self._cycle = np.dtype(
            [
                ("dissipation", "<f8", (n,)),
                ("slip", "<f8", (n,)),
                ("totals", [(k, np.asarray(v).dtype) for k, v in Totals._field_defaults.items()]),
                ("uniqueness", UNIQUENESS),
                ("kept", "i1"),
                ("corners", "<i4"),
                ("samples", "<i4"),
                ("changes", "<i4"),
            ]
        )
        self._instant = np.dtype(
            [
                ("cycle", "<i4"),
                ("leg", "<i4"),
                ("s", "<f8"),
                ("load", "<f8", (loads,)),
                ("v", "<f8", (n,)),
                ("u", "<f8", (2 * n,)),
                ("r", "<f8", (2 * n,)),
                ("state", "i1", (n,)),
            ]
        )
        self._event = event_rows(system).dtype

    def pack(self, cycles: list[FinishedCycle]) -> bytes:
        """Return the block of some cycles."""
        rows = np.zeros(len(cycles), self._cycle)
        instants: list[Instant] = []
        sampled = [cycle.samples or Samples() for cycle in cycles]
        for row, cycle, samples in zip(rows, cycles, sampled, strict=True):
            instants += cycle.corners + samples.instants
            for key in ("dissipation", "slip"):
                row[key] = getattr(cycle, key)
            row["totals"] = tuple(cycle.totals)
            row["uniqueness"] = dataclasses.astuple(cycle.uniqueness)
            row["kept"] = cycle.samples is not None
            row["corners"], row["samples"] = len(cycle.corners), len(samples.instants)
            row["changes"] = sum(map(len, samples.events))
        points = np.zeros(len(instants), self._instant)
        for key in ("cycle", "leg", "s", "load", "v"):
            points[key] = [getattr(i, key) for i in instants]
        for key in ("u", "r", "state"):
            points[key] = [getattr(i.state, key) for i in instants]
        changes = events_of(self._system, sampled)
        data = rows.tobytes() + points.tobytes() + changes.tobytes()
        head = np.array([(len(rows), len(points), len(changes), 0)], HEAD)
        head["crc"] = zlib.crc32(data, zlib.crc32(head.tobytes()))
        return head.tobytes() + data

    def unpack(self, file: BinaryIO) -> list[FinishedCycle] | None:
        """Read the next block; None when there is no complete one."""
        bytes_ = file.read(HEAD.itemsize)
        if len(bytes_) < HEAD.itemsize:
            return None
        head = np.frombuffer(bytes_, HEAD).copy()
        checksum, head["crc"] = int(head["crc"][0]), 0
        tables = self._cycle, self._instant, self._event
        counts = [int(head[key][0]) for key in ("cycles", "instants", "changes")]
        sizes = [n * t.itemsize for n, t in zip(counts, tables, strict=True)]
        if min(counts) < 0 or sum(sizes) > os.fstat(file.fileno()).st_size:
            return None
        data = file.read(sum(sizes))
        if len(data) < sum(sizes) or checksum != zlib.crc32(data, zlib.crc32(head.tobytes())):
            return None
        ends = np.cumsum([0, *sizes])
        cycles, points, changes = (
            np.frombuffer(data[a:b], t) for a, b, t in zip(ends[:-1], ends[1:], tables, strict=True)
        )
        instants = [
            Instant(
                int(i["cycle"]),
                int(i["leg"]),
                float(i["s"]),
                i["load"].copy(),
                i["v"].copy(),
                ContactState(*(i[key].copy() for key in ("u", "r", "state"))),
            )
            for i in points
        ]
        return _cycles(cycles, instants, changes)


def _cycles(
    rows: NDArray[np.void], instants: list[Instant], events: NDArray[np.void]
) -> list[FinishedCycle]:
    """Return the cycles of a block; its instants and events are taken in their order."""
    cycles = []
    for row in rows:
        corners, sampled, count = (int(row[key]) for key in ("corners", "samples", "changes"))
        samples = Samples(instants[corners : corners + sampled], [events[:count]])
        unique = {key: row["uniqueness"][key].tolist() for key in UNIQUENESS.names or ()}
        cycles.append(
            FinishedCycle(
                instants[:corners],
                row["dissipation"].copy(),
                row["slip"].copy(),
                Totals(**{key: row["totals"][key].item() for key in Totals._fields}),
                samples if row["kept"] else None,
                Uniqueness(**{**unique, "nodes": tuple(unique["nodes"])}),
            )
        )
        events = events[count:]
        del instants[: corners + sampled]
    return cycles
