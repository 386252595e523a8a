"""The contact law of many nodes at once: linear complementarity, and search of all sets of states.

With the slip split into v = z+ - z- and the gap g, Coulomb's and Signorini's conditions at a node
are

    A = Q + f_forward P >= 0  with  z+,  B = f_backward P - Q >= 0  with  z-,  P >= 0  with  g,

each pair complementary (A. Klarbring, 1986). A node that is known to be in contact on one side of
the friction cone keeps one pair. The unknowns may be rates (of nodes on a limit) or the whole
displacements of the static problem of a first load.

Every set of states makes the law a linear system, whose answer is a solution if it keeps the
inequalities of section 2 of Ahn & Barber (2008): where few nodes are undecided all sets are tried,
and failure proves that there is no solution.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise, product

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK, Friction, State
from receding_fenicsx.interface.lcp.lemke import solve
from receding_fenicsx.interface.system import ContactSystem, neutral_motions

EXHAUSTED = 2**16
"""Largest number of sets of states that is gone through: eight nodes with all four states."""

BATCH = 4096
"""Sets of states solved at once."""

Choices = list[tuple[int, ...]]


def number_of_sets(choices: Choices) -> int:
    """Return the number of sets of states."""
    return math.prod(map(len, choices))


def batches(choices: Choices) -> Iterator[NDArray[np.int8]]:
    """Yield all sets of states, (k, m) with k up to ``BATCH`` at once."""
    every = product(*choices)
    while batch := list(islice(every, BATCH)):
        yield np.array(batch, dtype=np.int8)


def solutions(
    S: Array,
    s: Array,
    friction: Friction,
    states: NDArray[np.int8],
    choices: Choices,
    smooth: NDArray[np.bool_],
) -> tuple[NDArray[np.int8], Array]:
    """Return those of (k, m) sets of states that are solutions, and their (j, 2m) changes u.

    Args:
        S: (2m, 2m) stiffness, order [v; w]: x = S u + s with the changes u of displacement and x of
            reaction.
        s: (2m,) change of reaction with the nodes held.
        friction: (m,) coefficients of friction.
        states: (k, m) sets of states to try.
        choices: the states that each node may take. A node that may not separate keeps its
            pressure, and one that may slip in one direction only is at that limit of friction.
        smooth: (m,) nodes that know only contact (stick) and separation, at whatever v does not
            concern.
    """
    m = len(friction.forward)
    S_t, S_n, s_t, s_n = S[:m], S[m:], s[:m], s[m:]
    A, B = friction[:, None].margins(S_t, S_n)
    a, b = friction.margins(s_t, s_n)
    stick, forward, backward, open_ = (
        states == state
        for state in (State.STICK, State.FORWARD_SLIP, State.BACKWARD_SLIP, State.SEPARATION)
    )
    eye = np.eye(2 * m)
    pick = [mask[:, :, None] for mask in (forward, backward, open_)]
    rows_t = np.where(pick[0], A, np.where(pick[1], B, np.where(pick[2], S_t, eye[:m])))
    right_t = np.where(forward, -a, np.where(backward, -b, np.where(open_, -s_t, 0.0)))
    rows_n, right_n = np.where(pick[2], S_n, eye[m:]), np.where(open_, -s_n, 0.0)
    # a smooth node's tangential freedom is not in the problem
    rows_t = np.where(smooth[:, None], eye[:m], rows_t)
    right_t = np.where(smooth, 0.0, right_t)
    matrix = np.concatenate([rows_t, rows_n], axis=1)
    right = np.concatenate([right_t, right_n], axis=1)[:, :, None]
    try:
        u = np.linalg.solve(matrix, right)[:, :, 0]
    except np.linalg.LinAlgError:
        # a set that leaves a motion without stiffness: least squares, checked below like all
        u = np.array(
            [np.linalg.lstsq(M, r[:, 0], rcond=None)[0] for M, r in zip(matrix, right, strict=True)]
        )
    x = u @ S.T + s
    balance = np.abs(np.einsum("kij,kj->ki", matrix, u) - right[:, :, 0]).max(axis=1)
    v, w, Q, P = u[:, :m], u[:, m:], x[:, :m], x[:, m:]
    # violation of an inequality, over the largest term of its kind, up to which a set is accepted
    force = np.maximum(np.abs(x).max(axis=1), np.abs(s).max())[:, None] * 1e-9
    way = np.abs(u).max(axis=1)[:, None] * 1e-9
    can_open, can_forward, can_backward = (
        np.array([state in c for c in choices])
        for state in (State.SEPARATION, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    )
    on_A, on_B = (can_forward | can_open) & ~smooth, (can_backward | can_open) & ~smooth
    margin_A, margin_B = friction.margins(Q, P)
    good = ~(stick & on_A) | (margin_A >= -force)
    good &= ~(stick & on_B) | (margin_B >= -force)
    good &= ~(~open_ & can_open) | (P >= -force)
    good &= ~forward | (v >= -way)
    good &= ~backward | (v <= way)
    good &= ~open_ | (w >= -way)
    solved = np.flatnonzero(good.all(axis=1) & (balance <= force[:, 0]))
    return states[solved], u[solved]


Indices = NDArray[np.intp]

COVERS = 8
"""Covering vectors of Lemke's method that are tried: an added pressure, uniform and then random.

