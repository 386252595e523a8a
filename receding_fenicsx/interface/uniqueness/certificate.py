"""Certificates of sets of states: definiteness of the matrix of the rate problem, and its margin.

With K' condensed of what moves at zero reaction, one set of states is judged as
:mod:`receding_fenicsx.interface.uniqueness` says.

**Many sets by one factorisation.** Take nodes that slip or open, each with one direction of slip,
and the rows

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
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.system import ContactSystem, pinned_stiffness
from receding_fenicsx.interface.uniqueness.instants import Sides, States, bits_of, mask_of, nodes_of

SINGULAR = 1e-11
"""Pivot of a Cholesky factorisation over the diagonal entry, or coupling over the stiffness, below
which it counts as zero."""


class Certificate:
    """Judges sets of states of one contact; an answer depends on the set alone.

    Attributes:
        frictional: (N,) nodes with the full contact law.
        smooth: (N,) nodes without friction, or held tangentially.
        rubbing: the frictional nodes, as an integer.
        loose: freedoms that move at zero reaction in every set of states.
        coupling: size of K_tn over that of K_nn.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Prepare for a system of ``kind = "frictional"``."""
        n = system.n
        self.system = system
        normal = ~system.held[n:]
        self.frictional = ~system.held[:n] & normal & system.friction.present
        self.smooth = normal & ~self.frictional
        self.loose = np.flatnonzero(~system.held[:n] & ~self.frictional)
        self.rubbing = bits_of(self.frictional)
        K_tn, K_nn = (float(np.linalg.norm(K)) for K in (system.K[:n, n:], system.K[n:, n:]))
        self.coupling = max(K_tn / K_nn, SINGULAR) if K_nn else SINGULAR
        self._factor: tuple[int, tuple[NDArray[np.intp], Array]] | None = None

    def slipping(self, state: States) -> NDArray[np.intp]:
        """Return the nodes that slip against friction."""
        return np.flatnonzero(self.frictional & ((state == FORWARD) | (state == BACKWARD)))

    def undecided(self, sides: Sides) -> Undecided:
        """Return the nodes that the rate problem decides where all on a limit slip or touch."""
        touching = np.array(nodes_of(sides.touching), dtype=np.intp)
        forward, backward = (
            np.flatnonzero(self.frictional & mask_of(bits, self.system.n)) for bits in sides[:2]
        )
        smooth = self.smooth[touching]
        return Undecided(forward, backward, touching[~smooth], touching[smooth])

    def free(self, open_: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the freedoms that move at zero reaction where some nodes are open."""
        n, held = self.system.n, self.system.held
        v, w = np.flatnonzero(open_ & self.frictional), np.flatnonzero(open_ & ~held[n:])
        return np.concatenate([v, self.loose, n + w])

    def matrices(self, state: States) -> tuple[Array, Array]:
        """Return K'_tt and C K'_nt of the slipping nodes; LinAlgError as :meth:`condensed`."""
        system, slips = self.system, self.slipping(state)
        m = len(slips)
        rows = np.concatenate([slips, system.n + slips])
        K = self.condensed(rows, m, bits_of(state == SEPARATION))
        return K[:m], system.friction[slips].at_slip(state[slips])[:, None] * K[m:]

    def condensed(self, rows: NDArray[np.intp], columns: int, open_: int) -> Array:
        """Return rows of K', of some open nodes, on the first of these freedoms as columns.

        LinAlgError: what moves freely, or with one of these, has a motion without stiffness.
        """
        if self._factor is None or self._factor[0] != open_:
            free = self.free(mask_of(open_, self.system.n))
            self._factor = open_, (free, cholesky(pinned_stiffness(self.system, free)))
        free, factor = self._factor[1]
        K = self.system.K[rows][:, rows[:columns]]
        if len(free) and len(rows):
            coupled = self.system.K[free][:, rows]
            half = sla.solve_triangular(factor, coupled, lower=True, check_finite=False)
            K -= half.T @ half[:, :columns]
        # what remains of a motion without stiffness is round-off
        if np.any(np.diagonal(K) <= SINGULAR * np.diagonal(self.system.K)[rows[:columns]]):
            raise np.linalg.LinAlgError
        return K

    def margin(self, state: States) -> tuple[float, tuple[int, ...]]:
        """Return phi of a set of states, and the leading nodes of the critical slip mode.

        It is 0 where something moves without stiffness, infinite where nothing slips or friction
        only stiffens.
        """
        slips = self.slipping(state)
        try:
            K_tt, X = self.matrices(state)
            if not len(slips):
                return np.inf, ()
            cholesky(K_tt)
        except np.linalg.LinAlgError:
            return 0.0, tuple(slips.tolist())
        last = len(slips) - 1
        size, mode = sla.eigh(-0.5 * (X + X.T), K_tt, subset_by_index=[last, last])
        # below this the eigenvalue is round-off
        if size[0] <= SINGULAR:
            return np.inf, ()
        large = np.abs(mode[:, 0])
        return float(1.0 / size[0]), tuple(slips[large >= 0.5 * large.max()].tolist())


