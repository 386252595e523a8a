"""Dataclasses of a scene: loads, supports, springs, bolts, history, solver, output, studies."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, hypot
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt, MaxLen

from receding_fenicsx.scene.checks import (
    ByType,
    Count,
    Million,
    NotNegative,
    Number,
    OneOf,
    Pair,
    Positive,
    Table,
    Thousand,
    Tolerance,
)
from receding_fenicsx.scene.profiles import Profile

UnitName = Annotated[str, MaxLen(12)]


@dataclass(frozen=True, repr=False)
class Units(Table):
    """Names of the units that the numbers of a scene are in; labels only, nothing is converted.

    Attributes:
        length: unit of lengths, such as "mm"; at most 12 characters.
        stress: unit of stresses, such as "MPa".
        force: unit of forces, such as "N"; default: products of the units of stress and length. In
            the plane, forces are for unit thickness: with length = "mm", "N" and "N/mm" both give
            axes in N/mm.
    """

    length: UnitName | None = None
    stress: UnitName | None = None
    force: UnitName | None = None

    def product(self, stress: int, length: int) -> str:
        """Return the unit stress^a length^b as text; "" if one of the units is not known."""
        powers = ((self.stress, stress), (self.length, length))
        raised = ("", "", "²", "³")
        parts = [unit and f"{unit}{raised[power]}" for unit, power in powers if power]
        return " ".join(filter(None, parts)) if all(parts) else ""

    def of_force(self, axisymmetric: bool) -> str:
        """Return the unit of forces: of the full circle, or in the plane for unit thickness."""
        divided = bool(re.search(r"[/⁻]|-\d| per ", self.force or ""))
        if self.force and divided != axisymmetric:
            return self.force
        if self.force and self.length and not axisymmetric:
            return f"{self.force}/{self.length}"
        return self.product(1, 2 if axisymmetric else 1)


def in_unit(name: str, unit: str | None) -> str:
    """Return a name with its unit in brackets; the name alone without a unit."""
    return f"{name} ({unit})" if unit else name


FREE = "free"
"""Component of a prescribed displacement that is not prescribed."""
INTERFERENCE = "interference"
"""Name of the load factor that closes the interference of the contacts, from 0 to 1."""
KINDS = (
    *("pressure", "traction", "displacement", "force", "tension", "gap"),
    *("body_force", "thermal_strain", "mode"),
)
"""Keys of a load of which exactly one is given; the last three are of loads on whole bodies."""


@dataclass(frozen=True, repr=False)
class Load(Table):
    """Named load: one of the ``KINDS``; the last three act on bodies, the others on an edge.

    The history multiplies it by its load factor.

    Attributes:
        name: name of the load in the history.
        edge: edge on which it acts; needed but for loads on bodies.
        span: [from, to] along the edge, positions as in a contact; default: the whole edge.
        pressure: stress normal to the edge, a profile; positive is compression.
        traction: [x, y] in global axes: stresses, profiles.
        displacement: prescribed [x, y]: lengths, profiles; "free" for a component that is not
            prescribed. Where they are numbers, the force along it is printed and in
            ``summary.json`` under ``forces``, at the turning points.
        platen: the edge moves rigidly without rotation, under a ``force`` or by a constant
            ``displacement``. Loads with the same edge and span act on the same platen.
        force: resultant [x, y] on a platen, for unit thickness, of the whole body (axisymmetric: of
            the full circle); or on the far field of a half-plane, which without ``platen`` turns
            freely under a force through the middle of the contact.
        tension: stress along the surface of a half-plane far from the contact, on its far field.
        gap: gap that the contacts on the edge have besides ``initial_gap``, a length, a profile
            like that one; negative closes. "-x/200" with the factor s on the gap "x^2/400" is a
            cylinder of radius 200 that rolls by s.
        travel: positions along a straight edge, from the first to the last of which a pressure or
            traction travels in each cycle of a history of the kind "travel"; its ``span`` and
            profile are relative to that position.
        steps: number of straight pieces of the history on that way; default: as many as keep the
            moment of a pressure over ``span`` within 1e-3 of itself between two of them.
        body: name of the body with a body force or thermal strain, needed when there are several.
        body_force: [x, y]: forces per volume, profiles without tables; ["0.4*x", 0.0] for a
            rotation with rho omega^2 = 0.4.
        thermal_strain: strain alpha dT of the free material, alike in all directions of space, a
            profile without tables.
        mode: inertia force M phi of a vibration mode by its number, 1 or more; made by
            ``joint --drive mode:1`` and ``rf.joint_curve``.
    """

    name: str
    edge: str = ""
    span: Pair | None = None
    pressure: Profile | None = None
    traction: tuple[Profile, Profile] | None = None
    displacement: tuple[Profile, Profile] | None = None
    platen: bool = False
    force: Pair | None = None
    tension: Number | None = None
    gap: Profile | None = None
    travel: tuple[Number, ...] = ()
    steps: Count | None = None
    body: str | None = None
    body_force: tuple[Profile, Profile] | None = None
    thermal_strain: Profile | None = None
    mode: Count | None = None

    @property
    def is_prescribed(self) -> bool:
        """Whether displacements are given, not forces: tension gives those far from the contact."""
        return any(part is not None for part in (self.displacement, self.tension, self.gap))

    @property
    def label(self) -> str:
        """Name in messages."""
        return f"load '{self.name}'"

    @property
    def units(self) -> tuple[Load, ...]:
        """The load; of one that travels a unit load at each end of a piece of its way."""
        if len(self.travel) < 2:
            return (self,)
        way = sum(abs(b - a) for a, b in pairwise(self.travel))
        low, high = self.span or (0.0, way)
        # interpolated between ends s apart, a uniform pressure over the length l is off by s^2 / 8
        # in its second integral, of which the largest is l^2 / 2
        step = way / self.steps if self.steps else 2.0 * 1e-3**0.5 * (high - low)
        step = max(step, way / 1001, 1e-300)  # more than 1000 are refused
        places = [self.travel[0]]
        for a, b in pairwise(self.travel):
            # round-off of a number of steps is not one more
            n = max(ceil(abs(b - a) / step - 1e-9), 1)
            places += [a + (b - a) * k / n for k in range(1, n)] + [b]
        return tuple(
            replace(self, name=f"{self.name} {k}", travel=(s,)) for k, s in enumerate(places)
        )

    @property
    def on_body(self) -> bool:
        """Whether the load acts on a body, not on an edge."""
        return any(getattr(self, kind) is not None for kind in KINDS[-3:])


@dataclass(frozen=True, repr=False)
class Support(Table):
    """Homogeneous displacement condition at an edge or a point.

    Attributes:
        fix: components held: "x", "y" or "xy".
        edge: edge that is held; or ``point``.
        point: point that is held: [x, y], or the name of a physical point of a mesh file.
        body: name of the point's body, needed when there are several bodies.
    """

    fix: Annotated[str, OneOf("x", "y", "xy", "yx")]
    edge: str | None = None
    point: Annotated[Pair | str, ByType()] | None = None
    body: str | None = None


@dataclass(frozen=True, repr=False)
class Spring(Table):
    """Springs evenly spread over an edge (Winkler), or a single one at a point.

    Attributes:
        edge: edge that is held; or ``point``.
        span: [from, to] along the edge, positions as in a contact; default: the whole edge.
        normal: stiffness against displacements along the edge's normal, a stress per length, not
            negative.
        tangential: stiffness against displacements along the edge, not negative.
        against: parallel edge of another body that it is tied to; default: the ground.
        point: point that is held: [x, y], or the name of a physical point of a mesh file.
        body: name of the point's body, needed when there are several bodies.
        x: stiffness of a point along x, a force for unit thickness per length (axisymmetric: of the
            full circle), not negative.
        y: stiffness of a point along y, not negative.
    """

    edge: str = ""
    span: Pair | None = None
    normal: NotNegative = 0.0
    tangential: NotNegative = 0.0
    against: str | None = None
    point: Annotated[Pair | str, ByType()] | None = None
    body: str | None = None
    x: NotNegative = 0.0
    y: NotNegative = 0.0
    label = "[[spring]]"


@dataclass(frozen=True, repr=False)
class Bolt(Table):
    """Bolt that draws two patches together, and then follows the load as a spring.

    Attributes:
        name: name of its load factor, the shortening.
        head: edge with the patch under the head.
        nut: edge with the patch under the nut.
        shortening: by how much tightening shortens the bolt, a length, positive; or ``preload``,
            for which it is found.
        head_span: [from, to], the patch on the edge of the head; default: the whole edge.
        nut_span: the same under the nut.
        axis: direction [x, y] from head to nut.
        stiffness: force for unit thickness over elongation, positive; default: rigid.
        preload: force at the end of tightening, for unit thickness (of a ring: of all bolts),
            positive; or ``shortening``.
        tightening: shortenings at the ends of the tightening legs, of this bolt and of the others;
            found from the preload, not to be given.
    """

    name: str
    head: str
    nut: str
    shortening: Number | None = None
    head_span: Pair | None = None
    nut_span: Pair | None = None
    axis: Pair = (0.0, -1.0)
    stiffness: Positive | None = None
    preload: Positive | None = None
    tightening: tuple[Number, ...] = ()

    @property
    def patches(self) -> tuple[Load, Load]:
        """Unit tension: a force on each patch, towards the other one."""
        x, y = (part / hypot(*self.axis) for part in self.axis)
        return (
            Load(self.name, self.head, self.head_span, force=(x, y)),
            Load(self.name, self.nut, self.nut_span, force=(0.0 - x, 0.0 - y)),
        )


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

Branch = Annotated[str, OneOf("first", "least dissipation", "most dissipation")]
"""Rule by which one of several continuations is taken."""


@dataclass(frozen=True, repr=False)
class Harmonic(Table):
    """Load factor mean + amplitude cos(angle - phase) of a harmonic history.

    Attributes:
        mean: mean load factor.
        amplitude: amplitude of the load factor, not negative; 0 for a constant load.
        phase: angle in degrees at which the load factor is largest.
    """

    mean: Number = 0.0
    amplitude: NotNegative = 0.0
    phase: Number = 0.0


@dataclass(frozen=True, repr=False)
class HistoryOptions(Table):
    """Options of the load history; see :mod:`receding_fenicsx.scene.history`.

    Attributes:
        kind: "cyclic": 0 to maximum, then maximum, minimum, maximum; "monotonic": 0 to maximum;
            "table": a polyline of the factors of several loads; "harmonic": mean, amplitude and
            phase of each load; "travel": loads that travel are put on, pass and are taken off, on
            the first path and in each cycle.
        load: name of the load that varies; needed when there are several that are not
            ``constant``.
        maximum: largest load factor, positive; to reverse a load, change its own sign.
        minimum: smallest load factor of the cycles, below the maximum.
        cycles: largest number of cycles, 1 to 1 000 000 000; the record must be smaller than
            1000 GB.
        until: "steady" stops when the steady state is reached; "limit" takes the limit of
            infinitely many cycles once it is known that the history comes there.
        columns: for "table": name of the load of each column.
        rows: for "table": load factors from rest to the start of the cycles, one list per row; in a
            scene file also {file = "signal.csv"}. Default: straight to the last of ``cycle_rows``.
        cycle_rows: for "table": load factors at the corners of a cycle, from the last of ``rows``
            back to it, one list per row; in a scene file also {file = "signal.csv"}.
        constant: load factors, such as {P = 1.0}, that are applied first, together on one leg, and
            then kept; the other loads vary as ``kind`` says.
        harmonic: for "harmonic": for each load a table [history.harmonic.NAME] with ``mean``,
            ``amplitude`` and ``phase``, each 0 by default.
        corners: for "harmonic": number of corners of the polygon that stands for the ellipse, at
            most 4096; default: as many as ``tolerance`` needs.
        tolerance: for "harmonic": largest error estimate of the dissipation per cycle due to the
            polygon, relative; default: 1e-3.
        initial_slip: tangential displacement from which the slip of the first leg is measured, a
            length, a profile; the first leg is then one static problem, and releases the slip if it
            has no load.
    """

    kind: Annotated[str, OneOf("cyclic", "monotonic", "table", "harmonic", "travel")] = "cyclic"
    load: str | None = None
    maximum: Positive = 1.0
    minimum: Number = 1.0 / 3.0
    cycles: Annotated[int, Ge(0), Le(1_000_000_000)] = 60
    until: Annotated[str, OneOf("steady", "limit")] | None = None
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[Number, ...], ...] = ()
    cycle_rows: tuple[tuple[Number, ...], ...] = ()
    constant: dict[str, Number] = field(default_factory=dict)
    harmonic: dict[str, Harmonic] = field(default_factory=dict)
    corners: Annotated[int, Ge(1), Le(4096)] | None = None
    tolerance: Tolerance | None = None
    initial_slip: Profile | None = None


@dataclass(frozen=True, repr=False)
class ShakedownOptions(Table):
    """Load range of the command ``shakedown``: mean + lambda range[k].

    Attributes:
        mean: load factors of the mean loads, by name; loads that are not named have 0.
        range: corners of the range at lambda = 1, changes of load factors by name; their convex
            combinations hold the mean load.
        separated: nodes that are separated under the mean loads: "refuse" them, or let them "stay"
            separated throughout.
        largest_slip: bound of the residual slips that the lower limit is for, as far as they stay
            below it; refused if none of these holds the mean loads.
        diagram: load whose mean varies along the diagram's axis; default: the first of the range.
    """

    mean: dict[str, Number] = field(default_factory=dict)
    range: tuple[dict[str, Number], ...] = ()
    separated: Annotated[str, OneOf("refuse", "stay")] = "refuse"
    largest_slip: Positive | None = None
    diagram: str | None = None


@dataclass(frozen=True, repr=False)
class SolverOptions(Table):
    """Options of the solver; tolerances are relative to the scales of the scene.

    Attributes:
        method: "events" (exact) or "gauss-seidel" (load steps).
        steps_per_leg: load steps per leg (Gauss-Seidel), at most 1 000 000.
        symmetry: "auto" models half of a mirror-symmetric body; "none" models the whole body.
        over_relaxation: relaxation factor, between 0 and 2 (Gauss-Seidel); 1 is none, 1.5 is often
            fastest.
        polish: solve directly once the states no longer change (Gauss-Seidel).
        change_tolerance: largest change in a sweep, over the largest displacement of the step,
            eq. (16) (Gauss-Seidel).
        residual_tolerance: residual of the contact law, over the largest nodal force
            (Gauss-Seidel).
        max_sweeps: largest number of sweeps of a step; more are an error. A step whose sweeps cycle
            or converge too slowly (1000 sweeps leave more than a tenth of the residual) is solved
            on the exact path (Gauss-Seidel).
        steady_tolerance: change of the nodal forces over a period, relative to the largest force.
            The cycle is steady when this change is below the tolerance, or below the round-off of
            the forces (K u of a nearly rigid body), for two periods in a row and no node slips, or
            the slips gain and the dissipation changes by less than 100 times the tolerance,
            relative to themselves. Default: 1e-8, and 1e-10 for until = "limit".
        on_jump: where no quasi-static continuation exists (both methods): "stop" ends with an error
            that names load factors and nodes; "static" solves one static problem past the jump and
            reports the jump and its released energy.
        branch: where several continuations exist: "first" takes the one found first, "least
            dissipation" and "most dissipation" the one that dissipates at the least or highest
            rate, a number n the n-th, or the last where there are fewer (method "events").
    """

    method: Annotated[str, OneOf("events", "gauss-seidel")] = "events"
    steps_per_leg: Million = 40
    symmetry: Annotated[str, OneOf("auto", "none")] = "auto"
    over_relaxation: Annotated[float, Gt(0.0), Lt(2.0)] = 1.5
    polish: bool = True
    change_tolerance: Tolerance = 1e-10
    residual_tolerance: Tolerance = 1e-12
    max_sweeps: Count = 20000
    steady_tolerance: Tolerance | None = None
    on_jump: Annotated[str, OneOf("stop", "static")] = "stop"
    branch: Annotated[Branch | Thousand, ByType()] = "first"


Cycles = Annotated[tuple[Annotated[int, Ge(0)], ...] | Annotated[str, OneOf("all")], ByType()]


@dataclass(frozen=True, repr=False)
class OutputOptions(Table):
    """Options of the record and the checkpoints.

    Attributes:
        samples_per_leg: samples per leg of the sampled cycles, 1 to 1 000 000; default: 40, on a
            cycle of more than 20 legs fewer, about 800 for the cycle.
        cycles: cycles with samples and events: "all" or a list; default: 0, 1, 2, 9 and the last;
            may differ in a resumed run.
        checkpoint_cycles: cycles between two checkpoints; ``--resume`` continues from the last one.
            After 20 times as many cycles, the distance grows to a tenth of the finished cycles.
    """

    samples_per_leg: Million | None = None
    cycles: Cycles | None = None
    checkpoint_cycles: Count = 10

    def samples_on(self, legs: int) -> int:
        """Return the number of samples per leg of a cycle of so many legs."""
        if self.samples_per_leg is not None:
            return self.samples_per_leg
        return max(1, min(40, 800 // max(legs, 1)))


@dataclass(frozen=True, repr=False)
class Probe(Table):
    """Points of a body at which displacement and stress are recorded: exactly one of four keys.

    Attributes:
        name: name of the probe, also that of its files.
        point: coordinates [x, y] of one point.
        points: coordinates of several points, [[x, y], ...].
        segment: both ends of a segment, [[x, y], [x, y]], which gets ``count`` evenly spaced
            points.
        edge: contact edge, "NAME.edge", at all of whose nodes.
        count: number of points of the segment, ends included; 2 to 1000, and at most 1000 in all
            probes.
        body: name of the points' body, needed when there are several bodies.
    """

    name: str
    point: Pair | None = None
    points: tuple[Pair, ...] = ()
    segment: tuple[Pair, ...] = ()
    edge: str | None = None
    count: Annotated[int, Ge(2), Le(1000)] | None = None
    body: str | None = None

    @property
    def coordinates(self) -> tuple[tuple[float, ...], ...]:
        """Coordinates (x, y) of all points; none of an edge, whose nodes its mesh places."""
        if self.edge is not None:
            return ()
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


@dataclass(frozen=True, repr=False)
class ModeOptions(Table):
    """Vibration modes that are computed.

    Attributes:
        count: number of vibration modes, at most 1000: of the stuck joint that ``joint`` prints,
            and with the contact nodes held that a reduced model keeps.
    """

    count: Thousand = 3


@dataclass(frozen=True, repr=False)
class WearOptions(Table):
    """Wear over many cycles, of the command ``wear``.

    Attributes:
        coefficient: depth that both bodies lose together, per density of dissipated energy.
        archard: the same per pressure and sliding distance, instead of ``coefficient``.
        cycles: number of cycles, 1 to 1 000 000 000.
        depth: largest depth of both bodies together, at which wear ends before.
        tolerance: largest estimated error of the depth in a step, over the depth that the step
            wears off.
        share: part of the wear that the first body takes, the one of ``edge``; 0 to 1.
    """

    coefficient: Positive | None = None
    archard: Positive | None = None
    cycles: Annotated[int, Ge(1), Le(1_000_000_000)] = 1_000_000
    depth: Positive | None = None
    tolerance: Tolerance = 0.05
    share: Annotated[float, Ge(0.0), Le(1.0)] = 0.5


@dataclass(frozen=True, repr=False)
class FatigueOptions(Table):
    """Fatigue parameters at the probes over the last cycle.

    Attributes:
        average: length along a probe over which each parameter is averaged too.
        dang_van: weight of the hydrostatic stress in Dang Van's parameter.
        crossland: weight of the hydrostatic stress in Crossland's parameter.
        fatemi_socie: weight of the normal stress over ``yield_stress`` in Fatemi's and Socie's
            parameter.
        yield_stress: yield stress; without it there is no parameter of Fatemi and Socie.
        strength: coefficient of Basquin's line, a stress; without it there is no life.
        strength_exponent: its exponent, below 0.
        ductility: coefficient of Coffin's and Manson's line.
        ductility_exponent: its exponent, below 0.
        threshold: range of the stress intensity below which long cracks do not grow; with it
            cracks along the segments of probes are followed, each from its first point.
        fatigue_limit: range of the stress below which no crack begins, given with ``threshold``.
    """

    average: Positive | None = None
    dang_van: NotNegative = 0.3
    crossland: NotNegative = 0.3
    fatemi_socie: NotNegative = 1.0
    yield_stress: Positive | None = None
    strength: Positive | None = None
    strength_exponent: Annotated[float, Gt(-1.0), Lt(0.0)] = -0.09
    ductility: NotNegative = 0.0
    ductility_exponent: Annotated[float, Gt(-2.0), Lt(0.0)] = -0.6
    threshold: Positive | None = None
    fatigue_limit: Positive | None = None


@dataclass(frozen=True, repr=False)
class AccuracyOptions(Table):
    """Options of a run that chooses its mesh by the errors of its numbers.

    Attributes:
        tolerance: largest relative error of the numbers, below 1: twice the estimate is below it;
            default: the mesh is that of the scene.
        numbers: names of the numbers; default: all but the ends of zones and the largest pressure.
            A name without brackets stands for that number of all edges, loads or probes.
        budget_seconds: no mesh is begun that would end later, by prediction.
    """

    tolerance: Tolerance | None = None
    numbers: tuple[str, ...] = ()
    budget_seconds: Positive = 600.0
