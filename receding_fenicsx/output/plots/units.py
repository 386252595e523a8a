"""Nondimensional units and axis labels of figures and pictures."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.moment import Moment
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import MIRRORED
from receding_fenicsx.interface.measures.axis import begins_on_axis
from receding_fenicsx.output.plots.series import first_unloading, is_unloading, leg_ends
from receding_fenicsx.reference.ahn_barber import is_papers_block
from receding_fenicsx.scene.model import Scene

MAX_NAME_LENGTH = 10
"""Largest number of letters of a load's name in a label."""
LETTER_WIDTH = 0.065
"""Mean width in inches of a letter of a title."""
IN_MATHEMATICS = {
    **{letter: f"\\{letter}" for letter in "_%${} "},
    "\\": r"\backslash ",
    "^": r"\wedge ",
    "~": r"\sim ",
    "#": r"\sharp ",
    '"': "''",
    "`": "'",
}
"""Replacements of letters of a name that are commands in Matplotlib's mathematics."""
SYMMETRY_TOLERANCE = 1e-9
"""Distance of a node from its mirror image, over the contact's length."""


@dataclass(frozen=True)
class Scales:
    """Units of the figures of a record.

    Attributes:
        length, length_symbol: unit of length; height "h" of a rectangle, or 1 and "".
        pressure: pressure of the only load at factor 1; 1 if there is none.
        pressure_symbol: its symbol; "" if tractions are not divided by it.
        load_max: (n_loads,) largest absolute factor of each load over the history, or 1.
        young: Young's modulus; 0 if unknown.
        paper: whether block and history are those of the paper.
        symmetric: whether all states are mirror-symmetric about x = 0.
        axisymmetric: whether positions are radii.
    """

    length: float
    length_symbol: str
    pressure: float
    pressure_symbol: str
    load_max: Array
    young: float
    paper: bool
    symmetric: bool
    axisymmetric: bool = False

    @property
    def x_label(self) -> str:
        """Label of the axis along the contact edge."""
        return position_label(self.length_symbol, self.axisymmetric)

    def ends(self, x: Array) -> tuple[float, float]:
        """Range of positions x that figures show, over the length scale."""
        first = 0.0 if self.axisymmetric and begins_on_axis(x) else float(x[0])
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

    def load_label(self, name: str) -> str:
        """Return the label of a load over its largest value."""
        symbol = load_symbol(name)
        return f"{shown_name(name)} / largest" if is_word(name) else f"${symbol}/{peak(symbol)}$"

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


def scales_of(record: Record) -> Scales:
    """Return the units of a record: height and pressure as in the paper where they exist."""
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
        paper=scene is not None and is_papers_block(scene),
        symmetric=_is_symmetric(record),
        axisymmetric=record.axisymmetric,
    )


def position_label(length_symbol: str, axisymmetric: bool) -> str:
    """Return the label of positions along the contact edge."""
    symbol = "r" if axisymmetric else "x"
    return f"${symbol}/{length_symbol}$" if length_symbol else f"${symbol}$"


def length_of(scene: Scene | None) -> float:
    """Return the height of a rectangular body; 0 for other bodies."""
    if scene is None or scene.body.mesh is not None or scene.body.shape != "rectangle":
        return 0.0
    return scene.body.height


def pressure_of(scene: Scene | None, load_names: tuple[str, ...]) -> tuple[float, str]:
    """Return the pressure of the only load at factor 1 and its symbol; 1 and "" without one."""
    if scene is None or len(load_names) != 1:
        return 1.0, ""
    value = scene.loads[0].pressure
    # a load may have parts on two bodies
    if any(load.pressure != value for load in scene.loads):
        return 1.0, ""
    if not isinstance(value, float | int) or value <= 0.0:
        return 1.0, ""
    return float(value), load_symbol(load_names[0])


def is_word(name: str) -> bool:
    """Return whether a load's name is a word, not a symbol."""
    return load_symbol(name).startswith(r"\mathrm")


def shown_name(name: str) -> str:
    """Return a load's name as text; the middle of a long name is left out."""
    return _shortened(name).replace("$", r"\$")


def _shortened(name: str) -> str:
    return name if len(name) <= MAX_NAME_LENGTH else f"{name[:5]}…{name[-4:]}"


def load_symbol(name: str) -> str:
    """Write a load's name as mathematics: "p0" as a letter with an index, a word as a word."""
    found = re.fullmatch(r"([A-Za-z])_?([A-Za-z0-9]*)", name)
    if found and (len(found[2]) == 0 or found[2].isdigit()):
        return found[1] + (f"_{{{found[2]}}}" if found[2] else "")
    word = "".join(IN_MATHEMATICS.get(letter, letter) for letter in _shortened(name))
    return rf"\mathrm{{{word}}}"


