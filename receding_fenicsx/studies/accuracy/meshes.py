"""Meshes of a scene: families whose sizes are all enlarged or reduced alike; smaller elements.

A rectangle and a .geo file that takes ``contact_elements`` are made anew with other elements, and a
growth whose distance from 1 changes in proportion: sizes are dx + (growth - 1) depth. Other files
are refined uniformly, which halves all sizes; rectangles in contact with them get twice as many
elements, so that nodes match.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from receding_fenicsx import mpi
from receding_fenicsx.arrays import Ints
from receding_fenicsx.bulk.mesh.user_mesh import takes_elements
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.measures.ends import contact_betas, estimated_ends
from receding_fenicsx.scene.model import Refinement, Scene
from receding_fenicsx.scene.symmetry import is_cylinder, is_horizontal

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

MIN_ELEMENTS = 8
"""Smallest number of contact elements of a mesh."""


def is_refined(scene: Scene) -> bool:
    """Return whether other meshes of a scene come from uniform refinement of a file."""
    return any(body.mesh is not None and not takes_elements(body) for body in scene.bodies)


def is_graded(scene: Scene) -> bool:
    """Return whether a scene's meshes are graded towards the ends of a contact edge."""
    return any(place.at == "ends" for place in scene.mesh.places)


def scaled_mesh(scene: Scene, elements: int) -> Scene:
    """Return the scene on a mesh of so many contact elements, all sizes changed alike.

    Of a mesh file that is refined, they are the scene's number of elements doubled or halved.
    """
    mesh = scene.mesh
    factor = mesh.contact_elements / elements

    def grown(growth: float) -> float:
        return min(1.0 + factor * (growth - 1.0), 3.0)

    # half-planes have no cells that could grow
    cells = mesh.refine is not None or any(not body.is_half_plane for body in scene.bodies)
    growth = grown(mesh.growth) if cells else mesh.growth
    if is_refined(scene):
        times = (mesh.refinements or 0) - round(math.log2(factor))
        mesh = replace(mesh, refinements=times)
        if any(body.mesh is None for body in scene.bodies):
            mesh = replace(mesh, contact_elements=elements, growth=growth)
        return replace(scene, mesh=mesh)
    places = [
        replace(p, size=factor * p.size, growth=p.growth and max(grown(p.growth), 1.01))
        for p in mesh.places
    ]
    scaled = None if mesh.refine is None else tuple(places)
    return replace(
        scene, mesh=replace(mesh, contact_elements=elements, growth=growth, refine=scaled)
    )


def graded_at_ends(scene: Scene, sizes: Sequence[float]) -> Scene:
    """Return a scene whose meshes are graded to the ends of contact edges and re-entrant corners.

    In all meshes of the family the elements there, of which ``sizes`` gives the length on each
    contact edge without grading, are smaller than the others by the same ratio, and grow away from
    them at a rate whose distance from 1 is in proportion to their size. The body gets smaller
    elements too, as without the errors of the corners those inside it count. A scene with a place
    at "ends" is returned as it is. InputError: a mesh file cannot be graded.
    """
    if is_refined(scene):
        raise InputError(
            "[mesh] refine: this mesh file is refined uniformly; give a .geo file that takes "
            "contact_elements"
        )
    places = scene.mesh.places
    if is_graded(scene):
        return scene
    growth = min(1.0 + 24 / scene.mesh.contact_elements, 3.0)
    files = any(body.mesh is not None for body in scene.bodies)
    places += tuple(
        Refinement(size / 100.0, at, growth, contact.edge)
        for contact, size in zip(scene.contacts, sizes, strict=True)
        for at in (("ends", "corners") if files else ("ends",))
    )
    bulk = min(scene.mesh.growth, 1.0 + 12 / scene.mesh.contact_elements)
    return replace(scene, mesh=replace(scene.mesh, refine=places, growth=bulk))


def to_limit(scene: Scene) -> Scene:
    """Return a scene whose cycles end in their limit, where it plays them until they are steady.

    The limit does not depend on where playing stops. A scene of few cycles, or with a steady
    tolerance of its own, is returned as it is.
    """
    history, solver = scene.history, scene.solver
    exact = (solver.steady_tolerance, solver.method, solver.branch) == (None, "events", "first")
    if history.until != "steady" or history.cycles < 50 or not exact:
        return scene
    return replace(scene, history=replace(scene.history, until="limit"))


def doublings(scene: Scene) -> list[int]:
    """Return the elements of all meshes of a refined file, from the coarsest."""
    least = scene.mesh.contact_elements / 2 ** (scene.mesh.refinements or 0)
    return [round(least * 2**k) for k in range(7)]


