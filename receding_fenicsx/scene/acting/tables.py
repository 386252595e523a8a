"""Dataclasses of what acts on the bodies: loads, supports, springs and bolts."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from receding_fenicsx.scene.options import Table
from receding_fenicsx.scene.profiles import Profile

FREE = "free"
"""Component of a prescribed displacement that is not prescribed."""
INTERFERENCE = "interference"
"""Name of the load factor that closes the interference of the contacts, from 0 to 1."""
ON_BODY = ("body_force", "thermal_strain", "mode")
"""Keys of a load on whole bodies."""
KINDS = ("pressure", "traction", "displacement", "force", "tension", *ON_BODY)
"""Keys of a load of which exactly one is given."""


@dataclass(frozen=True, repr=False)
class Load(Table):
    """Named load: one of the ``KINDS``; the last three act on bodies, the others on an edge.

    The history multiplies it by its load factor.

    Attributes:
        name: name of the load in the history.
        edge: edge on which it acts.
        span: part of the edge on which it acts; positions as in a contact.
        pressure: stress normal to the edge; positive is compression.
        traction: components [x, y] in global axes, stresses.
        displacement: prescribed components [x, y]; "free" for a component that is not prescribed.
        platen: the edge moves rigidly without rotation, under ``force`` or by a constant
            ``displacement``. Loads with the same edge and span act on the same platen.
        force: resultant [x, y] on a platen, of the whole body (axisymmetric: of the full circle);
            or on the far field of a half-plane, which without ``platen`` turns freely under a force
            through the middle of the contact.
        tension: stress along the surface of a half-plane far from the contact, on its far field.
        body: name of the body with a body force or thermal strain, in a scene of several.
        body_force: force [x, y] per volume; for example ["rho*omega^2*x", 0] with numbers.
        thermal_strain: strain alpha dT of the free material, alike in all directions of space.
        mode: inertia force M phi of a vibration mode by its number; for ``rf.joint_curve``.
    """

    name: str
    edge: str = ""
    span: tuple[float, float] | None = None
    pressure: Profile | None = None
    traction: tuple[Profile, Profile] | None = None
    displacement: tuple[Profile, Profile] | None = None
    platen: bool = False
    force: tuple[float, float] | None = None
    tension: float | None = None
    body: str | None = None
    body_force: tuple[Profile, Profile] | None = None
    thermal_strain: Profile | None = None
    mode: int | None = None

    @property
    def is_prescribed(self) -> bool:
        """Whether displacements are given, not forces: tension gives those far from the contact."""
        return self.displacement is not None or self.tension is not None

    @property
    def label(self) -> str:
        """Name in messages."""
        return f"load '{self.name}'"

    @property
    def on_body(self) -> bool:
        """Whether the load acts on a body, not on an edge."""
        return any(getattr(self, kind) is not None for kind in ON_BODY)


@dataclass(frozen=True)
class Support:
    """Homogeneous displacement condition at an edge or a point.

    Attributes:
        fix: components held: "x", "y" or "xy".
        edge: edge that is held; or ``point``.
        point: coordinates, or the name of a physical point of a mesh file.
        body: name of the point's body, in a scene of several.
    """

    fix: str
    edge: str | None = None
    point: tuple[float, float] | str | None = None
    body: str | None = None


@dataclass(frozen=True)
class Spring:
    """Springs evenly spread over an edge (Winkler), or a single one at a point.

    Attributes:
        edge: edge that it holds; or ``point``.
        span: part of the edge; positions as in a contact.
        normal, tangential: stiffness against displacements along the edge's normal and along it,
            stresses per length, not negative.
        against: parallel edge of another body that it is tied to; default: the ground.
        point: coordinates, or the name of a physical point of a mesh file.
        body: name of the point's body, in a scene of several.
        x, y: stiffness of a point's spring against displacements along the axes, a force for unit
            thickness per length (axisymmetric: of the full circle), not negative.
    """

    edge: str = ""
    span: tuple[float, float] | None = None
    normal: float = 0.0
    tangential: float = 0.0
    against: str | None = None
    point: tuple[float, float] | str | None = None
    body: str | None = None
    x: float = 0.0
    y: float = 0.0
    label = "[[spring]]"


@dataclass(frozen=True)
class Bolt:
    """Bolt that draws two patches together, and then follows the load as a spring.

    Attributes:
        name: name of its load factor, the shortening.
        preload: force at the end of tightening, for unit thickness (axisymmetric: of all bolts of a
            ring), positive; or ``shortening``.
        head, nut: edges with the patches.
        head_span, nut_span: the patches on them.
        axis: direction [x, y] from head to nut.
        shortening: by how much tightening shortens the bolt, a length, positive; found for a
            preload.
        tightening: shortening at the end of each tightening leg, of this bolt and of the others;
            found for a preload, not to be given.
        stiffness: force for unit thickness over elongation; default: rigid.
    """

    name: str
    head: str
    nut: str
    shortening: float | None = None
    head_span: tuple[float, float] | None = None
    nut_span: tuple[float, float] | None = None
    axis: tuple[float, float] = (0.0, -1.0)
    stiffness: float | None = None
    preload: float | None = None
    tightening: tuple[float, ...] = ()

    @property
    def patches(self) -> tuple[Load, Load]:
        """Unit tension: a force on each patch, towards the other one."""
        x, y = (part / hypot(*self.axis) for part in self.axis)
        return (
            Load(self.name, self.head, self.head_span, force=(x, y)),
            Load(self.name, self.nut, self.nut_span, force=(0.0 - x, 0.0 - y)),
        )
