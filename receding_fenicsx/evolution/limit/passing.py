"""Whether nodes pass a limit on the way to it: slip does not go back."""

from __future__ import annotations

from itertools import islice

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.limit.drifts import OVERSHOT, Drifts
from receding_fenicsx.evolution.limit.foresight import Expected, cycles_to_come, slowed
from receding_fenicsx.evolution.limit.frozen import NoLimit

MAX_DRIFTING = 20_000
"""Cycles of drifts, to first order, after which a limit counts as passed: it is not shown."""

SAME_SHAPE = 0.01
"""Force, over ``OVERSHOT``, by which drifts of one shape may change but for their size."""

LOOKED_AT = 4
"""Cycles of drifts after which they are looked at."""

CLEAR = 0.02
""":func:`clearance` below which a node may pass its limit: the first order is not exact."""

DOUBT = 8.0
"""Factor by which what is foreseen after two or three cycles may be wrong far ahead: drifts that
decay alike at the limit, but not at first, have come to differ tenfold after fifty cycles."""

PARTS_OF_DOUBT = (1.0, 0.75, 0.5, 0.33, 0.25, 0.17, 0.08)
"""Parts of the doubt, as exponents, of which the largest that agrees with what is seen is taken."""

WAVES = (1.0, 2.0)
"""Half waves along the contact of the errors of what nodes lack."""


def is_robust(expected: Expected, drifts: Drifts, force: float, doubt: float = DOUBT) -> bool:
    """Return whether no node passes the limit though drifts are foreseen wrongly.

    That none does as foreseen is for :func:`clearance` to tell. The first order is not exact while
    the drifts are large. So the nodes are taken to slip on as much less than ``expected`` as they
    did in the last cycle. And what they lack is taken larger at one end of the contact and smaller
    at the other, by the factor ``doubt``, and the reverse; by less where nodes would slip at once
    that are known to rest.
    """
    late = slowed(expected, drifts)
    if np.any(late.pace < 1.0) and _is_passed(late, force):
        return False
    rest, none = drifts.limit <= 0.0, -OVERSHOT * force
    seen = np.minimum(drifts.margins[0], 0.0)[rest] + none
    wave = np.cos(np.pi * _places(drifts))
    for exponents in (wave, -wave):
        for part in PARTS_OF_DOUBT:
            wrong = drifts.lacking(doubt ** (part * exponents))
            if np.all(wrong.margins[0][rest] >= seen):
                break
        if _is_passed(wrong, force):
            return False
    return True


def _is_passed(drifts: Drifts, force: float) -> bool:
    """Return whether a node passes the limit, or which ones slip on the way is not decided."""
    try:
        return clearance(drifts, force, least=0.0) < 0.0
    except NoLimit:
        return True


def clearance(drifts: Drifts, force: float, part: float = 0.0, least: float = CLEAR) -> float:
    """Return how clear of passing the limit the nodes stay on the way to it; -1 where one does.

    Slip does not go back: where a node passes its limit while others still drift, their slips may
    leave it a margin. The distance from that after a cycle is given over what its margin changes
    if others lack more or less of their limits at the cycle's start, in waves along the contact:
    the smallest one, or the first below ``least``. -1 also for drifts of more than ``MAX_DRIFTING``
    cycles.

    Args:
        drifts: drifts to the limit.
        force: largest nodal force of the history.
        part: part of the largest drift by which nodes may pass it; then all else is clear.
        least: clearance that is enough.

    Raises:
        NoLimit: the slips of a cycle were not found.
    """
    if np.any(np.diagonal(drifts.M) <= 0.0):
        return -1.0
    limit, margins, M = drifts.limit, drifts.margins, drifts.responses[-1]
    stiffness, clear = np.abs(np.diagonal(M)), 1.0
    allowed = OVERSHOT * force + part * limit.max() * stiffness
    waves = np.cos(np.pi * np.outer(_places(drifts), WAVES))
    before, shape = _left(limit, drifts.begun), np.zeros(2 * len(limit))
    for cycle, (y, m) in enumerate(islice(cycles_to_come(drifts), MAX_DRIFTING)):
        left = _left(limit, y)
        if cycle % LOOKED_AT == 0:
            lack = np.maximum(before, 0.0)[:, None]
            lasting = margins[min(cycle, len(margins) - 1)] - margins[-1]
            unsure = np.abs(M @ (waves * lack) - waves * (M @ lack)).max(axis=1) + np.abs(lasting)
            passed = stiffness * left + allowed
            distance = passed + np.maximum(m, 0.0)
            if np.any(passed < 0.0):
                return -1.0
            if not part:
                clear = min(clear, float((distance / np.maximum(unsure, allowed)).min()))
            both = np.append(stiffness * left, lasting)
            largest = float(np.abs(both).max())
            last, shape = shape, both / max(largest, OVERSHOT * force)
            # drifts and memories of one shape that only become smaller stay as clear as they are
            settled = largest * np.abs(shape - last).max() <= SAME_SHAPE * OVERSHOT * force
            if clear < least or settled or np.all(unsure <= allowed):
                return clear
        before = left
    return -1.0


def _places(drifts: Drifts) -> Array:
    """Return (2k,) places of the drifts along the contact, from 0 to 1."""
    return np.tile(np.linspace(0.0, 1.0, len(drifts.stiffness)), 2)


def _left(limit: Array, y: Array) -> Array:
    """Return what the drifts y (2k,) lack of the limit.

    A node that drifts to it may slip back on the way; one that does not drift must not slip at all.
    """
    drifts, back = limit > 0.0, np.roll(limit, len(limit) // 2) > 0.0
    left: Array = limit - y + np.where(drifts, np.roll(y, len(y) // 2), 0.0)
    left[back] = 0.0
    return left
