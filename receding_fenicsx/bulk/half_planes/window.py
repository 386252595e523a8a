"""Fields of a half-plane: values at points, and in the window that pictures show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.half_planes.body import HalfPlane, stretched
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, make_meshes
from receding_fenicsx.bulk.rigid_motions import motions
from receding_fenicsx.bulk.stress import Stresses, named_stresses
from receding_fenicsx.errors import InputError
from receding_fenicsx.half_plane.interior import Complexes, point_values
from receding_fenicsx.scene.model import Contact

WINDOW = (2.0, 1.0)
"""Width and depth of the window that pictures show, over the length of the contact."""
WINDOW_ELEMENTS = 160
"""Elements on the surface of the window."""
WINDOW_GROWTH = 1.05
"""Size ratio between neighbouring layers of the window."""
BLOCK_POINTS = 500
"""Points evaluated together."""
OUTSIDE = 1e-9
"""Height of a point above the surface, over the contact's length, that counts as round-off."""


def window_mesh(part: HalfPlane) -> BodyMesh:
    """Return the mesh of the window on all ranks."""
    length = part.surface.length
    width, depth = part.scene.body.window or (WINDOW[0] * length, WINDOW[1] * length)
    edge = part.scene.contacts[0].edge
    x, y = 0.5 * (part.contact.points.min(axis=0) + part.contact.points.max(axis=0))
    body = replace(
        part.scene.body,
        shape="rectangle",
        width=width,
        height=depth,
        position=(float(x), float(y) - (depth if edge == "top" else 0.0)),
    )
    mesh = replace(
        part.scene.mesh, contact_elements=WINDOW_ELEMENTS, growth=WINDOW_GROWTH, cell="triangle"
    )
    scene = replace(
        part.scene, body=body, mesh=mesh, contacts=(Contact(edge=edge),), loads=(), supports=()
    )
    return make_meshes(part.comm, scene, half=False)[0]


def value_rows(part: HalfPlane, points: Array, labels: list[str]) -> Array:
    """Return rows (m, 6, 2N + own loads): values at points for unit [u; lambda] of this body.

    Raises:
        InputError: a point lies outside the half-plane; its label begins the message.
    """
    depth = (points - part.contact.points[0]) @ (part.side * part.contact.normal[0])
    for point, label, below in zip(points, labels, depth, strict=True):
        if below < -OUTSIDE * part.surface.length:
            raise InputError(
                f"{label}: ({point[0]:g}, {point[1]:g}) lies outside the half-plane; move it inside"
            )
    found = part.condensed
    n = len(found.K)
    unit = np.eye(n // 2)
    of_forces = _values(part, points, np.hstack([unit, 1j * unit]))
    of_motion = _motion(part, points)
    rows = np.empty((len(points), 6, n + len(found.r_star)))
    rows[..., :n] = of_forces @ found.K
    rows[..., n:] = of_forces @ found.r_star.T
    for columns, motion in zip((slice(0, n), slice(n, None)), found.motion, strict=True):
        rows[..., columns] += of_motion @ motion
    return rows


def values_at(part: HalfPlane, points: Array, load: Array, u: Array) -> Array:
    """Return (m, 6) values [u_x, u_y, s_xx, s_yy, s_zz, s_xy] at points of the half-plane."""
    found = part.condensed
    Q, P = np.split(found.K @ u + found.r_star.T @ load, 2)
    forces = (Q + 1j * P)[:, None]
    blocks = [points[k : k + BLOCK_POINTS] for k in range(0, len(points), BLOCK_POINTS)]
    values = np.concatenate([_values(part, block, forces)[..., 0] for block in blocks])
    values += _motion(part, points) @ (found.motion[0] @ u + found.motion[1] @ load)
    return np.asarray(values)


def _values(part: HalfPlane, points: Array, forces: Complexes) -> Array:
    """Return values (m, 6, k) at points for nodal forces Q + i P (N, k), the far field at rest."""
    contact, side = part.contact, part.side
    axes = side * np.stack([contact.tangent[0], contact.normal[0]])
    apart = points - contact.points[0]
    own = np.stack([points @ axes[0], apart @ axes[1]], axis=1)
    surface = part.surface
    if side < 0:
        surface = replace(surface, x=-surface.x, elements=surface.elements[:, ::-1])
    tractions = side * forces / contact.weight[:, None]
    values = point_values(surface, part.material, own, part.datum, tractions)
    turned = values.copy()
    turned[:, :2] = np.einsum("ac,mak->mck", axes, values[:, :2])
    stress = np.einsum("ac,mabk,bd->mcdk", axes, values[:, [[2, 5], [5, 3]]], axes)
    turned[:, 2], turned[:, 3], turned[:, 5] = stress[:, 0, 0], stress[:, 1, 1], stress[:, 0, 1]
    return turned


def _motion(part: HalfPlane, points: Array) -> Array:
    """Return values (m, 6, 4) at points in the motions of the far field."""
    places, material = part.contact.points, part.material
    values = np.zeros((len(points), 6, 4))
    pivot = 0.5 * (places.min(axis=0) + places.max(axis=0))
    values[:, :2, :3] = motions(points, pivot, part.size)
    values[:, :2, 3] = stretched(part, points)
    values[:, [2, 4], 3] = material.stretch * np.array([1.0, material.nu_out])
    return values


def window_fields(
    part: HalfPlane, load: Array | None, u: Array | None
) -> tuple[fem.Function, Stresses]:
    """Return displacement and stresses in the window; collective.

    Args:
        part: the half-plane.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) displacements [v; w] of this body's contact nodes; only rank 0's are used.
    """
    load, u = part.comm.bcast((load, u), root=0)
    if part.window is None:
        part.window = window_mesh(part)
    mesh = part.body.mesh

    def at(points: Array) -> Array:
        return values_at(part, points, np.asarray(load, float), np.asarray(u, float))

    displacement = fem.Function(_dolfinx.vector_space(mesh, 1), name="displacement")
    spaces = (
        _dolfinx.scalar_space(mesh, "DG", 0),
        _dolfinx.scalar_space(mesh, "Lagrange", 1),
    )
    found = []
    for space in (displacement.function_space, *spaces):
        values = at(space.tabulate_dof_coordinates()[:, :2])
        if space is displacement.function_space:
            displacement.x.array[:] = values[:, :2].ravel()
            continue
        named = {}
        for name, value in named_stresses(*values[:, 2:].T).items():
            named[name] = fem.Function(space, name=name)
            named[name].x.array[:] = value
        found.append(named)
    return displacement, Stresses(*found)
