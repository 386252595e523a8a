"""Result of a wear study: the contact over the cycles, table, summary."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import Mirror, mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.scene.toml_file import from_toml
from receding_fenicsx.studies.wear.steps import NodePairs

COLUMNS = (
    *("cycles", "depth_max", "width", "volume", "dissipation"),
    *("contact_half_width", "stick_half_width"),
)
"""Columns of ``wear.csv``."""
WORN = 1e-3
"""Depth over the largest one above which a node belongs to the scar."""


@dataclass(frozen=True, repr=False)
class WearStudy:
    """The contact over the cycles: n rows, from 0 cycles, and the N nodes of the whole contact.

    Attributes:
        model: the mechanics.
        rows: (n,) rows of :func:`~receding_fenicsx.studies.wear.steps.row_type`.
        share: part of the wear that the first body takes.
        end: why the last row is the last one.
        coarse: the study on a coarser mesh at the same cycles, where one fits.
    """

    model: NodePairs
    rows: NDArray[Any]
    share: float
    end: str
    coarse: WearStudy | None = None

    @property
    def system(self) -> ContactSystem:
        """The unworn contact."""
        return self.model.whole.system

    @property
    def mirror(self) -> Mirror:
        """Map from the modelled nodes to the whole contact."""
        return mirror_of(self.system)

    @property
    def x(self) -> Array:
        """(N,) positions along the contact edge."""
        return self.mirror.odd(self.system.x)

    @property
    def cycles(self) -> Array:
        """(n,) numbers of cycles."""
        return np.asarray(self.rows["cycles"])

    @property
    def depth(self) -> Array:
        """(n, N) depth that both bodies have lost together."""
        return self.mirror.even(self.rows["depth"])

    @property
    def depth_of_bodies(self) -> Array:
        """(n, 2, N) depth that each body has lost."""
        if self.model.carried:
            return self.mirror.even(self.rows["worn"])
        shares = np.array([self.share, 1.0 - self.share])
        return np.asarray(shares[:, None] * self.depth[:, None])

    @property
    def pressure(self) -> Array:
        """(n, N) contact pressure at the turning point with the largest normal force."""
        weight = self.mirror.total(self.system.weight)
        return self.mirror.total(self.rows["P"]) / np.where(weight > 0.0, weight, np.inf)

    @property
    def slip(self) -> Array:
        """(n, N) sliding distance of a cycle."""
        return self.mirror.even(self.rows["path"])

    @property
    def zone(self) -> NDArray[np.int8]:
        """(n, N) state over a whole cycle: separation, stick, or (forward) slip."""
        return np.asarray(self.rows["zone"][:, self.mirror.index])

    @property
    def dissipation_per_cycle(self) -> Array:
        """(n,) dissipation of the limit cycle."""
        return np.asarray(self.mirror.factor * self.rows["energy"].sum(axis=1))

    @property
    def dissipation(self) -> Array:
        """(n,) dissipation since the start."""
        return np.asarray(self.mirror.factor * self.rows["dissipated"])

    @property
    def volume(self) -> Array:
        """(n,) worn volume of both bodies; of a plane problem that of unit thickness."""
        return np.asarray(self.mirror.factor * (self.rows["depth"] @ self.system.weight))

    @property
    def volume_estimate(self) -> Array:
        """(n,) estimated error of the volume by the steps and the mesh."""
        steps = self.mirror.factor * (self.rows["estimate"] @ self.system.weight)
        return steps + self.mesh_error * self.volume

    @property
    def depth_max(self) -> Array:
        """(n,) largest depth."""
        return np.asarray(self.rows["depth"].max(axis=1))

    @property
    def depth_estimate(self) -> Array:
        """(n,) estimated error of the largest depth by the steps and the mesh.

        Infinite at an end of a contact edge, whose corner makes it grow with every finer mesh.
        """
        error = self.rows["estimate"].max(axis=1) + self.mesh_error * self.depth_max
        at_corner = ends_of_edges(self.system)[self.rows["depth"].argmax(axis=1)]
        return np.where(at_corner & (self.depth_max > 0.0), np.inf, error)

    @property
    def mesh_error(self) -> Array:
        """(n,) estimated relative error by the mesh: errors are of first order at zone ends.

        It is the largest change of depth and volume, as a single one may be small by chance.
        """
        if self.coarse is None or len(self.rows) < 2:
            return np.zeros(len(self.rows))
        coarse = self.coarse
        ratio = (len(self.x) - 1) / (len(coarse.x) - 1)
        same = np.searchsorted(coarse.cycles, self.cycles, side="right") - 1
        changes = [
            np.abs(1.0 - other[same[1:]] / own[1:])
            for own, other in ((self.volume, coarse.volume), (self.depth_max, coarse.depth_max))
        ]
        return np.append(0.0, np.max(changes, axis=0) / (ratio - 1.0))

    @property
    def width(self) -> Array:
        """(n,) width of the scar."""
        depth = self.depth
        largest = depth.max(axis=1, keepdims=True)
        return self._length((depth > WORN * largest) & (depth > 0.0))

    @property
    def contact_half_width(self) -> Array:
        """(n,) half the length that touches in a cycle; a radius where that begins on the axis."""
        return 0.5 * self._length(self.zone != State.SEPARATION)

    @property
    def stick_half_width(self) -> Array:
        """(n,) half the length that sticks throughout a cycle."""
        return 0.5 * self._length(self.zone == State.STICK)

    def _length(self, marked: NDArray[np.bool_]) -> Array:
        """Return the length of marked nodes; zones end midway between nodes."""
        x, edge = self.x, self.system.edges[self.mirror.index]
        half = np.where(np.diff(edge) == 0, 0.5 * np.diff(x), 0.0)
        length = np.append(half, 0.0) + np.append(0.0, half)
        return np.asarray(marked @ length)

    def table(self) -> list[dict[str, float]]:
        """Return the rows of ``wear.csv``."""
        columns = {name: getattr(self, name).tolist() for name in COLUMNS}
        return [{name: columns[name][k] for name in COLUMNS} for k in range(len(self.rows))]

    def record(self, row: int) -> Record:
        """Return the record of the cycle of a row: all that a run knows of the worn contact.

        Raises:
            InputError: the profiles are carried along by the stroke.
        """
        if self.model.carried:
            raise InputError("wear: profiles that a stroke carries along have no single cycle")
        return self.model.record(self.rows[row])

    def fatigue(self) -> list[dict[str, Any]]:
        """Return the fatigue parameters at some of the cycles, evenly by the depth."""
        scene = from_toml(self.system.scene_toml) if self.system.scene_toml else None
        if scene is None or scene.fatigue is None or self.model.carried:
            return []
        return [
            {"cycles": float(self.cycles[k]), **fatigue_summary(self.record(k))["fatigue"]}
            for k in self.shown(11)
        ]

    def shown(self, count: int) -> NDArray[np.int64]:
        """Return at most so many rows, the first and the last one among them, evenly by depth."""
        wanted = np.linspace(0.0, self.depth_max[-1], count)
        nearest = [np.argmin(np.abs(self.depth_max - value)) for value in wanted]
        return np.unique([*nearest, len(self.rows) - 1])

    def summary(self) -> dict[str, Any]:
        """Return the content of ``wear.json`` but for the scene and the costs."""
        return {
            "end": self.end,
            "steps": len(self.rows) - 1,
            **self.table()[-1],
            "estimates": {
                "depth_max": float(self.depth_estimate[-1]),
                "volume": float(self.volume_estimate[-1]),
            },
            "carried": self.model.carried,
            "fatigue": self.fatigue(),
            "dissipation_per_cycle": self.dissipation_per_cycle.tolist(),
            "profile": {
                "x": self.x.tolist(),
                "depth": self.depth[-1].tolist(),
                "depth_of_bodies": self.depth_of_bodies[-1].tolist(),
                "pressure": self.pressure[-1].tolist(),
                "slip": self.slip[-1].tolist(),
            },
        }

    def write(self, folder: Path) -> None:
        """Write ``wear.csv`` and ``wear.npz``, the fields over cycles and nodes."""
        with new_file(folder / "wear.csv", overwrite=True) as beside:
            with open(beside, "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, COLUMNS)
                writer.writeheader()
                writer.writerows(self.table())
        names = ("x", "cycles", "depth", "depth_of_bodies", "pressure", "slip", "zone")
        more = ("dissipation_per_cycle", "volume", "volume_estimate")
        with new_file(folder / "wear.npz", overwrite=True) as beside, open(beside, "wb") as file:
            np.savez_compressed(file, **{name: getattr(self, name) for name in names + more})

    def __repr__(self) -> str:
        """Return the last row, its estimates, and the end."""
        last = self.table()[-1]
        half = [f"{last[name]:.6g}" for name in COLUMNS[5:]]
        by = " (steps)" if self.coarse is None else " (steps, mesh)"
        rows = [
            ("end", self.end),
            ("depth", f"{last['depth_max']:.6g} +- {self.depth_estimate[-1]:.1g}{by}"),
            ("volume", f"{last['volume']:.6g} +- {self.volume_estimate[-1]:.1g}{by}"),
            ("scar", f"{last['width']:.6g} wide"),
            ("half widths", f"contact {half[0]}, stick {half[1]}"),
            ("dissipation", f"{last['dissipation']:.6g}"),
        ]
        return described(f"Wear: {last['cycles']:.6g} cycles in {len(self.rows) - 1} steps", rows)


def ends_of_edges(system: ContactSystem) -> NDArray[np.bool_]:
    """Return which nodes are ends of contact edges, (N,), but not on an axis of symmetry."""
    apart = np.diff(system.edges, prepend=-1, append=-1) != 0
    found = apart[:-1] | apart[1:]
    if system.half or system.axisymmetric:
        found &= np.abs(system.points[:, 0]) > 1e-9 * np.abs(system.points).max()
    return found
