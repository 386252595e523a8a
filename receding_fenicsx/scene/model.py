"""What is modelled: the scene's dataclasses, and the values of profiles along its edges.

Units are any consistent set. ``docs/scene.md`` tells every key of the file with its default.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.expressions import evaluate_expression

Array = NDArray[np.float64]

Profile = float | str | dict[str, list[float]]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""

EDGES = ("bottom", "top", "left", "right")
"""Edges of a rectangle; "bottom" is y = 0 and x = 0 is the centre."""
HORIZONTAL = ("bottom", "top")
OF_RECTANGLES = ("shape", "width", "height", "position")
"""Keys of a body that belong to a rectangle and not to a mesh file."""
FREE = "free"
"""A component of a load's displacement that is not prescribed."""


@dataclass(frozen=True)
class Body:
    """Shape of an elastic body: a rectangle, or a mesh file with named physical groups.

    Attributes:
        name: names the body in "NAME.edge"; needed when there are two.
        shape: "rectangle".
        width, height: its sides; of a cylinder (axisymmetric, at x = 0) the width is the diameter.
        position: middle of the rectangle's bottom edge. Axisymmetric, a rectangle at x = r > 0 is
            a ring between the radii r - width / 2 and r + width / 2.
        mesh: a .geo or .msh file, in place of the rectangle; in a scene file its path is relative
            to that file.
        surface: physical surface of the mesh file that is the body; all of it when left out.
        parameters: numbers given to the .geo file.
        material: name of the body's table [material.NAME]. When left out, the one named like the
            body, or else [material].
    """

    name: str = ""
    shape: str = "rectangle"
    width: float = 4.0
    height: float = 1.0
    position: tuple[float, float] = (0.0, 0.0)
    mesh: str | None = None
    surface: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    material: str | None = None


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity.

    Attributes:
        young: Young's modulus, a stress; positive.
        poisson: Poisson's ratio, above -1 and below 0.5 (below 1 in plane stress).
        kinematics: "plane strain", "plane stress" or "axisymmetric": x is then r, y is z.
        name: that of a table [material.NAME].
    """

    young: float = 1.0
    poisson: float = 0.3
    kinematics: str = "plane strain"
    name: str = ""

    @property
    def poisson_limit(self) -> float:
        """Poisson's ratio at which the material is incompressible in its kinematics."""
        return 1.0 if self.kinematics == "plane stress" else 0.5


@dataclass(frozen=True)
class MeshOptions:
    """How the body is meshed.

    Attributes:
        contact_elements: elements on the whole nominal contact edge, 4 to 20000.
        cell: "triangle" or "quadrilateral".
        degree: degree of the displacements, 1 or 2.
        growth: size ratio of neighbouring layers away from the contact, 1 (uniform) to 3.
    """

    contact_elements: int = 160
    cell: str = "triangle"
    degree: int = 2
    growth: float = 1.25


@dataclass(frozen=True)
class Contact:
    """One contact edge.

    Attributes:
        edge: the edge that may touch.
        span: part of the edge; outside, the edge is free.
        friction: coefficient of friction, not negative.
        initial_gap: gap before loading, a length, not negative.
        against: the other body's edge; a rigid plane when left out.

    Positions along the edge, in ``span`` and the profiles, run from its middle: rightwards or
    upwards on a rectangle, with the body on the left (along t) on a mesh of the user's own. On a
    body of revolution they are radii.
    """

    edge: str = "bottom"
    span: tuple[float, float] | None = None
    friction: Profile = 0.35
    initial_gap: Profile = 0.0
    against: str | None = None


