"""Units and axis labels of figures and pictures: those of the scene, or nondimensional ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.moment import Moment
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import MIRRORED
from receding_fenicsx.output.plots.load_kinds import LoadKind, kind_of
from receding_fenicsx.output.plots.load_names import (
    is_word,
    load_symbol,
    load_text,
    peak,
    shown_name,
)
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.units import Units, in_unit

NO_UNITS = Units()
SYMMETRY_TOLERANCE = 1e-9
"""Distance of a node from its mirror image, over the contact's length."""
LARGEST_PLAIN_POWER = 5
"""Largest power of ten of a number that is written without it."""


@dataclass(frozen=True)
class Conjugate:
    """The work-conjugate quantity of a load in figures.

    Attributes:
        unit: what the load displacement U is divided by.
        symbol, behind, bracket: its symbol, the suffix of that, and its unit in brackets.
        name: what it is.
        upright: whether it is a force, or the work over a prescribed displacement; its axis is then
            the vertical one.
    """

    unit: float
    symbol: str
    behind: str
    bracket: str
    name: str
    upright: bool


@dataclass(frozen=True)
class Scales:
    """Units of the figures of a record.

    Attributes:
        length, length_symbol: unit of length; height "h" of a rectangle, or 1 and "".
        pressure: pressure of the only load at factor 1; 1 if there is none.
        pressure_symbol: its symbol; "" if tractions are not divided by it.
        load_max: (n_loads,) largest absolute factor of each load over the history, or 1.
        young: Young's modulus; 0 if unknown.
        symmetric: whether all states are mirror-symmetric about x = 0.
        axisymmetric: whether forces and work are those of the full circle.
        radial: whether positions are radii.
        begins_on_axis: whether the contact edge begins on the axis r = 0.
        units: units of the scene; with a unit of length (or stress) no length (or stress) is
            nondimensional.
        kinds: kind of each load.
    """

    length: float
    length_symbol: str
    pressure: float
    pressure_symbol: str
    load_max: Array
    young: float
    symmetric: bool
    axisymmetric: bool = False
    radial: bool = False
    begins_on_axis: bool = False
    units: Units = NO_UNITS
    kinds: tuple[LoadKind, ...] = ()

    @property
    def x_label(self) -> str:
        """Label of the axis along the contact edge."""
        return position_label(self.length_symbol, self.radial, self.units)

    def position(self, x: float, digits: str) -> str:
        """Return "x/h = 0.5", or "x = 5 mm", of a position over the length scale."""
        symbol = position_label(self.length_symbol, self.radial)
        unit = shown_unit(self.units.length)
        return f"{symbol[:-1]} = {x:z{digits}}$" + (f" {unit}" if unit else "")

    def with_unit(self, label: str, divided: str, stress: int = 0, length: int = 0) -> str:
        """Return a label with the unit stress^a length^b, if it is divided by nothing."""
        return label if divided else in_unit(label, shown_unit(self.units.product(stress, length)))

    def ends(self, x: Array) -> tuple[float, float]:
        """Range of positions x that figures show, over the length scale."""
        first = 0.0 if self.begins_on_axis else float(x[0])
        return first / self.length, float(x[-1]) / self.length

    def traction_unit(self, moment: Moment) -> float:
        """Return the unit of tractions at an instant: the pressure acting then, or 1."""
        if not self.pressure_symbol:
            return 1.0
        return abs(next(iter(moment.load.values()))) * self.pressure or 1.0

    def peak_traction(self) -> tuple[float, str]:
        """Return the unit of tractions of several instants, and the suffix of their symbols."""
        if not self.pressure_symbol:
            return 1.0, ""
        return self.pressure * float(self.load_max[0]), f"/{self._peak()}"

    def traction_labels(self) -> tuple[str, str, str]:
        """Return the labels of normal traction, tangential traction and friction limit."""
        divided = f"/{self.pressure_symbol}" if self.pressure_symbol else ""
        return f"$p{divided}$", f"$q{divided}$", rf"$\pm f p{divided}$"

    def load_axis(self, k: int, name: str) -> tuple[float, str]:
        """Return what a load factor is divided by on an axis, and the label of this axis.

        It is the load in the scene's units, or the load over its largest value.
        """
        unit = self.load_unit(k)
        if unit:
            return 1.0 / self.kinds[k].size, in_unit(load_text(name), unit)
        symbol = load_symbol(name)
        label = f"{shown_name(name)} / largest" if is_word(name) else f"${symbol}/{peak(symbol)}$"
        return float(self.load_max[k]), label

    def load_unit(self, k: int) -> str:
        """Return the unit of a load; "" if it is not known or the load is a factor."""
        return self._unit_of(self.kinds[k].unit) if self.kinds else ""

    def conjugate(self, k: int, prescribed: bool) -> Conjugate:
        """Return the work-conjugate quantity of a load, which may be a prescribed displacement."""
        if not self.kinds:
            name = "work over load factor" if prescribed else "work-conjugate displacement"
            return Conjugate(1.0, "U", "", "", name, prescribed)
        kind = self.kinds[k]
        unit, behind = kind.size, ""
        if not prescribed and self.normalised():
            unit, behind = self.load_displacement()
        # a tension of the far field is a prescribed strain; the tension does its work on -U
        tension = prescribed and kind.unit == (1, 0)
        bracket = "" if behind else in_unit("", self._unit_of(kind.conjugate_unit))
        return Conjugate(
            -unit if tension else unit,
            kind.symbol,
            behind,
            bracket,
            kind.conjugate,
            prescribed and not tension,
        )

    def _unit_of(self, powers: tuple[int, int]) -> str:
        if powers == (1, 2 if self.axisymmetric else 1):
            return shown_unit(self.units.of_force(self.axisymmetric))
        return shown_unit(self.units.product(*powers))

    def normalised(self) -> bool:
        """Return whether displacements and energies can be nondimensional."""
        return bool(self.length_symbol and self.pressure_symbol and self.young > 0.0)

    def slip(self) -> tuple[float, str]:
        """Return the unit of displacements, and the suffix of their symbols."""
        if not self.normalised():
            return 1.0, ""
        p = self.pressure * float(self.load_max[0])
        return p * self.length / self.young, rf"\,E/({self._peak()}\,{self.length_symbol})"

    def load_displacement(self) -> tuple[float, str]:
        """Return the unit of load displacements, and the suffix of their symbols.

        Nondimensional ones are conjugate to the pressure, not to the load factor: an area per unit
        thickness, or a volume of the full circle.
        """
        if not self.normalised():
            return 1.0, ""
        unit, _ = self.slip()
        power = 3 if self.axisymmetric else 2
        behind = rf"\,E/({self._peak()}\,{self.length_symbol}^{power})"
        return self.pressure * self.length ** (power - 1) * unit, behind

    def dissipation_density(self) -> tuple[float, str]:
        """Return the unit of energies per contact area, and the suffix of their symbols."""
        if not self.normalised():
            return 1.0, ""
        p = self.pressure * float(self.load_max[0])
        peak = f"({self._peak()})^2"
        return p * p * self.length / self.young, rf"\,E/({peak}\,{self.length_symbol})"

    def _peak(self) -> str:
        return peak(self.pressure_symbol)


