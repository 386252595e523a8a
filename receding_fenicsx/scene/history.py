"""Load history: a polyline of load factors, its legs and instants; the one of a scene, by kind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import cosdg

from receding_fenicsx.arrays import Array, Ints, as_numbers, check_types, described, over_largest
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import Rules, broken, check_known, refuse, unused
from receding_fenicsx.scene.model import INTERFERENCE, Harmonic, HistoryOptions, Scene

LOAD_ROUND_OFF = 1e-12
"""Load factor, over its largest, up to which it is zero: that of a sine or of a sum of others."""


@dataclass(frozen=True, repr=False)
class History:
    """Load history: a path from rest, then a closed loop that each cycle repeats.

    Attributes:
        load_names: n_loads names, one per column.
        path: (n + 1, n_loads) load factors of cycle 0, from zero load to the start of the cycles;
            those within round-off of zero are zero, also in ``loop``.
        loop: (m + 1, n_loads) load factors of every further cycle, closed: first and last row are
            ``path[-1]``; (0, n_loads) when there are no cycles.
        cycles: largest number of repetitions of the loop.
        until_steady: whether to stop when the steady state is reached.
        until_limit: whether to find the limit of infinitely many cycles.
    """

    load_names: tuple[str, ...]
    path: Array
    loop: Array
    cycles: int = 0
    until_steady: bool = False
    until_limit: bool = False

    def __post_init__(self) -> None:
        """Convert names and load factors given as lists."""
        object.__setattr__(self, "load_names", tuple(self.load_names))
        for name in ("path", "loop"):
            rows = as_numbers(getattr(self, name), f"the history's {name}")
            if name == "loop" and not rows.size:
                rows = rows.reshape(0, len(self.load_names))
            object.__setattr__(self, name, rows)
        both = self.path, self.loop
        if both[0].ndim == both[1].ndim == 2 and both[0].shape[1] == both[1].shape[1]:
            largest = np.abs(np.vstack(both)).max(axis=0, initial=0.0)
            for name, rows in zip(("path", "loop"), both, strict=True):
                # infinite ones are refused where the history is played
                zero = (np.abs(rows) <= LOAD_ROUND_OFF * largest) & np.isfinite(largest)
                object.__setattr__(self, name, np.where(zero, 0.0, rows))

    def __repr__(self) -> str:
        """Return the loads with their ranges, and the numbers of corners and cycles."""
        corners = np.vstack([self.path, self.loop])
        loads = zip(self.load_names, corners.min(axis=0), corners.max(axis=0), strict=True)
        rows = [(f"load {name}", f"{low:.6g} to {high:.6g}") for name, low, high in loads]
        legs = f"{max(len(self.loop) - 1, 0)} legs"
        title = f"History: {len(self.path)} corners from rest, {self.cycles} cycles of {legs}"
        until = ", until limit" if self.until_limit else ", until steady" * self.until_steady
        return described(title + until, rows)

    def polyline(self, cycle: int) -> Array:
        """Return the load factors at the corners of a cycle; cycle 0 is the path from rest."""
        if not 0 <= cycle <= self.cycles:
            raise InputError(f"cycle {cycle} does not occur: there are cycles 0 to {self.cycles}")
        return self.path if cycle == 0 else self.loop

    def parts(self, load: Array) -> Array:
        """Return load factors, each over its largest."""
        return over_largest(load, np.vstack([self.path, self.loop]))


def ended_by(history: History, until: str | None) -> History:
    """Return a history that ends at the steady state, at the limit, or (None) after its cycles."""
    if until not in (None, "steady", "limit"):
        raise InputError(f'[history] until: "{until}" is unknown; use "steady" or "limit"')
    if until == "limit" and not len(history.loop):
        raise InputError('[history] until: "limit" needs cycles; use kind = "cyclic"')
    # those before it, one to sort the nodes, two with frozen nodes, and the check
    if until == "limit" and history.cycles < 8:
        least = f'until = "limit" needs at least 8, not {history.cycles}'
        raise InputError(f"[history] cycles: {least}; raise cycles")
    return replace(history, until_steady=until == "steady", until_limit=until == "limit")


def named_factors(names: tuple[str, ...], row: Array) -> str:
    """Return load factors with the names of their loads, for messages."""
    return ", ".join(f"{name} = {value:g}" for name, value in zip(names, row, strict=True))


def check_history(history: History, load_names: tuple[str, ...]) -> None:
    """Raise InputError unless a history drives given loads from rest, in a closed loop."""
    if history.load_names != load_names:
        raise InputError(f"the history drives {history.load_names}, the system has {load_names}")
    path, loop, n = history.path, history.loop, len(load_names)
    for name, rows, least in (("path", path, 2), ("loop", loop, 0)):
        if rows.ndim != 2 or rows.shape[1] != n or len(rows) < least:
            wanted = f"at least {least} rows of {n} load factors"
            raise InputError(f"the history's {name} has shape {rows.shape}, expected {wanted}")
        for k in np.flatnonzero(~np.isfinite(rows).all(axis=1)):
            at = named_factors(load_names, rows[k])
            raise InputError(f"row {k} of the history's {name}, {at}, is not finite")
    if np.any(path[0]):
        first = named_factors(load_names, path[0])
        raise InputError(f"the history's path starts at {first}; insert a row of zeros before it")
    if len(loop) and (np.any(loop[0] != path[-1]) or np.any(loop[-1] != loop[0])):
        first, last, end = (named_factors(load_names, row) for row in (loop[0], loop[-1], path[-1]))
        at = f"start and end it at the end of the path, {end}"
        raise InputError(f"the history's loop runs from {first} to {last}: {at}")


def leg_number(history: History, name: str, cycle: int = 1) -> int:
    """Return the index of a leg in its cycle: a number, "unloading" or "loading"."""
    polyline = history.polyline(cycle)
    n = len(polyline) - 1
    if name in ("loading", "unloading"):
        grows = np.diff(np.abs(history.parts(polyline)).sum(axis=1)) > 0.0
        legs = np.flatnonzero(grows == (name == "loading"))
        if len(legs) == 1:
            return int(legs[0])
    elif name.isdecimal() and int(name) < n:
        return int(name)
    raise InputError(f"leg '{name}': is not one of cycle {cycle}, which has legs 0 to {n - 1}")


def evenly_spaced(history: History, cycle: int, n: int) -> tuple[Ints, Array, Array]:
    """Return legs, positions in [0, 1] and fractions of a cycle's path length of n instants.

    They are evenly spaced from the cycle's start, or, as nothing is loaded at that of cycle 0,
    slightly later; if n is larger than the number of legs, the end of each is one of them.
    """
    polyline = history.polyline(cycle)
    legs = len(polyline) - 1
    if n < 2:
        raise InputError(f"{n} frames: a film needs at least 2")
    way = np.abs(np.diff(history.parts(polyline), axis=0)).sum(axis=1)
    before = np.concatenate([[0.0], np.cumsum(way)]) / way.sum()
    time = np.linspace(0.0, 1.0, n)
    if n > legs:
        share = 1 + np.diff(np.round((n - 1 - legs) * before).astype(int))
        time = np.interp(np.arange(n), np.cumsum([0, *share]), before)
    number = np.minimum(np.searchsorted(before[1:], time), legs - 1)
    length = np.diff(before)[number]
    # the loads may rest on a leg
    position = np.minimum((time - before[number]) / np.where(length > 0.0, length, 1.0), 1.0)
    position[0] = 0.0 if cycle else 0.5 * position[1]
    return number, position, before[number] + position * length


# -- histories of scenes --------------------------------------------------------------------------

FEWEST_CORNERS, MOST_CORNERS = 8, 4096
"""Corners of the coarsest polygon, where the scene does not fix their number, and of the finest."""


def history_from_scene(scene: Scene) -> History:
    """Return the load history of a scene, with columns in the order of its loads.

    * "monotonic": path from 0 to ``maximum``, no cycles; "cyclic": then ``maximum``, ``minimum``,
      ``maximum`` in each cycle.
    * "table": path from zero load through ``rows``; each cycle runs from the last row through
      ``cycle_rows`` back to it.
    * "harmonic": path from rest to the means, then to the first corner of the polygon that stands
      for the ellipse, the coarsest one where the scene does not fix the number of corners:
      :func:`~receding_fenicsx.evolution.histories.with_corners` finds how many are needed.
    * "travel": zero load, each position of the loads that travel, zero load; path and each cycle.

    Before it each of the scene's preloads has a leg of its own, and the loads in ``constant`` are
    applied on one, and kept. InputError: a load is not driven, or an option is invalid.
    """
    check_types("history_from_scene", scene=(scene, Scene))
    options, names = scene.history, scene.driven_names
    varying = tuple(name for name in names if name not in options.constant)
    refuse(broken([_rules(scene, varying)]))
    if not names:
        path, loop = np.zeros((1, 0)), np.zeros((0, 0))
    elif options.kind == "travel":
        # loads are put on, travel side by side, and are taken off
        units = [load.units for load in scene.loads if len(load.travel) > 1]
        path = loop = np.zeros((len(units[0]) + 2, len(varying)))
        for part in units:
            path[np.arange(len(part)) + 1, [varying.index(unit.name) for unit in part]] = 1.0
    elif options.kind == "harmonic":
        path, loop = _harmonic(options, varying)
    elif options.kind == "table":
        path, loop = _table(options, varying)
    else:
        low, high = options.minimum, options.maximum
        path = np.array([[0.0], [high]])
        loop = np.array([[high], [low], [high]])[: 0 if options.kind == "monotonic" else 3]
    if len(loop) and options.cycles < 1:
        raise InputError('[history] cycles: must be at least 1, not 0; or use kind = "monotonic"')
    held = _held(scene)
    wide = np.tile(held[-1], (len(path) + len(loop), 1))
    wide[:, [scene.load_names.index(name) for name in varying]] = np.vstack([path, loop])
    path, loop = np.vstack([held[:-1], wide[: len(path)]]), wide[len(path) :]
    cycles = options.cycles if len(loop) else 0
    return ended_by(History(scene.load_names, path, loop, cycles), options.until)


def _rules(scene: Scene, varying: tuple[str, ...]) -> Rules:
    """The keys of [history] suit its kind, and it drives all loads that are not constant."""
    options, names, kind = scene.history, scene.driven_names, scene.history.kind
    for keys, kinds in (
        (("load", "maximum"), '"cyclic" or "monotonic"'),
        (("minimum",), '"cyclic"'),
        (("rows", "cycle_rows", "columns"), '"table"'),
        (("harmonic", "corners", "tolerance"), '"harmonic"'),
    ):
        only = f'is for kind = {kinds} only, not "{kind}"'
        yield from unused(options, "[history]", kind not in kinds, keys, only)
    travel = [load for load in scene.loads if len(load.travel) > 1]
    if travel and kind != "travel":
        yield f'{travel[0].label}: travels, which needs [history] kind = "travel"'
    moved = {unit.name for load in travel for unit in load.units}
    one = options.load or varying[0] if len(varying) == 1 else options.load
    key, driven, missing = {
        "travel": ("kind", moved, "no load travels; give one travel = [FROM, TO]"),
        "harmonic": ("harmonic", options.harmonic, "is missing; give each load a table"),
        "table": ("columns", options.columns, "is missing; name the load of each column"),
    }.get(kind, ("load", [one] if one else [], "several loads; name the one that is not constant"))
    driven = driven if names else []  # a scene may have nothing but preloads
    for at, given in (("constant", options.constant), (key, driven)):
        for name in given:
            check_known(name, names, f"[history] {at}", "load")
    if names and not varying:
        yield "[history] constant: names every load; leave out the one that varies"
    if names and not driven:
        yield f"[history] {key}: {missing}"
    for name in driven:
        if name in options.constant:
            yield f"[history] constant: load '{name}' varies by [history] {key}; name it in one"
    for name in varying:
        if name not in driven:
            yield f"load '{name}': is not driven by the history; name it in constant, or remove it"
    if not names:
        return
    if kind == "cyclic" and options.minimum >= options.maximum:
        yield f"[history] minimum: {options.minimum:g} is not below maximum, {options.maximum:g}"
    steps = sorted({len(load.units) - 1 for load in travel})
    if len(steps) > 1:
        yield f"[history] kind: loads travel in {' and '.join(map(str, steps))} steps; use one"
    if kind == "harmonic":
        if not any(load.amplitude for load in options.harmonic.values()):
            yield "[history] harmonic: no load has an amplitude, so nothing is cyclic; give one"
        least = len(_extremes(list(options.harmonic.values())))
        if options.corners is not None and options.corners < least:
            yield f"[history] corners: {options.corners} are too few; the extremes need {least}"
    if kind == "table":
        yield from _of_table(options)


def _of_table(options: HistoryOptions) -> Rules:
    """Rows of load factors begin at rest, are closed, and change from row to row."""
    columns = options.columns
    if len(set(columns)) < len(columns):
        yield "[history] columns: a load occurs twice; name each load once"
    for key in ("cycle_rows", "rows"):
        for i, row in enumerate(getattr(options, key)):
            if len(row) != len(columns):
                yield f"[history] {key} row {i + 1}: has {len(row)} values, not {len(columns)}"
    if not options.rows and not options.cycle_rows:
        yield "[history] rows: is missing; give the load factors up to the start of the cycles"
    rows, loop = _table(options, columns)
    if not np.any(rows) and not any(options.constant.values()):
        yield "[history] rows: all load factors are zero; give one that is not"
    if len(loop) and np.any(loop[-1] != rows[-1]):
        ends = f"ends at {named_factors(columns, loop[-1])}"
        end = f"rows end at {named_factors(columns, rows[-1])}"
        yield f"[history] cycle_rows: is not closed: {ends}, but {end}; use the same load factors"
    for key, corners in (("rows", rows), ("cycle_rows", loop)):
        still = np.flatnonzero(np.all(np.diff(corners, axis=0) == 0.0, axis=1))
        if len(still):
            twice = f"{named_factors(columns, corners[still[0]])} occurs twice in a row"
            yield f"[history] {key}: {twice}; remove one"


def preload_legs(scene: Scene) -> list[str]:
    """Return the names of the scene's preloads in the order of their legs."""
    # parts are fitted before they are bolted
    return sorted(scene.preloads, key=lambda name: name != INTERFERENCE)


