"""Checks of a scene's meaning.

Every message is one line: the table and key, what is wrong, what to do.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import (
    EDGES,
    FREE,
    HORIZONTAL,
    Contact,
    Load,
    Profile,
    Scene,
    Support,
    edge_points,
    edge_range,
    evaluate,
    is_cylinder,
)
from receding_fenicsx.scene.validate_bodies import (
    SMALLEST,
    check_bodies,
    check_choice,
    check_count,
    check_elements,
    check_mesh,
    check_positive,
    check_size,
)

if TYPE_CHECKING:
    from receding_fenicsx.scene.history import History

Array = NDArray[np.float64]

LENGTH_TOLERANCE = 1e-9
"""Positions closer than this, over the edge's length, are the same."""
MOST_STEPS = 1_000_000
"""Load steps or samples of a leg at most."""
MOST_BYTES = 1e12
"""Size of the largest record."""
BYTES_OF_A_NODE = 50
"""Bytes of one node at one instant of a record: v, w, P, Q, p, q and the state."""
DEFAULT_CYCLES = 5
"""Cycles that are sampled when the scene names none."""
LOAD_SAMPLES = 401
"""Points along an edge at which load profiles are looked at (odd: one lies at the centre)."""

TABLE = {"others": "body", "materials": "material", "contacts": "contact", "supports": "support"}
"""The table of a scene file that a scene's attribute of another name holds."""


def validate(scene: Scene) -> None:
    """Check that a scene can be modelled.

    Args:
        scene: the scene.

    Raises:
        InputError: a value has no meaning, contradicts another one, or asks for what is not
            available.
    """
    if not isinstance(scene, Scene):
        kind = type(scene).__name__
        raise InputError(f'a scene is needed, as read_scene("block.toml") returns it, not a {kind}')
    _check_finite(scene, "scene")
    check_bodies(scene)
    check_mesh(scene)
    _check_contacts(scene)
    for load in scene.loads:
        _check_load(scene, load)
    _check_load_names(scene)
    for support in scene.supports:
        _check_support(scene, support)
    for load in scene.loads:
        _check_carried(scene, load)
    _check_solver(scene)
    # the history's own checks are those of making it
    from receding_fenicsx.scene.history import from_scene

    history = from_scene(scene)
    if scene.history.initial_slip is not None:
        for contact in scene.contacts:
            if not _is_meshed(scene, contact.edge):
                x = contact_samples(scene, contact)
                _values(scene.history.initial_slip, x, None, "[history] initial_slip")
    _check_output(scene, history)


def contact_samples(scene: Scene, contact: Contact) -> Array:
    """Positions of the nodes that a contact edge will have, nominally equally spaced."""
    low, high = contact.span or edge_range(scene, contact.edge)
    n = scene.mesh.degree * scene.mesh.contact_elements
    return 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-1.0, 1.0, n + 1)


def load_samples(scene: Scene, load: Load) -> Array:
    """Positions along a load's span at which its profile is looked at."""
    low, high = load.span or edge_range(scene, load.edge)
    return 0.5 * (low + high) + 0.5 * (high - low) * np.linspace(-1.0, 1.0, LOAD_SAMPLES)


def is_horizontal(scene: Scene, edge: str) -> bool:
    """Whether an edge is the bottom or the top of a rectangle."""
    return scene.find_edge(edge)[1] in HORIZONTAL


def _is_meshed(scene: Scene, edge: str) -> bool:
    """Whether an edge is a group of a mesh file, which is looked at when it is read."""
    return scene.find_edge(edge)[0].mesh is not None


