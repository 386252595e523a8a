"""Tractions of a contact edge: nodal forces of one instant, means over cells, recovered tractions.

Where a traction p is smooth, nodal forces over weights of elements of order 2 err by opposite
amounts at the corners and the middles of elements, -h^2 p'' / 20 and h^2 p'' / 40. The mean
traction of an element is right to fourth order (:func:`cell_means`). So :func:`recover` moves force
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
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.law import Friction, State
from receding_fenicsx.interface.measures.zones import Flags, begins_on_axis


@dataclass(frozen=True)
class Tractions:
    """Nodal forces and states of one instant, from which zone ends are estimated."""

    x: Array  # (N,) positions, increasing
    weight: Array  # (N,) integrals of the shape functions over the contact edge
    # P, Q: (N,) nodal forces, Q positive towards greater x
    P: Array
    Q: Array
    state: NDArray[np.integer]  # (N,) values of :class:`State`
    friction: Friction  # law of friction of the nodes, in forces
    # Dundurs' constant of the body against the other side; None when it is not known
    beta: float | None = None
    half: bool = False  # True when all is its own mirror image about x = 0
    radius: Array | None = None  # (N,) distances of the nodes from the axis when axisymmetric

    @property
    def begins_on_axis(self) -> bool:
        """Whether the contact edge begins on the axis r = 0."""
        return self.radius is not None and begins_on_axis(self.radius, self.weight)


def midside_nodes(x: Array, weight: Array, radius: Array | None = None) -> Ints:
    """Return the midside nodes with a neighbour on both sides; none on elements of order 1.

    ``radius`` are distances from the axis when axisymmetric: the weights have the factor r then.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(x) < 3:
        return none
    local = weight
    if radius is not None:
        local = np.divide(weight, radius, out=np.zeros(len(x)), where=radius > 0.0)
    # weight over the distance of the neighbours is 2/3 at midside nodes, at vertices of order 2 1/3
    # and of order 1 1/2, on graded edges too
    heavy = local[1:-1] > 0.58 * (x[2:] - x[:-2])
    # every second node, beginning with the first or the second that has two neighbours
    for start in (0, 1):
        if np.all(heavy[start::2]) and not np.any(heavy[1 - start :: 2]):
            return np.arange(start + 1, len(x) - 1, 2)
    return none


def cell_means(x: Array, weight: Array, force: Array, midside: Ints) -> tuple[Array, Array, Array]:
    """Return the ends of cells along the edge, and the mean traction in each.

    On elements of order 2 lumped tractions err by opposite amounts at vertices and midside nodes;
    an element's share of the nodal forces over its length is its mean traction to fourth order.
    On elements of order 1 a cell reaches half-way to the neighbouring nodes, to second order.
    ``midside`` is that of :func:`midside_nodes`. Returned are left ends, right ends and means.
    """
    if len(midside):
        left, right = x[midside - 1], x[midside + 1]
        length = right - left
        part = np.ones((2, len(length)))
        both = length[1:] + length[:-1]
        part[0, 1:], part[1, :-1] = length[1:] / both, length[:-1] / both
        total, whole = (
            field[midside] + part[0] * field[midside - 1] + part[1] * field[midside + 1]
            for field in (force, weight)
        )
        return left, right, total / whole
    between = 0.5 * (x[1:] + x[:-1])
    traction = force / np.where(weight > 0.0, weight, np.inf)
    return np.append(x[0], between), np.append(between, x[-1]), traction


def traction_at(x: Array, weight: Array, force: Array, points: ArrayLike) -> Array:
    """Return the traction at any points: the slope of a cubic spline through the force so far.

    Fourth order in the element's size on elements of order 2 where the traction is smooth; beside
    zone ends no better than the nodes.

    Args:
        x: (N,) positions, increasing.
        weight: (N,) integrals of the shape functions.
        force: (N,) nodal forces.
        points: where.
    """
    left, right, mean = cell_means(x, weight, force, midside_nodes(x, weight))
    so_far = np.append(0.0, np.cumsum(mean * (right - left)))
    return np.asarray(CubicSpline(np.append(left, right[-1]), so_far)(points, 1))


def recover(at: Tractions) -> tuple[Array, Array]:
    """Return recovered tractions p and q at the nodes of one contact edge.

    sum(weight p) = sum(P), sum(weight q) = sum(Q), p >= 0, |q| <= f p, and |q| = f p at slipping
    nodes hold as for nodal forces over weights, which are returned on elements of order 1 and
    beside ends of zones.
    """
    P, Q, friction = at.P, at.Q, at.friction
    slack = 1e-14 * float(np.abs(P).max(initial=0.0))

    def broken(P: Array, Q: Array) -> Flags:
        A, B = friction.margins(Q, P)
        return (P < 0.0) | (friction.present & ((A < -slack) | (B < -slack)))

    middle = midside_nodes(at.x, at.weight, at.radius)
    # at a shear limit q does not follow p, with a cohesion it is not proportional
    if friction.is_cone:
        values, active = _middle_values(at, middle), np.ones(len(middle), dtype=bool)
        while np.any(active):
            moved = _moved(at, (middle, values), active)
            wrong = broken(*moved) & ~broken(P, Q)
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
    """Return (n, 3) values in the middle of parabolas with means here and beside; 0 at ends."""
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


