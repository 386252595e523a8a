"""Zones of stick, slip and separation along the contact edge, their widths, values on the axis.

A zone's end lies midway between its last node and the next one; the outermost zones end at the
outermost nodes. Where an axisymmetric contact edge begins on the axis r = 0, x is the distance from
it, and the first zone begins there, though at order 2 no contact node lies on the axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import STATE_NAMES, State

Flags = NDArray[np.bool_]

FRICTIONLESS_CONTACT = "contact"
"""Name of the closed zone where there is no friction."""

Zone = tuple[str, float, float]
"""Name of the state, and the two ends."""


def zones(
    x: Array,
    state: NDArray[np.integer],
    begins_on_axis: bool = False,
    f: Array | Flags | None = None,
) -> list[Zone]:
    """Split the contact edge into zones of equal state.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.
        begins_on_axis: the edge begins on the axis r = 0, at x = 0.
        f: (N,) coefficient of friction, or whether there is any: a node without friction has no
            limit to stick below; closed, it slides freely, in a zone named "contact".

    Returns:
        The zones from the smallest x to the greatest; each begins where the one before ends.
    """
    if len(x) == 0:
        return []
    names = {int(k): name for k, name in STATE_NAMES.items()} | {0: FRICTIONLESS_CONTACT}
    values = np.asarray(state)
    if f is not None:
        slides = (values == State.STICK) & (np.asarray(f, dtype=float) <= 0.0)
        values = np.where(slides, 0, values)
    starts = np.flatnonzero(np.diff(values)) + 1
    begin = [0.0] if begins_on_axis else x[:1]
    ends = np.concatenate([begin, 0.5 * (x[starts - 1] + x[starts]), x[-1:]])
    first = np.concatenate([[0], starts])
    return [
        (names[int(values[i])], float(a), float(b))
        for i, a, b in zip(first, ends[:-1], ends[1:], strict=True)
    ]


def contact_half_width(x: Array, state: NDArray[np.integer], begins_on_axis: bool = False) -> float:
    """Return :func:`half_width` of the contact; NaN also where it consists of several zones."""
    return half_width(x, contact_zone(x, state, begins_on_axis), begins_on_axis)


def stick_half_width(
    x: Array,
    state: NDArray[np.integer],
    f: Array | Flags | None = None,
    begins_on_axis: bool = False,
) -> float:
    """Return :func:`half_width` of the stick zone around the middle of the edge.

    Args:
        x: (N,) positions, increasing.
        state: (N,) values of :class:`State`.
        f: (N,) coefficient of friction: nodes without friction do not stick.
        begins_on_axis: the edge begins on the axis, at x = 0; that is its middle.
    """
    return half_width(x, stick_zone(x, state, f, begins_on_axis), begins_on_axis)


NodeRange = tuple[int, int]
"""First and last node of a zone; (0, -1) of one without nodes."""


def half_width(x: Array, zone: NodeRange | None, begins_on_axis: bool = False) -> float:
    """Return half the width of a zone around the middle, or its radius; 0 where it has no nodes.

    NaN where there are such nodes, but no zone of them that has a half width: see
    :func:`central_zone`.
    """
    if zone is None or zone == (0, -1):
        return np.nan if zone is None else 0.0
    left, right = _midway(x, *zone)
    return right if begins_on_axis else 0.5 * (right - left)


def contact_zone(
    x: Array, state: NDArray[np.integer], begins_on_axis: bool = False
) -> NodeRange | None:
    """Return :func:`central_zone` of the closed nodes; None where they form several zones."""
    touches = np.asarray(state) != State.SEPARATION
    found = central_zone(x, touches, begins_on_axis)
    whole = found is not None and found[1] - found[0] + 1 == np.count_nonzero(touches)
    return found if whole else None


def stick_zone(
    x: Array,
    state: NDArray[np.integer],
    f: Array | Flags | None = None,
    begins_on_axis: bool = False,
) -> NodeRange | None:
    """Return :func:`central_zone` of the sticking nodes; arguments as :func:`stick_half_width`."""
    sticks = np.asarray(state) == State.STICK
    if f is not None:
        sticks &= np.asarray(f, dtype=float) > 0.0
    return central_zone(x, sticks, begins_on_axis)


def central_zone(
    x: Array, inside: NDArray[np.bool_], begins_on_axis: bool = False
) -> NodeRange | None:
    """Find the zone of marked nodes around the middle of the edge, symmetric within a node.

    Where the edge begins on the axis, the zone does. Returned are its first and last node; (0, -1)
    when no node is marked; None when some are, but none of their zones lies around the middle, or
    that one is not symmetric.
    """
    if not np.any(inside):
        return (0, -1)
    centre = 0.5 * (x[0] + x[-1])
    first = 0
    for last in np.append(np.flatnonzero(np.diff(inside)), len(x) - 1):
        low, high = _midway(x, first, last)
        if inside[first] and (first == 0 if begins_on_axis else low <= centre <= high):
            node = max(x[last] - x[max(last - 1, 0)], x[min(first + 1, len(x) - 1)] - x[first])
            # the halves differ by a spacing at most
            even = begins_on_axis or abs(low + high - 2.0 * centre) <= (1.0 + 1e-9) * node
            return (int(first), int(last)) if even else None
        first = last + 1
    return None


def _midway(x: Array, first: int, last: int) -> tuple[float, float]:
    """Return the ends of the zone from one node to another, midway to the next ones."""
    low = 0.5 * (x[max(first - 1, 0)] + x[first])
    return float(low), float(0.5 * (x[last] + x[min(last + 1, len(x) - 1)]))


def begins_on_axis(radius: Array, weight: Array) -> bool:
    """Return whether an axisymmetric contact edge begins on the axis r = 0.

    At order 2 the node on the axis has no weight and is left out. The next one is the middle of an
    element from r = 0 to h = 2 r_0, with a weight in proportion to h^2 / 3; the node behind it has
    h (h + h') / 6, with h' of the next element, 0 where there is none. Weights are integrals of the
    shape functions times r.
    """
    if len(radius) == 0 or radius[0] <= 1e-6 * radius[-1]:
        return len(radius) > 0
    h = 2.0 * radius[0]
    if len(radius) < 2 or abs(radius[1] - h) > 1e-6 * h:
        return False
    beyond = radius[3] - radius[1] if len(radius) > 3 else 0.0
    expected = 2.0 * h * weight[1]
    return bool(abs(weight[0] * (h + beyond) - expected) <= 1e-6 * expected)


def on_axis(x: Array, values: Array) -> Array:
    """Return the value at r = 0 of fields (..., N) that are even in r, fitted by a + b r^2.

    A node on the axis itself is left out: its weight is the smallest by far (at order 2 it has
    none), and so its traction is the least certain.
    """
    near = np.flatnonzero(x > 0.0)[:5]
    basis = np.stack([np.ones(len(near)), (x[near] / x[near[-1]]) ** 2], axis=1)
    fit = np.linalg.lstsq(basis, np.asarray(values)[..., near].T, rcond=None)[0]
    return np.asarray(fit[0])
