"""Dataclasses of what acts on the bodies besides the contact: loads, supports, springs, bolts."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Annotated

from receding_fenicsx.scene.checks import Count, NotNegative, Number, OneOf, Pair, Positive, Table
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
    body: str | None = None
    body_force: tuple[Profile, Profile] | None = None
    thermal_strain: Profile | None = None
    mode: Count | None = None

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
    point: Pair | str | None = None
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
    point: Pair | str | None = None
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
