"""Validation of bodies, materials, mesh options and contacts."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.checks import check_name, unknown_name
from receding_fenicsx.scene.model import (
    MIN_REFINED_GROWTH,
    RECTANGLE_KEYS,
    Body,
    Material,
    MeshOptions,
    Refinement,
    Scene,
)
from receding_fenicsx.scene.profiles import check_table, directions, evaluate_checked
from receding_fenicsx.scene.symmetry import (
    EDGES,
    FAR,
    HORIZONTAL,
    contact_samples,
    edge_range,
    is_cylinder,
)

MIN_REFINED_SIZE = 1e-6
"""Smallest refined element, over the length of the contact edge: below it, round-off counts."""
LENGTH_TOLERANCE = 1e-9
"""Distance of two positions that count as equal, over the length of the edge."""


def check_bodies(scene: Scene) -> None:
    """Check names, shapes and materials of the bodies."""
    names = [body.name for body in scene.bodies]
    for name in names:
        if scene.others or name:
            check_name(name, "[[body]] name")
        if "." in name:
            raise InputError(f'[[body]] name: "{name}" holds a dot; remove it')
        if names.count(name) > 1:
            raise InputError(
                f"body '{name}': {names.count(name)} bodies have this name; rename one"
            )
    for body in scene.bodies:
        _check_body(body, _label(scene, body))
    used = [scene.material_of(body) for body in scene.bodies]
    used += [material for body in scene.bodies for material in scene.surface_materials(body)]
    for material in scene.materials:
        if material not in used:
            raise InputError(
                f"[material.{material.name}]: no body has this material; name it in a [[body]], or "
                "give it the name of a physical surface"
            )
    for material in used:
        _check_material(material)
    if len({material.kinematics for material in used}) > 1:
        raise InputError("[material] kinematics: differs between the bodies; use the same for all")
    for body in scene.bodies:
        low, high = (body.position[0] + 0.5 * side * body.width for side in (-1.0, 1.0))
        # the smallest hole of a ring, over its width
        ring = scene.axisymmetric and body.is_rectangle and not is_cylinder(scene, body)
        if ring and not low > 1e-6 * body.width:
            raise InputError(
                f"{_label(scene, body)} position: x = {body.position[0]:g} and width "
                f"{body.width:g} make a ring from r = {low:g} to {high:g}; move it off the axis "
                "r = 0, or put a cylinder (its width is the diameter) at x = 0"
            )


def _label(scene: Scene, body: Body) -> str:
    return f"body '{body.name}'" if scene.others else "[body]"


def _check_body(body: Body, label: str) -> None:
    if body.mesh is not None:
        default = Body()
        for key in RECTANGLE_KEYS:
            if getattr(body, key) != getattr(default, key):
                raise InputError(
                    f"{label} {key}: a body from a mesh file has none; remove {key} or mesh"
                )
        return
    for key in ("surface", "parameters"):
        if getattr(body, key):
            raise InputError(f"{label} {key}: needs a mesh file; give mesh, or remove {key}")
    if body.is_half_plane:
        if body.height != Body().height:
            raise InputError(f"{label} height: a half-plane has none; remove it")
        if body.datum is not None and not body.datum >= body.width:
            raise InputError(
                f"{label} datum: {body.datum:g} is less than the width of the contact, "
                f"{body.width:g}; choose a deeper point"
            )
        return
    for key in ("datum", "window"):
        if getattr(body, key) is not None:
            raise InputError(f'{label} {key}: belongs to shape = "half-plane"; remove it')
    # round-off grows with the position
    if max(map(abs, body.position)) > 1e4 * min(body.width, body.height):
        raise InputError(
            f"{label} position: [{body.position[0]:g}, {body.position[1]:g}] is more than 10000 "
            "times the body's smaller side from the origin; move it nearer"
        )


def check_half_planes(scene: Scene) -> None:
    """Check what half-planes touch: their contact edges, and the other body."""
    flat = [body for body in scene.bodies if body.is_half_plane]
    if not flat:
        return
    if scene.is_stack:
        raise InputError(
            f"{_label(scene, flat[0])} shape: a half-plane touches one body or one plane only, not "
            "a stack; use a large rectangle"
        )
    if scene.axisymmetric:
        raise InputError(
            "[material] kinematics: a half-plane is not axisymmetric; use plane strain or plane "
            "stress"
        )
    for body in flat:
        label = _label(scene, body)
        if scene.material_of(body).young_2 is not None:
            raise InputError(f"{label} material: a half-plane is isotropic; use a large rectangle")
        edges = [edge for contact in scene.contacts for edge in (contact.edge, contact.against)]
        own = {
            name
            for owner, name in (scene.find_edge(edge) for edge in edges if edge)
            if owner == body
        }
        if len(own) > 1:
            raise InputError(f"{label}: has the surfaces bottom and top; use one of them")
        if not scene.others:
            continue
        first = {scene.find_edge(contact.edge)[0].name for contact in scene.contacts}
        if body.name in first if len(flat) == 1 else len(first) > 1:
            raise InputError(
                f"[contact] edge: names the half-plane '{body.name}'; exchange edge and against, "
                "it takes its nodes from the other body's mesh"
            )
        for key in ("width", "position"):
            other = Body() if len(flat) == 1 else flat[0]
            if getattr(body, key) != getattr(other, key):
                where = "its partner's mesh" if len(flat) == 1 else f"body '{other.name}'"
                raise InputError(
                    f"{label} {key}: the contact nodes are those of {where}; remove {key}, or "
                    "give both half-planes the same"
                )
    surface, against = scene.find_edge(scene.contacts[0].edge)[1], scene.contacts[0].against
    if len(flat) == 2 and against is not None and scene.find_edge(against)[1] == surface:
        raise InputError(
            f'[contact] against: both half-planes have the surface "{surface}"; one has to be '
            '"bottom" and the other one "top"'
        )


def _check_material(material: Material) -> None:
    where = f"[material.{material.name}]" if material.name else "[material]"
    if material.poisson >= material.poisson_limit:
        raise InputError(
            f"{where} poisson: must be above -1 and below {material.poisson_limit:g} in "
            f"{material.kinematics}, not {material.poisson:g}"
        )
    if (material.young_2 is None) != (material.shear is None):
        raise InputError(f"{where}: an orthotropic material has both young_2 and shear; give both")
    if material.young_2 is None:
        if material.angle != 0.0:
            raise InputError(f"{where} angle: an isotropic material has none; remove it")
        return
    if material.kinematics != "plane stress":
        raise InputError(
            f"{where} young_2: orthotropic materials are for plane stress, where no constants "
            'across the plane count; use kinematics = "plane stress"'
        )
    if not material.poisson**2 < material.young / material.young_2:
        raise InputError(
            f"{where} poisson: its square must be below young / young_2, "
            f"{material.young / material.young_2:g}, not {material.poisson**2:g}"
        )


def check_mesh(scene: Scene) -> None:
    """Check the table [mesh]."""
    mesh = scene.mesh
    n = mesh.contact_elements
    if n % 2 and any(body.mesh is None for body in scene.bodies):
        raise InputError(
            f"[mesh] contact_elements: {n} is odd; use an even number, half on each side of x = 0"
        )
    if mesh.refinements and all(body.mesh is None for body in scene.bodies):
        raise InputError(
            "[mesh] refinements: is for bodies from mesh files; use more contact_elements"
        )
    if mesh.refine and mesh.cell != "triangle":
        raise InputError(
            f'[mesh] refine: is for triangles; use cell = "triangle", not "{mesh.cell}"'
        )
    for i, place in enumerate(mesh.places):
        _check_refinement(scene, place, f"[mesh] refine entry {i + 1}")


def _check_refinement(scene: Scene, place: Refinement, where: str) -> None:
    """Check one entry of refine; whether it lies on its edge is found when the body is meshed."""
    if place.at == "corners" and all(body.mesh is None for body in scene.bodies):
        raise InputError(f"{where} at: rectangles have no re-entrant corners; leave it out")
    if not isinstance(place.at, str) and place.span[0] > place.span[1]:
        raise InputError(f"{where} at: is empty; write [from, to]")
    if place.growth is None and scene.mesh.growth < MIN_REFINED_GROWTH:
        raise InputError(
            f"{where} growth: that of the mesh is {scene.mesh.growth:g}; give one of "
            f"{MIN_REFINED_GROWTH:g} to 3"
        )
    edges = [contact.edge for contact in scene.contacts]
    if place.edge is not None and place.edge not in edges:
        unknown_name(place.edge, edges, f"{where} edge", "contact edge")
    for contact in scene.contacts:
        body, _ = scene.find_edge(contact.edge)
        if body.mesh is None and place.edge in (None, contact.edge):
            low, high = edge_range(scene, contact.edge)
            if place.size < MIN_REFINED_SIZE * (high - low):
                raise InputError(
                    f"{where} size: {place.size:g} is less than {MIN_REFINED_SIZE:g} of the "
                    "contact edge; enlarge it"
                )
            ends = (low, high) if isinstance(place.at, str) else place.span
            slack = MIN_REFINED_SIZE * (high - low)
            if ends[0] < low - slack or ends[1] > high + slack:
                beyond = ends[0] if ends[0] < low - slack else ends[1]
                raise InputError(
                    f"{where} at: {beyond:g} lies beyond the contact edge, which runs from "
                    f"{low:g} to {high:g}; move it"
                )


def count_cells(mesh: MeshOptions, slenderness: float) -> float:
    """Estimate the number of triangles of a rectangle of a depth over its contact edge's length."""
    layers = mesh.contact_elements * slenderness
    if mesh.growth > 1.0:
        # a layer of size dx growth^k has n / growth^k elements side by side
        layers = min(layers, mesh.growth / (mesh.growth - 1.0))
    return 2.0 * mesh.contact_elements * layers


