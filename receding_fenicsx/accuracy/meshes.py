"""Families of meshes of a scene: all sizes are enlarged or reduced alike.

A rectangle and a .geo file that takes ``contact_elements`` are made anew with other elements, and a
growth whose distance from 1 changes in proportion: sizes are dx + (growth - 1) depth. Other files
are refined uniformly, which halves all sizes; rectangles in contact with them get twice as many
elements, so that nodes match.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

from receding_fenicsx.bulk.mesh.user_mesh import takes_elements
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.model import MIN_REFINED_GROWTH, MOST_REFINEMENTS, Refinement, Scene

T = TypeVar("T")

LARGEST_GROWTH = 3.0
"""Largest growth of a mesh."""
CORNER_RATIO = 100.0
"""Size of the elements of a graded edge over that at its ends."""
GRADED_ELEMENTS = 24
"""Contact elements with which a graded edge has a growth of 2."""
BULK_ELEMENTS = 12
"""Contact elements with which a body with graded edges has at most a growth of 2."""
MIN_ELEMENTS = 8
"""Smallest number of contact elements of a mesh."""
LIMIT_CYCLES = 50
"""Cycles that a history must allow to be left for its limit."""
EXACT_PLAYING = (None, "events", "first")
"""Steady tolerance, method and branch of a history that is left for its limit."""
SEARCH_RATIO = 1.6
"""Largest ratio to the wanted mesh size in the search for a mesh whose vertices fit the scene."""


def is_refined(scene: Scene) -> bool:
    """Return whether other meshes of a scene come from uniform refinement of a file."""
    return any(body.mesh is not None and not takes_elements(body) for body in scene.bodies)


def is_graded(scene: Scene) -> bool:
    """Return whether a scene's meshes are graded towards the ends of a contact edge."""
    return any(place.at == "ends" for place in scene.mesh.refine)


def scaled_mesh(scene: Scene, elements: int) -> Scene:
    """Return the scene on a mesh of so many contact elements, all sizes changed alike.

    Of a mesh file that is refined, they are the scene's number of elements doubled or halved.
    """
    mesh = scene.mesh
    factor = mesh.contact_elements / elements

    def grown(growth: float) -> float:
        return min(1.0 + factor * (growth - 1.0), LARGEST_GROWTH)

    growth = grown(mesh.growth)
    if not is_refined(scene):
        places = tuple(
            replace(
                place,
                size=factor * place.size,
                growth=place.growth and max(grown(place.growth), MIN_REFINED_GROWTH),
            )
            for place in mesh.refine
        )
        mesh = replace(mesh, contact_elements=elements, growth=growth, refine=places)
        return replace(scene, mesh=mesh)
    times = (mesh.refinements or 0) + round(math.log2(elements / mesh.contact_elements))
    mesh = replace(mesh, refinements=times)
    if any(body.mesh is None for body in scene.bodies):
        mesh = replace(mesh, contact_elements=elements, growth=growth)
    return replace(scene, mesh=mesh)


def graded_at_ends(scene: Scene, sizes: Sequence[float]) -> Scene:
    """Return a scene whose meshes are graded to the ends of contact edges and re-entrant corners.

    In all meshes of the family the elements there are smaller than the others by the same ratio,
    and grow away from them at a rate whose distance from 1 is in proportion to their size. Without
    the errors of the corners those inside the body count: it gets smaller elements too.

    Args:
        scene: a scene; one with a place at "ends" is returned as it is.
        sizes: length of the elements on each contact edge.

    Raises:
        InputError: a mesh file cannot be graded.
    """
    if is_refined(scene):
        raise InputError(
            "[accuracy] grading: this mesh file is refined uniformly; leave grading out, or give a "
            ".geo file that takes contact_elements"
        )
    places = scene.mesh.refine
    if is_graded(scene):
        return scene
    growth = min(1.0 + GRADED_ELEMENTS / scene.mesh.contact_elements, LARGEST_GROWTH)
    files = any(body.mesh is not None for body in scene.bodies)
    places += tuple(
        Refinement(size / CORNER_RATIO, at, growth, contact.edge)
        for contact, size in zip(scene.contacts, sizes, strict=True)
        for at in (("ends", "corners") if files else ("ends",))
    )
    bulk = min(scene.mesh.growth, 1.0 + BULK_ELEMENTS / scene.mesh.contact_elements)
    return replace(scene, mesh=replace(scene.mesh, refine=places, growth=bulk))


def to_limit(scene: Scene) -> Scene:
    """Return a scene whose cycles end in their limit, where it plays them until they are steady.

    The limit does not depend on where playing stops. A scene of few cycles,
    or with a steady tolerance of its own, is returned as it is.
    """
    history, solver = scene.history, scene.solver
    playing = (solver.steady_tolerance, solver.method, solver.branch)
    if history.until != "steady" or history.cycles < LIMIT_CYCLES or playing != EXACT_PLAYING:
        return scene
    return replace(scene, history=replace(scene.history, until="limit"))


def doublings(scene: Scene) -> list[int]:
    """Return the elements of all meshes of a refined file, from the coarsest."""
    least = scene.mesh.contact_elements / 2 ** (scene.mesh.refinements or 0)
    return [round(least * 2**k) for k in range(MOST_REFINEMENTS + 1)]


def elements_near(scene: Scene, wanted: float, limits: tuple[float, float]) -> Iterator[int]:
    """Yield numbers of elements within limits, the nearest to a wanted one first."""
    low, high = max(limits[0], MIN_ELEMENTS), limits[1]
    if is_refined(scene):
        found = [n for n in doublings(scene) if limits[0] <= n <= high]
    else:
        found = list(range(2 * math.ceil(low / 2), int(high) + 1, 2))
    yield from sorted(found, key=lambda n: abs(math.log(n / wanted)))


def first_that_fits(
    scene: Scene,
    numbers: Iterator[int],
    solve: Callable[[Scene, int], T],
    refused: type[InputError] = MeshMisfit,
) -> tuple[int, T] | None:
    """Solve on the first mesh whose vertices fit the scene; None where no numbers are given.

    Args:
        scene: a scene of the family.
        numbers: numbers of contact elements.
        solve: called with a scene and its elements.
        refused: the error with which a mesh is refused; that of the last one is raised.
    """
    misfit = None
    for elements in numbers:
        try:
            return elements, solve(scaled_mesh(scene, elements), elements)
        except refused as error:
            misfit = error
    if misfit is not None:
        raise misfit
    return None


def count_nodes(scene: Scene) -> int:
    """Return the number of contact nodes; the bodies are meshed on this rank.

    Raises:
        InputError: a mesh that cannot serve the scene.
    """
    from receding_fenicsx.bulk.half_planes import body
    from receding_fenicsx.bulk.mesh.meshing import contact_nodes_of

    if any(part.is_half_plane for part in scene.bodies):
        return body.count_nodes(scene)
    return sum(contact_nodes_of(scene))


def coarser(scene: Scene) -> Scene | None:
    """Return the scene on the mesh nearest to half as many elements that fits it.

    The bodies are meshed on this rank.

    Returns:
        None where the mesh is too coarse itself.

    Raises:
        InputError: why the last of the meshes that were tried does not fit.
    """

    def fitting(partner: Scene, _: int) -> Scene:
        count_nodes(partner)
        return partner

    half = 0.5 * scene.mesh.contact_elements
    numbers = elements_near(scene, half, (half / SEARCH_RATIO, half))
    found = first_that_fits(scene, numbers, fitting, InputError)
    return None if found is None else found[1]
