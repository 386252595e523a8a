"""Ends of zones below node spacing, fitted to the tractions beside them.

Beside an end at distance d inside the zone, a quantity that is zero beyond the end grows like

    y(d) = d^m (A_0 + A_1 d + A_2 d^2 + ...),

with y = p where the contact lifts off, and y = f p - |q| where stick ends in slip. Inserting the
power into the equations of a half-plane gives m: with slip and Dundurs' constant beta

    contact ends:  m = 1/2 - sigma atan(f beta) / pi      (cot(pi m) = sigma f beta),
    stick ends:    m = 1/2 + sigma atan(f beta) / pi,

sigma = 1 where the slip beside the end runs outwards from the zone's middle, -1 where inwards.
Where a contact sticks up to its end the power is complex (the tractions oscillate): no fit there.

The last node in the zone is left out: its traction depends on where the end lies between two nodes.
Further in, the error of finite elements acts as a shift of the end by a part of the node spacing:
some hundredths with fine elements of order 2, up to a third with coarse ones or order 1. The
interval is the hull of several fits, widened by that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.law import MIRRORED, Friction, State, friction_of
from receding_fenicsx.interface.measures.axis import begins_on_axis
from receding_fenicsx.interface.measures.tractions import cell_means, midside_nodes
from receding_fenicsx.interface.measures.zones import (
    NOWHERE,
    NodeRange,
    contact_zone,
    half_width,
    stick_zone,
)
from receding_fenicsx.interface.system import Array

Window = tuple[int, int, int]
"""First and last cell of a fit, and its terms. Cell 0, the last whole one, may touch the last
node and is left out."""

QUADRATIC_WINDOWS: tuple[Window, ...] = ((1, 6, 3), (1, 4, 2), (1, 3, 2), (1, 8, 3))
"""Elements of order 2 that are fitted; the first that the zone has room for gives the value."""
LINEAR_WINDOWS: tuple[Window, ...] = ((1, 8, 2), (1, 6, 2), (2, 10, 2), (1, 10, 3))
"""The same in nodes of order 1."""
QUADRATIC_SHIFT = 0.3
"""Largest shift of an end, in node spacings, by the error of elements of order 2."""
LINEAR_SHIFT = 0.4
"""The same for order 1."""
ROOM = {2: 0.6, 3: 0.4}
"""Largest part of the length over which a zone's traction is smooth that a fit may reach over, by
its terms."""
AGREEMENT = 0.6
"""Largest distance between the ends of several fits, in node spacings: beyond, they fit nothing."""
SEARCH = (-1.0, 2.0)
"""Where an end is looked for, in node spacings from the zone's last node."""
CANDIDATES = 33
"""Ends that are tried at once, between which the best one is looked for again."""
REFINEMENTS = 4
"""Rounds of trying; each narrows the search by the number of candidates."""


@dataclass(frozen=True)
class ZoneEnd:
    """End of a zone: its value, an interval around it, and whether it was fitted.

    Where it was not, the interval reaches from the zone's last node to the next one, and the value
    lies midway.
    """

    value: float
    low: float
    high: float
    fitted: bool


@dataclass(frozen=True)
class Tractions:
    """What the ends are fitted to, at one instant.

    Attributes:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions over the contact edge.
        P, Q: (N,) nodal forces, Q positive towards greater x.
        state: (N,) values of :class:`State`.
        f: (N,) coefficient of friction.
        beta: Dundurs' constant of the body against the other side; None when it is not known.
        half: True when all is its own mirror image about x = 0.
        axisymmetric: True when x is the radius.
        f_backward: (N,) coefficient of friction for backward slip; None stands for ``f``.
    """

    x: Array
    weight: Array
    P: Array
    Q: Array
    state: NDArray[np.integer]
    f: Array
    beta: float | None = None
    half: bool = False
    axisymmetric: bool = False
    f_backward: Array | None = None

    @property
    def friction(self) -> Friction:
        """Coefficients of friction for both directions of slip."""
        return friction_of(self.f, self.f_backward)


