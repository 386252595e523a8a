"""Validation of loads, supports, springs and bolts."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import SMALLEST, check_name, check_positive, unknown_name
from receding_fenicsx.scene.model import (
    FREE,
    INTERFERENCE,
    Body,
    Bolt,
    Load,
    Scene,
    Spring,
    Support,
)
from receding_fenicsx.scene.options import KINDS, MOST_UNITS, ON_BODY
from receding_fenicsx.scene.profiles import check_table, evaluate_checked
from receding_fenicsx.scene.symmetry import (
    HORIZONTAL,
    body_points,
    contact_samples,
    edge_points,
    edge_range,
    is_cylinder,
    is_horizontal,
    load_samples,
)
from receding_fenicsx.scene.validate_bodies import (
    FAR,
    LENGTH_TOLERANCE,
    check_edge,
    check_span,
    has_mesh_file,
)


def check_load(load: Load, scene: Scene) -> None:
    """Check that a load acts outside the contact, on what a body has, and is not zero."""
    where = f"load '{load.name}'"
    if load.on_body:
        _check_body_load(scene, load, where)
        return
    if not load.edge:
        raise InputError(f"{where}: the key 'edge' is missing; add it")
    if load.body is not None:
        raise InputError(f"{where} body: is for body_force and thermal_strain; write BODY.EDGE")
    on_contact = HORIZONTAL if load.gap is not None else (FAR,)
    check_edge(scene, load.edge, f"{where} edge", on_contact)
    if not load.travel:
        check_span(scene, load.edge, load.span, f"{where} span")
    _check_kind(scene, load, where)
    kind = _kinds(load)[0]
    if load.gap is not None:
        _check_gap(load, scene, where)
        return
    if scene.find_edge(load.edge)[0].is_half_plane:
        _check_far_load(load, kind, where)
        return
    _check_off_contact(scene, load, where)
    value, key = getattr(load, kind), f"{where} {kind}"
    parts = value if isinstance(value, tuple) else (value,)
    for part in parts:
        check_table(part, key)
    if has_mesh_file(scene, load.edge):
        return
    along = load_samples(scene, load)
    x, y = edge_points(scene, load.edge, along)
    zero = True
    for part in parts:
        if part != FREE:
            # a table is a function of the position along the edge, an expression of x and y
            points = along if isinstance(part, dict) else x
            values = evaluate_checked(part, points, y, key)
            zero = zero and bool(np.all(np.abs(values) < SMALLEST))
    if zero:
        raise InputError(f"{key}: is zero everywhere; give it a value or remove the load")


def _check_gap(load: Load, scene: Scene, where: str) -> None:
    """Check that a gap is on a contact edge, and finite there."""
    on = [contact for contact in scene.contacts if contact.edge == load.edge]
    if not on:
        edges = [contact.edge for contact in scene.contacts]
        unknown_name(load.edge, edges, f"{where} edge", "edge of a [[contact]]")
    gap = load.gap or 0.0
    check_table(gap, f"{where} gap")
    for contact in on:
        if not has_mesh_file(scene, load.edge):
            evaluate_checked(gap, contact_samples(scene, contact), None, f"{where} gap")


def _check_off_contact(scene: Scene, load: Load, where: str) -> None:
    """Check that a load on a rectangle is off the contact."""
    if has_mesh_file(scene, load.edge):
        return
    for joint, label in zip(scene.joints, scene.joint_labels, strict=True):
        if scene.find_edge(load.edge) == scene.find_edge(joint.edge):
            whole = edge_range(scene, load.edge)
            (a, b), (c, d) = (not load.travel and load.span) or whole, joint.span or whole
            if min(b, d) - max(a, c) > LENGTH_TOLERANCE * (whole[1] - whole[0]):
                what = "contact" if "contact" in label else "tie"
                raise InputError(
                    f'{where}: overlaps the {what} on the {what} edge "{load.edge}"; use another '
                    f"edge, or a span outside the {what}'s"
                )


def check_bolt(bolt: Bolt, scene: Scene) -> None:
    """Check the direction, preload and patches of a bolt."""
    where = f"bolt '{bolt.name}'"
    if not hypot(*bolt.axis) > 0.0:
        raise InputError(f"{where} axis: has no direction; give [x, y] from head to nut")
    if scene.axisymmetric and bolt.axis[0] != 0.0:
        raise InputError(f"{where} axis: of a ring of bolts it is [0, 1] or [0, -1]")
    if bolt.tightening:
        legs = len(scene.preloads)
        if bolt.preload is None or bolt.shortening is None or len(bolt.tightening) != legs:
            raise InputError(f"{where} tightening: is found from the preload; remove it")
    elif (bolt.shortening is None) == (bolt.preload is None):
        raise InputError(f"{where}: give exactly one of preload and shortening")
    elif bolt.shortening is not None:
        check_positive(bolt.shortening, f"{where} shortening")
    for patch, key in zip(bolt.patches, ("head", "nut"), strict=True):
        check_edge(scene, patch.edge, f"{where} {key}", ())
        check_span(scene, patch.edge, patch.span, f"{where} {key}_span")
        _check_off_contact(scene, patch, f"{where} {key}")


def _kinds(load: Load) -> list[str]:
    """Return which of pressure, traction, displacement and force are given."""
    return [kind for kind in KINDS if getattr(load, kind) is not None]


def _check_kind(scene: Scene, load: Load, where: str) -> None:
    """Check that a load has exactly one kind, and that its kind suits a platen."""
    kinds = _kinds(load)
    if len(kinds) != 1:
        raise InputError(
            f"{where}: has {' and '.join(kinds) or 'none'} of {', '.join(KINDS)}; give exactly one "
            "of them"
        )
    kind = kinds[0]
    if load.steps and len(load.travel) < 2:
        raise InputError(f"{where} steps: are those of its travel; remove them, or give travel")
    if load.travel and kind not in ("pressure", "traction"):
        raise InputError(f"{where} travel: is for a pressure or a traction, not {kind}; remove it")
    if len(load.travel) > 1:
        if not load.steps and not load.span:
            raise InputError(f"{where} steps: are needed to travel without a span; give them")
        if any(a == b for a, b in pairwise(load.travel)):
            raise InputError(f"{where} travel: stays at a position; write each once")
        if len(load.units) > MOST_UNITS:
            raise InputError(
                f"{where} travel: takes {len(load.units)} unit loads, {MOST_UNITS} are the most; "
                "shorten it, or give fewer steps"
            )
    far = scene.find_edge(load.edge)[0].is_half_plane
    if load.tension is not None and not far:
        raise InputError(f"{where} tension: acts on the far field of a half-plane; use traction")
    if load.force is not None and not load.platen and not far:
        raise InputError(
            f"{where} force: acts on a platen only; add platen = true, or use traction"
        )
    if load.platen and kind not in ("force", "displacement"):
        raise InputError(
            f"{where} platen: needs force or displacement, not {kind}; give one of them"
        )
    if scene.axisymmetric and load.platen and getattr(load, kind)[0] not in (0.0, FREE):
        raise InputError(
            f"{where} {kind}: a platen on a body of revolution moves along its axis only; "
            f"write [0.0, {getattr(load, kind)[1]}]"
        )


def _check_far_load(load: Load, kind: str, where: str) -> None:
    """Check a load on the far field: a force, a displacement or a tension, not zero."""
    if kind not in ("force", "displacement", "tension"):
        raise InputError(
            f"{where} {kind}: the far field of a half-plane takes a force, a displacement or a "
            "tension; use one of them"
        )
    value = getattr(load, kind)
    parts = [part for part in (value if kind != "tension" else (value,)) if part != FREE]
    if any(not isinstance(part, float | int) for part in parts):
        raise InputError(f"{where} {kind}: the far field moves as a whole; write numbers")
    if not any(abs(part) >= SMALLEST for part in parts):
        raise InputError(f"{where} {kind}: is zero; give it a value or remove the load")


def check_names(scene: Scene) -> None:
    """Check the names of loads and bolts, which are those of the load factors."""
    if not scene.load_names:
        raise InputError("[[load]]: the scene has none; add one")
    taken: list[str] = []
    modes = {load.name for load in scene.loads if load.mode is not None}
    names = [("load", name) for name in scene.driven_names]
    for table, name in (*names, *(("bolt", bolt.name) for bolt in scene.bolts)):
        check_name(name, f"[[{table}]] name")
        # of the contacts' interference, of vibration modes, of springs between bodies
        mode = name.startswith("mode:") and name not in modes
        if name == INTERFERENCE or mode or name.startswith("[[spring]] "):
            raise InputError(f"{table} '{name}': the name is reserved; rename the {table}")
        if name in taken:
            raise InputError(
                f"bolt '{name}': a load or another bolt has this name; rename the bolt"
            )
        taken.append(name)


def check_parts(scene: Scene) -> None:
    """Check the parts of each load, two at a time."""
    for k, load in enumerate(scene.loads):
        for other in scene.loads[:k]:
            if other.name == load.name:
                _check_pair(scene, other, load)


def _check_pair(scene: Scene, a: Load, b: Load) -> None:
    """Check two parts of one load: both forces or both displacements, and not the same part."""
    if a.is_prescribed != b.is_prescribed:
        forced, moved = (a, b) if b.is_prescribed else (b, a)
        raise InputError(
            f"load '{a.name}': is a force on \"{forced.edge or 'a body'}\" and a displacement on "
            f'"{moved.edge}"; give them two names'
        )
    if a.on_body or b.on_body:
        if _kinds(a) == _kinds(b) and a.body == b.body:
            raise InputError(f"load '{a.name}': has two of {_kinds(a)[0]} on one body; add them")
        return
    if scene.find_edge(a.edge) != scene.find_edge(b.edge) or _kinds(a) != _kinds(b):
        return
    if has_mesh_file(scene, a.edge) or scene.find_edge(a.edge)[0].is_half_plane:
        overlap = a.span is None or b.span is None or _overlap(a.span, b.span) > 0.0
    else:
        whole = edge_range(scene, a.edge)
        length = LENGTH_TOLERANCE * (whole[1] - whole[0])
        overlap = _overlap(a.span or whole, b.span or whole) > length
    if overlap:
        raise InputError(
            f"load '{a.name}': two of its parts are a {_kinds(a)[0]} on the same part of "
            f'"{a.edge}"; write them as one, or rename one'
        )


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the length that two spans share, negative where they are apart."""
    return min(a[1], b[1]) - max(a[0], b[0])


