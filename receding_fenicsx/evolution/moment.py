"""One instant of a record, asked for by names: ``record.at(cycle=9, load="minimum").p``."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record_data import RecordData, States
from receding_fenicsx.interface.measures.zones import Zone, contact_zones
from receding_fenicsx.interface.system import Array

SAME_LOAD = 1e-9
"""Difference of load factors, over their largest, within which a load is the one asked for."""


@dataclass(frozen=True)
class Moment:
    """The contact at one instant; arrays are over its N nodes, in the order of x.

    Attributes:
        cycle: cycle; 0 is the path to the start of the cycles (first loading).
        leg: straight piece of the load path within the cycle, from 0.
        s: position along the leg, in [0, 1].
        load: load factor of each load, by name.
        load_displacement: work-conjugate displacement of each load, by name.
        x: (N,) positions along the contact edge.
        state: (N,) states 1 to 4, values of ``State``.
        P, Q: (N,) normal and tangential nodal reaction on the body; P > 0 is compression (eq. 12).
        p, q: (N,) tractions, P / weight and Q / weight (0 where the weight is 0).
        v, w: (N,) tangential and normal displacement.
        f: (N,) coefficients of friction.
    """

    cycle: int
    leg: int
    s: float
    load: dict[str, float]
    load_displacement: dict[str, float]
    x: Array
    state: NDArray[np.int8]
    P: Array
    Q: Array
    p: Array
    q: Array
    v: Array
    w: Array
    f: Array

    @property
    def zones(self) -> list[Zone]:
        """Zones of equal state as (name, from, to), from the smallest x to the greatest."""
        return contact_zones(self.x, self.state, self.f)


def moment_of(record: RecordData, table: States, row: int) -> Moment:
    """Return one row of a record's turning points or samples."""
    names = record.load_names
    return Moment(
        cycle=int(table.cycle[row]),
        leg=int(table.leg[row]),
        s=float(table.s[row]),
        load=dict(zip(names, table.load[row].tolist(), strict=True)),
        load_displacement=dict(zip(names, table.load_displacement[row].tolist(), strict=True)),
        x=record.x,
        f=record.f,
        **{key: getattr(table, key)[row] for key in ("state", "P", "Q", "p", "q", "v", "w")},
    )


def find(
    record: RecordData,
    cycle: int,
    load: Literal["minimum", "maximum"] | float | None,
    leg: int | None,
    s: float | None,
) -> Moment:
    """Find the instant that :meth:`Record.at` is asked for; see there."""
    if len(np.unique(record.edge)) > 1:
        raise InputError(
            "the record has several contact edges; ask one of them: record.by_edge()"
            f"['{record.edge_names[0]}'].at(...)"
        )
    for name, value, kind in (("cycle", cycle, Integral), ("leg", leg, Integral), ("s", s, Real)):
        if value is not None and not isinstance(value, kind):
            expected = "whole number" if kind is Integral else "number from 0 to 1"
            raise InputError(f"{name} = {value!r}: must be a {expected}")
    points = record.turning_points
    last = int(points.cycle.max(initial=0))
    number = cycle + last + 1 if cycle < 0 else cycle
    if not 0 <= number <= last or not len(points.s):
        raise InputError(f"cycle {cycle}: is not in the record, which holds cycles 0 to {last}")
    where = f"cycle {number}" if leg is None else f"cycle {number}, leg {leg}"

    def rows_of(table: States) -> NDArray[np.intp]:
        return np.flatnonzero((table.cycle == number) & (leg is None or table.leg == leg))

    turning = rows_of(points)
    if not len(turning):
        legs = int(points.leg[points.cycle == number].max())
        raise InputError(f"{where}: has no such leg; legs are numbered from 0 to {legs}")
    if isinstance(load, str):
        if load not in ("minimum", "maximum") or s is not None:
            raise InputError('load: give "minimum" or "maximum" (without s) or a load factor')
        largest = np.abs(points.load).max(axis=0)
        size = np.abs(points.load[turning] / np.where(largest > 0.0, largest, 1.0)).sum(axis=1)
        best = np.min(size) if load == "minimum" else np.max(size)
        # of several turning points with this load, the cycle's last
        near = np.flatnonzero(np.abs(size - best) <= SAME_LOAD * max(1.0, best))
        return moment_of(record, points, int(turning[near[-1]]))
    if load is None and s is None:
        return moment_of(record, points, int(turning[-1]))
    if load is not None and len(record.load_names) != 1:
        raise InputError("load: the record has several loads; ask by leg and s")
    rows = rows_of(record.samples)
    tables = [(points, int(k)) for k in turning] + [(record.samples, int(k)) for k in rows]
    off = np.zeros(len(tables))
    if load is not None:
        scale = float(np.abs(points.load).max()) or 1.0
        off = np.array([abs(float(t.load[k, 0]) - load) for t, k in tables]) / scale
    if s is not None:
        off = np.maximum(off, [abs(float(t.s[k]) - s) for t, k in tables])
    found = [tables[k] for k in np.flatnonzero(off <= SAME_LOAD)]
    legs_found = {int(t.leg[k]) for t, k in found}
    if len(legs_found) > 1:
        raise InputError(f"{where}: several instants answer; say which leg, {sorted(legs_found)}")
    if not found:
        nearest, k = tables[int(np.argmin(off))]
        raise InputError(
            f"{where}: no such instant is stored; the nearest is leg {int(nearest.leg[k])}, "
            f"s = {float(nearest.s[k]):.12g}, load {nearest.load[k].tolist()} (raise [output] "
            "samples_per_leg or name the cycle in [output] cycles, or replay it: replay.instant_of)"
        )
    return moment_of(record, *found[0])
