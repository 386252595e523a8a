"""Kinds of loads: what a load and its work-conjugate displacement are, and their units.

A load with factor lambda does the work dW = lambda dU; the record holds U. Where the load is one
number F (a force, a stress, a prescribed displacement), figures show F lambda against U / F, so
that the area of a loop is still the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from receding_fenicsx.scene.model import FREE, Load, Scene


@dataclass(frozen=True)
class LoadKind:
    """What a load is.

    Attributes:
        size: the load at factor 1; 1 if it is no single number.
        unit: powers of stress and length in its unit; (0, 0) for a load factor.
        conjugate: name of the work-conjugate quantity U / size.
        conjugate_unit: powers of stress and length in the unit of that.
    """

    size: float
    unit: tuple[int, int]
    conjugate: str
    conjugate_unit: tuple[int, int]


def kind_of(scene: Scene | None, name: str, axisymmetric: bool) -> LoadKind:
    """Return the kind of a load.

    Args:
        scene: the scene; None if it is not known.
        name: name of the load.
        axisymmetric: forces and work are those of the full circle, not for unit thickness.
    """
    # work is stress times area in the plane, for unit thickness, or stress times volume
    work = (1, 3 if axisymmetric else 2)
    parts = [load for load in scene.loads if load.name == name] if scene else []
    if scene and name in [bolt.name for bolt in scene.bolts]:
        return LoadKind(1.0, (0, 1), "force of the bolt", (1, 1))
    found = {_size_and_kind(part) for part in parts}
    size, kind = found.pop() if len(found) == 1 else (0.0, "factor")
    if (len(parts) > 1 and kind in ("force", "displacement")) or size == 0.0:
        size, kind = 1.0, "factor"
    unit = {
        "force": (1, work[1] - 1),
        "stress": (1, 0),
        "displacement": (0, 1),
        "factor": (0, 0),
    }[kind]
    conjugate = {
        "force": "displacement of the platen",
        "stress": "displaced volume" if axisymmetric else "displaced area",
        "displacement": "force on the edge",
        "factor": "work over load factor",
    }[kind]
    return LoadKind(size, unit, conjugate, (work[0] - unit[0], work[1] - unit[1]))


def _size_and_kind(load: Load) -> tuple[float, str]:
    """Return the size of one part of a load and its kind; 0 if it is no single number."""
    if load.on_body or load.tension is not None:
        return 0.0, "factor"
    if load.force is not None:
        return hypot(*load.force), "force"
    if load.pressure is not None:
        return (load.pressure if isinstance(load.pressure, float | int) else 0.0), "stress"
    kind = "displacement" if load.traction is None else "stress"
    values = load.traction or load.displacement or ()
    numbers = [
        0.0 if value == FREE else float(value)
        for value in values
        if value == FREE or isinstance(value, float | int)
    ]
    return (hypot(*numbers) if len(numbers) == len(values) else 0.0), kind
