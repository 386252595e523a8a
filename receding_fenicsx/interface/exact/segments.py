"""Rates along a leg in given sets of states, one by one.

Quantities are kept in one vector y = [v, gap, A, B] with the margins A and B of
:mod:`receding_fenicsx.interface.law` (P in place of A at nodes without friction), see
:mod:`receding_fenicsx.interface.exact.tableau`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.balance import BalanceCheck
from receding_fenicsx.interface.exact.pivot_matrix import SINGULAR_ON_SPRINGS, SingularExchange
from receding_fenicsx.interface.exact.tableau import Tableau
from receding_fenicsx.interface.law import (
    BACKWARD,
    FORWARD,
    SEPARATION,
    SLIP_SIGN,
    STICK,
    margin_slopes,
    margins_at,
)
from receding_fenicsx.interface.system import (
    Changes,
    ContactState,
    ContactSystem,
    has_rigid,
    neutral_motions,
)
from receding_fenicsx.interface.tolerances import (
    ON_LIMIT,
    RATE_TOLERANCE,
    RIGID_TOLERANCE,
    ROUND_OFFS,
)

States = NDArray[np.int8]

EPSILON = float(np.finfo(float).eps)

UNREFINABLE_ROUND_OFFS = 16.0
"""Imbalance of rates, in round-offs of the norm of all rates, that refinement does not reduce."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Rates along a leg in one set of states."""

    q: Array  # (4N,) rates of y per unit of s
    falling: NDArray[np.intp]  # labels of quantities that must stay >= 0 and fall
    reversed_nodes: NDArray[np.intp]  # slipping nodes whose rate contradicts their state


