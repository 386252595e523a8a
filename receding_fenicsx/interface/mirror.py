"""From the modelled half of a mirror-symmetric contact, or one radian, to the whole contact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import MIRRORED, Friction
from receding_fenicsx.interface.system import ContactSystem

AXIS_TOLERANCE = 1e-12
"""Distance from the axis, over the contact's length, below which a node lies on it."""


@dataclass(frozen=True)
class Mirror:
    """Maps nodal arrays of the model to the whole contact; the identity for a whole model."""

    index: NDArray[np.intp]  # (M,) modelled node behind each node of the whole contact
    left: NDArray[np.bool_]  # (M,) True for reflected nodes
    axis: NDArray[np.bool_]  # (M,) True for the node on the axis of a half model
    # 2 for a half model, 2 pi for one radian, else 1: whole-contact energies over modelled ones
    factor: float
    circle: float = 1.0  # 2 pi for one radian, else 1: nodal totals over modelled ones

    def even(self, a: Array) -> Array:
        """Return w-like values (last axis over nodes): equal on both sides."""
        return a[..., self.index]

    def odd(self, a: Array) -> Array:
        """Return v-like values: opposite on the two sides, zero on the axis."""
        values = np.where(self.left, -a[..., self.index], a[..., self.index])
        return np.where(self.axis, 0.0, values)

    def total(self, a: Array) -> Array:
        """Return P-like nodal totals: even, the axis node's doubled."""
        return self.circle * np.where(self.axis, 2.0, 1.0) * a[..., self.index]

    def odd_total(self, a: Array) -> Array:
        """Return Q-like nodal totals: opposite on the two sides, zero on the axis."""
        return self.circle * self.odd(a)

    def states(self, a: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return states: forward and backward slip change places on reflected nodes."""
        swapped = MIRRORED[a]
        return np.where(self.left, swapped[..., self.index], a[..., self.index])

    def friction(self, a: Friction) -> Friction:
        """Return coefficients of friction: forward and backward change places when reflected."""
        reflected = a.mirrored[self.index]
        here = a[self.index]
        return replace(
            here,
            forward=np.where(self.left, reflected.forward, here.forward),
            backward=np.where(self.left, reflected.backward, here.backward),
        )

    def nodes(self, i: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the whole-contact nodes of modelled nodes (k,), each after the row of its i."""
        order, count = np.argsort(self.index, kind="stable"), np.bincount(self.index)
        rows = np.repeat(np.arange(len(i)), count[i])
        first = np.cumsum(count[i]) - count[i]
        begin = np.cumsum(count) - count
        return rows, order[begin[i[rows]] + np.arange(len(rows)) - first[rows]]


def mirror_of(system: ContactSystem) -> Mirror:
    """Return the map from the modelled nodes to the whole contact."""
    mirror = mirror_nodes(system.x, system.half, system.edge)
    if system.axisymmetric:
        return replace(mirror, factor=2.0 * np.pi, circle=2.0 * np.pi)
    return mirror


def mirror_nodes(
    x: Array, half: bool | NDArray[np.bool_], edge: NDArray[np.int64] | None = None
) -> Mirror:
    """Return the map to the whole contact for nodes at x, those of the half x >= 0 or all.

    With several edges each is its own mirror image; ``half`` may differ between them, (N,).
    """
    n = len(x)
    if np.any(half) and edge is not None and len(np.unique(edge)) > 1:
        places = [np.flatnonzero(edge == k) for k in np.unique(edge)]
        halves = np.broadcast_to(half, n)
        parts = [mirror_nodes(x[place], halves[place]) for place in places]
        return Mirror(
            np.concatenate([p[part.index] for p, part in zip(places, parts, strict=True)]),
            np.concatenate([part.left for part in parts]),
            np.concatenate([part.axis for part in parts]),
            2.0,
        )
    if not np.any(half):
        none = np.zeros(n, dtype=bool)
        return Mirror(np.arange(n), none, none.copy(), 1.0)
    on_axis = np.abs(x) <= AXIS_TOLERANCE * np.abs(x).max()
    reflected = np.flatnonzero(~on_axis)[::-1]
    index = np.concatenate([reflected, np.arange(n)])
    left = np.arange(len(index)) < len(reflected)
    return Mirror(index, left, on_axis[index] & ~left, 2.0)