def dundurs_beta(
    body: tuple[float, float, str], other: tuple[float, float, str] | None = None
) -> float:
    """Return Dundurs' beta of a body against another one, or against a rigid plane.

    beta = (G_b (kappa_a - 1) - G_a (kappa_b - 1)) / (G_b (kappa_a + 1) + G_a (kappa_b + 1)), with
    kappa = 3 - 4 nu (plane strain, axisymmetric) or (3 - nu) / (1 + nu) (plane stress).

    Args:
        body: Young's modulus, Poisson's ratio and kinematics of the body.
        other: the same of the other body; None when it is rigid.
    """
    shear, kappa = _shear_kappa(*body)
    if other is None:
        return (kappa - 1.0) / (kappa + 1.0)
    shear_b, kappa_b = _shear_kappa(*other)
    return (shear_b * (kappa - 1.0) - shear * (kappa_b - 1.0)) / (
        shear_b * (kappa + 1.0) + shear * (kappa_b + 1.0)
    )


def _shear_kappa(young: float, nu: float, kinematics: str) -> tuple[float, float]:
    kappa = (3.0 - nu) / (1.0 + nu) if kinematics == "plane stress" else 3.0 - 4.0 * nu
    return 0.5 * young / (1.0 + nu), kappa


def contact_half_width_estimate(at: Tractions) -> ZoneEnd:
    """Estimate half the width of a contact around the middle, or its radius; NaN without one."""
    return _half_width(at, contact_zone(at.x, at.state, at.axisymmetric))


def stick_half_width_estimate(at: Tractions) -> ZoneEnd:
    """Estimate half the width of the stick zone around the middle, or its radius."""
    return _half_width(at, stick_zone(at.x, at.state, at.friction.mean, at.axisymmetric))


def zone_ends(at: Tractions) -> list[ZoneEnd]:
    """Estimate where each zone of equal state ends and the next one begins, from left to right."""
    last = np.flatnonzero(np.diff(at.state))
    if not at.half:
        return [_between(at, int(i)) for i in last]
    right = [_between(at, int(i)) for i in last if at.x[i] + at.x[i + 1] > 0.0]
    middle = [_between(at, int(i)) for i in last if at.x[i] + at.x[i + 1] == 0.0]
    return [_turned(end) for end in reversed(right)] + middle + right


def _between(at: Tractions, last: int) -> ZoneEnd:
    """End of the zone up to a node, by the zone on either side whose tractions vanish there."""
    end = zone_end(at, last, 1)
    return end if end.fitted else zone_end(at, last + 1, -1)


def _turned(end: ZoneEnd) -> ZoneEnd:
    return ZoneEnd(-end.value, -end.high, -end.low, end.fitted)


def _half_width(at: Tractions, zone: NodeRange | None) -> ZoneEnd:
    """Estimate the half width of a zone, known to a node, within a fraction of a node."""
    if zone is None or zone == NOWHERE:
        width = half_width(at.x, zone)
        return ZoneEnd(width, width, width, fitted=False)
    first, last = zone
    right = zone_end(at, last, 1)
    if (at.axisymmetric and begins_on_axis(at.x)) or (at.half and at.x[first] == -at.x[last]):
        return right
    left = zone_end(at, first, -1)
    return ZoneEnd(
        0.5 * (right.value - left.value),
        0.5 * (right.low - left.high),
        0.5 * (right.high - left.low),
        fitted=right.fitted and left.fitted,
    )


def zone_end(at: Tractions, last: int, side: int) -> ZoneEnd:
    """Estimate where a zone ends beyond its last node.

    Args:
        at: tractions of the instant.
        last: the zone's last node.
        side: 1 when the zone ends towards greater x, -1 towards smaller x.

    Returns:
        The end; the edge's own end when the zone reaches it.
    """
    if side < 0:
        return _turned(zone_end(_mirrored(at), len(at.x) - 1 - last, 1))
    if last == len(at.x) - 1:
        return ZoneEnd(at.x[-1], at.x[-1], at.x[-1], fitted=False)
    low, high = float(at.x[last]), float(at.x[last + 1])
    spacing = high - low
    midside = midside_nodes(at.x, at.weight, at.axisymmetric)
    quadratic = len(midside) > 0
    shift = (QUADRATIC_SHIFT if quadratic else LINEAR_SHIFT) * spacing
    bracket = ZoneEnd(0.5 * (low + high), low - shift, high + shift, fitted=False)
    quantity = _vanishing(at, last)
    if quantity is None:
        return bracket
    y, exponent, first = quantity
    left, right, mean = cell_means(at.x, at.weight, y, midside)
    inside = np.flatnonzero((right <= low) & (left >= at.x[first]))[::-1]
    search = SEARCH[0] * spacing, SEARCH[1] * spacing
    ends = []
    for a, b, terms in QUADRATIC_WINDOWS if quadratic else LINEAR_WINDOWS:
        chosen = inside[a : b + 1]
        if len(chosen) <= b - a or low - left[chosen[-1]] > ROOM[terms] * (low - at.x[first]):
            continue
        fit = _fit(low - right[chosen], low - left[chosen], mean[chosen], (exponent, terms), search)
        if fit is None:
            return bracket
        ends.append(low + fit)
    if len(ends) < 2:
        return bracket
    if max(ends) - min(ends) > AGREEMENT * spacing:
        return bracket
    return ZoneEnd(ends[0], min(ends) - shift, max(ends) + shift, fitted=True)


