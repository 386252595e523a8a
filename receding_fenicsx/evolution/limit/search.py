"""Search for the state whose cycle repeats itself for ever, from the start of some cycle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.limit.drifts import at_risk
from receding_fenicsx.evolution.limit.frozen import Budget, Frozen, NoLimit
from receding_fenicsx.evolution.limit.frozen_cycle import MovedCycle
from receding_fenicsx.evolution.limit.newton import REPEATS, Solution, approach
from receding_fenicsx.evolution.limit.sorting import Sorted, sort_nodes
from receding_fenicsx.interface.exact.legs import widen
from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.unloading import carries_nothing, zero_crossing
from receding_fenicsx.interface.law import SLIP_SIGN, STICK
from receding_fenicsx.interface.measures.steady import SLIP_ROUND_OFF
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.solver import Solver
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

MAX_SORTS = 10
"""Sortings of the nodes after which the search is given up."""

VIOLATED = 1e-11
"""Margin of a frozen node below zero, over the largest nodal force, that is no round-off."""

CERTAIN = 2.0
"""Margin of a frozen node below zero, over the natural map of those that drift, by which it slips
in the limit, too."""

FEW = 2
"""Nodes freed before any Newton step below which one is taken before the next sorting: there the
zone of those that slip both ways grows node by node."""


@dataclass(frozen=True)
class Candidate:
    """State at the start of a cycle that should repeat itself.

    Attributes:
        state: the state.
        steps: Newton steps.
        residual: natural map of drifts and margins, over the largest nodal force; of a body that
            walks, change of the forces.
        found: contact and cycle with frozen nodes; None for a body that walks.
        moved: derivatives of the cycle in the shifts; None where no node drifts.
    """

    state: ContactState
    steps: int
    residual: float
    found: tuple[Frozen, Solution] | None = None
    moved: MovedCycle | None = None

    def lacking(self, ends: list[ContactState]) -> Array:
        """Return what nodes lack (j, N) at the ends of cycles; less than 0 beyond their limit.

        What free nodes lack has either sign.

        Raises:
            NoLimit: nodes have moved that stick on the way to this limit.
        """
        assert self.found is not None
        frozen, solution = self.found
        give = SLIP_ROUND_OFF * frozen.force / local_stiffness(frozen.system)[0]
        at_rest = np.setdiff1d(frozen.nodes, frozen.shifted)
        moved = np.array([end.v for end in ends]) - solution.cycle.start.v
        if np.any(np.abs(moved[-1])[at_rest] > give[at_rest]):
            raise NoLimit("nodes slip that were to stick in the limit that was found")
        left = -moved
        left[:, frozen.shifted] += solution.shifts
        left[:, at_rest] = 0.0
        x = solution.shifts
        drifting = left[:, frozen.shifted]
        left[:, frozen.shifted] = np.where(x == 0.0, -np.abs(drifting), np.sign(x) * drifting)
        return left


def find_limit(
    model: ContactSystem,
    solver: Solver,
    start: ContactState,
    loop: Array,
    force: float,
    budget: Budget,
) -> Candidate:
    """Find the state to which the starts of cycles tend.

    Args:
        model: the condensed body in 2N form.
        solver: plays the cycle by which the nodes are sorted.
        start: state at the start of a cycle.
        loop: (m + 1, n_loads) load factors of a cycle.
        force: largest nodal force of the history so far.
        budget: cycles that may be played; it counts them.

    Raises:
        NoLimit: none was found.
    """
    steps = 0
    if carries_nothing(start, force) or any(zero_crossing(leg) for leg in pairwise(loop)):
        raise NoLimit("the contact is unloaded in the cycle, and begins anew")
    try:
        budget.take()
        nodes = sort_nodes(model, solver, start, loop, force)
        shift, near, creeping, frozen = np.zeros(model.n), None, False, None
        for _ in range(MAX_SORTS):
            held, shifted = np.flatnonzero(nodes.frozen), np.flatnonzero(nodes.drifting)
            opens = widen(nodes.opens)
            frozen = Frozen(model, held, shifted, loop, force, budget, opens, frozen)
            if near is not None:
                u = near.u.copy()
                u[shifted] -= shift[shifted]
                # a node that slipped when it was free sticks as soon as it is frozen
                stops = nodes.frozen & (SLIP_SIGN[near.state] != 0.0)
                near = replace(near, u=u, state=np.where(stops, STICK, near.state).astype(np.int8))
            first = replace(start, state=np.where(nodes.frozen, STICK, start.state).astype(np.int8))
            for solution in approach(frozen, first, shift[shifted], near):
                if creeping and not (solution.steps or solution.settled):
                    continue
                again = _sorted_again(frozen, solution, nodes)
                if again is not None:
                    break
            steps += solution.steps
            at_once = near is not None and not solution.steps
            near, shift = _unfrozen(frozen, solution), np.zeros(model.n)
            shift[shifted] = solution.shifts
            if again is None:
                moved = frozen.periodic_change(solution.cycle) if len(shifted) else None
                others = () if moved is None else at_risk(frozen, solution, moved)
                rest = _at_rest(frozen, solution, nodes)
                if not len(others) and not np.any(rest):
                    _check_places(frozen, solution, nodes, shift)
                    return Candidate(near, steps, solution.residual, (frozen, solution), moved)
                again = nodes.with_drifting(others, rest)
                shift[rest] = (near.v - start.v)[rest]
            few = np.count_nonzero(again.frozen != nodes.frozen) < FEW
            creeping, nodes = at_once and few, again
    except SolveError as error:
        raise NoLimit("a cycle with frozen nodes ends early") from error
    except SingularExchange as error:
        raise NoLimit("a cycle with frozen nodes leaves a motion without stiffness") from error
    raise NoLimit(f"the nodes were sorted {MAX_SORTS} times")


def _sorted_again(frozen: Frozen, solution: Solution, nodes: Sorted) -> Sorted | None:
    """Return the nodes sorted anew by a cycle with frozen nodes; None where they are right.

    Nodes that open, violate both margins, or violate one though their drift holds the other, slip
    both ways. Others that violate one drift.
    """
    n, m = frozen.system.n, solution.margins
    least = -frozen.force * (VIOLATED if solution.settled else CERTAIN * solution.residual)
    forward, backward = (np.zeros(n, dtype=bool) for _ in range(2))
    forward[frozen.nodes[m.A < least]] = True
    backward[frozen.nodes[m.B < least]] = True
    drifting = forward | backward
    freed = (forward & backward) | (drifting & nodes.drifting)
    if solution.settled:
        freed |= solution.cycle.opens & nodes.frozen
    if not np.any(freed | drifting):
        return None
    return nodes.with_moved(freed, drifting)


def _at_rest(frozen: Frozen, solution: Solution, nodes: Sorted) -> NDArray[np.bool_]:
    """Return (N,) free nodes that never open, and do not slip both ways in the cycle.

    What they slip is what the cycle lacks of repeating itself.
    """
    u = np.array([stop.u for stop in solution.cycle.stops])
    slip = np.diff(u[:, : frozen.system.n], axis=0)
    forward, backward = np.maximum(slip, 0.0).sum(axis=0), np.maximum(-slip, 0.0).sum(axis=0)
    still: NDArray[np.bool_] = np.minimum(forward, backward) <= REPEATS * np.abs(u).max()
    return nodes.rubbing & ~nodes.frozen & ~solution.cycle.opens & still


def _check_places(frozen: Frozen, solution: Solution, nodes: Sorted, shift: Array) -> None:
    """Raise NoLimit where the place of a node in the limit depends on cycles not played.

    That is so where one that drifts would slip back, and where one that still slips both ways comes
    to rest but not on its friction limit.
    """
    if not nodes.go_on(shift):
        raise NoLimit("some node would slip back on the way to the limit that was found")
    if np.any(nodes.settling[frozen.shifted[solution.active == 0]]):
        raise NoLimit("some node that slips both ways would come to rest on the way")


def _unfrozen(frozen: Frozen, solution: Solution) -> ContactState:
    """Return the state at the start of the cycle, the shifts added to the displacements."""
    end = solution.cycle.end
    u = end.u.copy()
    u[frozen.shifted] += solution.shifts
    return ContactState(u, reactions(frozen.system, frozen.loop[0], u), end.state.copy())
