"""Ends of zones within a fraction of the node spacing, fitted to the tractions beside them.

At distance d from an end inside the zone, a quantity that is zero beyond the end grows like

    y(d) = d^m (A_0 + A_1 d + A_2 d^2 + ...),

with y = p where the contact lifts off, and y = f p - |q| where stick ends in slip. Inserting the
power into the equations of a half-plane gives m: with slip and Dundurs' constant beta

    contact ends:  m = 1/2 - sigma atan(f beta) / pi      (cot(pi m) = sigma f beta),
    stick ends:    m = 1/2 + sigma atan(f beta) / pi,

sigma = 1 where the slip beside the end runs outwards from the zone's middle, -1 where inwards.
That is the power of a stick zone that shrinks. One that grows passes its nodes while they just stop
to slip: the rate of f p - |q| has the power m there, and f p - |q|, its integral over the loads
since the zone has grown by d, the power m + 1 (Spence's problem). Both are tried: a fit counts
whose end is where the nodal states allow it, which the wrong power mostly misses by a spacing.
Where a contact sticks up to its end the power is complex (the tractions oscillate): no fit there.

The last node in the zone is left out: its traction depends on where the end lies between two nodes.
Further in, the error of finite elements acts as a shift of the end by a part of the node spacing:
some hundredths with fine elements of order 2, up to a third with coarse ones or order 1. The
interval is the hull of several fits, widened by that.

At the distance d from a corner in contact p(d) = d^m (A_0 + A_1 d) in the zone that begins there,
fitted from the third element to a part of the zone: the first ones err by the singularity itself.
Graded elements cover decades of d, equal ones a short range with few digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import MIRRORED, SLIP_SIGN, State
from receding_fenicsx.interface.measures.tractions import Tractions, cell_means, midside_nodes
from receding_fenicsx.interface.measures.zones import (
    NodeRange,
    contact_zone,
    half_width,
    stick_zone,
)


def fit_end(
    near: Array, far: Array, mean: Array, law: tuple[float, int], search: tuple[float, float]
) -> float | None:
    """Fit d^m (A_0 + A_1 d + ...) to means over cells, by least squares of the relative error.

    For each candidate end the coefficients follow from linear least squares; the end with the
    smallest error is searched for. ``near`` and ``far`` are distances (k,) of each cell's ends from
    the zone's last node, ``law`` is m and the number of terms, ``search`` the range of the end's
    distance beyond the last node. That distance is returned; None when a value is not positive, or
    when the best end lies at the edge of the range.
    """
    if np.any(mean <= 0.0):
        return None
    exponent, terms = law
    power = exponent + np.arange(terms) + 1.0
    scale = float(far.max())
    low, high = max(search[0], -0.5 * float(far.min())), search[1]

    def misfits(ends: Array) -> Array:
        a = (near[None, :, None] + ends[:, None, None]) / scale
        b = (far[None, :, None] + ends[:, None, None]) / scale
        basis = (b**power - np.maximum(a, 0.0) ** power) / (power * (b - a))
        return misfit(basis / mean[None, :, None])

    return _searched(misfits, low, high, 33)


def _searched(
    misfits: Callable[[Array], Array], low: float, high: float, count: int
) -> float | None:
    """Return the candidate of the smallest misfit, None if it lies at the range's edge."""
    best = low
    for turn in range(4):  # each round searches between the neighbours of the best candidate
        candidates = np.linspace(low, high, count)
        i = int(np.argmin(misfits(candidates)))
        if turn == 0 and i in (0, count - 1):
            return None
        best, low, high = (float(candidates[min(max(i + k, 0), count - 1)]) for k in (0, -1, 1))
    return best


def misfit(bases: Array) -> Array:
    """Return (n,) squared distances of the vector of ones from the spans of (n, k, terms) bases."""
    Q = np.linalg.qr(bases)[0]
    rest = 1.0 - np.einsum("nkt,nt->nk", Q, Q.sum(axis=1))
    return np.asarray(np.sum(rest**2, axis=1))


