"""Bodies in contact, one or several: assembly, and condensation to the contact nodes (eqs. 11, 12).

A mirror-symmetric whole body is condensed as it is. Two half-body problems (u_x = 0, then u_y = 0
on the axis) would take 40 % less time and a third less memory: with 2561 contact nodes 0.2 s of
0.5 s and 0.3 GB of 0.8 GB, little compared to the interface's work with 2N = 5122 unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.linalg import block_diag

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import Bulk, times
from receding_fenicsx.bulk.closures import add_links, add_springs, closed, with_gaps
from receding_fenicsx.bulk.contact_nodes import find_contact
from receding_fenicsx.bulk.contact_operator import ContactPoints, Relative, relative_of
from receding_fenicsx.bulk.elasticity import stiffness_in, stiffness_matrix
from receding_fenicsx.bulk.half_planes import HalfPlane, half_plane_of, join_half_planes, own_nodes
from receding_fenicsx.bulk.join_bodies import CondensedBody, JoinedBodies, join
from receding_fenicsx.bulk.loads import nodal_forces
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, make_meshes
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import in_order, part_of, sides_of_body
from receding_fenicsx.scene.toml_file import to_toml

Body = Bulk | HalfPlane
"""What a stack is made of; both have the same attributes and methods."""


@dataclass
class Stack:
    """Discretised bodies, the first contact's ``edge`` being on the first."""

    scene: Scene  # what they were built from
    parts: tuple[Body, ...]  # the bodies, each with its own part of the scene
    # compliance (m, m) of springs between the bodies, whose unit loads are the last m
    soft: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # their condensed system on rank 0, once they are ``condensed``
    joined: JoinedBodies | None = None
    condensed: bool = False
    # relative displacements of the bodies at the points of contacts and ties
    relative: Relative = field(init=False)
    contact: ContactPoints = field(init=False)  # points of all contacts

    def __post_init__(self) -> None:
        """Find the contact operator."""
        contacts, scenes = zip(*((part.contact, part.scene) for part in self.parts), strict=True)
        self.relative, self.contact = relative_of(self.scene, contacts, scenes)

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the meshes."""
        return self.parts[0].comm

    @property
    def body(self) -> BodyMesh:
        """Mesh of the first body."""
        return self.parts[0].body

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of all unit loads: those of the scene, then those of springs between bodies."""
        return self.parts[0].load_names

    @property
    def dofs(self) -> int:
        """Number of displacement degrees of freedom."""
        return sum(part.dofs for part in self.parts)

    def condense(self) -> None:
        """Condense all bodies, unless they are already, and join them on rank 0; collective."""
        if self.condensed:
            return
        pair = len(self.parts) == 2 and all(isinstance(p, HalfPlane) for p in self.parts)
        condensed = None if pair else [part.condensed() for part in self.parts]
        self.joined = on_root(self.comm, lambda: self._joined(condensed))
        self.condensed = True

    def links(self) -> tuple[list[int], Array]:
        """Return the numbers of the unit loads of bolts, then of springs, and their compliance."""
        scene, names = self.scene, self.load_names
        at = [names.index(bolt.name) for bolt in scene.bolts]
        at += range(len(scene.load_names), len(names))
        # of a ring of bolts per radian
        part = 2.0 * np.pi if scene.axisymmetric else 1.0
        soft = np.array([part / (bolt.stiffness or np.inf) for bolt in scene.bolts])
        return at, np.asarray(block_diag(np.diag(soft), self.soft))

    def _joined(self, condensed: list[CondensedBody | None] | None) -> JoinedBodies:
        """Join the condensed bodies, or a pair of half-planes, and close what acts between them."""
        names = self.load_names
        if condensed is None:
            a, b = self.parts
            assert isinstance(a, HalfPlane) and isinstance(b, HalfPlane)
            joined = join_half_planes(a, b, names)
        else:
            joined = join([given(part) for part in condensed], self.relative, names)
        at, soft = self.links()
        if at:
            labels = [f"bolt '{bolt.name}'" for bolt in self.scene.bolts]
            labels += ["[[spring]]"] * len(self.soft)
            joined = closed(joined, np.array(at), soft, labels, len(self.scene.load_names))
        for name, moved in zip(self.scene.load_names, joined.driven, strict=True):
            for dof in np.flatnonzero(joined.held & (moved != 0.0)):
                x, y = self.contact.points[dof % len(self.contact.x)]
                raise InputError(
                    f"load '{name}': prescribes how the contact node at ({x:.6g}, {y:.6g}) moves "
                    "relative to what it touches, which is held there; give it a platen with a "
                    "force, a pressure or a traction instead, or a span without that node"
                )
        return with_gaps(joined, self.scene, self.contact)

    def as_joined(self, load: Array | None, u: Array | None) -> list[tuple[Body, Any, Any]]:
        """Return each body with all unit loads' factors and its displacements, for rank 0's.

        ``u`` (2N,) is [v; w], between bodies the first one's less the second one's, with an
        interference as in the record.
        """
        sides: list[tuple[Body, Any, Any]] = [(part, None, None) for part in self.parts]
        if self.joined is not None:
            moved, factors = self.joined.as_joined(np.asarray(u, float), np.asarray(load, float))
            for k, part in enumerate(self.parts):
                sides[k] = part, factors, self.joined.displacement(k, moved, factors)
        return sides

    def destroy(self) -> None:
        """Free PETSc's objects; on all ranks together."""
        for part in self.parts:
            part.destroy()


