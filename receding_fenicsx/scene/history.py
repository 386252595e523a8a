"""Load histories: polylines of load factors, from a scene or made directly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import check_choice, suggestion
from receding_fenicsx.scene.model import HistoryOptions, Scene

KINDS = ("monotonic", "cyclic", "table")
MAX_CYCLES = 1_000_000_000
"""Largest number of cycles; cycle numbers in the files of a run have room for it."""


@dataclass(frozen=True)
class History:
    """Load history: a path from rest, then a closed loop that each cycle repeats.

    Attributes:
        load_names: n_loads names, one per column.
        path: (n + 1, n_loads) load factors of cycle 0, from zero load to the start of the cycles.
        loop: (m + 1, n_loads) load factors of every further cycle, closed: first and last row are
            ``path[-1]``; (0, n_loads) when there are no cycles.
        cycles: largest number of repetitions of the loop.
        until_steady: whether to stop when the steady state is reached.
    """

    load_names: tuple[str, ...]
    path: NDArray[np.float64]
    loop: NDArray[np.float64]
    cycles: int = 0
    until_steady: bool = False

    def polyline(self, cycle: int) -> NDArray[np.float64]:
        """Return the load factors at the corners of a cycle; cycle 0 is the path from rest.

        Raises:
            InputError: there is no such cycle.
        """
        if not 0 <= cycle <= self.cycles:
            raise InputError(
                f"cycle {cycle} does not occur: the history has cycles 0 to {self.cycles}"
            )
        return self.path if cycle == 0 else self.loop


def check_history(history: History, load_names: tuple[str, ...]) -> None:
    """Check that a history drives given loads, starts at rest and has a closed loop.

    Raises:
        InputError: the history has other loads, an array of a wrong shape or with entries that are
            not finite, a path that does not start at rest, or a loop that is not closed.
    """
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
                f"row {np.argmax(wrong)} of the history's {name}, {rows[np.argmax(wrong)].tolist()}"
                ", is not finite"
            )
    if np.any(path[0]):
        raise InputError(
            f"the history's path starts at load factors {path[0].tolist()}: insert a row of zeros "
            "(the body at rest) before it"
        )
    if len(loop) and (np.any(loop[0] != path[-1]) or np.any(loop[-1] != loop[0])):
        raise InputError(
            f"the history's loop runs from {loop[0].tolist()} to {loop[-1].tolist()}: start and "
            f"end it at the end of the path, {path[-1].tolist()}"
        )


def from_scene(scene: Scene) -> History:
    """Return the load history of a scene.

    * "monotonic": path from 0 to ``maximum``, no cycles.
    * "cyclic": path from 0 to ``maximum``; each cycle is ``maximum``, ``minimum``, ``maximum``.
    * "table": path from zero load through ``rows``; each cycle runs from the last row through
      ``cycle_rows`` back to it.

    Args:
        scene: the scene; the order of its loads is that of the columns of the history.

    Returns:
        The history.

    Raises:
        InputError: a load is not driven, or an option of the history is invalid.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"a Scene is needed, not a {type(scene).__name__}")
    options = scene.history
    names = scene.load_names
    check_choice(options.kind, KINDS, "[history] kind")
    if options.until not in (None, "steady"):
        raise InputError(
            f'[history] until: "{options.until}" is unknown; use "steady" or remove it'
        )
    if options.kind == "table":
        return _from_table(scene, names)
    for key in ("columns", "rows", "cycle_rows"):
        if getattr(options, key):
            raise InputError(
                f'[history] {key}: is for kind = "table" only, not "{options.kind}"; remove it'
            )
    if options.load is None and len(names) != 1:
        raise InputError("[history] load: the scene has several loads; name the driven one")
    driven = names[0] if options.load is None else options.load
    _check_driven((driven,), names, "load")
    return _from_range(options, names)


