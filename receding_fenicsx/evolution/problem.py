"""Problem to be evolved: a system with the friction and gap of a scene, history, solver, output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array, as_numbers
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.branches.choice import FIRST, Chooser, chooser_for
from receding_fenicsx.interface.measures.zones import begins_on_axis
from receding_fenicsx.interface.system import ContactSystem, eliminate_tangential
from receding_fenicsx.interface.system_checks import LARGEST, check_range, check_system
from receding_fenicsx.interface.tolerances import LIMIT_CYCLE_TOLERANCE
from receding_fenicsx.scene.checks import broken, refuse
from receding_fenicsx.scene.history import History, check_history, history_from_scene
from receding_fenicsx.scene.identity import body_difference
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions
from receding_fenicsx.scene.profiles import Profile, directions, evaluate, evaluate_checked
from receding_fenicsx.scene.toml_file import known_scene, to_toml
from receding_fenicsx.scene.toml_reader import check_values
from receding_fenicsx.scene.validate import of_solver, validate


def with_profiles(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return a system with the law of friction and the initial gap of a scene at its nodes.

    They are evaluated here only, for a newly condensed body and for a saved one. Body, material,
    mesh, contact edges, loads and supports of the scene must be those that the system was condensed
    from. Probes of another scene are dropped.
    """
    pairs = [directions(contact.friction) for contact in scene.contacts]
    f, f_backward = (_values(scene, system, "friction", p) for p in zip(*pairs, strict=True))
    # a support carries the normal force there, not the contact: no friction
    f[system.held[system.n :]] = f_backward[system.held[system.n :]] = 0.0
    branches: dict[str, Any] = {"cohesion": None, "shear_limit": None}
    for key, none in (("cohesion", 0.0), ("shear_limit", np.inf)):
        given = [getattr(contact, key) for contact in scene.contacts]
        if any(profile is not None for profile in given):
            branches[key] = _values(scene, system, key, given, none)
    if branches["cohesion"] is not None:
        branches["cohesion"][system.held[system.n :]] = 0.0
    gaps = [contact.initial_gap for contact in scene.contacts]
    return replace(
        system,
        f=f,
        g0=_shifted_to_axis(scene, system, _values(scene, system, "initial_gap", gaps)),
        scene_toml=to_toml(scene),
        f_backward=None if np.array_equal(f, f_backward) else f_backward,
        probes=system.probes if scene.probes and has_probes_of(scene, system) else None,
        **branches,
    )


def has_probes_of(scene: Scene, system: ContactSystem) -> bool:
    """Return whether a system has the probes of a scene, for which it need not be condensed."""
    if not scene.probes or system.probes is None or not system.scene_toml:
        return not scene.probes
    return known_scene(system.scene_toml).probes == scene.probes


