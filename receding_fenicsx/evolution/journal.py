"""The finished cycles of a run, kept on disk while it goes on, so that a killed run can go on.

The file grows by one block a checkpoint and is never rewritten: its cost does not grow with the
history. A block is a head (counts and the checksum of what follows) and three tables of fixed rows:
cycles, instants (ends of legs and samples) and changes of state. A kill while a block is written
leaves a tail that is no whole block; it is cut off, and the checkpoint before it serves.
"""

from __future__ import annotations

import os
import time
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.atomic import unwritable
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.collect import Change, Instant, Kept, Passed, Totals
from receding_fenicsx.interface.system import ContactState, ContactSystem

MAGIC = b"recedingjournal1"
"""First bytes of the file: what it is, and its format version."""

WRITING_SHARE = 0.02
"""Part of the run's time that writing checkpoints may take: one that comes sooner than that after
the one before is left to the next. (Small, fast systems; others write every checkpoint.)"""

HEAD = np.dtype([("cycles", "<i8"), ("instants", "<i8"), ("changes", "<i8"), ("crc", "<u4")])
TOTALS = np.dtype([(k, np.asarray(v).dtype) for k, v in Totals._field_defaults.items()])
CHANGE = np.dtype([("cycle", "<i4"), ("node", "<i4"), ("leg", "<i4"), ("old", "i1"), ("new", "i1")])


LOST_SHARE = 10
"""Part of the finished cycles, as 1 over this, that may lie behind the last checkpoint: to renew
the memory of the way costs some cycles' time, which long histories need not spend so often."""

JOURNAL = "journal.bin"
"""Name of the file in a run's folder."""


class Journal:
    """The finished cycles of a run, in memory.

    Attributes:
        checkpoint_cycles: cycles between two checkpoints, more in long histories; None for none.
        passed: the finished cycles, from cycle 0.
    """

    def __init__(self, checkpoint_cycles: int | None = None) -> None:
        """Start at rest."""
        self.checkpoint_cycles = checkpoint_cycles
        self.passed: list[Passed] = []

    def add(self, passed: Passed) -> bool:
        """Take the next finished cycle; return whether the run can be gone on with from its end."""
        self.passed.append(passed)
        every = self.checkpoint_cycles
        return every is not None and is_checkpoint(len(self.passed) - 1, every)

    def checkpoint(self) -> None:
        """Note that the run can be gone on with from here, its memory of the way being renewed."""

    def write(self) -> None:
        """Keep all cycles up to the last checkpoint."""

    def close(self) -> None:
        """End keeping."""


class JournalFile(Journal):
    """The finished cycles of a run, in memory and, up to a checkpoint, in a file."""

    def __init__(self, path: Path, system: ContactSystem, checkpoint_cycles: int) -> None:
        """Open the file of a run and read its checkpoints, or begin one.

        Args:
            path: the file; what no whole checkpoint ends with is cut off.
            system: the condensed body.
            checkpoint_cycles: cycles between two checkpoints.

        Raises:
            InputError: it is the file of another program or of another system.
        """
        super().__init__(checkpoint_cycles)
        self.path = Path(path)
        self._layout = _Layout(system)
        self._written = self._ready = 0
        self._cost, self._last = 0.0, -np.inf
        title = MAGIC + np.array(self._layout.shape, "<i8").tobytes()
        try:
            whole = self._read(title)
            # unbuffered: what has not been written when a signal comes shall never be
            self._file = open(path, "ab", buffering=0)
            self._file.truncate(whole)
            if not whole:
                self._append(title)
        except OSError as error:
            raise unwritable(path, error) from None

    def checkpoint(self) -> None:
        """Write what is new, unless the last writing is too fresh for its cost."""
        self._ready = len(self.passed)
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
        block = self._layout.pack(self.passed[self._written : self._ready])
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
        """Write data so that nothing of it is left when that fails."""
        before = os.fstat(self._file.fileno()).st_size
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except BaseException:
            self._file.truncate(before)
            raise

    def _read(self, title: bytes) -> int:
        """Read all whole blocks; return the place where they end."""
        if not self.path.exists():
            return 0
        with open(self.path, "rb") as file:
            head = file.read(len(title))
            if len(head) < len(title):
                return 0
            if head != title:
                raise InputError(f"{self.path}: belongs to another system; start the run anew")
            end = len(title)
            while block := self._layout.unpack(file):
                self.passed += block
                end = file.tell()
        self._written = self._ready = len(self.passed)
        return end


