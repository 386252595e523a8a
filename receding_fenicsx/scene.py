"""What is modelled: the scene's dataclasses, read from TOML, validated with clear messages."""

from __future__ import annotations

from dataclasses import dataclass, field

Profile = float | str | dict[str, list[float]]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""


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
    """How the body is meshed; ``growth`` is the size ratio between neighbouring layers, 1 = uniform."""

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
    """One named load with load factor lambda; exactly one of pressure, traction, displacement or force."""

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

    method: str = "gauss-seidel"
    steps_per_leg: int = 40
    symmetry: str = "auto"
    over_relaxation: float = 1.5
    polish: bool = True
    change_tolerance: float = 1e-10
    residual_tolerance: float = 1e-10
    max_sweeps: int = 20000
    steady_tolerance: float = 1e-8


@dataclass(frozen=True)
class OutputOptions:
    """What is kept of the history: samples a leg, and which cycles (all, or a list; None = default)."""

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
