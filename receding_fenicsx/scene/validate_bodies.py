"""Rules of bodies, materials, mesh options and contacts; see ``checks.broken``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import MeshMisfit
from receding_fenicsx.scene import model, symmetry
from receding_fenicsx.scene.checks import Pair, Rules, check_known, check_name, unused
from receding_fenicsx.scene.model import Body, Contact, Scene
from receding_fenicsx.scene.profiles import Profile, check_table, directions, evaluate_checked


def of_bodies(scene: Scene) -> Rules:
    """Names, shapes and materials of the bodies."""
    names = [body.name for body in scene.bodies]
    for name in names:
        if scene.others or name:
            check_name(name, "[[body]] name")
        if "." in name:
            yield f'[[body]] name: "{name}" holds a dot; remove it'
        if names.count(name) > 1:
            yield f"body '{name}': {names.count(name)} bodies have this name; rename one"
    for body in scene.bodies:
        at, position = scene.label(body), body.position
        none, only = "a body from a mesh file has none", 'belongs to shape = "half-plane"'
        yield from unused(body, at, body.mesh, model.RECTANGLE_KEYS, none)
        yield from unused(body, at, not body.mesh, ("surface", "parameters"), "needs a mesh file")
        yield from unused(body, at, body.is_half_plane, ("height",), "a half-plane has none")
        yield from unused(body, at, not body.is_half_plane, ("datum", "window"), only)
        if body.is_half_plane and body.datum is not None and not body.datum >= body.width:
            yield f"{at} datum: {body.datum:g} is less than the contact's width, {body.width:g}"
        # round-off grows with the position
        if body.is_rectangle and max(map(abs, position)) > 1e4 * min(body.width, body.height):
            yield f"{at} position: is more than 10000 times the body's smaller side from the origin"
    used = [scene.material_of(body) for body in scene.bodies]
    used += [material for body in scene.bodies for material in scene.surface_materials(body)]
    for material in scene.materials:
        if material not in used:
            yield f"[material.{material.name}]: no [[body]] or physical surface has this material"
    own = "each body has a [material.NAME] of its own"
    keys = [f.name for f in fields(scene.material) if f.name not in ("kinematics", "name")]
    yield from unused(scene.material, "[material]", scene.material not in used, keys, own)
    for m in used:
        at = f"[material.{m.name}]" if m.name else "[material]"
        if m.poisson >= 0.5 and m.kinematics != "plane stress":
            yield f"{at} poisson: must be below 0.5 in {m.kinematics}"
        if (m.young_2 is None) != (m.shear is None):
            yield f"{at}: an orthotropic material has both young_2 and shear; give both"
        yield from unused(m, at, m.young_2 is None, ("angle",), "an isotropic material has none")
        if m.young_2 is not None and m.kinematics != "plane stress":
            yield f"{at} young_2: orthotropic materials are for plane stress; use it as kinematics"
        if m.young_2 is not None and not m.poisson**2 < m.young / m.young_2:
            yield f"{at} poisson: its square must be below young / young_2, not {m.poisson**2:g}"
    if len({material.kinematics for material in used}) > 1:
        yield "[material] kinematics: differs between the bodies; use the same for all"
    for body in scene.bodies if scene.axisymmetric else ():
        x, width, low = body.position[0], body.width, body.position[0] - 0.5 * body.width
        # the smallest hole of a ring, over its width
        if body.is_rectangle and x != 0.0 and not low > 1e-6 * width:
            ring = f"makes a ring from r = {low:g} to {x + 0.5 * width:g}"
            yield f"{scene.label(body)} position: {ring}; move it, or put a cylinder at x = 0"


def of_half_planes(scene: Scene) -> Rules:
    """What half-planes touch: their contact edges, and the other body."""
    flat = [body for body in scene.bodies if body.is_half_plane]
    if not flat:
        return
    on_plane = any(joint.against is None for joint in scene.joints)
    if len(scene.bodies) > 2 or (scene.others and on_plane):
        yield f"{scene.label(flat[0])} shape: is not for a stack of bodies; use a large rectangle"
    if scene.axisymmetric:
        yield "[material] kinematics: a half-plane is not axisymmetric; use another one"
    edges = [edge for contact in scene.contacts for edge in (contact.edge, contact.against)]
    on = [scene.find_edge(edge) for edge in edges if edge]
    first = {scene.find_edge(c.edge)[0].name: k for k, c in enumerate(scene.contacts)}
    for body in flat:
        at = scene.label(body)
        if scene.material_of(body).young_2 is not None:
            yield f"{at} material: a half-plane is isotropic; use a large rectangle"
        if len({name for owner, name in on if owner == body}) > 1:
            yield f"{at}: has the surfaces bottom and top; use one of them"
        if not scene.others:
            continue
        if body.name in first if len(flat) == 1 else len(first) > 1:
            where = scene.joint_labels[first[body.name]]
            yield f"{where} edge: names the half-plane '{body.name}'; exchange edge and against"
        other = Body() if len(flat) == 1 else flat[0]
        whose = "its partner's mesh" if len(flat) == 1 else f"body '{other.name}'"
        for key in ("width", "position"):
            if getattr(body, key) != getattr(other, key):
                both = f"remove {key}, or give both half-planes the same"
                yield f"{at} {key}: the contact nodes are those of {whose}; {both}"
    if len(flat) == 2 and len({name for _, name in on}) == 1:
        yield f'[contact] against: both half-planes have "{on[0][1]}"; use "bottom" and "top"'


def of_mesh(scene: Scene) -> Rules:
    """The table [mesh]."""
    mesh, meshed = scene.mesh, [body.mesh is not None for body in scene.bodies]
    flat, graded = all(body.is_half_plane for body in scene.bodies), bool(mesh.refine)
    no = "half-planes have no cells"
    yield from unused(mesh, "[mesh]", flat, ("cell", "degree"), no)
    yield from unused(mesh, "[mesh]", flat and not graded, ("growth",), no)
    if mesh.contact_elements % 2 and not all(meshed):
        yield f"[mesh] contact_elements: {mesh.contact_elements} is odd; use an even number"
    if mesh.refinements and not any(meshed):
        yield "[mesh] refinements: is for bodies from mesh files; use more contact_elements"
    if mesh.refine and mesh.cell != "triangle":
        yield f'[mesh] refine: is for triangles; use cell = "triangle", not "{mesh.cell}"'
    for i, place in enumerate(mesh.places):
        yield from _of_refinement(scene, place, f"[mesh] refine entry {i + 1}", any(meshed))


def _of_refinement(scene: Scene, place: model.Refinement, at: str, meshed: bool) -> Rules:
    """One entry of refine; whether it lies on its edge is found when the body is meshed."""
    if place.at == "corners" and not meshed:
        yield f"{at} at: rectangles have no re-entrant corners; leave it out"
    if not isinstance(place.at, str) and place.span[0] > place.span[1]:
        yield f"{at} at: is empty; write [from, to]"
    if place.growth is None and scene.mesh.growth < 1.01:
        yield f"{at} growth: that of the mesh is {scene.mesh.growth:g}; give one of 1.01 to 3"
    edges = [contact.edge for contact in scene.contacts]
    if place.edge is not None:
        check_known(place.edge, edges, f"{at} edge", "contact edge")
    for edge in edges:
        if has_mesh_file(scene, edge) or place.edge not in (None, edge):
            continue
        low, high = symmetry.edge_range(scene, edge)
        slack = 1e-6 * (high - low)  # below it round-off counts
        if place.size < slack:
            yield f"{at} size: {place.size:g} is less than 1e-06 of the contact edge; enlarge it"
        for end in () if isinstance(place.at, str) else place.span:
            if not low - slack <= end <= high + slack:
                yield f"{at} at: {end:g} lies beyond the edge, from {low:g} to {high:g}; move it"


def count_cells(mesh: model.MeshOptions, slenderness: float) -> float:
    """Estimate the number of triangles of a rectangle of a depth over its contact edge's length."""
    layers = mesh.contact_elements * slenderness
    if mesh.growth > 1.0:
        # a layer of size dx growth^k has n / growth^k elements side by side
        layers = min(layers, mesh.growth / (mesh.growth - 1.0))
    return 2.0 * mesh.contact_elements * layers