def corner_exponent_fit(at: Tractions, side: int) -> float | None:
    """Return m at an end of the contact edge: side 1 at the greatest x, -1 at the smallest.

    None where the corner is separated, too few elements lie in the zone beside it, or the pressure
    there follows no power.
    """
    order = np.arange(len(at.x)) if side < 0 else np.arange(len(at.x))[::-1]
    d, state = np.abs(at.x[order] - at.x[order[0]]), np.asarray(at.state)[order]
    if state[0] == State.SEPARATION:
        return None
    weight, force = at.weight[order], at.P[order]
    if at.radius is not None:
        # tractions along the edge, without the factor r
        radius = np.where(at.radius[order] > 0.0, at.radius[order], 1.0)
        weight, force = weight / radius, force / radius
    other = np.flatnonzero(state != state[0])
    zone = d[other[0] - 1] if len(other) else d[-1]
    near, far, mean = cell_means(d, weight, force, midside_nodes(d, weight))
    chosen = np.arange(len(near))
    chosen = chosen[(chosen >= 2) & (far <= 0.05 * zone)]
    # six elements at least, whose distances differ enough to tell powers
    if len(chosen) < 6 or far[chosen[-1]] < 4.0 * near[chosen[0]]:
        return None
    near, far, mean = near[chosen, None] / zone, far[chosen, None] / zone, mean[chosen, None]
    if np.any(mean <= 0.0):
        return None

    def misfits(exponents: Array) -> Array:
        # off the powers -1 and 0, whose integrals are logarithms
        power = exponents[:, None, None] + np.array([1.0, 2.0]) + 1e-9
        basis = (far**power - near**power) / (power * (far - near)) / mean
        # the first term has to make up the larger part in every element: a fit that lives on its
        # second term finds the exponent less one
        leading = np.linalg.pinv(basis)[:, 0].sum(axis=1)
        leads = (basis[:, :, 0] * leading[:, None]).min(axis=1) > 0.5
        return np.where(leads, misfit(basis), np.inf)

    return _searched(misfits, -0.95, 1.5, 50)


@dataclass(frozen=True)
class ZoneEnd:
    """End of a zone: its value, an interval around it, and whether it was fitted.

    Where it was not, the interval reaches from the zone's last node to the next one, both widened
    by the error of elements, and the value lies midway.
    """

    value: float
    low: float
    high: float
    fitted: bool


def dundurs_beta(
    body: tuple[float, float, str], other: tuple[float, float, str] | None = None
) -> float:
    """Return Dundurs' beta of a body against another one, or against a rigid plane.

    beta = (G_b (kappa_a - 1) - G_a (kappa_b - 1)) / (G_b (kappa_a + 1) + G_a (kappa_b + 1)), with
    kappa of :func:`kolosov`.

    Args:
        body: Young's modulus, Poisson's ratio and kinematics of the body.
        other: the same of the other body; None when it is rigid.
    """
    young, nu, kinematics = body
    shear, kappa = 0.5 * young / (1.0 + nu), kolosov(nu, kinematics)
    if other is None:
        return (kappa - 1.0) / (kappa + 1.0)
    young, nu, kinematics = other
    shear_b, kappa_b = 0.5 * young / (1.0 + nu), kolosov(nu, kinematics)
    return (shear_b * (kappa - 1.0) - shear * (kappa_b - 1.0)) / (
        shear_b * (kappa + 1.0) + shear * (kappa_b + 1.0)
    )


def kolosov(poisson: float, kinematics: str = "plane strain") -> float:
    """Return Kolosov's constant: 3 - 4 nu, in plane stress (3 - nu) / (1 + nu)."""
    if kinematics == "plane stress":
        return (3.0 - poisson) / (1.0 + poisson)
    return 3.0 - 4.0 * poisson


def contact_half_width_estimate(at: Tractions) -> ZoneEnd:
    """Estimate half the width of a contact around the middle, or its radius; NaN without one."""
    return _half_width(at, contact_zone(at.x, at.state, at.begins_on_axis))