class Segments:
    """Makes segments; owns the tableau.

    Attributes:
        system: the condensed body in 2N form.
        frictional: (N,) nodes with the full contact law.
        smooth: (N,) nodes without friction, or held tangentially.
        weight: (4N,) brings every entry of y to the size of a nodal force.
        limit: (4N,) distance from a limit, per unit of force scale, up to which a node sits on it.
        friction: coefficients of friction.
        shares: (N,) factors a, b of Q = a A - b B; 0 at nodes without friction.
        balance: check that forces and displacements belong together.
        refinements: refinements of rates since the tableau was made.
        lifts_freely, slides_freely: nothing but the contact holds the body against lifting,
        sliding.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Prepare for ``system`` in 2N form."""
        self.system = system
        n = system.n
        normal = ~system.held[n:]
        self.frictional = ~system.held[:n] & normal & system.friction.present
        self.smooth = normal & ~self.frictional
        f = system.friction.mean
        force = 1.0 / np.maximum(1.0, f)
        stiffness = np.concatenate(system.local_stiffness)
        self._pin = float(stiffness.max())
        self.weight = np.concatenate([stiffness, force, force])
        # A and B are small with f: only a node without pressure may be on both limits
        scale = np.where(self.frictional, np.minimum(1.0, f / 0.1), 1.0)
        self.limit = ON_LIMIT / self.weight
        self.limit[2 * n :] *= np.tile(scale, 2)
        self.friction = system.friction
        self.shares = [np.where(self.frictional, part, 0.0) for part in system.friction.shares]
        self.balance = BalanceCheck(system, self.frictional, self.smooth)
        self.lifts_freely = has_rigid(system.rigid, np.repeat([0.0, 1.0], n))
        self.slides_freely = has_rigid(system.rigid, np.repeat([1.0, 0.0], n))
        self.refinements = 0
        self._tableau: Tableau | None = None
        self._last_pinned: tuple[bytes, Array, Tableau] | None = None
        self._slopes: dict[bytes, tuple[NDArray[np.bool_], Array]] = {}

    def tableau(self, state: States, renew: bool = False) -> Tableau:
        """Return the tableau, brought to the given states.

        With ``renew`` it is made from scratch, without the round-off that has gathered in it.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        # the pivot of a body that turns about one node may be all round-off
        if not self.free_motions(state).shape[1]:
            with suppress(SingularExchange):
                if self._tableau is None:
                    self._tableau = Tableau(self.system, state)
                elif renew:
                    self._tableau.build(state)
                else:
                    self._tableau.move_to(state)
                return self._tableau
        # it may stand half-way
        self._tableau = None
        return self._pinned(state)

    def tableau_at_hand(self, state: States) -> Tableau:
        """Return the tableau in whatever states it is, made for the given ones if there is none."""
        return self.tableau(state) if self._tableau is None else self._tableau

    @property
    def left_out(self) -> int:
        """Number of displacements whose columns are left out of the tableau."""
        return 0 if self._tableau is None else self._tableau.left_out

    def leave_out(self, state: States, inputs: NDArray[np.intp]) -> None:
        """Leave columns of displacements out of the tableau, see :meth:`Tableau.leave_out`."""
        try:
            tableau = self.tableau_at_hand(state)
            if not self.is_loose:
                tableau.leave_out(state, inputs)
        except SingularExchange:
            # it may stand half-way; whoever follows the leg makes another one
            self._tableau = None

    def _pinned(self, state: States) -> Tableau:
        """Return a tableau in which the rigid motions are pinned that the states leave free.

        A body that touches at one node can turn about it, one whose feet slip apart can drift:
        where the loads do not work on such a motion it is left out.

        Raises:
            SingularExchange: some other motion is left without stiffness.
        """
        key = state.tobytes()
        if self._last_pinned is None or self._last_pinned[0] != key:
            motion = self.free_motions(state)
            K = self.system.K + self._pin * motion @ motion.T
            pinned = Tableau(replace(self.system, K=K), state, singular=SINGULAR_ON_SPRINGS)
            self._last_pinned = key, motion, pinned
        return self._last_pinned[2]

    def free_motions(self, state: States) -> Array:
        """Return (2N, k) orthonormal rigid motions that nothing resists in the given states."""
        contact = state != SEPARATION
        kept = np.concatenate([contact & self.frictional & (state == STICK), contact])
        return neutral_motions(self.system.rigid, kept)

    def _works_on_pins(self, state: States, q: Array, direction: Array) -> bool:
        """Return whether rates of a pinned tableau lean on the pins by more than round-off."""
        if self._last_pinned is None or self._last_pinned[0] != state.tobytes():
            return False
        n = self.system.n
        lean = self._pin * (self._last_pinned[1].T @ q[: 2 * n])
        held = np.abs(direction @ self.system.r_star).max(initial=0.0)
        # rates on soft springs are large
        carried = (np.abs(self.system.K) @ np.abs(q[: 2 * n])).max()
        accepted = RIGID_TOLERANCE * held + ROUND_OFFS * EPSILON * carried
        return bool(np.abs(lean).max(initial=0.0) > accepted)

    def at(self, state: States, direction: Array) -> Segment:
        """Return the rates in the given states along a leg whose loads change by ``direction``.

        Raises:
            SingularExchange: a motion of the body is left without stiffness.
        """
        q = self._rates(state, direction)
        if self._works_on_pins(state, q, direction):
            raise SingularExchange
        return self.segment(state, q, direction)

    def is_near(self, state: States) -> bool:
        """Return whether the tableau is brought to the given states by a few exchanges."""
        tableau = self._tableau
        return tableau is not None and np.count_nonzero(tableau.state != state) <= 16

    def segment(self, state: States, q: Array, direction: Array) -> Segment:
        """Return the segment with rates (4N,) along a leg."""
        forces = q * self.weight
        n, threshold = len(state), -RATE_TOLERANCE * sqrt(forces.dot(forces))
        # what falls and is not a displacement is bounded: an output A, B or gap of its state
        forces[:n] *= SLIP_SIGN.take(state, mode="clip")  # in less time than with a check
        below = (forces < threshold).nonzero()[0]
        k = below.searchsorted(n)
        falling = below[k:]
        return Segment(q, falling, below[:k])

    def _rates(self, state: States, direction: Array) -> Array:
        """Return the rates in the given states, refined where they do not balance.

        The round-off of a tableau stays in it: where refining has taken as long as a new one would,
        it is renewed.
        """
        renew = self.refinements > 0.1 * self.system.n
        tableau = self.tableau(state, renew)
        if renew:
            self.refinements = 0
        q = tableau.rates(direction)
        imbalance = self.balance.error(q, direction)
        size, of_forces = (np.linalg.norm((q * self.weight)[k:]) for k in (0, 2 * len(state)))
        accepted = max(UNREFINABLE_ROUND_OFFS * EPSILON * size, RATE_TOLERANCE * of_forces)
        for _ in range(3):
            if imbalance <= accepted:
                break
            self.refinements += 1
            better = tableau.refined(q, direction)
            left = self.balance.error(better, direction)
            if left >= imbalance:
                break
            q, imbalance = better, left
        if imbalance > accepted and tableau.matrix.counts[1] and not self.is_loose:
            # pivots on soft springs may leave round-off that refining does not reduce
            self.refinements = 2 * len(state)
            return self._rates(state, direction)
        return q

    @property
    def is_loose(self) -> bool:
        """Whether some states have left a rigid motion free: rates may not be the tableau's."""
        return self._last_pinned is not None

    def values(self, state: ContactState) -> Array:
        """Return y = [v, gap, A, B]; quantities that the states fix get their exact value."""
        y = self.margins(state)
        y[2 * self.system.n :] = np.maximum(y[2 * self.system.n :], 0.0)
        return y

    def margins(self, state: ContactState) -> Array:
        """Return the same, A and B below zero where the limit of friction is passed."""
        key, nodes = state.state.tobytes(), (self.frictional, self.smooth)
        if key not in self._slopes:
            closed = (state.state != SEPARATION) & (self.frictional | self.smooth)
            keep(self._slopes, key, (closed, margin_slopes(self.friction, nodes, state.state)))
        closed, slopes = self._slopes[key]
        # a gap keeps its round-off: times the stiffness it would be a force out of balance
        gap = np.where(closed, 0.0, self.system.g0 + state.w)
        return np.concatenate([state.v, gap, *margins_at(slopes, state.r)])


