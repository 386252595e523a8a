"""Record of an evolved history: the same arrays as in ``record.h5``, and their selection.

Everything here describes the whole contact, also when half of the body was modelled. ::

    record = receding_fenicsx.read_record("results/block/record.h5")
    low = record.at(cycle=9, load="minimum")
    low.p, low.q, low.v, low.zones          # arrays over the contact nodes record.x
    record.cycles.dissipation               # one value a cycle, from cycle 1
    record.to_pandas("turning_points")      # a labelled table, where pandas is installed
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Ints
from receding_fenicsx.evolution import description, moment, tables
from receding_fenicsx.evolution.probes import ProbeHistory, history_of
from receding_fenicsx.evolution.record_data import Events, RecordData, States
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import known_scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray

DISSIPATION_ROUND_OFF = 1e-13
"""Dissipation over contact force times slip below which it is round-off."""


@dataclass(repr=False)
class Record(RecordData):
    """Result of one evolved history: its arrays, and ways to select from them.

    The arrays are those of :class:`~receding_fenicsx.evolution.record_data.RecordData`.
    """

    def __repr__(self) -> str:
        """Return what the record is of and its headline numbers, at most 30 lines."""
        title = "a History" if self.scene is None else self.scene.title
        return description.text_of(self, title, self.by_edge())

    def _repr_html_(self) -> str:
        """Return the description for a notebook, with the zones of the last cycle."""
        return description.html_of(repr(self), self.by_edge())

    @cached_property
    def scene(self) -> Scene | None:
        """The scene that was evolved, parsed once from ``scene_toml``; None where there is none."""
        return known_scene(self.scene_toml) if self.scene_toml else None

    @property
    def corner_ends(self) -> list[int]:
        """Ends of the contact edge, 0 or -1, that are not on the axis or a plane of symmetry.

        An end that a support holds tangentially lies on a plane of symmetry, unless supports hold
        single points only.
        """
        supports = self.scene.supports if self.scene else ()
        points_only = bool(supports) and all(support.edge is None for support in supports)
        held = () if self.held is None or points_only else self.held
        first = self.begins_on_axis or np.any(held[:1])
        return [*([] if first else [0]), *([] if np.any(held[-1:]) else [-1])]

    @property
    def dissipation_round_off(self) -> float:
        """Dissipation of a cycle that residuals may feign: 2 N |P, Q|_max |v|_max of the largest.

        It is large where soft springs hold a body that has moved far.
        """
        table = self.turning_points
        force, moved = np.abs([table.P, table.Q]).max(initial=0.0), np.abs(table.v).max(initial=0.0)
        return float(2.0 * len(self.x) * self.residual_max * force * moved)

    @property
    def dissipates(self) -> bool:
        """Whether cycle 1 dissipates more than the round-off of contact forces times slip."""
        D, table = self.cycles.dissipation, self.turning_points
        if not len(D):
            return False
        rows = table.cycle <= 1
        work = table.P[rows].sum(axis=1).max() * np.ptp(table.v[rows], axis=0).max()
        return bool(D[0] > max(DISSIPATION_ROUND_OFF * work, self.dissipation_round_off))

    def by_edge(self) -> dict[str, Record]:
        """Return the record of each contact edge by itself, by the edge's name.

        Arrays over nodes hold the edge's nodes only. Sums and counts over the contact (work,
        events, residuals) remain those of the whole contact.
        """
        numbers = np.unique(self.edge)
        if len(numbers) < 2:
            return {self.edge_names[numbers[0]] if self.edge_names else "": self}
        return {self.edge_names[k]: _on(self, np.flatnonzero(self.edge == k)) for k in numbers}

    def at(
        self,
        cycle: int = -1,
        load: Literal["minimum", "maximum"] | float | None = None,
        leg: int | None = None,
        s: float | None = None,
    ) -> moment.Moment:
        """Return one stored instant by names.

        Args:
            cycle: cycle; 0 is the first loading, -1 the last cycle, -2 the one before.
            load: "minimum" or "maximum": the turning point of the cycle with the smallest or the
                largest loads; or, with a single load, its load factor, which must be stored.
            leg: leg within the cycle, from 0 (in a plain cycle 0 is unloading, 1 reloading).
            s: position along the leg, in [0, 1]; it must be stored. Without ``load`` and ``s``, the
                end of the leg or of the cycle.

        Returns:
            The instant, with ``x``, ``state``, ``P``, ``Q``, ``p``, ``q``, ``v``, ``w``, ``zones``.

        Raises:
            InputError: no stored instant fits (the message names the nearest), or several do.
        """
        return moment.find(self, cycle, load, leg, s)

    def probe(self, name: str) -> ProbeHistory:
        """Return displacements and stresses at the points of a probe, along the load path."""
        return history_of(self, name)

    def to_table(self, which: str = "turning_points") -> dict[str, NDArray[Any]]:
        """Return "turning_points", "samples", "events" or "cycles" as columns of equal length.

        Turning points, samples and cycles have a row for each instant (or cycle) and node. The
        columns of a load are "load.NAME", its factor, and "load_displacement.NAME".
        """
        return tables.columns(self, which)

    def to_pandas(self, which: str = "turning_points") -> pd.DataFrame:
        """Return :meth:`to_table` as a DataFrame; needs pandas."""
        return tables.optional("pandas").DataFrame(self.to_table(which))

    def to_xarray(self, which: str = "turning_points") -> xarray.Dataset:
        """Return "turning_points", "samples" or "cycles" as a Dataset over named dimensions.

        Dimensions are "instant" (or "cycle"), "node" and "load"; needs xarray. Instants are
        selected by the coordinates "cycle", "leg", "s" and "load.NAME", nodes by "x", one after the
        other: ``.sel(cycle=3).sel(leg=0).sel(x=0.5, method="nearest")``. Loads are included twice:
        as "load_factor" and "load_displacement" along "load", and as the columns of
        :meth:`to_table`. With several contact edges, select one by "edge" first.
        """
        return tables.dataset(self, which)


def _on(record: Record, nodes: Ints) -> Record:
    """Return the record of some of the nodes."""

    def states(table: States) -> States:
        per_node = ("state", "P", "Q", "p", "q", "v", "w")
        return replace(table, **{name: getattr(table, name)[:, nodes] for name in per_node})

    names = "x points f g0 weight edge f_backward held cohesion shear_limit".split()
    every = {name: getattr(record, name) for name in names}
    own: dict[str, Any] = {k: None if a is None else a[nodes] for k, a in every.items()}
    events, cycles = record.events, record.cycles
    place = np.full(len(record.x), -1)
    place[nodes] = np.arange(len(nodes))
    here = place[events.node] >= 0
    columns = {f.name: getattr(events, f.name)[here] for f in fields(events)}
    return replace(
        record,
        **own,
        turning_points=states(record.turning_points),
        samples=states(record.samples),
        events=Events(**{**columns, "node": place[columns["node"]]}),
        cycles=replace(
            cycles,
            dissipation_density=cycles.dissipation_density[:, nodes],
            slip_increment=cycles.slip_increment[:, nodes],
        ),
    )
