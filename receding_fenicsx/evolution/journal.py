"""Journal of a run: the finished cycles, in memory and in a folder from which a run is resumed.

At a checkpoint the new cycles are written as one NumPy file ``N.npz``, N being the number of its
first cycle: tables of cycles, of instants (ends of legs, then samples, of each cycle) and events.
Files are never rewritten, so that the cost of a checkpoint does not grow with the history.
"""

from __future__ import annotations

import dataclasses
import io
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.atomic import make_folder, new_file
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

JOURNAL = "journal"
"""Name of the folder in a run's folder."""

UNIQUENESS = np.dtype(
    [(k, np.asarray(v).dtype, np.shape(v)) for k, v in dataclasses.asdict(Uniqueness()).items()]
)


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


class JournalFolder(Journal):
    """The finished cycles of a run, in memory and, up to a checkpoint, in files."""

    def __init__(self, folder: Path, system: ContactSystem, checkpoint_cycles: int) -> None:
        """Open the journal of a run and read its checkpoints, or create it.

        InputError: it is of another system or program, or damaged.
        """
        super().__init__(checkpoint_cycles)
        self.folder, self._system = Path(folder), system
        self._cost, self._last = 0.0, -np.inf
        make_folder(self.folder)
        for left in self.folder.glob(".*.tmp"):  # by a run that was killed
            left.unlink()
        while (path := self.folder / f"{len(self.cycles)}.npz").exists():
            self.cycles += unpacked(path, system)
        self._written = self._ready = len(self.cycles)

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
        tables = packed(self.cycles[self._written : self._ready], self._system)
        path = self.folder / f"{self._written}.npz"
        data = io.BytesIO()  # a full disk leaves NumPy's own file half open
        np.savez(data, **tables)
        with new_file(path, overwrite=True) as beside:
            beside.write_bytes(data.getvalue())
        self._written = self._ready
        self._last = time.monotonic()
        self._cost = self._last - begin


def is_checkpoint(cycle: int, every: int) -> bool:
    """Return whether there is a checkpoint at the end of a cycle, by its number alone.

    Checkpoints are ``every`` cycles apart at first. The spacing doubles with each doubling of the
    cycles beyond ``FINISHED_PER_LOST_CYCLE * every``.
    """
    # finished cycles per cycle that a kill may lose in long histories, at least: each checkpoint
    # costs the time of some cycles, as factors and rates are computed anew
    doublings = max(0, (cycle // (10 * every)).bit_length() - 1)
    return cycle % (every << doublings) == 0


def checkpoints(run: Path) -> int:
    """Return the number of checkpoints in a run's folder."""
    return len(list((run / JOURNAL).glob("*.npz")))


def _layout(system: ContactSystem) -> dict[str, np.dtype[np.void]]:
    """Return the rows of the tables of a system."""
    n, loads = system.n, len(system.load_names)
    cycle = [
        ("dissipation", "<f8", (n,)),
        ("slip", "<f8", (n,)),
        ("totals", [(k, np.asarray(v).dtype) for k, v in Totals._field_defaults.items()]),
        ("uniqueness", UNIQUENESS),
        ("kept", "i1"),
        ("corners", "<i4"),
        ("samples", "<i4"),
        ("events", "<i4"),
    ]
    instant = [
        ("cycle", "<i4"),
        ("leg", "<i4"),
        ("s", "<f8"),
        ("load", "<f8", (loads,)),
        ("v", "<f8", (n,)),
        ("u", "<f8", (2 * n,)),
        ("r", "<f8", (2 * n,)),
        ("state", "i1", (n,)),
    ]
    rows = {"cycles": np.dtype(cycle), "instants": np.dtype(instant)}
    return rows | {"events": event_rows(system).dtype}


def packed(cycles: list[FinishedCycle], system: ContactSystem) -> dict[str, NDArray[np.void]]:
    """Return the tables of some cycles."""
    layout = _layout(system)
    rows = np.zeros(len(cycles), layout["cycles"])
    instants: list[Instant] = []
    sampled = [cycle.samples or Samples() for cycle in cycles]
    for row, cycle, samples in zip(rows, cycles, sampled, strict=True):
        instants += cycle.corners + samples.instants
        row["dissipation"], row["slip"] = cycle.dissipation, cycle.slip
        row["totals"] = tuple(cycle.totals)
        row["uniqueness"] = dataclasses.astuple(cycle.uniqueness)
        row["kept"] = cycle.samples is not None
        row["corners"], row["samples"] = len(cycle.corners), len(samples.instants)
        row["events"] = sum(map(len, samples.events))
    points = np.zeros(len(instants), layout["instants"])
    for key in ("cycle", "leg", "s", "load", "v"):
        points[key] = [getattr(i, key) for i in instants]
    for key in ("u", "r", "state"):
        points[key] = [getattr(i.state, key) for i in instants]
    return {"cycles": rows, "instants": points, "events": events_of(system, sampled)}


def unpacked(path: Path, system: ContactSystem) -> list[FinishedCycle]:
    """Read the cycles of a file.

    Raises:
        InputError: it is damaged, cannot be read, or is of another system or program.
    """
    layout = _layout(system)
    try:
        data = io.BytesIO(path.read_bytes())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); check its rights"
        ) from None
    try:
        with np.load(data, allow_pickle=False) as file:
            tables = {name: file[name] for name in layout}
    except MemoryError:
        raise
    except Exception as error:  # of many kinds: whatever damaged bytes make of themselves
        raise InputError(
            f"{path}: is damaged ({error}); remove it to resume from the checkpoint before"
        ) from None
    if any(tables[name].dtype != rows for name, rows in layout.items()):
        raise InputError(
            f"{path}: belongs to another system or version of this program; start the run anew"
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
        for i in tables["instants"]
    ]
    cycles, events = [], tables["events"]
    for row in tables["cycles"]:
        corners, sampled, count = (int(row[key]) for key in ("corners", "samples", "events"))
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
