"""The whole body at one instant: mesh, outline, contact, arrows of loads, in a picture's units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk.closures import driven_gaps
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.law import Friction, State, friction_of
from receding_fenicsx.interface.measures.zones import begins_on_axis
from receding_fenicsx.interface.mirror import AXIS_TOLERANCE, mirror_nodes
from receding_fenicsx.output.plots import labels
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.one_body import in_order
from receding_fenicsx.scene.profiles import directions, evaluate
from receding_fenicsx.scene.symmetry import HORIZONTAL, edge_points, edge_range

if TYPE_CHECKING:
    from receding_fenicsx.bulk.stack import Stack


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
    tangent: Array  # (N, 2) unit vector t
    normal: Array  # (N, 2) unit vector n
    state: NDArray[np.int8]
    p: Array  # (N,) traction P/m on the body; nan at nodes without weight
    q: Array  # (N,) traction Q/m
    v: Array  # (N,) tangential displacement
    w: Array  # (N,) normal displacement
    initial_gap: Array  # (N,) gap g0
    driven_gap: Array  # (N,) gap by loads and interference at this instant
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
        driven_gap=mirror.even(instant.load @ driven_gaps(scene, contact)),
        shown=mirror.states(instant.state.state if instant.shown is None else instant.shown),
    )


@dataclass(frozen=True)
class Units:
    """Exaggeration of displacements and unit of stresses in a picture."""

    factor: float  # factor of the displacements
    traction: float  # unit of the stresses
    symbol: str  # symbol of this unit; "" for the scene's own units


@dataclass(frozen=True)
class Strip:
    """Contact nodes of one contact edge in a picture."""

    name: str
    x: Array  # (N,) positions along the edge
    place: Array  # (N, 2) undeformed coordinates
    moved: Array  # (N, 2) coordinates after the exaggerated deformation of the first body
    normal: Array  # (2,) unit normal n into the body
    gap: Array  # (N,) exaggerated initial gap, from the contact nodes to the plane
    state: NDArray[np.int8]
    rigid: bool  # whether the other side is a rigid plane, not a second body

    @property
    def direction(self) -> Array:
        """(2,) unit vector of increasing x."""
        return np.asarray((self.place[-1] - self.place[0]) / (self.x[-1] - self.x[0]))


@dataclass(frozen=True)
class Arrows:
    """Arrows of the tractions of one load."""

    tails: Array  # (n, 2)
    heads: Array  # (n, 2)
    joined: bool  # whether a line through the tails is drawn


@dataclass(frozen=True)
class View:
    """The whole body at one instant; lengths and stresses in the picture's units."""

    points: Array  # (n, 2) vertices
    moved: Array  # (n, 2) vertices after the exaggerated deformation
    cells: NDArray[np.int64]  # (m, 3 or 4) vertices around each cell
    stress: dict[str, Array]  # (n,) stresses by name
    factor: float  # exaggeration of displacements
    # length to which arrows and marks are proportional: the body's smaller extent, or half the
    # length of a small contact
    size: float
    near: bool  # whether the picture is a close-up of the contact
    strips: tuple[Strip, ...]  # the contact edges
    p: Array  # (N,) traction on the first contact edge; nan at nodes without weight
    q: Array  # (N,)
    f: Friction  # friction, forward and backward, of the N nodes on the first contact edge
    arrows: list[Arrows]  # arrows of the loads
    x_label: str  # label of positions along the first contact edge
    pressure_symbol: str  # symbol of the unit of stress; "" for the scene's own unit
    stress_unit: str  # this unit; "" if it is not known or stresses are nondimensional
    caption: str  # description of the instant

    @property
    def x(self) -> Array:
        """(N,) positions along the first contact edge."""
        return self.strips[0].x

    @property
    def friction(self) -> bool:
        """Whether there is friction; assumed with several contact edges."""
        return len(self.strips) > 1 or bool(np.any(self.f.present))


