"""Dataclasses of a scene's options: history, solver and output."""

from __future__ import annotations

from dataclasses import dataclass, field

from receding_fenicsx.arrays import call_of
from receding_fenicsx.scene.profiles import Profile

SAMPLES_PER_LEG, SAMPLES_PER_CYCLE = 40, 800
"""Default numbers of samples: per leg, and at most per cycle where it has many legs."""


HEADLINE_NAMES = {
    "centre_pressure": "pressure at the centre of a contact edge",
    "largest_pressure": "largest pressure",
    "contact_half_width": "contact half-width",
    "stick_half_width": "stick half-width",
    "contact_left": "left end of the contact",
    "contact_right": "right end of the contact",
    "stick_left": "left end of the stick zone",
    "stick_right": "right end of the stick zone",
    "load_displacement": "displacement conjugate to a load",
    "probe_ux": "displacement u_x of a probe",
    "probe_uy": "displacement u_y of a probe",
    "probe_sxx": "stress s_xx of a probe",
    "probe_syy": "stress s_yy of a probe",
    "probe_szz": "stress s_zz of a probe",
    "probe_sxy": "stress s_xy of a probe",
    "dissipation_first_loading": "dissipation of the first loading",
    "dissipation_first_cycle": "dissipation of cycle 1",
    "dissipation_ratio": "dissipation of the last cycle over cycle 1",
}
"""Headline numbers of a run and their descriptions. Those of an instant are at the end of cycle 0;
that of a probe is the largest in magnitude of its points."""

LOCAL_NUMBERS = (
    "largest_pressure",
    "contact_half_width",
    "stick_half_width",
    "contact_left",
    "contact_right",
    "stick_left",
    "stick_right",
)
"""Numbers that are asked for by name only: ends of zones are known to a part of the node spacing,
and the largest pressure may be infinite."""


class Table:
    """Table of a scene whose values may be long."""

    def __repr__(self) -> str:
        """Return the values, long ones cut; empty ones are left out."""
        return call_of(self)


@dataclass(frozen=True)
class Refinement:
    """Place at which elements are smaller.

    At the distance d from it elements have the size ``size + (growth - 1) d``, where that is less
    than their size without it.

    Attributes:
        size: length of the elements at the place, positive.
        at: position along the edge, a range [from, to], "ends": both ends of the contact, or
            "corners": the re-entrant corners of a body from a .geo file.
        growth: size ratio of neighbouring elements away from the place; default: that of the mesh.
        edge: contact edge; default: all contact edges.
    """

    size: float
    at: float | tuple[float, float] | str = "ends"
    growth: float | None = None
    edge: str | None = None

    @property
    def span(self) -> tuple[float, float]:
        """Range of a place by position."""
        assert not isinstance(self.at, str)
        return self.at if isinstance(self.at, tuple) else (self.at, self.at)


@dataclass(frozen=True)
class Harmonic:
    """Load factor mean + amplitude cos(angle - phase) of a harmonic history.

    Attributes:
        mean: mean load factor.
        amplitude: amplitude of the load factor, not negative; 0 for a constant load.
        phase: angle in degrees at which the load factor is largest.
    """

    mean: float = 0.0
    amplitude: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True, repr=False)
class HistoryOptions(Table):
    """Options of the load history; see :mod:`receding_fenicsx.scene.history`.

    Attributes:
        kind: "cyclic", "monotonic", "table" or "harmonic".
        load: name of the load that varies; required when there are several.
        maximum: largest load factor, positive.
        minimum: smallest load factor of the cycles, below the maximum.
        cycles: largest number of cycles.
        until: "steady" to stop when the steady state is reached; "limit" to find the limit of
            infinitely many cycles.
        columns: name of the load of each column (kind "table").
        rows: load factors from rest to the start of the cycles (kind "table"); in a scene file also
            a file. Default: straight to the last of ``cycle_rows``.
        cycle_rows: load factors at the corners of a cycle, from the last of ``rows`` back to it
            (kind "table"); in a scene file also a file.
        constant: load factors that are applied first and then kept, by the names of their loads.
        harmonic: each load's mean, amplitude and phase, by its name (kind "harmonic").
        corners: corners of the polygon that stands for the ellipse (kind "harmonic"); default: as
            many as ``tolerance`` needs.
        tolerance: largest error estimate of the dissipation per cycle due to the polygon, relative;
            default 1e-3 (kind "harmonic").
        initial_slip: tangential displacement from which the slip of the first leg is measured.
    """

    kind: str = "cyclic"
    load: str | None = None
    maximum: float = 1.0
    minimum: float = 1.0 / 3.0
    cycles: int = 60
    until: str | None = None
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[float, ...], ...] = ()
    cycle_rows: tuple[tuple[float, ...], ...] = ()
    constant: dict[str, float] = field(default_factory=dict)
    harmonic: dict[str, Harmonic] = field(default_factory=dict)
    corners: int | None = None
    tolerance: float | None = None
    initial_slip: Profile | None = None


