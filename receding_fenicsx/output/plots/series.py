"""Data of figures: requested cycles, legs and nodes; paths through a cycle; slip per cycle."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints, over_largest, spread
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.steady import PowerLaw, fit_power_law
from receding_fenicsx.scene.history import corner_angles, is_straight


def leg_ends(record: Record, cycle: int, leg: int) -> tuple[Array, Array]:
    """Return load factors (n_loads,) at the start and the end of a leg."""
    table = record.turning_points
    row = int(np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0])
    return table.load[row - 1] if row else np.zeros_like(table.load[0]), table.load[row]


def legs_of(record: Record, cycle: int) -> list[tuple[int, int]]:
    """Return (cycle, leg) of the legs of a cycle that have samples."""
    table = record.samples
    return [(cycle, int(leg)) for leg in np.unique(table.leg[table.cycle == cycle])]


def is_unloading(record: Record, cycle: int, leg: int) -> bool:
    """Return whether the sum of the absolute loads, each over its largest, falls along a leg."""
    ends = over_largest(np.array(leg_ends(record, cycle, leg)), record.turning_points.load)
    return bool(np.diff(np.abs(ends).sum(axis=1))[0] < 0.0)


def first_unloading(record: Record) -> tuple[int, int] | None:
    """Return cycle and leg of the first unloading; None without one, or of many short legs."""
    table = record.turning_points
    for where in zip(table.cycle.tolist(), table.leg.tolist(), strict=True):
        if is_unloading(record, *where):
            # a cycle of more legs than these is a curve rather than loading and unloading
            return where if np.count_nonzero(table.cycle == where[0]) <= 12 else None
    return None


def phases(record: Record) -> Array | None:
    """Return the angles in degrees at the ends of a cycle's legs; None unless it is an ellipse."""
    scene = record.scene
    if scene is None or scene.history.kind != "harmonic" or is_straight(scene.history):
        return None
    angles = corner_angles(scene.history, scene.driven_names)
    whole = np.all(np.bincount(record.turning_points.cycle)[1:] == len(angles) - 1)
    return angles if whole else None


def sampled_cycles(record: Record) -> list[int]:
    """Return the cycles that the record holds samples of."""
    return [int(cycle) for cycle in np.unique(record.samples.cycle)]


def requested_cycles(record: Record, asked: int | Iterable[int]) -> list[int]:
    """Return the requested cycles, one or several; refuse none, and those without samples."""
    found, known = whole_numbers(asked, "cycle"), sampled_cycles(record)
    for cycle in found:
        if cycle not in known:
            raise InputError(
                f"cycle {cycle}: the record has no samples of it, only of {known}; name it in "
                "[output] cycles"
            )
    if not found:
        raise InputError(f"cycles: name some of {known}")
    return found