def is_checkpoint(cycle: int, every: int) -> bool:
    """Return whether a history can be gone on with from the end of a cycle, by its number alone.

    Every so many cycles at first; the spacing doubles with each doubling of the cycles past
    ``LOST_SHARE * every``.

    Args:
        cycle: number of the cycle, 0 for the first loading.
        every: cycles between two checkpoints at the beginning.
    """
    doublings = max(0, (cycle // (LOST_SHARE * every)).bit_length() - 1)
    return cycle % (every << doublings) == 0


def has_checkpoint(path: Path) -> bool:
    """Return whether a journal may hold a checkpoint."""
    return path.is_file() and path.stat().st_size > len(MAGIC) + 16 + HEAD.itemsize


class _Layout:
    """Cycles as bytes and back, for a number of modelled nodes and of loads."""

    def __init__(self, system: ContactSystem) -> None:
        n, loads = system.n, len(system.load_names)
        self.shape = (n, loads)
        self.cycle = np.dtype(
            [
                ("dissipation", "<f8", (n,)),
                ("slip", "<f8", (n,)),
                ("slip_range", "<f8"),
                ("totals", TOTALS),
                ("unused", "i1"),  # so that older checkpoints can be read
                ("kept", "i1"),
                ("corners", "<i4"),
                ("samples", "<i4"),
                ("changes", "<i4"),
            ]
        )
        self.instant = np.dtype(
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
        self.change = np.dtype([*CHANGE.descr, ("s", "<f8"), ("load", "<f8", (loads,))])

    def pack(self, passed: list[Passed]) -> bytes:
        """Return the block of some cycles."""
        cycles = np.zeros(len(passed), self.cycle)
        instants: list[Instant] = []
        changes: list[Change] = []
        for row, p in zip(cycles, passed, strict=True):
            kept = p.kept or Kept()
            instants += p.corners + kept.instants
            changes += kept.changes
            row["dissipation"], row["slip"], row["slip_range"] = p.dissipation, p.slip, p.slip_range
            row["totals"] = tuple(p.totals)
            row["kept"] = p.kept is not None
            row["corners"], row["samples"] = len(p.corners), len(kept.instants)
            row["changes"] = len(kept.changes)
        points = np.zeros(len(instants), self.instant)
        for key in ("cycle", "leg", "s", "load", "v"):
            points[key] = [getattr(i, key) for i in instants]
        for key in ("u", "r", "state"):
            points[key] = [getattr(i.state, key) for i in instants]
        events = np.zeros(len(changes), self.change)
        if changes:
            for key in Change._fields:
                events[key] = [getattr(c, key) for c in changes]
        data = cycles.tobytes() + points.tobytes() + events.tobytes()
        head = np.array([(len(cycles), len(points), len(events), zlib.crc32(data))], HEAD)
        return head.tobytes() + data

    def unpack(self, file: BinaryIO) -> list[Passed] | None:
        """Read the next block; None when there is no whole one."""
        bytes_ = file.read(HEAD.itemsize)
        if len(bytes_) < HEAD.itemsize:
            return None
        head = np.frombuffer(bytes_, HEAD)[0]
        counts = [int(head[key]) for key in ("cycles", "instants", "changes")]
        sizes = [n * t.itemsize for n, t in zip(counts, self._tables, strict=True)]
        if min(counts) < 0 or sum(sizes) > os.fstat(file.fileno()).st_size:
            return None
        data = file.read(sum(sizes))
        if len(data) < sum(sizes) or zlib.crc32(data) != head["crc"]:
            return None
        ends = np.cumsum([0, *sizes])
        cycles, points, events = (
            np.frombuffer(data[a:b], t)
            for a, b, t in zip(ends[:-1], ends[1:], self._tables, strict=True)
        )
        return self._cycles(cycles, points, events)

    @property
    def _tables(self) -> tuple[np.dtype, np.dtype, np.dtype]:
        return self.cycle, self.instant, self.change

    def _cycles(
        self, cycles: NDArray[np.void], points: NDArray[np.void], events: NDArray[np.void]
    ) -> list[Passed]:
        instants = [
            Instant(
                int(i["cycle"]),
                int(i["leg"]),
                float(i["s"]),
                i["load"].copy(),
                i["v"].copy(),
                ContactState(i["u"].copy(), i["r"].copy(), i["state"].copy()),
            )
            for i in points
        ]
        changes = [
            Change(
                cycle=int(c["cycle"]),
                leg=int(c["leg"]),
                s=float(c["s"]),
                load=c["load"].copy(),
                node=int(c["node"]),
                old=int(c["old"]),
                new=int(c["new"]),
            )
            for c in events
        ]
        passed = []
        for row in cycles:
            corners, samples, count = (int(row[k]) for k in ("corners", "samples", "changes"))
            kept = Kept(instants[corners : corners + samples], changes[:count])
            passed.append(
                Passed(
                    instants[:corners],
                    row["dissipation"].copy(),
                    row["slip"].copy(),
                    float(row["slip_range"]),
                    Totals(**{key: row["totals"][key].item() for key in Totals._fields}),
                    kept if row["kept"] else None,
                )
            )
            del instants[: corners + samples], changes[:count]
        return passed