def system_for(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return a system with the friction and the gap of a scene, in the form that is evolved.

    Without friction the tangential displacements are eliminated. All arrays are made contiguous, as
    they are when read from a file, so that a saved system gives the same answer bit by bit.
    """
    system = with_profiles(scene, system)
    if system.kind == "frictional" and not np.any(system.law.present):
        system = eliminate_tangential(system)
    if system.kind == "normal" and np.any(system.law.present):
        raise InputError(
            "the system has no tangential displacements, since it was condensed without friction; "
            "condense the scene again"
        )
    arrays: dict[str, Any] = {}
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = np.ascontiguousarray(value)
    return replace(system, **arrays)


def _values(
    scene: Scene,
    system: ContactSystem,
    key: str,
    profiles: Sequence[Profile | None],
    none: float = 0.0,
) -> Array:
    """Return the values (N,) of the contacts' profiles at their nodes; refuse negative ones."""
    values = np.empty(system.n)
    for k, profile in enumerate(profiles):
        on = system.edges == k
        if profile is None:
            values[on] = none
            continue
        found = evaluate_checked(profile, system.x[on], None, f"[contact] {key}")
        values[on] = _without_round_off(found)
    if np.any(values < 0.0):
        i = int(np.argmin(values))
        edge = scene.contacts[system.edges[i]].edge
        raise InputError(
            f"[contact] {key}: is {values[i]:g} at x = {system.x[i]:g} along '{edge}'; it must not "
            "be negative"
        )
    return values


def _without_round_off(values: Array) -> Array:
    """Return values with round-off set to 0, so that a node near x = 0 touches for a gap x^2."""
    # gap or friction, over the largest one along the edge, below which it is round-off of zero
    is_zero = np.abs(values) <= 1e-10 * np.abs(values).max(initial=0.0)
    return np.where(is_zero, 0.0, values)


def _shifted_to_axis(scene: Scene, system: ContactSystem, g0: Array) -> Array:
    """Return the gap of a free body of revolution, shifted so that the body touches on its axis."""
    if not (system.axisymmetric and system.rigid.shape[1]):
        return g0
    for k, contact in enumerate(scene.contacts):
        first = int(np.argmax(system.edges == k))
        on = system.edges == k
        radius = system.points[on, 0]
        if not begins_on_axis(radius, system.weight[on]):
            continue
        # the smallest motion that opens this contact by 1
        w = system.rigid[system.n :]
        share = np.linalg.pinv(w.T @ w) @ w[first]
        if not w[first] @ share > 0.0:
            continue
        lift = _without_round_off(w @ share / (w[first] @ share))
        above = lift > 0.0
        on_axis = float(evaluate(contact.initial_gap, np.zeros(1))[0])
        depth = float((g0[above] / lift[above]).min()) - on_axis
        if depth > 0.0:
            g0 = _without_round_off(g0 - depth * lift)
    return g0


@dataclass(frozen=True)
class Problem:
    """Checked problem, made by :func:`problem_of_scene` or :func:`problem_of_history`."""

    system: ContactSystem  # the condensed body
    history: History  # path from rest, then cycles
    solver: SolverOptions  # method and tolerances
    output: OutputOptions  # which cycles get samples and events
    initial_slip: Array  # (N,) tangential displacement at rest; 0 at held nodes
    # chooses among several continuations of the exact path; None takes the first
    chooser: Chooser | None = None
    # the uniqueness of the path is judged; it costs time, and changes no other answer
    judged: bool = True

    @property
    def last_cycle(self) -> int:
        """Number of the last cycle of the history."""
        return self.history.cycles if len(self.history.loop) else 0

    def samples_on(self, cycle: int) -> int:
        """Return the number of samples per leg of a sampled cycle."""
        return self.output.samples_on(len(self.history.polyline(cycle)) - 1)

    def is_sampled(self, cycle: int) -> bool:
        """Return whether samples of a cycle were asked for by its number."""
        # cycles that get samples and events by default, beside the last one
        wanted = (0, 1, 2, 9) if self.output.cycles is None else self.output.cycles
        return wanted == "all" or cycle in wanted


def problem_of_scene(system: ContactSystem, scene: Scene) -> Problem:
    """Return the problem of a scene, its bolts tightened, on the system of its body."""
    validate(scene)
    if any(bolt.shortening is None for bolt in scene.bolts):
        raise ValueError("bolts with preloads have to be tightened first")
    if not system.scene_toml:
        raise InputError(
            "evolve: the system was made by hand, for no scene; give a History, or condense the "
            "scene"
        )
    other = body_difference(known_scene(system.scene_toml), scene)
    if other is not None:
        raise InputError(
            f"evolve: the system was condensed from a scene with another {other}; condense this "
            "scene"
        )
    if not has_probes_of(scene, system):
        raise InputError(
            "evolve: the system was condensed with other probes than the scene has; condense this "
            "scene, or change its [[probe]] tables"
        )
    system, slip = system_for(scene, system), scene.history.initial_slip
    initial_slip = None
    if slip is not None:
        initial_slip = evaluate_checked(slip, system.x, None, "[history] initial_slip")
    return _checked(system, history_from_scene(scene), scene.solver, scene.output, initial_slip)


def problem_of_history(
    system: ContactSystem,
    history: History,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
    initial_slip: Array | None = None,
) -> Problem:
    """Return the problem of a path of load factors on a system as it is."""
    return _checked(
        replace(system, scene_toml=""),
        history,
        solver or SolverOptions(),
        output or OutputOptions(),
        initial_slip,
    )


def _checked(
    system: ContactSystem,
    history: History,
    solver: SolverOptions,
    output: OutputOptions,
    initial_slip: Array | None,
) -> Problem:
    check_system(system)
    # what the check lets pass as round-off of the condensation would break energies and residuals
    system = replace(system, K=0.5 * (system.K + system.K.T))
    check_history(history, system.load_names)
    check_range(system, np.vstack([history.path, history.loop]))
    n = system.n
    if solver.steady_tolerance is None:
        if history.until_limit:
            solver = replace(solver, steady_tolerance=LIMIT_CYCLE_TOLERANCE)
    elif history.until_limit and solver.steady_tolerance < 1e-13:
        raise InputError(
            f"[solver] steady_tolerance: {solver.steady_tolerance:g} is below the round-off of a "
            f'cycle; until = "limit" needs at least 1e-13'
        )
    v = np.zeros(n) if initial_slip is None else as_numbers(initial_slip, "initial_slip")
    if v.shape != (n,):
        raise InputError(f"initial_slip has shape {v.shape}, expected ({n},)")
    if not np.all(np.abs(v) <= LARGEST):
        node = np.argmin(np.abs(v) <= LARGEST)
        raise InputError(f"initial_slip of node {node} is not finite, or beyond {LARGEST:g}")
    v[system.held[:n]] = 0.0
    # a method may be registered in Python
    check_values(replace(solver, method=SolverOptions.method), "[solver]")
    refuse(broken([of_solver(solver)]))
    if history.until_limit and solver.branch != FIRST:
        raise InputError(
            "[solver] branch: the limit of infinitely many cycles is that of the first "
            'continuation; use history.until = "steady", or branch = "first"'
        )
    if system.has_branches and solver.branch != FIRST:
        raise InputError("[solver] branch: not served with [contact] shear_limit or cohesion")
    return Problem(
        system, history, solver, output, v, chooser_for(solver.branch), not system.has_branches
    )