The added reactions lie in the middle of the friction cone and keep A + B = (f_forward +
f_backward) P, so that every point of Lemke's path is a frictional contact too; vectors without that
property end on rays where a solution exists."""


@dataclass(frozen=True)
class Undecided:
    """Nodes whose state the problem has to find; every other node keeps its own."""

    forward: Indices  # nodes in contact at A = 0: stick or forward slip
    backward: Indices  # nodes in contact at B = 0: stick or backward slip
    touching: Indices  # nodes with neither gap nor pressure: any state
    smooth: Indices  # nodes without friction or held tangentially, neither gap nor pressure

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
    small, nodes = condensed(system, r0, undecided, open_dofs), list(choices(undecided))
    if not nodes:
        return np.zeros(system.n, dtype=np.int8)
    problem, unsure = problem_of_nodes(system, undecided, *small), None
    for found in _by_covers(system, undecided, *small):
        if len(solutions(*problem[:3], found[nodes][None], *problem[3:])[0]):
            return found
        # round-off of pivots without stiffness, or a motion that only its bounds determine
        unsure = found if unsure is None else unsure
    most = EXHAUSTED if unsure is None else BATCH
    if number_of_sets(problem[3]) <= most:
        for sets in batches(problem[3]):
            solved, _ = solutions(*problem[:3], sets, *problem[3:])
            if len(solved):
                state = np.zeros(system.n, dtype=np.int8)
                state[nodes] = solved[0]
                return state
    return unsure


def states_by_covers(
    system: ContactSystem, r0: Array, undecided: Undecided, open_dofs: Indices
) -> Iterator[NDArray[np.int8]]:
    """Yield the answer of Lemke's method for each covering vector that leads to one.

    Arguments and answers as for :func:`solve_states`; answers may be alike.
    """
    return _by_covers(system, undecided, *condensed(system, r0, undecided, open_dofs))


def _by_covers(
    system: ContactSystem, undecided: Undecided, S: Array, s: Array
) -> Iterator[NDArray[np.int8]]:
    """Yield the answers with the condensed stiffness and reactions given."""
    problem = _Pairs(undecided, system.friction)
    M, q = problem.outputs(problem.columns(S)), problem.outputs(s)
    for cover in problem.covers():
        z = solve(M, q, cover)
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
        """Return the (N,) states that a solution stands for, 0 at nodes that are not undecided."""
        nodes, state = self.undecided, np.zeros(system.n, dtype=np.int8)
        stiffness = float(np.abs(np.diagonal(system.K)).max())
        tiny = float(np.finfo(float).tiny)
        # part of the largest variable below which a complementary variable counts as zero
        small = 1e-12 * max(float(np.abs(z).max(initial=0.0)), tiny)
        force = max(1e-12 * float(np.abs(y).max(initial=0.0)), stiffness * small)
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
    K, S, s = system.K, system.K[np.ix_(rows, rows)], r0[rows]
    if len(open_dofs):
        # rigid motions that move nothing but these are kept from moving
        kept = np.ones(len(K), dtype=bool)
        kept[open_dofs] = False
        motions = neutral_motions(system.rigid, kept)[open_dofs]
        pinned = float(np.abs(np.diagonal(K)).max()) * motions @ motions.T
        coupling = K[np.ix_(open_dofs, rows)]
        factor = sla.cho_factor(K[np.ix_(open_dofs, open_dofs)] + pinned)
        S = S - coupling.T @ sla.cho_solve(factor, coupling)
        s = s - coupling.T @ sla.cho_solve(factor, r0[open_dofs])
    # round-off where loads have no effect
    s[np.abs(s) <= 1e-14 * float(np.abs(r0).max(initial=0.0))] = 0.0
    return S, s


def problem_of_nodes(
    system: ContactSystem, undecided: Undecided, S: Array, s: Array
) -> tuple[Array, Array, Friction, Choices, NDArray[np.bool_]]:
    """Return the arguments of :func:`solutions`, but for sets, for the nodes of :func:`choices`.

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
    may = choices(undecided)
    return len(may) > 0 and number_of_sets(list(may.values())) <= EXHAUSTED
