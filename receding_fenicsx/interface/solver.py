"""Protocol of a solver: what the evolution of a load history needs to follow its legs."""

from __future__ import annotations

from typing import Protocol

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.system import ContactState, Leg


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

        Args:
            start: state at the leg's start.
            ends: load factors at its start and at its end.
            force_scale: largest nodal force of the history so far.

        Raises:
            SolveError: no state that satisfies the contact law was found.
        """
        ...