def keep(some: dict[bytes, Any], key: bytes, one: Any) -> None:
    """Keep one more of what belongs to states at ends of legs, at most four of them."""
    if len(some) == 4:
        del some[next(iter(some))]
    some[key] = one


def tied(segments: Segments, s: float, state: States, on: NDArray[np.bool_]) -> Changes:
    """Return the ties at one place, as changes to the state that a node may take as well.

    That is a direction of slip, or SEPARATION where it has neither gap nor pressure and may take
    any.

    Args:
        segments: of the condensed body.
        s: the place.
        state: (N,) states.
        on: (3N,) gap, A and B that are within round-off of zero, B of nodes without friction too.
    """
    frictional, (gap, A, B) = segments.frictional, on.reshape(3, -1)
    touches = np.where(state == SEPARATION, gap, A & B)
    near = touches | (A | B) & (state == STICK) & frictional
    node = (near & (frictional | segments.smooth)).nonzero()[0]
    side = np.where(A[node], FORWARD, BACKWARD)
    other = np.where(touches[node], SEPARATION, side).astype(np.int8)
    return Changes(np.full(len(node), s), node, state[node], other)


def ties_at(segments: Segments, s: float, y: Array, state: States, force_scale: float) -> Changes:
    """Return the ties at one place, with quantities y (4N,) and states (N,), see :func:`tied`."""
    return tied(segments, s, state, y[len(state) :] <= segments.limit[len(state) :] * force_scale)
