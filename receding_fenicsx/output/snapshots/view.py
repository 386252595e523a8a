"""What a picture of the body shows, as arrays: deformed mesh, outline, loads, contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.evolution.collect import Instant
from receding_fenicsx.interface.measures.axis import begins_on_axis
from receding_fenicsx.interface.mirror import mirror_nodes
from receding_fenicsx.interface.system import Array
from receding_fenicsx.output.plots.units import describe_factors, length_of, name_leg, pressure_of
from receding_fenicsx.scene import history
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.rectangle_edges import HORIZONTAL, edge_points, edge_range

if TYPE_CHECKING:
    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.two_bodies import Pair

EXAGGERATED = 0.1
"""Largest displacement in the picture over the body's smaller extent."""
ARROW = 0.24
"""Length of the arrow of the largest traction over the body's smaller extent."""
ARROW_GAP = 0.22
"""Distance between arrows, likewise, or a little less."""
SMALL = 0.2
"""Extent of the contact over the body's larger one below which it is shown from near by."""
ON_EDGE = 1e-9
"""Distance from an edge, over the body's size, within which a vertex lies on it."""
OUTWARD = {"bottom": (0.0, -1.0), "top": (0.0, 1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}


@dataclass(frozen=True)
class Arrows:
    """Tractions of one load.

    Attributes:
        tails, heads: (n, 2) ends of the arrows.
        joined: the tails lie on a line that is drawn.
    """

    tails: Array
    heads: Array
    joined: bool


@dataclass(frozen=True)
class Units:
    """What a picture's displacements and stresses are shown in.

    Attributes:
        factor: exaggeration of displacements.
        traction: what stresses are divided by.
        symbol: its symbol; "" for the scene's own units.
    """

    factor: float
    traction: float
    symbol: str


@dataclass(frozen=True)
class Strip:
    """A contact edge in a picture.

    Attributes:
        name: of the edge.
        x, place: (N,) positions along the edge, (N, 2) contact nodes.
        moved: (N, 2) contact nodes of the first body after the exaggerated deformation.
        normal: (2,) unit vector into the body.
        gap: (N,) exaggerated initial gap, from the contact nodes to the plane.
        state: (N,) states.
    """

    name: str
    x: Array
    place: Array
    moved: Array
    normal: Array
    gap: Array
    state: NDArray[np.int8]

    @property
    def direction(self) -> Array:
        """(2,) unit vector along which x grows."""
        return np.asarray((self.place[-1] - self.place[0]) / (self.x[-1] - self.x[0]))


@dataclass(frozen=True)
class View:
    """A body at one instant; all lengths over the length scale, all stresses over the pressure's.

    Attributes:
        points, moved: (n, 2) vertices before and after the exaggerated deformation.
        cells: (m, 3 or 4) vertices around each cell.
        edges: (k, 2) vertices of the outline's pieces.
        stress: by name, (n,).
        factor: exaggeration of displacements.
        size: what is drawn beside the body is in proportion to: the body's smaller extent, or half
            of a contact that is small beside it.
        near: only the contact and what is around it is to be shown.
        strips: the contact edges.
        rigid: what the body touches is a rigid plane, no second body.
        p, q: (N,) tractions on the first edge; nan where a node stands for no length.
        f: (N,) coefficients of friction on the first edge.
        arrows: the loads.
        length_symbol, pressure_symbol: what is divided by; "" for the scene's own units.
        caption: which instant this is.
        axisymmetric: positions along the contact edge are radii.
    """

    points: Array
    moved: Array
    cells: NDArray[np.int64]
    edges: NDArray[np.int64]
    stress: dict[str, Array]
    factor: float
    size: float
    near: bool
    strips: tuple[Strip, ...]
    rigid: bool
    p: Array
    q: Array
    f: Array
    arrows: list[Arrows]
    length_symbol: str
    pressure_symbol: str
    caption: str
    axisymmetric: bool

    @property
    def x(self) -> Array:
        """(N,) positions along the first contact edge."""
        return self.strips[0].x

    @property
    def friction(self) -> bool:
        """Whether there is friction; of further edges that is not known."""
        return len(self.strips) > 1 or bool(np.any(self.f > 0.0))

    @property
    def state(self) -> NDArray[np.int8]:
        """(N,) states on the first contact edge."""
        return self.strips[0].state


def view_of(
    bulk: Bulk | Pair, fields: Fields, instant: Instant, units: Units | None = None
) -> View:
    """Put together what a picture shows, on rank 0.

    Args:
        bulk: the body.
        fields: its fields at the instant.
        instant: state of the modelled contact nodes.
        units: what it is shown in; what suits the instant when left out.

    Returns:
        The view of the whole body.
    """
    scene, contact = bulk.scene, bulk.contact
    if bulk.body.half:
        fields = _joined(fields)
    length = length_of(scene)
    unit = length or 1.0
    shown = units or units_of(bulk, [fields], instant.load)
    now, factor = shown.traction, shown.factor
    # the image of a contact that does not reach the axis of revolution is left out
    whole = bulk.body.half and (not scene.axisymmetric or begins_on_axis(contact.x))
    mirror = mirror_nodes(contact.x, whole, contact.edge)
    edge = contact.edge[mirror.index]
    # of several contact edges the tractions of the first are shown
    on = edge == 0
    weight = mirror.total(contact.weight)
    per_length = np.where(weight > 0.0, 1.0 / np.where(weight > 0.0, weight, 1.0), np.nan) / now
    flip = np.where(mirror.left, -1.0, 1.0)
    size, near = _size(bulk, fields)
    place = contact.points[mirror.index] * np.stack([flip, np.ones_like(flip)], axis=1)
    x = flip * contact.x[mirror.index]
    # profiles know the radius
    along = np.abs(x) if scene.axisymmetric else x
    state = mirror.states(instant.state.state)
    strips = []
    for k, described in enumerate(scene.contacts):
        nodes = edge == k
        gap = factor * evaluate(described.initial_gap, along[nodes])
        normal = contact.normal[mirror.index][nodes][0]
        moved = place[nodes] + factor * _shift(fields, place[nodes], normal)
        strips.append(
            Strip(
                described.edge,
                x[nodes] / unit,
                place[nodes] / unit,
                moved / unit,
                normal,
                gap / unit,
                state[nodes],
            )
        )
    return View(
        points=fields.points / unit,
        moved=(fields.points + factor * fields.displacement) / unit,
        cells=fields.cells,
        edges=_outline(fields.cells),
        stress={name: value / now for name, value in fields.stress.items()},
        factor=factor,
        size=size / unit,
        near=near,
        strips=tuple(strips),
        rigid=scene.contacts[0].against is None,
        p=(mirror.total(instant.state.P) * per_length)[on],
        q=(mirror.odd(instant.state.Q) * per_length)[on],
        f=evaluate(scene.contacts[0].friction, along[on]),
        arrows=_arrows(scene, fields, bulk.load_names, instant.load, (factor, unit, size)),
        length_symbol="h" if length else "",
        pressure_symbol=shown.symbol,
        caption=_caption(scene, bulk.load_names, instant),
        axisymmetric=scene.material_of(scene.body).kinematics == "axisymmetric",
    )


def units_of(bulk: Bulk | Pair, fields: list[Fields], load: Array, symbol: str = "") -> Units:
    """Choose what one picture, or several alike, are shown in.

    Args:
        bulk: the body.
        fields: its fields in all of them.
        load: (n_loads,) load factors whose pressure stresses are divided by.
        symbol: symbol of that pressure; that of the load when left out.
    """
    size, _ = _size(bulk, fields[0])
    largest = max(float(np.linalg.norm(f.displacement, axis=1).max()) for f in fields)
    factor = _round(EXAGGERATED * size / largest) if largest > 0.0 else 1.0
    pressure, own = pressure_of(bulk.scene, bulk.load_names)
    traction = pressure * abs(float(load[0])) if own else 0.0
    return Units(factor, traction, symbol or own) if traction else Units(factor, 1.0, "")


def vertex_areas(view: View) -> Array:
    """(n,) each vertex's share of the cells around it."""
    corners = view.points[view.cells]
    x, y = corners[..., 0], corners[..., 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    width = view.cells.shape[1]
    share = np.repeat(area / width, width)
    return np.asarray(np.bincount(view.cells.ravel(), share, len(view.points)), dtype=float)


def _size(bulk: Bulk | Pair, fields: Fields) -> tuple[float, bool]:
    """Return a view's size in the scene's units, and whether it shows only the contact."""
    length = float(np.linalg.norm(np.ptp(bulk.contact.points, axis=0)))
    length *= 2.0 if bulk.body.half else 1.0
    extent = np.ptp(fields.points, axis=0)
    near = length < SMALL * float(extent.max())
    return min(0.5 * length, float(extent.min())) if near else float(extent.min()), near


def _round(value: float) -> float:
    """Return the nearest number below with one figure."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{np.floor(value / power) * power:.0e}")


def _joined(fields: Fields) -> Fields:
    """Make one vertex, with their mean values, of the two that the halves have on the axis."""
    axis = np.flatnonzero(np.abs(fields.points[:, 0]) <= ON_EDGE * np.abs(fields.points).max())
    # vertices of two bodies stay apart
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


def _outline(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges that belong to one cell only."""
    sides = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return np.asarray(edges[count == 1], dtype=np.int64)


def largest_factors(scene: Scene) -> Array:
    """(n_loads,) largest absolute factor of each load over the history; 1 where it is 0."""
    path = history.from_scene(scene)
    largest = np.abs(np.vstack([path.path, path.loop])).max(axis=0)
    return np.where(largest > 0.0, largest, 1.0)


def _caption(scene: Scene, names: tuple[str, ...], instant: Instant) -> str:
    """Say which instant this is."""
    path = history.from_scene(scene)
    legs = [(0, k, a, b) for k, (a, b) in enumerate(zip(path.path, path.path[1:], strict=False))]
    legs += [(1, k, a, b) for k, (a, b) in enumerate(zip(path.loop, path.loop[1:], strict=False))]
    falling = [(c, k) for c, k, a, b in legs if np.abs(b).sum() < np.abs(a).sum()]
    plain = len(path.loop) <= 3 and len(names) == 1
    falls = (min(instant.cycle, 1), instant.leg) in falling
    first = falling[:1] == [(instant.cycle, instant.leg)]
    way = name_leg(instant.cycle, instant.leg, falls, first, plain)
    return f"{way}, {describe_factors(names, instant.load / largest_factors(scene))}"


def _arrows(
    scene: Scene,
    fields: Fields,
    names: tuple[str, ...],
    factors: Array,
    units: tuple[float, float, float],
) -> list[Arrows]:
    """Arrows of the loads that act on the edges of rectangles, at their deformed edges."""
    exaggeration, unit, size = units
    largest = dict(zip(names, largest_factors(scene), strict=True))
    found = []
    for load in scene.loads:
        if scene.find_edge(load.edge)[0].mesh is None:
            along, points, traction = _traction(scene, load, ARROW_GAP * size)
            found.append((load, along, points, traction))
    if not found:
        return []
    sizes = [largest[load.name] * np.linalg.norm(t, axis=1).max() for load, _, _, t in found]
    scale = ARROW * size / max([*sizes, np.finfo(float).tiny])
    arrows = []
    for load, along, points, traction in found:
        body, edge = scene.find_edge(load.edge)
        outward = np.array(OUTWARD[edge])
        first = scene.find_edge(scene.contacts[0].edge)[0]
        shift = _edge_shift(fields, points, outward, int(body != first))
        vector = scale * float(factors[names.index(load.name)]) * traction
        if not np.any(vector):
            continue
        at = points + exaggeration * shift
        inward = vector @ outward < 0.0
        tails = np.where(inward[:, None], at - vector, at)
        tails = tails + 0.02 * size * outward
        arrows.append(Arrows(tails / unit, (tails + vector) / unit, bool(inward.all())))
    return arrows


def _traction(scene: Scene, load: Load, gap: float) -> tuple[Array, Array, Array]:
    """Positions along the edge, points and tractions (n, 2) of a load with factor 1.

    A platen's is its mean; a prescribed displacement has none. What reaches the axis of a body of
    revolution is continued beyond it.
    """
    begin, end = load.span or edge_range(scene, load.edge)
    edge = scene.find_edge(load.edge)[1]
    level = scene.axisymmetric and edge in HORIZONTAL
    area = np.pi * (end**2 - begin**2) if level else end - begin
    begin = -end if level and begin == 0.0 else begin
    along = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / gap)) + 1))
    x, y = edge_points(scene, load.edge, along)
    side = np.where(level & (x < 0.0), -1.0, 1.0)
    if load.pressure is not None:
        size = evaluate(load.pressure, side * x, y)
        traction = -size[:, None] * np.array(OUTWARD[edge])
    else:
        mean = (load.force[0] / area, load.force[1] / area) if load.force else (0.0, 0.0)
        parts = load.traction or mean
        traction = np.stack([evaluate(part, side * x, y) for part in parts], axis=1)
        traction[:, 0] *= side
    return along, np.stack([x, y], axis=1), traction