def check_support(support: Support, scene: Scene) -> None:
    """Check that a support holds an edge off the contact, or a point of a body."""
    several = f" number {scene.supports.index(support) + 1}" if len(scene.supports) > 1 else ""
    where = f"[[support]]{several}"
    if (support.edge is None) == (support.point is None):
        have = "both" if support.edge is not None else "neither"
        raise InputError(f"{where}: has {have} of edge and point; give exactly one of them")
    if support.edge is None:
        _check_point(scene, support, where)
        return
    check_edge(scene, support.edge, f"{where} edge")
    edge = scene.find_edge(support.edge)
    if any(scene.find_edge(c.edge) == edge and c.span is None for c in scene.joints):
        raise InputError(
            f'{where} edge: "{support.edge}" is a contact edge or tied; use another edge'
        )


def check_acts(load: Load, scene: Scene) -> None:
    """Refuse a force on an edge that supports hold in its direction: it has no effect."""
    if load.on_body:
        return
    (kind,) = _kinds(load)
    edge, value = scene.find_edge(load.edge), getattr(load, kind)
    on_edge = [s for s in scene.supports if s.edge and scene.find_edge(s.edge) == edge]
    held = {axis for support in on_edge for axis in support.fix}
    if kind in ("tension", "gap"):
        return
    if kind == "pressure":
        # the normal of an edge of a mesh file is not known before meshing
        normal = "y" if is_horizontal(scene, load.edge) else "x"
        acts = {"x", "y"} if edge[0].mesh is not None else {normal}
    else:
        acts = {axis for axis, part in zip("xy", value, strict=True) if part != 0.0}
    if kind != "displacement" and acts and acts <= held:
        raise InputError(
            f"load '{load.name}' edge: a support holds \"{load.edge}\" in the direction of the "
            f"{kind}, which has no effect; load or hold another edge"
        )


