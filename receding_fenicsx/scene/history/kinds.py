"""Load history of a scene, by ``[history] kind``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.history.polyline import History, ended_by, named_factors
from receding_fenicsx.scene.model import INTERFERENCE, Harmonic, HistoryOptions, Scene

FEWEST_CORNERS = 8
"""Corners of the coarsest polygon, where the scene does not fix their number."""
MOST_CORNERS = 4096
"""Corners of the finest polygon."""
DEFAULT_TOLERANCE = 1e-3
"""Largest error estimate of the dissipation per cycle due to the polygon, relative."""
SAME_ANGLE = 1e-9
"""Difference of angles, in degrees, that counts as round-off."""


def check_known(driven: Iterable[str], names: tuple[str, ...], key: str) -> None:
    """Raise InputError for a name under a key of [history] that no load has."""
    for name in driven:
        if name not in names:
            raise InputError(
                f"[history] {key}: no load is named '{name}'; {suggestion(name, names)}"
            )


def check_driven(
    driven: tuple[str, ...], names: tuple[str, ...], options: HistoryOptions, key: str
) -> None:
    """Check that a history drives, by a key of [history], all loads that are not constant."""
    for name in driven:
        if name in options.constant:
            raise InputError(
                f"[history] constant: load '{name}' varies, by [history] {key}; name it in one of "
                "them"
            )
    check_known(driven, names, key)
    for name in names:
        if name not in driven:
            raise InputError(
                f"load '{name}': is not driven by the history; remove it, name it in [history] "
                'constant, or use kind = "table" with a column for it'
            )


def from_harmonic(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the polygon of a harmonic history, the coarsest one without ``corners``.

    Its path leads from rest straight to the means, then straight to the first corner.
    """
    loads = _checked_loads(options, names)
    angles = _angles(options, loads)
    mean = np.array([load.mean for load in loads])
    amplitude = np.array([load.amplitude for load in loads])
    phase = np.array([load.phase for load in loads])
    loop = mean + amplitude * _cosine(angles[:, None] - phase)
    loop = np.vstack([loop, loop[:1]])
    path = np.vstack([np.zeros_like(mean), mean, loop[0]])
    moves = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0.0, axis=1)])
    return History(names, path[moves], loop, options.cycles)