def view_of(bulk: Stack, fields: Fields, instant: Instant, units: Units | None = None) -> View:
    """Return the view of the whole body at one instant, on rank 0; by default in its own units."""
    scene = bulk.scene
    length = labels.length_of(scene)
    unit = length or 1.0
    units = units or units_of(bulk, [fields], instant.load)
    size, near = _size(bulk, fields)
    strips, p, q, f = _contact(bulk, fields, instant, units, unit)
    arrows = load_arrows(scene, fields, instant.load, units.factor, size)
    first = strips[0]
    radial = scene.axisymmetric and np.allclose(np.abs(first.place[:, 0]), np.abs(first.x))
    return View(
        points=fields.points / unit,
        moved=(fields.points + units.factor * fields.displacement) / unit,
        cells=fields.cells,
        stress={name: value / units.traction for name, value in fields.stress.items()},
        factor=units.factor,
        size=size / unit,
        near=near,
        strips=strips,
        p=p,
        q=q,
        f=f,
        arrows=[Arrows(a.tails / unit, a.heads / unit, a.joined) for a in arrows],
        x_label=labels.position_label("h" if length else "", radial, scene.units),
        pressure_symbol=units.symbol,
        stress_unit=labels.shown_unit(scene.units.stress),
        caption=_caption(scene, instant),
    )


def _contact(
    bulk: Stack, fields: Fields, instant: Instant, units: Units, unit: float
) -> tuple[tuple[Strip, ...], Array, Array, Friction]:
    """Return the contact edges of the whole body, and p, q and f on the first of them."""
    scene, found, strips = bulk.scene, whole_contact(bulk, instant), []
    for k, described in enumerate(scene.contacts):
        on = found.edge == k
        place, normal = found.points[on], found.normal[on][0]
        displacement = edge_values(fields, fields.displacement, place, normal, found.body[on][0])
        moved = place + units.factor * displacement
        gap = units.factor * (found.initial_gap + found.driven_gap)[on] / unit
        at, x, state = place / unit, found.x[on] / unit, found.shown[on]
        rigid = described.against is None
        strips.append(Strip(described.edge, x, at, moved / unit, normal, gap, state, rigid))
    on = found.edge == 0
    p, q = found.p[on] / units.traction, found.q[on] / units.traction
    argument, first = found.argument[on], scene.contacts[0]
    forward, backward = (evaluate(f, argument) for f in directions(first.friction))
    # outward slip is forward on the right of the axis and backward on the left
    left = found.x[on] != argument
    forward, backward = np.where(left, backward, forward), np.where(left, forward, backward)
    cohesion, limit = (
        None if profile is None else evaluate(profile, argument) / units.traction
        for profile in (first.cohesion, first.shear_limit)
    )
    return tuple(strips), p, q, friction_of(forward, backward, 1.0, (cohesion, limit))


def units_of(bulk: Stack, fields: list[Fields], load: Array, symbol: str = "") -> Units:
    """Choose the units of pictures; stresses are over the pressure at a load, with this symbol."""
    size, _ = _size(bulk, fields[0])
    largest = max(float(np.linalg.norm(f.displacement, axis=1).max()) for f in fields)
    factor = 1.0
    if largest > 0.0:
        # displacements of up to a tenth of the view's size; one significant digit, rounded down
        power = 10.0 ** np.floor(np.log10(0.1 * size / largest))
        factor = float(f"{np.floor(0.1 * size / largest / power) * power:.0e}")
    if all(body.is_half_plane for body in bulk.scene.bodies) and len(bulk.scene.bodies) > 1:
        factor = min(factor, 1.0)  # the gap between them is not drawn, they would overlap
    pressure, own = labels.pressure_of(bulk.scene, bulk.scene.load_names)
    traction = pressure * abs(float(load[0])) if own else 0.0
    return Units(factor, traction, symbol or own) if traction else Units(factor, 1.0, "")


def _size(bulk: Stack, fields: Fields) -> tuple[float, bool]:
    """Return the size of a view in the scene's units, and whether it is a close-up."""
    length = (1.0 + bulk.body.half) * float(np.linalg.norm(np.ptp(bulk.contact.points, axis=0)))
    extent = np.ptp(fields.points, axis=0)
    # length of the contact, over the body's larger extent, below which the picture is a close-up
    near = length < 0.2 * float(extent.max())
    return min(0.5 * length, float(extent.min())) if near else float(extent.min()), near


