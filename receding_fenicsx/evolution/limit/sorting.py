"""Sort contact nodes: which slip both ways or open in every cycle, which drift, which stick."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.law import SEPARATION
from receding_fenicsx.interface.measures.steady import SLIP_ROUND_OFF
from receding_fenicsx.interface.residual import local_stiffness
from receding_fenicsx.interface.solver import Solver
from receding_fenicsx.interface.system import ContactState, ContactSystem

NEIGHBOURS = 2
"""Nodes on either side of one that drifts that may come to drift."""

SLIP_BACK = 1e-6
"""Part of its slip in a cycle by which a node may drift back after it: round-off."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Sorted:
    """Nodes by what they do in a cycle.

    Attributes:
        rubbing: (N,) nodes with friction, held in no direction.
        frozen: (N,) those of them that do not slip both ways and do not open; only these have a
            limit that depends on the cycles before.
        drifting: (N,) frozen nodes that slip in one direction, and their neighbours among them.
        slip: (N,) slip in the cycle of the nodes that were frozen at first, 0 elsewhere.
        opens: (N,) nodes that are open somewhere in the cycle.
        settling: (N,) frozen nodes that slip both ways, but not for ever.
    """

    rubbing: Mask
    frozen: Mask
    drifting: Mask
    slip: Array
    opens: Mask
    settling: Mask

    def with_moved(self, freed: Mask, drifting: Mask) -> Sorted:
        """Return the same with some nodes freed, and others that drift."""
        frozen = self.frozen & ~freed
        drifting = (self.drifting | drifting) & frozen
        return replace(self, frozen=frozen, drifting=drifting, settling=self.settling & frozen)

    def with_drifting(self, others: Ints | tuple[()], settling: Mask) -> Sorted:
        """Return the same with further frozen nodes that drift, and free ones that settle."""
        drifting = self.drifting | settling
        drifting[list(others)] = True
        settling = self.settling | settling
        return replace(self, frozen=self.frozen | settling, drifting=drifting, settling=settling)

    def go_on(self, shift: Array) -> bool:
        """Return whether frozen nodes that slip in the cycle slip on in the same direction.

        Args:
            shift: (N,) shifts from the start of the cycle to the limit.
        """
        slip = np.where(self.frozen, self.slip, 0.0)
        return bool(np.all(np.sign(slip) * (shift - slip) >= -SLIP_BACK * np.abs(slip)))


def sort_nodes(
    model: ContactSystem, solver: Solver, start: ContactState, loop: Array, force: float
) -> Sorted:
    """Play one cycle from its start and sort the nodes by what they do in it.

    Args:
        model: the condensed body in 2N form.
        solver: plays the legs.
        start: state at the start of the cycle.
        loop: (m + 1, n_loads) load factors of a cycle.
        force: largest nodal force of the history so far.
    """
    n, state = model.n, start
    forward, backward = np.zeros(n), np.zeros(n)
    opens = start.state == SEPARATION
    for a, b in pairwise(loop):
        leg = solver.trace_leg(state, (a, b), force, 1)
        opens[leg.events.node[leg.events.old == SEPARATION]] = True
        opens[leg.events.node[leg.events.new == SEPARATION]] = True
        v = np.array([*(u[:n] for _, u in leg.stops), leg.end.v])
        slip = np.diff(v, axis=0)
        forward += np.maximum(slip, 0.0).sum(axis=0)
        backward += np.maximum(-slip, 0.0).sum(axis=0)
        state = leg.end
    give = SLIP_ROUND_OFF * force / local_stiffness(model)[0]
    slips = np.array([forward > give, backward > give])
    rubbing = model.friction.present & ~model.held[:n] & ~model.held[n:]
    frozen = rubbing & ~opens & ~slips.all(axis=0)
    near = np.convolve(slips.any(axis=0) & frozen, np.ones(2 * NEIGHBOURS + 1))
    slip = np.where(frozen & slips.any(axis=0), forward - backward, 0.0)
    drifting = (near[NEIGHBOURS : NEIGHBOURS + n] > 0.5) & frozen
    return Sorted(rubbing, frozen, drifting, slip, opens, np.zeros(n, dtype=bool))
