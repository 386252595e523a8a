"""A half-plane as a body of a scene: contact nodes, loads and supports of its far field."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from mpi4py import MPI

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.bulk.join_bodies import CondensedBody
from receding_fenicsx.bulk.mesh.graded_edges import Base, graded
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, contact_nodes_of
from receding_fenicsx.bulk.rigid_motions import free_motions, motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.half_plane.far_field import CondensedHalfPlane, FarField, condense_far_field
from receding_fenicsx.half_plane.stiffness import (
    HalfPlaneMaterial,
    Surface,
    SurfaceStiffness,
    compliance,
    plane_material,
    surface_of,
)
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import FREE, Contact, Refinement, Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.rectangle_edges import contact_samples

STRAIGHT = 1e-9
"""Distance of a contact node from the half-plane's surface, over its length, that is round-off."""
DATUM_DEPTH = 10.0
"""Depth of the datum over the length of the contact, where the scene gives none."""


@dataclass
class HalfPlane:
    """A half-plane in the place of a discretised body; see :class:`bulk.body.Bulk`.

    Attributes:
        scene: the scene of this body alone.
        comm: communicator.
        contact: the contact nodes; those of the first body of a pair.
        size: length that rotations are relative to.
        surface: the nodes on the surface, at positions along t.
        side: +1 where n points into the half-plane, -1 for the second body of a pair.
        datum: depth of the point that displacements are relative to.
        far: loads and supports of the far field.
        window: mesh of the window that pictures show, made with the first fields.
    """

    scene: Scene
    comm: MPI.Comm
    contact: ContactNodes
    size: float
    surface: Surface
    side: int
    datum: float
    far: FarField
    window: BodyMesh | None = None
    dofs: int = 0
    half: bool = False
    seconds: dict[str, float] = field(default_factory=lambda: {"forms": 0.0, "assemble": 0.0})

    @property
    def parts(self) -> tuple[HalfPlane, ...]:
        """The modelled bodies: this one."""
        return (self,)

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads."""
        return self.scene.body_names

    @property
    def body(self) -> BodyMesh:
        """Mesh of the window, which :func:`window.window_fields` makes."""
        return given(self.window)

    @property
    def material(self) -> HalfPlaneMaterial:
        """Elastic constants."""
        return material_of(self.scene)

    @cached_property
    def compliance(self) -> Array:
        """(2N, 2N) Flamant's compliance D."""
        return compliance(self.surface, self.material, self.side, self.datum)

    @cached_property
    def condensed(self) -> CondensedHalfPlane:
        """Stiffness of the contact nodes."""
        stiffness = SurfaceStiffness(self.surface, self.compliance)
        return condense_far_field(stiffness.A, self.far_modes, self.far)

    @property
    def far_modes(self) -> Array:
        """(2N, 4) displacements [v; w] of the nodes in the motions of the far field."""
        strained = stretched(self, self.contact.points)
        axes = self.contact.tangent, self.contact.normal
        along = [np.einsum("nc,nc->n", axis, strained) for axis in axes]
        return np.column_stack([self.contact.modes, np.concatenate(along)])

    def condensed_body(self) -> CondensedBody:
        """Return the stiffness in the form that bodies are joined in."""
        found = self.condensed
        return CondensedBody(
            K=found.K,
            r_star=found.r_star,
            compliance=found.compliance,
            sign=self.far.sign,
            held=self.contact.held,
            modes=self.contact.modes,
            constraints=self.contact.constraints,
        )

    def destroy(self) -> None:
        """Free nothing: a half-plane holds no objects of PETSc."""


def half_plane_of(
    scene: Scene,
    comm: MPI.Comm,
    partner: ContactNodes | None = None,
    surface: Surface | None = None,
) -> HalfPlane:
    """Return a half-plane with its contact nodes.

    Args:
        scene: the scene of this body alone.
        comm: communicator.
        partner: contact nodes of the first body where this is the second one of a pair.
        surface: surface of the first body where that is a half-plane too.

    Raises:
        InputError: the partner's contact nodes do not lie on the half-plane's surface.
    """
    far = _far_field(scene)
    if partner is None:
        contact = _own_nodes(scene)
        size = float(np.ptp(contact.points[:, 0]))
    else:
        contact = partner
        _check_straight(scene, partner)
        size = _rotation_length(contact)
    constraints = np.eye(3)[~far.free[:3]]
    contact = replace(
        contact,
        held=np.zeros(2 * len(contact.x), dtype=bool),
        constraints=constraints,
        null=scaled(contact.modes @ free_motions(constraints)),
    )
    surface = surface or _surface(contact, 1 if partner is None else scene.mesh.degree)
    datum = scene.body.datum or DATUM_DEPTH * surface.length
    side = 1 if partner is None else -1
    return HalfPlane(scene, comm, contact, size, surface, side, datum, far)


def count_nodes(scene: Scene) -> int:
    """Return the number of contact nodes of a scene with half-planes; no communication."""
    for body in scene.bodies:
        if not body.is_half_plane:
            return sum(contact_nodes_of(part_of(scene, body)))
    owner = scene.find_edge(scene.contacts[0].edge)[0]
    return len(_own_nodes(part_of(scene, owner)).x)