def cholesky(matrix: Array) -> Array:
    """Return the lower factor; LinAlgError where not positive definite, or by round-off only."""
    factor = np.linalg.cholesky(matrix)
    if np.any(np.diagonal(factor) ** 2 <= SINGULAR * np.diagonal(matrix)):
        raise np.linalg.LinAlgError
    return factor


@dataclass(frozen=True)
class Pattern:
    """Sets of states that are definite together; sets of nodes are integers as in ``Sides``."""

    # forward, backward: nodes that may slip, and where to
    forward: int
    backward: int
    opened: int  # nodes that are open in all of its sets
    may_open: int  # nodes that are open in some
    rubbing: int  # nodes with friction
    # what it takes to turn round the slip of a node; in all less than 1 is there
    turning: dict[int, float]
    either: int  # nodes whose slip may be turned round

    def holds(self, one: Sides) -> bool:
        """Return whether all sets of states that the nodes may take are among its sets."""
        forward, backward, open_, touching = one
        if self.opened & ~open_ or (open_ | touching) & ~self.may_open:
            return False
        # these slip the other way as well, at once
        nodes = forward & ~self.forward | backward & ~self.backward | touching & self.rubbing
        if nodes & ~self.either:
            return False
        return not nodes & (nodes - 1) or sum(self.turning[i] for i in nodes_of(nodes)) < 1.0


def certify(judge: Certificate, sets: Sequence[Sides], margin: float) -> Pattern | None:
    """Certify sets of states with all friction multiplied by a margin.

    Slipping nodes of the sets are nodes with friction; directions that differ are those of the
    first. The pattern holds all sets unless too many nodes are turned round or touch. Of a single
    set in which none touches None means that it is not definite with this friction.
    """
    forward = backward = either = may_open = touching = 0
    opened = sets[0].open
    for one in sets:
        either |= forward & one.backward | backward & one.forward
        forward, backward = forward | one.forward & ~backward, backward | one.backward & ~forward
        opened, touching = opened & one.open, touching | one.touching
        may_open |= one.open | one.touching
    system, n, rubbing = judge.system, judge.system.n, judge.rubbing
    varying = may_open & ~opened
    forward |= varying & rubbing & ~backward
    state = Sides(forward, backward).states(n)
    # the rows v and w, and K_n of the slipping nodes, on the same columns
    slips, opening = judge.slipping(state), np.flatnonzero(mask_of(varying, n) & ~system.held[n:])
    rows = np.concatenate([slips, n + opening, n + slips])
    size, m = len(slips) + len(opening), len(slips)
    c = margin * system.friction[slips].at_slip(state[slips])
    try:
        K = judge.condensed(rows, size, opened)
        matrix, K_n = K[:size], K[size:]
        matrix[:m] += c[:, None] * K_n
        largest = np.abs(c).max(initial=0.0)
        # keeps (1 + alpha) K_tn + C K_nn, the coupling, small against alpha K_nn
        balanced = np.hypot(1.0, largest / judge.coupling)
        # weight of the rows w_i over c^2, from which on the slip of a node that may open is turned
        # round in most cases: there |a| |b| is about c (K_nn / alpha K_tt)^(1/2)
        matrix[m:] *= max(balanced, 10.0 * largest**2)
        lower = cholesky(0.5 * (matrix + matrix.T))
    except np.linalg.LinAlgError:
        return None
    # what it takes to turn round the slip of a node, round-off included
    turns = np.flatnonzero(mask_of(either | touching & rubbing, n))
    if not len(turns):
        return Pattern(forward, backward, opened, may_open, rubbing, {}, 0)
    friction, now, at = system.friction[turns], state[turns], np.searchsorted(slips, turns)
    change = friction.at_slip(np.where(now == FORWARD, BACKWARD, FORWARD)) - friction.at_slip(now)
    e, k = np.zeros((size, len(turns))), (0.5 * margin * change[:, None] * K_n[at]).T
    e[at, np.arange(len(turns))] = 1.0
    a, b = np.hsplit(sla.solve_triangular(lower, np.hstack([e, -k]), lower=True), 2)
    length = np.sqrt(np.sum(a * a, axis=0) * np.sum(b * b, axis=0))
    weights = dict(zip(turns.tolist(), np.sum(a * b, axis=0) + length + SINGULAR, strict=True))
    either = sum(1 << i for i, weight in weights.items() if weight < 1.0)
    return Pattern(forward, backward, opened, may_open, rubbing, weights, either)


def definite(judge: Certificate, one: Sides, margin: float) -> bool:
    """Return whether all sets of states that the nodes may take are definite.

    Where too many nodes touch it is not decided, and False.
    """
    pattern = certify(judge, [one], margin)
    if pattern is not None and pattern.holds(one):
        return True
    return one.touches_few and all(
        definite(judge, each, margin) for each in one.explicit(judge.rubbing)
    )
