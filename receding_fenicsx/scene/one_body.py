"""Scene of a single body of a pair, for meshing and condensing it."""

from __future__ import annotations

from dataclasses import replace

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Scene
from receding_fenicsx.scene.rectangle_edges import HORIZONTAL

COUNT_TOLERANCE = 1e-9
"""Relative distance of a number of elements from an even number that counts as round-off."""


def part_of(scene: Scene, body: Body) -> Scene:
    """Return the scene of one body, with edge names without the body's name.

    Contacts, loads and supports of the other body are omitted, and the probes of a pair. The number
    of contact elements of a rectangle is that for which elements have the same size on both bodies.

    Args:
        scene: the scene.
        body: one of its bodies.

    Returns:
        A scene of one body.

    Raises:
        InputError: elements of that size need an odd or fractional number on this body.
    """

    def own(edge: str | None) -> str | None:
        if edge is None:
            return None
        owner, name = scene.find_edge(edge)
        return name if owner == body else None

    contacts, loads, supports = [], [], []
    for contact in scene.contacts:
        edge, against = own(contact.edge), own(contact.against)
        if edge is not None:
            contacts.append(replace(contact, edge=edge, against=None))
        elif against is not None:
            contacts.append(replace(contact, edge=against, against=None, span=None))
    for load in scene.loads:
        edge = own(load.edge)
        if edge is not None:
            loads.append(replace(load, edge=edge))
    for support in scene.supports:
        edge = own(support.edge)
        if edge is not None:
            supports.append(replace(support, edge=edge))
        elif support.edge is None and (support.body is None or support.body == body.name):
            supports.append(replace(support, body=None))
    return replace(
        scene,
        body=body,
        others=(),
        material=replace(scene.material_of(body), name=""),
        materials=(),
        mesh=replace(scene.mesh, contact_elements=contact_elements(scene, body)),
        contacts=tuple(contacts),
        loads=tuple(loads),
        supports=tuple(supports),
        probes=() if scene.others else scene.probes,
    )


def contact_elements(scene: Scene, body: Body) -> int:
    """Return the number of contact elements on a body.

    ``mesh.contact_elements`` counts those of the first contact's edge. The other body gets elements
    of the same size.
    """
    n = scene.mesh.contact_elements
    first = scene.contacts[0] if scene.contacts else None
    if first is None or first.against is None or body.mesh is not None:
        return n
    owner, _ = scene.find_edge(first.edge)
    if owner == body or owner.mesh is not None:
        return n
    edge = _length(scene, first)
    wanted = n * edge[1] / edge[0]
    if abs(wanted - 2 * round(wanted / 2)) > COUNT_TOLERANCE * wanted:
        raise InputError(
            f"[mesh] contact_elements: {n} on '{first.edge}' make {wanted:g} on '{first.against}', "
            "which must be an even number; change contact_elements, or a width"
        )
    return 2 * round(wanted / 2)


def _length(scene: Scene, contact: Contact) -> tuple[float, float]:
    """Return the lengths of the edges of both bodies; for a cylinder the diameter."""
    ends = [scene.find_edge(edge) for edge in (contact.edge, contact.against or contact.edge)]
    first, second = (body.width if name in HORIZONTAL else body.height for body, name in ends)
    return first, second