def three_digits(value: float) -> str:
    """Write a number in mathematics, with three significant digits."""
    text = f"{value:z.3g}"
    mantissa, _, power = text.partition("e")
    if not power:
        return text
    if 0 < int(power) <= LARGEST_PLAIN_POWER:
        return f"{float(text):.0f}"
    return rf"{mantissa} \times 10^{{{int(power)}}}"


def scales_of(record: Record) -> Scales:
    """Return the units of a record: those of the scene, else its height and pressure."""
    scene = record.scene
    length = length_of(scene)
    pressure, symbol = pressure_of(scene, record.load_names)
    largest = np.abs(record.turning_points.load).max(axis=0, initial=0.0)
    return Scales(
        length=length or 1.0,
        length_symbol="h" if length else "",
        pressure=pressure,
        pressure_symbol=symbol,
        load_max=np.where(largest > 0.0, largest, 1.0),
        young=scene.material_of(scene.body).young if scene is not None else 0.0,
        symmetric=_is_symmetric(record),
        axisymmetric=record.axisymmetric,
        radial=record.radius is not None and np.allclose(record.x, record.radius),
        begins_on_axis=record.begins_on_axis,
        units=scene.units if scene is not None else Units(),
        kinds=tuple(kind_of(scene, name, record.axisymmetric) for name in record.load_names),
    )


def position_label(length_symbol: str, radial: bool, units: Units = NO_UNITS) -> str:
    """Return the label of positions along the contact edge."""
    symbol = "r" if radial else "x"
    if length_symbol:
        return f"${symbol}/{length_symbol}$"
    return in_unit(f"${symbol}$", shown_unit(units.length))


def shown_unit(unit: str | None) -> str:
    """Return a unit as text that Matplotlib does not take for mathematics."""
    return (unit or "").replace("$", r"\$")


def length_of(scene: Scene | None) -> float:
    """Return the height of a rectangular body if it is the natural length; else 0.

    It is not where the scene has a unit of length, where the contact edge is upright, or where two
    rectangles have different heights.
    """
    if scene is None or scene.units.length or not scene.body.is_rectangle:
        return 0.0
    upright = any(contact.edge.endswith(("left", "right")) for contact in scene.contacts)
    heights = {body.height for body in scene.bodies if body.is_rectangle}
    return 0.0 if upright or len(heights) > 1 else scene.body.height


def pressure_of(scene: Scene | None, load_names: tuple[str, ...]) -> tuple[float, str]:
    """Return the pressure of the only load at factor 1 and its symbol.

    Without such a pressure, and in a scene with a unit of stress, they are 1 and "".
    """
    if scene is None or not scene.loads or len(load_names) != 1 or scene.units.stress:
        return 1.0, ""
    value = scene.loads[0].pressure
    # a load may have parts on two bodies
    if any(load.pressure != value for load in scene.loads):
        return 1.0, ""
    if not isinstance(value, float | int) or value <= 0.0:
        return 1.0, ""
    return float(value), load_symbol(load_names[0])


def _is_symmetric(record: Record) -> bool:
    x = record.x
    if not len(x) or np.abs(x + x[::-1]).max() > SYMMETRY_TOLERANCE * np.ptp(x):
        return False
    tables = (record.turning_points.state, record.samples.state)
    return all(np.array_equal(MIRRORED[state][:, ::-1], state) for state in tables)
