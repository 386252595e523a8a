"""Load history as a polyline of load factors: legs, cycles, instants along them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import described
from receding_fenicsx.errors import InputError

LEAST_CYCLES = 8
"""Cycles with which a search for the limit can end: those before it, one to sort the nodes, two
with frozen nodes, and the check."""


@dataclass(frozen=True, repr=False)
class History:
    """Load history: a path from rest, then a closed loop that each cycle repeats.

    Attributes:
        load_names: n_loads names, one per column.
        path: (n + 1, n_loads) load factors of cycle 0, from zero load to the start of the cycles.
        loop: (m + 1, n_loads) load factors of every further cycle, closed: first and last row are
            ``path[-1]``; (0, n_loads) when there are no cycles.
        cycles: largest number of repetitions of the loop.
        until_steady: whether to stop when the steady state is reached.
        until_limit: whether to find the limit of infinitely many cycles.
    """

    load_names: tuple[str, ...]
    path: NDArray[np.float64]
    loop: NDArray[np.float64]
    cycles: int = 0
    until_steady: bool = False
    until_limit: bool = False

    def __post_init__(self) -> None:
        """Convert names and load factors given as lists."""
        object.__setattr__(self, "load_names", tuple(self.load_names))
        for name in ("path", "loop"):
            try:
                rows = np.asarray(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise InputError(
                    f"the history's {name} has to be rows of {len(self.load_names)} load factors"
                ) from None
            if name == "loop" and not rows.size:
                rows = rows.reshape(0, len(self.load_names))
            object.__setattr__(self, name, rows)

    def __repr__(self) -> str:
        """Return the loads with their ranges, and the numbers of corners and cycles."""
        loop = np.reshape(self.loop, (-1, len(self.load_names)))
        corners = np.vstack([self.path, loop])
        loads = zip(self.load_names, corners.min(axis=0), corners.max(axis=0), strict=True)
        rows = [(f"load {name}", f"{low:.6g} to {high:.6g}") for name, low, high in loads]
        return described(
            f"History: {len(self.path)} corners from rest, {self.cycles} cycles of "
            f"{max(len(loop) - 1, 0)} legs{self._until()}",
            rows,
        )

    def _until(self) -> str:
        if self.until_limit:
            return ", until limit"
        return ", until steady" if self.until_steady else ""

    def polyline(self, cycle: int) -> NDArray[np.float64]:
        """Return the load factors at the corners of a cycle; cycle 0 is the path from rest."""
        if not 0 <= cycle <= self.cycles:
            raise InputError(
                f"cycle {cycle} does not occur: the history has cycles 0 to {self.cycles}"
            )
        return self.path if cycle == 0 else self.loop


def ended_by(history: History, until: str | None) -> History:
    """Return a history that ends at the steady state, at the limit, or (None) after its cycles."""
    if until not in (None, "steady", "limit"):
        raise InputError(
            f'[history] until: "{until}" is unknown; use "steady", "limit", or remove it'
        )
    if until == "limit" and not len(history.loop):
        raise InputError(
            '[history] until: "limit" needs cycles, which this history does not have; use '
            'kind = "cyclic", or remove until'
        )
    if until == "limit" and history.cycles < LEAST_CYCLES:
        raise InputError(
            f'[history] cycles: until = "limit" needs at least {LEAST_CYCLES}, not '
            f"{history.cycles}; raise cycles"
        )
    return replace(history, until_steady=until == "steady", until_limit=until == "limit")


def named_factors(names: tuple[str, ...], row: NDArray[np.float64]) -> str:
    """Return load factors with the names of their loads, for messages."""
    return ", ".join(f"{name} = {value:g}" for name, value in zip(names, row, strict=True))


def check_history(history: History, load_names: tuple[str, ...]) -> None:
    """Raise InputError unless a history drives given loads from rest, in a closed loop."""
    if not isinstance(history, History):
        raise InputError(f"evolve: a Scene or a History is needed, not a {type(history).__name__}")
    if history.load_names != load_names:
        raise InputError(
            f"the history drives loads {list(history.load_names)}, the system has "
            f"{list(load_names)}: name the same loads in the same order"
        )
    path, loop = np.asarray(history.path), np.asarray(history.loop)
    for name, rows, least in (("path", path, 2), ("loop", loop, 0)):
        if rows.ndim != 2 or rows.shape[1] != len(load_names) or len(rows) < least:
            raise InputError(
                f"the history's {name} has shape {rows.shape}, expected at least {least} rows of "
                f"{len(load_names)} load factors"
            )
        wrong = ~np.isfinite(rows).all(axis=1)
        if np.any(wrong):
            raise InputError(
                f"row {np.argmax(wrong)} of the history's {name}, "
                f"{named_factors(load_names, rows[np.argmax(wrong)])}, is not finite"
            )
    if np.any(path[0]):
        raise InputError(
            f"the history's path starts at load factors {named_factors(load_names, path[0])}: "
            "insert a row of zeros (the body at rest) before it"
        )
    if len(loop) and (np.any(loop[0] != path[-1]) or np.any(loop[-1] != loop[0])):
        first, last, end = (named_factors(load_names, row) for row in (loop[0], loop[-1], path[-1]))
        raise InputError(
            f"the history's loop runs from {first} to {last}: start and end it at the end of the "
            f"path, {end}"
        )


def leg_number(history: History, name: str, cycle: int = 1) -> int:
    """Return the index of a leg in its cycle, from 0, by its name on the command line.

    In a cycle, "unloading" is the first leg and "loading" the last.
    """
    polyline = history.polyline(cycle)
    n = len(polyline) - 1
    size = np.abs(polyline).sum(axis=1)
    if name in ("loading", "unloading"):
        rises = size[1:] > size[:-1]
        legs = [k for k in range(n) if rises[k] == (name == "loading")]
        if len(legs) != 1:
            raise InputError(
                f"cycle {cycle} has {len(legs)} {name} legs; give a leg number, 0 to {n - 1}"
            )
        return legs[0]
    if not name.isdecimal() or int(name) >= n:
        raise InputError(
            f"leg '{name}': cycle {cycle} has legs 0 to {n - 1}; give a number, or loading or "
            "unloading"
        )
    return int(name)


def evenly_spaced(
    history: History, cycle: int, n: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return n instants of a cycle, evenly spaced in the path length of the loads.

    Each has a leg, the position s in [0, 1] along it, and the fraction of the cycle's path length
    up to it. The first one is the cycle's start; in cycle 0 it is slightly later, as nothing is
    loaded at the start. Where n is larger than the number of legs, the end of every leg is one of
    the instants.
    """
    polyline = history.polyline(cycle)
    legs = len(polyline) - 1
    if n < 2:
        raise InputError(f"{n} frames: a film needs at least 2")
    largest = np.abs(np.vstack([history.path, history.loop])).max(axis=0)
    way = np.abs(np.diff(polyline, axis=0) / np.where(largest > 0.0, largest, 1.0)).sum(axis=1)
    before = np.concatenate([[0.0], np.cumsum(way)]) / way.sum()
    if n > legs:
        share = 1 + np.diff(np.round((n - 1 - legs) * before).astype(int))
        number = np.repeat(np.arange(legs), share)
        position = np.concatenate([(np.arange(count) + 1.0) / count for count in share])
    else:
        time = np.arange(1, n) / (n - 1)
        number = np.minimum(np.searchsorted(before[1:], time), legs - 1)
        position = np.minimum((time - before[number]) / np.diff(before)[number], 1.0)
    number = np.concatenate([[0], number])
    position = np.concatenate([[0.0 if cycle else 0.5 * position[0]], position])
    return number, position, before[number] + position * np.diff(before)[number]
