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
        exchanges: (2, 5, 5, 4) kinds (output, input, output, input) to exchange, -1 for none, of
            smooth and frictional nodes, by the old and the new state.
        marks: (N, 5) random number of each state of each node.
        stiffness: unit in which the tableau measures displacements.
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
    stiffness: float
    rate_tolerance: float
    imbalances: tuple[float, float]


class Matrix(NamedTuple):
    """Arrays of a tableau, see :class:`~receding_fenicsx.interface.exact.pivot_matrix.PivotMatrix`.

    Attributes:
        T, U, V: the matrix without, and the factors of, its pending updates.
        counts: number of pending updates, exchanges in all, and whether ``rate`` is up to date.
        rate: (m,) rates of the outputs along the leg.
        row_label, column_label, row_of, column_of: labels and where they are.
        state: (N,) states of the tableau.
        singular: smallest pivot.
        oldest: exchanges after which it is to be made anew.
    """

    T: Array
    U: Array
    V: Array
    counts: Ints
    rate: Array
    row_label: Ints
    column_label: Ints
    row_of: Ints
    column_of: Ints
    state: NDArray[np.int8]
    singular: float
    oldest: int


class Memory(NamedTuple):
    """Rates of the sets of states met, by direction of the leg.

    Attributes:
        table: entry by hash, -1 where there is none.
        used: number of entries.
        mark: (k,) hash of each.
        state: (k, N) states.
        rates: (k, 4N) rates of y.
        threshold: (k,) rate, as a force, below which a quantity falls.
        reversed_nodes: (k,) number of slipping nodes whose rate contradicts their state.
        hit: (k,) quantity that reached its limit last time, -1 where the leg ended.
        stroke: (k, n_loads) rates of r*_k . u.
        imbalance: (k, sums) rates of the sums of the balance check.
        resting: (k,) number of gaps and margins that are zero in these states.
    """

    table: NDArray[np.int32]
    used: Ints
    mark: NDArray[np.uint64]
    state: NDArray[np.int8]
    rates: Array
    threshold: Array
    reversed_nodes: NDArray[np.int32]
    hit: NDArray[np.int32]
    stroke: Array
    imbalance: Array
    resting: NDArray[np.int32]


class Way(NamedTuple):
    """A leg.

    Attributes:
        start, direction: (n_loads,) load factors at its start, and their change.
        mark, back: number of its direction, and of the opposite one.
        on_limit: (4N,) distance from a limit up to which a node is on it.
        accepted: imbalance that need not be removed.
        sample_at: (k,) places of samples.
        end: place at which it ends.
        unloading: part of the leg before its end within which events may be round-off, else 0.
        asks_rates: all rates are asked for.
        asks_choice: consistent states are asked for at each event.
    """

    start: Array
    direction: Array
    mark: np.uint64
    back: np.uint64
    on_limit: Array
    accepted: float
    sample_at: Array
    end: float
    unloading: float
    asks_rates: bool
    asks_choice: bool


class Path(NamedTuple):
    """Path along a leg under way.

    Attributes:
        y, state: (4N,) quantities and (N,) states.
        place: s, where the last events without progress began, and the way to the next event.
        counts: see ``COUNTS``.
        dissipation: (N,) frictional dissipation.
        work: (n_loads,) integral of lambda_k r*_k . du.
        imbalance: (sums,) of the balance check.
        violated: (N,) scratch: 1 << kind of the violated quantities of each node, added up.
        event_at, event: (k,) places and (k, 3) node, old state, new state.
        tie_at, tie: likewise: node, state, other state.
        stop_at, stop: (k,) places and (k, 4N) quantities at events, where asked for.
        stop_label, stop_state, stop_rate: (k,) quantities that have reached their limit there, -1
            at the end, (k, N) states and (k, 4N) rates on the way there, where it is traced.
        sample, sample_state: (k, 4N) and (k, N) at the places of samples.
    """

    y: Array
    state: NDArray[np.int8]
    place: Array
    counts: Ints
    dissipation: Array
    work: Array
    imbalance: Array
    violated: Ints
    event_at: Array
    event: Ints
    tie_at: Array
    tie: Ints
    stop_at: Array
    stop: Array
    stop_label: Ints
    stop_state: NDArray[np.int8]
    stop_rate: Array
    sample: Array
    sample_state: NDArray[np.int8]


COUNTS = range(14)
EVENTS, FIRST, TIES, STOPS, SAMPLES, ROUNDS, HERE, BEGUN, ENTRY, GIVEN, HIT = COUNTS[:11]
STUCK, CHOSEN, ASKED = COUNTS[11:]
"""Places in ``Path.counts``: numbers of events, of those before the present instant, of ties,
stops, samples, of rounds of changes at the present instant, of events without progress; whether
the ties at the start are noted; the present entry of the memory; one more than an entry that is
given for this instant alone, 0 for none; the quantity that has reached its limit last, -1 for none;
and whether, at the present instant, a node that has closed is taken to stick, a choice has been
made, the end of unloading has been asked for."""
