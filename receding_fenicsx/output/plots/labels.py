"""Labels and units of figures and pictures: loads, scales, instants and legs.

Numbers are in the scene's units, or else nondimensional. A load with factor lambda does the work
dW = lambda dU, a prescribed displacement dW = U dlambda; the record holds U. Where the load is one
number F (a force, a stress, a prescribed displacement), figures show F lambda and U / F, so that
the area of a loop is still the work.
"""

from __future__ import annotations

import re
from math import hypot
from typing import NamedTuple

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.moment import Moment
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots.series import first_unloading, is_unloading, leg_ends, phases
from receding_fenicsx.scene.model import FREE, Load, Scene
from receding_fenicsx.scene.options import Units, in_unit

MOST_TOLD = 8
"""Number of loads of which all are named; of more only those that act."""


def is_word(name: str) -> bool:
    """Return whether a load's name is a word, not a symbol."""
    return load_symbol(name).startswith(r"\mathrm")


def shown_name(name: str) -> str:
    """Return a load's name as text; the middle of a name longer than "interference" is left out."""
    short = name if len(name) <= 12 else f"{name[:5]}…{name[-4:]}"
    return short.replace("$", r"\$")


def load_symbol(name: str) -> str:
    """Write a load's name as mathematics: "p0" as a letter with an index, a word as a word."""
    found = re.fullmatch(r"([A-Za-z])_?([A-Za-z0-9]*)", name)
    if found and (len(found[2]) == 0 or found[2].isdigit()):
        return found[1] + (f"_{{{found[2]}}}" if found[2] else "")
    # letters that are commands in Matplotlib's mathematics
    commands: dict[str, str | int | None] = {letter: f"\\{letter}" for letter in "_%${} "}
    commands |= {"\\": r"\backslash ", "^": r"\wedge ", "~": r"\sim ", "#": r"\sharp "}
    commands |= {'"': "''", "`": "'"}
    word = shown_name(name).replace(r"\$", "$").translate(str.maketrans(commands))
    return rf"\mathrm{{{word}}}"


def load_text(name: str) -> str:
    """Return a load's name as a text: a symbol as mathematics, a word as it is."""
    return shown_name(name) if is_word(name) else f"${load_symbol(name)}$"


def peak(symbol: str) -> str:
    """Return the symbol of the largest value of a load."""
    return rf"{symbol}^{{\,\mathrm{{max}}}}"


class LoadKind(NamedTuple):
    """What a load is."""

    size: float  # the load at factor 1; 1 if it is no single number
    unit: tuple[int, int]  # powers of stress and length in its unit; (0, 0) for a load factor
    conjugate: str  # name of the work-conjugate quantity U / size
    conjugate_unit: tuple[int, int]  # powers of stress and length in the unit of that
    symbol: str  # symbol of the conjugate quantity


def kind_of(scene: Scene | None, name: str, axisymmetric: bool) -> LoadKind:
    """Return the kind of a load; forces and work are those of the full circle if axisymmetric."""
    # work is stress times area in the plane, for unit thickness, or stress times volume
    lengths = 3 if axisymmetric else 2
    units = [unit for load in scene.loads for unit in load.units] if scene else []
    parts = [_size_and_kind(unit) for unit in units if unit.name == name]
    size, kind = parts[0] if len({*parts}) == 1 else (0.0, "factor")
    if (len(parts) > 1 and kind in ("force", "displacement")) or size == 0.0:
        size, kind = 1.0, "factor"
    if scene and name in [bolt.name for bolt in scene.bolts]:
        kind = "bolt"
    displaced = "displaced volume" if axisymmetric else "displaced area"
    unit, conjugate, symbol = {
        "force": ((1, lengths - 1), "displacement along the force", r"\delta"),
        "stress": ((1, 0), displaced, r"\delta"),
        "tension": ((1, 0), "area conjugate to the tension", r"\delta"),
        "displacement": ((0, 1), "force on the edge", "F"),
        "bolt": ((0, 1), "force of the bolt", "F"),
        "factor": ((0, 0), "work over load factor", "U"),
    }[kind]
    return LoadKind(size, unit, conjugate, (1 - unit[0], lengths - unit[1]), symbol)


def _size_and_kind(load: Load) -> tuple[float, str]:
    """Return the size of one part of a load and its kind; 0 if it is no single number."""
    if load.tension is not None:
        return float(load.tension), "tension"
    if load.force is not None:
        return hypot(*load.force), "force"
    if load.pressure is not None:
        return (load.pressure if isinstance(load.pressure, float | int) else 0.0), "stress"
    kind = "displacement" if load.traction is None else "stress"
    values = [0.0 if v == FREE else v for v in load.traction or load.displacement or ()]
    numbers = [float(v) for v in values if isinstance(v, float | int)]
    return (hypot(*numbers) if len(numbers) == len(values) else 0.0), kind


