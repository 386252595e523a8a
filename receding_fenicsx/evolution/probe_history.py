"""History of one probe: displacements and stresses at its points along the load path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution import tables
from receding_fenicsx.evolution.record_data import RecordData
from receding_fenicsx.scene.checks import suggestion

if TYPE_CHECKING:
    import pandas as pd

KINDS = np.array(["turning point", "sample", "event"])
"""Kinds of instants, by their number in the record."""


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
        table["point"] = np.tile(np.arange(m), n)
        table |= {axis: np.tile(self.points[:, k], n) for k, axis in enumerate("xy")}
        table |= {key: self.displacement[..., k].ravel() for k, key in enumerate(("ux", "uy"))}
        stresses = ("sxx", "syy", "szz", "sxy")
        table |= {key: self.stress[..., k].ravel() for k, key in enumerate(stresses)}
        table["von_mises"] = self.von_mises.ravel()
        return table

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
    return ProbeHistory(
        name=name,
        points=probes.points[own],
        load_names=record.load_names,
        kind=KINDS[probes.kind],
        cycle=probes.cycle,
        leg=probes.leg,
        s=probes.s,
        load=probes.load,
        displacement=probes.displacement[:, own],
        stress=probes.stress[:, own],
    )
