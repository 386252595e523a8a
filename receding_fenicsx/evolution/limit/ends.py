"""Ends of cycles at which round-off alone tells whether nodes stick or slip.

Drifting nodes come to their limits of friction where their margin is smallest in the cycle, often
at its very end. There they may as well stick as begin to slip.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.evolution.cycle_data import FinishedCycle, Samples
from receding_fenicsx.interface.exact.accumulate import EVENT_RESIDUAL
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.residual import local_stiffness, residual_at_rest
from receding_fenicsx.interface.system import ContactState, ContactSystem


def may_stick(
    model: ContactSystem, states: NDArray[np.int8], end: ContactState, force: float
) -> bool:
    """Return whether a state may as well be in other states, in which some slipping nodes stick.

    Args:
        model: the condensed body in 2N form.
        states: (N,) the other states.
        end: the state.
        force: largest nodal force of the history so far.
    """
    differ = states != end.state
    if np.any(differ & ((states != STICK) | (end.state == SEPARATION))):
        return False
    return residual_at_rest(model, replace(end, state=states), force) <= EVENT_RESIDUAL


def sticking_at_end(
    model: ContactSystem, cycle: FinishedCycle, states: NDArray[np.int8]
) -> FinishedCycle | None:
    """Return a cycle that ends in states in which some nodes stick that slip at its end.

    The last event of each, the slip that begins as it comes to its limit at the end, is left out.
    None where that is no slip from stick, or where one has slipped on its last leg, or before it
    and has only come to rest.

    Args:
        model: the condensed body in 2N form.
        cycle: the cycle.
        states: (N,) the states, see :func:`may_stick`.
    """
    *corners, end = cycle.corners
    samples, moving = cycle.samples, [c for c in corners if not np.array_equal(c.load, end.load)]
    before = (moving or corners)[-1]
    sticking = np.flatnonzero(states != end.state.state)
    slip = local_stiffness(model)[0] * np.abs(end.v - before.v)
    begins = (before.state.state == STICK) & (slip <= EVENT_RESIDUAL * cycle.totals.force_scale)
    if not begins[sticking].all():
        return None
    state = replace(end.state, state=states)
    if samples is not None:
        last = {event.node: k for k, event in enumerate(samples.events)}
        left_out = {last[i] for i in sticking.tolist()}
        if any(samples.events[k].old != STICK for k in left_out):
            return None
        events = [event for k, event in enumerate(samples.events) if k not in left_out]
        instants = [*samples.instants[:-1], samples.instants[-1]._replace(state=state)]
        samples = Samples(instants, events)
    images = np.bincount(mirror_of(model).index)
    return replace(
        cycle,
        corners=[*cycle.corners[:-1], end._replace(state=state)],
        samples=samples,
        totals=cycle.totals._replace(events=cycle.totals.events - int(images[sticking].sum())),
    )