class Scales:
    """Units of the figures of a record: those of the scene, else its height and pressure."""

    def __init__(self, record: Record) -> None:
        """Choose them; what the scene has a unit of is never nondimensional."""
        scene, names, length = record.scene, record.load_names, length_of(record.scene)
        self.record, self.length, self.length_symbol = record, length or 1.0, "h" if length else ""
        # pressure of the only load at factor 1, and its symbol; "": tractions are not divided by it
        self.pressure, symbol = pressure_of(scene, names)
        self.pressure_symbol, self.divided = symbol, f"/{symbol}" if symbol else ""
        largest = np.abs(record.turning_points.load).max(axis=0, initial=0.0)
        self.load_max = np.where(largest > 0.0, largest, 1.0)  # (n_loads,)
        self.young = scene.material_of(scene.body).young if scene is not None else 0.0
        self.axisymmetric = record.axisymmetric  # forces and work are those of the full circle
        # whether positions are radii
        self.radial = record.radius is not None and np.allclose(record.x, record.radius)
        self.units = scene.units if scene is not None else Units()
        self.nondimensional = bool(length and self.pressure_symbol)
        self.kinds = [kind_of(scene, name, record.axisymmetric) for name in names]

    @property
    def x_label(self) -> str:
        """Label of the axis along the contact edge."""
        return position_label(self.length_symbol, self.radial, self.units)

    def position(self, x: float, digits: str) -> str:
        """Return "x/h = 0.5", or "x = 5 mm", of a position over the length scale."""
        symbol = position_label(self.length_symbol, self.radial, Units())
        return f"{symbol[:-1]} = {x:z{digits}}$ {shown_unit(self.units.length)}".rstrip()

    def with_unit(self, label: str, divided: str, stress: int = 0, length: int = 0) -> str:
        """Return a label with the unit stress^a length^b, if it is divided by nothing."""
        return label if divided else in_unit(label, shown_unit(self.units.product(stress, length)))

    @property
    def ends(self) -> tuple[float, float]:
        """Range of positions x that figures show, over the length scale."""
        first = 0.0 if self.record.begins_on_axis else float(self.record.x[0])
        return first / self.length, float(self.record.x[-1]) / self.length

    def peak_traction(self, symbol: str) -> tuple[float, str]:
        """Return the unit of a traction at several instants, and its label."""
        if not self.pressure_symbol:
            return 1.0, self.with_unit(f"${symbol}$", "", stress=1)
        label = f"${symbol}/{peak(self.pressure_symbol)}$"
        return self.pressure * float(self.load_max[0]), label

    def load_axis(self, k: int, name: str) -> tuple[float, str]:
        """Return what a load factor is divided by on an axis, and the label of the axis."""
        if unit := self.load_unit(k):
            return 1.0 / self.kinds[k].size, in_unit(load_text(name), unit)
        symbol = load_symbol(name)
        label = f"{shown_name(name)} / largest" if is_word(name) else f"${symbol}/{peak(symbol)}$"
        return float(self.load_max[k]), label

    def load_unit(self, k: int) -> str:
        """Return the unit of a load; "" if it is not known or the load is a factor."""
        return self._unit_of(self.kinds[k].unit)

    def conjugate(self, k: int, prescribed: bool) -> tuple[float, str, bool]:
        """Return unit and end of the label of what is conjugate to a load, and if it is upright."""
        kind = self.kinds[k]
        unit, behind = kind.size, in_unit("$", self._unit_of(kind.conjugate_unit))
        if self.nondimensional:
            # conjugate to the pressure, not to its factor: an area, or the volume of a circle
            unit, label = self.elastic("", 1, 3 if self.axisymmetric else 2)
            unit, behind = unit * self.pressure, label[1:]
        # a tension of the far field is a prescribed strain; the tension does its work on -U
        tension = prescribed and kind.unit == (1, 0)
        return (-unit, behind, False) if tension else (unit, behind, prescribed)

    def _unit_of(self, powers: tuple[int, int]) -> str:
        if powers == (1, 2 if self.axisymmetric else 1):
            return shown_unit(self.units.of_force(self.axisymmetric))
        return shown_unit(self.units.product(*powers))

    def elastic(self, symbol: str, pressures: int, lengths: int) -> tuple[float, str]:
        """Return the unit p^a h^b / E of a quantity, p the largest pressure, and its label.

        It is that of the scene where h, p or E is not known.
        """
        if not self.nondimensional:
            return 1.0, self.with_unit(f"${symbol}$", "", pressures - 1, lengths)
        p, top = self.pressure * float(self.load_max[0]), peak(self.pressure_symbol)
        top = top if pressures == 1 else f"({top})^{pressures}"
        height = self.length_symbol + (f"^{lengths}" if lengths > 1 else "")
        unit = p**pressures * self.length**lengths / self.young
        return unit, rf"${symbol}\,E/({top}\,{height})$"


def position_label(length_symbol: str, radial: bool, units: Units) -> str:
    """Return the label of positions along the contact edge."""
    symbol = "r" if radial else "x"
    if length_symbol:
        return f"${symbol}/{length_symbol}$"
    return in_unit(f"${symbol}$", shown_unit(units.length))


