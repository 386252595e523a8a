"""Half-planes as bodies of a scene: contact nodes, far field, values at points; a pair of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from scipy import sparse

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.contact_nodes import ContactNodes, ContactSide
from receding_fenicsx.bulk.elasticity import Stresses, named_stresses
from receding_fenicsx.bulk.join_bodies import CondensedBody, JoinedBodies
from receding_fenicsx.bulk.mesh.grading import Base, graded
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, make_meshes
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.half_plane.interior import Complexes, point_values
from receding_fenicsx.half_plane.stiffness import (
    CondensedHalfPlane,
    FarField,
    HalfPlaneMaterial,
    Surface,
    SurfaceStiffness,
    compliance,
    condense_far_field,
    plane_material,
    surface_of,
)
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import FREE, Contact, Refinement, Scene
from receding_fenicsx.scene.symmetry import contact_samples


@dataclass
class HalfPlane:
    """A half-plane in the place of a discretised body; see :class:`bulk.body.Bulk`."""

    scene: Scene  # the scene of this body alone
    comm: MPI.Comm  # communicator
    load_names: tuple[str, ...]  # names of the loads on all bodies
    contact: ContactNodes  # the contact nodes; those of the first body of a pair
    size: float  # length that rotations are relative to
    surface: Surface  # the nodes on the surface, at positions along t
    side: int  # +1 where n points into the half-plane, -1 for the second body of a pair
    datum: float  # depth of the point that displacements are relative to
    material: HalfPlaneMaterial  # elastic constants
    far: FarField  # loads and supports of the far field
    # mesh of the window that pictures show, made with the first fields
    window: BodyMesh | None = None
    dofs: int = 0
    half: bool = False

    @property
    def body(self) -> BodyMesh:
        """Mesh of the window, which :meth:`fields` makes."""
        return given(self.window)

    @cached_property
    def compliance(self) -> Array:
        """(2N, 2N) Flamant's compliance D."""
        return compliance(self.surface, self.material, self.side, self.datum)

    @cached_property
    def stiffness(self) -> CondensedHalfPlane:
        """Stiffness of the contact nodes."""
        stiffness = SurfaceStiffness(self.surface, self.compliance)
        return condense_far_field(stiffness.A, self.far_modes, self.far)

    @property
    def far_modes(self) -> Array:
        """(2N, 4) displacements [v; w] of the nodes in the motions of the far field."""
        strained = _stretched(self, self.contact.points)
        axes = self.contact.tangent, self.contact.normal
        along = [np.einsum("nc,nc->n", axis, strained) for axis in axes]
        return np.column_stack([self.contact.modes, np.concatenate(along)])

    def condensed(self) -> CondensedBody | None:
        """Return the stiffness on rank 0; collective."""

        def work() -> CondensedBody:
            found, nodes = self.stiffness, self.contact
            K, r_star, driven = found.K, found.r_star, np.zeros_like(found.r_star)
            more = nodes.held, driven, nodes.modes, nodes.constraints
            return CondensedBody(K, r_star, found.compliance, self.far.sign, *more)

        return on_root(self.comm, work)

    def value_rows(self, points: Array, labels: list[str]) -> Array | None:
        """Return rows (m, 6, 2N + own loads) of the values at points on rank 0; collective."""

        def rows() -> Array:
            depth = (points - self.contact.points[0]) @ (self.side * self.contact.normal[0])
            for point, label, below in zip(points, labels, depth, strict=True):
                # round-off of a point on the surface
                if below < -1e-9 * self.surface.length:
                    raise InputError(
                        f"{label}: ({point[0]:g}, {point[1]:g}) lies outside the half-plane; move "
                        "it inside"
                    )
            found = self.stiffness
            n = len(found.K)
            unit = np.eye(n // 2)
            of_forces = self._values(points, np.hstack([unit, 1j * unit]))
            of_motion = self._motion(points)
            rows = np.empty((len(points), 6, n + len(found.r_star)))
            rows[..., :n] = of_forces @ found.K
            rows[..., n:] = of_forces @ found.r_star.T
            for columns, motion in zip((slice(0, n), slice(n, None)), found.motion, strict=True):
                rows[..., columns] += of_motion @ motion
            return rows

        return on_root(self.comm, rows)

    def fields(self, load: Array | None, u: Array | None) -> tuple[fem.Function, Stresses]:
        """Return displacement and stresses in the window for rank 0's factors and u; collective."""
        load, u = self.comm.bcast((load, u), root=0)
        if self.window is None:
            self.window = _window_mesh(self)
        mesh, found = self.body.mesh, self.stiffness
        Q, P = np.split(found.K @ np.asarray(u) + found.r_star.T @ np.asarray(load), 2)
        forces = (Q + 1j * P)[:, None]
        far = found.motion[0] @ np.asarray(u) + found.motion[1] @ np.asarray(load)

        def at(space: fem.FunctionSpace) -> Array:
            points = space.tabulate_dof_coordinates()[:, :2]
            # evaluated in blocks of 500 points
            blocks = [points[k : k + 500] for k in range(0, len(points), 500)]
            values = np.concatenate([self._values(block, forces)[..., 0] for block in blocks])
            return np.asarray(values + self._motion(points) @ far)

        displacement = fem.Function(_dolfinx.vector_space(mesh, 1), name="displacement")
        displacement.x.array[:] = at(displacement.function_space)[:, :2].ravel()
        stresses = []
        for family, degree in (("DG", 0), ("Lagrange", 1)):
            space = _dolfinx.scalar_space(mesh, family, degree)
            named = named_stresses(*at(space)[:, 2:].T)
            functions = {name: fem.Function(space, name=name) for name in named}
            for name, value in named.items():
                functions[name].x.array[:] = value
            stresses.append(functions)
        return displacement, Stresses(*stresses)

    def _values(self, points: Array, forces: Complexes) -> Array:
        """Return values (m, 6, k) at points for nodal forces Q + i P (N, k), far field at rest."""
        contact, side = self.contact, self.side
        axes = side * np.stack([contact.tangent[0], contact.normal[0]])
        apart = points - contact.points[0]
        own = np.stack([points @ axes[0], apart @ axes[1]], axis=1)
        surface = self.surface
        if side < 0:
            surface = replace(surface, x=-surface.x, elements=surface.elements[:, ::-1])
        weight = np.concatenate([edge.weight for edge in contact.sides])
        tractions = side * forces / weight[:, None]
        values = point_values(surface, self.material, own, self.datum, tractions)
        turned = values.copy()
        turned[:, :2] = np.einsum("ac,mak->mck", axes, values[:, :2])
        stress = np.einsum("ac,mabk,bd->mcdk", axes, values[:, [[2, 5], [5, 3]]], axes)
        turned[:, 2], turned[:, 3], turned[:, 5] = stress[:, 0, 0], stress[:, 1, 1], stress[:, 0, 1]
        return turned

    def _motion(self, points: Array) -> Array:
        """Return values (m, 6, 4) at points in the motions of the far field."""
        places, material = self.contact.points, self.material
        values = np.zeros((len(points), 6, 4))
        values[:, :2, :3] = motions(points, _pivot(places), self.size)
        values[:, :2, 3] = _stretched(self, points)
        values[:, [2, 4], 3] = material.stretch * np.array([1.0, material.nu_out])
        return values

    def destroy(self) -> None:
        """Free nothing: a half-plane holds no objects of PETSc."""


def half_plane_of(
    scene: Scene,
    comm: MPI.Comm,
    names: tuple[str, ...],
    first: Bulk | HalfPlane | None = None,
) -> HalfPlane:
    """Return a half-plane with its contact nodes; as the second body it has those of the first."""
    m = scene.material
    material = plane_material(m.young, m.poisson, m.kinematics == "plane stress")
    far = _far_field(scene, names, material)
    if first is None:
        contact = own_nodes(scene)
        size = float(np.ptp(contact.points[:, 0]))
    else:
        contact = first.contact
        outward = np.array([0.0, 1.0 if scene.contacts[0].edge == "top" else -1.0])
        off = np.ptp(contact.points[:, 1]) > 1e-9 * np.ptp(contact.points[:, 0])
        if off or np.abs(contact.normal - outward).max() > 1e-9:
            raise InputError(
                f"body '{scene.body.name}': the contact nodes of its partner do not lie on one "
                f'horizontal line below which (edge "top") or above which (edge "bottom") the '
                "half-plane lies; turn or exchange the bodies, or give the profile as initial_gap"
            )
        size = first.size if isinstance(first, HalfPlane) else first.body.size
    constraints = np.eye(3)[~far.free[:3]]
    contact = replace(
        contact,
        held=np.zeros(2 * len(contact.node), dtype=bool),
        constraints=constraints,
        null=scaled(contact.modes @ free_motions(constraints)),
    )
    if isinstance(first, HalfPlane):
        surface = first.surface
    else:
        if sum(len(side.node) for side in contact.sides) > len(contact.node):
            raise InputError(
                f"body '{scene.body.name}': edges in contact with a half-plane meet; make them one "
                "group"
            )
        along = np.einsum("nc,nc->n", contact.points, contact.tangent)
        edge = np.repeat(np.arange(len(contact.sides)), [len(s.node) for s in contact.sides])
        lower = np.flatnonzero(np.diff(edge) == 0)
        elements = np.stack([lower, lower + 1], axis=1)
        if along[elements[0, 1]] < along[elements[0, 0]]:
            elements = elements[:, ::-1]
        surface = surface_of(along, elements, 1 if first is None else scene.mesh.degree)
    datum = scene.body.datum or 10.0 * surface.length
    side = 1 if first is None else -1
    return HalfPlane(scene, comm, names, contact, size, surface, side, datum, material, far)


def own_nodes(scene: Scene) -> ContactNodes:
    """Return the contact nodes of a half-plane that is the only or the first body."""
    x = [_positions(scene, contact) for contact in scene.contacts]
    below = scene.contacts[0].edge == "top"
    along, count = np.concatenate(x), len(np.concatenate(x))
    points = np.stack([along + scene.body.position[0], np.full(count, scene.body.position[1])], 1)
    normal = np.tile([0.0, -1.0 if below else 1.0], (count, 1))
    starts = np.cumsum([0, *(len(part) for part in x)])
    sides = []
    for part, start in zip(x, starts, strict=False):
        at = np.arange(start, start + len(part))
        facets = np.column_stack([np.arange(len(part) - 1), np.arange(1, len(part))])
        weight = np.convolve(np.diff(part), [0.5, 0.5])
        carries = np.ones(len(part), dtype=bool)
        sides.append(ContactSide(at, part, points[at], normal[at], weight, facets, carries, True))
    places, none = (np.arange(count), points, normal), np.zeros((0, 3))
    pivot = _pivot(points), float(np.ptp(along))
    return ContactNodes.of(places, np.zeros(2 * count, dtype=bool), (none, none), pivot, sides)


def _positions(scene: Scene, contact: Contact) -> Array:
    """Return the positions of the nodes on one contact edge."""
    even = contact_samples(scene, contact)
    places = [place for place in scene.mesh.places if place.edge in (None, contact.edge)]
    if not places:
        return even
    ends = float(even[0]), float(even[-1])
    size = (ends[1] - ends[0]) / scene.mesh.contact_elements
    # a node in the middle, which most profiles touch first
    places.append(Refinement(size, 0.5 * (ends[0] + ends[1]), 2.0))
    return graded(ends, Base(np.array(ends), np.array([size])), places)


def _stretched(part: HalfPlane, points: Array) -> Array:
    """Return displacements (m, 2) of points under unit strain along a surface free of tractions."""
    apart = points - _pivot(part.contact.points)
    return apart * [1.0, -part.material.contraction]


def _pivot(points: Array) -> Array:
    """Return the point that the far field rotates about: the middle of all contact nodes."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _far_field(scene: Scene, names: tuple[str, ...], material: HalfPlaneMaterial) -> FarField:
    """Return what acts on the far field; supports, displacements and platens hold its rotation."""
    free, sign = np.array([True, True, True, False]), np.zeros(len(names))
    force, moved = np.zeros((len(names), 4)), np.zeros((len(names), 4))
    fixed = ["xy".index(axis) for support in scene.supports for axis in support.fix]
    free[fixed + [2] * bool(fixed)] = False
    for load in scene.loads:
        k = names.index(load.name)
        if load.platen or load.displacement is not None:
            free[2] = False
        if load.force is not None:
            force[k, :2] += load.force
            sign[k] = -1.0
        if load.tension is not None:
            moved[k, 3] += load.tension / material.stretch
            sign[k] = 1.0
        for axis, value in enumerate(load.displacement or ()):
            if value != FREE:
                assert isinstance(value, float | int)
                free[axis] = False
                moved[k, axis] += value
                sign[k] = 1.0
    for k, name in enumerate(names):
        if np.any(force[k, ~free]):
            raise InputError(
                f"load '{name}' force: the far field of the half-plane is held in its direction by "
                "a support or a displacement; remove one of them"
            )
        if np.any(moved[k, fixed]):
            raise InputError(
                f"load '{name}': its displacement moves the far field of a half-plane, which a "
                "support holds; drop the support"
            )
    return FarField(free, force, moved, sign)


def _window_mesh(part: HalfPlane) -> BodyMesh:
    """Return the mesh of the window that pictures show, on all ranks."""
    length = part.surface.length
    width, depth = part.scene.body.window or (2.0 * length, length)
    edge = part.scene.contacts[0].edge
    x, y = 0.5 * (part.contact.points.min(axis=0) + part.contact.points.max(axis=0))
    body = replace(
        part.scene.body,
        width=width,
        height=depth,
        position=(float(x), float(y) - (depth if edge == "top" else 0.0)),
    )
    mesh = replace(part.scene.mesh, contact_elements=160, growth=1.05, cell="triangle")
    scene = replace(
        part.scene, body=body, mesh=mesh, contacts=(Contact(edge=edge),), loads=(), supports=()
    )
    return make_meshes(part.comm, scene, half=False)[0]


def join_half_planes(a: HalfPlane, b: HalfPlane, load_names: tuple[str, ...]) -> JoinedBodies:
    """Join two half-planes on the same nodes to one system, for u = u_a - u_b; n points into a.

    With the force r of b on a, tractions t and the far fields a_a, a_b, B^T t = r and

        (D_a + D_b) t + B R (a_a - a_b) = B u,    u_b = - B^-T D_b t + R a_b:

    a pair behaves as one half-plane of the compliance D_a + D_b, in which the coupling of equal
    materials cancels exactly. A motion that is free on either side is free; free on both sides, its
    forces must balance, and that of b is zero.
    """
    force, moved, sign = (
        np.array([getattr(part.far, name) for part in (a, b)])
        for name in ("force", "moved", "sign")
    )
    together = a.far.free & b.far.free
    size = np.abs(force).sum(axis=(0, 2))
    lost = np.abs((force[0] + force[1]) * together).max(axis=1) > 1e-9 * size
    # a displacement of one body that the other one follows freely
    lost |= np.any(moved[0] * b.far.free, axis=1) | np.any(moved[1] * a.far.free, axis=1)
    for k in np.flatnonzero(lost):
        raise InputError(
            f"load '{load_names[k]}' moves both half-planes together, and nothing holds them: add "
            "a [[support]] to the far edge of one of them, or balance it by its part on the other"
        )
    free = a.far.free | b.far.free
    relative = FarField(
        free,
        np.where(a.far.free, force[0], -force[1]),
        moved[0] - moved[1],
        np.sign(sign.sum(axis=0)),
    )
    stiffness = SurfaceStiffness(a.surface, a.compliance + b.compliance)
    modes = a.far_modes
    found = condense_far_field(stiffness.A, modes, relative)
    on_u, on_loads = found.motion
    count = len(modes)
    # a_b: given, or that of a less the relative motion; zero where both are free
    follows = (b.far.free & ~a.far.free)[:, None]
    b_on_u = np.where(follows, -on_u, 0.0)
    b_on_loads = np.where(follows, moved[0].T - on_loads, moved[1].T)

    # u_b = -moved (u - R a) + R a_b
    moved_b = stiffness.moved_by(b.compliance)
    turned = moved_b @ modes
    every = sparse.identity(count, format="csr")
    none = np.zeros_like(found.r_star)
    rest = turned @ on_u - moved_b + modes @ b_on_u, turned @ on_loads + modes @ b_on_loads
    held, moving = np.zeros(count, dtype=bool), ((every, every), (0.0 * every, every))
    known = found.K, found.r_star, found.compliance, relative.sign, held, none
    factors = np.eye(len(load_names)), none
    return JoinedBodies(*known, scaled(modes[:, free]), rest, moving, factors, none)
