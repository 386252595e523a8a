"""The contact law of a node: unilateral contact and Coulomb friction (eqs. 4 to 10).

Friction may differ for the two directions of slip. With the coefficients f_forward and f_backward
the tangential reaction Q and the normal reaction P on the body satisfy

    A = Q + f_forward P >= 0,    B = f_backward P - Q >= 0,

where A = 0 in forward slip (v grows) and B = 0 in backward slip (v falls). All solvers, residuals
and replays take states, signs, margins and limits from this module.

With a cohesion c and a shear limit t, forces of a node (traction times weight), the limits of a
node in contact are

    -min(f_forward P + c, t) <= Q <= min(f_backward P + c, t).

The limit of an open node is 0: a bond forms where a gap closes, and breaks where the pressure
vanishes. The solvers know cones only;
:mod:`receding_fenicsx.interface.shear_branches` gives each of them a cone of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array


class State(IntEnum):
    """The four states of a contact node, numbered as in section 2 of the paper."""

    STICK = 1
    SEPARATION = 2
    FORWARD_SLIP = 3
    BACKWARD_SLIP = 4


STATE_NAMES = {s: s.name.lower().replace("_", " ") for s in State}
"""Names of the states in words."""

STICK, SEPARATION = int(State.STICK), int(State.SEPARATION)
FORWARD, BACKWARD = int(State.FORWARD_SLIP), int(State.BACKWARD_SLIP)

SLIP_SIGN = np.zeros(len(State) + 1)
SLIP_SIGN[FORWARD], SLIP_SIGN[BACKWARD] = 1.0, -1.0
"""Sign of the slip rate in each state; 0 in stick and separation."""

MIRRORED = np.array([0, STICK, SEPARATION, BACKWARD, FORWARD], np.int8)
"""State of the mirror image of a node in each state."""


@dataclass(frozen=True)
class Friction:
    """Coefficients of friction for forward and backward slip, cohesion and shear limit as forces.

    Methods broadcast the nodes along the last axis of reactions; ``friction[nodes, None]`` serves
    matrices whose rows are nodes.

        >>> friction = Friction(np.array([0.5]), np.array([0.25]))
        >>> Q, P = np.array([-1.0]), np.array([4.0])
        >>> A, B = friction.margins(Q, P)
        >>> A.tolist(), B.tolist(), friction.limits(P)[0].tolist()
        ([1.0], [2.0], [-2.0])
    """

    forward: Array
    backward: Array
    cohesion: Array | float = 0.0
    shear_limit: Array | float = np.inf

    def __getitem__(self, key: Any) -> Friction:
        """Return the coefficients of some nodes."""
        parts: list[Any] = [self.forward, self.backward, self.cohesion, self.shear_limit]
        return Friction(*(part[key] if isinstance(part, np.ndarray) else part for part in parts))

    @property
    def is_cone(self) -> bool:
        """Whether there is neither cohesion nor shear limit."""
        return bool(np.all(np.isinf(self.shear_limit)) and not np.any(self.cohesion))

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """True at nodes with friction in either direction."""
        rubs = (self.forward > 0.0) | (self.backward > 0.0) | (np.asarray(self.cohesion) > 0.0)
        return rubs & (np.asarray(self.shear_limit) > 0.0)

    @property
    def mean(self) -> Array:
        """Mean of both coefficients, half the opening of the friction cone."""
        return 0.5 * (self.forward + self.backward)

    @property
    def largest(self) -> Array:
        """Larger one of both coefficients."""
        return np.maximum(self.forward, self.backward)

    def largest_limit(self, P: Array) -> Array:
        """Return the larger one of both limits of |Q| at a pressure that is not negative."""
        return self._limit(self.largest, P)

    @property
    def shares(self) -> tuple[Array, Array]:
        """Factors a, b of Q = a A - b B; 1/2 without friction.

        With P = (A + B) / (f_forward + f_backward): a = f_backward / (f_forward + f_backward) and
        b = f_forward / (f_forward + f_backward).
        """
        opening = np.where(self.present, self.forward + self.backward, 1.0)
        a, b = self.backward / opening, self.forward / opening
        return np.where(self.present, a, 0.5), np.where(self.present, b, 0.5)

    @property
    def mirrored(self) -> Friction:
        """Friction of the mirror image, whose forward slip is backward slip here."""
        return replace(self, forward=self.backward, backward=self.forward)

    def margins(self, Q: Array, P: Array) -> tuple[Array, Array]:
        """Return the distances A = Q + f_forward P and B = f_backward P - Q from both limits."""
        return Q + self._limit(self.forward, P), self._limit(self.backward, P) - Q

    def _limit(
        self, coefficient: Array, P: Array, touches: NDArray[np.bool_] | bool = True
    ) -> Array:
        """Return the size of one limit; without contact there is no cohesion."""
        limit = coefficient * P
        if np.ndim(self.cohesion) or self.cohesion:
            limit = limit + self.cohesion * touches
        if np.ndim(self.shear_limit) or self.shear_limit < np.inf:
            limit = np.minimum(limit, self.shear_limit)
        return limit

    def opening(self, P: Array) -> Array:
        """Return A + B = (f_forward + f_backward) P, the distance between both limits."""
        return (self.forward + self.backward) * P

    def limits(self, P: Array, touches: NDArray[np.bool_] | bool = True) -> tuple[Array, Array]:
        """Return the lowest and the highest Q; -f_forward P+, f_backward P+ for a cone, P+ >= 0."""
        slopes, pressing = (self.forward, self.backward), np.maximum(P, 0.0)
        forward, backward = (self._limit(slope, pressing, touches) for slope in slopes)
        return -forward, backward

    def at_slip(self, state: NDArray[np.integer]) -> Array:
        """Return the signed coefficient c of slipping nodes, Q = -c P; 0 in other states."""
        slip = np.where(state == BACKWARD, -self.backward, 0.0)
        return np.where(state == FORWARD, self.forward, slip)

    def slip_force(self, state: NDArray[np.integer], P: Array) -> Array:
        """Return the tangential reaction of slipping nodes; 0 in other states."""
        forward, backward = self._limit(self.forward, P), self._limit(self.backward, P)
        return np.where(state == FORWARD, -forward, np.where(state == BACKWARD, backward, 0.0))


def friction_of(
    f: Array,
    f_backward: Array | None,
    weight: Array | float = 1.0,
    branches: tuple[Array | None, Array | None] = (None, None),
) -> Friction:
    """Return the law of nodes from their weights, and cohesion and shear limit as tractions."""
    backward, (cohesion, limit) = f if f_backward is None else f_backward, branches
    return Friction(
        f,
        backward,
        0.0 if cohesion is None else weight * cohesion,
        np.inf if limit is None else weight * limit,
    )


def natural_states(
    friction: Friction,
    P: Array,
    trial: tuple[Array, Array],
    loose: NDArray[np.bool_],
    can_open: NDArray[np.bool_],
) -> NDArray[np.int8]:
    """Return the states whose pieces of the natural map hold at a trial point.

    A node is open where the trial pressure is not positive. In contact it slips where the trial
    tangential reaction is beyond a limit, or without friction, and sticks elsewhere. P sets the
    limits, ``trial`` are Q - k_t dv and P - k_n g; ``loose`` nodes are not held tangentially,
    those that ``can_open`` not normally.
    """
    low, high = friction.limits(P)
    state = np.full(len(P), STICK, dtype=np.int8)
    state[loose & ((trial[0] < low) | ~friction.present)] = FORWARD
    state[loose & (trial[0] > high)] = BACKWARD
    state[can_open & (trial[1] <= 0.0)] = SEPARATION
    return state


def sticks(Q: float, P: float, f_forward: float, f_backward: float) -> bool:
    """Return whether one node sticks: P > 0, -f_forward P <= Q <= f_backward P (eq. 5)."""
    return P > 0.0 and -f_forward * P <= Q <= f_backward * P


def slips(state: int, slip: float, P: float) -> bool:
    """Return whether one node slips in the direction of a state: P > 0 and no slip against it."""
    return P > 0.0 and (slip >= 0.0 if state == FORWARD else slip <= 0.0)


def margin_slopes(
    friction: Friction,
    nodes: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    state: NDArray[np.int8],
) -> Array:
    """Return the slopes of the margins A and B over Q and P in given states (N,): (2, 2, N).

    At a slipping node one margin is zero and the other A + B: as a difference of Q and f P it
    would carry the round-off of Q, which a small f P does not bear. Both are zero at an open node,
    and at one that a support holds normally, which has no limit. ``nodes`` are those with friction,
    a cone, and smooth ones, at which P stands in place of A.
    """
    frictional, smooth = nodes
    stuck, contact = frictional & (state == STICK), state != SEPARATION
    backward, forward = frictional & (state == BACKWARD), frictional & (state == FORWARD)
    opening, Q = friction.opening(np.ones(len(state))), np.where(stuck, 1.0, 0.0)
    A = np.select([smooth & contact, stuck, backward], [1.0, friction.forward, opening])
    B = np.select([stuck, forward], [friction.backward, opening])
    return np.array([[Q, A], [-Q, B]])


def margins_at(slopes: Array, r: Array) -> Array:
    """Return the margins A and B (2, N) of reactions (2N,), or their rates, from their slopes."""
    Q, P = r.reshape(2, -1)
    return slopes[:, 0] * Q + slopes[:, 1] * P
