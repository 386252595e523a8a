"""Validation of contact edges, spans and the initial slip."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.profiles import check_table, directions, evaluate_checked
from receding_fenicsx.scene.rectangle_edges import (
    EDGES,
    FAR,
    HORIZONTAL,
    contact_samples,
    edge_range,
    is_cylinder,
)
from receding_fenicsx.scene.validate_bodies import check_elements

LENGTH_TOLERANCE = 1e-9
"""Distance of two positions that count as equal, over the length of the edge."""

KINK = 1e-6
"""Change of slope of a table, over its largest slope, that is a kink and not round-off."""
SAMPLED_POINTS = 6
"""Number of kinks of a table from which it is taken for samples of a curve."""
COARSE_TABLE = 1.5
"""Distance of a table's points, over that of the nodes, above which the mesh resolves its kinks.
A parabola of 51 points on 161 nodes has peaks of 4 % of the largest pressure, one of 201 points
0.2 %."""


def check_touching(scene: Scene) -> None:
    """Check that there are contacts, and that every body is in one of them."""
    if not scene.contacts:
        raise InputError("[contact]: the scene has none; add one")
    edges = [edge for contact in scene.contacts for edge in (contact.edge, contact.against) if edge]
    touching = [scene.find_edge(edge)[0] for edge in edges]
    for body in scene.bodies:
        if body not in touching:
            raise InputError(
                f"body '{body.name}': touches nothing; name one of its edges in a [[contact]]"
            )


def check_contact(scene: Scene, number: int) -> None:
    """Check the edges of a contact, its span, friction, gap and interference."""
    contact = scene.contacts[number]
    where = "[contact]" if len(scene.contacts) == 1 else f"[[contact]] number {number + 1}"
    check_edge(scene, contact.edge, f"{where} edge", HORIZONTAL)
    if contact.against is not None:
        check_edge(scene, contact.against, f"{where} against", HORIZONTAL)
        if not scene.others:
            raise InputError(
                f"{where} against: the scene has one body only; add a second [[body]], or remove "
                "against for a rigid plane"
            )
        if scene.find_edge(contact.against)[0] == scene.find_edge(contact.edge)[0]:
            raise InputError(f"{where} against: must name an edge of another body")
    meshed = has_mesh_file(scene, contact.edge)
    check_span(scene, contact.edge, contact.span, f"{where} span")
    forward, backward = directions(contact.friction, f"{where} friction")
    profiles = [(forward, "friction"), (contact.initial_gap, "initial_gap")]
    if contact.interference is not None:
        profiles.append((contact.interference, "interference"))
        if not scene.others and scene.body.is_half_plane:
            raise InputError(f"{where} interference: a half-plane moves as a whole; remove it")
    if forward != backward:
        profiles[:1] = [(forward, "friction forward"), (backward, "friction backward")]
    for profile, key in profiles:
        check_table(profile, f"{where} {key}")
    if meshed:
        # the points of the edge are known when it is meshed; numbers need none
        profiles = [(p, key) for p, key in profiles if not isinstance(p, dict | str)]
    elif not scene.find_edge(contact.edge)[0].is_half_plane:
        check_elements(scene.mesh, *scene.find_edge(contact.edge))
    x = np.zeros(1) if meshed else contact_samples(scene, contact)
    for profile, key in profiles:
        values = evaluate_checked(profile, x, None, f"{where} {key}")
        if values.min() < 0.0:
            at = x[np.argmin(values)]
            raise InputError(
                f"{where} {key}: is {values.min():g} at x = {at:.6g}; must not be negative"
            )


def check_edge(
    scene: Scene, edge: str, where: str, of_half_plane: tuple[str, ...] = (FAR,)
) -> None:
    """Check that a body has an edge; groups of a mesh file are checked when it is read.

    Args:
        scene: the scene.
        edge: its name.
        where: begins the message.
        of_half_plane: names that a half-plane's edge may have here.
    """
    try:
        body, name = scene.find_edge(edge)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if body.mesh is not None:
        return
    choices = of_half_plane if body.is_half_plane else EDGES
    if name not in choices:
        raise InputError(f'{where}: "{name}" is unknown; use one of {", ".join(choices)}')
    if is_cylinder(scene, body) and name == "left":
        raise InputError(
            f'{where}: "{edge}" is the axis r = 0 of the axisymmetric body; use another edge'
        )


def check_span(scene: Scene, edge: str, span: tuple[float, float] | None, where: str) -> None:
    """Check that a span is an interval within its edge."""
    if span is None:
        return
    if scene.find_edge(edge)[1] == FAR and not has_mesh_file(scene, edge):
        raise InputError(f"{where}: the far field of a half-plane has no parts; remove span")
    low, high = span if has_mesh_file(scene, edge) else edge_range(scene, edge)
    slack = LENGTH_TOLERANCE * abs(high - low)
    if not span[1] - span[0] > slack:
        raise InputError(
            f"{where}: [{span[0]:g}, {span[1]:g}] is empty; write [lower end, upper end]"
        )
    if span[0] < low - slack or span[1] > high + slack:
        raise InputError(
            f'{where}: [{span[0]:g}, {span[1]:g}] reaches beyond edge "{edge}", which runs from '
            f"{low:g} to {high:g}; shorten it"
        )


def has_mesh_file(scene: Scene, edge: str) -> bool:
    """Return whether an edge is a group of a mesh file."""
    return scene.find_edge(edge)[0].mesh is not None


def check_initial_slip(scene: Scene) -> None:
    """Check the profile of the initial slip on every contact edge of a rectangle."""
    slip = scene.history.initial_slip
    if slip is None:
        return
    check_table(slip, "[history] initial_slip")
    for contact in scene.contacts:
        if not has_mesh_file(scene, contact.edge):
            x = contact_samples(scene, contact)
            evaluate_checked(slip, x, None, "[history] initial_slip")


def gap_warnings(scene: Scene) -> list[str]:
    """Return one line for each table of a curved gap that is coarser than the contact nodes.

    A table is linear between its points: where these are further apart than the nodes, the mesh
    resolves its kinks, which are edges of the profile with peaks of pressure. Tables of few points
    are taken for polygons by intention; nodes of mesh files are not known yet.
    """
    lines = []
    for i, contact in enumerate(scene.contacts):
        table = contact.initial_gap
        if not isinstance(table, dict) or has_mesh_file(scene, contact.edge):
            continue
        nodes = contact_samples(scene, contact)
        x, gap = (np.asarray(table[key]) for key in ("x", "value"))
        slope = np.diff(gap) / np.diff(x)
        kinks = np.abs(np.diff(slope)) > KINK * np.abs(slope).max(initial=0.0)
        inside = (x[1:-1] > nodes[0]) & (x[1:-1] < nodes[-1])
        apart = float(np.median(np.diff(x)))
        spacing = float(nodes[1] - nodes[0])
        if np.count_nonzero(kinks & inside) >= SAMPLED_POINTS and apart > COARSE_TABLE * spacing:
            where = "[contact]" if len(scene.contacts) == 1 else f"[[contact]] number {i + 1}"
            lines.append(
                f"{where} initial_gap: the table is linear between points {apart:.3g} apart, nodes "
                f"are {spacing:.3g} apart: its kinks give peaks of pressure; use more points or an "
                "expression"
            )
    return lines
