"""Validation of solver and output options."""

from __future__ import annotations

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import check_choice, check_count, check_positive
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import Scene, SolverOptions

MAX_STEPS = 1_000_000
"""Largest number of load steps or samples of a leg."""
MAX_RECORD_BYTES = 1e12
"""Size of the largest record."""
BYTES_PER_NODE = 50
"""Bytes of one node at one instant of a record: v, w, P, Q, p, q and the state."""
DEFAULT_SAMPLED_CYCLES = 5
"""Number of cycles that are sampled by default: 0, 1, 2, 9 and the last."""


def check_solver(solver: SolverOptions) -> None:
    """Check the table [solver]."""
    check_choice(solver.method, ("gauss-seidel", "events"), "[solver] method")
    check_choice(solver.symmetry, ("auto", "none"), "[solver] symmetry")
    check_choice(solver.on_jump, ("stop", "static"), "[solver] on_jump")
    check_count(solver.steps_per_leg, MAX_STEPS, "[solver] steps_per_leg")
    check_positive(solver.max_sweeps, "[solver] max_sweeps")
    for key in ("change_tolerance", "residual_tolerance", "steady_tolerance"):
        check_positive(getattr(solver, key), f"[solver] {key}")
        if getattr(solver, key) >= 1.0:
            raise InputError(f"[solver] {key}: is relative; must be below 1")
    if not 0.0 < solver.over_relaxation < 2.0:
        raise InputError(
            f"[solver] over_relaxation: must be between 0 and 2, not {solver.over_relaxation:g}; "
            "1 is none, 1.5 often fastest"
        )


def check_output(scene: Scene, history: History) -> None:
    """Check the table [output], and that the record is not too large to be stored."""
    output = scene.output
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
    output, legs = scene.output, max(len(history.loop) - 1, 1)
    # a run until the steady state ends long before
    cycles = 0 if history.until_steady else history.cycles
    sampled = min(DEFAULT_SAMPLED_CYCLES, cycles + 1)
    if output.cycles is not None:
        sampled = len(output.cycles) if isinstance(output.cycles, tuple) else cycles + 1
    nodes = scene.mesh.degree * scene.mesh.contact_elements + 1
    for key, count, advice in (
        ("[history] cycles", cycles, "use fewer"),
        (
            "[output] samples_per_leg",
            sampled * output.samples_per_leg,
            "use fewer, or sample fewer cycles by output.cycles",
        ),
    ):
        size = count * legs * nodes * BYTES_PER_NODE
        if size > MAX_RECORD_BYTES:
            raise InputError(f"{key}: requires a record of {size / 1e9:.0f} GB; {advice}")
