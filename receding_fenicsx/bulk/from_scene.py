"""From a scene to its bulk and its condensed system, by all ranks together or by rank 0 alone."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.scene.validate_bodies import count_cells
from receding_fenicsx.timing import Timer

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.two_bodies import Pair
    from receding_fenicsx.interface.system import ContactSystem

SMALL_CELLS = 30_000
"""Cells, about, up to which rank 0 condenses a rectangle by itself."""
SMALL_FILE = 10_000_000
"""The same for a user's mesh: bytes of its file."""


def is_small(scene: Scene) -> bool:
    """Return whether rank 0 condenses a scene's body by itself.

    For small bodies that is quicker than together, and it gives the same bits at every start and
    on any number of ranks: several ranks number and add up in the order in which messages come.
    """
    for body in scene.bodies:
        if body.mesh is not None:
            if Path(body.mesh).stat().st_size > SMALL_FILE:
                return False
            continue
        if count_cells(scene.mesh, body.height / body.width) > SMALL_CELLS:
            return False
    return True


def condensed(scene: Scene, comm: MPI.Comm, timer: Timer) -> tuple[ContactSystem | None, int]:
    """Mesh, assemble and condense; return the system on rank 0, and the body's freedoms."""
    from receding_fenicsx.bulk import condensation

    if comm.size > 1 and is_small(scene):
        from mpi4py import MPI

        alone = on_root(comm, lambda: condensed(scene, MPI.COMM_SELF, timer))
        return alone or (None, 0)
    bulk = bulk_of(scene, comm, timer)
    try:
        with timer("condense"):
            system = condensation.condense(bulk)
            on_root(comm, lambda: _check_felt(given(system)))
            return system, bulk.dofs
    finally:
        bulk.destroy()


def _check_felt(system: ContactSystem) -> None:
    """Refuse a contact that supports hold wholly, and a load of which nothing reaches it."""
    if system.held[system.n :].all():
        raise InputError(
            "[[support]]: holds every node of the contact, so nothing can touch or part; hold "
            "another edge, or drop the support"
        )
    for name, reactions in zip(system.load_names, system.r_star, strict=True):
        if not reactions.any():
            raise InputError(
                f"load '{name}': acts on nothing but nodes that supports hold, so nothing of it "
                "reaches the contact; load or hold another edge"
            )


def bulk_of(scene: Scene, comm: MPI.Comm, timer: Timer) -> Bulk | Pair:
    """Mesh and assemble a scene's body or bodies; collective."""
    from receding_fenicsx.bulk import two_bodies
    from receding_fenicsx.bulk.mesh import meshing

    with timer("mesh"), _signals_kept():
        bodies = meshing.make_meshes(comm, scene, is_half_meshed(scene))
    with timer("assemble"):
        return two_bodies.build_all(scene, bodies)


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Put Python's handlers back afterwards: gmsh sets that of SIGTERM to its default."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
