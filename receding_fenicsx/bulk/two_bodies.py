"""Two discretised bodies in contact with each other: assembly and joined condensed system."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from mpi4py import MPI

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import elasticity
from receding_fenicsx.bulk.acting.links import NAME, add_links, with_links
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.bulk.half_planes.body import HalfPlane, half_plane_of
from receding_fenicsx.bulk.half_planes.pair import join_half_planes
from receding_fenicsx.bulk.join_bodies import CondensedBody, JoinedBodies, join
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import part_of


@dataclass
class Pair:
    """Two discretised bodies, the contact's ``edge`` being on the first.

    Attributes:
        scene: what they were built from.
        parts: the bodies, each with its own part of the scene.
        joined: their condensed system on rank 0, once they are condensed.
        condensed: they are, known on every rank.
        soft: compliance (m, m) of springs between the bodies, whose unit loads are the last m.
    """

    scene: Scene
    parts: tuple[Bulk | HalfPlane, Bulk | HalfPlane]
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

    @property
    def contact(self) -> ContactNodes:
        """Contact nodes, on the first body."""
        return self.parts[0].contact

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads on both bodies."""
        return self.scene.body_names

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the unit loads of springs between the bodies."""
        every = self.parts[0].load_names
        return tuple(name for name in every if name.startswith(NAME))

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


Bodies = Bulk | HalfPlane | Pair
"""One discretised body, or two in contact."""


def build_all(scene: Scene, bodies: tuple[BodyMesh, ...], comm: MPI.Comm | None = None) -> Bodies:
    """Assemble one body or two; see :func:`elasticity.build`.

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
    owner = scene.find_edge(scene.contacts[0].edge)[0]
    parts: list[Bulk | HalfPlane] = []
    for body in sorted(scene.bodies, key=lambda body: body != owner):
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
    return Pair(scene, (parts[0], parts[1]), soft=soft)


def join_pair(pair: Pair, condensed: tuple[CondensedBody | None, CondensedBody | None]) -> None:
    """Join the condensed bodies of a pair on rank 0; on all ranks together.

    Args:
        pair: the pair, which keeps the result.
        condensed: both condensed bodies on rank 0.
    """

    def work() -> JoinedBodies:
        every = pair.load_names + pair.link_names
        sides = [
            _with_all_loads(part, bulk.load_names, every)
            for part, bulk in zip(condensed, pair.parts, strict=True)
            if part is not None
        ]
        joined = join(sides[0], sides[1], every)
        return with_links(joined, pair.soft) if len(pair.soft) else joined

    pair.joined = on_root(pair.comm, work)
    pair.condensed = True


def join_without_meshes(pair: Pair) -> bool:
    """Join the bodies of a pair on rank 0 if both are half-planes; return whether they are."""
    a, b = pair.parts
    if not (isinstance(a, HalfPlane) and isinstance(b, HalfPlane)):
        return False
    pair.joined = on_root(pair.comm, lambda: join_half_planes(a, b, pair.load_names))
    pair.condensed = True
    return True


def _with_all_loads(
    part: CondensedBody, own: tuple[str, ...], every: tuple[str, ...]
) -> CondensedBody:
    """Return a condensed body with the loads of both bodies, zero where they act on the other."""
    rows = np.array([every.index(name) for name in own], dtype=int)
    r_star = np.zeros((len(every), len(part.held)))
    compliance, sign = np.zeros((len(every), len(every))), np.zeros(len(every))
    r_star[rows] = part.r_star
    compliance[np.ix_(rows, rows)] = part.compliance
    sign[rows] = part.sign
    return replace(part, r_star=r_star, compliance=compliance, sign=sign)