def _caption(scene: Scene, instant: Instant) -> str:
    """Describe an instant: its leg and its load factors."""
    path, names = history.history_from_scene(scene), scene.load_names
    sizes = enumerate(np.abs(path.parts(part)).sum(axis=1) for part in (path.path, path.loop))
    falling = [(c, k) for c, size in sizes for k in np.flatnonzero(np.diff(size) < 0.0)]
    plain = len(path.loop) <= 3 and len(names) == 1
    falls = (min(instant.cycle, 1), instant.leg) in falling
    first = falling[:1] == [(instant.cycle, instant.leg)]
    way = labels.name_leg(instant.cycle, instant.leg, falls, first, plain)
    parts = instant.load / largest_factors(scene)
    told = labels.told_loads(scene, names, instant.load)
    return ", ".join([way, *(labels.describe_factor(names[k], float(parts[k])) for k in told)])


def load_arrows(
    scene: Scene, fields: Fields, factors: Array, exaggeration: float, size: float
) -> list[Arrows]:
    """Return the arrows of loads on rectangles, at the deformed edges, in the scene's lengths."""
    names = scene.load_names
    largest = dict(zip(names, largest_factors(scene), strict=True))
    # over the size of the view: largest distance between arrows 0.22, from the edge 0.02, length of
    # the arrow of the largest traction 0.24
    found = [
        (unit, *_traction(scene, unit, 0.22 * size))
        for load in scene.loads
        if load in scene.edge_loads and scene.find_edge(load.edge)[0].is_rectangle
        for unit in load.units
    ]
    sizes = [largest[load.name] * np.linalg.norm(t, axis=1).max() for load, *_, t in found]
    if not any(sizes):
        return []
    bodies, arrows = in_order(scene), []
    for load, points, outward, traction in found:
        part = float(factors[names.index(load.name)]) / max(sizes)
        vector = 0.24 * size * part * traction
        if not np.any(vector):
            continue
        body = bodies.index(scene.find_edge(load.edge)[0])
        moved = edge_values(fields, fields.displacement, points, outward, body)
        at = points + exaggeration * moved
        inward = vector @ outward < 0.0
        tails = np.where(inward[:, None], at - vector, at) + 0.02 * size * outward
        arrows.append(Arrows(tails, tails + vector, bool(inward.all())))
    return arrows


def largest_factors(scene: Scene) -> Array:
    """Return (n_loads,) the largest absolute load factors over the history, 1 in place of 0."""
    path = history.history_from_scene(scene)
    largest = np.abs(np.vstack([path.path, path.loop])).max(axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def _traction(scene: Scene, load: Load, spacing: float) -> tuple[Array, Array, Array]:
    """Return points (n, 2), outward normal and tractions (n, 2) of a load with factor 1."""
    begin, end = edge_range(scene, load.edge)
    # of a load that travels, the part on the edge
    place = load.travel[0] if load.travel else 0.0
    if load.span is not None:
        begin, end = (float(np.clip(s + place, begin, end)) for s in load.span)
    edge = scene.find_edge(load.edge)[1]
    sides = {"bottom": (0.0, -1.0), "top": (0.0, 1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}
    level, outward = scene.axisymmetric and edge in HORIZONTAL, np.array(sides[edge])
    area = np.pi * (end**2 - begin**2) if level else end - begin
    begin = -end if level and begin == 0.0 else begin
    along = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / spacing)) + 1))
    at = np.stack(edge_points(scene, load.edge, along), axis=1)
    x, y = edge_points(scene, load.edge, along - place)
    side = np.where(level & (x < 0.0), -1.0, 1.0)
    if load.pressure is not None:
        size = evaluate(load.pressure, side * x, y)
        traction = -size[:, None] * outward
    else:
        mean = (load.force[0] / area, load.force[1] / area) if load.force else (0.0, 0.0)
        parts = load.traction or mean
        traction = np.stack([evaluate(part, side * x, y) for part in parts], axis=1)
        traction[:, 0] *= side
    return at, outward, traction
