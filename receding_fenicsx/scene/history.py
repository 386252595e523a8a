"""Load histories: polylines in the space of load factors."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene

KINDS = ("monotonic", "cyclic", "table")
MOST_CYCLES = 1_000_000_000
"""What the numbers of cycles in a run's files have room for."""


@dataclass(frozen=True)
class History:
    """A path from rest, then a closed polygon that is run through again and again.

    Attributes:
        load_names: n_loads names, one a column.
        path: (n + 1, n_loads) load factors of cycle 0, from zero load to the start of the cycles.
        loop: (m + 1, n_loads) closed polygon of every further cycle, first and last row equal to
            ``path[-1]``; (0, n_loads) when there are no cycles.
        cycles: how many times the loop is run through at most.
        until_steady: stop as soon as the steady state is reached.
    """

    load_names: tuple[str, ...]
    path: NDArray[np.float64]
    loop: NDArray[np.float64]
    cycles: int = 0
    until_steady: bool = False


def check_history(history: History, load_names: tuple[str, ...]) -> None:
    """Raise where a history cannot be played on a contact with these loads.

    Raises:
        InputError: it drives other loads, its arrays have another shape or entries that are not
            finite, it does not begin at rest, or its cycle does not join on and close.
    """
    if not isinstance(history, History):
        raise InputError(f"evolve: plays a Scene or a History, not a {type(history).__name__}")
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
            f"the history's path begins at load factors {path[0].tolist()}: put a row of zeros, "
            "the body at rest, before it"
        )
    if len(loop) and (np.any(loop[0] != path[-1]) or np.any(loop[-1] != loop[0])):
        raise InputError(
            f"the history's loop runs from {loop[0].tolist()} to {loop[-1].tolist()}: begin and "
            f"end it where the path ends, at {path[-1].tolist()}"
        )


