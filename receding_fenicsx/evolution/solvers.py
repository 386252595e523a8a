"""Solvers that follow the legs of a load history, by their names in ``[solver] method``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Protocol

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.exact.legs import Chooser
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions
from receding_fenicsx.interface.load_steps.path import GaussSeidelPath
from receding_fenicsx.interface.shear_branches.path import BranchedPath
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg
from receding_fenicsx.scene.model import SolverOptions


def _exact(system: ContactSystem, options: SolverOptions) -> Solver:
    if system.has_branches:
        return BranchedPath(system, options.on_jump)
    return EventPath(system, on_jump=options.on_jump)


def _gauss_seidel(system: ContactSystem, options: SolverOptions) -> Solver:
    names = {field.name for field in fields(options)} & {f.name for f in fields(GaussSeidelOptions)}
    sweeps = GaussSeidelOptions(**{name: getattr(options, name) for name in names})
    if system.has_branches:
        return BranchedPath(system, options.on_jump, sweeps, options.steps_per_leg)
    return GaussSeidelPath(system, sweeps, options.steps_per_leg, options.on_jump)


SOLVERS: dict[str, Callable[[ContactSystem, SolverOptions], Solver]] = {
    "events": _exact,
    "gauss-seidel": _gauss_seidel,
}
"""Makers of solvers, by method."""


def make_solver(
    system: ContactSystem, options: SolverOptions, chooser: Chooser | None = None
) -> Solver:
    """Return a new solver of a method for a system of ``kind = "frictional"``.

    ``chooser`` chooses among several continuations of the exact path; None takes the first.
    """
    if options.method not in SOLVERS:
        raise InputError(f'method "{options.method}": is unknown; use one of {", ".join(SOLVERS)}')
    if chooser is not None:
        return EventPath(system, on_jump=options.on_jump, chooser=chooser)
    return SOLVERS[options.method](system, options)


class Solver(Protocol):
    """Follows straight legs of a load path on one system of ``kind = "frictional"``.

    A solver may keep factors, rates and limits of earlier legs. The evolution makes a new one at
    each checkpoint, so that a resumed run equals an undisturbed one bit by bit.
    """

    def trace_leg(
        self, start: ContactState, ends: tuple[Array, Array], force_scale: float, samples: int = 0
    ) -> Leg:
        """Follow one leg.

        Args:
            start: state at the leg's start; it must not be changed.
            ends: (n_loads,) load factors at its start and at its end.
            force_scale: largest nodal force of the history so far.
            samples: number of states to keep along the leg, the last one at s = 1.

        Returns:
            The leg: its end, dissipation, work, residual, samples and events.

        Raises:
            SolveError: no path that satisfies the contact law was found.
        """
        ...

    def static_leg(self, start: ContactState, ends: tuple[Array, Array], force_scale: float) -> Leg:
        """Solve one static problem at the end of a leg; slip is counted from ``start``.

        Arguments and errors are those of :meth:`trace_leg`.
        """
        ...
