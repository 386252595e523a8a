"""Solvers by their names in ``[solver] method``."""

from __future__ import annotations

from collections.abc import Callable

from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.exact.legs import Chooser
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions
from receding_fenicsx.interface.load_steps.path import GaussSeidelPath
from receding_fenicsx.interface.solver import Solver
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import SolverOptions


def _exact(system: ContactSystem, options: SolverOptions) -> Solver:
    return EventPath(system, on_jump=options.on_jump)


def _gauss_seidel(system: ContactSystem, options: SolverOptions) -> Solver:
    sweeps = GaussSeidelOptions(
        over_relaxation=options.over_relaxation,
        polish=options.polish,
        change_tolerance=options.change_tolerance,
        residual_tolerance=options.residual_tolerance,
        max_sweeps=options.max_sweeps,
    )
    return GaussSeidelPath(system, sweeps, options.steps_per_leg, options.on_jump)


SOLVERS: dict[str, Callable[[ContactSystem, SolverOptions], Solver]] = {
    "events": _exact,
    "gauss-seidel": _gauss_seidel,
}
"""Makers of solvers, by method."""


def make_solver(
    system: ContactSystem, options: SolverOptions, chooser: Chooser | None = None
) -> Solver:
    """Return a new solver of the method asked for.

    Args:
        system: the condensed body, ``kind = "frictional"``.
        options: method and tolerances.
        chooser: chooses among several continuations of the exact path; None takes the first.

    Raises:
        InputError: there is no such method.
    """
    if options.method not in SOLVERS:
        raise InputError(f'method "{options.method}": is unknown; use one of {", ".join(SOLVERS)}')
    if chooser is not None:
        return EventPath(system, on_jump=options.on_jump, chooser=chooser)
    return SOLVERS[options.method](system, options)
