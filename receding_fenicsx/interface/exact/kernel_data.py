"""Arrays on which the compiled loop works, as it takes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints


class Contact(NamedTuple):
    """What does not change along a path.

    Attributes:
        frictional, smooth: (N,) nodes with the full contact law, and those with P alone.
        weight: (4N,) brings every entry of y to the size of a nodal force.
        share_A, share_B: (N,) factors a, b of Q = a A - b B.
        sums_of_y, sums_of_load: (sums, 4N) and (sums, n_loads) of the balance check.
        r_star: (n_loads, 2N) held reactions of unit loads.
        exchanges: (3, 5, 5, 4) kinds (output, input, output, input) to exchange, -1 for none, of
            smooth and frictional nodes and the others, by the old and the new state.
        marks: (N, 5) random number of each state of each node.
        rate_tolerance: rate over the norm of all rates below which it counts as zero.
        imbalances: imbalance of rates that is accepted, over the norms of all rates and of forces.
    """

    frictional: NDArray[np.bool_]
    smooth: NDArray[np.bool_]
    weight: Array
    share_A: Array
    share_B: Array
    sums_of_y: Array
    sums_of_load: Array
    r_star: Array
    exchanges: Ints
    marks: NDArray[np.uint64]
    rate_tolerance: float
    imbalances: tuple[float, float]


class Memory(NamedTuple):
    """Rates of the sets of states met, by direction of the leg."""

    table: NDArray[np.int32]  # entry by hash, -1 where there is none
    used: Ints  # number of entries
    mark: NDArray[np.uint64]  # (k,) hash of each
    state: NDArray[np.int8]  # (k, N) states
    rates: Array  # (k, 4N) rates of y
    threshold: Array  # (k,) rate, as a force, below which a quantity falls
    # (k,) number of slipping nodes whose rate contradicts their state
    reversed_nodes: NDArray[np.int32]
    hit: NDArray[np.int32]  # (k,) quantity that reached its limit last time, -1 where the leg ended
    stroke: Array  # (k, n_loads) rates of r*_k . u
    imbalance: Array  # (k, sums) rates of the sums of the balance check
    resting: NDArray[np.int32]  # (k,) number of gaps and margins that are zero in these states


class Way(NamedTuple):
    """A leg."""

    # start, direction: (n_loads,) load factors at its start, and their change
    start: Array
    direction: Array
    # mark, back: number of its direction, and of the opposite one
    mark: np.uint64
    back: np.uint64
    on_limit: Array  # (4N,) distance from a limit up to which a node is on it
    accepted: float  # imbalance that need not be removed
    sample_at: Array  # (k,) places of samples
    end: float  # place at which it ends
    unloading: float  # part of the leg before its end within which events may be round-off, else 0
    asks_rates: bool  # all rates are asked for
    asks_choice: bool  # consistent states are asked for at each event


class Path(NamedTuple):
    """Path along a leg under way."""

    # y, state: (4N,) quantities and (N,) states
    y: Array
    state: NDArray[np.int8]
    # s, where the last events without progress began, the way to the next event, the imbalance that
    # is accepted, and the largest displacement for which it is
    place: Array
    counts: Ints  # see ``COUNTS``
    dissipation: Array  # (N,) frictional dissipation
    work: Array  # (n_loads,) integral of lambda_k r*_k . du
    imbalance: Array  # (sums,) of the balance check
    violated: Ints  # (N,) scratch: 1 << kind of the violated quantities of each node, added up
    # event_at, event: (k,) places and (k, 3) node, old state, new state
    event_at: Array
    event: Ints
    # tie_at, tie: likewise: node, state, other state
    tie_at: Array
    tie: Ints
    # stop_at, stop: (k,) places and (k, 4N) quantities at events, where asked for
    stop_at: Array
    stop: Array
    # stop_label, stop_state, stop_rate: (k,) quantities that have reached their limit there, -1 at
    # the end, (k, N) states and (k, 4N) rates on the way there, where it is traced
    stop_label: Ints
    stop_state: NDArray[np.int8]
    stop_rate: Array
    # sample, sample_state: (k, 4N) and (k, N) at the places of samples
    sample: Array
    sample_state: NDArray[np.int8]


COUNTS = range(13)
EVENTS, FIRST, TIES, STOPS, SAMPLES, ROUNDS, HERE, BEGUN, ENTRY, GIVEN, HIT = COUNTS[:11]
CHOSEN, ASKED = COUNTS[11:]
"""Places in ``Path.counts``: numbers of events, of those before the present instant, of ties,
stops, samples, of rounds of changes at the present instant, of events without progress; whether
the ties at the start are noted; the present entry of the memory; one more than an entry that is
given for this instant alone, 0 for none; the quantity that has reached its limit last, -1 for none;
and whether, at the present instant, a choice has been made, the end of unloading has been asked
for."""