def _surface(contact: ContactNodes, order: int) -> Surface:
    """Return the surface of contact nodes between which elements of some order lie."""
    along = np.einsum("nc,nc->n", contact.points, contact.tangent)
    lower = np.flatnonzero(np.diff(contact.edge) == 0)
    elements = np.stack([lower, lower + 1], axis=1)
    if along[elements[0, 1]] < along[elements[0, 0]]:
        elements = elements[:, ::-1]
    return surface_of(along, elements, order)


def _own_nodes(scene: Scene) -> ContactNodes:
    """Return the contact nodes of a half-plane that is the only or the first body."""
    x = [_positions(scene, contact) for contact in scene.contacts]
    below = scene.contacts[0].edge == "top"
    along, count = np.concatenate(x), len(np.concatenate(x))
    points = np.stack([along + scene.body.position[0], np.full(count, scene.body.position[1])], 1)
    normal = np.tile([0.0, -1.0 if below else 1.0], (count, 1))
    tangent = np.tile([-1.0 if below else 1.0, 0.0], (count, 1))
    size = float(np.ptp(along))
    weight = np.concatenate([np.convolve(np.diff(part), [0.5, 0.5]) for part in x])
    on_nodes = motions(points, _pivot(points), size)
    modes = np.concatenate([np.einsum("nc,nck->nk", axis, on_nodes) for axis in (tangent, normal)])
    return ContactNodes(
        x=along,
        edge=np.repeat(np.arange(len(x)), [len(part) for part in x]),
        points=points,
        node=np.arange(count),
        tangent=tangent,
        normal=normal,
        weight=weight,
        held=np.zeros(2 * count, dtype=bool),
        modes=modes,
        constraints=np.zeros((0, 3)),
        null=modes,
    )


def _positions(scene: Scene, contact: Contact) -> Array:
    """Return the positions of the nodes on one contact edge."""
    even = contact_samples(scene, contact)
    places = [place for place in scene.mesh.refine if place.edge in (None, contact.edge)]
    if not places:
        return even
    ends = float(even[0]), float(even[-1])
    size = (ends[1] - ends[0]) / scene.mesh.contact_elements
    # a node in the middle, which most profiles touch first
    places.append(Refinement(size, 0.5 * (ends[0] + ends[1]), 2.0))
    return graded(ends, Base(np.array(ends), np.array([size])), places)


def material_of(scene: Scene) -> HalfPlaneMaterial:
    """Return the elastic constants of the half-plane of a scene."""
    material = scene.material
    return plane_material(material.young, material.poisson, material.kinematics == "plane stress")


def stretched(part: HalfPlane, points: Array) -> Array:
    """Return displacements (m, 2) of points under unit strain along a surface free of tractions."""
    apart = points - _pivot(part.contact.points)
    return apart * [1.0, -part.material.contraction]


def _pivot(points: Array) -> Array:
    """Return the point that the far field rotates about: the middle of all contact nodes."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _rotation_length(contact: ContactNodes) -> float:
    """Return the length by which the contact nodes' displacement in a rotation was divided."""
    apart = contact.points - _pivot(contact.points)
    farthest = int(np.argmax(np.abs(apart[:, 0])))
    turned = contact.modes[len(apart) + farthest, 2] * contact.normal[farthest, 1]
    return float(apart[farthest, 0] / turned)


def _check_straight(scene: Scene, partner: ContactNodes) -> None:
    """Check that the partner's contact nodes lie on a horizontal line on the right side."""
    (edge, *_) = {contact.edge for contact in scene.contacts}
    outward = np.array([0.0, 1.0 if edge == "top" else -1.0])
    length = np.ptp(partner.points[:, 0])
    off = np.abs(partner.normal - outward).max() > STRAIGHT
    if off or np.ptp(partner.points[:, 1]) > STRAIGHT * length:
        raise InputError(
            f"body '{scene.body.name}': the contact nodes of its partner do not lie on one "
            f'horizontal line below which (edge "top") or above which (edge "bottom") the '
            "half-plane lies; turn or exchange the bodies, or give the profile as initial_gap"
        )


def _far_field(scene: Scene) -> FarField:
    """Return what acts on the far field.

    Supports and prescribed displacements hold the rotation, and so do platens.
    """
    names = scene.body_names
    free, sign = np.array([True, True, True, False]), np.zeros(len(names))
    force, moved = np.zeros((len(names), 4)), np.zeros((len(names), 4))
    material = material_of(scene)
    for support in scene.supports:
        free[["xy".index(axis) for axis in support.fix] + [2]] = False
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
    for support in scene.supports:
        held = ["xy".index(axis) for axis in support.fix]
        for name, motion in zip(names, moved, strict=True):
            if np.any(motion[held]):
                raise InputError(
                    f"load '{name}': its displacement moves the far field of a half-plane, which "
                    "a support holds; drop the support"
                )
    return FarField(free, force, moved, sign)
