"""Zones of stick, slip and separation along the contact edge, and their widths.

A zone's end lies midway between its last node and the next one; the outermost zones end at the
outermost nodes. Axisymmetric, x is the radius and the first zone begins on the axis, unless the
contact edge does not reach it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.axis import begins_on_axis
from receding_fenicsx.interface.contact import STATE_NAMES, Array, State

TOUCHING = "contact"
"""Name of the zone that touches where there is no friction."""

Zone = tuple[str, float, float]
"""Name of the state, and the two ends."""


def zones(x: Array, state: NDArray[np.integer], axisymmetric: bool = False) -> list[Zone]:
    """Split the contact edge into zones of equal state.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.
        axisymmetric: x is the radius.

    Returns:
        The zones from the smallest x to the greatest; each begins where the one before ends.
    """
    if len(x) == 0:
        return []
    starts = np.flatnonzero(np.diff(state)) + 1
    begin = [0.0] if axisymmetric and begins_on_axis(x) else x[:1]
    ends = np.concatenate([begin, 0.5 * (x[starts - 1] + x[starts]), x[-1:]])
    first = np.concatenate([[0], starts])
    return [
        (STATE_NAMES[State(int(state[i]))], float(a), float(b))
        for i, a, b in zip(first, ends[:-1], ends[1:], strict=True)
    ]


def contact_zones(
    x: Array, state: NDArray[np.integer], f: Array, axisymmetric: bool = False
) -> list[Zone]:
    """Zones as :func:`zones` finds them; without friction what touches is called "contact".

    There nothing holds the nodes, and "stick" would tell of a limit that they do not have.
    """
    found = zones(x, state, axisymmetric)
    if np.any(f > 0.0):
        return found
    return [(TOUCHING if name == STATE_NAMES[State.STICK] else name, a, b) for name, a, b in found]


def contact_half_width(x: Array, state: NDArray[np.integer], axisymmetric: bool = False) -> float:
    """Half the distance between the ends of the outermost zones in contact; 0 without contact.

    Axisymmetric it is the radius of the outer end, on an edge that begins on the axis.
    """
    touching = [z for z in zones(x, state, axisymmetric) if z[0] != STATE_NAMES[State.SEPARATION]]
    if axisymmetric and begins_on_axis(x):
        return touching[-1][2] if touching else 0.0
    return 0.5 * (touching[-1][2] - touching[0][1]) if touching else 0.0


def stick_half_width(
    x: Array, state: NDArray[np.integer], f: Array | None = None, axisymmetric: bool = False
) -> float:
    """Half the width of the stick zone around the centre of the contact edge; 0 when there is none.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.
        f: (N,) coefficient of friction: nodes without friction do not stick.
        axisymmetric: x is the radius, the centre x = 0.

    Returns:
        The half width, axisymmetric the radius.
    """
    found = stick_zone(x, state, f, axisymmetric)
    if found is None:
        return 0.0
    left, right = _midway(x, *found)
    return right if axisymmetric and begins_on_axis(x) else 0.5 * (right - left)


def stick_zone(
    x: Array, state: NDArray[np.integer], f: Array | None = None, axisymmetric: bool = False
) -> tuple[int, int] | None:
    """First and last node of the stick zone around the centre of the contact edge, or None.

    The arguments are those of :func:`stick_half_width`.
    """
    if len(x) == 0:
        return None
    sticks = np.asarray(state) == State.STICK
    if f is not None:
        sticks &= np.asarray(f) > 0.0
    ends = np.append(np.flatnonzero(np.diff(sticks)), len(x) - 1)
    centre = 0.5 * (x[0] + x[-1])
    axisymmetric = axisymmetric and begins_on_axis(x)
    first = 0
    for last in ends:
        low, high = _midway(x, first, last)
        if sticks[first] and (first == 0 if axisymmetric else low <= centre <= high):
            return int(first), int(last)
        first = last + 1
    return None


def _midway(x: Array, first: int, last: int) -> tuple[float, float]:
    """Ends of the zone between two nodes."""
    low = 0.5 * (x[max(first - 1, 0)] + x[first])
    return float(low), float(0.5 * (x[last] + x[min(last + 1, len(x) - 1)]))


def pattern(found: Sequence[Zone]) -> list[str]:
    """Names of the zones in their order."""
    return [name for name, _, _ in found]