def stick_half_width_estimate(at: Tractions) -> ZoneEnd:
    """Estimate half the width of the stick zone around the middle, or its radius.

    Where no node sticks, but slip turns round in the middle, the zone is between two nodes.
    """
    zone = stick_zone(at.x, at.state, at.friction.present, at.begins_on_axis)
    if zone == (0, -1):
        sign, middle = SLIP_SIGN[at.state], 0.5 * (at.x[0] + at.x[-1])
        for i in np.flatnonzero(sign[:-1] * sign[1:] < 0.0):
            width = at.x[i + 1] - at.x[i]
            if abs(0.5 * (at.x[i] + at.x[i + 1]) - middle) <= width:
                return ZoneEnd(0.25 * width, 0.0, 0.9 * width, fitted=False)
    return _half_width(at, zone, stick=True)


def zone_ends(at: Tractions) -> list[ZoneEnd]:
    """Estimate where each zone of equal state ends and the next one begins, from left to right."""

    def between(i: int) -> ZoneEnd:
        # fitted on the side where tractions vanish
        end = zone_end(at, i, 1)
        return end if end.fitted else zone_end(at, i + 1, -1)

    last = np.flatnonzero(np.diff(at.state)).tolist()
    if not at.half:
        return [between(i) for i in last]
    right = [between(i) for i in last if at.x[i] + at.x[i + 1] > 0.0]
    middle = [between(i) for i in last if at.x[i] + at.x[i + 1] == 0.0]
    return [_turned(end) for end in reversed(right)] + middle + right


def _turned(end: ZoneEnd) -> ZoneEnd:
    """Return the mirror image of an end."""
    return ZoneEnd(-end.value, -end.high, -end.low, end.fitted)


def _half_width(at: Tractions, zone: NodeRange | None, stick: bool = False) -> ZoneEnd:
    """Estimate the half width of a zone, known to a node, within a fraction of a node."""
    if zone is None or zone == (0, -1):
        width = half_width(at.x, zone)
        return ZoneEnd(width, width, width, fitted=False)
    first, last = zone
    right = zone_end(at, last, 1, stick)
    if at.begins_on_axis or (at.half and at.x[first] == -at.x[last]):
        return replace(right, low=max(right.low, 0.0))
    left = zone_end(at, first, -1, stick)
    return ZoneEnd(
        0.5 * (right.value - left.value),
        max(0.5 * (right.low - left.high), 0.0),
        0.5 * (right.high - left.low),
        fitted=right.fitted and left.fitted,
    )


