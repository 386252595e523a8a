"""Nodes that sit on a limit at an instant, and might go either way there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import Segments, States
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.system import Changes


def tied(
    segments: Segments, places: Array, states: NDArray[np.int8], on: NDArray[np.bool_]
) -> Changes:
    """Return the ties of several instants, as changes to the state that a node may take as well.

    That is a direction of slip, or SEPARATION where it has neither gap nor pressure and may take
    any.

    Args:
        segments: of the condensed body.
        places: (k,) of the instants.
        states: (k, N) states.
        on: (k, 3N) gap, A and B that are within round-off of zero, B of nodes without friction too.
    """
    n, frictional = segments.system.n, segments.frictional
    gap, A, B = on[:, :n], on[:, n : 2 * n], on[:, 2 * n :]
    touches = np.where(states == SEPARATION, gap, A & B)
    near = touches | (A | B) & (states == STICK) & frictional
    near &= frictional | segments.smooth
    rows, nodes = near.nonzero()
    if not len(rows):
        return Changes.none()
    side = np.where(A[rows, nodes], FORWARD, BACKWARD)
    other = np.where(touches[rows, nodes], SEPARATION, side)
    return Changes(places[rows], nodes, states[rows, nodes], other.astype(np.int8))


def ties_at(segments: Segments, s: float, y: Array, state: States, force_scale: float) -> Changes:
    """Return the ties at one place, with quantities y (4N,) and states (N,), see :func:`tied`."""
    n = len(state)
    on = y[n:] <= segments.limit[n:] * force_scale
    return tied(segments, np.array([s]), state[None], on[None])
