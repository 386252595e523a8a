"""Units of a scene, as text for axes and tables."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import Annotated

from annotated_types import MaxLen

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import Table

UnitName = Annotated[str, MaxLen(12)]
POWERS = {1: "", 2: "²", 3: "³"}


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
        parts = [(self.stress, stress), (self.length, length)]
        needed = [(unit, power) for unit, power in parts if power]
        if any(unit is None for unit, _ in needed):
            return ""
        return " ".join(f"{unit}{POWERS[power]}" for unit, power in needed)

    def of_force(self, axisymmetric: bool) -> str:
        """Return the unit of forces: of the full circle, or in the plane for unit thickness."""
        divided = bool(re.search(r"[/⁻]|-\d| per ", self.force or ""))
        if self.force and divided != axisymmetric:
            return self.force
        if self.force and self.length and not axisymmetric:
            return f"{self.force}/{self.length}"
        return self.product(1, 2 if axisymmetric else 1)


def check_units(units: Units) -> None:
    """Check that the names in the table [units] can be printed."""
    for field in fields(units):
        text = getattr(units, field.name)
        if text is not None and not (text.isprintable() and text.strip()):
            raise InputError(
                f'[units] {field.name}: must be the name of a unit, such as "mm", not {text!r}'
            )


def in_unit(name: str, unit: str | None) -> str:
    """Return a name with its unit in brackets; the name alone without a unit."""
    return f"{name} ({unit})" if unit else name
