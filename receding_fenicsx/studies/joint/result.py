"""Dissipation and stiffness of a joint over the amplitude of a driven load."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.studies.joint.backbone import Backbone
from receding_fenicsx.studies.sweep_table import ERROR, SweepTable

FITTED = 3
"""Least number of amplitudes with dissipation for an exponent."""


@dataclass(frozen=True, repr=False)
class JointCurve:
    """Dissipation and stiffness over the amplitude; arrays over the n amplitudes.

    Attributes:
        drive: name of the driven load.
        amplitude: (n,) load factors.
        dissipation: (n,) per cycle of the limit; NaN where the case failed.
        estimate: (n,) change of the dissipation from a mesh of half as many elements, relative,
            the largest of an amplitude and its neighbours, times the dissipation; NaN without.
        stiffness: (n,) secant: range of the load factor over that of its displacement; of a
            prescribed displacement the inverse, of its conjugate.
        masing: (n,) dissipation by Masing's rule from the first loading.
        slip: (n,) largest slip range of a node in contact.
        kind: kind of each steady state, or "failed".
        backbone: the first loading.
        table: the sweep, with the reasons of failed cases.
        linear: (k,) angular frequencies of the stuck joint, with a mode as drive; else empty.
    """

    drive: str
    amplitude: Array
    dissipation: Array
    estimate: Array
    stiffness: Array
    masing: Array
    slip: Array
    kind: tuple[str, ...]
    backbone: Backbone
    table: SweepTable
    linear: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def masing_defect(self) -> Array:
        """(n,) |D - D_Masing| / D, NaN where nothing is dissipated."""
        D = np.where(self.dissipation > 0.0, self.dissipation, np.nan)
        return np.abs(D - self.masing) / D

    @property
    def omega(self) -> Array:
        """(n,) angular frequency of a driven mode, sqrt(alpha / q)."""
        return np.sqrt(self.stiffness)

    @property
    def zeta(self) -> Array:
        """(n,) damping ratio of a driven mode, D / (2 pi omega^2 q^2)."""
        return self.dissipation * self.stiffness / (2.0 * np.pi * self.amplitude**2)

    @property
    def is_mode(self) -> bool:
        """Whether the drive is a vibration mode."""
        return self.drive.startswith("mode:")

    @property
    def exponent(self) -> tuple[float, float]:
        """Slope of log D over log amplitude, and its standard error; NaN for too few points."""
        alive = self.dissipation > 0.0
        if np.count_nonzero(alive) < FITTED:
            return np.nan, np.nan
        x, y = np.log(self.amplitude[alive]), np.log(self.dissipation[alive])
        slope, level = np.polyfit(x, y, 1)
        rest = y - slope * x - level
        spread = np.sum((x - x.mean()) ** 2)
        return float(slope), float(np.sqrt(rest @ rest / max(len(x) - 2, 1) / spread))

    def rows(self) -> list[dict[str, Any]]:
        """Return the table: a row for each amplitude."""
        names = (
            *("amplitude", "dissipation", "estimate", "stiffness"),
            *("masing", "masing_defect", "slip"),
            *(("omega", "zeta") if self.is_mode else ()),
        )
        columns = [getattr(self, name).tolist() for name in names]
        return [
            dict(zip(names, row, strict=True)) | {"kind": self.kind[k], ERROR: case[ERROR]}
            for k, (*row, case) in enumerate(zip(*columns, self.table.rows, strict=True))
        ]

    def __repr__(self) -> str:
        """Return the range of amplitudes, the exponent, the defect and macroslip."""
        slope, error = self.exponent
        held = self.dissipation[np.isfinite(self.dissipation)]
        rows = [
            ("amplitudes", f"{self.amplitude.min():.6g} to {self.amplitude.max():.6g}"),
            ("dissipation", f"{held.min(initial=np.inf):.6g} to {held.max(initial=0.0):.6g}"),
            ("exponent", f"{slope:.3f} +- {error:.3f} of log D over log amplitude"),
            ("Masing defect", f"at most {np.nanmax([0.0, *self.masing_defect]):.3g}"),
        ]
        alive = np.isfinite(self.estimate) & (self.dissipation > 0.0)
        if np.any(alive):
            worst = np.max(self.estimate[alive] / self.dissipation[alive])
            rows.append(("mesh", f"D changes by at most {worst:.2g} from half as many elements"))
        if np.isfinite(self.backbone.macroslip):
            rows.append(("macroslip", f"at {self.backbone.macroslip:.6g}"))
        if len(self.linear):
            found = ", ".join(f"{omega:.6g}" for omega in self.linear)
            rows.append(("stuck modes", f"omega = {found}"))
        return described(f"JointCurve of '{self.drive}', {len(self.amplitude)} amplitudes", rows)
