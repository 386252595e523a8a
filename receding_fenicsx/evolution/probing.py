"""Displacements and stresses at the probes, from contact displacements and load factors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.cycle_data import Samples, events_of
from receding_fenicsx.evolution.instants import Instant, event_rows
from receding_fenicsx.evolution.record_data import Probes
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg, ProbeMatrix

TURNING_POINT, SAMPLE, EVENT = range(3)
"""Kinds of instants in a table of probes."""

Places = tuple[Array, Array, Array]
"""Places (k,) on a leg, not decreasing, with displacements (k, 2N) and load factors there."""


def known_places(start: ContactState, ends: tuple[Array, Array], leg: Leg) -> Places:
    """Return the places on a leg at which its displacements are known: start, stops, samples."""
    places = [(0.0, start.u), *leg.stops, *((s, state.u) for s, state in leg.samples)]
    places.sort(key=lambda place: place[0])
    s: Array = np.array([place for place, _ in places], dtype=float)
    load: Array = np.outer(1.0 - s, ends[0]) + np.outer(s, ends[1])
    return s, np.array([u for _, u in places]), load


def probed_at(system: ContactSystem, known: Places | None, wanted: Array) -> Array:
    """Return displacements and stresses (6 m,) at the probes, at places along a leg.

    Between two events the path is straight, so that values at an event itself are exact; where a
    solver does not tell the displacements there they are linear between its samples.

    Args:
        system: the condensed body.
        known: where the displacements are known; None for a leg that is one static problem.
        wanted: (k,) places of events.

    Returns:
        The values (k, 6 m) at each place, NaN where nothing is known; m = 0 without probes.
    """
    if system.probes is None or known is None or not len(wanted):
        return np.full((len(wanted), event_rows(system)["probed"].shape[1]), np.nan)
    s, u, load = known
    v, w = u[:, : system.n], u[:, system.n :]
    if system.slip_map is not None:
        v = np.hstack([w, load]) @ system.slip_map.T
    values = _values(system.probes, v, w, load)
    # of several known at one place, the last: after a jump
    before = np.searchsorted(s, wanted, side="right") - 1
    after = np.minimum(before + 1, len(s) - 1)
    length = s[after] - s[before]
    part = np.divide(wanted - s[before], length, out=np.zeros(len(wanted)), where=length > 0.0)
    found: Array = values[before] + part[:, None] * (values[after] - values[before])
    return found


def probes_table(
    system: ContactSystem, corners: list[Instant], samples: list[Samples]
) -> Probes | None:
    """Return the record's table of the probes: turning points, samples and events, in order.

    At each place of the load path there is one instant: a turning point rather than the sample or
    event there.

    Args:
        system: the condensed body.
        corners: ends of the legs.
        samples: samples and events of the kept cycles.

    Returns:
        The table; None for a system without probes.
    """
    probes = system.probes
    if probes is None:
        return None
    sampled = [instant for part in samples for instant in part.instants]
    events, instants = events_of(system, samples), corners + sampled
    events = events[~np.isnan(events["probed"]).any(axis=1)]
    known = event_rows(system, len(instants))
    for key in ("cycle", "leg", "s", "load"):
        known[key] = np.array([getattr(i, key) for i in instants]).reshape(known[key].shape)
    if instants:
        v, w = np.array([i.v for i in instants]), np.array([i.state.w for i in instants])
        known["probed"] = _values(probes, v, w, known["load"])
    every = np.concatenate([known, events])
    counts = len(corners), len(sampled), len(events)
    kind = np.repeat(np.array([TURNING_POINT, SAMPLE, EVENT], dtype=np.int8), counts)
    cycle, leg, s = every["cycle"].astype(np.int64), every["leg"].astype(np.int64), every["s"]
    rows = _in_order(kind, cycle, leg, s)
    values = every["probed"][rows].reshape(len(rows), -1, 6)
    return Probes(
        names=probes.names,
        points=probes.points,
        kind=kind[rows],
        cycle=cycle[rows],
        leg=leg[rows],
        s=s[rows],
        load=every["load"][rows],
        displacement=np.ascontiguousarray(values[..., :2]),
        stress=np.ascontiguousarray(values[..., 2:]),
    )


def _values(probes: ProbeMatrix, v: Array, w: Array, load: Array) -> Array:
    """Return the values (n, 6 m) at n instants."""
    rows = probes.rows.reshape(-1, probes.rows.shape[-1])
    return np.hstack([v, w, load]) @ rows.T


def _in_order(kind: NDArray[np.int8], cycle: Ints, leg: Ints, s: Array) -> Ints:
    """Return the rows in the order of the load path, the first kind at each place."""
    order = np.lexsort((kind, s, leg, cycle))
    places = np.column_stack([cycle[order], leg[order], s[order]])
    new = np.ones(len(order), dtype=bool)
    new[1:] = np.any(places[1:] != places[:-1], axis=1)
    return order[new]
