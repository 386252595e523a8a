"""Validation of a scene: errors for what cannot be modelled, warnings for what is inaccurate.

Types, ranges and choices of single values stand at the dataclasses of the scene. Here are the rules
between values, and in ``validate_bodies`` and ``validate_loads``.
"""

from __future__ import annotations

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import checks
from receding_fenicsx.scene import validate_bodies as bodies
from receding_fenicsx.scene import validate_loads as loads
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.scene.model import Probe, Scene, SolverOptions
from receding_fenicsx.scene.options import HEADLINE_NAMES
from receding_fenicsx.scene.toml_reader import check_values


def validate(scene: Scene) -> None:
    """Check that a scene can be modelled.

    Raises:
        InputError: a value has a wrong type or range, contradicts another one, or needs a feature
            that is not available; one line for each error that does not follow from another one.
    """
    if not isinstance(scene, Scene):
        kind = type(scene).__name__
        raise InputError(f'a scene is needed, as read_scene("block.toml") returns it, not a {kind}')
    check_values(scene)
    check_rules(scene)


def check_rules(scene: Scene) -> None:
    """Check the rules between the values of a scene whose types and ranges are right."""
    checks.refuse(checks.broken([bodies.of_bodies(scene)]))
    # what follows asks for the edges of contacts and ties
    checks.refuse(checks.broken(bodies.of_joint(scene, k) for k in range(len(scene.joints))))
    whole = (bodies.of_touching, bodies.of_mesh, bodies.of_half_planes)
    rules = [
        *(bodies.of_contact(scene, k) for k in range(len(scene.contacts))),
        *(rule(scene) for rule in (*whole, _of_probes, _of_shakedown, _of_accuracy)),
        *(loads.of_support(scene, support) for support in scene.supports),
        *(loads.of_spring(scene, spring) for spring in scene.springs),
        *([line] for line in _of_options(scene)),
        of_solver(scene.solver),
    ]
    # a load or bolt that is wrong may not be in the history yet
    of_loads = [loads.of_load(scene, load) for load in scene.loads]
    of_loads += [loads.of_bolt(scene, bolt) for bolt in scene.bolts]
    errors = checks.broken([loads.of_names(scene), *of_loads])
    errors = errors or checks.broken([loads.of_parts(scene)])
    acts = (loads.of_effect(scene, load) for load in scene.loads)
    errors = errors or checks.broken([*acts, _of_fatigue(scene), _of_record(scene)])
    checks.refuse([*checks.broken(rules), *errors])


def scene_warnings(scene: Scene) -> list[str]:
    """Return one line for each option that makes the results inaccurate without any error."""
    lines = []
    materials = (scene.material, *scene.materials)
    largest = max([m.poisson for m in materials if m.kinematics != "plane stress"], default=0.0)
    # Poisson's ratio above which elements of order 1 are too stiff. On the paper's block with 81
    # contact nodes, the error of their dissipation is 3 to 8 % at 0.49 and 11 to 30 % at 0.499;
    # that of order 2 is 1 %
    if scene.mesh.degree == 1 and largest > 0.45:
        lock = f"elements of order 1 lock near incompressibility (Poisson's ratio {largest:g})"
        lines.append(f"[mesh] degree: {lock}, which the residual does not show; use degree = 2")
    return lines + bodies.gap_warnings(scene)


def of_solver(solver: SolverOptions) -> checks.Rules:
    """The method finds the branch that is taken."""
    if solver.branch != "first" and solver.method != "events":
        yield '[solver] branch: load steps find one continuation only; use method "events"'


def _of_options(scene: Scene) -> checks.Rules:
    """Rules that do not rely on each other."""
    history, wear = scene.history, scene.wear
    once = history.kind == "table" and bool(history.rows) and not history.cycle_rows
    none = "a table without cycle_rows has none"
    yield from checks.unused(history, "[history]", once and history.cycles, ("cycles",), none)
    for name, text in vars(scene.units).items():
        if text is not None and not (text.isprintable() and text.strip()):
            yield f'[units] {name}: must be the name of a unit, such as "mm", not {text!r}'
    if wear.coefficient is not None and wear.archard is not None:
        yield "[wear] coefficient and archard: give one of them"


def _of_fatigue(scene: Scene) -> checks.Rules:
    """There are a cycle and points for fatigue parameters."""
    options = scene.fatigue
    if options is None:
        return
    if not scene.probes:
        yield '[fatigue]: needs points; add a [[probe]], such as edge = "bottom" for a contact edge'
    if not len(history_from_scene(scene).loop):
        yield '[fatigue]: needs a history with cycles; use kind = "cyclic", "table" or "harmonic"'
    if (options.threshold is None) != (options.fatigue_limit is None):
        yield "[fatigue] threshold and fatigue_limit: give both, or none"
    long = any(probe.segment and len(probe.coordinates) > 2 for probe in scene.probes)
    if options.threshold is not None and not long:
        yield "[fatigue] threshold: needs a [[probe]] with a segment, and a count of 3 or more"
    for probe in scene.probes:
        edge, at = probe.edge, f"probe '{probe.name}'"
        body = scene.find_edge(edge)[0] if edge else loads.body_named(scene, probe.body, at)
        if len(scene.surface_materials(body)) > 1 or scene.material_of(body).young_2 is not None:
            yield f"{at}: [fatigue] needs a body of one isotropic material; leave one of them out"


