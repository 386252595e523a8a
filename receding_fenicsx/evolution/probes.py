"""Displacements and stresses at the probes along the load path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution import tables
from receding_fenicsx.evolution.instants import Instant, Samples, event_rows, events_of
from receding_fenicsx.evolution.record_data import Probes, RecordData
from receding_fenicsx.interface.system import ContactState, ContactSystem, Leg, ProbeMatrix
from receding_fenicsx.scene.checks import suggestion

if TYPE_CHECKING:
    import pandas as pd


KINDS = np.array(["turning point", "sample", "event"])
"""Kinds of instants, by their number in the record."""

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
    """Return displacements and stresses (k, 6 m) at the m points of the probes, at places on a leg.

    Between two events the path is straight, so that values at an event itself are exact; where a
    solver does not tell the displacements there they are linear between its samples. Values are NaN
    where nothing is known, as on a leg that is one static problem.
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

    Of several at a place the first of these is kept.
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
    every, counts = np.concatenate([known, events]), (len(corners), len(sampled), len(events))
    # of equal places the first is returned
    places = np.column_stack([every["cycle"], every["leg"], every["s"]])
    _, rows = np.unique(places, axis=0, return_index=True)
    every = every[rows]
    values = every["probed"].reshape(len(rows), len(probes.points), 6)
    return Probes(
        names=probes.names,
        points=probes.points.copy(),
        kind=np.repeat(np.arange(len(KINDS), dtype=np.int8), counts)[rows],
        cycle=every["cycle"].astype(np.int64),
        leg=every["leg"].astype(np.int64),
        s=every["s"].copy(),
        load=every["load"].copy(),
        displacement=np.ascontiguousarray(values[..., :2]),
        stress=np.ascontiguousarray(values[..., 2:]),
    )


def _values(probes: ProbeMatrix, v: Array, w: Array, load: Array) -> Array:
    """Return the values (n, 6 m) at n instants."""
    rows = probes.rows.reshape(-1, probes.rows.shape[-1])
    return np.hstack([v, w, load]) @ rows.T


@dataclass(frozen=True)
class ProbeHistory:
    """Displacements and stresses at the m points of a probe, at n instants along the load path.

    The instants are all turning points, and the samples and events of the cycles that the record
    keeps. In an axisymmetric body x is r, y is z and s_zz the hoop stress.

    Attributes:
        name: name of the probe.
        points: (m, 2) coordinates.
        load_names: names of the loads.
        kind: (n,) "turning point", "sample" or "event".
        cycle: (n,) cycle; 0 is the first loading.
        leg: (n,) leg within the cycle, from 0.
        s: (n,) position along the leg, in [0, 1].
        load: (n, n_loads) load factors.
        displacement: (n, m, 2) displacements u_x, u_y.
        stress: (n, m, 4) stresses s_xx, s_yy, s_zz, s_xy; tension is positive.
    """

    name: str
    points: Array
    load_names: tuple[str, ...]
    kind: NDArray[np.str_]
    cycle: Ints
    leg: Ints
    s: Array
    load: Array
    displacement: Array
    stress: Array

    def __repr__(self) -> str:
        """Return the points, the instants and the largest von Mises stress in three lines."""
        first, last = (tuple(self.points[k].tolist()) for k in (0, -1))
        where = f"point {first}" if len(self.points) == 1 else f"{first} to {last}"
        n, m = np.unravel_index(np.argmax(self.von_mises), self.von_mises.shape)
        counts = ", ".join(f"{np.count_nonzero(self.kind == kind)} {kind}s" for kind in KINDS)
        instant = f"cycle {self.cycle[n]}, leg {self.leg[n]}, s = {self.s[n]:.6g}"
        return (
            f"Probe {self.name}: {len(self.points)} point(s), {where}\n"
            f"  instants   {counts}, cycles {self.cycle[0]} to {self.cycle[-1]}\n"
            f"  von Mises  largest {self.von_mises[n, m]:.6g}, point {m}, {instant}"
        )

    @property
    def von_mises(self) -> Array:
        """(n, m) von Mises equivalent stress."""
        xx, yy, zz, xy = np.moveaxis(self.stress, -1, 0)
        pairs = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
        return np.asarray(np.sqrt(0.5 * pairs + 3.0 * xy**2))

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Return columns of equal length, with a row for each instant and point.

        The column of a load is "load.NAME", its factor.
        """
        n, m = len(self.s), len(self.points)
        single = {key: getattr(self, key) for key in ("cycle", "leg", "s", "kind")}
        single |= {f"load.{name}": self.load[:, k] for k, name in enumerate(self.load_names)}
        table = {name: np.repeat(values, m) for name, values in single.items()}
        table |= {"point": np.tile(np.arange(m), n)}
        table |= {axis: np.tile(self.points[:, k], n) for k, axis in enumerate("xy")}
        fields = np.concatenate([self.displacement, self.stress, self.von_mises[..., None]], axis=2)
        names = ("ux", "uy", "sxx", "syy", "szz", "sxy", "von_mises")
        return table | {name: fields[..., k].ravel() for k, name in enumerate(names)}

    def to_pandas(self) -> pd.DataFrame:
        """Return :meth:`to_table` as a DataFrame; needs pandas."""
        return tables.optional("pandas").DataFrame(self.to_table())


def probe_names(record: RecordData) -> tuple[str, ...]:
    """Return the names of a record's probes, in their order."""
    return () if record.probes is None else tuple(dict.fromkeys(record.probes.names))


def history_of(record: RecordData, name: str) -> ProbeHistory:
    """Return the history of a probe; see :meth:`Record.probe`."""
    names = probe_names(record)
    if record.probes is None:
        raise InputError(
            f"probe '{name}': the record has no probes; add a table [[probe]] to the scene"
        )
    if name not in names:
        raise InputError(f"probe '{name}': is not in the record; {suggestion(name, names)}")
    probes = record.probes
    own = np.flatnonzero(np.array(probes.names) == name)
    places = {key: getattr(probes, key) for key in ("cycle", "leg", "s", "load")}
    return ProbeHistory(
        name=name,
        points=probes.points[own],
        load_names=record.load_names,
        kind=KINDS[probes.kind],
        displacement=probes.displacement[:, own],
        stress=probes.stress[:, own],
        **places,
    )