def check_elements(mesh: MeshOptions, body: Body, edge: str) -> None:
    """Check a rectangle's depth below its contact edge against the size of its elements."""
    flat = edge in HORIZONTAL
    depth, length = (body.height, body.width) if flat else (body.width, body.height)
    size = length / mesh.contact_elements
    key = "height" if flat else "width"
    if depth < 0.01 * size:
        raise MeshMisfit(
            f"[body] {key}: {depth:g} is less than 0.01 of an element of the contact edge "
            f"({size:.3g}); enlarge it, or mesh.contact_elements"
        )
    if depth > 1e5 * length:
        raise InputError(
            f"[body] {key}: {depth:g} is more than 100000 times the contact edge's length; reduce "
            "it, material so far away has no effect"
        )
    cells = count_cells(mesh, depth / length)
    # estimated number of cells of a rectangle above which no machine can mesh and factor it
    if cells > 1e8:
        raise InputError(
            f"[mesh] growth: {mesh.growth:g} makes about {cells:.0e} cells; "
            "enlarge it, or use fewer contact_elements"
        )


def check_touching(scene: Scene) -> None:
    """Check that there are contacts, and that every body is in one of them or in a tie."""
    if not scene.contacts:
        raise InputError("[contact]: the scene has none; add one")
    edges = [edge for joint in scene.joints for edge in (joint.edge, joint.against) if edge]
    touching = [scene.find_edge(edge)[0] for edge in edges]
    for body in scene.bodies:
        if body not in touching:
            raise InputError(
                f"body '{body.name}': touches nothing; name one of its edges in a [[contact]], or "
                "bond it by a [[tie]]"
            )