def _check_body_load(scene: Scene, load: Load, where: str) -> None:
    """Check a body force or thermal strain: its body, and that its profile is finite, not zero."""
    kind, *others = [kind for kind in ON_BODY if getattr(load, kind) is not None]
    on_edges = ("edge", "span", "platen", *(key for key in KINDS if key not in ON_BODY))
    given = [key for key in on_edges if getattr(load, key)] + others
    if given:
        raise InputError(f"{where}: {kind} acts on a whole body; remove {given[0]}")
    if load.mode is not None:
        check_modes(scene, where)
        return
    body = body_named(scene, load.body, where, "load")
    if body.is_half_plane:
        raise InputError(f"{where} {kind}: a half-plane has no mesh to act on; give it a shape")
    value = getattr(load, kind)
    parts = value if isinstance(value, tuple) else (value,)
    if any(isinstance(part, dict) for part in parts):
        raise InputError(f"{where} {kind}: a table runs along an edge; write an expression in x, y")
    if body.mesh is not None:
        # its points are known when it is meshed
        return
    x, y = body_points(scene, body)
    values = [evaluate_checked(part, x, y, f"{where} {kind}") for part in parts]
    if np.abs(values).max() < SMALLEST:
        raise InputError(f"{where} {kind}: is zero everywhere; give it a value or remove the load")