def zone_end(at: Tractions, last: int, side: int, stick: bool = False) -> ZoneEnd:
    """Estimate where a zone ends beyond its last node, towards greater x (side 1) or smaller (-1).

    Where the zone has the edge's last node it is the edge's own end, with an interval to the node
    before if the traction falls so much that it may vanish between them: the pressure, or of a zone
    of ``stick`` the margin of the friction law.
    """
    if side < 0:
        x, weight, P, Q = (part[::-1] for part in (-at.x, at.weight, at.P, -at.Q))
        radius = None if at.radius is None else at.radius[::-1]
        state, friction = MIRRORED[at.state[::-1]], at.friction[::-1].mirrored
        at = Tractions(x, weight, P, Q, state, friction, at.beta, at.half, radius)
        return _turned(zone_end(at, len(x) - 1 - last, 1, stick))
    midside = midside_nodes(at.x, at.weight, at.radius)
    quadratic = len(midside) > 0
    # by the error of elements, in node spacings
    shift = 0.3 if quadratic else 0.4
    if last == len(at.x) - 1:
        value = low = float(at.x[-1])
        y = np.minimum(*at.friction.margins(at.Q, at.P)) if stick else at.P
        mean, pressure = (part / np.where(at.weight > 0.0, at.weight, np.inf) for part in (y, at.P))
        # with the end at the last node a square root falls to 0.55, a power of 1/3 to 0.65; less
        # than 1e-9 of the pressure is round-off of nodes at their limit
        if last > 0 and 1e-9 * pressure.max() < mean[-1] <= 0.75 * mean[-2]:
            low = float(at.x[-2] - shift * (at.x[-1] - at.x[-2]))
        return ZoneEnd(value, low, value, fitted=False)
    low, high = float(at.x[last]), float(at.x[last + 1])
    spacing = high - low
    shift *= spacing
    # no end lies beyond those of the edge
    edge = 0.0 if at.begins_on_axis else float(at.x[0]), float(at.x[-1])
    nearest, furthest = np.clip([low - shift, high + shift], *edge).tolist()
    bracket = ZoneEnd(0.5 * (low + high), nearest, furthest, fitted=False)
    quantity = _vanishing(at, last)
    if quantity is None:
        return bracket
    y, exponents, first = quantity
    left, right, mean = cell_means(at.x, at.weight, y, midside)
    inside = np.flatnonzero((right <= low) & (left >= at.x[first]))[::-1]
    search = -spacing, 2.0 * spacing
    windows = []
    # first and last cell of a fit, and its number of terms; cell 0, the last whole one, may touch
    # the last node and is left out; the first fit that the zone has room for gives the value
    on_order_2, on_order_1 = (
        ((1, 6, 3), (1, 4, 2), (1, 3, 2), (1, 8, 3)),
        ((1, 8, 2), (1, 6, 2), (2, 10, 2), (1, 10, 3)),
    )
    for a, b, terms in on_order_2 if quadratic else on_order_1:
        chosen = inside[a : b + 1]
        # over the length on which the traction is smooth
        reach = {2: 0.6, 3: 0.4}[terms] * (low - at.x[first])
        if len(chosen) > b - a and low - left[chosen[-1]] <= reach:
            windows.append((chosen, terms))
    ends: list[float] = []
    for exponent in exponents if len(windows) > 1 else ():
        fits = [
            fit_end(low - right[k], low - left[k], mean[k], (exponent, terms), search)
            for k, terms in windows
        ]
        found = [low + fit for fit in fits if fit is not None]
        inside_bracket = len(found) == len(fits) and bracket.low <= min(found)
        if inside_bracket and max(found) <= min(bracket.high, min(found) + 0.6 * spacing):
            ends += found
    if not ends:
        return bracket
    # elements inside the zone may be larger than the one in which it ends
    length = float(right[inside[1]] - left[inside[1]])
    shift *= max(1.0, (0.5 if quadratic else 1.0) * length / spacing)
    nearest, furthest = np.clip([min(ends) - shift, max(ends) + shift], *edge).tolist()
    return ZoneEnd(ends[0], nearest, furthest, fitted=True)


def _vanishing(at: Tractions, last: int) -> tuple[Array, tuple[float, ...], int] | None:
    """Return forces of what vanishes beyond a node, its powers, and from where it is smooth."""
    here, beyond = State(int(at.state[last])), State(int(at.state[last + 1]))
    # the first node of the run of equal states that ends here
    other = np.flatnonzero(np.asarray(at.state[: last + 1]) != at.state[last])
    first = int(other[-1]) + 1 if len(other) else 0
    friction = at.friction[last]
    if not at.friction.is_cone:
        return None  # powers are known for a cone only
    if beyond == State.SEPARATION:
        if not friction.present:
            # the pressure vanishes at both ends of the zone
            return at.P, (0.5,), (first + last) // 2
        if here == State.STICK or at.beta is None:
            return None
        coefficient = float(friction.at_slip(np.asarray(here)))
        return at.P, (0.5 - math.atan(coefficient * at.beta) / math.pi,), first
    if here == State.STICK and beyond != State.STICK and friction.present:
        if at.beta is None:
            return None
        A, B = at.friction.margins(at.Q, at.P)
        coefficient = float(friction.at_slip(np.asarray(beyond)))
        power = 0.5 + math.atan(coefficient * at.beta) / math.pi
        smooth = (first + last) // 2
        return A if beyond == State.FORWARD_SLIP else B, (power, power + 1.0), smooth
    return None
