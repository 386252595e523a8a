"""Recovered tractions of elements of order 2: without the zigzag between corner and middle nodes.

Where a traction p is smooth, nodal forces over weights err by opposite amounts at the corners and
the middles of elements, -h^2 p'' / 20 and h^2 p'' / 40. The mean traction of an element is right to
fourth order (:func:`~receding_fenicsx.interface.measures.tractions.cell_means`). So force is moved,
within an element, from its middle node in equal parts to its corners, until the middle has the
traction of the parabola with the means of the element and its two neighbours. That keeps the
resultant, and the moment too.

Nothing is moved where the traction is not smooth: beside the ends of contact and where the
direction of slip changes, for q also beside the ends of stick, and at kinks inside a zone. In slip
zones q follows p by the friction law; what q gains there is taken from the stick next to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.tractions import cell_means, midside_nodes
from receding_fenicsx.interface.measures.zone_ends import Tractions

Flags = NDArray[np.bool_]

PASSES = 2
"""Times that forces are moved: each pass also smooths differences between neighbouring elements."""
FLAT = 1e-3
"""Difference of means, over the largest one, below which the curvature does not matter."""
ROUND_OFF = 1e-14
"""Excess of |Q| over f P, over the largest P, that is round-off."""


@dataclass(frozen=True)
class Elements:
    """Elements of order 2 along a contact edge.

    Attributes:
        middle: (n,) middle nodes; the corners are the nodes before and after.
        middle_value: (n, 3) value in the middle of an element of the parabola with given means in
            the element before, in itself and in the next one.
    """

    middle: Ints
    middle_value: Array

    def inside(self, alike: Flags) -> Flags:
        """Return the elements that lie in a zone with both neighbours.

        Args:
            alike: (N - 1,) whether a node and the next one are of the same zone.
        """
        whole = alike[self.middle - 1] & alike[self.middle]
        found = np.zeros(len(whole), dtype=bool)
        found[1:-1] = whole[1:-1] & whole[:-2] & whole[2:]
        return found


def recover(at: Tractions) -> tuple[Array, Array]:
    """Return recovered tractions p and q at the nodes of one contact edge.

    sum(weight p) = sum(P), sum(weight q) = sum(Q), p >= 0, |q| <= f p, and |q| = f p at slipping
    nodes hold as for nodal forces over weights, which are returned on elements of order 1 and
    beside ends of zones.

    Args:
        at: nodal forces and states of one instant.

    Returns:
        p and q, (N,) each.
    """
    P, Q = at.P, at.Q
    middle = midside_nodes(at.x, at.weight, at.radius)
    if len(middle) > 2:
        elements = Elements(middle, _middle_values(at, middle))
        active = np.ones(len(middle), dtype=bool)
        while np.any(active):
            moved = _moved(at, elements, active)
            wrong = _violating(at, *moved)
            if not np.any(wrong):
                P, Q = moved
                break
            # the elements within two nodes of a violated inequality keep their forces
            near = np.convolve(wrong, np.ones(5), mode="same") > 0.0
            quiet = near[middle] & active
            active &= ~(quiet if np.any(quiet) else active)
    safe = np.where(at.weight > 0.0, at.weight, np.inf)
    return P / safe, Q / safe


def _middle_values(at: Tractions, middle: Ints) -> Array:
    """Return ``Elements.middle_value``: rows of zeros for the first and the last element."""
    values = np.zeros((len(middle), 3))
    inner = np.arange(1, len(middle) - 1)
    centre = at.x[middle[inner]]
    length = at.x[middle[inner] + 1] - at.x[middle[inner] - 1]
    means = np.empty((len(inner), 3, 3))
    for k, other in enumerate((inner - 1, inner, inner + 1)):
        a, b = ((at.x[middle[other] + side] - centre) / length for side in (-1, 1))
        moment = [(b ** (n + 1) - a ** (n + 1)) / (n + 1) for n in range(4)]
        if at.radius is not None:
            # the weight r, linear along the edge
            node = middle[inner]
            grows = at.radius[node + 1] - at.radius[node - 1]
            moment = [at.radius[node] * moment[n] + grows * moment[n + 1] for n in range(3)]
        means[:, k] = np.stack([part / moment[0] for part in moment[:3]], axis=1)
    values[inner] = np.linalg.inv(means)[:, 0]
    return values


def _moved(at: Tractions, elements: Elements, active: Flags) -> tuple[Array, Array]:
    """Return the nodal forces after all passes in the active elements."""
    state, friction = np.asarray(at.state), at.friction
    contact = state != State.SEPARATION
    stick = (state == State.STICK) & friction.present
    # Q = ratio P where a node slips
    ratio = -friction.at_slip(state)
    sign = np.sign(ratio)
    turns = (sign[1:] != sign[:-1]) & ~stick[1:] & ~stick[:-1]
    in_contact = elements.inside(contact[1:] & contact[:-1] & ~turns) & active
    in_stick = elements.inside(stick[1:] & stick[:-1]) & active
    P, Q = at.P.copy(), at.Q.copy()
    for _ in range(PASSES):
        flow = _flow(at, elements, P, in_contact)
        change = np.diff(flow, prepend=0.0, append=0.0)
        change_Q = np.diff(_flow(at, elements, Q, in_stick), prepend=0.0, append=0.0)
        for a, b in _runs(sign):
            ends = a > 0 and stick[a - 1], b + 1 < len(stick) and stick[b + 1]
            if not any(ends):
                _balance(change[a : b + 1], P[a : b + 1], ratio[a : b + 1])
            gained = ratio[a : b + 1] * change[a : b + 1]
            change_Q[a : b + 1] += gained
            _take_from_stick(change_Q, (a, b), ends, float(gained.sum()), ratio[a] * flow[a - 1])
        P, Q = P + change, Q + change_Q
    Q[sign != 0.0] = (ratio * P)[sign != 0.0]
    return P, Q


def _flow(at: Tractions, elements: Elements, force: Array, chosen: Flags) -> Array:
    """Return (N - 1,) forces that pass to each node from the next one, in chosen elements."""
    middle = elements.middle
    left, right, mean = cell_means(at.x, at.weight, force, middle)
    around = np.stack([np.roll(mean, 1), mean, np.roll(mean, -1)], axis=1)
    wanted = at.weight[middle] * (elements.middle_value * around).sum(axis=1)
    chosen = chosen & _is_smooth(0.5 * (left + right), mean, chosen)
    half = np.where(chosen, 0.5 * (force[middle] - wanted), 0.0)
    flow = np.zeros(len(force) - 1)
    flow[middle - 1], flow[middle] = half, -half
    return flow


def _is_smooth(centre: Array, mean: Array, inside: Flags) -> Flags:
    """Return the elements around which the curvature of a traction keeps its sign.

    It changes it at a kink that the states do not show, such as the former end of a stick zone.

    Args:
        centre: (n,) position of its middle.
        mean: (n,) mean traction of each element.
        inside: (n,) elements that lie in a zone with both neighbours.
    """
    curvature = np.zeros(len(mean))
    apart = np.diff(centre)
    # the second difference of means where elements are equally long
    curvature[1:-1] = np.diff(np.diff(mean) / apart) * 0.5 * (apart[1:] + apart[:-1])
    curvature[~inside] = np.nan
    around = np.stack([np.roll(curvature, 1), curvature, np.roll(curvature, -1)])
    low, high = np.fmin.reduce(around), np.fmax.reduce(around)
    flat = np.maximum(-low, high) <= FLAT * np.abs(mean).max(initial=0.0)
    return flat | (low * high > 0.0)


def _runs(of: Array) -> list[tuple[int, int]]:
    """Return first and last node of each run of equal values that are not 0."""
    ends = np.flatnonzero(np.diff(of)) + 1
    pairs = zip(np.append(0, ends), np.append(ends, len(of)) - 1, strict=True)
    return [(int(a), int(b)) for a, b in pairs if of[a] != 0]


def _balance(change: Array, P: Array, ratio: Array) -> None:
    """Change P, in place, so that Q of a zone of slip without stick beside it keeps its resultant.

    Only where f varies: P (f - mean f), which has no resultant, is added in proportion.
    """
    if np.all(ratio == ratio[0]) or not P.sum() > 0.0:
        return
    shape = P * (ratio - P @ ratio / P.sum())
    change -= shape * (ratio @ change) / (ratio @ shape)


def _take_from_stick(
    change_Q: Array, zone: tuple[int, int], ends: tuple[bool, bool], gained: float, before: float
) -> None:
    """Take what Q has gained in a zone of slip from the nodes of stick beside it, in place.

    Args:
        change_Q: (N,) change of Q.
        zone: first and last node of the zone.
        ends: whether there is stick before and after it.
        gained: change of Q in the zone.
        before: what the node before the zone gains where there is stick on both sides.
    """
    (a, b), (left, right) = zone, ends
    if left:
        change_Q[a - 1] += before if right else -gained
    if right:
        change_Q[b + 1] -= gained + (before if left else 0.0)


def _violating(at: Tractions, P: Array, Q: Array) -> Flags:
    """Return the nodes at which p >= 0 or |q| <= f p does not hold though it did before."""
    slack = ROUND_OFF * float(np.abs(at.P).max(initial=0.0))

    def wrong(P: Array, Q: Array) -> Flags:
        forward, backward = at.friction.margins(Q, P)
        return (P < 0.0) | (at.friction.present & ((forward < -slack) | (backward < -slack)))

    return wrong(P, Q) & ~wrong(at.P, at.Q)
