"""Problem to be evolved: a condensed system with its history, solver, output and initial slip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import Array, as_numbers
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.prepare import has_probes_of, system_for
from receding_fenicsx.interface.branches.choice import FIRST, Chooser, chooser_for
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.system_checks import LARGEST, check_range, check_system
from receding_fenicsx.interface.tolerances import LIMIT_CYCLE_TOLERANCE
from receding_fenicsx.scene.history import History, check_history, history_from_scene
from receding_fenicsx.scene.identity import body_difference
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions
from receding_fenicsx.scene.profiles import evaluate_checked
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.scene.toml_reader import check_values
from receding_fenicsx.scene.validate import check_solver, validate

LEAST_TOLERANCE = 1e-13
"""Smallest tolerance of the limit: round-off of a cycle's forces over the largest."""

DEFAULT_SAMPLED_CYCLES = (0, 1, 2, 9)
"""Cycles that get samples and events by default, beside the last one."""


@dataclass(frozen=True)
class Problem:
    """Problem to be evolved, checked; see :func:`problem_of_scene` and :func:`problem_of_history`.

    Attributes:
        system: the condensed body.
        history: path from rest, then cycles.
        solver: method and tolerances.
        output: which cycles get samples and events.
        initial_slip: (N,) tangential displacement at rest; 0 at held nodes.
        chooser: chooses among several continuations of the exact path; None takes the first.
        judged: the uniqueness of the path is judged; it costs time, and changes no other answer.
    """

    system: ContactSystem
    history: History
    solver: SolverOptions
    output: OutputOptions
    initial_slip: Array
    chooser: Chooser | None = None
    judged: bool = True

    @property
    def has_initial_slip(self) -> bool:
        """Whether the first leg is one static problem, with slip counted from an initial one."""
        return bool(np.any(self.initial_slip))

    @property
    def last_cycle(self) -> int:
        """Number of the last cycle of the history."""
        return self.history.cycles if len(self.history.loop) else 0

    def samples_on(self, cycle: int) -> int:
        """Return the number of samples per leg of a sampled cycle."""
        return self.output.samples_on(len(self.history.polyline(cycle)) - 1)

    def is_sampled(self, cycle: int) -> bool:
        """Return whether samples of a cycle were asked for by its number."""
        wanted = DEFAULT_SAMPLED_CYCLES if self.output.cycles is None else self.output.cycles
        return wanted == "all" or cycle in wanted


def problem_of_scene(system: ContactSystem, scene: Scene) -> Problem:
    """Return the problem of a scene on the system condensed from its body.

    Raises:
        ValueError: the shortenings of its bolts are not known
            (:mod:`~receding_fenicsx.evolution.histories.tightening`).
        InputError: the scene is not valid, or the system is that of another body.
    """
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
    """Return the problem of a path of load factors on a system as it is.

    Raises:
        InputError: the history's loads are not the system's, or an array has a wrong length or
            values without meaning.
    """
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
    elif history.until_limit and solver.steady_tolerance < LEAST_TOLERANCE:
        raise InputError(
            f"[solver] steady_tolerance: {solver.steady_tolerance:g} is below the round-off of a "
            f'cycle; until = "limit" needs at least {LEAST_TOLERANCE:g}'
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
    check_solver(solver)
    if history.until_limit and solver.branch != FIRST:
        raise InputError(
            "[solver] branch: the limit of infinitely many cycles is that of the first "
            'continuation; use history.until = "steady", or branch = "first"'
        )
    return Problem(system, history, solver, output, v, chooser_for(solver.branch))