@dataclass(frozen=True, repr=False)
class ShakedownOptions(Table):
    """Load range of the command ``shakedown``: mean + lambda range[k].

    Attributes:
        mean: load factors of the mean loads, by the names of their loads.
        range: changes of the load factors at the corners of the range at lambda = 1.
        separated: "refuse" nodes that are separated under the mean loads, or let them "stay"
            separated over the whole range.
        largest_slip: bound of the residual slips that the lower limit is for.
        diagram: load whose mean varies along the diagram's axis; default: the first of the range.
    """

    mean: dict[str, float] = field(default_factory=dict)
    range: tuple[dict[str, float], ...] = ()
    separated: str = "refuse"
    largest_slip: float | None = None
    diagram: str | None = None


@dataclass(frozen=True)
class SolverOptions:
    """Options of the solver; tolerances are relative to the scales of the scene.

    Attributes:
        method: "events" (exact) or "gauss-seidel" (load steps).
        steps_per_leg: load steps per leg (Gauss-Seidel).
        symmetry: "auto" models half of a mirror-symmetric body; "none" models the whole body.
        over_relaxation: relaxation factor, between 0 and 2 (Gauss-Seidel).
        polish: solve directly once the states no longer change (Gauss-Seidel).
        change_tolerance: largest change in a sweep, over the largest displacement of the step,
            eq. (16) (Gauss-Seidel).
        residual_tolerance: residual of the contact law, over the largest nodal force
            (Gauss-Seidel).
        max_sweeps: largest number of sweeps of a step; more are an error. A step whose sweeps cycle
            or converge too slowly (1000 sweeps leave more than a tenth of the residual) is solved
            on the exact path (Gauss-Seidel).
        steady_tolerance: change of the nodal forces over a cycle, relative to the largest force,
            below which the cycle is steady. What slips gain and how the dissipation changes are
            compared with 100 times this tolerance, relative to themselves. Default: 1e-8, and 1e-10
            for the limit of infinitely many cycles.
        on_jump: "stop" or "static", where no quasi-static continuation exists.
        branch: where several continuations exist, "first" takes the one found first, "least
            dissipation" or "most dissipation" the one that dissipates at the least or highest rate,
            and a number n the n-th, or the last where there are fewer (method "events").
    """

    method: str = "events"
    steps_per_leg: int = 40
    symmetry: str = "auto"
    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-12
    max_sweeps: int = 20000
    steady_tolerance: float | None = None
    on_jump: str = "stop"
    branch: str | int = "first"


@dataclass(frozen=True)
class OutputOptions:
    """Options of the record and the checkpoints.

    Attributes:
        samples_per_leg: samples per leg of the sampled cycles; default 40, on a cycle of more than
            20 legs fewer, about 800 for the cycle.
        cycles: cycles with samples and events: "all" or a list; default 0, 1, 2, 9 and the last.
        checkpoint_cycles: cycles between two checkpoints. After 20 times as many cycles, the
            distance grows to a tenth of the finished cycles.
    """

    samples_per_leg: int | None = None
    cycles: tuple[int, ...] | str | None = None
    checkpoint_cycles: int = 10

    def samples_on(self, legs: int) -> int:
        """Return the number of samples per leg of a cycle of so many legs."""
        if self.samples_per_leg is not None:
            return self.samples_per_leg
        return max(1, min(SAMPLES_PER_LEG, SAMPLES_PER_CYCLE // max(legs, 1)))


@dataclass(frozen=True)
class Probe:
    """Points of a body at which displacement and stress are recorded: exactly one of three keys.

    Attributes:
        name: name of the probe; also that of its files.
        point: coordinates [x, y] of one point.
        points: coordinates of several points.
        segment: both ends of a segment, which gets ``count`` evenly spaced points.
        count: number of points of the segment, ends included.
        body: name of the points' body, in a scene of several.
    """

    name: str
    point: tuple[float, float] | None = None
    points: tuple[tuple[float, ...], ...] = ()
    segment: tuple[tuple[float, ...], ...] = ()
    count: int | None = None
    body: str | None = None

    @property
    def coordinates(self) -> tuple[tuple[float, ...], ...]:
        """Coordinates (x, y) of all points."""
        if self.point is not None:
            return (self.point,)
        if self.points:
            return self.points
        n = (self.count or 2) - 1
        (ax, ay), (bx, by) = self.segment
        # both ends exactly, the middle of symmetric ends exactly
        return tuple(
            (((n - i) * ax + i * bx) / n, ((n - i) * ay + i * by) / n) for i in range(n + 1)
        )


@dataclass(frozen=True)
class ModeOptions:
    """Vibration modes that are computed.

    Attributes:
        count: number of modes: of the stuck joint that ``joint`` prints, and with the contact nodes
            held that a reduced model keeps.
    """

    count: int = 3


@dataclass(frozen=True)
class AccuracyOptions:
    """Options of a run that chooses its mesh by the errors of its numbers.

    Attributes:
        tolerance: largest relative error of the numbers: twice the estimate is below it. Default:
            the mesh is that of the scene.
        numbers: names of the numbers. Default: all but the ends of zones and the largest pressure.
            A name without brackets stands for that number of all edges, loads or probes.
        budget_seconds: no mesh is begun that would end later, by prediction.
        grading: the meshes are graded towards the ends of the contact edges and the re-entrant
            corners of bodies. Default: where a sharp corner is in contact and it is possible.
    """

    tolerance: float | None = None
    numbers: tuple[str, ...] = ()
    budget_seconds: float = 600.0
    grading: bool | None = None
