"""Evolve a condensed contact along a load history, cycle after cycle, into a Record."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from receding_fenicsx.arrays import Array, check_types
from receding_fenicsx.errors import InputError, NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.evolution.collect import record_of
from receding_fenicsx.evolution.histories import with_corners
from receding_fenicsx.evolution.instants import end_of
from receding_fenicsx.evolution.journal import Journal
from receding_fenicsx.evolution.limit.search import LimitSearch, Progress
from receding_fenicsx.evolution.problem import Problem, problem_of_history, problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.run_state import RunState, check_force_range
from receding_fenicsx.interface.branches.choice import Chooser, by_key
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem, softest_motion
from receding_fenicsx.scene.history import History, ended_by
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions

NEARLY_LOOSE = 1e-7
"""Stiffness of the softest motion, over that of the stiffest, below which a refusal names it."""


def evolve(
    system: ContactSystem,
    history: Scene | History,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
    initial_slip: Array | None = None,
    progress: Progress | None = None,
    until: str | None = None,
) -> Record:
    """Evolve the contact from rest along a history (eqs. 4 to 15 of Ahn & Barber 2008).

    ``evolve(system, scene)`` plays a whole scene on the body that the system was condensed from:
    friction, gap, history, initial slip, solver and output are the scene's. The record equals that
    of :func:`~receding_fenicsx.studies.run.run` bit by bit. The corners of a harmonic history are
    doubled until they meet its tolerance; the record's scene has their number.

    ``evolve(system, History(...))`` plays a path of load factors on the system as it is. The
    record's ``scene_toml`` is then empty.

    Args:
        system: the condensed body.
        history: a scene; or a path from rest, then cycles.
        solver: method and tolerances; not with a scene.
        output: which cycles get samples and events, and how many samples a leg; not with a scene.
        initial_slip: (N,) tangential displacement at rest from which the first slip is counted; the
            first leg is then one static problem. It is ignored at open nodes. Not with a scene.
        progress: called after every cycle, and in searches for the limit.
        until: "steady" stops when the steady state is reached; "limit" finds the limit of
            infinitely many cycles (:mod:`receding_fenicsx.evolution.limit`). Default: as the
            history says.

    Returns:
        The record of the whole contact.

    Raises:
        InputError: the scene's body is not the system's, the history's loads are not, an array has
            a wrong length or values without meaning, or an open node lands where the first leg is
            one static problem.
        SolveError: a solver found no answer that satisfies the contact law.
    """
    check_types(
        "evolve",
        system=(system, ContactSystem),
        history=(history, Scene, History),
        solver=(solver, SolverOptions, None),
        output=(output, OutputOptions, None),
        progress=(progress, Callable, None),
        until=(until, str, None),
    )
    if isinstance(history, Scene):
        if solver is not None or output is not None or initial_slip is not None:
            raise InputError(
                "evolve: a scene brings its own solver, output and initial slip; change the scene "
                "by dataclasses.replace"
            )
        if until is not None:
            history = replace(history, history=replace(history.history, until=until))
        scene, doubling = with_corners(system, history)
        journal = Journal(scene.output.checkpoint_cycles)
        record = continue_history(problem_of_scene(system, scene), journal, progress)
        record.doubling = doubling
        return record
    if until is not None:
        history = ended_by(history, until)
    problem = problem_of_history(system, history, solver, output, initial_slip)
    return continue_history(problem, Journal(), progress)


def evolve_bare(system: ContactSystem, scene: Scene) -> Record:
    """Return the record of a scene without samples, events and uniqueness."""
    bare = replace(scene, output=OutputOptions(samples_per_leg=1, cycles=()))
    problem = problem_of_scene(system, with_corners(system, bare)[0])
    return continue_history(replace(problem, judged=False), Journal())


def continue_history(
    problem: Problem, journal: Journal, progress: Progress | None = None
) -> Record:
    """Evolve a problem from the end of the last cycle of its journal, from rest if it has none.

    At each checkpoint of the journal the solver is replaced by a new one, so that a run resumed
    there equals an undisturbed one bit by bit. The ``record`` of a SolveError holds the history up
    to the leg that failed.
    """
    cycles, history = journal.cycles, problem.history
    if problem.chooser is not None:
        problem.chooser.log |= by_key(choice for cycle in cycles for choice in cycle.choices)
    run = RunState(problem, cycles)
    run.sample_finished()
    # the limit is searched along the first continuation only
    searches = history.until_limit and problem.chooser is None
    search = LimitSearch(problem, cycles) if searches else None
    try:
        for number in range(len(cycles), problem.last_cycle + 1):
            if run.steady.cycle >= 0 and (history.until_steady or search is not None):
                break
            if search is not None and search.is_due(number) and search.found(cycles, progress):
                break
            if number == 1:
                check_force_range(run.model, history, run.position.totals.force_scale)
            if journal.add(run.trace_cycle(number)):
                run.restart()
                journal.checkpoint()
            run.steady.add(end_of(cycles[number]))
            if progress is not None and number > 0:
                progress(number, history.cycles, _message(run, number))
    except SolveError as error:
        unfinished = run.corners, run.position.totals, run.uniqueness.found
        error.record = record_of(problem.system, problem.solver, cycles, unfinished)
        error.record.choices = () if problem.chooser is None else problem.chooser.choices
        chosen = problem.solver.method == "events" and not problem.system.has_branches
        if isinstance(error, NoQuasiStaticContinuation) and chosen:
            found = error.record.uniqueness
            text = Chooser().text() if found and found.certified else _choices_before(problem)
            error.args = (f"{error}; {text}",)
        body = problem.system
        soft = softest_motion(body.K, body.held, body.rigid)
        if soft < NEARLY_LOOSE and not isinstance(error, NoEquilibrium):
            error.args = (
                f"{error}; the softest motion of the body is {soft:.0e} as stiff as the stiffest: "
                "forces so small beside the largest, which round-off hides, decide here; stiffen "
                "the springs that hold the body, or add a [[support]]",
            )
        raise
    last = None if search is not None and search.steady is not None else run.sample_last()
    record = record_of(problem.system, problem.solver, cycles, last=last, watch=run.steady)
    if search is not None:
        search.tell(record)
    return record


def _choices_before(problem: Problem) -> str:
    """Return in words which choices between continuations a path that ends has made.

    Where they have not been looked for on the way, the path is followed once more.
    """
    chooser = problem.chooser
    if chooser is None:
        chooser, output = Chooser(), OutputOptions(samples_per_leg=1, cycles=())
        with suppress(SolveError):
            continue_history(replace(problem, chooser=chooser, output=output), Journal())
    return chooser.text()


def _message(run: RunState, number: int) -> str:
    """Return the results of a cycle in words."""
    cycle, before = run.cycles[number], run.cycles[number - 1].totals
    sweeps = f"{cycle.totals.sweeps - before.sweeps} sweeps, " if cycle.totals.sweeps else ""
    D = mirror_of(run.model).factor * cycle.dissipation.sum()
    return (
        f"{cycle.totals.events - before.events} events, {sweeps}"
        f"residual {cycle.totals.residual:.1e}, dissipation {D:.6g}, "
        f"change {run.steady.change[-1]:.1e}"
    )
