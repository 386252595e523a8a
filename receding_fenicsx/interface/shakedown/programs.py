"""Linear programs over safe residual slips, each answer checked by primal and dual residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError

VANISHES = 1e-9
"""Largest violated margin of an accepted answer, and sum of a target's margins that is zero, over
the largest margin of the mean loads."""
BINDS = 1e-7
"""Margin below which a row binds."""


@dataclass(frozen=True)
class Answer:
    """Smallest value of a linear function over G z + c >= 0, with its proof."""

    z: Array  # where it is reached; polished on the rows that bind
    value: float  # the smallest value; inf when no z is feasible, -inf when there is none
    bound: float  # value that the multipliers prove to be a lower bound
    multipliers: Array  # (rows,) not negative (of any sign at rows that are equations)
    equations: tuple[int, ...] = ()  # rows that were made to vanish


def minimise(
    cost: Array, G: Array, c: Array, top: float = np.inf, equations: tuple[int, ...] = ()
) -> Answer:
    """Minimise cost z over G z + c >= 0 with 0 <= z[-1] <= top, the other z being free.

    For multipliers m >= 0 with m G = cost - rho the value is at least -m c + rho z; the polished
    multipliers leave rho only in the last unknown, whose bounds are known, and round-off elsewhere.
    The rows ``equations`` vanish. G is (rows, m + 1).
    """
    is_equation = np.isin(np.arange(len(c)), equations)
    reasons = []
    # the dual simplex method gives up at times for no reason of the program
    ways = (("highs-ds", 1e-9), ("highs-ds", 1e-7), ("highs-ipm", 1e-9), ("highs-ds", 1e-10))
    for method, tolerance in ways:
        found = scipy.optimize.linprog(
            cost,
            A_ub=-G[~is_equation],
            b_ub=c[~is_equation],
            A_eq=G[is_equation] if equations else None,
            b_eq=-c[is_equation] if equations else None,
            bounds=[(None, None)] * (len(cost) - 1) + [(0.0, None if np.isinf(top) else top)],
            method=method,
            options={
                "primal_feasibility_tolerance": tolerance,
                "dual_feasibility_tolerance": tolerance,
            },
        )
        if found.status in (2, 3):  # infeasible, unbounded
            value = np.inf if found.status == 2 else -np.inf
            return Answer(np.full(len(cost), np.nan), value, -np.inf, np.zeros(len(c)))
        if found.status == 0:
            multipliers = np.zeros(len(c))
            multipliers[~is_equation] = np.maximum(-found.ineqlin.marginals, 0.0)
            multipliers[is_equation] = found.eqlin.marginals
            z = _polished(found.x, G, c, is_equation, top)
            multipliers = _refined(multipliers, cost, G, is_equation, 0.0 < z[-1] < top)
            bound = dual_bound(multipliers, cost, G, c, top, z)
            answer = Answer(z, float(cost @ z), bound, multipliers, equations)
            violated, gap = -float((G @ z + c).min()), abs(answer.value - bound)
            if violated <= VANISHES and gap <= 1e-8 * (1.0 + abs(answer.value)):
                return answer
            found.message = f"margins violated by {violated:.1e}, dual bound off by {gap:.1e}"
        reasons.append(found.message)
    raise SolveError(
        f"a linear program of the shakedown limits has no answer that passes its checks: "
        f"{'; '.join(reasons)}"
    )


def dual_bound(multipliers: Array, cost: Array, G: Array, c: Array, top: float, z: Array) -> float:
    """Return the lower bound of cost z that (rows,) multipliers prove.

    The size of the point z tells what the residual rho of the unbounded unknowns may do.
    """
    rest = cost - multipliers @ G
    free = slice(0, -1) if np.isfinite(top) else slice(None)
    last = min(0.0, rest[-1]) * top if np.isfinite(top) else 0.0
    return float(-multipliers @ c) + last - float(np.abs(rest[free]) @ np.abs(z[free]))


def _polished(x: Array, G: Array, c: Array, is_equation: NDArray[np.bool_], top: float) -> Array:
    """Return the nearest point at which the rows that bind vanish to round-off."""
    margins = G @ x + c
    rows = np.flatnonzero(is_equation | (np.abs(margins) <= BINDS))
    z = x.copy()
    z[-1] = next((end for end in (0.0, top) if abs(x[-1] - end) <= VANISHES), x[-1])
    # the last unknown stays where it is at one of its bounds
    moving = slice(None) if 0.0 < z[-1] < top else slice(0, -1)
    if len(rows):
        z[moving] -= np.linalg.lstsq(G[rows][:, moving], G[rows] @ z + c[rows], rcond=None)[0]
    return z if -(G @ z + c).min() <= max(-margins.min(), VANISHES) else x


def _refined(
    multipliers: Array, cost: Array, G: Array, is_equation: NDArray[np.bool_], inside: bool
) -> Array:
    """Return multipliers that balance the cost of the unknowns away from bounds to round-off."""
    rows = np.flatnonzero(is_equation | (multipliers > 0.0))
    columns = slice(None) if inside else slice(0, -1)
    rest = (cost - multipliers @ G)[columns]
    refined = multipliers.copy()
    refined[rows] += np.linalg.lstsq(G[rows][:, columns].T, rest, rcond=None)[0]
    return np.where(is_equation, refined, np.maximum(refined, 0.0))