def _of_shakedown(scene: Scene) -> checks.Rules:
    options, known = scene.shakedown, scene.driven_names
    named = [("mean", options.mean), *(("range", vertex) for vertex in options.range)]
    for key, names in [*named, ("diagram", [options.diagram] if options.diagram else [])]:
        for name in names:
            checks.check_known(name, known, f"[shakedown] {key}", "load")
    yield from ()  # unknown names raise


def _of_accuracy(scene: Scene) -> checks.Rules:
    probes = [probe.name for probe in scene.probes]
    owners = {"load": scene.load_names, "probe": probes, "": [c.edge for c in scene.contacts]}
    for name in scene.accuracy.numbers:
        base, bracket, owner = name.removesuffix("]").partition("[")
        if base not in HEADLINE_NAMES:
            checks.check_known(name, tuple(HEADLINE_NAMES), "[accuracy] numbers", "number")
        kind = next(kind for kind in owners if base.startswith(kind))
        several = kind or len(scene.contacts) > 1
        if bracket and (base.startswith("dissipation") or not several):
            yield f"[accuracy] numbers: '{base}' is one number; leave out [{owner}]"
        if bracket:
            what = kind or "contact edge"
            checks.check_known(owner, owners[kind], f"[accuracy] numbers '{base}'", what)


def _of_record(scene: Scene) -> checks.Rules:
    """The history, its sampled cycles, and that the record can be stored."""
    history, output = history_from_scene(scene), scene.output
    for number in output.cycles if isinstance(output.cycles, tuple) else ():
        if number > history.cycles:
            yield f"[output] cycles: cycle {number} does not occur; the last is {history.cycles}"
    legs = max(len(history.loop) - 1, len(history.path) - 1)
    # a run until the steady state or the limit ends long before
    cycles = 0 if history.until_steady or history.until_limit else history.cycles
    # number of cycles that are sampled by default: 0, 1, 2, 9 and the last
    sampled = min(5, cycles + 1)
    if output.cycles is not None:
        sampled = len(output.cycles) if isinstance(output.cycles, tuple) else cycles + 1
    # of a node at one instant a record has 50 bytes: v, w, P, Q, p, q and the state
    size = 50e-9 * legs * (scene.mesh.degree * scene.mesh.contact_elements + 1)
    samples = sampled * output.samples_on(legs)
    fewer = "use fewer, or sample fewer cycles by output.cycles"
    if size * (cycles + 1) > 1000.0:
        yield f"[history] cycles: requires a record of {size * (cycles + 1):.0f} GB; use fewer"
    if size * samples > 1000.0:
        yield f"[output] samples_per_leg: requires a record of {size * samples:.0f} GB; {fewer}"


def _of_probes(scene: Scene) -> checks.Rules:
    """The names of probes, and that their points lie on their bodies."""
    seen: set[str] = set()
    for probe in scene.probes:
        at, name = f"probe '{probe.name}'", probe.name
        checks.check_name(name, "[[probe]] name")
        # characters that some systems do not allow
        odd = any(c in '/\\:*?"<>|' for c in name) or name != name.strip() or name[0] == "."
        if odd or len(name) > 80:
            yield f"[[probe]] name: {name!r} cannot be the name of a file; use letters, digits"
        if name.casefold() in seen:
            yield f"{at}: two probes have this name; rename one"
        seen.add(name.casefold())
        yield from _of_points(scene, probe, at)
    total = sum(len(probe.coordinates) for probe in scene.probes)
    if total > 1000:  # each costs six solves with the bulk
        yield f"[[probe]]: the probes have {total} points, at most 1000 are possible; omit some"


def _of_points(scene: Scene, probe: Probe, at: str) -> checks.Rules:
    """The points of a probe are given in one way, and lie on its body."""
    yield from checks.one_of(probe, at, ("point", "points", "segment", "edge"))
    if probe.segment and probe.count is None:
        yield f"{at} count: a segment needs its number of points; add count"
    if probe.count is not None and not probe.segment:
        yield f"{at} count: belongs to a segment; remove it"
    if probe.segment and (len(probe.segment) != 2 or probe.segment[0] == probe.segment[1]):
        yield f"{at} segment: needs two different ends, [[x, y], [x, y]]"
    if probe.edge is None:
        for point in probe.coordinates:
            yield from loads.of_place(scene, loads.body_named(scene, probe.body, at), point, at)
        return
    known = [e for c in scene.contacts for e in (c.edge, c.against) if e is not None]
    checks.check_known(probe.edge, known, f"{at} edge", "contact edge")
    if probe.body is not None:
        yield f"{at} body: the edge names the body; remove it"
