"""Assembly and condensation of a scene, on all ranks or for small bodies on rank 0 alone."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import T, given, on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.scene.validate_bodies import count_cells
from receding_fenicsx.timing import Timer

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.bulk.stack import Stack
    from receding_fenicsx.interface.system import ContactSystem, ProbeMatrix


def is_small(scene: Scene) -> bool:
    """Return whether rank 0 condenses a scene's bodies alone.

    For small bodies that is faster than on all ranks, and every run on any number of ranks gives
    the same bits: on several ranks, numbering and sums depend on the order of messages.
    """
    for body in scene.bodies:
        if body.is_half_plane:
            continue
        if body.mesh is not None:
            # 10 MB of a user's mesh, or 30,000 cells (estimated) of a rectangle
            size = Path(body.mesh).stat().st_size * 4 ** (scene.mesh.refinements or 0)
            if size > 10_000_000:
                return False
        elif count_cells(scene.mesh, body.height / body.width) > 30_000:
            return False
    return True


def condensed(scene: Scene, comm: MPI.Comm, timer: Timer) -> tuple[ContactSystem | None, int]:
    """Return a scene's condensed system, on rank 0, and the number of freedoms; collective."""
    from receding_fenicsx.bulk import stack
    from receding_fenicsx.bulk.fields import probe_matrix

    for load in scene.loads:
        if load.mode is not None:
            raise InputError(f"{load.label}: modes are driven by joint, --drive mode:{load.mode}")

    def check(system: ContactSystem) -> None:
        if system.held[system.n :].all():
            raise InputError(
                "[[support]]: holds every node of the contact, so nothing can touch or part; hold "
                "another edge, or drop the support"
            )
        moved = system.load_compliance.any(axis=1)
        for name, reactions, moves in zip(system.load_names, system.r_star, moved, strict=True):
            # a pull on a patch of a rigid bolt moves nothing but the bolt's force
            if not (reactions.any() or moves):
                raise InputError(
                    f"load '{name}': is zero or acts on nothing but nodes that supports hold, so "
                    "nothing of it reaches the contact; give it a value, or load or hold another "
                    "edge"
                )

    def work(bulk: Stack) -> tuple[ContactSystem | None, int]:
        system = stack.condense(bulk)
        on_root(bulk.comm, lambda: check(given(system)))
        probes = probe_matrix(bulk, scene) if scene.probes else None
        return system and replace(system, probes=probes), bulk.dofs

    return _with_bulk(scene, comm, timer, work) or (None, 0)


def probes_of(scene: Scene, comm: MPI.Comm, timer: Timer) -> ProbeMatrix | None:
    """Return the values at a scene's probes alone, on rank 0; collective."""
    from receding_fenicsx.bulk.fields import probe_matrix

    return _with_bulk(scene, comm, timer, lambda bulk: probe_matrix(bulk, scene))


def _with_bulk(
    scene: Scene, comm: MPI.Comm, timer: Timer, work: Callable[[Stack], T | None]
) -> T | None:
    """Return a result of a scene's bodies, assembled for it; small ones on rank 0 alone."""
    if comm.size > 1 and is_small(scene):
        from mpi4py import MPI

        return on_root(comm, lambda: _with_bulk(scene, MPI.COMM_SELF, timer, work))
    bulk = bulk_of(scene, comm, timer)
    try:
        with timer("condense"):
            return work(bulk)
    finally:
        bulk.destroy()


def bulk_of(scene: Scene, comm: MPI.Comm, timer: Timer) -> Stack:
    """Mesh and assemble a scene's bodies; collective."""
    from receding_fenicsx.bulk import stack
    from receding_fenicsx.bulk.mesh import meshing

    with timer("mesh"), _restored_sigterm():
        meshed = [body for body in scene.bodies if not body.is_half_plane]
        # a body on a half-plane is meshed like one on a rigid plane
        whole = scene if len(meshed) == len(scene.bodies) else None
        half = is_half_meshed(scene)
        bodies: tuple[meshing.BodyMesh, ...] = ()
        if meshed:
            bodies = meshing.make_meshes(comm, whole or part_of(scene, meshed[0]), half)
    with timer("assemble"):
        return stack.build_all(scene, bodies, comm)


@contextmanager
def _restored_sigterm() -> Iterator[None]:
    """Restore Python's handler of SIGTERM on exit: gmsh sets it to its default."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)