@dataclass(frozen=True)
class Load:
    """One named load with its load factor: one of pressure, traction, displacement and force.

    Attributes:
        name: what the history calls it.
        edge: where it acts.
        span: part of the edge, along it as that of a contact.
        pressure: stress normal to the edge; positive pushes on the body.
        traction: [x, y] in global axes, stresses.
        displacement: [x, y] prescribed; a component that is "free" is not.
        platen: the edge moves rigidly without rotation, under ``force`` or by a constant
            ``displacement``; loads with the same edge and span share it.
        force: [x, y], resultant on a platen (axisymmetric: of the full circle; one half of a
            symmetric body carries half).
    """

    name: str
    edge: str
    span: tuple[float, float] | None = None
    pressure: Profile | None = None
    traction: tuple[Profile, Profile] | None = None
    displacement: tuple[Profile, Profile] | None = None
    platen: bool = False
    force: tuple[float, float] | None = None


@dataclass(frozen=True)
class Support:
    """Degrees of freedom held at an edge or a point.

    Attributes:
        fix: "x", "y" or "xy".
        edge: the edge that is held.
        point: a place, or the name of a group of points of a mesh file, that is held instead.
        body: whose point it is, in a scene of two bodies.
    """

    fix: str
    edge: str | None = None
    point: tuple[float, float] | str | None = None
    body: str | None = None


@dataclass(frozen=True)
class HistoryOptions:
    """The load history's table in the scene file; see :mod:`receding_fenicsx.scene.history`.

    Attributes:
        kind: "cyclic", "monotonic" or "table".
        load: name of the load that is driven, unless there is but one.
        maximum: largest load factor, positive.
        minimum: smallest load factor of the cycles, below the maximum.
        cycles: cycles at most.
        until: "steady" to stop when the steady state is reached.
        columns: of a table, the load of each column.
        rows: of a table, load factors from rest to the cycles' start.
        cycle_rows: of a table, corners of a cycle, from the last of ``rows`` and back to it.
        initial_slip: tangential displacement at rest from which the first slip is counted.
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
    initial_slip: Profile | None = None


@dataclass(frozen=True)
class SolverOptions:
    """Method and tolerances, each relative to the scene's own scales.

    Attributes:
        method: "events" (exact) or "gauss-seidel" (in load steps).
        steps_per_leg: load steps a leg (Gauss-Seidel).
        symmetry: "auto" models half of a symmetric body, "none" never.
        over_relaxation: between 0 and 2 (Gauss-Seidel).
        polish: solve directly once the states have settled (Gauss-Seidel).
        change_tolerance: change in a sweep over the step's largest displacement, eq. (16).
        residual_tolerance: residual of the contact law over the largest nodal force.
        max_sweeps: sweeps a step; one that needs more is an error. Steps whose sweeps cycle or
            creep (1000 leave more than a tenth of the residual) are taken on the exact path.
        steady_tolerance: change of the nodal forces over a cycle, over the largest, below which
            they repeat; slips repeat below 100 times as much of a cycle's largest slip.
        on_jump: "stop" or "static", where no quasi-static path leads on.
    """

    method: str = "events"
    steps_per_leg: int = 40
    symmetry: str = "auto"
    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-12
    max_sweeps: int = 20000
    steady_tolerance: float = 1e-8
    on_jump: str = "stop"


@dataclass(frozen=True)
class OutputOptions:
    """What is kept of the history, and how often a run can be gone on with.

    Attributes:
        samples_per_leg: samples a leg of the kept cycles.
        cycles: which cycles get samples and events ("all", list, None: default).
        checkpoint_cycles: cycles between two checkpoints; after 20 times as many a tenth of the
            finished cycles at most.
    """

    samples_per_leg: int = 40
    cycles: tuple[int, ...] | str | None = None
    checkpoint_cycles: int = 10


@dataclass(frozen=True)
class Scene:
    """Everything that a run is made from.

    ``body`` and ``material`` are the first body and the material of bodies that name no other;
    ``others`` and ``materials`` hold further bodies and the tables [material.NAME].
    """

    title: str = ""
    body: Body = field(default_factory=Body)
    others: tuple[Body, ...] = ()
    material: Material = field(default_factory=Material)
    materials: tuple[Material, ...] = ()
    mesh: MeshOptions = field(default_factory=MeshOptions)
    contacts: tuple[Contact, ...] = (Contact(),)
    loads: tuple[Load, ...] = ()
    supports: tuple[Support, ...] = ()
    history: HistoryOptions = field(default_factory=HistoryOptions)
    solver: SolverOptions = field(default_factory=SolverOptions)
    output: OutputOptions = field(default_factory=OutputOptions)

    @property
    def axisymmetric(self) -> bool:
        """Whether x stands for r and y for z of a body of revolution."""
        return self.material_of(self.body).kinematics == "axisymmetric"

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads; parts of one load on two bodies share its name."""
        return tuple(dict.fromkeys(load.name for load in self.loads))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies."""
        return (self.body, *self.others)

    def material_of(self, body: Body) -> Material:
        """Return the material of a body.

        Raises:
            InputError: the body names a material that the scene does not have.
        """
        for material in self.materials:
            if material.name == (body.material or body.name):
                return material
        if body.material is None:
            return self.material
        raise InputError(
            f'[body] material: "{body.material}" is unknown; add [material.{body.material}]'
        )

    def find_edge(self, edge: str) -> tuple[Body, str]:
        """Return the body of an edge "NAME.edge" and the edge's own name.

        The body's name may be left out in a scene of one body.

        Raises:
            InputError: no body has that name.
        """
        for body in self.bodies:
            if body.name and edge.startswith(f"{body.name}."):
                return body, edge[len(body.name) + 1 :]
        if self.others:
            names = [body.name for body in self.bodies]
            raise InputError(
                f'"{edge}" names none of the bodies {", ".join(names)}; write it as '
                f'"{nearest(edge.partition(".")[0], names) or names[0]}.{edge.rpartition(".")[2]}"'
            )
        return self.body, edge


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most like a name, if one is like it at all."""
    return next(iter(difflib.get_close_matches(name, list(known), n=1)), None)


