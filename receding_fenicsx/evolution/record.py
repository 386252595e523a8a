"""The record of an evolved history, as ``record.h5`` holds it too.

Everything here describes the whole contact, also when half of the body was modelled. ::

    record = receding_fenicsx.read_record("results/block/record.h5")
    low = record.at(cycle=9, load="minimum")
    low.p, low.q, low.v, low.zones          # arrays over the contact nodes record.x
    record.cycles.dissipation               # one value a cycle, from cycle 1
    record.to_pandas("turning_points")      # a labelled table, where pandas is installed
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.evolution import moment, tables

if TYPE_CHECKING:
    import pandas as pd
    import xarray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass
class States:
    """n instants of the contact's N nodes.

    Attributes:
        cycle: (n,) cycle; 0 is the path to the start of the cycles (first loading).
        leg: (n,) straight piece of the load path within the cycle, from 0.
        s: (n,) position along the leg, in [0, 1].
        load: (n, n_loads) load factors.
        state: (n, N) states 1 to 4.
        P, Q: (n, N) nodal reactions on the body.
        p, q: (n, N) tractions, P / weight and Q / weight (0 where the weight is 0).
        v, w: (n, N) tangential and normal displacement.
        load_displacement: (n, n_loads) work-conjugate displacement of each load.
    """

    cycle: Ints
    leg: Ints
    s: Array
    load: Array
    state: NDArray[np.int8]
    P: Array
    Q: Array
    p: Array
    q: Array
    v: Array
    w: Array
    load_displacement: Array


@dataclass
class Events:
    """n changes of state.

    Attributes:
        cycle, leg, s: (n,) where on the load path, as in :class:`States`.
        load: (n, n_loads) load factors.
        node: (n,) contact node of the whole contact.
        old, new: (n,) states before and after.
    """

    cycle: Ints
    leg: Ints
    s: Array
    load: Array
    node: Ints
    old: NDArray[np.int8]
    new: NDArray[np.int8]


@dataclass
class Cycles:
    """Per-cycle quantities of the n completed cycles, row 0 being cycle 1.

    Attributes:
        dissipation: (n,) frictional dissipation of the whole contact.
        dissipation_density: (n, N) dissipation per node divided by the node's weight.
        slip_increment: (n, N) v at the end of the cycle less v at the end of the one before, of
            nodes that touch at both; 0 elsewhere, as what an open node moves is no slip.
    """

    dissipation: Array
    dissipation_density: Array
    slip_increment: Array


@dataclass
class Steady:
    """Whether a steady state was reached, and of which kind; see ``interface/cycles.py``.

    Attributes:
        reached: True when two successive periods repeat, in forces and in slips.
        cycle: first cycle at which that held; -1 when not reached.
        kind: "shakedown", "cyclic slip", "ratchetting" (every period gains the same displacement
            under the same forces) or "not reached".
        period: 1 or 2 cycles.
        change: (n_cycles,) A_n over one cycle: largest change of a nodal reaction over the largest.
    """

    reached: bool
    cycle: int
    kind: str
    period: int
    change: Array


@dataclass
class Record:
    """What one evolved history leaves behind.

    Attributes:
        x, points, f, g0, weight, edge: the contact nodes, as in ``ContactSystem``, whole contact.
        edge_names: names of the contact edges.
        load_names: names of the loads.
        scene_toml: text of the scene, "" when the system was made by hand.
        method: "gauss-seidel" or "events".
        modelled_nodes, modelled_dofs: contact nodes and degrees of freedom that were solved for.
        half: True when half of the body was modelled.
        axisymmetric: True when x is the radius; forces and energies are those of the full circle.
        load_sign: (n_loads,) -1 for forces, whose load_displacement is a displacement;
            +1 for prescribed displacements, whose load_displacement is the force that they take.
        turning_points: the end of every leg.
        samples: instants along the legs of the kept cycles.
        events: changes of state in the kept cycles.
        cycles: per-cycle quantities.
        dissipation_first_loading: dissipation of cycle 0.
        steady: steady state and kind.
        residual_max: largest residual of any accepted step or segment, over the largest force.
        energy_error_max: largest relative error of a leg's energy identity.
        sweeps: Gauss-Seidel sweeps in total (0 for other methods).
        n_events: changes of state in total.
        jumps: jumps that were stepped over, no quasi-static path leading on.
        released: energy that they released, not counted in any dissipation.
    """

    x: Array
    points: Array
    f: Array
    g0: Array
    weight: Array
    edge: Ints
    edge_names: tuple[str, ...]
    load_names: tuple[str, ...]
    scene_toml: str
    method: str
    modelled_nodes: int
    modelled_dofs: int
    half: bool
    axisymmetric: bool
    load_sign: Array
    turning_points: States
    samples: States
    events: Events
    cycles: Cycles
    dissipation_first_loading: float
    steady: Steady
    residual_max: float
    energy_error_max: float
    sweeps: int
    n_events: int
    jumps: int = 0
    released: float = 0.0

    def by_edge(self) -> dict[str, Record]:
        """Return the record of each contact edge by itself, by the edge's name.

        Arrays over nodes hold the edge's nodes only; what is counted or summed over the contact
        (work, events, residuals) stays that of the whole.
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
            InputError: nothing, or more than one instant, answers; it names the nearest.
        """
        return moment.find(self, cycle, load, leg, s)

    def to_table(self, which: str = "turning_points") -> dict[str, NDArray[Any]]:
        """Return "turning_points", "samples", "events" or "cycles" as columns of equal length.

        Turning points, samples and cycles have a row for each instant (or cycle) and node. The
        columns of a load are "load.NAME", its factor, and "load_displacement.NAME".
        """
        return tables.columns(self, which)

    def to_pandas(self, which: str = "turning_points") -> pd.DataFrame:
        """Return :meth:`to_table` as a DataFrame; needs pandas."""
        return tables.frame(self, which)

    def to_xarray(self, which: str = "turning_points") -> xarray.Dataset:
        """Return "turning_points", "samples" or "cycles" as a Dataset over named dimensions.

        Dimensions are "instant" (or "cycle"), "node" and "load"; needs xarray. Loads stand there
        twice: as "load_factor" and "load_displacement" along "load", and by the names of columns.
        """
        return tables.dataset(self, which)


def _on(record: Record, nodes: Ints) -> Record:
    """Return the record of some of the nodes."""

    def states(table: States) -> States:
        per_node = ("state", "P", "Q", "p", "q", "v", "w")
        return replace(table, **{name: getattr(table, name)[:, nodes] for name in per_node})

    per_record = ("x", "points", "f", "g0", "weight", "edge")
    events, cycles = record.events, record.cycles
    place = np.full(len(record.x), -1)
    place[nodes] = np.arange(len(nodes))
    here = place[events.node] >= 0
    columns = {f.name: getattr(events, f.name)[here] for f in fields(events)}
    return replace(
        record,
        **{name: getattr(record, name)[nodes] for name in per_record},
        turning_points=states(record.turning_points),
        samples=states(record.samples),
        events=Events(**{**columns, "node": place[columns["node"]]}),
        cycles=replace(
            cycles,
            dissipation_density=cycles.dissipation_density[:, nodes],
            slip_increment=cycles.slip_increment[:, nodes],
        ),
    )
