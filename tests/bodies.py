"""Small bodies for the tests of mesh, elasticity and condensation."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk import _dolfinx, stack
from receding_fenicsx.bulk.body import Bulk, back_substitute, gather_contact
from receding_fenicsx.bulk.mesh.meshing import BodyMesh, make_meshes
from receding_fenicsx.bulk.stack import Body, Stack, build
from receding_fenicsx.studies import run as study

Array = NDArray[np.float64]

CELLS = ("triangle", "quadrilateral")
ELEMENTS = pytest.mark.parametrize(("cell", "degree"), [("triangle", 2), ("quadrilateral", 1)])
"""For what does not depend on the element; an own assembly is compared with all four."""

YOUNG, NU = 2.0, 0.3
ROUND = rf.Material(YOUNG, NU, "axisymmetric")
ONCE = rf.HistoryOptions(kind="monotonic")


def block(
    cell: str = "triangle",
    degree: int = 1,
    elements: int = 16,
    growth: float = 1.3,
    load: rf.Load | None = None,
    **parts: object,
) -> rf.Scene:
    """The paper's block, coarse: 4 by 1, pressed over the middle half of its top.

    ``parts`` replace fields of the scene.
    """
    scene = rf.Scene(
        body=rf.Body(width=4.0, height=1.0),
        material=rf.Material(young=2.0, poisson=0.3),
        mesh=rf.MeshOptions(contact_elements=elements, cell=cell, degree=degree, growth=growth),
        loads=(load or rf.Load("p0", "top", (-1.0, 1.0), pressure=1.0),),
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


def cylinder(cell: str = "triangle", degree: int = 1, **parts: object) -> rf.Scene:
    """A cylinder of radius 2 and height 1 on a smooth plane, pressed over all of its top."""
    smooth = {"contacts": (rf.Contact(friction=0.0),), "material": ROUND, "history": ONCE}
    scene = block(cell, degree, load=rf.Load("p", "top", pressure=1.0))
    return replace(scene, **(smooth | parts))  # type: ignore[arg-type]


def make_mesh(comm: MPI.Comm, scene: rf.Scene, half: bool) -> BodyMesh:
    """Mesh the only body of a scene."""
    (mesh,) = make_meshes(comm, scene, half)
    return mesh


def built(scene: rf.Scene, half: bool = False, comm: MPI.Comm = MPI.COMM_WORLD) -> Bulk:
    """Mesh and assemble."""
    return build(scene, make_mesh(comm, scene, half))


def stack_of(bulk: Body | Stack) -> Stack:
    """A body as a stack of one."""
    return bulk if isinstance(bulk, Stack) else Stack(bulk.scene, (bulk,))


def condense(bulk: Body | Stack) -> rf.ContactSystem | None:
    """Condense one body or several."""
    return stack.condense(stack_of(bulk))


def system_of(
    scene: rf.Scene, half: bool = False, comm: MPI.Comm = MPI.COMM_WORLD
) -> rf.ContactSystem | None:
    """Condense the only body of a scene."""
    bulk = built(scene, half, comm)
    system = condense(bulk)
    bulk.destroy()
    return system


def everything(body: BodyMesh) -> tuple[Array, NDArray[np.int64]]:
    """All points (n, 2) and cells (DOLFINx's order) of a mesh, alike on every rank."""
    mesh = body.mesh
    index_map, cells = mesh.geometry.index_map(), mesh.topology.index_map(2).size_local
    numbers = _dolfinx.cell_nodes(mesh)[:cells]
    owned = mesh.geometry.x[: index_map.size_local, :2]
    around = index_map.local_to_global(numbers.ravel()).reshape(numbers.shape)
    parts = mesh.comm.allgather((owned, around))
    return np.vstack([p[0] for p in parts]), np.vstack([p[1] for p in parts]).astype(np.int64)


def displacements(
    bulk: Stack, load: Array | None, u: Array | None
) -> list[tuple[Bulk, fem.Function]]:
    """Return each body that has a mesh with its displacement field; collective.

    Arguments as of ``Stack.as_joined``.
    """
    return [
        (part, back_substitute(part, *side))
        for part, *side in bulk.as_joined(load, u)
        if isinstance(part, Bulk)
    ]


def reactions(bulk: Bulk, load: Array | None, displacement: fem.Function) -> Array | None:
    """Return the contact reactions [Q; P] of a displacement field, on rank 0; collective.

    They are the nodal forces E A u less the loads: an independent check of
    r = sum lambda r* + K u.
    """
    factors = np.asarray(bulk.comm.bcast(load, root=0), float)
    vector, force = bulk.stiffness.createVecRight(), bulk.stiffness.createVecLeft()
    vector.getArray()[:] = _dolfinx.owned_values(displacement)
    bulk.stiffness.mult(vector, force)
    force.scale(bulk.young)
    # a prescribed displacement is in the field already
    force.getArray()[:] -= bulk.loads @ np.where(bulk.sign > 0.0, 0.0, factors)
    gathered = gather_contact(bulk, force.getArray(readonly=True)[:, None])
    vector.destroy()
    force.destroy()
    return None if gathered is None else bulk.contact.to_local(gathered[:, 0])


def played(scene: rf.Scene) -> rf.Record:
    """The record of a scene, on every rank."""
    system = study.condense(scene, MPI.COMM_WORLD)
    record = rf.evolve(system, scene) if system is not None else None
    return rf.given(MPI.COMM_WORLD.bcast(record))


def last(scene: rf.Scene) -> tuple[rf.ContactSystem, rf.Record]:
    """Return the system and the record of a scene."""
    rf.validate(scene)
    system = rf.given(study.condense(scene, MPI.COMM_WORLD))
    return system, rf.evolve(system, scene)
