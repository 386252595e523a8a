"""Decay of the residual over the sweeps: over-relaxation and stalled sweeps are judged by it."""

from __future__ import annotations

import numpy as np

STALLED_GAIN = 0.1
"""Part of the residual that is left after ``stalled_sweeps`` where sweeps lead to an end."""

GROWN = 10.0
"""Growth of the residual, over its smallest value, above which sweeps go on without
over-relaxation."""

SWEEPS_PER_NODE = 10
"""Sweeps for each node of a large contact that count as one gain: plain ones carry a change on by
about one node."""


class Gain:
    """Smallest residual so far and the sweep of its last reduction to ``STALLED_GAIN``."""

    def __init__(self, sweeps: int, nodes: int) -> None:
        """Wait for a number of sweeps without a reduction, in a large contact for more."""
        self.patience, self.best = max(sweeps, SWEEPS_PER_NODE * nodes), np.inf
        self.gained, self.gained_at = np.inf, 0

    def has_grown(self, residual: float) -> bool:
        """Return whether the residual is well above the smallest one before."""
        grown = residual > GROWN * self.best
        self.best = min(self.best, residual)
        return grown

    def has_stalled(self, residual: float, sweep: int) -> bool:
        """Return whether the last reduction is too many sweeps ago."""
        if residual < STALLED_GAIN * self.gained:
            self.gained, self.gained_at = residual, sweep
            return False
        return sweep - self.gained_at >= self.patience
