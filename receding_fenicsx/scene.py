"""What is modelled: the scene's dataclasses, and the values of profiles along its edges.

Reading and writing TOML is in :mod:`receding_fenicsx.scene_file`, the checks and the test for
mirror symmetry in :mod:`receding_fenicsx.scene_checks`; their public functions are also found here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.expressions import evaluate_expression

if TYPE_CHECKING:
    from receding_fenicsx.scene_checks import is_mirror_symmetric as is_mirror_symmetric
    from receding_fenicsx.scene_file import from_toml as from_toml
    from receding_fenicsx.scene_file import read_scene as read_scene
    from receding_fenicsx.scene_file import to_toml as to_toml

Array = NDArray[np.float64]

Profile = float | str | dict[str, list[float]]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""

EDGES = ("bottom", "top", "left", "right")
"""Edges of a rectangle; "bottom" is y = 0 and x = 0 is the centre."""
HORIZONTAL = ("bottom", "top")


@dataclass(frozen=True)
class Body:
    """Shape of the elastic body: a rectangle, or a mesh file with named physical groups."""

    shape: str = "rectangle"
    width: float = 4.0
    height: float = 1.0
    mesh: str | None = None


@dataclass(frozen=True)
class Material:
    """Isotropic linear elasticity."""

    young: float = 1.0
    poisson: float = 0.3
    kinematics: str = "plane strain"


@dataclass(frozen=True)
class MeshOptions:
    """How the body is meshed; ``growth`` is the size ratio of neighbouring layers, 1 = uniform."""

    contact_elements: int = 160
    cell: str = "triangle"
    degree: int = 2
    growth: float = 1.3


@dataclass(frozen=True)
class Contact:
    """One contact edge against a rigid plane; ``span`` restricts it."""

    edge: str = "bottom"
    span: tuple[float, float] | None = None
    friction: Profile = 0.35
    initial_gap: Profile = 0.0


@dataclass(frozen=True)
class Load:
    """One named load with its load factor: exactly one of pressure and traction (global axes).

    ``span`` runs along the edge: x on "bottom" and "top", y less half the height on the others.
    """

    name: str
    edge: str
    span: tuple[float, float] | None = None
    pressure: Profile | None = None
    traction: tuple[Profile, Profile] | None = None


@dataclass(frozen=True)
class Support:
    """Degrees of freedom held at an edge or a point: ``fix`` is "x", "y" or "xy"."""

    fix: str
    edge: str | None = None
    point: tuple[float, float] | None = None


@dataclass(frozen=True)
class HistoryOptions:
    """The load history's table in the scene file; see :mod:`receding_fenicsx.history`."""

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
    """Method and tolerances, each relative to the scene's own scales."""

    method: str = "events"
    steps_per_leg: int = 40
    symmetry: str = "auto"
    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-12
    max_sweeps: int = 20000
    steady_tolerance: float = 1e-8


@dataclass(frozen=True)
class OutputOptions:
    """What is kept of the history: samples a leg, and which cycles ("all", list, None: default)."""

    samples_per_leg: int = 40
    cycles: tuple[int, ...] | str | None = None


@dataclass(frozen=True)
class Scene:
    """Everything that a run is made from."""

    title: str = ""
    body: Body = field(default_factory=Body)
    material: Material = field(default_factory=Material)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    contacts: tuple[Contact, ...] = (Contact(),)
    loads: tuple[Load, ...] = ()
    supports: tuple[Support, ...] = ()
    history: HistoryOptions = field(default_factory=HistoryOptions)
    solver: SolverOptions = field(default_factory=SolverOptions)
    output: OutputOptions = field(default_factory=OutputOptions)

    def validate(self) -> None:
        """Raise InputError, one line, when the scene cannot be modelled."""
        from receding_fenicsx.scene_checks import validate

        validate(self)


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


def edge_range(scene: Scene, edge: str) -> tuple[float, float]:
    """Ends of an edge, measured along it from the body's centre, as a ``span`` is."""
    if edge not in EDGES:
        raise InputError(f"'{edge}' is no edge of a rectangle; use one of {', '.join(EDGES)}")
    half = 0.5 * (scene.body.width if edge in HORIZONTAL else scene.body.height)
    return -half, half


def edge_points(scene: Scene, edge: str, along: ArrayLike) -> tuple[Array, Array]:
    """Coordinates (x, y) of the points of an edge at the positions ``along`` from its centre."""
    t = np.asarray(along, dtype=float)
    if edge in HORIZONTAL:
        return t, np.full(t.shape, 0.0 if edge == "bottom" else scene.body.height)
    side = -0.5 if edge == "left" else 0.5
    return np.full(t.shape, side * scene.body.width), t + 0.5 * scene.body.height


def __getattr__(name: str) -> Any:
    """Find the functions of the modules that build on this one, loaded when first asked for."""
    if name in ("read_scene", "from_toml", "to_toml"):
        from receding_fenicsx import scene_file

        return getattr(scene_file, name)
    if name == "is_mirror_symmetric":
        from receding_fenicsx.scene_checks import is_mirror_symmetric

        return is_mirror_symmetric
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
