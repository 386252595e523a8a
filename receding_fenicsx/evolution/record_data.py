"""Arrays of a record: instants, events, cycles and the contact nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.interface.law import Friction, friction_of
from receding_fenicsx.interface.measures.zones import begins_on_axis


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
        load_displacement: (n, n_loads) work-conjugate quantity U of each load: the work is the
            integral of lambda dU, of a prescribed displacement that of U dlambda.
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
            nodes that touch at both; 0 elsewhere, since displacement of an open node is no slip.
    """

    dissipation: Array
    dissipation_density: Array
    slip_increment: Array


@dataclass
class Probes:
    """Displacements and stresses at the m points of the probes, at n instants along the path.

    ``names`` has the name of the probe of each point; ``kind`` is 0 for a turning point, 1 for a
    sample, 2 for an event of a kept cycle. All else is as in ``ProbeHistory``.
    """

    names: tuple[str, ...]
    points: Array
    kind: NDArray[np.int8]
    cycle: Ints
    leg: Ints
    s: Array
    load: Array
    displacement: Array
    stress: Array


@dataclass
class Steady:
    """Whether a steady state was reached, and its kind; see ``interface/measures/steady.py``.

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
class Limit:
    """Limit of infinitely many cycles; see :mod:`receding_fenicsx.evolution.limit`.

    Attributes:
        reached: True when a cycle that repeats itself was found, played and checked.
        cycle: its number in the record, the last one; -1 when not reached.
        cycles_played: cycles played from cycle 1, those of searches too.
        residual: change of the forces over the cycle, over the largest force. NaN without a search.
        unique: 1 when all cycles to come were followed to the limit, so that the history comes to
            it and to no other one; -1 when that is not known.
        reason: why it was reached or not, in words.
        jumped: True when the cycle starts where it ends itself; in ratchetting, by its rigid walk
            behind that.
    """

    reached: bool
    cycle: int
    cycles_played: int
    residual: float
    unique: int
    reason: str
    jumped: bool = False


@dataclass
class PathUniqueness:
    """Whether the path is the only one from its start; see :mod:`receding_fenicsx.interface`.

    Attributes:
        certified: at every instant the rates are proved to be unique, and no static problem (first
            loading) was found to have several solutions; of half a model, among mirror-symmetric
            paths.
        margin: factor by which all friction could grow before the certificate fails on the path's
            sets of states; infinite where nothing slips, nan where not all states were judged.
        solutions: largest number of solutions found at one instant.
        cycle, leg, s: place of the first doubt, -1 without one, and where the path is not certified
            because its first cycles were not judged.
        nodes: nodes of the first doubt, of the whole contact.
        first_loading: solutions found of the static problem of a first loading, 0 without one.
        first_loading_proved: it is proved that there are no others.
    """

    certified: bool
    margin: float
    solutions: int
    cycle: int
    leg: int
    s: float
    nodes: Ints
    first_loading: int
    first_loading_proved: bool


@dataclass
class RecordData:
    """Arrays and numbers of one evolved history.

    Attributes:
        x, points, f, g0, weight, edge: the contact nodes, as in ``ContactSystem``, whole contact.
        edge_names: names of the contact edges.
        load_names: names of the loads.
        scene_toml: text of the scene, "" where none was evolved.
        method: "gauss-seidel" or "events".
        modelled_nodes, modelled_dofs: contact nodes and degrees of freedom that were solved for.
        half: True when half of the body was modelled.
        axisymmetric: forces and energies are those of the full circle.
        load_sign: (n_loads,) -1 for forces, whose load_displacement is a displacement;
            +1 for prescribed displacements, whose load_displacement is the force along them times
            the displacement at factor 1.
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
        released: energy released by the jumps, not counted in any dissipation.
        f_backward: (N,) coefficient of friction for backward slip; None where ``f`` holds for both
            directions.
        probes: displacements and stresses at the probes; None where the scene has none.
        doubling: (k, 2) of a harmonic history whose corners were doubled: number of corners of each
            polygon, and error estimate of its dissipation per cycle, relative (NaN for the first
            two).
        choices: instants with several continuations on the exact path, and the one taken; they are
            looked for where ``solver.branch`` asks for another one than the first.
        limit: limit of infinitely many cycles; None where it was not asked for.
        uniqueness: whether the path is the only one from its start.
        held: (N,) nodes whose tangential displacement symmetry or a support holds: the force that
            this takes is no traction, Q = 0; None where there are none.
        cohesion, shear_limit: (N,) tractions c and t of the limits min(f P + c m, t m) of |Q|, m
            the weight; None for none.
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
    f_backward: Array | None = None
    probes: Probes | None = None
    doubling: Array | None = None
    choices: tuple[Choice, ...] = ()
    limit: Limit | None = None
    uniqueness: PathUniqueness | None = None
    held: NDArray[np.bool_] | None = None
    cohesion: Array | None = None
    shear_limit: Array | None = None

    def start_row(self, cycle: int) -> int | None:
        """Return the turning point from which a cycle starts; None at rest.

        It is the end of the cycle before, or of the cycle itself after a jump to the limit; in
        ratchetting the cycle starts by its slip increment behind that.
        """
        jumped = self.limit is not None and self.limit.jumped and self.limit.cycle == cycle
        rows = np.flatnonzero(self.turning_points.cycle == (cycle if jumped else cycle - 1))
        return int(rows[-1]) if len(rows) else None

    @property
    def friction(self) -> Friction:
        """Law of friction of the nodes, in forces."""
        return friction_of(self.f, self.f_backward, self.weight, (self.cohesion, self.shear_limit))

    def traction_law(self, unit: float) -> Friction:
        """Return the law of friction of the nodes in tractions over a unit."""
        return friction_of(self.f, self.f_backward, 1.0 / unit, (self.cohesion, self.shear_limit))

    @property
    def radius(self) -> Array | None:
        """(N,) distances of the nodes from the axis of revolution; None where there is none."""
        return self.points[:, 0] if self.axisymmetric else None

    @property
    def begins_on_axis(self) -> bool:
        """Whether the contact edge begins on the axis r = 0, from which x is measured then."""
        return self.axisymmetric and begins_on_axis(self.points[:, 0], self.weight)
