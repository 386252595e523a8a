"""Drift of a body along the rigid motions that the states of its contact leave free.

The loads do not determine how far such a body drifts; the contact law bounds it: it must not
penetrate its ground, nor turn a slip round. Of all drifts that keep the law the least is taken.
"""

from __future__ import annotations

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import Segment, Segments, States
from receding_fenicsx.interface.law import SLIP_SIGN
from receding_fenicsx.interface.tolerances import RIGID_TOLERANCE


def drifting(
    segments: Segments,
    segment: Segment,
    state: States,
    direction: Array,
    touching: NDArray[np.intp],
) -> Segment:
    """Return rates with the least drift that keeps touching nodes from penetrating.

    Args:
        segments: of the condensed body.
        segment: rates without drift.
        state: (N,) states.
        direction: (n_loads,) change of the load factors on the leg.
        touching: separated nodes whose gap is zero and must not fall.
    """
    q = segment.q.copy()
    q[: 2 * len(state)] = drifted(segments, q[: 2 * len(state)], state, touching)
    return segments.segment(state, q, direction)


def drifted(segments: Segments, change: Array, state: States, touching: NDArray[np.intp]) -> Array:
    """Add the least drift with which slips keep their directions and gaps do not fall.

    Args:
        segments: of the condensed body.
        change: (2N,) displacements, or their rates, without drift.
        state: (N,) states.
        touching: separated nodes whose gap must not fall.

    Returns:
        (2N,) displacements; unchanged where no drift will do.
    """
    motion = segments.free_motions(state)
    slipping = np.flatnonzero(segments.frictional & (SLIP_SIGN[state] != 0.0))
    rows = np.concatenate([slipping, len(state) + touching])
    if motion.shape[1] == 0 or len(rows) == 0:
        return change
    sign = np.concatenate([SLIP_SIGN[state[slipping]], np.ones(len(touching))])
    drift = _least(sign[:, None] * motion[rows], -sign * change[rows])
    return change if drift is None else change + motion @ drift


def _least(rows: Array, bounds: Array) -> Array | None:
    """Minimise |c| with rows c >= bounds; None where no c satisfies it.

    Least distance programming by non-negative least squares (C. L. Lawson and R. J. Hanson,
    Solving least squares problems, 1974, chapter 23).
    """
    size = float(np.abs(bounds).max())
    if size == 0.0:
        return np.zeros(rows.shape[1])
    system = np.vstack([rows.T, bounds / size])
    multipliers, distance = scipy.optimize.nnls(system, np.append(np.zeros(rows.shape[1]), 1.0))
    if distance <= RIGID_TOLERANCE:
        return None
    left = system @ multipliers
    c: Array = size * left[:-1] / (1.0 - left[-1])
    return c
