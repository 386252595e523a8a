"""Zones of stick, slip and separation along the contact edge, and their widths.

A zone's end lies midway between its last node and the next one; the outermost zones end at the
outermost nodes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.contact import STATE_NAMES, Array, State

Zone = tuple[str, float, float]
"""Name of the state, and the two ends."""


def zones(x: Array, state: NDArray[np.integer]) -> list[Zone]:
    """Split the contact edge into zones of equal state.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.

    Returns:
        The zones from the smallest x to the greatest; each begins where the one before ends.
    """
    if len(x) == 0:
        return []
    starts = np.flatnonzero(np.diff(state)) + 1
    ends = np.concatenate([x[:1], 0.5 * (x[starts - 1] + x[starts]), x[-1:]])
    first = np.concatenate([[0], starts])
    return [
        (STATE_NAMES[State(int(state[i]))], float(a), float(b))
        for i, a, b in zip(first, ends[:-1], ends[1:], strict=True)
    ]


def contact_half_width(x: Array, state: NDArray[np.integer]) -> float:
    """Half the distance between the ends of the outermost zones in contact; 0 without contact."""
    touching = [z for z in zones(x, state) if z[0] != STATE_NAMES[State.SEPARATION]]
    return 0.5 * (touching[-1][2] - touching[0][1]) if touching else 0.0


def stick_half_width(x: Array, state: NDArray[np.integer], f: Array | None = None) -> float:
    """Half the width of the stick zone around the centre of the contact edge; 0 when there is none.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.
        f: (N,) coefficient of friction: nodes without friction do not stick.

    Returns:
        The half width.
    """
    if len(x) == 0:
        return 0.0
    sticks = np.asarray(state) == State.STICK
    if f is not None:
        sticks &= np.asarray(f) > 0.0
    centre = 0.5 * (x[0] + x[-1])
    for name, a, b in zones(x, np.where(sticks, State.STICK, State.SEPARATION)):
        if name == STATE_NAMES[State.STICK] and a <= centre <= b:
            return 0.5 * (b - a)
    return 0.0


def pattern(found: Sequence[Zone]) -> list[str]:
    """Names of the zones in their order."""
    return [name for name, _, _ in found]
