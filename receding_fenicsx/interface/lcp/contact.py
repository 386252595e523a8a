"""The contact law of many nodes at once as a linear complementarity problem.

With the slip split into v = z+ - z- and the gap g, Coulomb's and Signorini's conditions at a node
are

    A = Q + f P >= 0  with  z+,     B = f P - Q >= 0  with  z-,     P >= 0  with  g,

each pair complementary (A. Klarbring, 1986). A node that is known to be in contact on one side of
the friction cone keeps one pair. Works for rates (which way do nodes on a limit go?) and for the
static problem of a first load alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.lcp import enumerate_states, lemke
from receding_fenicsx.interface.system import Array, ContactSystem

Indices = NDArray[np.intp]

DECIDE_TOLERANCE = 1e-12
"""Part of the largest variable below which a complementary variable counts as zero."""

COVERS = 8
"""Covering vectors of Lemke's method that are tried: an added pressure, uniform and then random.

An added pressure keeps A + B = 2 f P, so that every point of Lemke's path is a frictional contact
too; vectors without that property end on rays where a solution exists."""


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
    n = system.n
    a, b, c, d = undecided.forward, undecided.backward, undecided.touching, undecided.smooth
    v_nodes = np.concatenate([a, b, c])
    rows = np.concatenate([v_nodes, n + v_nodes, n + d])
    S, s = _eliminate(system.K, r0, rows, open_dofs)
    m, k = len(v_nodes), len(c)
    f = system.f[v_nodes]
    row_t, row_n = np.arange(m), m + np.arange(m)
    tail = 2 * m + np.arange(len(d))
    last = m - k + np.arange(k)
    # unknowns: slip of a, of b reversed, z+ and z- and gap of c, gap of d
    columns = np.hstack(
        [
            S[:, row_t[: len(a)]],
            -S[:, row_t[len(a) : m - k]],
            S[:, row_t[last]],
            -S[:, row_t[last]],
            S[:, row_n[last]],
            S[:, tail],
        ]
    )

    def combine(x: Array) -> Array:
        fP = (f * x[row_n].T).T
        A, B = x[row_t] + fP, fP - x[row_t]
        return np.concatenate(
            [A[: len(a)], B[len(a) : m - k], A[last], B[last], x[row_n[last]], x[tail]]
        )

    random = np.random.default_rng(0)
    covers = []
    for attempt in range(COVERS):
        pressing = np.ones(len(rows)) if attempt == 0 else random.uniform(0.1, 1.0, len(rows))
        pressing[row_t] = 0.0
        covers.append(combine(pressing))
    z = lemke.solve(combine(columns), combine(s), covers)
    if z is None:
        return _exhaust(system, undecided, S, s)
    state = np.zeros(n, dtype=np.int8)
    stiffness = float(np.abs(np.diagonal(system.K)).max())
    ends = np.cumsum([0, len(a), len(b), k, k, k, len(d)])
    za, zb, plus, minus, gap, gap_d = (z[i:j] for i, j in pairwise(ends))
    small = DECIDE_TOLERANCE * max(float(np.abs(z).max(initial=0.0)), float(np.finfo(float).tiny))
    state[a] = np.where(za > small, State.FORWARD_SLIP, State.STICK)
    state[b] = np.where(zb > small, State.BACKWARD_SLIP, State.STICK)
    y = combine(columns) @ z + combine(s)
    P_c, P_d = y[ends[4] : ends[5]], y[ends[5] :]
    force = max(DECIDE_TOLERANCE * float(np.abs(y).max(initial=0.0)), stiffness * small)
    slip = np.where(
        plus > minus + small,
        State.FORWARD_SLIP,
        np.where(minus > plus + small, State.BACKWARD_SLIP, State.STICK),
    )
    state[c] = np.where((gap > small) | (P_c <= force), State.SEPARATION, slip)
    state[d] = np.where((gap_d > small) | (P_d <= force), State.SEPARATION, State.STICK)
    return state


def choices(undecided: Undecided) -> dict[int, tuple[int, ...]]:
    """Return the states that each undecided node may take."""
    stick, open_ = int(State.STICK), int(State.SEPARATION)
    forward, backward = int(State.FORWARD_SLIP), int(State.BACKWARD_SLIP)
    may = dict.fromkeys(undecided.forward.tolist(), (stick, forward))
    may |= dict.fromkeys(undecided.backward.tolist(), (stick, backward))
    may |= dict.fromkeys(undecided.touching.tolist(), (stick, open_, forward, backward))
    return may | dict.fromkeys(undecided.smooth.tolist(), (stick, open_))


def is_exhaustible(undecided: Undecided) -> bool:
    """Return whether all sets of states are tried where the finite method finds nothing."""
    return (
        0 < enumerate_states.count(list(choices(undecided).values())) <= enumerate_states.EXHAUSTED
    )


def _exhaust(
    system: ContactSystem, undecided: Undecided, S: Array, s: Array
) -> NDArray[np.int8] | None:
    """Try all sets of states, where they are few.

    Args:
        system: the condensed body in 2N form.
        undecided: the nodes to decide.
        S: stiffness at the rows of :func:`solve_states`: v of forward, backward and touching nodes,
            w of the same, w of the smooth ones.
        s: (rows,) reactions (or rates) with no further displacement.
    """
    if not is_exhaustible(undecided):
        return None
    may = choices(undecided)
    nodes = np.array(list(may))
    m, d = len(nodes), len(undecided.smooth)
    # smooth nodes get a tangential freedom of their own that is kept still
    where = np.concatenate([np.arange(m - d), m + np.arange(m)])
    full, held = np.eye(2 * m), np.zeros(2 * m)
    full[np.ix_(where, where)], held[where] = S, s
    smooth = np.arange(m) >= m - d
    found = enumerate_states.exhaust(full, held, system.f[nodes], list(may.values()), smooth)
    if found is None:
        return None
    state = np.zeros(system.n, dtype=np.int8)
    state[nodes] = found
    return state


def _eliminate(K: Array, r0: Array, rows: Indices, free: Indices) -> tuple[Array, Array]:
    """Return stiffness and reactions at ``rows``, the ``free`` dofs having no reaction."""
    S, s = K[np.ix_(rows, rows)], r0[rows]
    if len(free) == 0:
        return S, s
    coupling = K[np.ix_(free, rows)]
    factor = sla.cho_factor(K[np.ix_(free, free)])
    return S - coupling.T @ sla.cho_solve(factor, coupling), s - coupling.T @ sla.cho_solve(
        factor, r0[free]
    )