def solve_near(
    scene: Scene,
    wanted: float,
    most: float,
    solve: Callable[[Scene, int], T],
    ratio: float = 1.6,
) -> T | None:
    """Solve on the mesh nearest to a wanted number of elements whose vertices fit the scene.

    It has from ``wanted`` / ``ratio`` to ``most`` elements; None where there is none such. Where
    all are misfits, the error of the last one is raised.
    """
    low = max(wanted / ratio, MIN_ELEMENTS)
    found = [*range(2 * math.ceil(low / 2), int(most) + 1, 2)]
    if is_refined(scene):
        found = [n for n in doublings(scene) if wanted / ratio <= n <= most]
    misfit = None
    for elements in sorted(found, key=lambda n: abs(math.log(n / wanted))):
        try:
            return solve(scaled_mesh(scene, elements), elements)
        except MeshMisfit as error:
            misfit = error
    if misfit is not None:
        raise misfit
    return None


def count_nodes(scene: Scene) -> int:
    """Return the number of contact nodes; the bodies are meshed on this rank."""
    from receding_fenicsx.bulk.stack import contact_of

    return len(contact_of(scene)[0].x)


def coarser(scene: Scene) -> Scene | None:
    """Return the scene on the mesh nearest to half as many elements that fits, None if too coarse.

    The bodies are meshed on this rank.
    """

    def fitting(partner: Scene, _: int) -> Scene:
        count_nodes(partner)
        return partner

    half = 0.5 * scene.mesh.contact_elements
    return solve_near(scene, half, half, fitting)


def partner(scene: Scene, comm: MPI.Comm) -> Scene | None:
    """Return :func:`coarser` on all ranks; collective."""
    return comm.bcast(mpi.on_root(comm, lambda: coarser(scene)))


# -- smaller elements where a coarse run needs them ----------------------------------------------


def refined_at_zone_ends(
    scene: Scene,
    record: Record,
    ratio: float = 4.0,
    corner_ratio: float = 100.0,
    growth: float = 1.5,
) -> Scene:
    """Return a scene with smaller elements where zones end in a coarser run of it, and at corners.

    Zone ends are those at the turning points of cycles 0, 1 and the last one. Where an end was not
    fitted below the node spacing, the whole interval in which it lies is refined. Corners are ends
    of a contact edge that touch at one of these turning points.

    Args:
        scene: the scene; places in its ``mesh.refine`` are kept.
        record: a record of the scene, on this or on another mesh.
        ratio: size of the largest contact elements of the record over that at zone ends, which a
            coarse run knows not well enough for more than 4; 8 pays at those of a graded run.
        corner_ratio: the same at corners, where tractions may be singular.
        growth: size ratio of neighbouring elements away from the new places.
    """
    for each in (ratio, corner_ratio):
        if not each > 0.0:
            raise InputError(f"refined_at_zone_ends: ratios must be positive, not {each:g}")
    parts = record.by_edge()
    numbers = np.unique(record.edge)
    if numbers[-1] >= len(scene.contacts):
        raise InputError("refined_at_zone_ends: the record has more contact edges than the scene")
    places = list(scene.mesh.places)
    for part, number in zip(parts.values(), numbers, strict=True):
        edge = scene.contacts[number].edge if len(scene.contacts) > 1 else None
        size = float(np.diff(part.x).max()) * scene.mesh.degree
        # the turning points of cycles 0, 1 and the last one at which the contact is loaded
        table = part.turning_points
        chosen = np.isin(table.cycle, (0, 1, table.cycle.max(initial=0)))
        force = np.abs(table.P).max(axis=1, initial=0.0)
        rows = np.flatnonzero(chosen & (force > 1e-9 * force.max(initial=0.0)))
        for at in _zone_ends(scene, part, rows, size / ratio):
            places.append(Refinement(size / ratio, at, growth, edge))
        for k in part.corner_ends:  # 0 or -1, where it touches
            if np.any(table.state[rows][:, k] != State.SEPARATION):
                places.append(Refinement(size / corner_ratio, float(part.x[k]), growth, edge))
    return replace(scene, mesh=replace(scene.mesh, refine=tuple(places)))


def _zone_ends(
    scene: Scene, record: Record, rows: Ints, size: float
) -> list[float | tuple[float, float]]:
    """Return where zones end, or the ranges; those closer than two elements to another left out."""
    edge = scene.contacts[int(record.edge[0])].edge
    body, _ = scene.find_edge(edge)
    # a rectangle is graded alike on both sides of its middle
    ring = scene.axisymmetric and is_horizontal(scene, edge) and not is_cylinder(scene, body)
    mirrored = body.mesh is None and not ring
    betas = contact_betas(record)
    found: list[tuple[float, float]] = []
    for row in rows:
        for end in estimated_ends(record, int(row), betas):
            low, high = [end["value"]] * 2 if end["fitted"] else end["interval"]
            low, high = max(low, float(record.x[0])), min(high, float(record.x[-1]))
            pair = (-high, -low) if mirrored and low + high < 0.0 else (low, high)
            if all(max(abs(a - b) for a, b in zip(pair, p, strict=True)) > 2 * size for p in found):
                found.append(pair)
    return [low if low == high else (low, high) for low, high in sorted(found)]
