"""Format of the journal file: blocks of finished cycles as bytes, and back.

The file begins with a title: its kind, its format version, and the numbers of nodes and loads. Each
block is a head (counts and a checksum) and three tables of fixed rows: cycles, instants (ends of
legs, then samples, of each cycle) and events.
"""

from __future__ import annotations

import dataclasses
import os
import zlib
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.evolution.cycle_data import FinishedCycle, Samples, Totals, events_of
from receding_fenicsx.evolution.instants import Instant, event_rows
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.uniqueness.watch import Uniqueness

MAGIC = b"recedingjournal4"
"""First bytes of the file: its kind and its format version."""

TITLE_BYTES = len(MAGIC) + 16
"""Length of the title."""

HEAD = np.dtype([("cycles", "<i8"), ("instants", "<i8"), ("changes", "<i8"), ("crc", "<u4")])
TOTALS = np.dtype([(k, np.asarray(v).dtype) for k, v in Totals._field_defaults.items()])
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
                ("totals", TOTALS),
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
        return _cycles(cycles, [_instant(i) for i in points], changes)


def _instant(row: np.void) -> Instant:
    return Instant(
        int(row["cycle"]),
        int(row["leg"]),
        float(row["s"]),
        row["load"].copy(),
        row["v"].copy(),
        ContactState(row["u"].copy(), row["r"].copy(), row["state"].copy()),
    )


def _uniqueness(cycle: np.void) -> Uniqueness:
    row = cycle["uniqueness"]
    values = {key: row[key].tolist() for key in UNIQUENESS.names or ()}
    return Uniqueness(**{**values, "nodes": tuple(values["nodes"])})


def _cycles(
    rows: NDArray[np.void], instants: list[Instant], events: NDArray[np.void]
) -> list[FinishedCycle]:
    """Return the cycles of a block; its instants and events are taken in their order."""
    cycles = []
    for row in rows:
        corners, sampled, count = (int(row[key]) for key in ("corners", "samples", "changes"))
        samples = Samples(instants[corners : corners + sampled], [events[:count]])
        cycles.append(
            FinishedCycle(
                instants[:corners],
                row["dissipation"].copy(),
                row["slip"].copy(),
                Totals(**{key: row["totals"][key].item() for key in Totals._fields}),
                samples if row["kept"] else None,
                _uniqueness(row),
            )
        )
        events = events[count:]
        del instants[: corners + sampled]
    return cycles
