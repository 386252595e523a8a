"""Drifts of nodes to a limit: what a slip changes, what they lack, and whether they come there."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.limit.frozen import Frozen
from receding_fenicsx.evolution.limit.frozen_cycle import MovedCycle
from receding_fenicsx.evolution.limit.newton import Solution, margin_rows

OVERSHOT = 1e-10
"""Force that a drift lacks or has too much, over the largest nodal force, that is none."""

ROUND_OFF = 1e-3
"""Part of it that is round-off."""


SAME_SHAPE = 0.3
"""Change of the logarithm of a drift beside those of others, until it is none, that is none. With
two decays 1 is enough; three may hide each other for some cycles."""


def at_risk(frozen: Frozen, solution: Solution, moved: MovedCycle) -> Ints:
    """Return frozen nodes without drift whose margins may vanish while others drift.

    While the others lack any parts of their drifts x, a margin is at least
    m* - sum over j of |dm/dx_j x_j|.
    """
    still = np.flatnonzero(~np.isin(frozen.nodes, frozen.shifted))
    rest, m = frozen.nodes[still], solution.margins.of(still)
    risk = np.zeros(len(rest), dtype=bool)
    for sign, margin, at in ((1.0, m.A, m.at_A), (-1.0, m.B, m.at_B)):
        rows = margin_rows(frozen, solution.cycle, rest, np.full(len(rest), sign), at)
        risk |= margin < np.abs(rows.moved(moved, frozen.shifted) * solution.shifts).sum(axis=1)
    return rest[risk]


def derivatives(frozen: Frozen, solution: Solution, moved: MovedCycle) -> Array:
    """Return the derivatives (k, k) of the margins in the drifts, both towards the nearer limit."""
    nodes = frozen.shifted
    m = solution.margins.of(np.searchsorted(frozen.nodes, nodes))
    forward = (solution.active > 0) | ((solution.active == 0) & (m.A < m.B))
    signs = np.where(forward, 1.0, -1.0)
    rows = margin_rows(frozen, solution.cycle, nodes, signs, np.where(forward, m.at_A, m.at_B))
    M: Array = rows.moved(moved, nodes) * signs
    return M


def has_settled(lacking: Array, least: Array) -> bool:
    """Return whether nodes come to their limit, and none of them slips beyond it.

    Near the limit the map from what nodes lack to what they lack a cycle later is piecewise linear
    and homogeneous, whatever the order of the events: what keeps its shape in a cycle keeps it for
    ever, and only becomes smaller. A node passes its limit only if it comes to lack nothing while
    others still lack something; the shape then changes. With the changes ln r_i of the logarithms
    of what nodes lack in a cycle, all have come to ``least`` after N cycles, and

        sum over N cycles of (max ln r - min ln r) < c,
        sum over N cycles of max |change of ln r_i from cycle to cycle| < -max ln r,

    c being ``SAME_SHAPE``, where both go on to grow by the factor by which they have grown in the
    last cycle. Where a node lacks A a^n - C b^n, a < b, beside one that lacks b^n, it passes at n =
    ln(A/C) / ln(b/a); ln r differs by A/(A - C) ln(b/a), and the product is x ln x / (x - 1) > 1
    with x = A/C. Where the slower decay does not show yet, the difference grows by b/a in a cycle.
    The second condition excludes that nodes come to rest before: there ln r tends to 0.

    Args:
        lacking: (4, k) what the nodes lack at the ends of four cycles, negative beyond the limit.
        least: (k,) of it that is none.
    """
    far = np.abs(lacking[-1]) > least
    if not np.any(far):
        return True
    left, least = lacking[:, far], least[far]
    if len(left) < 4 or np.all(np.abs(left[-1] - left[-2]) <= least) or np.any(left == 0.0):
        return False
    ratio = left[1:] / left[:-1]
    if np.any(ratio <= 0.0) or ratio[-1].max() >= 1.0:
        return False
    ln_r = np.log(ratio)
    slowest, changes = float(ln_r[-1].max()), np.abs(np.diff(ln_r, axis=0)).max(axis=1)
    cycles = float(np.log(np.abs(left[-1]) / least).max()) / -slowest
    # what round-off makes of ln r
    none = float((ROUND_OFF * least / np.abs(left[-1])).max())

    def summed(before: float, now: float) -> float:
        growth = np.log(max(1.0, (now + none) / (before + none)))
        times = np.expm1(min(cycles * growth, 99.0)) / np.expm1(growth) if growth else cycles
        return float(max(now - none, 0.0) * times)

    differ = np.ptp(ln_r, axis=1)
    shape, pace = summed(differ[-2], differ[-1]), summed(changes[0], changes[1])
    return shape < SAME_SHAPE and pace < -slowest
