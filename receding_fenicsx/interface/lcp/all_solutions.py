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

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import (
    BATCH,
    EXHAUSTED,
    Choices,
    Indices,
    Problem,
    Undecided,
    batches,
)
from receding_fenicsx.interface.lcp.lemke import covers, solve
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.tolerances import SAME_RATES, TOO_FAR


@dataclass(frozen=True)
class Solutions:
    """Solutions of a rate problem."""

    # (k, N) states of the undecided nodes, 0 elsewhere; a row for each solution
    states: NDArray[np.int8]
    complete: bool  # no other solution exists. Otherwise there may be more than were found


def all_solutions(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> Solutions:
    """Find all solutions of the rate problem, or of a static problem from rest, with other u each.

    The arguments are those of :func:`~receding_fenicsx.interface.lcp.contact.solve_states`.
    LinAlgError: a motion of the freely moving freedoms is left without stiffness.
    """
    problem = Problem.of(system, r0, undecided, open_dofs)
    if not problem.may:
        return Solutions(np.zeros((1, system.n), dtype=np.int8), complete=True)
    tried, complete = _candidates(problem, undecided.sets)
    if not complete:
        tried = chain(tried, (states[None] for states in problem.by_covers()))
    k, stiffness = np.abs(np.diagonal(problem.S)), system.largest_stiffness
    far = TOO_FAR * float(np.abs(problem.s).max(initial=0.0))
    kept, rates = list[NDArray[np.int8]](), list[Array]()
    for states in tried:
        for state, u, loose in zip(*problem.solutions(states), strict=True):
            if stiffness * float(np.abs(u).max(initial=0.0)) > far:
                continue
            complete = complete and not loose
            x = problem.S @ u + problem.s
            scale = max(float(np.abs(k * u).max()), float(np.abs(x).max()))
            if all(np.abs(k * (u - other)).max() > SAME_RATES * scale for other in rates):
                kept.append(state)
                rates.append(u)
    found = np.array(kept, dtype=np.int8).reshape(-1, len(problem.may))
    return Solutions(problem.whole(found), complete)


def _candidates(problem: Problem, sets: int) -> tuple[Iterator[NDArray[np.int8]], bool]:
    """Return (k, m) sets of states that may be solutions, and whether there are no others."""
    free = np.flatnonzero(problem.may_be(SEPARATION))
    sides: Choices = [
        (SEPARATION, STICK) if problem.smooth[i] else (SEPARATION, FORWARD, BACKWARD) for i in free
    ]
    combinations = math.prod(map(len, sides))
    if sets <= BATCH or combinations > 3**6:
        few = sets <= EXHAUSTED
        return (batches(problem.may), True) if few else (iter(()), False)
    found: list[NDArray[np.int8]] = []
    complete = True
    for chosen in product(*sides):
        states = np.array([c[-1] for c in problem.may], dtype=np.int8)
        states[free] = chosen
        part, unique = _with_sides(problem, states, EXHAUSTED // combinations)
        found += part
        complete = complete and unique
    return iter(found), complete


def _with_sides(
    problem: Problem, sides: NDArray[np.int8], most: int
) -> tuple[list[NDArray[np.int8]], bool]:
    """Return candidates with given sides, at most so many sets; whether there are no others."""
    (*_, smooth, friction, S, s), m = problem, len(sides)
    pairs = np.flatnonzero(((sides == FORWARD) | (sides == BACKWARD)) & ~smooth)
    sign = np.where(sides[pairs] == FORWARD, 1.0, -1.0)
    f = np.where(sign > 0.0, friction.forward[pairs], friction.backward[pairs])
    open_ = np.flatnonzero(sides == SEPARATION)
    free = np.concatenate([open_[~smooth[open_]], m + open_])
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
    d = np.sqrt(np.maximum(np.diagonal(M), 0.0))
    definite = d.min(initial=1.0) > 0.0
    if definite and len(M):  # whether the symmetric part of M is positive definite
        size = np.linalg.eigvalsh(0.5 * (M + M.T) / d / d[:, None])
        definite = size[0] > 1e-12 * size[-1]
    states = np.where(np.isin(np.arange(m), pairs), STICK, sides).astype(np.int8)
    if not definite and 2.0 ** len(pairs) <= most:
        slips: Choices = [(STICK, side) if i in pairs else (side,) for i, side in enumerate(sides)]
        return list(batches(slips)), True
    found = []
    for cover in covers(len(pairs)):
        z = solve(M, q, cover)
        if z is not None:
            found.append(states.copy())
            found[-1][pairs[z > 0.0]] = sides[pairs[z > 0.0]]
        if definite and found:
            break
    return [np.array(found)] if found else [], bool(definite and found)