def check_sides(scene: Scene, number: int) -> None:
    """Check the edges of a contact or tie, its span, and which side is the slave."""
    joint, where = scene.joints[number], scene.joint_labels[number]
    surfaces = HORIZONTAL if number < len(scene.contacts) else ()
    check_edge(scene, joint.edge, f"{where} edge", surfaces)
    if joint.against is not None:
        check_edge(scene, joint.against, f"{where} against", surfaces)
        if not scene.others:
            raise InputError(
                f"{where} against: the scene has one body only; add a second [[body]], or remove "
                "against for a rigid plane"
            )
        if scene.find_edge(joint.against)[0] == scene.find_edge(joint.edge)[0]:
            raise InputError(f"{where} against: must name an edge of another body")
    elif joint.slave is not None:
        raise InputError(f"{where} slave: a rigid plane has no nodes; remove it, or give against")
    check_span(scene, joint.edge, joint.span, f"{where} span")


def check_contact(scene: Scene, number: int) -> None:
    """Check friction, gap and interference of a contact."""
    contact, where = scene.contacts[number], scene.joint_labels[number]
    meshed = has_mesh_file(scene, contact.edge)
    forward, backward = directions(contact.friction, f"{where} friction")
    profiles = [(forward, "friction"), (contact.initial_gap, "initial_gap")]
    for key in ("shear_limit", "cohesion"):
        if (given := getattr(contact, key)) is not None:
            profiles.append((given, key))
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

    ``of_half_plane`` are the names that a half-plane's edge may have here.
    """
    try:
        body, name = scene.find_edge(edge)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if body.mesh is not None:
        return
    choices = of_half_plane if body.is_half_plane else EDGES
    if not choices:
        raise InputError(f"{where}: a half-plane cannot be tied; use a large rectangle")
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
        # change of slope of a table, over its largest slope, that is a kink and not round-off
        kinks = np.abs(np.diff(slope)) > 1e-6 * np.abs(slope).max(initial=0.0)
        inside = (x[1:-1] > nodes[0]) & (x[1:-1] < nodes[-1])
        apart = float(np.median(np.diff(x)))
        spacing = float(nodes[1] - nodes[0])
        # number of kinks of a table from which it is taken for samples of a curve
        # distance of a table's points, over that of the nodes, above which the mesh resolves its
        # kinks. A parabola of 51 points on 161 nodes has peaks of 4 % of the largest pressure, one
        # of 201 points 0.2 %
        if np.count_nonzero(kinks & inside) >= 6 and apart > 1.5 * spacing:
            lines.append(
                f"{scene.joint_labels[i]} initial_gap: the table is linear between points "
                f"{apart:.3g} apart, nodes are {spacing:.3g} apart: its kinks give peaks of "
                "pressure; use more points or an expression"
            )
    return lines