def _shift(fields: Fields, place: Array, normal: Array) -> Array:
    """Displacement (N, 2) of the first body's contact nodes, from its vertices on their edge."""
    tangent = np.array([normal[1], -normal[0]])
    near = ON_EDGE * np.abs(fields.points).max()
    along = (fields.points - place[0]) @ tangent
    wanted = (place - place[0]) @ tangent
    on = np.abs((fields.points - place[0]) @ normal) <= near
    on &= (along >= wanted.min() - near) & (along <= wanted.max() + near)
    if fields.body is not None:
        on &= fields.body == 0
    order = np.argsort(along[on], kind="stable")
    position, moved = along[on][order], fields.displacement[on][order]
    return np.stack([np.interp(wanted, position, moved[:, k]) for k in (0, 1)], axis=1)


def _edge_shift(fields: Fields, points: Array, outward: Array, body: int) -> Array:
    """Displacement (n, 2) of points of an edge, from the vertices on it of the body's number."""
    height = fields.points @ outward
    on = np.abs(height - points[0] @ outward) <= ON_EDGE * np.abs(fields.points).max()
    if fields.body is not None:
        on &= fields.body == body
    axis = 1 if outward[0] else 0
    order = np.argsort(fields.points[on][:, axis], kind="stable")
    position, moved = fields.points[on][order][:, axis], fields.displacement[on][order]
    return np.stack([np.interp(points[:, axis], position, moved[:, k]) for k in (0, 1)], axis=1)
