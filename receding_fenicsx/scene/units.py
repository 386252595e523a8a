"""Units of a scene, as text for axes and tables."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields

from receding_fenicsx.errors import InputError

MAX_UNIT = 12
"""Largest number of characters of a unit."""
POWERS = {1: "", 2: "²", 3: "³"}


@dataclass(frozen=True)
class Units:
    """Names of the units that the numbers of a scene are in; labels only, nothing is converted.

    Attributes:
        length: unit of lengths, such as "mm".
        stress: unit of stresses, such as "MPa".
        force: unit of forces, such as "N"; default: products of the units of stress and length. In
            the plane "N" and "N/mm" mean the same where the unit of length is "mm".
    """

    length: str | None = None
    stress: str | None = None
    force: str | None = None

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
    """Check the table [units]."""
    for field in fields(units):
        text = getattr(units, field.name)
        if text is None:
            continue
        where = f"[units] {field.name}"
        if not isinstance(text, str) or not text.isprintable() or not text.strip():
            raise InputError(f'{where}: must be the name of a unit, such as "mm", not {text!r}')
        if len(text) > MAX_UNIT:
            raise InputError(f"{where}: must have at most {MAX_UNIT} characters, not {len(text)}")


def in_unit(name: str, unit: str | None) -> str:
    """Return a name with its unit in brackets; the name alone without a unit."""
    return f"{name} ({unit})" if unit else name
