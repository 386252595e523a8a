"""Nodes that reach the friction limit in a cycle without slipping (the paper's Fig. 9, dashed)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.contact import State
from receding_fenicsx.output.record import Record

NEGLIGIBLE_SLIP = 1e-5
"""Slip in a cycle, over the largest of any node, below which a node does not slip to speak of.

The steady state is approached for ever: until then nodes on the limit creep a little."""

LIMIT_REACHED = 1.0 - 1e-6
"""|Q| / (f P) from which a sampled node counts as being on the friction limit."""


def limit_without_slip(record: Record, cycle: int) -> NDArray[np.bool_]:
    """Find nodes that stay in contact, reach |Q| = f P in a cycle, and do not slip to speak of.

    Args:
        record: the record; the cycle must be among the sampled ones.
        cycle: the cycle.

    Returns:
        (N,) True at such nodes.
    """
    samples, events = record.samples, record.events
    rows = samples.cycle == cycle
    if not rows.any():
        return np.zeros(len(record.x), dtype=bool)
    P, Q = samples.P[rows], samples.Q[rows]
    pressed = (P > 0.0).all(axis=0) & (record.f > 0.0)
    ratio = np.abs(Q) / np.where(P > 0.0, np.maximum(record.f * P, np.finfo(float).tiny), np.inf)
    reached = (ratio >= LIMIT_REACHED).any(axis=0)
    slips = np.isin(events.new, (State.FORWARD_SLIP, State.BACKWARD_SLIP))
    reached[events.node[(events.cycle == cycle) & slips]] = True
    slip = np.ptp(samples.v[rows], axis=0)
    little: NDArray[np.bool_] = slip <= NEGLIGIBLE_SLIP * slip.max(initial=0.0)
    return reached & pressed & little
