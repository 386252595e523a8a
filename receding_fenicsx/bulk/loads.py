r"""Integrals over facets of edges; nodal forces of the loads on edges and on bodies.

A body force $b$ has the nodal forces $f_i = \int N_i\, b \, dV$. A thermal strain
$\varepsilon^\theta = \alpha\, \Delta T\, 1$ in $\sigma = C (\varepsilon - \lambda\,
\varepsilon^\theta)$ has those of the stress that would hold it,
$f_i = \int C \varepsilon^\theta : \varepsilon(N_i) \, dV$. Both are forces to the condensation:
they alter $r^*$ alone, and their work-conjugates are $f \cdot u$: for the thermal strain
$\int E / (1 - 2 \nu)\, \alpha \Delta T\, \mathrm{tr}\, \varepsilon \, dV$ (plane stress
$E / (1 - \nu)$). Where stresses are evaluated, the load's factor times $\varepsilon^\theta$ is
subtracted from the strain (`elasticity.thermal_strain`); on elements of order 1, whose strain is
that of the cell's midpoint, at the midpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import basix
import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.elasticity import free_strain, stiffness_in, strain_of
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.raw_mesh import Arcs, gauss
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.profiles import Profile, evaluate, evaluate_checked


@dataclass(frozen=True)
class EdgeFacets:
    """Straight boundary facets of all ranks, alike on every rank."""

    # (n, nodes, 2) coordinates of a facet's nodes: both ends, and at order 2 the middle
    points: Array
    nodes: Ints  # (n, nodes) their global numbers
    outward: Array  # (n, 2) unit normals

    def __len__(self) -> int:
        """Return the number of facets."""
        return len(self.nodes)


def edge_facets(
    space: fem.FunctionSpace, body: BodyMesh, edge: str, span: tuple[float, float] | None = None
) -> EdgeFacets:
    """Find the facets of a named edge; an edge that the (half) body lacks has none; collective.

    With a span, keep the facets between these positions along the edge, which are vertices.
    """
    found = tagged_facets(space, body, body.groups.get(edge, ()))
    if span is None or not len(found):
        return found
    middle = along(body, edge, found.points[:, :2].mean(axis=1))
    inside = (middle > span[0]) & (middle < span[1])
    return EdgeFacets(found.points[inside], found.nodes[inside], found.outward[inside])


def tagged_facets(space: fem.FunctionSpace, body: BodyMesh, tags: Sequence[int]) -> EdgeFacets:
    """Find the facets with one of the tags; collective."""
    topology = body.mesh.topology
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    cell_of, facets_of = topology.connectivity(1, 2), topology.connectivity(2, 1)
    corners = np.array(basix.topology(getattr(basix.CellType, body.cell))[1])
    facets = np.concatenate([np.empty(0, np.int32), *map(body.facet_tags.find, tags)])
    cells = cell_of.array[cell_of.offsets[facets]]
    owned = cells < topology.index_map(2).size_local
    facets, cells = facets[owned], cells[owned]
    around = facets_of.array.reshape(-1, len(corners))[cells]
    side = np.argmax(around == facets[:, None], axis=1)
    places = body.mesh.geometry.x[_dolfinx.cell_nodes(body.mesh)[cells], :2]
    a, b = np.moveaxis(places[np.arange(len(cells))[:, None], corners[side]], 1, 0)
    normal = np.column_stack([b[:, 1] - a[:, 1], a[:, 0] - b[:, 0]])
    normal /= np.hypot(*(b - a).T)[:, None]
    inside = np.sum(normal * (places.mean(axis=1) - a), axis=1) > 0.0
    layout = space.dofmap.dof_layout
    closure = np.array([layout.entity_closure_dofs(1, i) for i in range(len(corners))])[side]
    nodes = _dolfinx.global_nodes(space, _dolfinx.cell_dofs(space)[cells[:, None], closure])
    points = np.stack([a, b, 0.5 * (a + b)], axis=1)[:, : nodes.shape[1]]
    outward = np.where(inside[:, None], -normal, normal) + 0.0
    parts = body.mesh.comm.allgather((points, nodes, outward))
    return EdgeFacets(*map(np.concatenate, zip(*parts, strict=True)))


def along(body: BodyMesh, edge: str, points: Array) -> Array:
    """Return positions of points (n, 2) along an edge from its middle; it must be straight."""
    if edge not in body.lines:
        raise InputError(
            f"'{edge}' is not straight or in pieces, so there is no position along it; leave out "
            "its span and use expressions in x and y"
        )
    return body.lines[edge].along(points)


def edge_nodes(
    space: fem.FunctionSpace, body: BodyMesh, edge: str, span: tuple[float, float] | None
) -> tuple[Ints, Array]:
    """Return all nodes of an edge or a span of it, sorted, and their places; collective."""
    facets = edge_facets(space, body, edge, span)
    unique, first = np.unique(facets.nodes, return_index=True)
    return unique, facets.points.reshape(-1, 2)[first]


def measure(scene: Scene, points: Array) -> Array:
    """Return the factor (n, 1) of a length element at points (n, 2): 1, or r if axisymmetric."""
    return points[:, :1] if scene.axisymmetric else np.ones((len(points), 1))


def integrate(
    facets: EdgeFacets,
    traction: Callable[[Array, Array], Array],
    part: tuple[Array, Array] | None = None,
) -> Array:
    """Integrate a traction times each nodal shape function by Gauss's rule; (n, nodes, k) forces.

    The traction is a function of points (m, 2) and outward normals (m, 2) that returns (m, k)
    values, ``part`` where the integral begins and ends in each facet (n,), from 0 to 1.
    """
    s, weight = gauss()
    n, nodes = facets.nodes.shape
    begin, end = part or (np.zeros(n), np.ones(n))
    s = begin[:, None] + (end - begin)[:, None] * s
    shape = shape_functions(nodes, s)
    a, b = facets.points[:, 0], facets.points[:, 1]
    points = a[:, None, :] + s[:, :, None] * (b - a)[:, None, :]
    normals = np.repeat(facets.outward, len(weight), axis=0)
    values = np.asarray(traction(points.reshape(-1, 2), normals))
    values = values.reshape(n, len(weight), values.shape[-1])
    length = (end - begin) * np.hypot(b[:, 0] - a[:, 0], b[:, 1] - a[:, 1])
    return length[:, None, None] * np.einsum("inq,q,nqk->nik", shape, weight, values)


def facet_mass(scene: Scene, facets: EdgeFacets) -> Array:
    """Return int N_i N_j dA (n, nodes, nodes) of each facet."""
    shapes = np.tile(shape_functions(facets.nodes.shape[1], gauss()[0]).T, (len(facets), 1))
    return integrate(facets, lambda points, _: measure(scene, points) * shapes)


def shape_functions(nodes: int, s: Array) -> Array:
    """Return the values (nodes, ...) of a facet's shape functions at s (...), from 0 to 1."""
    if nodes == 2:
        return np.array([1.0 - s, s])
    return np.array([(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0), 4.0 * s * (1.0 - s)])


