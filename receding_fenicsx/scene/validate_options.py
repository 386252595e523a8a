"""Validation of solver and output options, and of probes."""

from __future__ import annotations

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.acting.validate import body_named, check_inside
from receding_fenicsx.scene.checks import (
    check_choice,
    check_count,
    check_name,
    check_positive,
    nearest,
    unknown_name,
)
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import Probe, Scene, SolverOptions
from receding_fenicsx.scene.options import HEADLINE_NAMES

MAX_STEPS = 1_000_000
"""Largest number of load steps or samples of a leg."""
MAX_BRANCH = 1_000
MAX_MODES = 1_000
"""Largest number of a continuation."""
MAX_RECORD_BYTES = 1e12
"""Size of the largest record."""
BYTES_PER_NODE = 50
"""Bytes of one node at one instant of a record: v, w, P, Q, p, q and the state."""
DEFAULT_SAMPLED_CYCLES = 5
"""Number of cycles that are sampled by default: 0, 1, 2, 9 and the last."""
PROBE_KINDS = ("point", "points", "segment")
"""Keys of a probe of which exactly one is given."""
MOST_POINTS = 1000
"""Largest number of points of all probes together: each costs six solves with the bulk."""
NOT_IN_FILE_NAMES = '/\\:*?"<>|'
"""Characters that the names of files cannot hold on some systems."""
MAX_NAME_LENGTH = 80


def check_solver(solver: SolverOptions) -> None:
    """Check the table [solver]."""
    check_choice(solver.method, ("gauss-seidel", "events"), "[solver] method")
    check_choice(solver.symmetry, ("auto", "none"), "[solver] symmetry")
    check_choice(solver.on_jump, ("stop", "static"), "[solver] on_jump")
    check_branch(solver)
    check_count(solver.steps_per_leg, MAX_STEPS, "[solver] steps_per_leg")
    check_positive(solver.max_sweeps, "[solver] max_sweeps")
    for key in ("change_tolerance", "residual_tolerance", "steady_tolerance"):
        value = getattr(solver, key)
        if value is None:  # a default that depends on the history
            continue
        check_positive(value, f"[solver] {key}")
        if value >= 1.0:
            raise InputError(f"[solver] {key}: is relative; must be below 1")
    if not 0.0 < solver.over_relaxation < 2.0:
        raise InputError(
            f"[solver] over_relaxation: must be between 0 and 2, not {solver.over_relaxation:g}; "
            "1 is none, 1.5 often fastest"
        )


def check_branch(solver: SolverOptions) -> None:
    """Check which of several continuations is taken, and that the method can."""
    rule, where = solver.branch, "[solver] branch"
    if isinstance(rule, bool) or not isinstance(rule, int):
        check_choice(rule, ("first", "least dissipation", "most dissipation"), where)
    else:
        check_count(rule, MAX_BRANCH, where)
    if rule != "first" and solver.method != "events":
        raise InputError(
            f'{where}: load steps find one continuation only; use method "events" with it'
        )


def check_shakedown(scene: Scene) -> None:
    """Check the loads of the table [shakedown], and its choices."""
    options, known = scene.shakedown, scene.driven_names
    check_choice(options.separated, ("refuse", "stay"), "[shakedown] separated")
    if options.largest_slip is not None:
        check_positive(options.largest_slip, "[shakedown] largest_slip")
    tables = [("mean", options.mean), *(("range", vertex) for vertex in options.range)]
    for key, names in [*tables, ("diagram", [options.diagram] if options.diagram else [])]:
        for name in names:
            if name not in known:
                unknown_name(name, known, f"[shakedown] {key}", "load")