def corner_angles(options: HistoryOptions, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the angles of the corners in degrees, from the start of a cycle to its end."""
    loads = [options.harmonic[name] for name in names if name in options.harmonic]
    angles = _angles(options, loads)
    return np.append(angles, angles[0] + 360.0)


def is_straight(options: HistoryOptions) -> bool:
    """Return whether all loads are in phase or opposite, so that two corners are exact."""
    return len(_extremes(list(options.harmonic.values()))) == 2


def _checked_loads(options: HistoryOptions, names: tuple[str, ...]) -> list[Harmonic]:
    """Return the loads in the order of their names."""
    if not options.harmonic:
        raise InputError(
            '[history] harmonic: is missing; give each load a table [history.harmonic."NAME"] with '
            "mean, amplitude and phase"
        )
    check_driven(tuple(options.harmonic), names, options, "harmonic")
    if not any(load.amplitude for load in options.harmonic.values()):
        raise InputError(
            "[history] harmonic: no load has an amplitude, so nothing is cyclic; give one an "
            'amplitude, or use kind = "monotonic"'
        )
    if options.corners is not None:
        least = len(_extremes(list(options.harmonic.values())))
        if options.corners < least:
            raise InputError(
                f"[history] corners: {options.corners} are too few; the extremes of the loads need "
                f"{least}"
            )
    return [options.harmonic[name] for name in names]


def _extremes(loads: list[Harmonic]) -> NDArray[np.float64]:
    """Return the angles of the loads' extremes, sorted, from 0 at the first load's maximum."""
    phases = np.array([load.phase for load in loads if load.amplitude])
    angles = np.concatenate([phases, phases + 180.0]) - phases[0]
    # round-off below a full turn is the first angle again
    angles = np.mod(angles + 0.5 * SAME_ANGLE, 360.0) - 0.5 * SAME_ANGLE
    angles = np.sort(angles)
    return angles[np.concatenate([[True], np.diff(angles) > SAME_ANGLE])]


def _angles(options: HistoryOptions, loads: list[Harmonic]) -> NDArray[np.float64]:
    """Return the angles of the corners in degrees, from the first load's maximum once around."""
    extremes = _extremes(loads)
    start = next(load.phase for load in loads if load.amplitude)
    if len(extremes) == 2:
        return start + extremes
    corners = max(options.corners or FEWEST_CORNERS, len(extremes))
    arcs = np.diff(np.append(extremes, 360.0))
    pieces = _shares(arcs / 360.0, corners)
    parts = [
        low + arc * np.arange(n) / n for low, arc, n in zip(extremes, arcs, pieces, strict=True)
    ]
    return start + np.concatenate(parts)


def _shares(parts: NDArray[np.float64], total: int) -> NDArray[np.int64]:
    """Divide a number by parts of 1, at least 1 each; twice a number gives twice the shares."""
    if total % 2 == 0 and total // 2 >= max(FEWEST_CORNERS, len(parts)):
        return 2 * _shares(parts, total // 2)
    found = np.ones(len(parts), dtype=np.int64)
    while found.sum() < total:
        # to the part whose pieces are the longest
        found[np.argmax(parts / found)] += 1
    return found


def _cosine(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosine of angles in degrees, exact at multiples of 90."""
    quarters = np.round(degrees / 90.0)
    rest = np.radians(degrees - 90.0 * quarters)
    turn = np.mod(quarters, 4.0)
    sign = np.where((turn == 1.0) | (turn == 2.0), -1.0, 1.0)
    return sign * np.where(turn % 2.0 == 1.0, np.sin(rest), np.cos(rest)) + 0.0


KEYS_OF_KIND = {
    "load": ("cyclic", "monotonic"),
    "maximum": ("cyclic", "monotonic"),
    "minimum": ("cyclic", "monotonic"),
    "rows": ("table",),
    "cycle_rows": ("table",),
    "columns": ("table",),
    "harmonic": ("harmonic",),
    "corners": ("harmonic",),
    "tolerance": ("harmonic",),
}
"""Keys that have a meaning for some kinds of history only."""


def history_from_scene(scene: Scene) -> History:
    """Return the load history of a scene.

    * "monotonic": path from 0 to ``maximum``, no cycles.
    * "cyclic": path from 0 to ``maximum``; each cycle is ``maximum``, ``minimum``, ``maximum``.
    * "table": path from zero load through ``rows``; each cycle runs from the last row through
      ``cycle_rows`` back to it.
    * "harmonic": see :mod:`~receding_fenicsx.scene.history.kinds`. Where the scene does not fix
      the number of corners, the polygon is the coarsest one:
      :func:`~receding_fenicsx.evolution.histories.with_corners` finds how many are needed.

    Loads in ``constant`` are applied first, on a leg of their own, and kept. Before them each of
    the scene's preloads has a leg of its own.

    Args:
        scene: the scene; the order of its loads is that of the columns of the history.

    Returns:
        The history.

    Raises:
        InputError: a load is not driven, or an option of the history is invalid.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"a Scene is needed, not a {type(scene).__name__}")
    options, names = scene.history, scene.driven_names
    _check_keys(options)
    check_known(tuple(options.constant), names, "constant")
    if not names:
        nothing = History((), np.zeros((1, 0)), np.zeros((0, 0)))
        return _with_preloads(nothing, scene)
    varying = tuple(name for name in names if name not in options.constant)
    if not varying:
        raise InputError("[history] constant: names every load; leave out the one that varies")
    history = _from_options(options, varying)
    if len(history.loop):
        if options.cycles < 1:
            raise InputError(
                '[history] cycles: must be at least 1, not 0; or use kind = "monotonic"'
            )
    history = _with_preloads(_with_constant(history, options, names), scene)
    return ended_by(history, options.until)


def _from_options(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the history of the loads that are not constant."""
    if options.kind == "table":
        return _from_table(options, names)
    if options.kind == "harmonic":
        return from_harmonic(options, names)
    if options.load is None and len(names) != 1:
        raise InputError(
            "[history] load: the scene has several loads; name the driven one, and the others in "
            "constant"
        )
    driven = names[0] if options.load is None else options.load
    check_driven((driven,), names, options, "load")
    return _from_range(options, names)


def _from_range(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the history of one load between minimum and maximum."""
    path = np.array([[0.0], [options.maximum]])
    if options.kind == "monotonic":
        return History(names, path, np.zeros((0, 1)))
    if options.minimum >= options.maximum:
        raise InputError(
            f"[history] minimum: {options.minimum:g} is not below maximum = {options.maximum:g}; "
            "reduce it"
        )
    loop = np.array([[options.maximum], [options.minimum], [options.maximum]])
    return History(names, path, loop, options.cycles)


def _with_constant(history: History, options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return a history with the constant loads added: applied first, on one leg, then kept."""
    factors = np.array([options.constant.get(name, 0.0) for name in names])
    varying = [names.index(name) for name in history.load_names]

    def widened(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        wide = np.tile(factors, (len(rows), 1))
        wide[:, varying] = rows
        return wide

    path = widened(history.path)
    if np.any(factors):
        path = np.vstack([np.zeros_like(path[:1]), path])
    return dataclasses.replace(history, load_names=names, path=path, loop=widened(history.loop))


def preload_legs(scene: Scene) -> list[str]:
    """Return the names of the scene's preloads in the order of their legs."""
    # parts are fitted before they are bolted
    return sorted(scene.preloads, key=lambda name: name != INTERFERENCE)


def _with_preloads(history: History, scene: Scene) -> History:
    """Return a history with the scene's preloads, brought up before all else and kept."""
    preloads = scene.preloads
    if not preloads:
        return history
    names, n = scene.load_names, len(history.load_names)
    legs = np.zeros((len(preloads) + 1, len(names)))
    for row, name in enumerate(preload_legs(scene), start=1):
        legs[row:, names.index(name)] = preloads[name]
    for bolt in scene.bolts:
        if bolt.tightening:
            legs[1:, names.index(bolt.name)] = bolt.tightening

    def widened(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        wide = np.tile(legs[-1], (len(rows), 1))
        wide[:, :n] = rows
        return wide

    path = np.vstack([legs[:-1], widened(history.path)])
    return dataclasses.replace(history, load_names=names, path=path, loop=widened(history.loop))


def _check_keys(options: HistoryOptions) -> None:
    """Refuse keys without a meaning for the kind of the history."""
    default = HistoryOptions()
    for key, kinds in KEYS_OF_KIND.items():
        value = getattr(options, key)
        if options.kind in kinds or (isinstance(value, tuple) and not value):
            continue
        if value != getattr(default, key):
            hint = "name the loads by columns" if key == "load" and options.kind == "table" else ""
            allowed = " or ".join(f'"{kind}"' for kind in kinds)
            raise InputError(
                f"[history] {key}: is for kind = {allowed} only, not "
                f'"{options.kind}"; {hint or "remove it"}'
            )


def _from_table(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the history of a table of load factors; ``names`` are those not constant."""
    if not options.columns:
        raise InputError("[history] columns: is missing; give the name of the load of each column")
    if len(set(options.columns)) < len(options.columns):
        raise InputError("[history] columns: a load occurs twice; name each load once")
    check_driven(options.columns, names, options, "columns")
    loop = _rows(options.cycle_rows, options.columns, "cycle_rows")
    rows = _rows(options.rows, options.columns, "rows")
    if not len(rows):
        if not len(loop):
            raise InputError(
                "[history] rows: is missing; give the load factors up to the start of the cycles"
            )
        rows = loop[-1:]
    preloaded = any(options.constant.values())
    if np.any(rows[0] != 0.0):
        rows = np.vstack([np.zeros_like(rows[:1]), rows])
    if not np.any(rows) and not preloaded:
        raise InputError("[history] rows: all load factors are zero; give one that is not")
    _check_moves(rows, options.columns, "rows")
    order = [options.columns.index(name) for name in names]
    if not len(loop):
        return History(names, rows[:, order], np.zeros((0, len(names))))
    if np.any(loop[-1] != rows[-1]):
        raise InputError(
            "[history] cycle_rows: is not closed: ends at "
            f"{named_factors(options.columns, loop[-1])}, but rows end at "
            f"{named_factors(options.columns, rows[-1])}; use the same load factors"
        )
    if np.any(loop[0] != rows[-1]) or len(loop) == 1:
        loop = np.vstack([rows[-1:], loop])
    _check_moves(loop, options.columns, "cycle_rows")
    return History(names, rows[:, order], loop[:, order], options.cycles)


def _rows(
    rows: tuple[tuple[float, ...], ...], columns: tuple[str, ...], key: str
) -> NDArray[np.float64]:
    for i, row in enumerate(rows):
        if len(row) != len(columns):
            raise InputError(
                f"[history] {key} row {i + 1}: has {len(row)} value(s) for {len(columns)} "
                "column(s); give one per column"
            )
    return np.array(rows, dtype=float).reshape(len(rows), len(columns))


def _check_moves(rows: NDArray[np.float64], columns: tuple[str, ...], key: str) -> None:
    still = np.flatnonzero(np.all(np.diff(rows, axis=0) == 0.0, axis=1))
    if len(still):
        raise InputError(
            f"[history] {key}: {named_factors(columns, rows[still[0]])} occurs twice in a row; "
            "remove one"
        )