def nodal_forces(
    space: fem.FunctionSpace, body: BodyMesh, scene: Scene, load: Load
) -> tuple[Ints, Array]:
    """Return forces (n, k, 2) at nodes (n, k) of a load with factor 1, to be added; collective.

    Their sum is over all ranks; half a body carries its part at x >= 0.
    """
    comm = body.mesh.comm
    if load.on_body:
        return on_all(comm, lambda: _domain_forces(space, body, scene, load))
    # forces on edges are known on every rank, and given by rank 0
    own = slice(None if comm.rank == 0 else 0)
    if load.force is not None and load.platen:
        # as far as it is modelled, at one of the platen's nodes
        nodes, _ = edge_nodes(space, body, load.edge, load.span)
        share = 0.5 / np.pi if scene.axisymmetric else 0.5 if body.half else 1.0
        return nodes[:1, None][own], share * np.array(load.force, dtype=float)[None, None][own]
    facets = edge_facets(space, body, load.edge, None if load.travel else load.span)
    if load.force is not None:
        # the uniform traction with this resultant, per radian
        area = integrate(facets, lambda points, _: measure(scene, points)).sum()
        x, y = np.array(load.force) / area
        load = replace(load, force=None, traction=(x, y))
    if load.travel and load.edge not in body.lines:
        name = load.name.rpartition(" ")[0]
        raise InputError(f"load '{name}' travel: '{load.edge}' is not straight; split it")
    profiles = (load.pressure,) if load.pressure is not None else load.traction or ()
    moved = load.travel[0] * body.lines[load.edge].direction if load.travel else 0.0

    def traction(points: Array, normals: Array) -> Array:
        values = [profile_values(load, body, part, points - moved) for part in profiles]
        acting = -values[0][:, None] * normals if len(values) == 1 else np.column_stack(values)
        return measure(scene, points) * acting

    part = None
    tables = [profile for profile in profiles if isinstance(profile, dict)]
    if (load.travel or tables) and len(facets):
        # pieces of facets between the ends of the span and the kinks of tables
        low, high = load.span or (-np.inf, np.inf)
        kinks = np.unique([s for table in tables for s in table["x"] if low < s < high])
        cuts = np.concatenate([[low], kinks, [high]])
        a, b = (along(body, load.edge, facets.points[:, k] - moved) for k in (0, 1))
        at = ((cuts - a[:, None]) / (b - a)[:, None]).clip(0.0, 1.0)
        begin, end = np.minimum(at[:, :-1], at[:, 1:]), np.maximum(at[:, :-1], at[:, 1:])
        facet, piece = np.nonzero(end - begin > 1e-12)
        facets = EdgeFacets(facets.points[facet], facets.nodes[facet], facets.outward[facet])
        part = begin[facet, piece], end[facet, piece]
    values = integrate(facets, traction, part)
    if body.arcs is not None:
        values += _beyond_chords(facets, body.arcs, scene, traction, values)
    return facets.nodes[own], values[own]


