"""Rates along a leg in known sets of states, remembered: what the event search works on.

Quantities are kept in one vector y = [v, gap, A, B] with the margins A and B of
:mod:`receding_fenicsx.interface.law` (P in place of A at nodes without friction), see
:mod:`receding_fenicsx.interface.exact.tableau`.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.exact.pivot_matrix import SingularExchange
from receding_fenicsx.interface.exact.tableau import (
    A,
    B,
    Tableau,
    limit_distances,
)
from receding_fenicsx.interface.gauss_seidel.direct import (
    RIGID_TOLERANCE,
    has_rigid,
    neutral_motions,
)
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.system import Array, ContactState, ContactSystem

States = NDArray[np.int8]

LIMIT_TOLERANCE = 1e-12
"""Distance from a limit, over the largest nodal force, up to which a node sits on it."""

RATE_TOLERANCE = 1e-11
"""Rate over the Euclidean norm of all rates (as forces) below which it is taken for zero."""

RATE_IMBALANCE = 1e-12
"""Imbalance of rates, over the norm of those of forces alone, above which they are refined."""

EPSILON = float(np.finfo(float).eps)

UNIT_ROUND_OFFS = 16.0
"""What no refinement betters: such round-offs of the norm of all rates."""

REFINEMENTS = 3
"""Steps of iterative refinement at most."""

RENEWAL = 0.05
"""Refinements, in multiples of the number of contact freedoms, that take as long as a new
tableau."""

SLIGHT = 0.1
"""Friction below which the distances A and B from its limits are measured by f P, not by P: they
are small because f is, and a node on both limits at once has to be one without pressure."""

COUNTED = 1e-3
"""Friction below which the rates A + B of slipping nodes are worked out from P itself."""

PROBES = 4
"""Random sums by which the forces at an event are compared with those of the displacements."""

CACHED_BYTES = 2**26
"""Memory for the rates of sets of states that have been met before."""


@dataclass(slots=True)
class Segment:
    """Rates along a leg in one set of states, ready for the event search.

    Attributes:
        q: (4N,) rates of y per unit of s.
        falling: labels of quantities that must stay >= 0 and fall.
        time: (len(falling),) -1 / rate of each.
        reversed_nodes: slipping nodes whose rate contradicts their state.
        next: by the label of the quantity that reached its limit, what came of it: states, segment
            and change (node, old, new).
    """

    q: Array
    falling: NDArray[np.intp]
    time: Array
    reversed_nodes: NDArray[np.intp]
    next: dict[int, tuple[States, Segment, tuple[int, int, int]]] = field(default_factory=dict)


class Segments:
    """Makes and remembers segments; owns the tableau.

    Attributes:
        system: the condensed body in 2N form.
        frictional: (N,) nodes with the full contact law.
        smooth: (N,) nodes without friction, or held tangentially.
        weight: (4N,) brings every entry of y to the size of a nodal force.
        limit: (4N,) distance from a limit, per unit of force scale, up to which a node sits on it.
        trials: sets of states whose rates were worked out.
        lifts_freely, slides_freely: nothing but the contact holds the body against lifting,
        sliding.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Start with nothing remembered."""
        self.system = system
        n = system.n
        normal = ~system.held[n:]
        self.frictional = ~system.held[:n] & normal & system.friction.present
        self.smooth = normal & ~self.frictional
        f = system.friction.mean
        force = 1.0 / np.maximum(1.0, f)
        stiffness = np.concatenate(local_stiffness(system))
        self._pin = float(stiffness.max())
        self.weight = np.concatenate([stiffness, force, force])
        slack = np.where(self.frictional, np.minimum(1.0, f / SLIGHT), 1.0)
        self.limit = LIMIT_TOLERANCE / self.weight
        self.limit[2 * n :] *= np.tile(slack, 2)
        self._slack = slack
        self._counted = np.flatnonzero(self.frictional & (f < COUNTED))
        self.lifts_freely = has_rigid(system.rigid, np.repeat([0.0, 1.0], n))
        self.slides_freely = has_rigid(system.rigid, np.repeat([1.0, 0.0], n))
        self.trials = self.refinements = 0
        self._tableau: Tableau | None = None
        self._probes: tuple[Array, Array, Array] | None = None
        self._last_pinned: tuple[bytes, Array, Tableau] | None = None
        self._known: OrderedDict[tuple[bytes, bytes], Segment] = OrderedDict()

    def tableau(self, state: States) -> Tableau:
        """Return the tableau, brought to the given states.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        try:
            if self._tableau is None:
                self._tableau = Tableau(self.system, state)
            else:
                self._tableau.move_to(state)
        except SingularExchange:
            # it may stand half-way
            self._tableau = None
            return self._pinned(state)
        return self._tableau

    def _pinned(self, state: States) -> Tableau:
        """Return a tableau in which the rigid motions are pinned that the states leave free.

        A body that touches at one node can turn about it, one whose feet slip apart can drift:
        where the loads do not work on such a motion it is left out.

        Raises:
            SingularExchange: some other motion is left without stiffness.
        """
        key = state.tobytes()
        if self._last_pinned is None or self._last_pinned[0] != key:
            motion = self.neutral(state)
            if motion.shape[1] == 0:
                raise SingularExchange
            K = self.system.K + self._pin * motion @ motion.T
            self._last_pinned = key, motion, Tableau(replace(self.system, K=K), state)
        return self._last_pinned[2]

    def neutral(self, state: States) -> Array:
        """Return (2N, k) orthonormal rigid motions that nothing resists in the given states."""
        contact = state != SEPARATION
        kept = np.concatenate([contact & self.frictional & (state == STICK), contact])
        return neutral_motions(self.system.rigid, kept)

    def _works_on_pins(self, state: States, q: Array, direction: Array) -> bool:
        """Return whether rates of a pinned tableau lean on the pins."""
        if self._last_pinned is None or self._last_pinned[0] != state.tobytes():
            return False
        n = self.system.n
        lean = self._pin * (self._last_pinned[1].T @ q[: 2 * n])
        held = np.abs(direction @ self.system.r_star).max(initial=0.0)
        return bool(np.abs(lean).max() > RIGID_TOLERANCE * held)

    def at(self, state: States, direction: Array) -> Segment:
        """Return the rates in the given states along a leg whose loads change by ``direction``."""
        key = state.tobytes(), direction.tobytes()
        known = self._known.get(key)
        if known is not None:
            return known
        self.trials += 1
        made = self._make(state, direction)
        self._known[key] = made
        if len(self._known) * 2 * made.q.nbytes > CACHED_BYTES:
            self._known.popitem(last=False)[1].next.clear()
        return made

    def _make(self, state: States, direction: Array) -> Segment:
        n = len(state)
        q = self._rates(state, direction)
        if self._works_on_pins(state, q, direction):
            raise SingularExchange
        forces = q * self.weight
        threshold = -RATE_TOLERANCE * sqrt(forces.dot(forces))
        if len(self._counted):
            self._count_pressure(state, q, direction, forces)
        # what falls and is not a displacement is bounded: an output A, B or gap of its state
        falling = (forces[n:] < threshold).nonzero()[0]
        falling += n
        wrong = (SLIP_SIGN[state] * forces[:n] < threshold).nonzero()[0]
        return Segment(q, falling, -1.0 / q[falling], wrong)

    def _rates(self, state: States, direction: Array) -> Array:
        """Return the rates in the given states, refined where they do not balance.

        The round-off of a tableau stays in it: where refining has taken as long as a new one would,
        it is renewed.
        """
        tableau, n = self.tableau(state), self.system.n
        if self.refinements > RENEWAL * 2 * n:
            tableau.build(state)
            self.refinements = 0
        q = tableau.rates(direction)
        imbalance = self.imbalance(q, direction, of_rates=True)
        all_ = q * self.weight
        forces = all_[2 * n :]
        accepted = max(
            RATE_IMBALANCE * sqrt(forces.dot(forces)),
            UNIT_ROUND_OFFS * EPSILON * sqrt(all_.dot(all_)),
        )
        for _ in range(REFINEMENTS):
            if imbalance <= accepted:
                break
            self.refinements += 1
            better = tableau.refined(q, direction)
            left = self.imbalance(better, direction, of_rates=True)
            if left >= imbalance:
                break
            q, imbalance = better, left
        return q

    def _count_pressure(self, state: States, q: Array, direction: Array, forces: Array) -> None:
        """Set the rates 2 f P of slipping nodes with little friction by their pressure itself.

        As outputs of the tableau they carry round-off of the size of P, which is theirs over f.
        """
        n, system = self.system.n, self.system
        for slipping, kind in ((FORWARD, B), (BACKWARD, A)):
            i = self._counted[state[self._counted] == slipping]
            P = direction @ system.r_star[:, n + i] + system.K[n + i] @ q[: 2 * n]
            q[kind * n + i] = system.friction[i].opening(P)
            forces[kind * n + i] = q[kind * n + i] / self._slack[i]

    def imbalance(self, y: Array, load: Array, of_rates: bool = False) -> float:
        """Return the largest of a few random sums over the nodes of the errors of Q and P.

        With independent errors it is some sqrt(N) times theirs, and never much below the largest.
        Its cost does not grow with N^2.

        Args:
            y: (4N,) quantities, or (k, 4N) of k instants.
            load: (n_loads,) or (k, n_loads) load factors.
            of_rates: y are rates, load is that of the load factors.
        """
        if self._probes is None:
            self._probes = self._make_probes()
        on_y, on_load, gaps = self._probes
        errors = y @ on_y + load @ on_load
        return float(np.abs(errors if of_rates else errors - gaps).max())

    def _make_probes(self) -> tuple[Array, Array, Array]:
        """Return (4N, PROBES) and (n_loads, PROBES) weights of the sums, and what gaps add."""
        n, system = self.system.n, self.system
        # Q and P, not the limits: where friction is small these hide what is wrong with P
        on_Q, on_P = np.random.default_rng(0).choice([-1.0, 1.0], (2, n, PROBES))
        on_Q *= self.frictional[:, None]
        on_P *= (self.frictional | self.smooth)[:, None]
        opening = np.where(self.frictional, system.friction.opening(np.ones(n)), 1.0)[:, None]
        a, b = system.friction[:, None].shares
        on_A, on_B = a * on_Q + on_P / opening, on_P / opening - b * on_Q
        on_B[~self.frictional] = 0.0
        on_r = np.vstack([on_Q, on_P])
        on_u = system.K @ on_r
        return np.vstack([on_u, -on_A, -on_B]), system.r_star @ on_r, system.g0 @ on_u[n:]

    def values(self, state: ContactState) -> Array:
        """Return y = [v, gap, A, B]; quantities that the states fix get their exact value."""
        y = self.margins(state)
        y[2 * self.system.n :] = np.maximum(y[2 * self.system.n :], 0.0)
        return y

    def margins(self, state: ContactState) -> Array:
        """Return the same, A and B below zero where the limit of friction is passed."""
        nodes = self.frictional, self.smooth
        forward, backward = limit_distances(self.system.friction, nodes, state.state, state.r)
        contact = state.state != SEPARATION
        gap = np.where(contact & (self.frictional | self.smooth), 0.0, self.system.g0 + state.w)
        # a gap keeps its round-off: times the stiffness it would be a force out of balance
        return np.concatenate([state.v, gap, forward, backward])

    def undecided(self, y: Array, state: States, force_scale: float) -> Undecided:
        """Return the nodes that sit on a limit, sorted by which limit."""
        n = self.system.n
        on = (y <= self.limit * force_scale).reshape(4, n)
        contact = state != SEPARATION
        touching = np.where(contact, on[2] & (on[3] | ~self.frictional), on[1])
        F = self.frictional & contact & ~touching
        return Undecided(
            np.flatnonzero(F & ((state == FORWARD) | (on[2] & (state == STICK)))),
            np.flatnonzero(F & ((state == BACKWARD) | (on[3] & (state == STICK)))),
            np.flatnonzero(self.frictional & touching),
            np.flatnonzero(self.smooth & touching),
        )