def check_accuracy(scene: Scene) -> None:
    """Check the table [accuracy] and the names of its numbers."""
    options = scene.accuracy
    if options.tolerance is not None:
        check_positive(options.tolerance, "[accuracy] tolerance")
        if options.tolerance >= 1.0:
            raise InputError("[accuracy] tolerance: is relative; must be below 1")
    check_positive(options.budget_seconds, "[accuracy] budget_seconds")
    if options.grading and scene.mesh.cell != "triangle":
        raise InputError('[accuracy] grading: is for triangles; use cell = "triangle"')
    owners = {
        "load": scene.load_names,
        "probe": tuple(probe.name for probe in scene.probes),
        "": tuple(contact.edge for contact in scene.contacts),
    }
    for name in options.numbers:
        base, bracket, owner = name.removesuffix("]").partition("[")
        if base not in HEADLINE_NAMES:
            close = nearest(base, HEADLINE_NAMES)
            hint = f"did you mean '{close}'? " if close else ""
            known = ", ".join(HEADLINE_NAMES)
            raise InputError(
                f"[accuracy] numbers: unknown number '{name}'; {hint}known are {known}"
            )
        kind = next(kind for kind in owners if base.startswith(kind))
        several = kind or len(scene.contacts) > 1
        if bracket and (base.startswith("dissipation") or not several):
            raise InputError(f"[accuracy] numbers: '{base}' is one number; leave out [{owner}]")
        if bracket and owner not in owners[kind]:
            what = kind or "contact edge"
            unknown_name(owner, owners[kind], f"[accuracy] numbers '{base}'", what)


def check_output(scene: Scene, history: History) -> None:
    """Check the table [output], and that the record is not too large to be stored."""
    output = scene.output
    if output.samples_per_leg is not None:
        check_count(output.samples_per_leg, MAX_STEPS, "[output] samples_per_leg")
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
    output, legs = scene.output, max(len(history.loop) - 1, len(history.path) - 1)
    # a run until the steady state or the limit ends long before
    cycles = 0 if history.until_steady or history.until_limit else history.cycles
    sampled = min(DEFAULT_SAMPLED_CYCLES, cycles + 1)
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
        size = count * legs * nodes * BYTES_PER_NODE
        if size > MAX_RECORD_BYTES:
            raise InputError(f"{key}: requires a record of {size / 1e9:.0f} GB; {advice}")


def check_probes(scene: Scene) -> None:
    """Check the names of probes, and that their points lie on their bodies.

    Whether a point lies inside a mesh file's body is found when the body is meshed.
    """
    seen: set[str] = set()
    for probe in scene.probes:
        where = f"probe '{probe.name}'"
        _check_probe_name(probe.name)
        if probe.name.casefold() in seen:
            raise InputError(f"{where}: two probes have this name; rename one")
        seen.add(probe.name.casefold())
        _check_probe_points(probe, where)
        body = body_named(scene, probe.body, where)
        for point in probe.coordinates if body.mesh is None else ():
            check_inside(scene, body, point, where)
    total = sum(len(probe.coordinates) for probe in scene.probes)
    if total > MOST_POINTS:
        raise InputError(
            f"[[probe]]: the probes have {total} points, at most {MOST_POINTS} are possible; "
            "leave some out"
        )


def _check_probe_name(name: str) -> None:
    """Check that a name can be that of a file."""
    check_name(name, "[[probe]] name")
    if (
        any(c in NOT_IN_FILE_NAMES for c in name)
        or name != name.strip()
        or name.startswith(".")
        or len(name) > MAX_NAME_LENGTH
    ):
        raise InputError(
            f"[[probe]] name: {name!r} cannot be the name of a file; use letters, digits, _ and -"
        )


def _check_probe_points(probe: Probe, where: str) -> None:
    """Check that the points are given in one way, as pairs of numbers."""
    given = [kind for kind in PROBE_KINDS if getattr(probe, kind) not in (None, ())]
    if len(given) != 1:
        raise InputError(
            f"{where}: has {' and '.join(given) or 'none'} of {', '.join(PROBE_KINDS)}; give "
            "exactly one of them"
        )
    if (probe.count is not None) != (given == ["segment"]):
        raise InputError(
            f"{where} count: a segment needs its number of points; add count"
            if given == ["segment"]
            else f"{where} count: belongs to a segment; remove it"
        )
    for pair in probe.points or probe.segment or (probe.point or (),):
        if len(pair) != 2:
            raise InputError(f"{where} {given[0]}: a point is two numbers [x, y], not {list(pair)}")
    if probe.count is None:
        return
    if len(probe.segment) != 2 or probe.segment[0] == probe.segment[1]:
        raise InputError(f"{where} segment: needs two different ends, [[x, y], [x, y]]")
    if not 2 <= probe.count <= MOST_POINTS:
        raise InputError(f"{where} count: must be from 2 to {MOST_POINTS}, not {probe.count}")