def peak(symbol: str) -> str:
    """Return the symbol of the largest value of a load."""
    return rf"{symbol}^{{\,\mathrm{{max}}}}"


def describe_load(record: Record, moment: Moment, scales: Scales) -> str:
    """Describe an instant: its leg and its load factors."""
    way = _way(record, moment.cycle, moment.leg)
    factors = describe_factors(
        record.load_names, np.array(list(moment.load.values())) / scales.load_max
    )
    return f"{way}, {factors}" if len(record.load_names) == 1 else f"{way}\n{factors}"


def describe_factors(names: tuple[str, ...], parts: Array) -> str:
    """Describe load factors as parts of their largest values."""
    symbols = [load_symbol(name) for name in names]
    return ", ".join(
        f"{shown_name(name)} at ${part:z.3g}$ of its largest"
        if is_word(name)
        else f"${symbol} = {number(float(part))}{peak(symbol) if part else ''}$"
        for name, symbol, part in zip(names, symbols, parts, strict=True)
    )


def describe_leg(
    record: Record, cycle: int, leg: int, scales: Scales, inches: float = np.inf
) -> str:
    """Describe a leg; with several loads also the range of each load.

    Args:
        record: the record.
        cycle: cycle of the leg.
        leg: leg within the cycle.
        scales: units.
        inches: width; a longer text is broken between the loads.
    """
    text = _way(record, cycle, leg)
    if len(record.load_names) == 1:
        return text
    begin, end = (load / scales.load_max for load in leg_ends(record, cycle, leg))
    moves = [
        f"{load_text(name)} ${a:z.3g}$ to ${b:z.3g}$"
        for name, a, b in zip(record.load_names, begin, end, strict=True)
        if a != b
    ]
    lines = [f"{text}: " if moves else text]
    for n, move in enumerate(moves):
        piece = move + (", " if n + 1 < len(moves) else "")
        longer = len(_plain(lines[-1] + piece)) * LETTER_WIDTH > inches
        lines = [*lines, piece] if longer else [*lines[:-1], lines[-1] + piece]
    return "\n".join(line.rstrip() for line in lines)


def _plain(text: str) -> str:
    """Return a text without the marks of mathematics."""
    return re.sub(r"\\mathrm|[${}_]", "", text)


def load_text(name: str) -> str:
    """Return a load's name as a text: a symbol as mathematics, a word as it is."""
    return shown_name(name) if is_word(name) else f"${load_symbol(name)}$"


def _way(record: Record, cycle: int, leg: int) -> str:
    table = record.turning_points
    legs = len(np.unique(table.leg[table.cycle == cycle]))
    plain = legs <= 2 and len(record.load_names) == 1
    falls = is_unloading(record, cycle, leg)
    first = falls and (cycle, leg) == first_unloading(record)
    return name_leg(cycle, leg, falls, first, plain)


def name_leg(cycle: int, leg: int, falls: bool, first: bool, plain: bool) -> str:
    """Name a leg: "first loading", "unloading, cycle 9", "cycle 9, leg 3".

    Args:
        cycle: cycle, 0 for the first loading.
        leg: leg within the cycle, from 0.
        falls: whether the sum of the loads falls along the leg.
        first: whether it is the first unloading.
        plain: whether the cycle is unloading and reloading of one load.
    """
    if first:
        return "first unloading"
    if cycle == 0:
        return f"first loading, leg {leg}" if leg else "first loading"
    if not plain:
        return f"cycle {cycle}, leg {leg}"
    return f"{'unloading' if falls else 'reloading'}, cycle {cycle}"


def number(value: float) -> str:
    """Format a factor of a symbol: "" for 1, a fraction for thirds, else three digits."""
    if abs(value + 1.0) < SYMMETRY_TOLERANCE:
        return "-"
    for text, known in (("", 1.0), (r"\frac{1}{3}\,", 1.0 / 3.0), (r"\frac{2}{3}\,", 2.0 / 3.0)):
        if abs(value - known) < SYMMETRY_TOLERANCE:
            return text
    return rf"{value:.3g}\," if value else "0"


def _is_symmetric(record: Record) -> bool:
    x = record.x
    if not len(x) or np.abs(x + x[::-1]).max() > SYMMETRY_TOLERANCE * np.ptp(x):
        return False
    tables = (record.turning_points.state, record.samples.state)
    return all(np.array_equal(MIRRORED[state][:, ::-1], state) for state in tables)