def _from_range(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the history of one load between minimum and maximum."""
    if not options.maximum > 0.0:
        raise InputError(
            f"[history] maximum: must be positive, not {options.maximum:g}; to reverse the "
            "load, change its own sign"
        )
    path = np.array([[0.0], [options.maximum]])
    if options.kind == "monotonic":
        return History(names, path, np.zeros((0, 1)))
    if options.minimum >= options.maximum:
        raise InputError(
            f"[history] minimum: {options.minimum:g} is not below maximum = {options.maximum:g}; "
            "reduce it"
        )
    _check_cycles(options.cycles)
    loop = np.array([[options.maximum], [options.minimum], [options.maximum]])
    return History(names, path, loop, options.cycles, options.until == "steady")


def leg_number(history: History, name: str, cycle: int = 1) -> int:
    """Return the index of a leg in its cycle from its name on the command line.

    Args:
        history: the history.
        name: "loading", "unloading", or the index.
        cycle: cycle of the leg; 0 is the path from rest.

    Returns:
        Index of the leg, from 0: in a cycle, "unloading" is the first leg and "loading" the last.

    Raises:
        InputError: the cycle has no such leg.
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
    """Return instants of a cycle, evenly spaced in the path length of the loads.

    Args:
        history: the history.
        cycle: cycle, 0 for the path from rest.
        n: number of instants, at least the number of legs plus one.

    Returns:
        For each instant the leg, the position s in [0, 1] along it, and the fraction of the cycle's
        path length up to it. The first instant is the cycle's start; in cycle 0 it is slightly
        later, as nothing is loaded at the start. The end of every leg is one of the instants.

    Raises:
        InputError: there is no such cycle, or n is too small.
    """
    polyline = history.polyline(cycle)
    legs = len(polyline) - 1
    if n < legs + 1:
        raise InputError(f"{n} frames: a cycle of {legs} legs needs at least {legs + 1}")
    largest = np.abs(np.vstack([history.path, history.loop])).max(axis=0)
    way = np.abs(np.diff(polyline, axis=0) / np.where(largest > 0.0, largest, 1.0)).sum(axis=1)
    share = np.maximum(1, np.round((n - 1) * way / way.sum())).astype(int)
    share[np.argmax(share)] += n - 1 - share.sum()
    before = np.concatenate([[0.0], np.cumsum(way)]) / way.sum()
    leg, s = [0], [0.0 if cycle else 0.5 / share[0]]
    for k, count in enumerate(share):
        leg += [k] * count
        s += ((np.arange(count) + 1.0) / count).tolist()
    number, position = np.array(leg), np.array(s)
    return number, position, before[number] + position * np.diff(before)[number]


def _from_table(scene: Scene, names: tuple[str, ...]) -> History:
    options = scene.history
    if options.load is not None:
        raise InputError('[history] load: is not for kind = "table"; use columns = ["..."] instead')
    if not options.columns:
        raise InputError("[history] columns: is missing; give the name of the load of each column")
    if len(set(options.columns)) < len(options.columns):
        raise InputError("[history] columns: a load occurs twice; name each load once")
    _check_driven(options.columns, names, "columns")
    rows = _table(options.rows, options.columns, "rows")
    if not len(rows):
        raise InputError(
            "[history] rows: is missing; give the load factors up to the start of the cycles"
        )
    if np.any(rows[0] != 0.0):
        rows = np.vstack([np.zeros_like(rows[:1]), rows])
    if not np.any(rows):
        raise InputError("[history] rows: all load factors are zero; give one that is not")
    _check_moves(rows, "rows")
    loop = _table(options.cycle_rows, options.columns, "cycle_rows")
    order = [options.columns.index(name) for name in names]
    if not len(loop):
        return History(names, rows[:, order], np.zeros((0, len(names))))
    if np.any(loop[-1] != rows[-1]):
        raise InputError(
            f"[history] cycle_rows: is not closed: ends at {loop[-1].tolist()}, but rows end at "
            f"{rows[-1].tolist()}; use the same load factors"
        )
    if np.any(loop[0] != rows[-1]) or len(loop) == 1:
        loop = np.vstack([rows[-1:], loop])
    _check_moves(loop, "cycle_rows")
    _check_cycles(options.cycles)
    return History(names, rows[:, order], loop[:, order], options.cycles, options.until == "steady")


def _table(
    rows: tuple[tuple[float, ...], ...], columns: tuple[str, ...], key: str
) -> NDArray[np.float64]:
    for i, row in enumerate(rows):
        if len(row) != len(columns):
            raise InputError(
                f"[history] {key} row {i + 1}: has {len(row)} value(s) for {len(columns)} "
                "column(s); give one per column"
            )
    return np.array(rows, dtype=float).reshape(len(rows), len(columns))


def _check_moves(rows: NDArray[np.float64], key: str) -> None:
    still = np.flatnonzero(np.all(np.diff(rows, axis=0) == 0.0, axis=1))
    if len(still):
        raise InputError(
            f"[history] {key}: the load factors {rows[still[0]].tolist()} occur twice in a row; "
            "remove one"
        )


def _check_cycles(cycles: int) -> None:
    if cycles < 1:
        raise InputError(
            f'[history] cycles: must be at least 1, not {cycles}; or use kind = "monotonic"'
        )
    if cycles > MAX_CYCLES:
        raise InputError(f"[history] cycles: must be at most {MAX_CYCLES}, not {cycles}")


def _check_driven(driven: tuple[str, ...], names: tuple[str, ...], key: str) -> None:
    for name in driven:
        if name not in names:
            raise InputError(
                f"[history] {key}: no load is named '{name}'; {suggestion(name, names)}"
            )
    for name in names:
        if name not in driven:
            raise InputError(
                f"load '{name}': is not driven by the history; remove it, or use "
                'kind = "table" with a column for it'
            )
