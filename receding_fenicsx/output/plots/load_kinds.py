"""Kinds of loads: what a load and its work-conjugate quantity are, and their units.

A load with factor lambda does the work dW = lambda dU, a prescribed displacement dW = U dlambda;
the record holds U. Where the load is one number F (a force, a stress, a prescribed displacement),
figures show F lambda and U / F, so that the area of a loop is still the work.
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
        symbol: symbol of the conjugate quantity.
    """

    size: float
    unit: tuple[int, int]
    conjugate: str
    conjugate_unit: tuple[int, int]
    symbol: str


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
        return LoadKind(1.0, (0, 1), "force of the bolt", (1, work[1] - 1), "F")
    found = {_size_and_kind(part) for part in parts}
    size, kind = found.pop() if len(found) == 1 else (0.0, "factor")
    if (len(parts) > 1 and kind in ("force", "displacement")) or size == 0.0:
        size, kind = 1.0, "factor"
    displaced = "displaced volume" if axisymmetric else "displaced area"
    unit, conjugate, symbol = {
        "force": ((1, work[1] - 1), "displacement along the force", r"\delta"),
        "stress": ((1, 0), displaced, r"\delta"),
        "tension": ((1, 0), "area conjugate to the tension", r"\delta"),
        "displacement": ((0, 1), "force on the edge", "F"),
        "factor": ((0, 0), "work over load factor", "U"),
    }[kind]
    return LoadKind(size, unit, conjugate, (work[0] - unit[0], work[1] - unit[1]), symbol)


def _size_and_kind(load: Load) -> tuple[float, str]:
    """Return the size of one part of a load and its kind; 0 if it is no single number."""
    if load.on_body:
        return 0.0, "factor"
    if load.tension is not None:
        return float(load.tension), "tension"
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