def from_scene(scene: Scene) -> History:
    """Make the load history of a scene.

    * "monotonic": path 0 to ``maximum``, no cycles.
    * "cyclic": path 0 to ``maximum``, every cycle ``maximum``, ``minimum``, ``maximum``.
    * "table": path from zero load through ``rows``, every cycle from the last row through
      ``cycle_rows`` and back to it.

    Args:
        scene: the scene; the columns of the history are its loads in their order there.

    Returns:
        The history.

    Raises:
        InputError: the history drives no load or not every one, or its table has no meaning.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"a history is made from a scene, not from a {type(scene).__name__}")
    options = scene.history
    names = scene.load_names
    if options.kind not in KINDS:
        raise InputError(
            f'[history] kind: "{options.kind}" is unknown; use one of {", ".join(KINDS)}'
        )
    if options.until not in (None, "steady"):
        raise InputError(
            f'[history] until: "{options.until}" is unknown; use "steady" or leave it out'
        )
    if options.kind == "table":
        return _from_table(scene, names)
    for key in ("columns", "rows", "cycle_rows"):
        if getattr(options, key):
            raise InputError(
                f'[history] {key}: belongs to kind = "table"; this history is "{options.kind}"'
            )
    driven = options.load
    if driven is None:
        if len(names) != 1:
            raise InputError(
                "[history] load: the scene has several loads; name the one that is driven"
            )
        driven = names[0]
    _check_driven((driven,), names, "load")
    if not options.maximum > 0.0:
        raise InputError(
            f"[history] maximum: must be positive, not {options.maximum:g}, or nothing is ever "
            "loaded; turn the load's own sign instead"
        )
    path = np.array([[0.0], [options.maximum]])
    if options.kind == "monotonic":
        return History(names, path, np.zeros((0, 1)))
    if options.minimum >= options.maximum:
        raise InputError(
            f"[history] minimum: {options.minimum:g} is not below maximum = {options.maximum:g}; "
            "lower it"
        )
    _check_cycles(options.cycles)
    loop = np.array([[options.maximum], [options.minimum], [options.maximum]])
    return History(names, path, loop, options.cycles, options.until == "steady")


def leg_number(history: History, name: str, cycle: int = 1) -> int:
    """Number of a leg within a cycle from its name on the command line.

    Args:
        history: the history.
        name: "loading", "unloading", or the number itself.
        cycle: cycle that the leg belongs to; 0 is the path from rest.

    Returns:
        Index of the leg, from 0: in a cycle, "unloading" is the first leg and "loading" the last.

    Raises:
        InputError: the cycle has no such leg.
    """
    if not 0 <= cycle <= history.cycles:
        raise InputError(
            f"cycle {cycle} does not occur: the history has cycles 0 to {history.cycles}"
        )
    polyline = history.path if cycle == 0 else history.loop
    n = len(polyline) - 1
    size = np.abs(polyline).sum(axis=1)
    if name in ("loading", "unloading"):
        rises = size[1:] > size[:-1]
        legs = [k for k in range(n) if rises[k] == (name == "loading")]
        if len(legs) != 1:
            raise InputError(
                f"cycle {cycle} has {len(legs)} {name} legs; give the leg's number, 0 to {n - 1}"
            )
        return legs[0]
    if not name.isdecimal() or int(name) >= n:
        raise InputError(
            f"leg '{name}': cycle {cycle} has legs 0 to {n - 1}; give one of them, or loading or "
            "unloading"
        )
    return int(name)


def spread(
    history: History, cycle: int, n: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Spread instants over a cycle, evenly in the way that the loads go.

    Args:
        history: the history.
        cycle: cycle, 0 for the path from rest.
        n: instants, at least one more than the cycle has legs.

    Returns:
        For each instant the leg, the position s in [0, 1] along it, and the part of the cycle's
        whole way that lies behind. The first is at the cycle's start (on the path from rest, where
        nothing is loaded, a little later), every leg's end is among them, the last is at its end.

    Raises:
        InputError: there is no such cycle, or n is too small.
    """
    if not 0 <= cycle <= history.cycles:
        raise InputError(
            f"cycle {cycle} does not occur: the history has cycles 0 to {history.cycles}"
        )
    polyline = history.path if cycle == 0 else history.loop
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
        raise InputError(
            '[history] load: a table drives its columns; use columns = ["..."] instead'
        )
    if not options.columns:
        raise InputError("[history] columns: is missing; name the load of each column")
    if len(set(options.columns)) < len(options.columns):
        raise InputError("[history] columns: a load is named twice; name each once")
    _check_driven(options.columns, names, "columns")
    rows = _table(options.rows, options.columns, "rows")
    if not len(rows):
        raise InputError(
            "[history] rows: is missing; give the load factors up to the cycles' start"
        )
    if np.any(rows[0] != 0.0):
        rows = np.vstack([np.zeros_like(rows[:1]), rows])
    if not np.any(rows):
        raise InputError("[history] rows: all load factors are zero; nothing is ever loaded")
    _check_moves(rows, "rows")
    loop = _table(options.cycle_rows, options.columns, "cycle_rows")
    order = [options.columns.index(name) for name in names]
    if not len(loop):
        return History(names, rows[:, order], np.zeros((0, len(names))))
    if np.any(loop[-1] != rows[-1]):
        raise InputError(
            f"[history] cycle_rows: is not closed: ends at {loop[-1].tolist()}, but rows end at "
            f"{rows[-1].tolist()}; end it there"
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
                "column(s); give one a column"
            )
    return np.array(rows, dtype=float).reshape(len(rows), len(columns))


def _check_moves(rows: NDArray[np.float64], key: str) -> None:
    still = np.flatnonzero(np.all(np.diff(rows, axis=0) == 0.0, axis=1))
    if len(still):
        raise InputError(
            f"[history] {key}: the load factors {rows[still[0]].tolist()} stand twice in a row; "
            "drop one"
        )


def _check_cycles(cycles: int) -> None:
    if cycles < 1:
        raise InputError(
            f'[history] cycles: must be at least 1, not {cycles}; or use kind = "monotonic"'
        )
    if cycles > MOST_CYCLES:
        raise InputError(f"[history] cycles: must be at most {MOST_CYCLES}, not {cycles}")


def _check_driven(driven: tuple[str, ...], names: tuple[str, ...], key: str) -> None:
    for name in driven:
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1) or names
            raise InputError(
                f"[history] {key}: no load is named '{name}'; did you mean '{close[0]}'?"
            )
    for name in names:
        if name not in driven:
            raise InputError(
                f"load '{name}': is not driven by the history; leave it out, or use "
                'kind = "table" with a column for it'
            )