def of_elements(mesh: model.MeshOptions, body: Body, edge: str) -> Rules:
    """A rectangle's depth below its contact edge against the size of its elements."""
    keys = ("height", "width") if edge in symmetry.HORIZONTAL else ("width", "height")
    depth, length = (getattr(body, key) for key in keys)
    size, cells = length / mesh.contact_elements, count_cells(mesh, depth / length)
    if depth < 0.01 * size:
        less = f"{depth:g} is less than 0.01 of an element of the contact edge ({size:.3g})"
        raise MeshMisfit(f"[body] {keys[0]}: {less}; enlarge it, or mesh.contact_elements")
    if depth > 1e5 * length:
        yield f"[body] {keys[0]}: {depth:g} is more than 100000 times the contact edge; reduce it"
    # above which no machine can mesh and factor it
    if cells > 1e8:
        yield f"[mesh] growth: {mesh.growth:g} makes about {cells:.0e} cells; enlarge it"


def of_touching(scene: Scene) -> Rules:
    """There are contacts, and every body is in one of them or in a tie."""
    if not scene.contacts:
        yield "[contact]: the scene has none; add one"
    edges = [edge for joint in scene.joints for edge in (joint.edge, joint.against) if edge]
    touching = [scene.find_edge(edge)[0] for edge in edges]
    for body in scene.bodies:
        if body not in touching:
            yield f"body '{body.name}': touches nothing; give it a [[contact]] or a [[tie]]"


