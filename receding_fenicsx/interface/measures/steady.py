"""Quantities of whole cycles: the steady state, its kind, trends and power laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import Friction

SHAKEDOWN, CYCLIC_SLIP, RATCHETTING = "shakedown", "cyclic slip", "ratchetting"
NOT_REACHED = "not reached"


@dataclass(frozen=True)
class PowerLaw:
    """Least-squares fit of |y| = c N^exponent."""

    exponent: float  # slope of log |y| over log N
    uncertainty: float  # its standard error


def fit_power_law(N: Array, y: Array) -> PowerLaw:
    """Fit |y| = c N^exponent through three or more non-zero values (the paper's Fig. 8)."""
    N, y = np.asarray(N, float), np.abs(np.asarray(y, float))
    used = y > 0.0
    if used.sum() < 3:
        raise ValueError("a power law needs at least three non-zero values")
    (slope, _), covariance = np.polyfit(np.log(N[used]), np.log(y[used]), 1, cov=True)
    return PowerLaw(float(slope), float(np.sqrt(covariance[0, 0])))


def limit_of_decay(values: Array) -> tuple[str, float, float]:
    """Extrapolate a slowly converging sequence (n,), n >= 8, from its last differences.

    The differences are fitted over the second half of the sequence by a power N^-m and by a rate
    exp(-a N); the better fit is summed to infinity. Returned are "power" or "rate", the exponent
    (negative) or the factor per term, and the limit: nan where the sum is not finite.
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


class CycleEnd(NamedTuple):
    """What a cycle leaves for :class:`SteadyWatch`."""

    r: Array  # (2N,) reactions at its end
    v: Array  # (N,) tangential displacements there
    dissipation: Array  # (N,) dissipation in it
    pressed: Array  # (N,) largest P at its corners
    reach: Array  # (2N,) largest displacements there
    force: float  # largest nodal force of the history so far
    residual: float = 0.0  # largest residual of the contact law so far, over that force


class SteadyWatch:
    """Compares the ends of successive cycles and says when, and how, the response repeats itself.

    With A_n = max |r_n - r_(n-T)| / max |r| at the ends of cycles n, for periods T = 1 and 2, the
    forces repeat where A_n is below the tolerance, or the round-off of their terms
    sum_j |K_ij u_j|, for two periods running. Where a cycle ends without force, max |r| is taken
    over the whole history, times 1e-3: the contact's own forces are then round-off.

    Forces that repeat tell little of slips that are small beside the displacements they belong to.
    So slips are judged by themselves: a node slips by s = D_i / (f P)_i in a cycle, if K_ii s is
    more than 1e-11 of the largest terms sum_j |K_ij u_j| of the forces of the nodes to which
    it is coupled, and than the residual: where a limit is found its drifts are some 1e-12 off.
    The state is steady at the first n at which the forces repeat and

    * no node has slipped or gained a displacement for two periods running: shakedown; or
    * nodes gain d_n = v_n - v_(n-T), and the gains repeat, max |d_n - d_(n-T)| <= c max
      |d_n|: ratchetting. As the forces do not change, this is a motion that the body does not
      resist, or hardly; or
    * they gain no more than c times the largest slip, and the dissipation repeats, |D_n - D_(n-T)|
      <= c D_n: cyclic slip,

    with c = 100 times the tolerance: where slips decay they change by a few times as much as the
    forces. Slips that decay are not steady before they are that small beside others that do not, or
    round-off.
    """

    def __init__(self, tolerance: float, K: Array, friction: Friction) -> None:
        """Start with no cycles seen: bound of A_n, (N, 2N) tangential rows of K, and friction."""
        self.tolerance, self.friction, self._terms = tolerance, friction, np.abs(K)
        self._coupled = self._terms[:, : len(K)] > 0.0
        self.ends: list[CycleEnd] = []
        self.change: list[float] = []
        self.change_2: list[float] = []
        self.cycle, self.period, self.kind = -1, 1, NOT_REACHED

    def add(self, end: CycleEnd) -> bool:
        """Take the end of the next cycle, first of cycle 0; return whether one was steady."""
        self.ends = [*self.ends[-4:], end]
        if len(self.ends) == 1:
            return False
        largest = max(_largest(end.r), 1e-3 * end.force)
        for period, change in ((1, self.change), (2, self.change_2)):
            known = len(self.ends) > period
            change.append(_largest(end.r - self.ends[~period].r) if known else np.inf)
            if known:
                change[-1] = change[-1] / largest if largest > 0.0 else 0.0
            if self.cycle < 0 and len(change) >= 2 * period:
                most = max(change[-2 * period :]) * largest
                # forces of a nearly rigid body are small differences of their terms
                repeats = most <= self.tolerance * largest or (
                    most < 1e-6 * largest
                    and most < 32.0 * 2.0**-52 * _largest(self._terms @ end.reach)
                )
                self.kind = self._kind(period) if repeats else NOT_REACHED
                if self.kind != NOT_REACHED:
                    self.cycle, self.period = len(self.change), period
        return self.cycle >= 0

    def _slips(self, end: CycleEnd) -> tuple[Array, Array]:
        """Return the (N,) slips in a cycle, zero where they are round-off, and the least ones."""
        terms, stiffness = self._terms @ end.reach, self._terms.diagonal()
        # round-off of all nodes to which one is coupled reaches it
        terms = np.maximum(terms, np.where(self._coupled, terms, 0.0).max(axis=1, initial=0.0))
        # a smaller largest P counts as none
        limit = self.friction.largest_limit(np.maximum(end.pressed, 1e-9 * terms))
        slip = np.divide(end.dissipation, limit, out=np.zeros_like(limit), where=limit > 0.0)
        least = np.maximum(1e-11 * terms, end.residual * end.force)
        least = np.divide(least, stiffness, out=np.zeros_like(least), where=stiffness > 0.0)
        return np.where(slip > least, slip, 0.0), least

    def _kind(self, period: int) -> str:
        """Name the state of a contact whose forces repeat (section 1.2 of the paper)."""
        found = [self._slips(end) for end in self.ends[-2 * period :]]
        slips, none = np.max([slip for slip, _ in found], axis=0), found[-1][1]
        now, before, first = (end.v for end in self.ends[::-period][:3])
        gain = np.maximum(np.abs(now - before), np.abs(before - first))
        # nodes gain without dissipation where a direction has no friction, or while they are open
        moving = (slips > 0.0) | (self.friction.present & (gain > _largest(none)))
        if not np.any(moving):
            return SHAKEDOWN
        bound, drift = 100.0 * self.tolerance, _largest(gain[moving])
        if drift > max(bound * _largest(slips), _largest(none[moving])):
            change = _largest((now - 2.0 * before + first)[moving])
            return RATCHETTING if change <= bound * drift else NOT_REACHED
        D = np.array([end.dissipation.sum() for end in self.ends[-2 * period :]])
        D_before, D_now = D.reshape(2, period).sum(axis=1)
        return CYCLIC_SLIP if abs(D_now - D_before) <= bound * D_now else NOT_REACHED


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))