def _check_finite(value: object, where: str) -> None:
    """Refuse NaN and infinity, also in scenes made in Python, and numbers beyond all use."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f"{where}: must be a finite number, not {value}")
        check_size(value, where)
    if isinstance(value, dict):
        for key, item in value.items():
            _check_finite(item, f"{where}.{key}")
    elif isinstance(value, list | tuple):
        for item in value:
            _check_finite(item, where)
    elif hasattr(value, "__dataclass_fields__"):
        label = (
            f"load '{value.name}'" if isinstance(value, Load) else f"[{TABLE.get(where, where)}]"
        )
        for key in value.__dataclass_fields__:
            _check_finite(getattr(value, key), key if where == "scene" else f"{label} {key}")


def _check_contacts(scene: Scene) -> None:
    if not scene.contacts:
        raise InputError("[contact]: the scene has none; add one")
    first = scene.contacts[0].edge
    for i, contact in enumerate(scene.contacts):
        where = "[contact]" if len(scene.contacts) == 1 else f"[[contact]] number {i + 1}"
        _check_contact(scene, contact, where)
        if not scene.others:
            continue
        own, other = (scene.find_edge(e)[0] for e in (contact.edge, contact.against or first))
        if contact.against is None or own == other:
            raise InputError(
                f"{where} against: has to name an edge of the other body; a rigid plane beside two "
                "bodies is not available"
            )
        if own != scene.find_edge(first)[0]:
            raise InputError(
                f'{where} edge: lies on another body than "{first}"; exchange edge and against'
            )


def _check_contact(scene: Scene, contact: Contact, where: str) -> None:
    _check_edge(scene, contact.edge, f"{where} edge")
    if contact.against is not None:
        _check_edge(scene, contact.against, f"{where} against")
        if not scene.others:
            raise InputError(
                f"{where} against: the scene has one body only; add a second [[body]], or leave it "
                "out for a rigid plane"
            )
    meshed = _is_meshed(scene, contact.edge)
    if scene.axisymmetric and not (meshed or is_horizontal(scene, contact.edge)):
        raise InputError(
            f'{where} edge: "{contact.edge}" cannot touch a plane in an axisymmetric body; use '
            "bottom or top"
        )
    _check_span(scene, contact.edge, contact.span, f"{where} span")
    if meshed:
        return
    check_elements(scene.mesh, *scene.find_edge(contact.edge))
    x = contact_samples(scene, contact)
    for profile, key in ((contact.friction, "friction"), (contact.initial_gap, "initial_gap")):
        values = _values(profile, x, None, f"{where} {key}")
        if values.min() < 0.0:
            at = x[np.argmin(values)]
            raise InputError(
                f"{where} {key}: is {values.min():g} at x = {at:.6g}; it must not be negative"
            )


def _check_edge(scene: Scene, edge: str, where: str) -> None:
    try:
        body, name = scene.find_edge(edge)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if body.mesh is not None:
        return
    check_choice(name, EDGES, where)
    if is_cylinder(scene, body) and name == "left":
        raise InputError(
            f'{where}: "{edge}" is the axis r = 0 of the axisymmetric body, which is held by '
            "itself; use another edge"
        )


def _check_span(scene: Scene, edge: str, span: tuple[float, float] | None, where: str) -> None:
    if span is None:
        return
    low, high = span if _is_meshed(scene, edge) else edge_range(scene, edge)
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


def _values(profile: Profile, x: Array, y: Array | None, where: str) -> Array:
    """Values of a profile at its points, with the key put in front of any complaint."""
    if isinstance(profile, dict):
        table = np.asarray(profile["x"], dtype=float), np.asarray(profile["value"], dtype=float)
        if len(table[0]) != len(table[1]) or len(table[0]) < 2:
            raise InputError(
                f"{where}: a table needs two lists of equal length (at least 2), not "
                f"{len(table[0])} and {len(table[1])} values"
            )
        if np.any(np.diff(table[0]) <= 0.0):
            raise InputError(f"{where}: x of the table must increase from value to value; sort it")
    try:
        values = evaluate(profile, x, y)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    check_size(float(np.abs(values).max(initial=0.0)), where)
    return values


def _check_load(scene: Scene, load: Load) -> None:
    where = f"load '{load.name}'"
    _check_edge(scene, load.edge, f"{where} edge")
    _check_span(scene, load.edge, load.span, f"{where} span")
    kind = _load_kind(scene, load, where)
    if _is_meshed(scene, load.edge):
        return
    for contact in scene.contacts:
        if scene.find_edge(load.edge) == scene.find_edge(contact.edge):
            whole = edge_range(scene, load.edge)
            (a, b), (c, d) = load.span or whole, contact.span or whole
            if min(b, d) - max(a, c) > LENGTH_TOLERANCE * (whole[1] - whole[0]):
                raise InputError(
                    f'{where}: lies on the contact edge "{load.edge}" where the contact is; use '
                    "another edge, or a span beside the contact's"
                )
    along = load_samples(scene, load)
    x, y = edge_points(scene, load.edge, along)
    value = getattr(load, kind)
    key = f"{where} {kind}"
    zero = True
    for part in value if isinstance(value, tuple) else (value,):
        if part != FREE:
            # a table runs along the edge, an expression knows x and y
            values = _values(part, along if isinstance(part, dict) else x, y, key)
            zero = zero and bool(np.all(np.abs(values) < SMALLEST))
    if zero:
        raise InputError(f"{key}: is zero everywhere; give it a value or leave the load out")


def _check_carried(scene: Scene, load: Load) -> None:
    """Refuse a force on an edge that supports hold in its direction: nothing of it is felt."""
    kind = _load_kind(scene, load, f"load '{load.name}'")
    edge, value = scene.find_edge(load.edge), getattr(load, kind)
    on_edge = [s for s in scene.supports if s.edge and scene.find_edge(s.edge) == edge]
    held = {axis for support in on_edge for axis in support.fix}
    if kind == "pressure":
        # which way an edge of the user's own mesh faces is not known here
        normal = "y" if is_horizontal(scene, load.edge) else "x"
        acts = {"x", "y"} if edge[0].mesh is not None else {normal}
    else:
        acts = {axis for axis, part in zip("xy", value, strict=True) if part != 0.0}
    if kind != "displacement" and acts and acts <= held:
        raise InputError(
            f"load '{load.name}' edge: a support holds \"{load.edge}\" in the direction of the "
            f"{kind}, so nothing of it reaches the body; load or hold another edge"
        )


def _load_kind(scene: Scene, load: Load, where: str) -> str:
    """Return which of its four forms a load has."""
    known = ("pressure", "traction", "displacement", "force")
    kinds = [kind for kind in known if getattr(load, kind) is not None]
    if len(kinds) != 1:
        raise InputError(
            f"{where}: has {' and '.join(kinds) or 'none'} of {', '.join(known)}; give exactly one "
            "of them"
        )
    if load.force is not None and not load.platen:
        raise InputError(f"{where} force: belongs to a platen; add platen = true, or use traction")
    if load.platen and kinds[0] in ("pressure", "traction"):
        raise InputError(
            f"{where} platen: moves under force or displacement, not {kinds[0]}; give one of them"
        )
    if scene.axisymmetric and load.platen and getattr(load, kinds[0])[0] not in (0.0, FREE):
        raise InputError(
            f"{where} {kinds[0]}: a platen on a body of revolution moves along its axis only; "
            f"write [0.0, {getattr(load, kinds[0])[1]}]"
        )
    return kinds[0]


def _check_load_names(scene: Scene) -> None:
    if not scene.loads:
        raise InputError("[[load]]: the scene has none; add one")
    names = [(load.name, scene.find_edge(load.edge)[0].name) for load in scene.loads]
    for name, body in names:
        if not name.strip():
            raise InputError("[[load]] name: is empty; give the load a name")
        if not name.isprintable():
            raise InputError(
                f"[[load]] name: {name!r} holds a character that cannot be printed; leave it out"
            )
        count = names.count((name, body))
        if count > 1:
            raise InputError(
                f"load '{name}': {count} loads have this name; rename one (only parts on two "
                "bodies share a name)"
            )


def _check_support(scene: Scene, support: Support) -> None:
    where = "[[support]]"
    if sorted(support.fix) not in (["x"], ["y"], ["x", "y"]):
        raise InputError(f'{where} fix: "{support.fix}" is unknown; use one of x, y, xy')
    if (support.edge is None) == (support.point is None):
        have = "both" if support.edge is not None else "neither"
        raise InputError(f"{where}: has {have} of edge and point; give exactly one of them")
    if support.edge is not None:
        _check_edge(scene, support.edge, f"{where} edge")
        edge = scene.find_edge(support.edge)
        if any(scene.find_edge(c.edge) == edge and c.span is None for c in scene.contacts):
            raise InputError(
                f'{where} edge: "{support.edge}" is the contact edge; hold another one'
            )
        return
    names = [body.name for body in scene.bodies]
    if (support.body is None) == bool(scene.others) or support.body not in (None, *names):
        raise InputError(
            f"{where} body: says whose the point is; give one of {', '.join(names)}"
            if scene.others
            else f"{where} body: the scene has one body only; leave it out"
        )
    body = scene.bodies[names.index(support.body) if support.body is not None else 0]
    if body.mesh is not None:
        return
    if not isinstance(support.point, tuple):
        raise InputError(f"{where} point: a rectangle has no named points; write [x, y]")
    x, y = support.point
    left, right = (body.position[0] + side * body.width for side in (-0.5, 0.5))
    low, high = (body.position[1] + part for part in (0.0, body.height))
    if is_cylinder(scene, body):
        left = 0.0
    slack = LENGTH_TOLERANCE * max(body.width, body.height)
    if not (left - slack <= x <= right + slack and low - slack <= y <= high + slack):
        raise InputError(
            f"{where} point: ({x:g}, {y:g}) lies outside the body, which fills "
            f"{left:g} <= x <= {right:g}, {low:g} <= y <= {high:g}"
        )


def _check_solver(scene: Scene) -> None:
    solver = scene.solver
    check_choice(solver.method, ("gauss-seidel", "events"), "[solver] method")
    check_choice(solver.symmetry, ("auto", "none"), "[solver] symmetry")
    check_choice(solver.on_jump, ("stop", "static"), "[solver] on_jump")
    check_count(solver.steps_per_leg, MOST_STEPS, "[solver] steps_per_leg")
    for key in (
        "max_sweeps",
        "change_tolerance",
        "residual_tolerance",
        "steady_tolerance",
    ):
        check_positive(getattr(solver, key), f"[solver] {key}")
    for key in ("change_tolerance", "residual_tolerance", "steady_tolerance"):
        if getattr(solver, key) >= 1.0:
            raise InputError(f"[solver] {key}: is relative, so it must be below 1")
    if not 0.0 < solver.over_relaxation < 2.0:
        raise InputError(
            f"[solver] over_relaxation: must lie between 0 and 2, not {solver.over_relaxation:g}; "
            "1 is none, 1.5 often fastest"
        )


def _check_output(scene: Scene, history: History) -> None:
    output = scene.output
    check_count(output.samples_per_leg, MOST_STEPS, "[output] samples_per_leg")
    check_positive(output.checkpoint_cycles, "[output] checkpoint_cycles")
    if isinstance(output.cycles, tuple):
        for number in output.cycles:
            if not 0 <= number <= history.cycles:
                raise InputError(
                    f"[output] cycles: cycle {number} does not occur; the history has cycles 0 to "
                    f"{history.cycles}"
                )
    _check_record_size(scene, history)


def _check_record_size(scene: Scene, history: History) -> None:
    """Refuse a record that no machine holds."""
    output, legs = scene.output, max(len(history.loop) - 1, 1)
    # a run until it is steady ends long before
    cycles = 0 if history.until_steady else history.cycles
    kept = min(DEFAULT_CYCLES, cycles + 1)
    if output.cycles is not None:
        kept = len(output.cycles) if isinstance(output.cycles, tuple) else cycles + 1
    nodes = scene.mesh.degree * scene.mesh.contact_elements + 1
    each = legs * nodes * BYTES_OF_A_NODE
    for key, count, advice in (
        ("[history] cycles", cycles, "use fewer"),
        (
            "[output] samples_per_leg",
            kept * output.samples_per_leg,
            "use fewer, or sample fewer cycles by output.cycles",
        ),
    ):
        if count * each > MOST_BYTES:
            raise InputError(f"{key}: asks for a record of {count * each / 1e9:.0f} GB; {advice}")
