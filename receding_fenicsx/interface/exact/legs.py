"""Legs to be followed, places on them, and legs joined from pieces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.system import ContactState, Leg

EVENTS_WITHOUT_PROGRESS = 20
"""Events per node within ``SIMULTANEOUS`` of one place after which there is no end of them."""


class Chooser(Protocol):
    """Chooses among several continuations, see :mod:`receding_fenicsx.interface.branches`."""

    def choose(self, found: Any, before: NDArray[np.int8], segment: Any) -> Any:
        """Return the rates to go on with, and bring the path's states to theirs."""
        ...

    def choose_static(self, segments: Any, problem: LegProblem, end: ContactState) -> ContactState:
        """Return the end of a leg from rest to take, ``end`` being the one that was found."""
        ...


@dataclass(frozen=True)
class LegProblem:
    """A leg to be followed from a given state, or a piece of a leg."""

    start: ContactState  # state at ``s_start``
    ends: tuple[Array, Array]  # (n_loads,) load factors at s = 0 and at s = 1
    force_scale: float  # largest nodal force of the history so far
    samples: tuple[float, ...] = ()  # places s at which states are stored, increasing
    s_start: float = 0.0  # place at which ``start`` is
    # where s = 0 and s = 1 lie on the leg of the history, for messages
    part: tuple[float, float] = (0.0, 1.0)
    jumps: int = 0  # jumps on the leg of the history before this piece
    # chooses among several continuations; None takes the first one found
    chooser: Chooser | None = None

    def load(self, s: float) -> Array:
        """Return the (n_loads,) load factors at s, 0 where both ends cancel but for round-off."""
        pairs = zip(*(end.tolist() for end in self.ends), strict=True)
        loads = [(a, b, (1.0 - s) * a + s * b) for a, b in pairs]
        return np.array([x if abs(x) > 4e-15 * max(abs(a), abs(b)) else 0.0 for a, b, x in loads])

    @cached_property
    def way(self) -> bytes:
        """What its direction has as its own."""
        return direction_key(self.ends[1] - self.ends[0])

    def place(self, s: float) -> float:
        """Return where s lies on the leg of the history."""
        return self.part[0] + s * (self.part[1] - self.part[0])

    def piece(
        self,
        start: ContactState,
        ends: tuple[Array, Array],
        force_scale: float,
        s: tuple[float, float],
        jumps: int = 0,
    ) -> LegProblem:
        """Return a piece of this leg as a leg of its own.

        It runs between the places ``s`` of this one, which has had some jumps just before.
        """
        low, high = s
        return replace(
            self,
            start=start,
            ends=ends,
            force_scale=force_scale,
            samples=tuple((p - low) / (high - low) for p in self.samples if low < p <= high),
            s_start=0.0,
            part=(self.place(low), self.place(high)),
            jumps=self.jumps + jumps,
        )


@dataclass
class PathPoint:
    """Contact at one place of a leg, as the quantities of the event search; changed in place."""

    problem: LegProblem  # the leg
    s: float  # place on the leg
    y: Array  # (4N,) quantities [v, gap, A, B]
    state: NDArray[np.int8]  # (N,) states

    @property
    def load(self) -> Array:
        """(n_loads,) load factors."""
        return self.problem.load(self.s)


def direction_key(change: Array) -> bytes:
    """Return what a direction of loading has as its own: rates grow in proportion to the change."""
    return bytes((change / (np.abs(change).max() or 1.0)).tobytes())


def evenly_spaced(samples: int) -> tuple[float, ...]:
    """Return so many places on a leg, the last one at s = 1."""
    return tuple(j / samples for j in range(1, samples + 1))


def widen(changed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the nodes that changed and those within a hundredth of them along the contact."""
    n = len(changed)
    reach = max(2, int(0.01 * n))
    window = np.ones(2 * reach + 1)
    return np.convolve(changed, window, mode="full")[reach : reach + n] > 0.5


def unchanged(problem: LegProblem) -> Leg:
    """Return a leg on which nothing changes."""
    return Leg(
        end=problem.start,
        dissipation=np.zeros(len(problem.start.state)),
        force_scale=problem.force_scale,
        samples=[(s, problem.start) for s in problem.samples],
    )