def of_joint(scene: Scene, number: int) -> Rules:
    """The edges of a contact or tie, its span, and which side is the slave."""
    joint, at = scene.joints[number], scene.joint_labels[number]
    surfaces = symmetry.HORIZONTAL if number < len(scene.contacts) else ()
    yield from of_edge(scene, joint.edge, f"{at} edge", surfaces)
    if joint.against is not None:
        yield from of_edge(scene, joint.against, f"{at} against", surfaces)
        if not scene.others:
            yield f"{at} against: the scene has one body only; add a [[body]], or remove against"
        if scene.find_edge(joint.against)[0] == scene.find_edge(joint.edge)[0]:
            yield f"{at} against: must name an edge of another body"
    elif joint.slave is not None:
        yield f"{at} slave: a rigid plane has no nodes; remove it, or give against"
    yield from of_span(scene, joint.edge, joint.span, f"{at} span")


def on_contact(
    scene: Scene, contact: Contact, profile: Profile, at: str, span: Pair | None = None
) -> tuple[Array, Array]:
    """Return positions on a contact and a checked profile there; of a mesh file's a number only."""
    x, (low, high) = np.zeros(1), span or (-np.inf, np.inf)
    if not has_mesh_file(scene, contact.edge):
        x = symmetry.contact_samples(scene, contact)
        x = x[(x >= low) & (x <= high)]
    elif isinstance(profile, dict | str):
        check_table(profile, at)
        return x[:0], x[:0]
    return x, evaluate_checked(profile, x, None, at)


