r"""Nodal forces of the loads: tractions, pressures and resultants on edges, loads on bodies.

A body force $b$ has the nodal forces $f_i = \int N_i\, b \, dV$. A thermal strain
$\varepsilon^\theta = \alpha\, \Delta T\, 1$ in $\sigma = C (\varepsilon - \lambda\,
\varepsilon^\theta)$ has those of the stress that would hold it,
$f_i = \int C \varepsilon^\theta : \varepsilon(N_i) \, dV$. Both are forces to the condensation:
they alter $r^*$ alone, and their work-conjugates are $f \cdot u$: for the thermal strain
$\int E / (1 - 2 \nu)\, \alpha \Delta T\, \mathrm{tr}\, \varepsilon \, dV$ (plane stress
$E / (1 - \nu)$). Where stresses are evaluated, the load's factor times $\varepsilon^\theta$ is
subtracted from the strain (`thermal_strain`); on elements of order 1, whose strain is that of the
cell's midpoint, at the midpoint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import basix
import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.edges import (
    EdgeFacets,
    along,
    edge_facets,
    edge_nodes,
    integrate,
    measure,
)
from receding_fenicsx.bulk.elasticity import free_strain, stiffness_in, strain_of
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.mesh.raw_mesh import Arcs, gauss
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_all
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.profiles import Profile, evaluate, evaluate_checked


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
        raise InputError(f"{load.label} travel: '{load.edge}' is not straight; split it")
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
    """Return (n,) values of a load's profile at points (n, 2) of its edge.

    A table is a function of the position along the edge, an expression one of x and y.
    """
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
