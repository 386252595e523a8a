"""The branches of a law with cohesion and shear limit, each set of them written as cones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import SEPARATION, SLIP_SIGN, STICK
from receding_fenicsx.interface.system import ContactState, ContactSystem

FRICTION, FORWARD_LIMIT, BACKWARD_LIMIT = range(3)
"""Branch of a node: friction in both directions, or the shear limit in one of them."""
BREAKS, FORMS = 2, 3
"""Kinds of changes of a bond, beside those of the limits forward 0 and backward 1."""


@dataclass(frozen=True)
class Branches:
    """Branches that limit Q, one set of them."""

    branch: NDArray[np.int8]  # (N,) ``FRICTION``, ``FORWARD_LIMIT`` or ``BACKWARD_LIMIT``
    bonded: NDArray[np.bool_]  # (N,) nodes in contact, where the cohesion acts

    @property
    def key(self) -> bytes:
        """The same for equal branches."""
        return self.branch.tobytes() + self.bonded.tobytes()

    @property
    def on_limit(self) -> NDArray[np.bool_]:
        """(2, N) nodes whose limit forward, or backward, is the shear limit."""
        return self.branch == np.array([[FORWARD_LIMIT], [BACKWARD_LIMIT]])


class Cones:
    """Law of a contact with a cohesion or a shear limit.

    Attributes:
        system: the condensed body in 2N form.
        cohesive: (N,) nodes with cohesion.
    """

    def __init__(self, system: ContactSystem) -> None:
        """Write the law of ``system`` so that every node has a branch that grows with P."""
        self.system, n, law = system, system.n, system.law
        cohesion, limit = law.cohesion, law.shear_limit
        rubs = law.present & ~system.held[:n] & ~system.held[n:]
        self._c = np.where(rubs, np.minimum(cohesion, limit), 0.0)
        self._special = rubs & ((cohesion > 0.0) | np.isfinite(limit))
        self.cohesive = self._c > 0.0
        slopes = np.stack([law.forward, law.backward]) * law.present
        flat = self._special & (slopes == 0.0)
        # c = min(P + c, c) where friction adds nothing
        self._slope = np.where(flat, 1.0, slopes)
        self._t = np.where(self._special, np.where(flat, self._c, limit), np.inf)

    def branches_of(self, state: ContactState) -> Branches:
        """Return branches that limit Q in a state."""
        capped = self._t < self._slope * state.P + self._c
        side = np.where(capped[0] & (~capped[1] | (state.Q <= 0.0)), FORWARD_LIMIT, BACKWARD_LIMIT)
        touches = state.state != SEPARATION
        branch = np.where(touches & capped.any(axis=0), side, FRICTION).astype(np.int8)
        return Branches(branch, touches)

    def coulomb(self, now: Branches) -> tuple[ContactSystem, Array]:
        """Return a system of cones alone, and the force (2N,) that its reactions have in addition.

        A = Q + c_A P + d_A and B = c_B P + d_B - Q are the margins of a cone for Q + a, P + b:
        b = (d_A + d_B) / (c_A + c_B), a = d_A - c_A b. The force [a; b] is a load of factor 1.
        """
        slope = np.where(now.on_limit, 0.0, self._slope)
        offset = np.where(now.on_limit, self._t, np.where(now.bonded, self._c, 0.0))
        opening = np.where(self._special, slope.sum(axis=0), 1.0)
        b = offset.sum(axis=0) / opening
        force = np.concatenate([offset[0] - slope[0] * b, b])
        system = replace(
            self.system, f=slope[0], f_backward=slope[1], cohesion=None, shear_limit=None
        )
        if np.any(force):
            names, r_star = (*system.load_names, ""), np.vstack([system.r_star, force])
            system = replace(system, r_star=r_star, load_names=names)
        return system, force

    def other_margins(self, now: Branches, r: Array) -> Array:
        """Return what must not be negative beside the margins of the cones, for r (k, 2N).

        These are (k, 3, N) margins of the branches forward and backward that are not in use, and
        pressures of bonded nodes, infinite where there are none.
        """
        n = self.system.n
        Q, P = r[:, :n], r[:, n:]
        rough = self._slope * P[:, None] + np.where(now.bonded, self._c, 0.0)
        other = np.stack([Q, -Q], axis=1) + np.where(now.on_limit, rough, self._t)
        P = np.where(self.cohesive & now.bonded, P, np.inf)
        margins = np.concatenate([other, P[:, None]], axis=1)
        return np.where(self._special, margins, np.inf)

    def passed(self, now: Branches, margins: Sequence[tuple[int, int]]) -> Branches:
        """Return the branches where margins of :meth:`other_margins` reach zero, or bonds form.

        Each has the number of its kind, ``FORMS`` for a bond, and its node.
        """
        branch, bonded = now.branch.copy(), now.bonded.copy()
        for kind, node in margins:
            if kind in (BREAKS, FORMS):
                bonded[node] = kind == FORMS
                branch[node] = FRICTION if kind == BREAKS else branch[node]
                continue
            limit = (FORWARD_LIMIT, BACKWARD_LIMIT)[kind]
            # one direction keeps its friction, so that A and B tell both Q and P
            branch[node] = FRICTION if branch[node] == limit else limit
        return Branches(branch, bonded)

    def on_branches(self, now: Branches, state: ContactState, close: float) -> NDArray[np.int8]:
        """Return the states (N,) on branches: bonds formed and broken, no slip off the limits."""
        c, force = self.coulomb(now)
        n = len(state.state)
        off = state.Q + force[:n] + c.friction.at_slip(state.state) * (state.P + force[n:])
        stuck = (SLIP_SIGN[state.state] != 0.0) & self._special & (np.abs(off) > close)
        stuck |= self.cohesive & now.bonded & (state.state == SEPARATION)
        opened = self.cohesive & ~now.bonded
        return np.select([opened, stuck], [SEPARATION, STICK], state.state).astype(np.int8)
