"""The contact law of many nodes at once as a linear complementarity problem.

With the slip split into v = z+ - z- and the gap g, Coulomb's and Signorini's conditions at a node
are

    A = Q + f_forward P >= 0  with  z+,  B = f_backward P - Q >= 0  with  z-,  P >= 0  with  g,

each pair complementary (A. Klarbring, 1986). A node that is known to be in contact on one side of
the friction cone keeps one pair. The unknowns may be rates (of nodes on a limit) or the whole
displacements of the static problem of a first load.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, Friction
from receding_fenicsx.interface.lcp import enumerate_states, lemke
from receding_fenicsx.interface.rigid_motions import neutral_motions
from receding_fenicsx.interface.system import ContactSystem

Indices = NDArray[np.intp]

DECIDE_TOLERANCE = 1e-12
"""Part of the largest variable below which a complementary variable counts as zero."""

NO_REACTION = 1e-14
"""Reaction, over the largest one, that is left by round-off where loads have no effect."""

COVERS = 8
"""Covering vectors of Lemke's method that are tried: an added pressure, uniform and then random.

The added reactions lie in the middle of the friction cone and keep A + B = (f_forward +
f_backward) P, so that every point of Lemke's path is a frictional contact too; vectors without that
property end on rays where a solution exists."""


@dataclass(frozen=True)
class Undecided:
    """Nodes whose state the problem has to find; every other node keeps its own.

    Attributes:
        forward: nodes in contact at A = 0: stick or forward slip.
        backward: nodes in contact at B = 0: stick or backward slip.
        touching: nodes with neither gap nor pressure: any state.
        smooth: nodes without friction or held tangentially, neither gap nor pressure.
    """

    forward: Indices
    backward: Indices
    touching: Indices
    smooth: Indices

    @property
    def nodes(self) -> Indices:
        """All of them, sorted."""
        return np.sort(np.concatenate([self.forward, self.backward, self.touching, self.smooth]))


def solve_states(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> NDArray[np.int8] | None:
    """Find the states of the undecided nodes.

    Args:
        system: the condensed body in 2N form.
        r0: (2N,) reactions (or their rates) with no further displacement.
        undecided: the nodes to decide.
        open_dofs: degrees of freedom (of the 2N) that move freely at zero reaction.

    Returns:
        (N,) states of the undecided nodes, 0 elsewhere; None when no solution was found.
    """
    S, s = condensed(system, r0, undecided, open_dofs)
    problem = _Pairs(undecided, system.friction)
    M, q = problem.outputs(problem.columns(S)), problem.outputs(s)
    z = lemke.solve(M, q, problem.covers())
    if z is None:
        return _exhaust(system, undecided, S, s)
    return problem.states_of(system, z, M @ z + q)


def states_by_covers(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> Iterator[NDArray[np.int8]]:
    """Yield the answer of Lemke's method for each covering vector that leads to one.

    Arguments and answers as for :func:`solve_states`; answers may be alike.
    """
    S, s = condensed(system, r0, undecided, open_dofs)
    problem = _Pairs(undecided, system.friction)
    M, q = problem.outputs(problem.columns(S)), problem.outputs(s)
    for cover in problem.covers():
        z = lemke.solve(M, q, [cover])
        if z is not None:
            yield problem.states_of(system, z, M @ z + q)


class _Pairs:
    """Complementary pairs of the undecided nodes.

    Rows of stiffness and reactions: v of the forward, backward and touching nodes, w of the same, w
    of the smooth ones. Variables z: slip of the forward nodes, reversed slip of the backward ones,
    z+, z- and gap of the touching ones, gap of the smooth ones.

    Attributes:
        v_nodes: forward, backward and touching nodes.
    """

    def __init__(self, undecided: Undecided, friction: Friction) -> None:
        self.undecided = undecided
        self.v_nodes = np.concatenate([undecided.forward, undecided.backward, undecided.touching])
        self.friction = friction[self.v_nodes]
        m = len(self.v_nodes)
        forward, backward = len(undecided.forward), len(undecided.backward)
        touching, smooth = len(undecided.touching), len(undecided.smooth)
        self._v, self._w = slice(m), slice(m, 2 * m)
        self._forward, self._backward = slice(forward), slice(forward, forward + backward)
        self._touching = slice(m - touching, m)
        self._touching_w = slice(2 * m - touching, 2 * m)
        self._smooth = slice(2 * m, 2 * m + smooth)
        self._ends = np.cumsum([0, forward, backward, touching, touching, touching, smooth])

    def columns(self, S: Array) -> Array:
        """Return the columns of the stiffness S that the variables multiply."""
        return np.hstack(
            [
                S[:, self._forward],
                -S[:, self._backward],
                S[:, self._touching],
                -S[:, self._touching],
                S[:, self._touching_w],
                S[:, self._smooth],
            ]
        )

    def outputs(self, x: Array) -> Array:
        """Return what is complementary to the variables, from reactions or their columns x."""
        friction = self.friction if x.ndim == 1 else self.friction[:, None]
        A, B = friction.margins(x[self._v], x[self._w])
        return np.concatenate(
            [
                A[self._forward],
                B[self._backward],
                A[self._touching],
                B[self._touching],
                x[self._touching_w],
                x[self._smooth],
            ]
        )

    def covers(self) -> list[Array]:
        """Return the covering vectors of Lemke's method, see ``COVERS``."""
        random = np.random.default_rng(0)
        middle = 0.5 * (self.friction.backward - self.friction.forward)
        found = []
        rows = self._smooth.stop
        for attempt in range(COVERS):
            pressing = np.ones(rows) if attempt == 0 else random.uniform(0.1, 1.0, rows)
            pressing[self._v] = middle * pressing[self._w]
            found.append(self.outputs(pressing))
        return found

    def states_of(self, system: ContactSystem, z: Array, y: Array) -> NDArray[np.int8]:
        """Return the (N,) states that a solution stands for, 0 at nodes that are not undecided.

        Args:
            system: the condensed body in 2N form.
            z: variables of the solution.
            y: what is complementary to them.
        """
        nodes, state = self.undecided, np.zeros(system.n, dtype=np.int8)
        stiffness = float(np.abs(np.diagonal(system.K)).max())
        tiny = float(np.finfo(float).tiny)
        small = DECIDE_TOLERANCE * max(float(np.abs(z).max(initial=0.0)), tiny)
        force = max(DECIDE_TOLERANCE * float(np.abs(y).max(initial=0.0)), stiffness * small)
        ahead, back, plus, minus, gap, smooth_gap = (z[i:j] for i, j in pairwise(self._ends))
        P, smooth_P = y[self._ends[4] : self._ends[5]], y[self._ends[5] :]
        state[nodes.forward] = np.where(ahead > small, FORWARD, STICK)
        state[nodes.backward] = np.where(back > small, BACKWARD, STICK)
        slip = np.where(minus > plus + small, BACKWARD, STICK)
        slip = np.where(plus > minus + small, FORWARD, slip)
        state[nodes.touching] = np.where((gap > small) | (P <= force), SEPARATION, slip)
        open_ = (smooth_gap > small) | (smooth_P <= force)
        state[nodes.smooth] = np.where(open_, SEPARATION, STICK)
        return state


