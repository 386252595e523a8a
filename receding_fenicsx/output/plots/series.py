"""Data of figures: legs, slip per cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.steady import PowerLaw, fit_power_law
from receding_fenicsx.scene.history.harmonic import corner_angles, is_straight

SLIP_CYCLES = (4, 20)
"""Cycles N of the fit: earlier ones do not follow a power law, later increments are small."""
SLIP_NODES = (0.5, 0.8)
"""Range of |x| over the length scale of nodes that are drawn before others."""
POSITION_TOLERANCE = 1e-6
"""Round-off of the representative nodes' positions, over the length scale."""
MAX_LINES = 4
"""Largest number of nodes in the figure of slip per cycle."""
CURVED_LEGS = 12
"""Number of legs above which a cycle is a curve rather than loading and unloading."""


@dataclass(frozen=True)
class SlipLine:
    """Slip per cycle of one node.

    Attributes:
        node: the node.
        x: its position over the length scale.
        N: cycles in which it slips by more than round-off.
        slip: its absolute slip in them, over the slip scale.
        fit: power law over the fitted cycles.
        factor: value of the fit at N = 1.
    """

    node: int
    x: float
    N: Array
    slip: Array
    fit: PowerLaw
    factor: float

    def at(self, N: Array) -> Array:
        """Values of the fit."""
        return self.factor * N**self.fit.exponent


def leg_ends(record: Record, cycle: int, leg: int) -> tuple[Array, Array]:
    """Return load factors (n_loads,) at the start and the end of a leg."""
    row = leg_row(record, cycle, leg)
    end = record.turning_points.load[row]
    return record.turning_points.load[row - 1] if row else np.zeros_like(end), end


def leg_row(record: Record, cycle: int, leg: int) -> int:
    """Return the row of the turning points at which a leg ends."""
    table = record.turning_points
    return int(np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0])


def legs_of(record: Record, cycle: int) -> list[tuple[int, int]]:
    """Return (cycle, leg) of the legs of a cycle that have samples."""
    table = record.samples
    return [(cycle, int(leg)) for leg in np.unique(table.leg[table.cycle == cycle])]


def is_unloading(record: Record, cycle: int, leg: int) -> bool:
    """Return whether the sum of the absolute loads falls along a leg."""
    begin, end = leg_ends(record, cycle, leg)
    return bool(np.abs(end).sum() < np.abs(begin).sum())


def first_unloading(record: Record) -> tuple[int, int] | None:
    """Return cycle and leg of the first unloading; None without one.

    One leg of a cycle of more than ``CURVED_LEGS`` legs is a short piece of a curve, and not shown.
    """
    table = record.turning_points
    for where in zip(table.cycle.tolist(), table.leg.tolist(), strict=True):
        if is_unloading(record, *where):
            legs = np.count_nonzero(table.cycle == where[0])
            return where if legs <= CURVED_LEGS else None
    return None


def phases(record: Record) -> Array | None:
    """Return the angles in degrees at the ends of the legs of a cycle, from its start on.

    None where the history is not harmonic, or where its loads are in phase or opposite: its two
    legs are not an ellipse.
    """
    scene = record.scene
    if scene is None or scene.history.kind != "harmonic" or is_straight(scene.history):
        return None
    angles = corner_angles(scene.history, scene.driven_names)
    return (
        angles if np.all(np.bincount(record.turning_points.cycle)[1:] == len(angles) - 1) else None
    )


def slip_lines(record: Record, length: float = 1.0, unit: float = 1.0) -> list[SlipLine]:
    """Return slip per cycle at representative nodes with fitted powers of N.

    Args:
        record: the record.
        length: length scale; nodes with 0.5 <= |x|/length <= 0.8 are representative where any of
            them slips in every fitted cycle, otherwise all that do.
        unit: what slip is divided by.

    Returns:
        Up to ``MAX_LINES`` nodes spread evenly; none when there are too few cycles.
    """
    cycles = fitted_cycles(record)
    size = np.abs(record.cycles.slip_increment)
    # smallest number of cycles for the fit of a power law
    if len(cycles) < 5 or not size.any():
        return []
    # part of the largest increment below which an increment is round-off
    seen = size > 1e-9 * size.max()
    moving = np.all(seen[cycles - 1], axis=0)
    distance = record.x / length
    low, high = SLIP_NODES[0] - POSITION_TOLERANCE, SLIP_NODES[1] + POSITION_TOLERANCE
    wanted = moving & (distance >= low) & (distance <= high)
    nodes = np.flatnonzero(wanted if wanted.any() else moving)
    if not len(nodes):
        return []
    chosen = nodes[np.unique(np.linspace(0, len(nodes) - 1, MAX_LINES).round().astype(int))]
    lines = []
    for i in chosen:
        values = size[cycles - 1, i] / unit
        fit = fit_power_law(cycles.astype(float), values)
        factor = np.exp(np.mean(np.log(values) - fit.exponent * np.log(cycles)))
        N = np.flatnonzero(seen[:, i]) + 1
        slip = size[N - 1, i] / unit
        lines.append(
            SlipLine(int(i), float(distance[i]), N.astype(float), slip, fit, float(factor))
        )
    return lines


def fitted_cycles(record: Record) -> Ints:
    """Return the cycles of the fits: ``SLIP_CYCLES``, or the later half."""
    n = len(record.cycles.slip_increment)
    first, last = SLIP_CYCLES
    return np.arange(first, last + 1) if n >= last else np.arange(n // 2, n + 1)[n // 2 == 0 :]
