"""Quantities of whole cycles: the steady state, its kind, trends and power laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array

SLIP_TOLERANCE = 100.0
"""Change of the slips per period over the largest slip range of a cycle, and change of a drift per
period over that drift, each over the tolerance of the forces, below which they repeat. Where slips
decay they change by a few times as much as the forces."""

SHAKEDOWN, CYCLIC_SLIP, RATCHETTING = "shakedown", "cyclic slip", "ratchetting"
NOT_REACHED = "not reached"
SHAKEDOWN_TOLERANCE = 1e-6
"""Dissipation of a cycle over that of cycle 1 below which the contact has shaken down."""

UNLOADED_FORCE = 1e-3
"""Largest force at the end of a cycle, over the largest so far, below which the contact is
unloaded: the change of its forces is then relative to the largest, as its own are round-off."""

SLIP_ROUND_OFF = 1e-12
"""Slip over the elastic displacement F / K_ii of a node under the largest nodal force F, and
dissipation over its energy F^2 / K_ii, below which they are round-off: no node slips."""


@dataclass(frozen=True)
class PowerLaw:
    """Least-squares fit of |y| = c N^exponent.

    Attributes:
        exponent: slope of log |y| over log N.
        uncertainty: its standard error.
    """

    exponent: float
    uncertainty: float


def fit_power_law(N: Array, y: Array) -> PowerLaw:
    """Fit |y| = c N^exponent through non-zero values (the paper's Fig. 8).

    Raises:
        ValueError: fewer than three non-zero values.
    """
    N, y = np.asarray(N, float), np.abs(np.asarray(y, float))
    used = y > 0.0
    if used.sum() < 3:
        raise ValueError("a power law needs at least three non-zero values")
    (slope, _), covariance = np.polyfit(np.log(N[used]), np.log(y[used]), 1, cov=True)
    return PowerLaw(float(slope), float(np.sqrt(covariance[0, 0])))


def limit_of_decay(values: Array) -> tuple[str, float, float]:
    """Extrapolate a slowly converging sequence from its last differences.

    The differences are fitted over the second half of the sequence by a power N^-m and by a rate
    exp(-a N); the better fit is summed to infinity.

    Args:
        values: (n,) sequence, n >= 8.

    Returns:
        "power" or "rate", the exponent (negative) or the factor per term, and the limit; the limit
        is nan when the fitted differences have no finite sum.
    """
    steps = np.diff(values)
    N = np.arange(2, len(values) + 1, dtype=float)
    keep = (N > len(values) / 2) & (steps != 0.0)
    if keep.sum() < 3:
        return "rate", 0.0, float(values[-1])
    log_steps = np.log(np.abs(steps[keep]))
    fits = {
        name: np.polyfit(t, log_steps, 1, full=True)
        for name, t in (("power", np.log(N[keep])), ("rate", N[keep]))
    }
    name = min(fits, key=lambda key: float(fits[key][1][0]) if len(fits[key][1]) else 0.0)
    slope = float(fits[name][0][0])
    last, n = float(steps[-1]), float(N[-1])
    if name == "power":
        rest = last * n / (-slope - 1.0) if slope < -1.0 else np.nan
        return name, slope, float(values[-1] + rest)
    ratio = float(np.exp(slope))
    rest = last * ratio / (1.0 - ratio) if ratio < 1.0 else np.nan
    return name, ratio, float(values[-1] + rest)


class SteadyWatch:
    """Compares the ends of successive cycles and says when, and how, the response repeats itself.

    With A_n = max |r_n - r_(n-T)| / max |r| and the gain d_n = v_n - v_(n-T) at the ends of cycles
    n, for periods T = 1 and 2, the forces repeat where A_n is below the tolerance for two periods
    running. Where a cycle ends without force, max |r| is taken over the whole history, times
    ``UNLOADED_FORCE``. The state is steady at the first n at which the forces repeat and, for two
    periods running,

    * the slips repeat, max |d_n| <= c max (range of v in a cycle): shakedown or cyclic slip; or
    * the gains repeat, max |d_n - d_(n-T)| <= c max |d_n|: ratchetting. As the forces do not
      change, this is a motion that the body does not resist, or hardly; or
    * no cycle dissipates anything: shakedown,

    with c = ``SLIP_TOLERANCE`` times the tolerance. A drift that decays is not steady yet.
    """

    def __init__(self, tolerance: float, stiffness: float = np.inf) -> None:
        """Start with no cycles seen.

        Args:
            tolerance: bound of A_n.
            stiffness: local stiffness of a contact node, to tell slip from round-off.
        """
        # a body that nothing but its contact holds has none, and no displacement by forces
        self.tolerance, self.stiffness = tolerance, stiffness or np.inf
        self.ends: list[tuple[Array, Array]] = []
        self.change: list[float] = []
        self.change_2: list[float] = []
        self.cycle, self.period, self.kind = -1, 1, NOT_REACHED

    def start(self, r: Array, v: Array) -> None:
        """Remember the start of cycle 1."""
        self.ends = [(r.copy(), v.copy())]

    def add(
        self,
        r: Array,
        v: Array,
        slip_range: float,
        dissipation: float,
        first: float,
        force: float = 0.0,
    ) -> bool:
        """Take the end of the next cycle; return True once a steady state has been found.

        Args:
            r: reactions at the end of the cycle.
            v: (N,) tangential displacements there.
            slip_range: largest range of v within the cycle of a node that touches in it.
            dissipation: dissipation of this cycle.
            first: dissipation of cycle 1.
            force: largest nodal force of the history so far.
        """
        scale = max(float(np.abs(r).max()), UNLOADED_FORCE * force)
        self.change.append(_relative(r, self.ends[-1][0], scale))
        self.change_2.append(
            _relative(r, self.ends[-2][0], scale) if len(self.ends) > 1 else np.inf
        )
        self.ends = [*self.ends[-4:], (r.copy(), v.copy())]
        largest = max(scale, force)
        give = SLIP_ROUND_OFF * largest / self.stiffness
        least = max(first, give * largest / SHAKEDOWN_TOLERANCE)
        slips = slip_range > give and dissipation > SHAKEDOWN_TOLERANCE * least
        for period, change in ((1, self.change), (2, self.change_2)):
            repeats = len(change) >= 2 * period and max(change[-2 * period :]) < self.tolerance
            if self.cycle < 0 and repeats:
                self.kind = self._kind(period, slip_range, give, slips)
                if self.kind != NOT_REACHED:
                    self.cycle, self.period = len(self.change), period
        return self.cycle >= 0

    def _kind(self, period: int, slip_range: float, give: float, slips: bool) -> str:
        """Name the state of a contact whose forces repeat (section 1.2 of the paper)."""
        bound = SLIP_TOLERANCE * self.tolerance
        now, before, first = (v for _, v in self.ends[-1::-period][:3])
        gain, change = now - before, now - 2.0 * before + first
        drift = max(_largest(gain), _largest(gain - change))
        if drift <= max(bound * slip_range, give):
            return CYCLIC_SLIP if slips else SHAKEDOWN
        if _largest(change) <= bound * drift:
            return RATCHETTING
        return NOT_REACHED if slips else SHAKEDOWN


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _relative(a: Array, b: Array, scale: float) -> float:
    return float(np.abs(a - b).max()) / scale if scale > 0.0 else 0.0


def slip_exponents(
    slip_increment: Array, cycles: tuple[int, int], nodes: NDArray[np.bool_]
) -> list[PowerLaw]:
    """Fit the slip increment per cycle over a range of cycles at each of the chosen nodes.

    Args:
        slip_increment: (n, N) slip increments, row 0 being cycle 1.
        cycles: first and last cycle of the fit, inclusive.
        nodes: (N,) nodes to fit; nodes that do not move in every one of the cycles are passed over.

    Returns:
        One fit per node.
    """
    N = np.arange(cycles[0], min(cycles[1], len(slip_increment)) + 1)
    rows = slip_increment[N - 1]
    moving = nodes & np.all(rows != 0.0, axis=0)
    return [fit_power_law(N.astype(float), rows[:, i]) for i in np.flatnonzero(moving)]
