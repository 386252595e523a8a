"""Diagram of Bree's kind: both limits over the mean of one load."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.interface.shakedown.limits import Certificates, lower_limit, upper_limit
from receding_fenicsx.interface.shakedown.margins import Margins
from receding_fenicsx.interface.shakedown.programs import minimise

POINTS, MANY_NODES, FEW_POINTS = 25, 60, 9
"""Mean loads of a diagram; fewer where more than ``MANY_NODES`` nodes need a program each."""
INSIDE = 1e-3
"""Distance of the outermost means from those that just can be held, over their interval."""


@dataclass(frozen=True)
class Diagram:
    """Limits over the mean of one load.

    Attributes:
        load: name of the load.
        mean: (n,) its mean load factors.
        lower, upper: (n,) limits; NaN where they were not found.
        given: the mean load factor of the scene.
    """

    load: str
    mean: Array
    lower: Array
    upper: Array
    given: float


def means(margins: Margins, load: int, width: float) -> Array:
    """Return changes of a mean load over which a residual slip holds the contact.

    Args:
        margins: margins with the scene's mean loads.
        load: number of the load.
        width: largest change.
    """
    ends = []
    for sign in (-1.0, 1.0):
        G = np.hstack([margins.G, sign * width * margins.by_load[:, [load]]])[: len(margins.kind)]
        cost = np.append(np.zeros(margins.G.shape[1]), -1.0)
        ends.append(sign * width * -minimise(cost, G, margins.c[: len(G)], 1.0).value)
    low, high = ends
    room = INSIDE * (high - low)
    n = POINTS if len(margins.targets) <= MANY_NODES else FEW_POINTS
    # a mean load that cannot vary leaves one point
    return np.linspace(low + room, high - room, n) if high > low else np.zeros(1)


def limits_at(margins: Margins, load: int, changes: Sequence[float]) -> list[tuple[float, float]]:
    """Return both limits for changes of one mean load; NaN where they were not found."""
    found = []
    proofs: Certificates = {}
    for change in changes:
        moved = replace(margins, c=margins.c + change * margins.by_load[:, load])
        low = top = np.nan
        # a point whose programs fail, or that no slip holds, is left out of the diagram
        with suppress(SolveError, InputError):
            upper = upper_limit(moved)
            top = -upper.value if upper.value < np.inf else np.nan
            lower, proofs = lower_limit(moved, upper, certificates=proofs)
            low = top if lower is None else min(lower.value, top)
        found.append((low * margins.range_scale, top * margins.range_scale))
    return found