def build(scene: Scene, body: BodyMesh, names: tuple[str, ...] | None = None) -> Bulk:
    """Assemble the body's stiffness and loads, and find its contact nodes and supports; collective.

    ``scene`` is that of this body alone, ``names`` those of the loads on all bodies. A half body is
    held at u_x = 0 on x = 0.
    """
    names = scene.load_names if names is None else names
    space = _dolfinx.vector_space(body.mesh, scene.mesh.degree)
    C = stiffness_in(scene, body) / scene.material.young
    stiffness = stiffness_matrix(space, C, scene.axisymmetric)
    resisted = add_springs(stiffness, space, body, scene)
    stiffness.assemble()
    contact, constraints = find_contact(scene, space, body, resisted)
    P = constraints.matrix(stiffness)
    start, end = stiffness.getOwnershipRange()
    loads, moved = np.zeros((2, end - start, len(names)))
    total = stiffness.createVecLeft()
    for name, column in zip(names, loads.T, strict=True):
        total.set(0.0)
        for load in scene.applied:
            # the forces of a mode are known once the contact is
            if load.name == name and load.displacement is None and load.mode is None:
                nodes, forces = nodal_forces(space, body, scene, load)
                rows = (2 * nodes[:, :, None] + np.arange(2)).astype(PETSc.IntType)
                total.setValues(rows.ravel(), forces.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
                total.assemble()
        column[:] = total.getArray(readonly=True)
    total.destroy()
    if P is not None:
        untied, stiffness = stiffness, stiffness.PtAP(P)
        untied.destroy()
        loads = times(P, loads, transposed=True)
    driven = np.zeros((len(names), 2 * len(contact.node)))
    own = (constraints.given >= start) & (constraints.given < end)
    _, at, on = np.intersect1d(constraints.given, contact.dofs, return_indices=True)
    for name, values in constraints.prescribed.items():
        k = names.index(name)
        moved[constraints.given[own] - start, k] = values[own]
        driven[k, on] = values[at]
    pushed = [names.index(name) for name in constraints.prescribed]
    if pushed:
        loads[:, pushed] = -scene.material.young * times(stiffness, moved[:, pushed])
    acting = [load.name for load in scene.applied]
    off = np.union1d(np.setdiff1d(constraints.given, contact.dofs), constraints.slaves)
    return Bulk(
        scene,
        body,
        space,
        names,
        stiffness=stiffness,
        loads=loads,
        moved=moved,
        sign=np.where(np.isin(np.arange(len(names)), pushed), 1.0, -1.0 * np.isin(names, acting)),
        fixed=off[(off >= start) & (off < end)],
        contact=contact,
        driven=contact.to_local(driven.T).T,
        ties=P,
    )


def build_all(scene: Scene, bodies: tuple[BodyMesh, ...], comm: MPI.Comm | None = None) -> Stack:
    """Assemble all bodies, given the meshes of those that have one."""
    meshes = iter(bodies)
    built = {
        body.name: build(part_of(scene, body), next(meshes), scene.load_names)
        for body in scene.bodies
        if not body.is_half_plane
    }
    soft = add_links(scene, built)
    names = next((part.load_names for part in built.values()), scene.load_names)
    parts: list[Body] = []
    for body in in_order(scene):
        if body.name in built:
            parts.append(built[body.name])
        else:
            place = comm or bodies[0].mesh.comm
            parts.append(half_plane_of(part_of(scene, body), place, names, *parts))
    return Stack(scene, tuple(parts), soft)


def contact_of(scene: Scene) -> tuple[ContactPoints, list[float]]:
    """Mesh a scene on this process; return contact points, mean sizes of the slaves' elements.

    Of half-planes it takes the first, or the body on one.
    """
    meshed = [body for body in scene.bodies if not body.is_half_plane]
    if len(meshed) < len(scene.bodies):
        scene = part_of(scene, meshed[0] if meshed else in_order(scene)[0])
    scenes = [part_of(scene, body) for body in scene.bodies]
    meshes = make_meshes(MPI.COMM_SELF, scene, scene.axisymmetric) if meshed else ()
    contacts = [] if meshed else [own_nodes(scene)]
    for part, mesh in zip(scenes, meshes, strict=False):
        space = _dolfinx.vector_space(mesh.mesh, scene.mesh.degree)
        contacts.append(find_contact(part, space, mesh, np.zeros((0, 3)))[0])
    sizes = {}
    for part, nodes in zip(scenes, contacts, strict=True):
        for (joint, _), side in zip(sides_of_body(scene, part.body), nodes.sides, strict=True):
            if side.slave:
                ends = side.facets[side.facets.min(axis=1) >= 0, :2]
                a, b = np.moveaxis(side.points[ends], 1, 0)
                sizes[joint] = float(np.linalg.norm(b - a, axis=1).mean())
    return relative_of(scene, contacts, scenes)[1], [sizes[k] for k in range(len(scene.contacts))]


def condense(bodies: Stack) -> ContactSystem | None:
    """Condense the bodies to the contact nodes; collective.

    Returns the system on rank 0, with the data of the contact nodes, each on its first body. Its
    friction and gap are NaN: :func:`receding_fenicsx.evolution.problem.with_profiles` sets them.
    """
    bodies.condense()

    def system() -> ContactSystem:
        scene, contact, joined = bodies.scene, bodies.contact, given(bodies.joined)
        unknown = np.full(len(contact.x), np.nan)
        edges = [part.edge for part in scene.contacts]
        return ContactSystem(
            x=contact.x,
            points=contact.points,
            weight=contact.weight,
            K=joined.K,
            r_star=joined.r_star,
            load_names=scene.load_names,
            f=unknown,
            g0=unknown.copy(),
            held=joined.held,
            rigid=joined.rigid,
            half=bodies.parts[0].half and not scene.axisymmetric,
            load_compliance=joined.compliance,
            load_sign=joined.sign,
            edge=contact.edge,
            # numbered where several contacts lie on one edge
            edge_names=tuple(
                f"{name} {edges[: i + 1].count(name)}" if edges.count(name) > 1 else name
                for i, name in enumerate(edges)
            ),
            axisymmetric=scene.axisymmetric,
            scene_toml=to_toml(scene),
        )

    return on_root(bodies.comm, system)