def condensed(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> tuple[Array, Array]:
    """Return stiffness and reactions of the undecided nodes, ``open_dofs`` having no reaction.

    Rows: v of the forward, backward and touching nodes, w of the same, w of the smooth ones.
    """
    n = system.n
    rubbing = np.concatenate([undecided.forward, undecided.backward, undecided.touching])
    rows = np.concatenate([rubbing, n + rubbing, n + undecided.smooth])
    S, s = _eliminate(system, r0, rows, open_dofs)
    s[np.abs(s) <= NO_REACTION * float(np.abs(r0).max(initial=0.0))] = 0.0
    return S, s


def problem_of_nodes(
    system: ContactSystem, undecided: Undecided, S: Array, s: Array
) -> tuple[Array, Array, Friction, enumerate_states.Choices, NDArray[np.bool_]]:
    """Return the arguments of :func:`enumerate_states.exhaust` for the nodes of :func:`choices`.

    Args:
        system: the condensed body in 2N form.
        undecided: the nodes to decide.
        S: stiffness, as of :func:`condensed`; a smooth node gets a tangential freedom, kept still.
        s: reactions, the same.
    """
    may, smooth = choices(undecided), len(undecided.smooth)
    m = len(may)
    where = np.concatenate([np.arange(m - smooth), m + np.arange(m)])
    full, held = np.eye(2 * m), np.zeros(2 * m)
    full[np.ix_(where, where)], held[where] = S, s
    friction = system.friction[np.array(list(may))]
    return full, held, friction, list(may.values()), np.arange(m) >= m - smooth


def choices(undecided: Undecided) -> dict[int, tuple[int, ...]]:
    """Return the states that each undecided node may take."""
    may = dict.fromkeys(undecided.forward.tolist(), (STICK, FORWARD))
    may |= dict.fromkeys(undecided.backward.tolist(), (STICK, BACKWARD))
    may |= dict.fromkeys(undecided.touching.tolist(), (STICK, SEPARATION, FORWARD, BACKWARD))
    return may | dict.fromkeys(undecided.smooth.tolist(), (STICK, SEPARATION))


def is_exhaustible(undecided: Undecided) -> bool:
    """Return whether all sets of states are tried where the finite method finds nothing."""
    return (
        0 < enumerate_states.count(list(choices(undecided).values())) <= enumerate_states.EXHAUSTED
    )


def _exhaust(
    system: ContactSystem, undecided: Undecided, S: Array, s: Array
) -> NDArray[np.int8] | None:
    """Try all sets of states, where they are few; S and s are those of :func:`condensed`."""
    if not is_exhaustible(undecided):
        return None
    found = enumerate_states.exhaust(*problem_of_nodes(system, undecided, S, s))
    if found is None:
        return None
    state = np.zeros(system.n, dtype=np.int8)
    state[list(choices(undecided))] = found
    return state


def _eliminate(
    system: ContactSystem, r0: Array, rows: Indices, free: Indices
) -> tuple[Array, Array]:
    """Return stiffness and reactions at ``rows``, the ``free`` dofs having no reaction.

    Rigid motions that move nothing but these are kept from moving.
    """
    K = system.K
    S, s = K[np.ix_(rows, rows)], r0[rows]
    if len(free) == 0:
        return S, s
    kept = np.ones(len(K), dtype=bool)
    kept[free] = False
    motions = neutral_motions(system.rigid, kept)[free]
    pinned = float(np.abs(np.diagonal(K)).max()) * motions @ motions.T
    coupling = K[np.ix_(free, rows)]
    factor = sla.cho_factor(K[np.ix_(free, free)] + pinned)
    return S - coupling.T @ sla.cho_solve(factor, coupling), s - coupling.T @ sla.cho_solve(
        factor, r0[free]
    )