def requested_legs(record: Record, asked: int | Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the requested legs as (cycle, leg); of a cycle all; refuse those without samples."""
    if not isinstance(asked, Iterable) or isinstance(asked, str):
        return legs_of(record, *requested_cycles(record, asked))
    found = [whole_numbers(pair, "leg") for pair in asked]
    if not found or any(len(pair) != 2 for pair in found):
        raise InputError(f"legs {asked!r}: give a cycle, or a list of (cycle, leg), legs from 0")
    for cycle, leg in found:
        known = legs_of(record, *requested_cycles(record, cycle))
        if (cycle, leg) not in known:
            numbers = [k for _, k in known]
            raise InputError(f"cycle {cycle}, leg {leg}: has no such leg, only {numbers}")
    return [(cycle, leg) for cycle, leg in found]


def whole_numbers(asked: Any, what: str) -> list[int]:
    """Return one or several whole numbers as a list."""
    several = isinstance(asked, Iterable) and not isinstance(asked, str)
    try:
        return [operator.index(value) for value in (asked if several else [asked])]
    except TypeError:
        raise InputError(f"{what} {asked!r}: must be a whole number") from None


@dataclass(frozen=True)
class Loop:
    """n instants of one cycle in order of time, from the end of the cycle before, or from rest."""

    cycle: int
    load: Array  # (n, n_loads) load factors
    displacement: Array  # (n, n_loads) displacements conjugate to them
    # (n_loads,) -1 for forces, +1 for prescribed displacements, whose conjugates are forces times
    # the displacements at factor 1
    load_sign: Array
    p: Array  # (n, N), as q, v and w
    q: Array
    v: Array
    w: Array
    turning: NDArray[np.bool_]  # (n,) True at turning points

    def area(self) -> Array:
        r"""(n_loads,) work of each load over the closed cycle; their sum is the dissipation.

        The trapezoidal rule on the samples is exact if no node changes its state between them.
        """
        mean = 0.5 * (self.load[1:] + self.load[:-1])
        return -self.load_sign * np.sum(mean * np.diff(self.displacement, axis=0), axis=0)


def loop_of(record: Record, cycle: int) -> Loop:
    """Return a sampled cycle's path."""
    requested_cycles(record, cycle)
    points, samples = record.turning_points, record.samples
    before, ends = np.flatnonzero(points.cycle < cycle)[-1:], points.cycle == cycle
    turning = np.append(before, np.flatnonzero(ends))
    inside = (samples.cycle == cycle) & (samples.s > 0.0) & (samples.s < 1.0)
    inside &= np.isin(samples.leg, points.leg[ends])
    # at rest all is zero, but for an initial slip
    slipped = record.scene is not None and record.scene.history.initial_slip is not None
    rest = 0 if len(before) or slipped else 1
    order, (load, moved, p, q, v, w) = in_time(record, rest, turning, inside)
    turns = np.pad(order < len(turning), (rest, 0))
    return Loop(cycle, load, moved, record.load_sign, p, q, v, w, turns)


def in_time(
    record: Record, rest: int = 1, turning: Any = slice(None), inside: Any = slice(None)
) -> tuple[Ints, list[Array]]:
    """Return the order in time of turning points and samples, and loads, U, p, q, v, w in it.

    Before them are rows of zeros: the state at ``rest``.
    """

    def join(name: str) -> Array:
        tables = (record.turning_points, turning), (record.samples, inside)
        return np.concatenate([getattr(table, name)[rows] for table, rows in tables])

    order = np.lexsort([join(name) for name in ("s", "leg", "cycle")])
    names = "load", "load_displacement", "p", "q", "v", "w"
    return order, [np.pad(join(name)[order], [(rest, 0), (0, 0)]) for name in names]


def paths_of(record: Record, cycles: int | Iterable[int] | None = None) -> list[Loop]:
    """Return the paths of cycles, by default of the first loading, first and last cycle sampled."""
    sampled = sampled_cycles(record)
    chosen = {*sampled[:2], *sampled[-1:]}
    requested = sorted(chosen) if cycles is None else requested_cycles(record, cycles)
    return [loop_of(record, cycle) for cycle in requested]


def representative_nodes(record: Record) -> list[int]:
    """Choose up to 4 nodes with different paths, x > 0 if half of the body was modelled.

    In the last sampled cycle: the one with the largest dissipation, the middle ones of those that
    separate and of those that always stick, and others between them.
    """
    rows = np.isin(record.samples.cycle, sampled_cycles(record)[-1:])
    state, force = record.samples.state[rows], record.samples.P[rows]
    # less of the largest nodal force is round-off
    usable = np.any(force > 1e-6 * force.max(initial=0.0), axis=0) & (record.weight > 0.0)
    if record.half and np.any(usable & (record.x > 0.0)):
        usable &= record.x > 0.0
    if not np.any(usable):
        return []
    chosen = set()
    density = record.cycles.dissipation_density[-1:]
    if np.any(density > 0.0):
        chosen.add(int(np.argmax(np.where(usable, density[0], -1.0))))
    for kind in (np.any(state == State.SEPARATION, axis=0), np.all(state == State.STICK, axis=0)):
        nodes = np.flatnonzero(usable & kind)
        chosen |= {int(nodes[len(nodes) // 2])} if len(nodes) else set()
    between = np.flatnonzero(usable)
    if len(chosen) > 1:
        between = between[(between > min(chosen)) & (between < max(chosen))]
    missing = min(4 - len(chosen), len(between))
    for part in (np.arange(missing) + 1.0) / (missing + 1.0):
        chosen.add(int(between[round(part * (len(between) - 1))]))
    return sorted(chosen, key=lambda i: float(record.x[i]))


@dataclass(frozen=True)
class SlipLine:
    """Slip per cycle of one node."""

    node: int
    x: float  # its position over the length scale
    N: Array  # cycles in which it slips by more than round-off
    slip: Array  # its absolute slip in them, over the slip scale
    fit: PowerLaw  # power law over the fitted cycles
    factor: float  # value of the fit at N = 1


def slip_lines(record: Record, length: float = 1.0, unit: float = 1.0) -> list[SlipLine]:
    """Return slip per cycle over ``unit`` at up to 4 nodes that slip in every fitted cycle.

    Those with 0.5 <= x/length <= 0.8 if there are any; none when there are too few cycles.
    """
    cycles = fitted_cycles(record)
    size = np.abs(record.cycles.slip_increment)
    if len(cycles) < 5 or not size.any():
        return []
    seen = size > 1e-9 * size.max()  # less is round-off
    moving = np.all(seen[cycles - 1], axis=0)
    distance = record.x / length
    # positions have round-off
    wanted = moving & (distance >= 0.5 - 1e-6) & (distance <= 0.8 + 1e-6)
    nodes = np.flatnonzero(wanted if wanted.any() else moving)
    lines = []
    for i in spread(nodes, 4) if len(nodes) else ():
        values = size[cycles - 1, i] / unit
        fit = fit_power_law(cycles.astype(float), values)
        factor = float(np.exp(np.mean(np.log(values) - fit.exponent * np.log(cycles))))
        N = np.flatnonzero(seen[:, i]) + 1
        slip = size[N - 1, i] / unit
        lines.append(SlipLine(int(i), float(distance[i]), N.astype(float), slip, fit, factor))
    return lines


def fitted_cycles(record: Record) -> Ints:
    """Return the cycles of the fits: 4 to 20, or the later half of fewer."""
    # earlier cycles do not follow a power law, later increments are small
    n = len(record.cycles.slip_increment)
    return np.arange(4, 21) if n >= 20 else np.arange(max(n // 2, 1), n + 1)