def evaluate(profile: Profile, x: ArrayLike, y: ArrayLike | None = None) -> Array:
    """Evaluate a profile: constant, expression, or linear table held constant beyond its ends.

    Args:
        profile: number, expression or table.
        x: points.
        y: second coordinate of the points, for expressions that use it.

    Returns:
        Values, of the shape of ``x``.

    Raises:
        InputError: the expression cannot be read, or its value is not finite at one of the points.
    """
    points = np.asarray(x, dtype=float)
    if isinstance(profile, str):
        return evaluate_expression(
            profile, points, None if y is None else np.asarray(y, dtype=float)
        )
    if isinstance(profile, dict):
        return np.interp(points, profile["x"], profile["value"])
    return np.full(points.shape, float(profile))


def is_cylinder(scene: Scene, body: Body) -> bool:
    """Whether a rectangle's middle is the axis of revolution, so that x >= 0 is all of it."""
    return scene.axisymmetric and body.position[0] == 0.0


def edge_range(scene: Scene, edge: str) -> tuple[float, float]:
    """Ends of a rectangle's edge as a ``span`` counts them: from its middle, or radii."""
    body, name = scene.find_edge(edge)
    if name not in EDGES:
        raise InputError(f"'{edge}' is no edge of a rectangle; use one of {', '.join(EDGES)}")
    half = 0.5 * (body.width if name in HORIZONTAL else body.height)
    if scene.axisymmetric and name in HORIZONTAL:
        middle = body.position[0]
        return 0.0 if is_cylinder(scene, body) else middle - half, middle + half
    return -half, half


def edge_points(scene: Scene, edge: str, along: ArrayLike) -> tuple[Array, Array]:
    """Coordinates (x, y) of the points of a rectangle's edge at positions along it."""
    body, name = scene.find_edge(edge)
    t = np.asarray(along, dtype=float)
    x, y = body.position
    if name in HORIZONTAL:
        if not scene.axisymmetric:  # there positions are radii
            t = t + x
        return t, np.full(t.shape, y + (0.0 if name == "bottom" else body.height))
    side = -0.5 if name == "left" else 0.5
    return np.full(t.shape, x + side * body.width), t + (y + 0.5 * body.height)