def check_modes(scene: Scene, where: str) -> None:
    """Check that the bodies of a scene have vibration modes."""
    if any(body.is_half_plane for body in scene.bodies):
        raise InputError(f"{where}: half-planes have no vibration modes; use bodies with a mesh")
    if any(bolt.stiffness is None for bolt in scene.bolts):
        raise InputError(f"{where}: vibration modes need elastic bolts; give them a stiffness")
    materials = [
        m for b in scene.bodies for m in (scene.material_of(b), *scene.surface_materials(b))
    ]
    if any(material.density <= 0.0 for material in materials):
        raise InputError("[material] density: vibration modes need one of every body; give it")


def body_named(scene: Scene, name: str | None, where: str, what: str = "point") -> Body:
    """Return the body that a point or load names; a name is for scenes of several bodies only."""
    names = [body.name for body in scene.bodies]
    if (name is None) == bool(scene.others) or name not in (None, *names):
        raise InputError(
            f"{where} body: must name the body of the {what}; give one of {', '.join(names)}"
            if scene.others
            else f"{where} body: the scene has one body only; remove it"
        )
    return scene.bodies[names.index(name) if name is not None else 0]


def check_spring(spring: Spring, scene: Scene) -> None:
    """Check where a spring acts, and that its stiffness is positive."""
    several = f" number {scene.springs.index(spring) + 1}" if len(scene.springs) > 1 else ""
    where = f"{spring.label}{several}"
    if bool(spring.edge) == (spring.point is not None):
        have = "both" if spring.edge else "neither"
        raise InputError(f"{where}: has {have} of edge and point; give exactly one of them")
    keys, excluded = ["normal", "tangential"], ["body", "x", "y"]
    if spring.point is not None:
        keys, excluded = ["x", "y"], ["span", "against", "normal", "tangential"]
    for key in excluded:
        if getattr(spring, key):
            what = "an edge" if spring.edge else "a point"
            raise InputError(f"{where} {key}: is not for {what}; give {' and '.join(keys)}")
    if spring.point is not None:
        _check_point(scene, spring, where)
    else:
        check_edge(scene, spring.edge, f"{where} edge", ())
        check_span(scene, spring.edge, spring.span, f"{where} span")
    if spring.against is not None:
        check_edge(scene, spring.against, f"{where} against", ())
        if scene.find_edge(spring.edge)[0] == scene.find_edge(spring.against)[0]:
            raise InputError(f"{where} against: must be an edge of another body")
    if max(getattr(spring, key) for key in keys) < SMALLEST:
        raise InputError(f"{where}: has no stiffness; give {keys[0]}, {keys[1]} or both")


def _check_point(scene: Scene, support: Support | Spring, where: str) -> None:
    """Check that the point of a support or spring lies on its body."""
    body = body_named(scene, support.body, where)
    if body.is_half_plane:
        raise InputError(f'{where} point: hold the edge "far" of a half-plane instead')
    if body.mesh is not None:
        return
    if not isinstance(support.point, tuple):
        raise InputError(f"{where} point: a rectangle has no named points; write [x, y]")
    check_inside(scene, body, support.point, f"{where} point")


def check_inside(scene: Scene, body: Body, point: tuple[float, ...], where: str) -> None:
    """Check that a point lies on a rectangle."""
    x, y = point
    if body.is_half_plane:
        # the side is checked where the nodes are known
        return
    left, right = (body.position[0] + side * body.width for side in (-0.5, 0.5))
    low, high = (body.position[1] + part for part in (0.0, body.height))
    if is_cylinder(scene, body):
        left = 0.0
    slack = LENGTH_TOLERANCE * max(body.width, body.height)
    if not (left - slack <= x <= right + slack and low - slack <= y <= high + slack):
        raise InputError(
            f"{where}: ({x:g}, {y:g}) lies outside the body, {left:g} <= x <= {right:g}, "
            f"{low:g} <= y <= {high:g}; move it"
        )