def _beyond_chords(
    facets: EdgeFacets,
    arcs: Arcs,
    scene: Scene,
    traction: Callable[[Array, Array], Array],
    values: Array,
) -> Array:
    """Return the (n, nodes, 2) forces that chords lack to a load's resultant on the true curve.

    The difference is spread evenly over each facet, so that forces which chords give exactly, such
    as those of a uniform pressure, do not change. In an axisymmetric body only the axial component
    is corrected; radially the chord belongs to the cells that it bounds.
    """
    on, numbers = arcs.find(facets.points[:, :2])
    slopes = arcs.slopes[numbers]
    length = np.linalg.norm(slopes, axis=2, keepdims=True)
    normals = np.stack([slopes[..., 1], -slopes[..., 0]], axis=-1) / np.where(length, length, 1.0)
    outward = facets.outward[on][:, None, :]
    normals *= np.sign(np.sum(normals * outward, axis=-1, keepdims=True))
    acting = np.asarray(traction(arcs.points[numbers].reshape(-1, 2), normals.reshape(-1, 2)))
    whole = np.einsum("q,nqk->nk", gauss()[1], acting.reshape(slopes.shape) * length)
    lacking = whole - values[on].sum(axis=1)
    if scene.axisymmetric:
        lacking[:, 0] = 0.0
    missing = np.zeros_like(values)
    share = integrate(facets, lambda points, normals: measure(scene, points))[on]
    missing[on] = share / share.sum(axis=1, keepdims=True) * lacking[:, None, :]
    return missing


def profile_values(load: Load, body: BodyMesh, profile: Profile, points: Array) -> Array:
    """Return (n,) values at points (n, 2) of a table along a load's edge, or an expression."""
    if isinstance(profile, dict):
        return evaluate(profile, along(body, load.edge, points))
    return evaluate(profile, points[:, 0], points[:, 1])


def _domain_forces(
    space: fem.FunctionSpace, body: BodyMesh, scene: Scene, load: Load
) -> tuple[Ints, Array]:
    """Return nodes (cells, n) and forces (cells, n, 2) of a load on this rank's cells."""
    corners = _dolfinx.cell_corners(body.mesh)
    nodes = _dolfinx.global_nodes(space, _dolfinx.cell_dofs(space)[: len(corners)])
    # polynomials of degree 10 are integrated exactly
    at, weight = basix.make_quadrature(getattr(basix.CellType, body.cell), 10)
    shape, slopes = _dolfinx.tabulated(body.cell, scene.mesh.degree, at)
    points, jacobian = _dolfinx.mapped(body.cell, corners, at)
    volume = weight * np.abs(np.linalg.det(jacobian))
    if load.body_force is not None:
        where = f"{load.label} body_force"
        x, y = np.moveaxis(points, -1, 0)
        density = [evaluate_checked(part, x, y, where) for part in load.body_force]
        if scene.axisymmetric:
            volume = volume * points[..., 0]
        return nodes, np.einsum("cq,qn,icq->cni", volume, shape, np.array(density))
    # stress that holds a unit thermal strain
    held = np.atleast_2d(stiffness_in(scene, body) @ free_strain(scene.material))
    strain = strain_of(load, points) * volume
    xx, yy, hoop, xy = held.T[:, :, None] * strain
    stress = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-1)
    gradient = np.einsum("kqn,cqki->cqni", slopes, np.linalg.inv(jacobian))
    if not scene.axisymmetric:
        return nodes, np.einsum("cqij,cqni->cnj", stress, gradient)
    forces = np.einsum("cqij,cqni->cnj", stress * points[..., :1, None], gradient)
    # the hoop strain u_r / r, times r
    forces[..., 0] += np.einsum("cq,qn->cn", hoop, shape)
    return nodes, forces
