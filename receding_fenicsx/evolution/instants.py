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


def event_rows(system: ContactSystem, count: int = 0) -> NDArray[np.void]:
    """Return rows for so many changes of state of modelled nodes.

    Their fields are cycle, leg, s and load, as in :class:`Instant`, the node, its old and new
    state, and the displacements and stresses (6 m,) at the m points of the probes, NaN where they
    are not known.
    """
    probed = 0 if system.probes is None else 6 * len(system.probes.names)
    whole = [(key, "<i4") for key in ("cycle", "node", "leg")]
    loads = ("load", "<f8", (len(system.load_names),))
    states = [("old", "i1"), ("new", "i1")]
    return np.zeros(count, [*whole, *states, ("s", "<f8"), loads, ("probed", "<f8", (probed,))])


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
