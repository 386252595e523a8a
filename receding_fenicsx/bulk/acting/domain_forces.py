"""Nodal forces of body forces and thermal strains, by Gauss's rule in each cell."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.acting.thermal import strain_of
from receding_fenicsx.bulk.material import unit_stress
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.bulk.probes.shape_functions import reference, tabulated
from receding_fenicsx.scene.model import Load, Scene
from receding_fenicsx.scene.profiles import evaluate_checked

GAUSS_POINTS = 6
"""Points along each side of a cell: polynomials of degree 10 are integrated exactly."""


def domain_forces(
    space: fem.FunctionSpace, body: BodyMesh, scene: Scene, load: Load
) -> tuple[Ints, Array]:
    """Return the nodal forces of a load on a body in the cells that this rank owns.

    Args:
        space: displacement space.
        body: the mesh.
        scene: the scene of this body alone.
        load: a load with a body force or a thermal strain.

    Returns:
        Global numbers (cells, n) of the nodes, and the (cells, n, 2) forces.

    Raises:
        InputError: the load's profile cannot be evaluated.
    """
    mesh, dofmap = body.mesh, space.dofmap
    owned = mesh.topology.index_map(2).size_local
    if not owned:
        return np.empty((0, 1), dtype=np.int64), np.empty((0, 1, 2))
    local = _dolfinx.cell_dofs(space)[:owned]
    nodes = dofmap.index_map.local_to_global(local.ravel()).astype(np.int64).reshape(local.shape)
    vertices = _dolfinx.cell_nodes(mesh)[:owned]
    corners = mesh.geometry.x[vertices][..., :2]
    places = space.tabulate_dof_coordinates()[local[0], :2]
    # the nodes of every cell have the same reference coordinates
    at_nodes = np.array([reference(corners[0], place) for place in places])
    at, weight = _rule(len(vertices[0]))
    shape, slopes = tabulated(at_nodes, len(vertices[0]), at)
    place, along = tabulated(_dolfinx.REFERENCE_CORNERS[body.cell], len(vertices[0]), at)
    points = np.einsum("qv,cvi->cqi", place, corners)
    jacobian = np.einsum("kqv,cvi->cqik", along, corners)
    volume = weight * np.abs(np.linalg.det(jacobian))
    if load.body_force is not None:
        where = f"{load.label} body_force"
        x, y = np.moveaxis(points, -1, 0)
        density = [evaluate_checked(part, x, y, where) for part in load.body_force]
        if scene.axisymmetric:
            volume = volume * points[..., 0]
        return nodes, np.einsum("cq,qn,icq->cni", volume, shape, np.array(density))
    # stress that holds a unit thermal strain
    held = unit_stress(scene.material)[0]
    stress = held * strain_of(load, points) * volume
    gradient = np.einsum("kqn,cqki->cqni", slopes, np.linalg.inv(jacobian))
    if not scene.axisymmetric:
        return nodes, np.einsum("cq,cqni->cni", stress, gradient)
    forces = np.einsum("cq,cqni->cni", stress * points[..., 0], gradient)
    # the hoop strain u_r / r, times r
    forces[..., 0] += np.einsum("cq,qn->cn", stress, shape)
    return nodes, forces


def _rule(corners: int) -> tuple[Array, Array]:
    """Return reference points (m, 2) of Gauss's rule in a cell and their weights."""
    s, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    a, b = (grid.ravel() for grid in np.meshgrid(0.5 * (1.0 + s), 0.5 * (1.0 + s)))
    product = 0.25 * np.outer(weight, weight).ravel()
    if corners == 4:
        return np.column_stack([a, b]), product
    # the square with one side drawn together
    return np.column_stack([a * (1.0 - b), b]), product * (1.0 - b)
