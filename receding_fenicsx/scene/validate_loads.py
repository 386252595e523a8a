"""Rules of loads, supports, springs, bolts and points; see ``validate_bodies``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import hypot

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import checks, symmetry
from receding_fenicsx.scene.model import FREE, Body, Bolt, Load, Scene, Spring, Support
from receding_fenicsx.scene.options import INTERFERENCE, KINDS
from receding_fenicsx.scene.profiles import check_table, evaluate_checked
from receding_fenicsx.scene.validate_bodies import has_mesh_file, of_edge, of_span, on_contact


def of_load(scene: Scene, load: Load) -> checks.Rules:
    """A load acts outside the contact, on what a body has, and is not zero."""
    at = load.label
    kinds = [kind for kind in KINDS if checks.is_given(load, kind)]
    if load.on_body:
        yield from _of_body_load(scene, load, kinds)
        return
    if not load.edge:
        yield f"{at}: the key 'edge' is missing; add it"
    if load.body is not None:
        yield f"{at} body: is for body_force and thermal_strain; write BODY.EDGE"
    surfaces = symmetry.HORIZONTAL if load.gap is not None else ("far",)
    yield from of_edge(scene, load.edge, f"{at} edge", surfaces)
    yield from of_span(scene, load.edge, None if load.travel else load.span, f"{at} span")
    yield from checks.one_of(load, at, KINDS)
    kind, travels = kinds[0], len(load.travel) > 1
    value, key = getattr(load, kind), f"{at} {kind}"
    if load.steps and not travels:
        yield f"{at} steps: are those of its travel; remove them, or give travel"
    if load.travel and kind not in ("pressure", "traction"):
        yield f"{at} travel: is for a pressure or a traction, not {kind}; remove it"
    if travels and not load.steps and not load.span:
        yield f"{at} steps: are needed to travel without a span; give them"
    if any(a == b for a, b in pairwise(load.travel)):
        yield f"{at} travel: stays at a position; write each once"
    if travels and len(load.units) > 1000:  # each costs a solve with the bulk
        yield f"{at} travel: {len(load.units)} unit loads, 1000 are the most; shorten it"
    far = scene.find_edge(load.edge)[0].is_half_plane
    if load.tension is not None and not far:
        yield f"{at} tension: acts on the far field of a half-plane; use traction"
    if load.force is not None and not load.platen and not far:
        yield f"{at} force: acts on a platen only; add platen = true, or use traction"
    if load.platen and kind not in ("force", "displacement"):
        yield f"{at} platen: needs force or displacement, not {kind}; give one of them"
    if scene.axisymmetric and load.platen and value[0] not in (0.0, FREE):
        yield f"{key}: a platen of revolution moves along its axis only; write [0.0, {value[1]}]"
    if load.gap is not None:
        edges = [contact.edge for contact in scene.contacts]
        checks.check_known(load.edge, edges, f"{at} edge", "edge of a [[contact]]")
        for contact in (contact for contact in scene.contacts if contact.edge == load.edge):
            on_contact(scene, contact, load.gap, key, load.span)
        return
    parts = [part for part in (value if isinstance(value, tuple) else (value,)) if part != FREE]
    if far:
        if kind not in ("force", "displacement", "tension"):
            yield f"{key}: the far field of a half-plane takes force, displacement or tension"
        if any(not isinstance(part, float | int) for part in parts):
            yield f"{key}: the far field moves as a whole; write numbers"
        if not any(abs(part) >= checks.SMALLEST for part in parts):
            yield f"{key}: is zero; give it a value or remove the load"
        return
    yield from _off_contact(scene, load, at)
    for part in parts:
        check_table(part, key)
    if has_mesh_file(scene, load.edge):
        return
    along = symmetry.load_samples(scene, load)
    x, y = symmetry.edge_points(scene, load.edge, along)
    # a table is a function of the position along the edge, an expression of x and y
    points = (along if isinstance(part, dict) else x for part in parts)
    values = [evaluate_checked(p, at_, y, key) for p, at_ in zip(parts, points, strict=True)]
    if np.abs(values).max(initial=0.0) < checks.SMALLEST:
        yield f"{key}: is zero everywhere; give it a value or remove the load"


def _off_contact(scene: Scene, load: Load, at: str) -> checks.Rules:
    """A load on a rectangle is off the contact."""
    span = None if load.travel else load.span
    for joint, label in zip(scene.joints, scene.joint_labels, strict=True):
        on = not has_mesh_file(scene, load.edge)
        on &= scene.find_edge(load.edge) == scene.find_edge(joint.edge)
        if on and _overlap(scene, load.edge, span, joint.span):
            yield f'{at}: overlaps {label} on "{load.edge}"; use another edge, or a span beside it'


def _overlap(scene: Scene, edge: str, *spans: tuple[float, float] | None) -> bool:
    """Return whether spans of an edge, None for all of it, share more than round-off."""
    low, high = -np.inf, np.inf  # those of a mesh file are not known yet
    if not (has_mesh_file(scene, edge) or scene.find_edge(edge)[0].is_half_plane):
        low, high = symmetry.edge_range(scene, edge)
    begins, ends = zip(*(span or (low, high) for span in spans), strict=True)
    return bool(min(ends) - max(begins) > (1e-9 * (high - low) if high < np.inf else 0.0))


def _of_body_load(scene: Scene, load: Load, kinds: list[str]) -> checks.Rules:
    """A body force or thermal strain: its body, and that its profile is finite, not zero."""
    kind = kinds[-1]
    at, key = load.label, f"{load.label} {kind}"
    of_edges = ("edge", "span", "platen", "travel", "steps")
    others = (*of_edges, *(other for other in KINDS if other != kind))
    yield from checks.unused(load, at, True, others, f"{kind} acts on a whole body")
    if load.mode is not None:
        yield from of_modes(scene, at)
        return
    body = body_named(scene, load.body, at, "load")
    if body.is_half_plane:
        yield f"{key}: a half-plane has no mesh to act on; give it a shape"
    value = getattr(load, kind)
    parts = value if isinstance(value, tuple) else (value,)
    if any(isinstance(part, dict) for part in parts):
        yield f"{key}: a table runs along an edge; write an expression in x, y"
    if body.mesh is None:  # else its points are known when it is meshed
        x, y = symmetry.body_points(scene, body)
        if np.abs([evaluate_checked(part, x, y, key) for part in parts]).max() < checks.SMALLEST:
            yield f"{key}: is zero everywhere; give it a value or remove the load"


def of_modes(scene: Scene, at: str) -> checks.Rules:
    """The bodies have vibration modes."""
    if any(body.is_half_plane for body in scene.bodies):
        yield f"{at}: half-planes have no vibration modes; use bodies with a mesh"
    if any(bolt.stiffness is None for bolt in scene.bolts):
        yield f"{at}: vibration modes need elastic bolts; give them a stiffness"
    own = [m for b in scene.bodies for m in (scene.material_of(b), *scene.surface_materials(b))]
    if any(material.density <= 0.0 for material in own):
        yield "[material] density: vibration modes need one of every body; give it"


def of_names(scene: Scene) -> checks.Rules:
    """Names of loads and bolts, which are those of the load factors."""
    if not scene.load_names:
        yield "[[load]]: the scene has none; add one"
    taken: list[str] = []
    modes = {load.name for load in scene.loads if load.mode is not None}
    names = [("load", name) for name in scene.driven_names]
    for table, name in (*names, *(("bolt", bolt.name) for bolt in scene.bolts)):
        checks.check_name(name, f"[[{table}]] name")
        # of the contacts' interference, of vibration modes, of springs between bodies
        mode = name.startswith("mode:") and name not in modes
        if name == INTERFERENCE or mode or name.startswith("[[spring]] "):
            yield f"{table} '{name}': the name is reserved; rename the {table}"
        if name in taken:
            yield f"bolt '{name}': a load or another bolt has this name; rename the bolt"
        taken.append(name)


def of_parts(scene: Scene) -> checks.Rules:
    """Two parts of one load are both forces or both displacements, and not the same part."""
    for k, b in enumerate(scene.loads):
        for a in (other for other in scene.loads[:k] if other.name == b.name):
            if a.is_prescribed != b.is_prescribed:
                forced, moved = (a, b) if b.is_prescribed else (b, a)
                on = f'a force on "{forced.edge or "a body"}" and a displacement on "{moved.edge}"'
                yield f"{a.label}: is {on}; give them two names"
            kind, other = (next(k for k in KINDS if checks.is_given(part, k)) for part in (a, b))
            if kind == other and a.on_body and a.body == b.body:
                yield f"{a.label}: has two of {kind} on one body; add them"
            if kind != other or a.on_body or scene.find_edge(a.edge) != scene.find_edge(b.edge):
                continue
            if _overlap(scene, a.edge, a.span, b.span):
                yield f'{a.label}: has two of {kind} on one part of "{a.edge}"; add or rename them'


def of_effect(scene: Scene, load: Load) -> checks.Rules:
    """Supports do not hold the edge of a force in its direction: it would have no effect."""
    kind = next(kind for kind in KINDS if checks.is_given(load, kind))
    if load.on_body or kind in ("tension", "gap", "displacement"):
        return
    acts = _normal(scene, load.edge)
    if kind != "pressure":
        value = getattr(load, kind)
        acts = {axis for axis, part in zip("xy", value, strict=True) if part != 0.0}
    if acts and acts <= _held(scene, load.edge, scene.supports):
        yield f'{load.label} edge: a support holds "{load.edge}" in its direction; use another one'


def _held(scene: Scene, edge: str, supports: Sequence[Support]) -> set[str]:
    """Return the directions in which supports hold the whole of an edge."""
    on = [s for s in supports if s.edge and scene.find_edge(s.edge) == scene.find_edge(edge)]
    return {axis for support in on for axis in support.fix}


def _normal(scene: Scene, edge: str) -> set[str]:
    """Return the direction of an edge's normal; both where it is not known before meshing."""
    if has_mesh_file(scene, edge):
        return {"x", "y"}
    return {"y" if symmetry.is_horizontal(scene, edge) else "x"}


