"""Selection of one stored instant of a record: ``record.at(cycle=9, load="minimum").p``."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, check_types, over_largest
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record_data import RecordData, States
from receding_fenicsx.interface.law import friction_of
from receding_fenicsx.interface.measures.tractions import Tractions, recover
from receding_fenicsx.interface.measures.zones import Zone, zones

SAME_LOAD = 1e-9
"""Difference of load factors, over their largest, below which they count as equal."""


@dataclass(frozen=True)
class Moment:
    """The contact at one instant; arrays are over its N nodes, in the order of x.

    Attributes:
        cycle: cycle; 0 is the path to the start of the cycles (first loading).
        leg: straight piece of the load path within the cycle, from 0.
        s: position along the leg, in [0, 1].
        load: load factor of each load, by name.
        load_displacement: work-conjugate displacement of each load, by name; of a prescribed
            displacement the force along it times the displacement at factor 1.
        x: (N,) positions along the contact edge.
        state: (N,) states 1 to 4, values of ``State``.
        P, Q: (N,) normal and tangential nodal reaction on the body; P > 0 is compression (eq. 12).
        p, q: (N,) tractions, P / weight and Q / weight (0 where the weight is 0).
        v, w: (N,) tangential and normal displacement.
        f: (N,) coefficients of friction; for forward slip only where ``f_backward`` is given.
        f_backward: (N,) coefficients for backward slip, or None.
        begins_on_axis: the contact edge begins on the axis r = 0, at x = 0.
        cohesion, shear_limit: (N,) tractions c and t of the limits min(f p + c, t) of |q|, or None.
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
    f_backward: Array | None = None
    begins_on_axis: bool = False
    cohesion: Array | None = None
    shear_limit: Array | None = None

    @property
    def zones(self) -> list[Zone]:
        """Zones of equal state as (name, from, to), from the smallest x to the greatest."""
        branches = self.cohesion, self.shear_limit
        rubs = friction_of(self.f, self.f_backward, branches=branches).present
        return zones(self.x, self.state, self.begins_on_axis, rubs)


def moment_of(record: RecordData, table: States, row: int) -> Moment:
    """Return one row of a record's turning points or samples."""
    names, own = record.load_names, "x f f_backward begins_on_axis cohesion shear_limit".split()
    return Moment(
        cycle=int(table.cycle[row]),
        leg=int(table.leg[row]),
        s=float(table.s[row]),
        load=dict(zip(names, table.load[row].tolist(), strict=True)),
        load_displacement=dict(zip(names, table.load_displacement[row].tolist(), strict=True)),
        **{key: getattr(record, key) for key in own},
        **{key: getattr(table, key)[row] for key in ("state", "P", "Q", "p", "q", "v", "w")},
    )


def recovered_tractions(record: RecordData, moment: Moment) -> tuple[Array, Array]:
    """Return tractions p and q without the zigzag of elements of order 2.

    See :mod:`receding_fenicsx.interface.measures.tractions`. Resultants, p >= 0, |q| <= f p, and
    |q| = f p at slipping nodes hold as for ``moment.p`` and ``moment.q``, which are returned on
    elements of order 1 and beside ends of contact.

    Args:
        record: the record, of one contact edge (see :meth:`Record.by_edge`).
        moment: one of its instants, such as ``record.at(9, "minimum")``.

    Returns:
        p and q, (N,) each.

    Raises:
        InputError: the instant is not one of the record, or the record has several contact edges.
    """
    if len(np.unique(record.edge)) > 1 or not np.array_equal(moment.x, record.x):
        raise InputError(
            "recovered_tractions: give an instant and the record of its contact edge; of several "
            "edges record.by_edge() has the record of each"
        )
    forces = moment.P, moment.Q, moment.state, record.friction
    return recover(Tractions(record.x, record.weight, *forces, radius=record.radius))


def find(
    record: RecordData,
    cycle: int,
    load: Literal["minimum", "maximum"] | float | None,
    leg: int | None,
    s: float | None,
) -> Moment:
    """Find the stored instant that :meth:`Record.at` selects; see there."""
    check_types("at", cycle=(cycle, Integral), leg=(leg, Integral, None), s=(s, Real, None))
    if len(np.unique(record.edge)) > 1:
        raise InputError(
            "the record has several contact edges; ask one of them: record.by_edge()"
            f"['{record.edge_names[0]}'].at(...)"
        )
    points, samples = record.turning_points, record.samples
    last = int(points.cycle.max(initial=0))
    number = cycle + last + 1 if cycle < 0 else cycle
    if not 0 <= number <= last or not len(points.s):
        raise InputError(f"cycle {cycle}: is not in the record, which holds cycles 0 to {last}")
    where = f"cycle {number}" if leg is None else f"cycle {number}, leg {leg}"
    ends = _rows_of(points, number, leg)
    if not len(ends):
        legs = int(points.leg[points.cycle == number].max())
        raise InputError(f"{where}: has no such leg; legs are numbered from 0 to {legs}")
    if isinstance(load, str):
        if load not in ("minimum", "maximum") or s is not None:
            raise InputError('load: give "minimum" or "maximum" (without s) or a load factor')
        return moment_of(record, points, extreme_row(points, ends, load))
    if load is None and s is None:
        return moment_of(record, points, int(ends[-1]))
    if load is not None and len(record.load_names) != 1:
        raise InputError("load: the record has several loads; ask by leg and s")
    at = _rows_of(samples, number, leg)
    legs, places, loads = (
        np.concatenate([getattr(points, key)[ends], getattr(samples, key)[at]])
        for key in ("leg", "s", "load")
    )
    off = np.zeros(len(legs))
    if load is not None:
        off = np.abs(loads[:, 0] - load) / (np.abs(points.load).max() or 1.0)
    if s is not None:
        off = np.maximum(off, np.abs(places - s))
    found, k = np.flatnonzero(off <= SAME_LOAD), int(np.argmin(off))
    several = np.unique(legs[found]).tolist()
    if len(several) > 1:
        raise InputError(f"{where}: several instants answer; say which leg, {several}")
    if not several:
        raise InputError(
            f"{where}: no such instant is stored; the nearest is leg {legs[k]}, "
            f"s = {places[k]:.12g}, load {loads[k].tolist()} (raise [output] "
            "samples_per_leg or name the cycle in [output] cycles, or replay it: replay.instant_of)"
        )
    k = int(found[0]) - len(ends)
    return moment_of(record, *((points, int(ends[k])) if k < 0 else (samples, int(at[k]))))


def _rows_of(table: States, cycle: int, leg: int | None) -> NDArray[np.intp]:
    """Return the rows of a cycle, or of one leg of it."""
    return np.flatnonzero((table.cycle == cycle) & (leg is None or table.leg == leg))


def extreme_row(points: States, rows: NDArray[np.intp], load: str) -> int:
    """Return the last of the rows with the smallest or largest loads, each over its maximum."""
    size = np.abs(over_largest(points.load[rows], points.load)).sum(axis=1)
    best = np.min(size) if load == "minimum" else np.max(size)
    return int(rows[np.flatnonzero(np.abs(size - best) <= SAME_LOAD * max(1.0, best))[-1]])
