"""Discretised bodies in contact with each other and with planes: assembly, joined system."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import elasticity
from receding_fenicsx.bulk.acting.links import NAME, add_links, with_links
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.bulk.half_planes.body import HalfPlane, half_plane_of
from receding_fenicsx.bulk.half_planes.pair import join_half_planes
from receding_fenicsx.bulk.join_bodies import CondensedBody, JoinedBodies, Place, join
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import in_order, part_of, sides_of_body

log = logging.getLogger(__name__)


@dataclass
class Stack:
    """Several discretised bodies, the first contact's ``edge`` being on the first.

    Attributes:
        scene: what they were built from.
        parts: the bodies, each with its own part of the scene.
        joined: their condensed system on rank 0, once they are condensed.
        condensed: they are, known on every rank.
        soft: compliance (m, m) of springs between the bodies, whose unit loads are the last m.
    """

    scene: Scene
    parts: tuple[Bulk | HalfPlane, ...]
    joined: JoinedBodies | None = None
    condensed: bool = False
    soft: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the meshes."""
        return self.parts[0].comm

    @property
    def body(self) -> BodyMesh:
        """Mesh of the first body."""
        return self.parts[0].body

    @property
    def half(self) -> bool:
        """Whether only x >= 0 is modelled; always for an axisymmetric body."""
        return self.parts[0].half

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """Where the contact nodes of each body are among those of all contacts."""
        sides = [sides_of_body(self.scene, part.scene.body) for part in self.parts]
        sizes = np.zeros(len(self.scene.contacts), dtype=int)
        for own, part in zip(sides, self.parts, strict=True):
            sizes[[k for k, _ in own]] = np.bincount(part.contact.edge)
        starts = np.cumsum(sizes) - sizes
        found = []
        for own, part in zip(sides, self.parts, strict=True):
            contact, side = np.array(own)[part.contact.edge].T
            first = np.searchsorted(part.contact.edge, part.contact.edge)
            node = starts[contact] + np.arange(len(contact)) - first
            found.append(Place(node, side, contact))
        return tuple(found)

    @cached_property
    def contact(self) -> ContactNodes:
        """Nodes of all contacts, each on its first body; held where both sides are."""
        own = [place.side > 0 for place in self.places]
        order = np.argsort(
            np.concatenate([p.node[on] for p, on in zip(self.places, own, strict=True)])
        )

        def merged(name: str) -> Any:
            arrays = [getattr(part.contact, name) for part in self.parts]
            return np.concatenate([a[on] for a, on in zip(arrays, own, strict=True)])[order]

        def halves(name: str) -> Any:
            pairs = [getattr(part.contact, name) for part in self.parts]
            stacked = [a.reshape(2, len(on), -1)[:, on] for a, on in zip(pairs, own, strict=True)]
            return np.concatenate(stacked, axis=1)[:, order].reshape(2 * len(order), -1)

        contact = [place.contact[on] for place, on in zip(self.places, own, strict=True)]
        held = np.ones(2 * len(order), dtype=bool)
        for place, part in zip(self.places, self.parts, strict=True):
            held[place.dofs(len(order))] &= part.contact.held
        single = ("x", "points", "node", "tangent", "normal", "weight")
        return ContactNodes(
            **{name: merged(name) for name in single},
            edge=np.concatenate(contact)[order],
            held=held,
            modes=halves("modes"),
            constraints=np.vstack([part.contact.constraints for part in self.parts]),
            null=np.zeros((2 * len(order), 0)),
        )

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads on all bodies."""
        return self.scene.body_names

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the unit loads of springs between the bodies."""
        return tuple(f"{NAME}{k}" for k in range(len(self.soft)))

    @property
    def dofs(self) -> int:
        """Number of displacement degrees of freedom."""
        return sum(bulk.dofs for bulk in self.parts)

    @property
    def seconds(self) -> dict[str, float]:
        """Time spent on "forms" and "assemble"."""
        parts = [bulk.seconds for bulk in self.parts]
        return {key: sum(part[key] for part in parts) for key in parts[0]}

    def destroy(self) -> None:
        """Free PETSc's objects; on all ranks together."""
        for bulk in self.parts:
            bulk.destroy()


