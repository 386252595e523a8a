"""Journal of a run: the finished cycles, in memory and in a folder from which a run is resumed.

At a checkpoint the new cycles are written as one NumPy file ``N.npz``, N being the number of its
first cycle: arrays of cycles, of instants (ends of legs, then samples, of each cycle) and events.
Files are never rewritten, so that the cost of a checkpoint does not grow with the history.
"""

from __future__ import annotations

import dataclasses
import io
import json
import time
from itertools import islice
from pathlib import Path
from typing import Any

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
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.uniqueness.watch import Uniqueness
from receding_fenicsx.scene.toml_reader import type_adapter

WRITING_SHARE = 0.02
"""Largest part of the run's time spent on writing checkpoints. Where they come faster, as on small
systems, some are left out."""

JOURNAL = "journal"
"""Name of the folder in a run's folder."""

PLACE, STATE = ("cycle", "leg", "s", "load", "v"), ("u", "r", "state")
"""Arrays of the instants in a file, and of their contact states."""


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
        number, every = len(self.cycles) - 1, self.checkpoint_cycles
        if every is None:
            return False
        # the spacing doubles with each doubling of the cycles beyond 10 spacings: each checkpoint
        # costs the time of some cycles, as factors and rates are computed anew
        doublings = max(0, (number // (10 * every)).bit_length() - 1)
        return number % (every << doublings) == 0

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


def checkpoints(run: Path) -> int:
    """Return the number of checkpoints in a run's folder."""
    return len(list((run / JOURNAL).glob("*.npz")))


def packed(cycles: list[FinishedCycle], system: ContactSystem) -> dict[str, NDArray[Any]]:
    """Return some cycles as arrays over them, over their instants and over their events."""
    sampled = [cycle.samples or Samples() for cycle in cycles]
    instants = [
        i for cycle, own in zip(cycles, sampled, strict=True) for i in cycle.corners + own.instants
    ]
    about = [
        {
            "corners": len(cycle.corners),
            "samples": None if cycle.samples is None else len(own.instants),
            "events": sum(map(len, own.events)),
            "totals": cycle.totals._asdict(),
            "uniqueness": dataclasses.asdict(cycle.uniqueness),
            "choices": list(map(dataclasses.asdict, cycle.choices)),
        }
        for cycle, own in zip(cycles, sampled, strict=True)
    ]
    text = json.dumps(about, default=lambda number: number.item())
    return {
        "about": np.array(text),
        **{key: np.array([getattr(c, key) for c in cycles]) for key in ("dissipation", "slip")},
        **{key: np.array([getattr(i, key) for i in instants]) for key in PLACE},
        **{key: np.array([getattr(i.state, key) for i in instants]) for key in STATE},
        "events": events_of(system, sampled),
    }


def unpacked(path: Path, system: ContactSystem) -> list[FinishedCycle]:
    """Read the cycles of a file.

    Raises:
        InputError: it is damaged, cannot be read, or is of another system or program.
    """
    try:
        data = io.BytesIO(path.read_bytes())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); check its rights"
        ) from None
    try:
        with np.load(data, allow_pickle=False) as file:
            tables = {name: file[name] for name in file}
        about = json.loads(str(tables["about"]))
        shapes = {"load": len(system.load_names), "v": system.n, "u": 2 * system.n}
        fits = all(tables[key].shape[1:] == (size,) for key, size in shapes.items())
        if not fits or tables["events"].dtype != event_rows(system).dtype:
            raise ValueError("of another system")
        keys = Totals._field_defaults.keys(), dataclasses.asdict(Uniqueness()).keys()
        if any((row["totals"].keys(), row["uniqueness"].keys()) != keys for row in about):
            raise ValueError("of another version")
        places = zip(*(tables[key].tolist() for key in ("cycle", "leg", "s")), strict=True)
        arrays = zip(*(map(np.copy, tables[key]) for key in ("load", "v", *STATE)), strict=True)
        instants = iter(
            [
                Instant(cycle, leg, s, load, v, ContactState(*state))
                for (cycle, leg, s), (load, v, *state) in zip(places, arrays, strict=True)
            ]
        )
        cycles, events = [], tables["events"]
        for k, row in enumerate(about):
            corners = list(islice(instants, row["corners"]))
            count, unique = row["events"], row["uniqueness"]
            samples = Samples(list(islice(instants, row["samples"] or 0)), [events[:count]])
            cycles.append(
                FinishedCycle(
                    corners,
                    tables["dissipation"][k].copy(),
                    tables["slip"][k].copy(),
                    Totals(**row["totals"]),
                    None if row["samples"] is None else samples,
                    Uniqueness(**unique | {"nodes": tuple(unique["nodes"])}),
                    type_adapter(tuple[Choice, ...]).validate_python(row.get("choices", ())),
                )
            )
            events = events[count:]
    except MemoryError:
        raise
    except Exception as error:  # of many kinds: whatever damaged bytes make of themselves
        raise InputError(
            f"{path}: is damaged, or of another system or version of this program ({error}); "
            "remove it to resume from the checkpoint before, or start the run anew"
        ) from None
    return cycles
