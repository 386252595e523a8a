"""Nodes on a limit that keep their state: ties, at which a path might go on otherwise.

At an instant of the path a stuck node may sit on a limit of friction, a node in contact be without
pressure, or an open one without gap, by symmetry or by chance, while another node changes its
state. No event tells of it; the certificate of uniqueness has to know.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK


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