Bodies = Bulk | HalfPlane | Stack
"""One discretised body, or several in contact."""


def build_all(scene: Scene, bodies: tuple[BodyMesh, ...], comm: MPI.Comm | None = None) -> Bodies:
    """Assemble one body or several; see :func:`elasticity.build`.

    Args:
        scene: the scene.
        bodies: mesh of each body that has one.
        comm: communicator of a scene without meshes.

    Returns:
        The discretised body or bodies.
    """
    meshes = iter(bodies)
    built = {
        body.name: elasticity.build(part_of(scene, body), next(meshes))
        for body in scene.bodies
        if not body.is_half_plane
    }
    oblique = np.vstack([np.empty((0, 2)), *(bulk.contact.oblique for bulk in built.values())])
    if len(oblique):
        if bodies[0].mesh.comm.rank == 0:
            places = ", ".join(f"({x:g}, {y:g})" for x, y in oblique)
            log.warning("[[support]]: holds the end of a contact edge, no contact at %s", places)
        for name, bulk in built.items() if len(built) > 1 else ():
            # the node opposite has no contact condition either
            bulk.destroy()
            built[name] = elasticity.build(bulk.scene, bulk.body, oblique)
    parts: list[Bulk | HalfPlane] = []
    for body in in_order(scene):
        if body.name in built:
            parts.append(built[body.name])
            continue
        place = comm or bodies[0].mesh.comm
        nodes = parts[0].contact if parts else None
        surface = parts[0].surface if parts and isinstance(parts[0], HalfPlane) else None
        parts.append(half_plane_of(part_of(scene, body), place, nodes, surface))
    if len(parts) == 1:
        return parts[0]
    soft = add_links(scene, [part for part in parts if isinstance(part, Bulk)])
    return Stack(scene, tuple(parts), soft=soft)


def join_stack(stack: Stack, condensed: list[CondensedBody | None]) -> None:
    """Join the condensed bodies of a stack on rank 0; on all ranks together.

    Args:
        stack: the stack, which keeps the result.
        condensed: the condensed bodies on rank 0.
    """

    def work() -> JoinedBodies:
        every = stack.load_names + stack.link_names
        bodies = [
            _with_all_loads(part, bulk.load_names, every)
            for part, bulk in zip(condensed, stack.parts, strict=True)
            if part is not None
        ]
        joined = join(bodies, stack.places, every)
        return with_links(joined, stack.soft) if len(stack.soft) else joined

    stack.joined = on_root(stack.comm, work)
    stack.condensed = True


def join_without_meshes(stack: Stack) -> bool:
    """Join the bodies of a stack on rank 0 if they are two half-planes; return whether they are."""
    a, b = stack.parts[0], stack.parts[-1]
    if not (isinstance(a, HalfPlane) and isinstance(b, HalfPlane)):
        return False
    stack.joined = on_root(stack.comm, lambda: join_half_planes(a, b, stack.load_names))
    stack.condensed = True
    return True


def _with_all_loads(
    part: CondensedBody, own: tuple[str, ...], every: tuple[str, ...]
) -> CondensedBody:
    """Return a condensed body with the loads of all bodies, zero where they act on others."""
    rows = np.array([every.index(name) for name in own], dtype=int)
    r_star = np.zeros((len(every), len(part.held)))
    compliance, sign = np.zeros((len(every), len(every))), np.zeros(len(every))
    r_star[rows] = part.r_star
    compliance[np.ix_(rows, rows)] = part.compliance
    sign[rows] = part.sign
    return replace(part, r_star=r_star, compliance=compliance, sign=sign)