def of_bolt(scene: Scene, bolt: Bolt) -> checks.Rules:
    """The direction, preload and patches of a bolt."""
    at = f"bolt '{bolt.name}'"
    if not hypot(*bolt.axis) > 0.0:
        yield f"{at} axis: has no direction; give [x, y] from head to nut"
    if scene.axisymmetric and bolt.axis[0] != 0.0:
        yield f"{at} axis: of a ring of bolts it is [0, 1] or [0, -1]"
    if not bolt.tightening:
        yield from checks.one_of(bolt, at, ("preload", "shortening"))
    elif None in (bolt.preload, bolt.shortening) or len(bolt.tightening) != len(scene.preloads):
        yield f"{at} tightening: is found from the preload; remove it"
    if bolt.shortening is not None and not bolt.tightening and bolt.shortening < checks.SMALLEST:
        yield f"{at} shortening: must be positive, not {bolt.shortening:g}"
    for patch, key in zip(bolt.patches, ("head", "nut"), strict=True):
        yield from of_edge(scene, patch.edge, f"{at} {key}", ())
        yield from of_span(scene, patch.edge, patch.span, f"{at} {key}_span")
        yield from _off_contact(scene, patch, f"{at} {key}")


def _numbered(label: str, part: object, parts: Sequence[object]) -> str:
    return f"{label} number {parts.index(part) + 1}" if len(parts) > 1 else label


