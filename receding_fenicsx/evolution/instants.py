"""Instants and events of the modelled nodes, and the state at rest that a history starts from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem


class Instant(NamedTuple):
    """State of the modelled nodes at one place of the load path.

    Attributes:
        cycle: cycle, 0 for the path from rest.
        leg: leg of the cycle, from 0.
        s: position along the leg, in [0, 1].
        load: (n_loads,) load factors.
        v: (N,) tangential displacement, also where the solvers work without it.
        state: state in the 2N layout of the solvers.
        shown: (N,) states that pictures show where they differ from those of ``state``.
    """

    cycle: int
    leg: int
    s: float
    load: Array
    v: Array
    state: ContactState
    shown: NDArray[np.int8] | None = None


class Event(NamedTuple):
    """Change of state of one modelled node.

    Attributes:
        cycle, leg, s, load: place on the load path, as in :class:`Instant`.
        node: the modelled node.
        old, new: its states before and after.
        probed: displacements and stresses at the probes, (6 m,); None without probes.
    """

    cycle: int
    leg: int
    s: float
    load: Array
    node: int
    old: int
    new: int
    probed: Array | None = None


def instant(
    system: ContactSystem, place: tuple[int, int, float], load: Array, state: ContactState
) -> Instant:
    """Return a state with its place on the load path.

    Without friction v is no unknown: v = slip_map @ [w; lambda].

    Args:
        system: the condensed body.
        place: cycle, leg and position s.
        load: load factors.
        state: state in the 2N layout of the solvers.
    """
    v = state.v
    if system.slip_map is not None:
        v = system.slip_map @ np.concatenate([state.w, load])
    return Instant(*place, load, v, state)


def rest_state(system: ContactSystem, slip: Array | None = None) -> ContactState:
    """Return the state without loads: u = [slip; 0], r = 0, open nodes where there is a gap.

    Args:
        system: the condensed body.
        slip: (N,) tangential displacement at rest; none when left out.
    """
    n = system.n
    v = np.zeros(n) if slip is None else slip
    state = np.where(system.g0 > 0.0, State.SEPARATION, State.STICK).astype(np.int8)
    return ContactState(np.concatenate([v, np.zeros(n)]), np.zeros(2 * n), state)
