"""Legs whose events are known: played again from other quantities, and verified many at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.exact.accumulate import Rates, sum_rows
from receding_fenicsx.interface.exact.reduction import Reduction
from receding_fenicsx.interface.exact.replay.chain import Chain
from receding_fenicsx.interface.exact.replay.events import floors, passed_by_round_off
from receding_fenicsx.interface.exact.round_off import negligible_imbalance
from receding_fenicsx.interface.exact.segments import (
    LIMIT_TOLERANCE,
    Following,
    Segment,
    Segments,
)
from receding_fenicsx.interface.exact.walk import END_TOLERANCE, Walk
from receding_fenicsx.interface.system import Leg


@dataclass
class KnownLeg:
    """A leg whose events came twice in the same order.

    Attributes:
        ends: load factors at its start and at its end, that of the frozen nodes included.
        start, end: (n,) states of the active nodes before it and at its end.
        turned: changes of state at its start.
        first, last: rates at its start and at its end.
        chain: its events.
        imbalance, stroke: rates along the chain's segments and the last one, as in ``Rates``.
        slipping: active nodes that slip against friction on it.
        slip, resisting: their rates, as in ``Rates``.
        changes: of the whole contact.
    """

    ends: tuple[Array, Array]
    start: NDArray[np.int8]
    end: NDArray[np.int8]
    turned: int
    first: Segment
    last: Segment
    chain: Chain
    imbalance: Array
    stroke: Array
    slipping: NDArray[np.intp]
    slip: Array
    resisting: Array
    changes: Changes


class Played(NamedTuple):
    """Several passages of one leg, one a row.

    Attributes:
        y: (c, 4n) quantities at the start.
        h: (c, k + 1) lengths of the segments, the last one up to the end.
        at: (c, 4n) quantities at the last event.
        end: (c, 4n) quantities at the end.
    """

    y: Array
    h: Array
    at: Array
    end: Array


def followings(walk: Walk) -> list[Following]:
    """Return what came last of the events met from the start of a walk on, as many as it had."""
    segment, begun = walk.first
    following, left = list[Following](), len(walk.course.events) - begun
    step = segment.last
    while left > 0 and step is not None:
        following.append(step)
        left -= len(step.changes)
        segment = step.segment
        step = segment.last
    return following if segment is walk.last else []


def are_of(walk: Walk, following: list[Following]) -> bool:
    """Return whether these came of the events of a walk."""
    changes = [change for step in following for change in step.changes]
    return changes == [event[1:] for event in walk.course.events[walk.first[1] :]]


def known_leg(walk: Walk, following: list[Following], leg: Leg) -> KnownLeg:
    """Return a leg with what its replay needs."""
    first, turned = walk.first
    chain = Chain([first, *(step.segment for step in following[:-1])], following)
    chain.complete(walk.sums)
    _, last = walk.sums.rates([walk.last])
    rates = Rates(*map(np.vstack, zip(chain.rates, last, strict=True)))
    slipping = np.flatnonzero((rates.slip != 0.0).any(axis=0) & walk.segments.frictional)
    a, b = walk.problem.ends
    return KnownLeg(
        ends=(a, b),
        start=walk.problem.start.state,
        end=walk.point.state.copy(),
        turned=turned,
        first=first,
        last=walk.last,
        chain=chain,
        imbalance=rates.imbalance,
        stroke=rates.stroke,
        slipping=slipping,
        slip=rates.slip[:, slipping],
        resisting=rates.resisting[:, slipping],
        changes=leg.events,
    )


def lengths(one: KnownLeg, y: Array) -> Array | None:
    """Return the lengths (k + 1,) of a leg's segments from quantities y (4n,); None if negative."""
    h, singular = dtrtrs(one.chain.triangle, -y[one.chain.labels], lower=1)
    rest = 1.0 - h.sum()
    holds = not singular and h.min() >= 0.0 and rest >= END_TOLERANCE
    return np.append(h, rest) if holds else None


def play(
    segments: Segments, course: list[KnownLeg], y: Array, force_scale: float
) -> list[tuple[Array, Array, Array, Array]]:
    """Follow legs one after the other from quantities y (4n,), as far as the lengths are positive.

    Returns:
        For each leg the entries of :class:`Played`.
    """
    n, passed = segments.system.n, passed_by_round_off(segments, force_scale)
    rows = []
    for one in course:
        h, labels = lengths(one, y), one.chain.labels
        if h is None:
            break
        at = y + h[:-1] @ one.chain.rows[:, : 4 * n]
        # what has reached its limit and stays there is exactly zero
        at[labels[at[labels] <= passed[labels]]] = 0.0
        at[labels[-1]] = 0.0
        end = at + h[-1] * one.last.q
        np.maximum(end[2 * n :], 0.0, out=end[2 * n :])
        rows.append((y, h, at, end))
        y = end
    return rows


def keeps_law(
    reduction: Reduction, one: KnownLeg, played: Played, force_scale: float
) -> tuple[NDArray[np.bool_], list[Changes]]:
    """Return which passages of a leg are its path, event for event, and the ties on each."""
    segments, chain = reduction.segments, one.chain
    (a, b), h, g0 = one.ends, played.h[:, :-1], segments.system.g0
    on_limit, watch = segments.limit * force_scale, LIMIT_TOLERANCE * force_scale
    floor = floors(segments, force_scale, len(reduction.watched))

    def watched(y: Array, load: Array) -> Array:
        u = displacements(g0, y)
        return u @ reduction.watched[:, : u.shape[1]].T + reduction.watched[:, u.shape[1] :] @ load

    before = np.hstack([played.y, watched(played.y, a)])
    after = before[:, played.y.shape[1] :] + h @ chain.rows[:, played.y.shape[1] :]
    fall = one.first.falling
    holds = (played.y[:, fall] > on_limit[fall]).all(axis=1)
    low, lowest = chain.low, before[:, chain.low] + h @ chain.fall
    holds &= (lowest >= floor[low]).all(axis=1)
    holds &= (np.hstack([played.at, after]) >= floor).all(axis=1)
    # no event on the way from the last one to the end
    first = (played.at[:, one.last.falling] * one.last.time).min(axis=1, initial=np.inf)
    holds &= first >= played.h[:, -1] - END_TOLERANCE
    holds &= (watched(played.end, b) > watch).all(axis=1)
    errors = (played.h[:, :, None] * one.imbalance).cumsum(axis=1)
    errors += segments.balance.errors(played.y, a)[:, None, :]
    holds &= np.abs(errors).max(axis=(1, 2)) <= negligible_imbalance(len(g0)) * force_scale
    near = lowest <= np.append(on_limit, np.full(len(reduction.watched), -np.inf))[low]
    return holds, chain.ties(segments, played.y, h, on_limit, near)


def displacements(g0: Array, y: Array) -> Array:
    """Return the displacements (c, 2n) that belong to quantities (c, 4n)."""
    n = len(g0)
    return np.hstack([y[:, :n], y[:, n : 2 * n] - g0])


def dissipated(one: KnownLeg, h: Array, y: Array, shares: list[Array]) -> Array:
    """Return the dissipation of the slipping nodes along segments of lengths h from y (4n,)."""
    n, at = len(y) // 4, one.slipping
    start = y[3 * n + at] * shares[1][at] - y[2 * n + at] * shares[0][at]
    middle = h[:, None] * one.resisting
    half = 0.5 * middle
    sum_rows(middle)
    middle -= half
    middle += start
    middle *= one.slip
    dissipation: Array = h @ middle
    return dissipation