def of_support(scene: Scene, support: Support) -> checks.Rules:
    """A support holds an edge off the contact, or a point of a body."""
    at = _numbered("[[support]]", support, scene.supports)
    yield from checks.one_of(support, at, ("edge", "point"))
    if support.edge is None:
        yield from _of_point(scene, support, at)
        return
    yield from checks.unused(support, at, True, ("body",), "is not for an edge")
    yield from of_edge(scene, support.edge, f"{at} edge")
    edge = scene.find_edge(support.edge)
    others = [other for other in scene.supports if other is not support]
    if {*support.fix} <= _held(scene, support.edge, others):
        yield f'{at}: another one holds "{support.edge}" in this direction; remove one'
    if any(scene.find_edge(c.edge) == edge and c.span is None for c in scene.joints):
        yield f'{at} edge: "{support.edge}" is a contact edge or tied; use another edge'


def of_spring(scene: Scene, spring: Spring) -> checks.Rules:
    """Where a spring acts, and that its stiffness is positive."""
    at, keys = _numbered(spring.label, spring, scene.springs), ("normal", "tangential")
    of_point = ("x", "y")
    yield from checks.one_of(spring, at, ("edge", "point"))
    if spring.edge:
        yield from checks.unused(spring, at, True, ("body", *of_point), "is not for an edge")
        yield from of_edge(scene, spring.edge, f"{at} edge", ())
        yield from of_span(scene, spring.edge, spring.span, f"{at} span")
    else:
        yield from checks.unused(spring, at, True, ("span", "against", *keys), "is not for a point")
        yield from _of_point(scene, spring, at)
        keys = of_point
    if spring.against is not None:
        yield from of_edge(scene, spring.against, f"{at} against", ())
        if scene.find_edge(spring.edge)[0] == scene.find_edge(spring.against)[0]:
            yield f"{at} against: must be an edge of another body"
    if max(getattr(spring, key) for key in keys) < checks.SMALLEST:
        yield f"{at}: has no stiffness; give {keys[0]}, {keys[1]} or both"
    if spring.edge and spring.against is None:
        normal = _normal(scene, spring.edge)
        acts = {k for k in "xy" if getattr(spring, "normal" if k in normal else "tangential")}
        if acts and acts <= _held(scene, spring.edge, scene.supports):
            yield f'{at}: a support holds "{spring.edge}" in its direction; remove it'


