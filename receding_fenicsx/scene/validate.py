"""Validation of a scene: errors for what cannot be modelled, warnings for what is inaccurate.

Types, ranges and choices of single values stand at the dataclasses of the scene. Here are the rules
between values, and in ``validate_bodies`` and ``validate_loads``. Every
message is one line: the table and key, what is wrong, what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from receding_fenicsx.errors import InputError, InputErrors
from receding_fenicsx.scene.checks import check_name, unknown_name
from receding_fenicsx.scene.history import History, history_from_scene
from receding_fenicsx.scene.model import Probe, Scene, SolverOptions
from receding_fenicsx.scene.options import HEADLINE_NAMES, check_units
from receding_fenicsx.scene.toml_reader import check_values
from receding_fenicsx.scene.validate_bodies import (
    check_bodies,
    check_contact,
    check_half_planes,
    check_initial_slip,
    check_mesh,
    check_sides,
    check_touching,
    gap_warnings,
)
from receding_fenicsx.scene.validate_loads import (
    body_named,
    check_acts,
    check_bolt,
    check_inside,
    check_load,
    check_names,
    check_parts,
    check_spring,
    check_support,
)


def validate(scene: Scene) -> None:
    """Check that a scene can be modelled.

    Args:
        scene: the scene.

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
    _raise_all(_errors([lambda scene: check_units(scene.units), check_bodies], scene))
    # what follows asks for the edges of contacts and ties
    sides = [partial(check_sides, number=k) for k in range(len(scene.joints))]
    _raise_all(_errors(sides, scene))
    checks: list[Callable[[Scene], None]]
    checks = [partial(check_contact, number=k) for k in range(len(scene.contacts))]
    checks += [check_touching, check_mesh, check_half_planes]
    checks += [partial(check_bolt, bolt) for bolt in scene.bolts]
    checks += [partial(check_support, support) for support in scene.supports]
    checks += [partial(check_spring, spring) for spring in scene.springs]
    checks += [check_probes, check_shakedown, check_wear, check_accuracy, check_initial_slip]
    errors = _errors([*checks, lambda scene: check_solver(scene.solver)], scene)
    wrong = _errors([check_names, *(partial(check_load, load) for load in scene.loads)], scene)
    wrong = wrong or _errors([check_parts], scene)
    if not wrong:  # a load that is wrong may not be in the history yet
        acts = [partial(check_acts, load) for load in scene.loads]
        wrong = _errors([*acts, check_fatigue, check_output], scene)
    _raise_all([*errors, *wrong])


def _errors(checks: Iterable[Callable[[Scene], None]], scene: Scene) -> list[InputError]:
    """Return the errors of all checks."""
    errors = []
    for check in checks:
        try:
            check(scene)
        except InputError as error:
            errors.append(error)
    return errors


def _raise_all(errors: list[InputError]) -> None:
    """Raise all errors if there are any; a single one as it is."""
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise InputErrors(*dict.fromkeys(str(error) for error in errors))


def scene_warnings(scene: Scene) -> list[str]:
    """Return one line for each option that makes the results inaccurate without any error."""
    lines = []
    largest = max(
        (
            material.poisson
            for material in (scene.material, *scene.materials)
            if material.kinematics != "plane stress"
        ),
        default=0.0,
    )
    # Poisson's ratio above which elements of order 1 are too stiff. On the paper's block with 81
    # contact nodes, the error of their dissipation is 3 to 8 % at 0.49 and 11 to 30 % at 0.499;
    # that of order 2 is 1 %
    if scene.mesh.degree == 1 and largest > 0.45:
        lines.append(
            f"[mesh] degree: elements of order 1 lock near incompressibility (Poisson's ratio "
            f"{largest:g}), which the residual does not show; use degree = 2"
        )
    return lines + gap_warnings(scene)


def check_solver(solver: SolverOptions) -> None:
    """Check that the method finds the branch that is taken."""
    if solver.branch != "first" and solver.method != "events":
        raise InputError(
            '[solver] branch: load steps find one continuation only; use method "events" with it'
        )


def check_wear(scene: Scene) -> None:
    """Check that wear has one coefficient."""
    if scene.wear.coefficient is not None and scene.wear.archard is not None:
        raise InputError("[wear] coefficient and archard: give one of them")


def check_fatigue(scene: Scene) -> None:
    """Check that there are a cycle and points for fatigue parameters."""
    if scene.fatigue is None:
        return
    if not scene.probes:
        raise InputError(
            '[fatigue]: needs points; add a [[probe]], such as edge = "bottom" for a contact edge'
        )
    if not len(history_from_scene(scene).loop):
        raise InputError(
            "[fatigue]: needs a history with cycles, this one is monotonic; use "
            'kind = "cyclic", "table" or "harmonic"'
        )
    if (scene.fatigue.threshold is None) != (scene.fatigue.fatigue_limit is None):
        raise InputError("[fatigue] threshold and fatigue_limit: give both, or none")
    if scene.fatigue.threshold is not None and not any(
        probe.segment and len(probe.coordinates) > 2 for probe in scene.probes
    ):
        raise InputError(
            "[fatigue] threshold: needs a [[probe]] with a segment, and a count of 3 or more, "
            "along which a crack grows"
        )