def _inside(middle: Ints, alike: Flags) -> Flags:
    """Return elements in a zone with both neighbours; ``alike`` nodes and the next are of one."""
    whole = alike[middle - 1] & alike[middle]
    found = np.zeros(len(whole), dtype=bool)
    found[1:-1] = whole[1:-1] & whole[:-2] & whole[2:]
    return found


def _moved(at: Tractions, elements: tuple[Ints, Array], active: Flags) -> tuple[Array, Array]:
    """Return the nodal forces after all passes in the active elements."""
    middle = elements[0]
    state, friction = np.asarray(at.state), at.friction
    contact = state != State.SEPARATION
    stick = (state == State.STICK) & friction.present
    # Q = ratio P where a node slips
    ratio = -friction.at_slip(state)
    sign = np.sign(ratio)
    turns = (sign[1:] != sign[:-1]) & ~stick[1:] & ~stick[:-1]
    in_contact = _inside(middle, contact[1:] & contact[:-1] & ~turns) & active
    in_stick = _inside(middle, stick[1:] & stick[:-1]) & active
    # first and last node of each run of equal direction of slip
    starts = np.append(0, np.flatnonzero(np.diff(sign)) + 1)
    runs = list(zip(starts, np.append(starts[1:], len(sign)) - 1, strict=True))
    P, Q = at.P.copy(), at.Q.copy()
    # times that forces are moved: each pass also smooths differences between neighbouring elements
    for _ in range(2):
        flow = _flow(at, elements, P, in_contact)
        change = np.diff(flow, prepend=0.0, append=0.0)
        change_Q = np.diff(_flow(at, elements, Q, in_stick), prepend=0.0, append=0.0)
        for a, b in runs:
            if sign[a] == 0.0:
                continue
            zone = slice(a, b + 1)
            left, right = a > 0 and stick[a - 1], b + 1 < len(stick) and stick[b + 1]
            uneven = np.any(ratio[zone] != ratio[a]) and P[zone].sum() > 0.0
            if not (left or right) and uneven:
                # P (f - mean f), which has no resultant, keeps that of Q
                shape = P[zone] * (ratio[zone] - P[zone] @ ratio[zone] / P[zone].sum())
                change[zone] -= shape * (ratio[zone] @ change[zone]) / (ratio[zone] @ shape)
            gained = ratio[zone] * change[zone]
            change_Q[zone] += gained
            # what Q has gained is taken from the stick beside it; between two of them each gives
            # what has passed to it, and half of what friction that changes adds
            total = float(gained.sum())
            if left and right:
                before, after = ratio[a] * flow[a - 1], ratio[b] * flow[b]
                added = 0.5 * (total + before - after)
                change_Q[a - 1] += before - added
                change_Q[b + 1] -= after + added
            elif left:
                change_Q[a - 1] -= total
            elif right:
                change_Q[b + 1] -= total
        P, Q = P + change, Q + change_Q
    Q[sign != 0.0] = (ratio * P)[sign != 0.0]
    return P, Q


def _flow(at: Tractions, elements: tuple[Ints, Array], force: Array, chosen: Flags) -> Array:
    """Return (N - 1,) forces that pass to each node from the next one, in chosen elements."""
    middle, values = elements
    left, right, mean = cell_means(at.x, at.weight, force, middle)
    around = np.stack([np.roll(mean, 1), mean, np.roll(mean, -1)], axis=1)
    wanted = at.weight[middle] * (values * around).sum(axis=1)
    chosen = chosen & _is_smooth(0.5 * (left + right), mean, chosen)
    half = np.where(chosen, 0.5 * (force[middle] - wanted), 0.0)
    flow = np.zeros(len(force) - 1)
    flow[middle - 1], flow[middle] = half, -half
    return flow


def _is_smooth(centre: Array, mean: Array, inside: Flags) -> Flags:
    """Return the elements around which the curvature of a traction keeps its sign."""
    # it changes it at a kink that the states do not show, such as the former end of a stick zone
    curvature = np.zeros(len(mean))
    apart = np.diff(centre)
    # the second difference of means where elements are equally long
    curvature[1:-1] = np.diff(np.diff(mean) / apart) * 0.5 * (apart[1:] + apart[:-1])
    curvature[~inside] = np.nan
    around = np.stack([np.roll(curvature, 1), curvature, np.roll(curvature, -1)])
    low, high = np.fmin.reduce(around), np.fmax.reduce(around)
    flat = np.maximum(-low, high) <= 1e-3 * np.abs(mean).max(initial=0.0)
    return flat | (low * high > 0.0)
