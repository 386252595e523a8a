r"""Many sets of states certified by one factorisation.

Take nodes that slip or open, each with one direction of slip, and the rows

    v_i = K_t,i + c_i K_n,i   of all of them,    w_i = alpha K_n,i   of those that may open,

on the columns of their tangential and normal freedoms. If the symmetric part of this one matrix is
positive definite, every set of states in which some of these nodes slip in these directions and
some of those that may open are open is definite: its matrix is a Schur complement of a principal
submatrix, and elimination of an open node does not see that the rows v_i and w_i are combinations
of K_t,i and K_n,i. Nodes that are open in all the sets are condensed out exactly.

Nodes on the edge of contact are judged with slip in either direction. To turn round the slip of a
node changes one row, and the symmetric part by e k' + k e'. With nodes turned round at once it
stays positive definite if

    sum of (a . b + |a| |b|) over them < 1,   with L a = e,  L b = -k,

L being the Cholesky factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD
from receding_fenicsx.interface.uniqueness.definite import SINGULAR, Certificate, cholesky
from receding_fenicsx.interface.uniqueness.sides import Sides, States, mask_of, nodes_of

MOST_TOUCHING = 6
"""Touching nodes of an instant up to which all their sides are judged one by one."""

TURNING_WEIGHT = 10.0
"""Weight of the rows w_i over c^2, from which on the slip of a node that may open is turned round
in most cases: there |a| |b| is about c (K_nn / alpha K_tt)^(1/2)."""


@dataclass(frozen=True)
class Pattern:
    """Sets of states that are definite together; sets of nodes are integers as in ``Sides``.

    Attributes:
        forward, backward: nodes that may slip, and where to.
        opened: nodes that are open in all of its sets.
        may_open: nodes that are open in some.
        rubbing: nodes with friction.
        turning: what it takes to turn round the slip of a node; in all less than 1 is there.
        either: nodes whose slip may be turned round.
    """

    forward: int
    backward: int
    opened: int
    may_open: int
    rubbing: int
    turning: dict[int, float]
    either: int

    def holds(self, one: Sides) -> bool:
        """Return whether all sets of states that the nodes may take are among its sets."""
        forward, backward, open_, touching = one
        if self.opened & ~open_ or (open_ | touching) & ~self.may_open:
            return False
        return self.turns(
            forward & ~self.forward | backward & ~self.backward | touching & self.rubbing
        )

    def turns(self, nodes: int) -> bool:
        """Return whether all of these nodes may slip the other way as well, at once."""
        if not nodes & (nodes - 1):
            return not nodes & ~self.either
        return not nodes & ~self.either and sum(self.turning[i] for i in nodes_of(nodes)) < 1.0


def turned(pattern: Sides, one: Sides) -> int:
    """Return the nodes that slip the other way in a set of states."""
    return pattern.forward & one.backward | pattern.backward & one.forward


def joined(pattern: Sides, one: Sides) -> Sides:
    """Return a pattern with the slipping nodes of a set of states; those it has keep their way."""
    forward, backward, *_ = pattern
    forward, backward = forward | one.forward & ~backward, backward | one.backward & ~forward
    return Sides(forward, backward, pattern.open | one.open, pattern.touching | one.touching)


def grouped(sets: Sequence[Sides]) -> list[list[Sides]]:
    """Sort sets of states into groups that share directions of slip but for one node of each."""
    groups: list[list[Sides]] = []
    united: list[Sides] = []
    for one in sets:
        for k, pattern in enumerate(united):
            other = turned(pattern, one)
            if not other & (other - 1):
                break
        else:
            k = len(groups)
            groups.append([])
            united.append(Sides())
        groups[k].append(one)
        united[k] = joined(united[k], one)
    return groups


def halves(sets: Sequence[Sides]) -> tuple[list[Sides], list[Sides]]:
    """Split a group of at least two: those with fewer open nodes, and the others."""
    ranked = sorted(range(len(sets)), key=lambda k: sets[k].open.bit_count())
    fewer = set(ranked[: len(sets) // 2])
    few, many = list[Sides](), list[Sides]()
    for k, one in enumerate(sets):
        (few if k in fewer else many).append(one)
    return few, many


def certify(judge: Certificate, sets: Sequence[Sides], margin: float) -> Pattern | None:
    """Certify sets of states with all friction multiplied by a margin.

    Args:
        judge: certificate of the contact.
        sets: sets of states, whose slipping nodes are nodes with friction. Directions that differ
            are those of the first.
        margin: finite factor.

    Returns:
        A pattern, or None. It holds all sets unless too many nodes are turned round or touch. For a
        single set in which none touches None means that it is not definite with this friction.
    """
    pattern, either, opened = Sides(), 0, sets[0].open
    for one in sets:
        either |= turned(pattern, one)
        pattern = joined(pattern, one)
        opened &= one.open
    may_open, rubbing = pattern.open | pattern.touching, judge.rubbing
    varying = may_open & ~opened
    unsigned = varying & rubbing & ~(pattern.forward | pattern.backward)
    forward, backward = pattern.forward | unsigned, pattern.backward
    n = judge.system.n
    state = Sides(forward, backward).states(n)
    opening = np.flatnonzero(mask_of(varying, n) & ~judge.system.held[n:])
    try:
        matrix, K_n = _matrix(judge, (state, opening, opened), margin)
        lower = cholesky(0.5 * (matrix + matrix.T))
    except np.linalg.LinAlgError:
        return None
    may_turn = np.flatnonzero(mask_of(either | pattern.touching & rubbing, n))
    turning = _turning(judge, (state, may_turn), (lower, K_n), margin) if len(may_turn) else []
    weights = dict(zip(may_turn.tolist(), turning, strict=True))
    either = sum(1 << i for i, weight in weights.items() if weight < 1.0)
    return Pattern(forward, backward, opened, may_open, rubbing, weights, either)


def definite(judge: Certificate, one: Sides, margin: float) -> bool:
    """Return whether all sets of states that the nodes may take are definite.

    Where too many nodes touch it is not decided, and False.
    """
    pattern = certify(judge, [one], margin)
    if pattern is not None and pattern.holds(one):
        return True
    few = 0 < one.touching.bit_count() <= MOST_TOUCHING
    return few and all(definite(judge, each, margin) for each in one.explicit(judge.rubbing))


def _matrix(
    judge: Certificate, nodes: tuple[States, np.ndarray, int], margin: float
) -> tuple[Array, Array]:
    """Return the rows v and w, and K_n of the slipping nodes, on the same columns.

    Args:
        judge: certificate of the contact.
        nodes: (N,) states, slip in all nodes of the pattern; nodes that may open; those that are
            open.
        margin: factor on friction.

    Raises:
        np.linalg.LinAlgError: something moves without stiffness.
    """
    (state, may_open, opened), n = nodes, judge.system.n
    slips = judge.slipping(state)
    rows = np.concatenate([slips, n + may_open, n + slips])
    size, m = len(slips) + len(may_open), len(slips)
    K = judge.condensed(rows, size, opened)
    if np.any(np.diagonal(K) <= SINGULAR * np.diagonal(judge.system.K)[rows[:size]]):
        raise np.linalg.LinAlgError
    c = margin * judge.system.friction[slips].at_slip(state[slips])
    matrix = K[:size]
    matrix[:m] += c[:, None] * K[size:]
    if size > m:
        largest = np.abs(c).max(initial=0.0)
        # keeps (1 + alpha) K_tn + C K_nn, the coupling, small against alpha K_nn
        balanced = np.hypot(1.0, largest / judge.coupling)
        matrix[m:] *= max(balanced, TURNING_WEIGHT * largest**2)
    return matrix, K[size:]


def _turning(
    judge: Certificate,
    nodes: tuple[States, np.ndarray],
    factored: tuple[Array, Array],
    margin: float,
) -> list[float]:
    """Return what it takes to turn round the slip of each of some nodes, round-off included."""
    (state, chosen), (lower, K_n) = nodes, factored
    friction = judge.system.friction[chosen]
    now = state[chosen]
    change = friction.at_slip(np.where(now == FORWARD, BACKWARD, FORWARD)) - friction.at_slip(now)
    at = np.searchsorted(judge.slipping(state), chosen)
    e, k = np.zeros((len(lower), len(chosen))), (0.5 * margin * change[:, None] * K_n[at]).T
    e[at, np.arange(len(chosen))] = 1.0
    a, b = np.hsplit(sla.solve_triangular(lower, np.hstack([e, -k]), lower=True), 2)
    size = np.sqrt(np.sum(a * a, axis=0) * np.sum(b * b, axis=0))
    weights: list[float] = (np.sum(a * b, axis=0) + size + SINGULAR).tolist()
    return weights
