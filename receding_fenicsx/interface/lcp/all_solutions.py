"""All solutions of the rate problem: every way in which a contact can go on from an instant.

The undecided nodes of :class:`~receding_fenicsx.interface.lcp.contact.Undecided` may take several
states each. Few sets of states are all tried. Where there are many, most belong to slipping nodes,
which may stick: then the few nodes that touch without pressure get a *side* each, open, the forward
or the backward side of the friction cone, and the slipping ones and those of the sides satisfy

    y = q + M z,  y >= 0,  z >= 0,  y . z = 0,    M = T (K_tt + T F K_nt) T,

with T = diag(+-1) for forward and backward slip and K condensed of all that moves freely. If the
symmetric part of M is positive definite there is exactly one z for these sides (Cottle, Pang &
Stone, The Linear Complementarity Problem, 1992, theorem 3.1.6); it is a solution of the whole
problem if it keeps the conditions of the sides, P >= 0 and gap >= 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import (
    BATCH,
    COVERS,
    EXHAUSTED,
    Choices,
    Indices,
    Undecided,
    batches,
    choices,
    condensed,
    number_of_sets,
    problem_of_nodes,
    solutions,
    states_by_covers,
)
from receding_fenicsx.interface.lcp.lemke import solve
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SAME_RATES, TOO_FAR

TRIED_AT_ONCE = BATCH
"""Sets of states up to which all are tried, without looking at sides: those of six nodes."""


@dataclass(frozen=True)
class Solutions:
    """Solutions of a rate problem."""

    # (k, N) states of the undecided nodes, 0 elsewhere; a row for each solution
    states: NDArray[np.int8]
    complete: bool  # no other solution exists. Otherwise there may be more than were found


def all_solutions(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> Solutions:
    """Find all solutions of the rate problem, or of a static problem from rest.

    Args:
        system: the condensed body in 2N form.
        r0: (2N,) reactions (or their rates) with no further displacement.
        undecided: the nodes to decide.
        open_dofs: degrees of freedom (of the 2N) that move freely at zero reaction.

    Raises:
        np.linalg.LinAlgError: a motion of the freely moving freedoms is left without stiffness.
    """
    may = choices(undecided)
    if not may:
        return Solutions(np.zeros((1, system.n), dtype=np.int8), complete=True)
    args = system, r0, undecided, open_dofs
    problem = _Problem(*args)
    tried, complete = problem.candidates()
    if not complete:
        by_covers = (states[None, list(may)] for states in states_by_covers(*args))
        tried = chain(tried, by_covers)
    found = problem.distinct(tried)
    states = np.zeros((len(found), system.n), dtype=np.int8)
    states[:, list(may)] = found
    return Solutions(states, complete)


class _Problem:
    """Rate problem of the undecided nodes, order: forward, backward, touching, smooth ones.

    Attributes:
        S: (2m, 2m) stiffness condensed to them, order [v; w]; a smooth node's v does not matter.
        s: (2m,) reactions with no further displacement.
        friction: (m,) coefficients.
        stiffness: the largest one of a freedom of the body.
        may: states that each node may take.
        smooth: (m,) nodes without friction pair.
    """

    def __init__(
        self, system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
    ) -> None:
        S, s = condensed(system, r0, undecided, open_dofs)
        problem = problem_of_nodes(system, undecided, S, s)
        self.S, self.s, self.friction, self.may, self.smooth = problem
        self.stiffness = float(np.diagonal(system.K).max(initial=0.0))

    def candidates(self) -> tuple[Iterator[NDArray[np.int8]], bool]:
        """Return (k, m) sets of states that may be solutions, and whether there are no others."""
        sets = number_of_sets(self.may)
        free = np.flatnonzero([SEPARATION in c for c in self.may])
        sides: Choices = [
            (SEPARATION, STICK) if self.smooth[i] else (SEPARATION, FORWARD, BACKWARD) for i in free
        ]
        combinations = number_of_sets(sides)
        if sets <= TRIED_AT_ONCE or combinations > 3**6:
            few = sets <= EXHAUSTED
            return (batches(self.may), True) if few else (iter(()), False)
        found: list[NDArray[np.int8]] = []
        complete = True
        for chosen in product(*sides):
            states = np.array([c[-1] for c in self.may], dtype=np.int8)
            states[free] = chosen
            part, unique = self._with_sides(states, EXHAUSTED // combinations)
            found += part
            complete = complete and unique
        return iter(found), complete

    def _with_sides(
        self, sides: NDArray[np.int8], most: int
    ) -> tuple[list[NDArray[np.int8]], bool]:
        """Return candidates with given sides, at most so many sets; whether there are no others."""
        S, s, m = self.S, self.s, len(sides)
        pairs = np.flatnonzero(((sides == FORWARD) | (sides == BACKWARD)) & ~self.smooth)
        sign = np.where(sides[pairs] == FORWARD, 1.0, -1.0)
        f = np.where(sign > 0.0, self.friction.forward[pairs], self.friction.backward[pairs])
        open_ = np.flatnonzero(sides == SEPARATION)
        free = np.concatenate([open_[~self.smooth[open_]], m + open_])
        mix = np.zeros((len(pairs), 2 * m))
        mix[np.arange(len(pairs)), pairs] = sign
        mix[np.arange(len(pairs)), m + pairs] = f
        if len(free):
            try:
                gone = np.linalg.solve(S[np.ix_(free, free)], np.column_stack([S[free], s[free]]))
            except np.linalg.LinAlgError:  # a motion that nothing resists
                return [], False
            S, s = S - S[:, free] @ gone[:, :-1], s - S[:, free] @ gone[:, -1]
        M, q = mix @ S[:, pairs] * sign, mix @ s
        definite = _is_definite(M)
        states = np.where(np.isin(np.arange(m), pairs), STICK, sides).astype(np.int8)
        if not definite and 2.0 ** len(pairs) <= most:
            slips: Choices = [
                (STICK, side) if i in pairs else (side,) for i, side in enumerate(sides)
            ]
            return list(batches(slips)), True
        found = []
        random = np.random.default_rng(0).uniform(0.1, 1.0, (COVERS - 1, len(pairs)))
        for cover in np.vstack([np.ones(len(pairs)), random]):
            z = solve(M, q, cover)
            if z is not None:
                found.append(states.copy())
                found[-1][pairs[z > 0.0]] = sides[pairs[z > 0.0]]
            if definite and found:
                break
        return [np.array(found)] if found else [], definite and bool(found)

    def distinct(self, tried: Iterator[NDArray[np.int8]]) -> NDArray[np.int8]:
        """Return those sets of states that are solutions, one for each different u."""
        k = np.abs(np.diagonal(self.S))
        far = TOO_FAR * float(np.abs(self.s).max(initial=0.0))
        kept: list[NDArray[np.int8]] = []
        rates: list[Array] = []
        for states in tried:
            found = solutions(self.S, self.s, self.friction, states, self.may, self.smooth)
            for state, u in zip(*found, strict=True):
                if self.stiffness * float(np.abs(u).max(initial=0.0)) > far:
                    continue
                x = self.S @ u + self.s
                scale = max(float(np.abs(k * u).max()), float(np.abs(x).max()))
                if all(np.abs(k * (u - other)).max() > SAME_RATES * scale for other in rates):
                    kept.append(state)
                    rates.append(u)
        return np.array(kept, dtype=np.int8).reshape(-1, len(self.may))


def _is_definite(M: Array) -> bool:
    """Return whether the symmetric part of M is positive definite."""
    if len(M) == 0:
        return True
    d = np.sqrt(np.maximum(np.diagonal(M), 0.0))
    if d.min() == 0.0:
        return False
    size = np.linalg.eigvalsh(0.5 * (M + M.T) / d / d[:, None])
    return bool(size[0] > 1e-12 * size[-1])
