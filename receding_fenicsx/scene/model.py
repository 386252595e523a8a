"""Dataclasses of a scene: bodies, materials, mesh, contacts, ties; all else is in ``options``.

Any consistent set of units can be used. The types say what each key may be, the docstrings what it
means: ``docs/scene.md`` and the JSON Schema of scene files are written from them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from receding_fenicsx.arrays import call_of, described
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import (
    ByType,
    NotNegative,
    Number,
    OneOf,
    Pair,
    Positive,
    Table,
    check_known,
    nearest,
)
from receding_fenicsx.scene.options import FREE as FREE
from receding_fenicsx.scene.options import INTERFERENCE as INTERFERENCE
from receding_fenicsx.scene.options import AccuracyOptions as AccuracyOptions
from receding_fenicsx.scene.options import Bolt as Bolt
from receding_fenicsx.scene.options import FatigueOptions as FatigueOptions
from receding_fenicsx.scene.options import Harmonic as Harmonic
from receding_fenicsx.scene.options import HistoryOptions as HistoryOptions
from receding_fenicsx.scene.options import Load as Load
from receding_fenicsx.scene.options import ModeOptions as ModeOptions
from receding_fenicsx.scene.options import OutputOptions as OutputOptions
from receding_fenicsx.scene.options import Probe as Probe
from receding_fenicsx.scene.options import ShakedownOptions as ShakedownOptions
from receding_fenicsx.scene.options import SolverOptions as SolverOptions
from receding_fenicsx.scene.options import Spring as Spring
from receding_fenicsx.scene.options import Support as Support
from receding_fenicsx.scene.options import Units
from receding_fenicsx.scene.options import WearOptions as WearOptions
from receding_fenicsx.scene.profiles import FrictionProfile, Profile

MAX_CONTACT_ELEMENTS = 20000
"""Most elements on a contact edge: the condensed stiffness of more needs tens of gigabytes."""
RECTANGLE_KEYS = ("shape", "width", "height", "position")
"""Keys of a body that a mesh file replaces."""
TABLE_OF = {
    "others": "body",
    "materials": "material",
    "contacts": "contact",
    "ties": "tie",
    "loads": "load",
    "supports": "support",
    "springs": "spring",
    "bolts": "bolt",
    "probes": "probe",
}
"""Table of the scene file for each attribute of a scene that has another name."""

Slave = Annotated[str, OneOf("edge", "against")]
Kinematics = Annotated[str, OneOf("plane strain", "plane stress", "axisymmetric")]


@dataclass(frozen=True, repr=False)
class Body(Table):
    """Shape of an elastic body: a rectangle, or a mesh file with named physical groups.

    Attributes:
        name: name of the body in "NAME.edge"; needed when there are several bodies.
        shape: "rectangle", with the edges "bottom", "top", "left" and "right"; or "half-plane": no
            mesh, infinite, with the surface "bottom" or "top" and the far field "far".
        width: length of the rectangle's bottom edge; of a cylinder (axisymmetric, at x = 0) its
            diameter, of a half-plane the width of its contact.
        height: length of the side edges; the unit h of lengths in the results, see [units].
        position: [x, y] of the middle of the rectangle's bottom edge, or of a half-plane's contact.
            An axisymmetric rectangle at x > 0 is a ring between the radii x - width / 2 and
            x + width / 2.
        mesh: a .geo or .msh file instead of the rectangle; in a scene file the path is relative to
            that file.
        surface: physical surface of the mesh file that is the body; default: all surfaces.
        datum: depth, below the middle of the contact, of the point that displacements of a
            half-plane are relative to; default: ten times the length of the contact.
        window: [width, depth] of the part of a half-plane that pictures show; default: two and one
            times the length of the contact.
        parameters: values of constants of the .geo file, such as {angle = 30}.
        material: name of the body's table [material.NAME]; default: the table with the name of the
            body, or else [material].
    """

    name: str = ""
    shape: Annotated[str, OneOf("rectangle", "half-plane")] = "rectangle"
    width: Positive = 4.0
    height: Positive = 1.0
    position: Pair = (0.0, 0.0)
    mesh: str | None = None
    surface: str | None = None
    datum: Number | None = None
    window: tuple[Positive, Positive] | None = None
    parameters: dict[str, Number] = field(default_factory=dict)
    material: str | None = None

    @property
    def is_half_plane(self) -> bool:
        """Whether the body is a half-plane without a mesh."""
        return self.mesh is None and self.shape == "half-plane"

    @property
    def is_rectangle(self) -> bool:
        """Whether the body is a rectangle."""
        return self.mesh is None and not self.is_half_plane

    def __repr__(self) -> str:
        """Return the values; those of a rectangle only where it is one."""
        return call_of(self, () if self.mesh is None else RECTANGLE_KEYS)


@dataclass(frozen=True, repr=False)
class Material(Table):
    """Linear elastic material, isotropic or, with ``young_2``, orthotropic.

    Attributes:
        young: Young's modulus, a stress; positive. Of an orthotropic material that along its
            direction 1.
        poisson: Poisson's ratio, above -1 and below 0.5 (below 1 in plane stress). Of an
            orthotropic material nu_12, the contraction along 2 under tension along 1.
        kinematics: "plane strain", "plane stress" (unit thickness) or "axisymmetric" (x is r, y is
            z).
        name: NAME of a table [material.NAME]; not a key of the file.
        density: mass per volume, for vibration modes; 0 where it is not given.
        young_2: Young's modulus of an orthotropic material across its direction 1; in plane stress.
        shear: shear modulus G_12 of an orthotropic material.
        angle: from x to direction 1 of an orthotropic material, counter-clockwise in degrees.
    """

    young: Positive = 1.0
    poisson: Annotated[float, Gt(-1.0), Lt(1.0)] = 0.3
    kinematics: Kinematics = "plane strain"
    name: str = ""
    density: NotNegative = 0.0
    young_2: Positive | None = None
    shear: Positive | None = None
    angle: Number = 0.0


@dataclass(frozen=True, repr=False)
class Refinement(Table):
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

    size: Positive
    at: Annotated[Number | Pair | Annotated[str, OneOf("ends", "corners")], ByType()] = "ends"
    growth: Annotated[float, Ge(1.01), Le(3.0)] | None = None
    edge: str | None = None

    @property
    def span(self) -> tuple[float, float]:
        """Range of a place by position."""
        assert not isinstance(self.at, str)
        return self.at if isinstance(self.at, tuple) else (self.at, self.at)


@dataclass(frozen=True, repr=False)
class MeshOptions(Table):
    """Mesh options.

    Attributes:
        contact_elements: elements on the whole nominal contact edge, 4 to 20000; the number of
            contact nodes is ``degree`` times ``contact_elements`` plus 1.
        cell: "triangle" or "quadrilateral".
        degree: polynomial degree of the displacements, 1 or 2.
        growth: size ratio of neighbouring layers away from the contact and from the ends of loads
            and supports, 1 (uniform) to 3.
        refine: places on the contact edge with smaller elements: a list of
            {at = ..., size = ..., growth = ..., edge = ...}; ``at`` is a position, a range, "ends"
            or "corners". Default: none, but a search for a tolerance grades its meshes towards
            sharp corners in contact, which [] switches off.
        refinements: times that the mesh of a file is refined uniformly, 0 to 6: each halves the
            size of all its elements.
    """

    # fewer than 4 cannot show stick, slip and separation side by side
    contact_elements: Annotated[int, Ge(4), Le(MAX_CONTACT_ELEMENTS)] = 160
    cell: Annotated[str, OneOf("triangle", "quadrilateral")] = "triangle"
    degree: Annotated[int, Ge(1), Le(2)] = 2
    growth: Annotated[float, Ge(1.0), Le(3.0)] = 1.25
    refine: tuple[Refinement, ...] | None = None
    refinements: Annotated[int, Ge(0), Le(6)] | None = None

    @property
    def places(self) -> tuple[Refinement, ...]:
        """Places with smaller elements."""
        return self.refine or ()


@dataclass(frozen=True, repr=False)
class Contact(Table):
    """Contact edge.

    Attributes:
        edge: edge that may touch the other side.
        span: [from, to], part of the edge that may touch; default: the whole edge.
        friction: coefficient of friction f, a profile; not negative, 0 for none.
            {forward = PROFILE, backward = PROFILE} where it differs between forward slip (v grows,
            Q = -f_forward P) and backward slip (v falls, Q = +f_backward P).
        initial_gap: gap before loading, a length, a profile; not negative.
        against: edge of another body, "NAME.edge"; default: a rigid plane.
        interference: depth by which the bodies would overlap as made, a length, a profile; not
            negative.
        slave: "edge" or "against": the side whose nodes are the contact points where those of both
            do not match; default: the one with more of them.
        shear_limit: shear traction t that the contact bears at most, a profile: |q| <= min(f p, t);
            default: none.
        cohesion: shear traction c that it bears without pressure, a profile: |q| <= f p + c, open
            nodes excepted; default: none.

    Positions in ``span`` and in profiles are measured along the edge from its middle: to the right
    or upwards on a rectangle, along t (the body on the left) on a mesh file. On a body of
    revolution they are radii.
    """

    edge: str = "bottom"
    span: Pair | None = None
    friction: FrictionProfile = 0.35
    initial_gap: Profile = 0.0
    against: str | None = None
    interference: Profile | None = None
    slave: Slave | None = None
    shear_limit: Profile | None = None
    cohesion: Profile | None = None


@dataclass(frozen=True, repr=False)
class Tie(Table):
    """Two edges that cannot move relative to each other, without contact nodes.

    Attributes:
        edge: tied edge.
        span: [from, to], part of the edge that is tied; default: the whole edge.
        against: edge of another body, "NAME.edge"; default: a rigid plane.
        slave: "edge" or "against": the side each of whose nodes follows the other side where their
            nodes do not match; default: the one with more of them.
    """

    edge: str
    span: Pair | None = None
    against: str | None = None
    slave: Slave | None = None


Joint = Contact | Tie


@dataclass(frozen=True, repr=False)
class Scene(Table):
    """Input of a run: bodies, materials, contacts, loads, history and options.

    ``body`` is the first body, ``others`` are the other ones. ``material`` is the default material,
    ``materials`` are the tables [material.NAME].
    """

    title: str = ""
    body: Body = field(default_factory=Body)
    others: tuple[Body, ...] = ()
    material: Material = field(default_factory=Material)
    materials: tuple[Material, ...] = ()
    mesh: MeshOptions = field(default_factory=MeshOptions)
    contacts: tuple[Contact, ...] = (Contact(),)
    ties: tuple[Tie, ...] = ()
    loads: tuple[Load, ...] = ()
    supports: tuple[Support, ...] = ()
    springs: tuple[Spring, ...] = ()
    bolts: tuple[Bolt, ...] = ()
    history: HistoryOptions = field(default_factory=HistoryOptions)
    solver: SolverOptions = field(default_factory=SolverOptions)
    output: OutputOptions = field(default_factory=OutputOptions)
    probes: tuple[Probe, ...] = ()
    units: Units = field(default_factory=Units)
    shakedown: ShakedownOptions = field(default_factory=ShakedownOptions)
    accuracy: AccuracyOptions = field(default_factory=AccuracyOptions)
    mode: ModeOptions = field(default_factory=ModeOptions)
    wear: WearOptions = field(default_factory=WearOptions)
    fatigue: FatigueOptions | None = None

    def __repr__(self) -> str:
        """Return the parts of the scene, long tables cut."""
        rows = []
        for name in (part.name for part in fields(self) if part.name != "title"):
            value = getattr(self, name)
            for item in value if isinstance(value, tuple) else (value,):
                rows.append((TABLE_OF.get(name, name), repr(item)))
        return described(f"Scene {self.title!r}", rows)

    @property
    def axisymmetric(self) -> bool:
        """Whether the scene is a body of revolution: x is r and y is z."""
        return self.material_of(self.body).kinematics == "axisymmetric"

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Contacts, then ties."""
        return (*self.contacts, *self.ties)

    @property
    def joint_labels(self) -> tuple[str, ...]:
        """Beginning of messages on each contact, then on each tie."""
        return tuple(
            f"[{name}]" if len(joints) == 1 else f"[[{name}]] number {i + 1}"
            for name, joints in (("contact", self.contacts), ("tie", self.ties))
            for i in range(len(joints))
        )

    @property
    def given(self) -> tuple[Load, ...]:
        """Loads, and the unit tensions of the bolts."""
        return (*self.loads, *(patch for bolt in self.bolts for patch in bolt.patches))

    @property
    def applied(self) -> tuple[Load, ...]:
        """The same with the unit loads of those that travel."""
        return tuple(unit for load in self.given for unit in load.units)

    @property
    def edge_loads(self) -> tuple[Load, ...]:
        """Of these the ones on edges, without those on whole bodies and gaps."""
        return tuple(part for part in self.given if not part.on_body and part.gap is None)

    @property
    def edge_parts(self) -> tuple[Load | Spring, ...]:
        """What acts on edges or parts of them, travelling loads on all of theirs: with springs."""
        loads = (replace(part, span=None) if part.travel else part for part in self.edge_loads)
        return (*loads, *(spring for spring in self.springs if spring.edge))

    @property
    def driven_names(self) -> tuple[str, ...]:
        """Names of the loads, each once: the parts of a load share its name."""
        return tuple(dict.fromkeys(unit.name for load in self.loads for unit in load.units))

    @property
    def load_names(self) -> tuple[str, ...]:
        """Names of the load factors of a history: of the loads, bolts and interference."""
        return (*self.driven_names, *self.preloads)

    @property
    def preloads(self) -> dict[str, float]:
        """Load factors of first legs of their own, by name; unknown shortenings are 0."""
        fits = any(contact.interference is not None for contact in self.contacts)
        tightened = {bolt.name: bolt.shortening or 0.0 for bolt in self.bolts}
        return tightened | ({INTERFERENCE: 1.0} if fits else {})

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies, the first one first."""
        return (self.body, *self.others)

    def material_of(self, body: Body) -> Material:
        """Return the material of a body; raise InputError for one that the scene lacks."""
        named = {material.name: material for material in self.materials}
        if body.material is not None:
            check_known(body.material, [*named], f"{self.label(body)} material", "material")
        default = next(iter(self.surface_materials(body)), self.material)
        return named.get(body.material or body.name, default)

    def surface_materials(self, body: Body) -> tuple[Material, ...]:
        """Return the tables [material.NAME] that can be those of single surfaces of a body."""
        names = {each.material or each.name for each in self.bodies}
        own = body.material or body.name
        if body.mesh is None or body.surface or any(m.name == own for m in self.materials):
            return ()
        return tuple(material for material in self.materials if material.name not in names)

    def label(self, body: Body) -> str:
        """Return the beginning of messages on a body."""
        return f"body '{body.name}'" if self.others else "[body]"

    def find_edge(self, edge: str, where: str = "") -> tuple[Body, str]:
        """Split "NAME.edge" or, of one body, "edge" into body and edge; ``where`` begins errors."""
        for body in self.bodies:
            if body.name and edge.startswith(f"{body.name}."):
                return body, edge[len(body.name) + 1 :]
        if self.others:
            names = [body.name for body in self.bodies]
            raise InputError(
                f'{where}"{edge}" names none of the bodies {", ".join(names)}; write it as '
                f'"{nearest(edge.partition(".")[0], names) or names[0]}.{edge.rpartition(".")[2]}"'
            )
        return self.body, edge