def _held(scene: Scene) -> Array:
    """Return the factors of what is kept: from zero, a leg for each preload, then the constants."""
    names, legs = scene.load_names, preload_legs(scene)
    rows = np.zeros((len(legs) + 2, len(names)))
    for row, name in enumerate(legs, start=1):
        rows[row:, names.index(name)] = scene.preloads[name]
    for bolt in scene.bolts:
        if bolt.tightening:
            rows[1:-1, names.index(bolt.name)] = bolt.tightening
            rows[-1, names.index(bolt.name)] = bolt.tightening[-1]
    for name, factor in scene.history.constant.items():
        rows[-1, names.index(name)] = factor
    return rows if np.any(list(scene.history.constant.values())) else rows[:-1]


def _table(options: HistoryOptions, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Return path and loop of a table of load factors, with columns in the order of names."""
    order = [options.columns.index(name) for name in names]
    rows, loop = (
        np.array(given, dtype=float).reshape(-1, len(order))[:, order]
        for given in (options.rows, options.cycle_rows)
    )
    rows = rows if len(rows) else loop[-1:]
    if np.any(rows[0] != 0.0):
        rows = np.vstack([np.zeros_like(rows[:1]), rows])
    if len(loop) and (np.any(loop[0] != rows[-1]) or len(loop) == 1):
        loop = np.vstack([rows[-1:], loop])
    return rows, loop


def _harmonic(options: HistoryOptions, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Return path and polygon of a harmonic history, the coarsest one without ``corners``."""
    loads = [options.harmonic[name] for name in names]
    mean, amplitude, phase = np.array([[o.mean, o.amplitude, o.phase] for o in loads]).T
    loop = mean + amplitude * cosdg(corner_angles(options, names)[:-1, None] - phase)
    path = np.vstack([np.zeros_like(mean), mean, loop[0]])
    moves = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0.0, axis=1)])
    return path[moves], np.vstack([loop, loop[:1]])


