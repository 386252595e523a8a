"""The whole body and its whole contact, with both halves of a modelled half."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.zones import begins_on_axis
from receding_fenicsx.interface.mirror import AXIS_TOLERANCE, mirror_nodes
from receding_fenicsx.scene.one_body import in_order
from receding_fenicsx.scene.profiles import evaluate

if TYPE_CHECKING:
    from receding_fenicsx.bulk.stack import Stack

# -- vertices of the fields ----------------------------------------------------------------------


def merge_axis(fields: Fields) -> Fields:
    """Merge the vertices of both halves of a body on the axis x = 0; average their values."""
    near = 1e-9 * np.abs(fields.points).max()
    axis = np.flatnonzero(np.abs(fields.points[:, 0]) <= near)
    # vertices of two bodies are not merged
    bodies = np.zeros(len(axis)) if fields.body is None else fields.body[axis]
    keys = np.stack([fields.points[axis, 1], bodies], axis=1)
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = fields.points.copy()
    points[axis, 0] = 0.0
    target = np.arange(len(fields.points))
    target[axis] = axis[first][place]
    count = np.bincount(target, minlength=len(target)).astype(float)
    used = np.flatnonzero(count)

    def mean(values: Array) -> Array:
        return np.bincount(target, values, minlength=len(target))[used] / count[used]

    return Fields(
        points=points[used],
        cells=np.searchsorted(used, target[fields.cells]),
        displacement=np.stack([mean(part) for part in fields.displacement.T], axis=1),
        stress={name: mean(values) for name, values in fields.stress.items()},
        body=None if fields.body is None else fields.body[used],
    )


def outline(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (k, 2) vertices of the edges that belong to one cell only."""
    sides = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return np.asarray(edges[count == 1], dtype=np.int64)


def vertex_areas(points: Array, cells: NDArray[np.int64]) -> Array:
    """Return (n,) areas of the vertices: equal shares of the cells around each."""
    x, y = np.moveaxis(points[cells], 2, 0)
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    width = cells.shape[1]
    share = np.repeat(area / width, width)
    return np.asarray(np.bincount(cells.ravel(), share, len(points)), dtype=float)


def edge_values(fields: Fields, values: Array, place: Array, normal: Array, body: int = 0) -> Array:
    """Interpolate values (n, k) of the vertices at points (m, 2) of a straight edge of a body."""
    tangent = np.array([normal[1], -normal[0]])
    near = 1e-9 * np.abs(fields.points).max()
    along = (fields.points - place[0]) @ tangent
    wanted = (place - place[0]) @ tangent
    on = np.abs((fields.points - place[0]) @ normal) <= near
    on &= (along >= wanted.min() - near) & (along <= wanted.max() + near)
    if fields.body is not None:
        on &= fields.body == body
    order = np.argsort(along[on], kind="stable")
    position, known = along[on][order], values[on][order]
    return np.stack([np.interp(wanted, position, column) for column in known.T], axis=1)


# -- nodes of the contact ------------------------------------------------------------------------


@dataclass(frozen=True)
class WholeContact:
    """The N nodes of all contact edges, a modelled half with its mirror image.

    An axisymmetric contact on a plane z = const that begins on the axis has both sides of a section
    through the axis; one on a cylinder or a cone has the side r > 0.
    """

    x: Array  # (N,) position along the node's edge
    argument: Array  # (N,) argument of friction and gap: x, on the other side of the axis -x
    points: Array  # (N, 2) coordinates
    edge: Ints  # (N,) number of the contact edge
    body: Ints  # (N,) number of the first body of the contact, as in ``Fields.body``
    # tangent, normal: (N, 2) unit vectors t and n
    tangent: Array
    normal: Array
    state: NDArray[np.int8]  # (N,) states
    # p, q: (N,) tractions P/m and Q/m on the body; nan at nodes without weight
    p: Array
    q: Array
    # v, w: (N,) tangential and normal displacement
    v: Array
    w: Array
    initial_gap: Array  # (N,) gap g0
    shown: NDArray[np.int8]  # (N,) states that pictures show


def whole_contact(bulk: Stack, instant: Instant) -> WholeContact:
    """Return the whole contact at one instant of its modelled nodes."""
    scene, contact = bulk.scene, bulk.contact
    half = np.full(len(contact.x), bulk.body.half)
    if scene.axisymmetric:
        for k in np.unique(contact.edge):
            on = contact.edge == k
            level = np.ptp(contact.points[on, 1]) <= AXIS_TOLERANCE * np.ptp(contact.x[on])
            half[on] = level and begins_on_axis(contact.points[on, 0], contact.weight[on])
    mirror = mirror_nodes(contact.x, half, contact.edge)
    side = np.where(mirror.left, -1.0, 1.0)
    x = side * contact.x[mirror.index]
    argument = contact.x[mirror.index] if scene.axisymmetric else x
    edge = contact.edge[mirror.index]
    gap = np.zeros(len(x))
    bodies, owners = in_order(scene), []
    for k, described in enumerate(scene.contacts):
        gap[edge == k] = evaluate(described.initial_gap, argument[edge == k])
        owners.append(bodies.index(scene.find_edge(described.edge)[0]))
    weight = mirror.total(contact.weight)
    weight = np.where(weight > 0.0, weight, np.nan)
    # open nodes carry no force, the rest is round-off; reactions of supports are no tractions
    without = np.tile(instant.state.state == State.SEPARATION, 2) | contact.held
    Q, P = np.split(np.where(without, 0.0, instant.state.r), 2)
    return WholeContact(
        x=x,
        argument=argument,
        points=contact.points[mirror.index] * np.stack([side, np.ones_like(side)], axis=1),
        edge=edge,
        body=np.array(owners)[edge],
        tangent=contact.tangent[mirror.index],
        normal=contact.normal[mirror.index],
        state=mirror.states(instant.state.state),
        p=mirror.total(P) / weight,
        q=mirror.odd_total(Q) / weight,
        v=mirror.odd(instant.v),
        w=mirror.even(instant.state.w),
        initial_gap=gap,
        shown=mirror.states(instant.state.state if instant.shown is None else instant.shown),
    )
