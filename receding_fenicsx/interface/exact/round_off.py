"""Effect of round-off on the displacements of a leg."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.segments import EPSILON, Segments
from receding_fenicsx.interface.residual import limit_excuse, residual_at_rest
from receding_fenicsx.interface.system import Changes, ContactState
from receding_fenicsx.interface.tolerances import ROUND_OFFS

SIGN_PATTERNS = 8
"""Random sign patterns of round-off by which its effect on the displacements is estimated."""

ESTIMATED_STATES = 64
"""Last sets of states on a leg in which that effect is estimated."""

INHERITED_RESIDUAL = 2.0
"""Residual accepted over that of the leg's start, as a factor: stuck nodes keep its errors."""


def displacement_uncertainty(
    segments: Segments,
    ends: tuple[ContactState, ContactState],
    events: Changes,
    force_scale: float,
) -> float:
    """Return the residual that round-off may leave in gaps and slips, over the force scale.

    Displacements are uncertain by the response of the body to round-off of the reactions: in a
    nearly singular body far more than the forces are. Stuck nodes keep the error of the start.

    Args:
        segments: of the condensed body.
        ends: states at the leg's start and end.
        events: changes of state on the leg.
        force_scale: largest nodal force of the history so far.
    """
    n, weight = segments.system.n, segments.weight
    reach: Array = np.abs(segments.system.K) @ np.max([np.abs(end.u) for end in ends], axis=0)
    signs = np.random.default_rng(0).choice([-EPSILON, EPSILON], (SIGN_PATTERNS, 2 * n))
    now = ends[0].state.copy()
    met = {now.tobytes(): now.copy()}
    for _, i, _, new in events:
        now[i] = new
        met[now.tobytes()] = now.copy()
    largest = 0.0
    for state in list(met.values())[-ESTIMATED_STATES:]:
        tableau = segments.tableau(state)
        for error in signs * reach:
            change = tableau.correction(error)[: 2 * n] * weight[: 2 * n]
            largest = max(largest, float(np.abs(change).max()))
    inherited = INHERITED_RESIDUAL * residual_at_rest(segments.system, ends[0], force_scale)
    excused = max(inherited, ROUND_OFFS * largest / force_scale)
    return limit_excuse(segments.system, excused, [end.u for end in ends], force_scale)