def is_straight(options: HistoryOptions) -> bool:
    """Return whether all loads are in phase or opposite, so that two corners are exact."""
    return len(_extremes(list(options.harmonic.values()))) == 2


def corner_angles(options: HistoryOptions, names: tuple[str, ...]) -> Array:
    """Return the angles of the corners in degrees, from the start of a cycle to its end."""
    loads = [options.harmonic[name] for name in names if name in options.harmonic]
    extremes = _extremes(loads)
    if len(extremes) > 2:
        corners = max(options.corners or FEWEST_CORNERS, len(extremes))
        arcs = np.diff(np.append(extremes, 360.0))
        pieces = zip(extremes, arcs, _shares(arcs / 360.0, corners), strict=True)
        extremes = np.concatenate([low + arc * np.arange(n) / n for low, arc, n in pieces])
    angles = next(load.phase for load in loads if load.amplitude) + extremes
    return np.append(angles, angles[0] + 360.0)


def _extremes(loads: list[Harmonic]) -> Array:
    """Return the angles of the loads' extremes, sorted, from 0 at the first load's maximum."""
    same = 1e-9  # difference of angles, in degrees, that counts as round-off
    phases = np.array([load.phase for load in loads if load.amplitude])
    angles = np.concatenate([phases, phases + 180.0]) - phases[0]
    # round-off below a full turn is the first angle again
    angles = np.sort(np.mod(angles + 0.5 * same, 360.0) - 0.5 * same)
    return angles[np.concatenate([[True], np.diff(angles) > same])]


def _shares(parts: Array, total: int) -> Ints:
    """Divide a number by parts of 1, at least 1 each; twice a number gives twice the shares."""
    if total % 2 == 0 and total // 2 >= max(FEWEST_CORNERS, len(parts)):
        return 2 * _shares(parts, total // 2)
    found = np.ones(len(parts), dtype=np.int64)
    while found.sum() < total:
        # to the part whose pieces are the longest
        found[np.argmax(parts / found)] += 1
    return found