def check_shakedown(scene: Scene) -> None:
    """Check the loads of the table [shakedown], and its choices."""
    options, known = scene.shakedown, scene.driven_names
    tables = [("mean", options.mean), *(("range", vertex) for vertex in options.range)]
    for key, names in [*tables, ("diagram", [options.diagram] if options.diagram else [])]:
        for name in names:
            if name not in known:
                unknown_name(name, known, f"[shakedown] {key}", "load")


def check_accuracy(scene: Scene) -> None:
    """Check the table [accuracy] and the names of its numbers."""
    options = scene.accuracy
    owners = {
        "load": scene.load_names,
        "probe": tuple(probe.name for probe in scene.probes),
        "": tuple(contact.edge for contact in scene.contacts),
    }
    for name in options.numbers:
        base, bracket, owner = name.removesuffix("]").partition("[")
        if base not in HEADLINE_NAMES:
            unknown_name(name, tuple(HEADLINE_NAMES), "[accuracy] numbers", "number")
        kind = next(kind for kind in owners if base.startswith(kind))
        several = kind or len(scene.contacts) > 1
        if bracket and (base.startswith("dissipation") or not several):
            raise InputError(f"[accuracy] numbers: '{base}' is one number; leave out [{owner}]")
        if bracket and owner not in owners[kind]:
            what = kind or "contact edge"
            unknown_name(owner, owners[kind], f"[accuracy] numbers '{base}'", what)


def check_output(scene: Scene) -> None:
    """Check the history, its sampled cycles, and that the record can be stored."""
    history, output = history_from_scene(scene), scene.output
    if isinstance(output.cycles, tuple):
        for number in output.cycles:
            if number > history.cycles:
                raise InputError(
                    f"[output] cycles: cycle {number} does not occur; the history has cycles 0 to "
                    f"{history.cycles}"
                )
    _check_record_size(scene, history)


def _check_record_size(scene: Scene, history: History) -> None:
    output, legs = scene.output, max(len(history.loop) - 1, len(history.path) - 1)
    # a run until the steady state or the limit ends long before
    cycles = 0 if history.until_steady or history.until_limit else history.cycles
    # number of cycles that are sampled by default: 0, 1, 2, 9 and the last
    sampled = min(5, cycles + 1)
    if output.cycles is not None:
        sampled = len(output.cycles) if isinstance(output.cycles, tuple) else cycles + 1
    nodes = scene.mesh.degree * scene.mesh.contact_elements + 1
    for key, count, advice in (
        ("[history] cycles", cycles + 1, "use fewer"),
        (
            "[output] samples_per_leg",
            sampled * output.samples_on(legs),
            "use fewer, or sample fewer cycles by output.cycles",
        ),
    ):
        # bytes of one node at one instant of a record: v, w, P, Q, p, q and the state
        size = count * legs * nodes * 50
        # size of the largest record
        if size > 1e12:
            raise InputError(f"{key}: requires a record of {size / 1e9:.0f} GB; {advice}")


def check_probes(scene: Scene) -> None:
    """Check the names of probes, and that their points lie on their bodies."""
    seen: set[str] = set()
    for probe in scene.probes:
        where = f"probe '{probe.name}'"
        check_name(probe.name, "[[probe]] name")
        # characters that some systems do not allow
        odd = any(c in '/\\:*?"<>|' for c in probe.name) or probe.name != probe.name.strip()
        if odd or probe.name.startswith(".") or len(probe.name) > 80:
            raise InputError(
                f"[[probe]] name: {probe.name!r} cannot be the name of a file; use letters, "
                "digits, _ and -"
            )
        if probe.name.casefold() in seen:
            raise InputError(f"{where}: two probes have this name; rename one")
        seen.add(probe.name.casefold())
        _check_probe_points(probe, where)
        if probe.edge is not None:
            known = [e for c in scene.contacts for e in (c.edge, c.against) if e is not None]
            if probe.edge not in known:
                unknown_name(probe.edge, known, f"{where} edge", "contact edge")
            if probe.body is not None:
                raise InputError(f"{where} body: the edge names the body; remove it")
            continue
        body = body_named(scene, probe.body, where)
        for point in probe.coordinates if body.mesh is None else ():
            check_inside(scene, body, point, where)
    total = sum(len(probe.coordinates) for probe in scene.probes)
    if total > 1000:  # each costs six solves with the bulk
        raise InputError(
            f"[[probe]]: the probes have {total} points, at most 1000 are possible; leave some out"
        )


def _check_probe_points(probe: Probe, where: str) -> None:
    """Check that the points are given in one way."""
    kinds = ("point", "points", "segment", "edge")
    given = [kind for kind in kinds if getattr(probe, kind) not in (None, ())]
    if len(given) != 1:
        raise InputError(
            f"{where}: has {' and '.join(given) or 'none'} of {', '.join(kinds)}; give "
            "exactly one of them"
        )
    if (probe.count is not None) != (given == ["segment"]):
        raise InputError(
            f"{where} count: a segment needs its number of points; add count"
            if given == ["segment"]
            else f"{where} count: belongs to a segment; remove it"
        )
    if probe.count is None:
        return
    if len(probe.segment) != 2 or probe.segment[0] == probe.segment[1]:
        raise InputError(f"{where} segment: needs two different ends, [[x, y], [x, y]]")