def shown_unit(unit: str | None) -> str:
    """Return a unit as text that Matplotlib does not take for mathematics."""
    return (unit or "").replace("$", r"\$")


def length_of(scene: Scene | None) -> float:
    """Return the height of rectangles of one height on level edges; 0 with a unit of length."""
    if scene is None or scene.units.length or not scene.body.is_rectangle:
        return 0.0
    upright = any(contact.edge.endswith(("left", "right")) for contact in scene.contacts)
    heights = {body.height for body in scene.bodies if body.is_rectangle}
    return 0.0 if upright or len(heights) > 1 else scene.body.height


def pressure_of(scene: Scene | None, load_names: tuple[str, ...]) -> tuple[float, str]:
    """Return the pressure of the only load and its symbol; without it, or with units, 1 and ""."""
    if scene is None or not scene.loads or len(load_names) != 1 or scene.units.stress:
        return 1.0, ""
    value = scene.loads[0].pressure
    # a load may have parts on two bodies
    same = all(load.pressure == value for load in scene.loads)
    if not same or not isinstance(value, float | int) or value <= 0.0:
        return 1.0, ""
    return float(value), load_symbol(load_names[0])


def load_pieces(moment: Moment, scales: Scales) -> tuple[str, list[str]]:
    """Return the name of the leg of an instant, and a text for each load there."""
    found, names, record = [], tuple(moment.load), scales.record
    for k in told_loads(record.scene, names, np.array([*moment.load.values()])):
        part = moment.load[names[k]] / scales.load_axis(k, names[k])[0]
        if unit := scales.load_unit(k):
            found.append(f"{load_text(names[k])} ${three_digits(part)}$ {unit}")
        else:
            found.append(describe_factor(names[k], part))
    return _place(record, moment.cycle, moment.leg, moment.s), found


def told_loads(scene: Scene | None, names: tuple[str, ...], load: Array) -> list[int]:
    """Return the numbers of the loads that describe an instant: no preloads once applied."""
    whole = {} if scene is None else scene.preloads
    told = [k for k, name in enumerate(names) if name not in whole or load[k] != whole[name]]
    told = [k for k in told if load[k] or len(names) <= MOST_TOLD]
    return told or list(range(len(names)))


def leg_pieces(cycle: int, leg: int, scales: Scales) -> list[str]:
    """Return the name of a leg; with several loads also the range of each load that changes."""
    record, moves = scales.record, []
    text, ends = _place(record, cycle, leg, 1.0), leg_ends(record, cycle, leg)
    for k, name in enumerate(record.load_names if len(record.load_names) > 1 else ()):
        one, (begin, end) = scales.load_axis(k, name)[0], (float(end[k]) for end in ends)
        if begin != end:
            first, last = three_digits(begin / one), three_digits(end / one)
            moves.append(f"{load_text(name)} ${first}$ to ${last}$ {scales.load_unit(k)}".rstrip())
    return [f"{text}: {moves[0]}", *moves[1:]] if moves else [text]


def describe_factor(name: str, part: float) -> str:
    """Describe a load factor as a part of its largest value."""
    symbol = load_symbol(name)
    if is_word(name):
        return f"{shown_name(name)} at ${three_digits(part)}$ of its largest"
    if part == 0.0:
        return f"${symbol} = 0$"
    known = {-1.0: "-", 1.0: "", 1.0 / 3.0: r"\frac{1}{3}\,", 2.0 / 3.0: r"\frac{2}{3}\,"}
    near = [text for value, text in known.items() if abs(value - part) < 1e-9]
    times = near[0] if near else rf"{three_digits(part)}\,"
    return f"${symbol} = {times}{peak(symbol)}$"


def _place(record: Record, cycle: int, leg: int, s: float) -> str:
    table = record.turning_points
    legs = len(np.unique(table.leg[table.cycle == cycle]))
    plain = legs <= 2 and len(record.load_names) == 1
    falls = is_unloading(record, cycle, leg)
    first = falls and (cycle, leg) == first_unloading(record)
    angles = phases(record)
    if angles is not None and cycle and not first:
        return rf"cycle {cycle}, phase ${np.interp(leg + s, np.arange(legs + 1), angles):.0f}$°"
    return name_leg(cycle, leg, falls, first, plain)


def name_leg(cycle: int, leg: int, falls: bool, first: bool, plain: bool) -> str:
    """Name a leg: "first loading", "unloading, cycle 9"; not ``plain``: "cycle 9, leg 3"."""
    if first:
        return "first unloading"
    if cycle == 0:
        return f"first loading, leg {leg}" if leg else "first loading"
    if not plain:
        return f"cycle {cycle}, leg {leg}"
    return f"{'unloading' if falls else 'reloading'}, cycle {cycle}"


def three_digits(value: float) -> str:
    """Write a number in mathematics, with three significant digits."""
    text = f"{value:z.3g}"
    mantissa, _, power = text.partition("e")
    if not power:
        return text
    if 0 < int(power) <= 5:
        return f"{float(text):.0f}"
    return rf"{mantissa} \times 10^{{{int(power)}}}"