def _of_point(scene: Scene, part: Support | Spring, at: str) -> checks.Rules:
    """The point of a support or spring lies on its body."""
    body = body_named(scene, part.body, at)
    if body.is_half_plane:
        yield f'{at} point: hold the edge "far" of a half-plane instead'
    if body.mesh is None:
        if not isinstance(part.point, tuple):
            yield f"{at} point: a rectangle has no named points; write [x, y]"
        else:
            yield from of_place(scene, body, part.point, f"{at} point")
            # a support there, unlike a spring, acts as it would without the edge's
            acts = {k for k in "xy" if isinstance(part, Spring) and getattr(part, k)}
            for other in (s for s in scene.supports if s.edge and acts and acts <= {*s.fix}):
                owner, line = scene.find_edge(other.edge or "")
                x, y = symmetry.edge_points(scene, other.edge or "", 0.0)
                near = y == part.point[1] if line in symmetry.HORIZONTAL else x == part.point[0]
                if owner == body and near:
                    yield f'{at} point: a support holds "{other.edge}" in its direction; remove it'


def body_named(scene: Scene, name: str | None, where: str, what: str = "point") -> Body:
    """Return the body that a point or load names; a name is for scenes of several bodies only."""
    names = [body.name for body in scene.bodies]
    if (name is None) == bool(scene.others) or name not in (None, *names):
        needed = f"must name the body of the {what}; give one of {', '.join(names)}"
        only = "the scene has one body only; remove it"
        raise InputError(f"{where} body: {needed if scene.others else only}")
    return scene.bodies[names.index(name) if name is not None else 0]


def of_place(scene: Scene, body: Body, point: tuple[float, ...], at: str) -> checks.Rules:
    """A point lies on a rectangle; its side of a half-plane is checked where nodes are known."""
    if not body.is_rectangle:
        return
    x, y = point
    left, right = (body.position[0] + side * body.width for side in (-0.5, 0.5))
    low, high = (body.position[1] + part for part in (0.0, body.height))
    left = 0.0 if symmetry.is_cylinder(scene, body) else left
    slack = 1e-9 * max(body.width, body.height)  # round-off
    if not (left - slack <= x <= right + slack and low - slack <= y <= high + slack):
        body_is = f"{left:g} <= x <= {right:g}, {low:g} <= y <= {high:g}"
        yield f"{at}: ({x:g}, {y:g}) lies outside the body, {body_is}; move it"