def _mirrored(at: Tractions) -> Tractions:
    return Tractions(
        -at.x[::-1],
        at.weight[::-1],
        at.P[::-1],
        -at.Q[::-1],
        MIRRORED[np.asarray(at.state)[::-1]],
        at.friction.backward[::-1],
        at.beta,
        at.half,
        at.axisymmetric,
        at.friction.forward[::-1],
    )


def _vanishing(at: Tractions, last: int) -> tuple[Array, float, int] | None:
    """What vanishes at the end beyond a node, as nodal forces, its power, and from where smooth.

    None when its power is not known.
    """
    here, beyond = State(int(at.state[last])), State(int(at.state[last + 1]))
    first = _first_alike(at, last)
    friction = at.friction[last]
    if beyond == State.SEPARATION:
        if not friction.present:
            # the pressure vanishes at both ends of the zone
            return at.P, 0.5, (first + last) // 2
        if here == State.STICK or at.beta is None:
            return None
        coefficient = float(friction.at_slip(np.asarray(here)))
        return at.P, 0.5 - math.atan(coefficient * at.beta) / math.pi, first
    if here == State.STICK and beyond != State.STICK and friction.present:
        if at.beta is None:
            return None
        A, B = at.friction.margins(at.Q, at.P)
        coefficient = float(friction.at_slip(np.asarray(beyond)))
        power = 0.5 + math.atan(coefficient * at.beta) / math.pi
        return A if beyond == State.FORWARD_SLIP else B, power, (first + last) // 2
    return None


def _first_alike(at: Tractions, last: int) -> int:
    """First node of the run of equal states that ends at a node."""
    other = np.flatnonzero(np.asarray(at.state[: last + 1]) != at.state[last])
    return int(other[-1]) + 1 if len(other) else 0


def _fit(
    near: Array, far: Array, mean: Array, law: tuple[float, int], search: tuple[float, float]
) -> float | None:
    """Fit d^m (A_0 + A_1 d + ...) to means over cells, by least squares of the relative error.

    Args:
        near: (k,) distance of each cell's nearer end from the zone's last node.
        far: (k,) the same of its further end.
        mean: (k,) mean values over the cells.
        law: m, and the number of terms.
        search: range of the end's distance beyond the last node.

    Returns:
        Distance of the end beyond the last node; None when a value is not positive, or when the
        best end lies at the edge of the range.
    """
    if np.any(mean <= 0.0):
        return None
    exponent, terms = law
    power = exponent + np.arange(terms) + 1.0
    scale = float(far.max())
    low, high = max(search[0], -0.5 * float(far.min())), search[1]
    best = 0.0
    for turn in range(REFINEMENTS):
        ends = np.linspace(low, high, CANDIDATES)
        a = (near[None, :, None] + ends[:, None, None]) / scale
        b = (far[None, :, None] + ends[:, None, None]) / scale
        basis = (b**power - np.maximum(a, 0.0) ** power) / (power * (b - a))
        i = int(np.argmin(_misfit(basis / mean[None, :, None])))
        if turn == 0 and i in (0, CANDIDATES - 1):
            return None
        best = float(ends[i])
        low, high = ends[max(i - 1, 0)], ends[min(i + 1, CANDIDATES - 1)]
    return best


def _misfit(bases: Array) -> Array:
    """Square of what of the vector of ones lies outside each of (n, k, terms) bases (n,)."""
    rest = np.ones(bases.shape[:2])
    for j in range(bases.shape[2]):
        direction = bases[:, :, j] / np.sqrt(np.sum(bases[:, :, j] ** 2, axis=1))[:, None]
        bases = bases - direction[:, :, None] * np.einsum("nk,nkt->nt", direction, bases)[:, None]
        rest = rest - direction * np.sum(direction * rest, axis=1)[:, None]
    return np.asarray(np.sum(rest**2, axis=1))
