"""Scene of a single one of several bodies, for meshing and condensing it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Refinement, Scene
from receding_fenicsx.scene.symmetry import HORIZONTAL, edge_points, edge_range, is_horizontal


def part_of(scene: Scene, body: Body) -> Scene:
    """Return the scene of one body, with edge names without its name, and without the others."""

    def own(edge: str | None) -> str | None:
        owner, name = scene.find_edge(edge) if edge else (None, None)
        return name if owner == body else None

    def of_body(parts: Iterable[Any]) -> tuple[Any, ...]:
        on = [p for p in parts if (own(p.edge) if p.edge else p.body in (None, body.name))]
        return tuple(replace(p, edge=p.edge and own(p.edge), body=None) for p in on)

    contacts = []
    for joint in scene.joints:
        # a tie is meshed and condensed like a contact
        contact = joint if isinstance(joint, Contact) else Contact()
        for edge, span in ((own(joint.edge), joint.span), (own(joint.against), None)):
            if edge is not None:
                contacts.append(replace(contact, edge=edge, against=None, span=span))
    # the joined system has the interference, gaps and bolts
    if scene.others:
        contacts = [replace(contact, interference=None) for contact in contacts]
    loads = scene.given if scene.others else scene.loads
    bolts = [replace(b, head=own(b.head) or "", nut=own(b.nut) or "") for b in scene.bolts]
    mesh = replace(scene.mesh, refine=places_on(scene, body))
    material = scene.material_of(body)
    return replace(
        scene,
        body=body,
        others=(),
        material=replace(material, name=""),
        materials=(material,) if body.material else scene.surface_materials(body),
        mesh=replace(mesh, contact_elements=contact_elements(scene, body)),
        contacts=tuple(contacts),
        ties=(),
        loads=of_body(load for load in loads if load.gap is None),
        supports=of_body(scene.supports),
        bolts=() if scene.others else tuple(bolts),
        springs=of_body(scene.springs),
        probes=() if scene.others else scene.probes,
    )


def places_on(scene: Scene, body: Body) -> tuple[Refinement, ...]:
    """Return the refined places on a body's contact edges, which both bodies of a contact get."""
    found = []
    for contact in scene.contacts if scene.mesh.places else ():
        sides = [scene.find_edge(e) for e in (contact.edge, contact.against) if e is not None]
        # a half-plane takes the nodes of its partner, or of the first of two half-planes
        sides = [side for side in sides if not side[0].is_half_plane] or sides[:1]
        if body not in [owner for owner, _ in sides]:
            continue
        own = next(name for owner, name in sides if owner == body)
        places = [place for place in scene.mesh.places if place.edge in (None, contact.edge)]
        files = [owner.mesh is not None for owner, _ in sides]
        if not any(files):
            edges = [edge for edge in (contact.edge, contact.against) if edge][: len(sides)]
            places = _on_rectangle(scene, edges, contact.span, body, places)
        elif not all(files):
            raise InputError("[mesh] refine: needs mesh files on both sides of a contact, or none")
        elif contact.span is not None:
            corners = [place for place in places if place.at == "corners"]
            places = _resolved(places, contact.span) + corners
        if all(files) and body != sides[0][0]:
            # along t, which is opposite on the other body
            places = [p if isinstance(p.at, str) else _moved(p, -1.0, 0.0) for p in places]
        growth = scene.mesh.growth
        found += [replace(place, edge=own, growth=place.growth or growth) for place in places]
    return tuple(found)


def _resolved(places: Iterable[Refinement], ends: Iterable[float]) -> list[Refinement]:
    """Return the places, those at "ends" by one at each end, without those at "corners"."""
    return [
        replace(place, at=at)
        for place in places
        if place.at != "corners"
        for at in (ends if isinstance(place.at, str) else (place.at,))
    ]


def _moved(place: Refinement, sign: float, shift: float) -> Refinement:
    """Return a place at sign * s + shift."""
    low, high = sorted(sign * s + shift for s in place.span)
    return replace(place, at=(low, high))


def _on_rectangle(
    scene: Scene,
    edges: list[str],
    span: tuple[float, float] | None,
    body: Body,
    places: list[Refinement],
) -> list[Refinement]:
    """Return the places of a contact on one of its rectangles, and breaks at its ends."""
    # coordinates from which positions count, from the middle of the first edge
    zeros = [edge_points(scene, e, 0.0)[0 if is_horizontal(scene, e) else 1] for e in edges]
    shifts = [float(zero - zeros[0]) for zero in zeros]
    ranges = [edge_range(scene, edge) for edge in edges]
    low = max(shift + a for shift, (a, _) in zip(shifts, ranges, strict=True))
    high = min(shift + b for shift, (_, b) in zip(shifts, ranges, strict=True))
    low, high = (max(low, span[0]), min(high, span[1])) if span is not None else (low, high)
    # nothing ends on the axis of a body of revolution
    radial = scene.axisymmetric and is_horizontal(scene, edges[0])
    places = _resolved(places, [s for s in (low, high) if not (radial and s == 0.0)])
    if len(edges) == 1:
        return places
    places += [Refinement(high - low, s, 2.0) for s in (low, high)]
    owners = [scene.find_edge(edge)[0] for edge in edges]
    mine = shifts[owners.index(body)]
    return [_moved(place, 1.0, -mine) for place in places]


def contact_elements(scene: Scene, body: Body) -> int:
    """Return the even number of elements of the first contact's size on a body's contact edge."""
    n = scene.mesh.contact_elements
    if not scene.others or not body.is_rectangle:
        return n
    first = scene.contacts[0].edge
    own = next((edge for _, edge, _ in _touching(scene, body)), first)
    if not scene.find_edge(first)[0].is_rectangle:
        return n
    # for a cylinder the diameters
    sides = map(scene.find_edge, (first, own))
    before, length = (side.width if name in HORIZONTAL else side.height for side, name in sides)
    # 4.5 is rounded alike in all units of length, whatever its round-off
    return max(2, 2 * round(round(0.5 * n * length / before, 9)))


def in_order(scene: Scene) -> list[Body]:
    """Return the bodies in the order of their fields: that of the first contact's edge first."""
    owner = scene.find_edge(scene.contacts[0].edge)[0]
    return sorted(scene.bodies, key=lambda body: body != owner)


def sides_of_body(scene: Scene, body: Body) -> list[tuple[int, int]]:
    """Return the numbers of a body's contacts and ties, +1 where it is the first body, or -1."""
    return [(k, side) for k, _, side in _touching(scene, body)]


def _touching(scene: Scene, body: Body) -> Iterator[tuple[int, str, int]]:
    """Yield a body's contacts and ties: number, edge on it, +1 as the first body, or -1."""
    for k, contact in enumerate(scene.joints):
        for edge, side in ((contact.edge, 1), (contact.against, -1)):
            if edge is not None and scene.find_edge(edge)[0] == body:
                yield k, edge, side