def of_contact(scene: Scene, number: int) -> Rules:
    """Friction, gap and interference of a contact."""
    contact, at = scene.contacts[number], scene.joint_labels[number]
    body, edge = scene.find_edge(contact.edge)
    forward, backward = directions(contact.friction, f"{at} friction")
    profiles = {"friction": forward, "friction backward": backward}
    keys = ("initial_gap", "shear_limit", "cohesion", "interference")
    profiles |= {key: p for key in keys if (p := getattr(contact, key)) is not None}
    if contact.interference is not None and not scene.others and body.is_half_plane:
        yield f"{at} interference: a half-plane moves as a whole; remove it"
    if body.is_rectangle:
        yield from of_elements(scene.mesh, body, edge)
    if (slip := scene.history.initial_slip) is not None:
        on_contact(scene, contact, slip, "[history] initial_slip")
    for key, profile in profiles.items():
        x, values = on_contact(scene, contact, profile, f"{at} {key}")
        if values.min(initial=0.0) < 0.0:
            least = f"is {values.min():g} at x = {x[np.argmin(values)]:.6g}"
            yield f"{at} {key}: {least}; must not be negative"


def of_edge(scene: Scene, edge: str, at: str, of_half_plane: Sequence[str] = ("far",)) -> Rules:
    """A body has the edge, a half-plane one of some; groups of a mesh file are checked later."""
    body, name = scene.find_edge(edge, f"{at}: ")
    choices = of_half_plane if body.is_half_plane else symmetry.EDGES
    if body.mesh is not None:
        return
    if not choices:
        yield f"{at}: a half-plane cannot be tied; use a large rectangle"
    if name not in choices:
        yield f'{at}: "{name}" is unknown; use one of {", ".join(choices)}'
    if symmetry.is_cylinder(scene, body) and name == "left":
        yield f'{at}: "{edge}" is the axis r = 0 of the axisymmetric body; use another edge'


def of_span(scene: Scene, edge: str, span: tuple[float, float] | None, at: str) -> Rules:
    """A span is an interval within its edge."""
    if span is None:
        return
    meshed = has_mesh_file(scene, edge)
    if scene.find_edge(edge)[1] == "far" and not meshed:
        yield f"{at}: the far field of a half-plane has no parts; remove span"
    low, high = span if meshed else symmetry.edge_range(scene, edge)
    slack, own = 1e-9 * abs(high - low), f"[{span[0]:g}, {span[1]:g}]"  # round-off
    if not span[1] - span[0] > slack:
        yield f"{at}: {own} is empty; write [lower end, upper end]"
    if span[0] < low - slack or span[1] > high + slack:
        yield f'{at}: {own} reaches beyond edge "{edge}", from {low:g} to {high:g}; shorten it'


def has_mesh_file(scene: Scene, edge: str) -> bool:
    """Return whether an edge is a group of a mesh file."""
    return scene.find_edge(edge)[0].mesh is not None


def gap_warnings(scene: Scene) -> list[str]:
    """Return one line for each table of a curved gap that is coarser than the contact nodes.

    The mesh then resolves its kinks, edges of the profile with peaks of pressure.
    """
    lines = []
    for i, contact in enumerate(scene.contacts):
        table = contact.initial_gap
        if not isinstance(table, dict) or has_mesh_file(scene, contact.edge):
            continue
        nodes = symmetry.contact_samples(scene, contact)
        x, gap = (np.asarray(table[key]) for key in ("x", "value"))
        slope = np.diff(gap) / np.diff(x)
        # smaller changes of slope are round-off
        kinks = np.abs(np.diff(slope)) > 1e-6 * np.abs(slope).max(initial=0.0)
        inside = (x[1:-1] > nodes[0]) & (x[1:-1] < nodes[-1])
        apart, spacing = float(np.median(np.diff(x))), float(nodes[1] - nodes[0])
        # six kinks are samples of a curve. A parabola of 51 points on 161 nodes has peaks of 4 %
        # of the largest pressure, one of 201 points 0.2 %
        if np.count_nonzero(kinks & inside) >= 6 and apart > 1.5 * spacing:
            far = f"the table is linear between points {apart:.3g} apart, nodes are {spacing:.3g}"
            kinks = "its kinks give peaks of pressure; use more points or an expression"
            lines.append(f"{scene.joint_labels[i]} initial_gap: {far} apart: {kinks}")
    return lines
