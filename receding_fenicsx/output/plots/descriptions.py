"""Titles of instants and legs: where on the load path they are, and their loads."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.moment import Moment
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.load_names import (
    is_word,
    load_symbol,
    load_text,
    peak,
    shown_name,
)
from receding_fenicsx.output.plots.series import first_unloading, is_unloading, leg_ends, phases
from receding_fenicsx.output.plots.units import Scales, three_digits

SAME_PART = 1e-9
"""Difference of a part of a load from a fraction that is written as such."""


def describe_load(record: Record, moment: Moment, scales: Scales, inches: float = np.inf) -> str:
    """Describe an instant, its leg and its load factors, in lines of a largest width in inches."""
    way = _way(record, moment.cycle, moment.leg, moment.s)
    found = []
    for k, (name, value) in enumerate(moment.load.items()):
        unit, (one, _) = scales.load_unit(k), scales.load_axis(k, name)
        part = np.array([value / scales.load_max[k]])
        own = f"{load_text(name)} ${three_digits(value / one)}$ {unit}"
        found.append(own if unit else describe_factors((name,), part))
    several = len(record.load_names) > 1
    return (
        f"{way}\n{style.wrapped(found, inches)}"
        if several
        else style.wrapped([way, *found], inches)
    )


def describe_factors(names: tuple[str, ...], parts: Array) -> str:
    """Describe load factors as parts of their largest values."""
    symbols = [load_symbol(name) for name in names]
    return ", ".join(
        f"{shown_name(name)} at ${three_digits(part)}$ of its largest"
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
    text = _way(record, cycle, leg, 1.0)
    if len(record.load_names) == 1:
        return text
    begin, end = leg_ends(record, cycle, leg)
    moves = []
    for k, name in enumerate(record.load_names):
        unit = scales.load_unit(k)
        one = scales.load_axis(k, name)[0] if unit else scales.load_max[k]
        if begin[k] != end[k]:
            first, last = (three_digits(factor[k] / one) for factor in (begin, end))
            move = f"{load_text(name)} ${first}$ to ${last}$ {unit}"
            moves.append(move.rstrip())
    return style.wrapped([f"{text}: {moves[0]}", *moves[1:]] if moves else [text], inches)


def _way(record: Record, cycle: int, leg: int, s: float) -> str:
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
    if abs(value + 1.0) < SAME_PART:
        return "-"
    for text, known in (("", 1.0), (r"\frac{1}{3}\,", 1.0 / 3.0), (r"\frac{2}{3}\,", 2.0 / 3.0)):
        if abs(value - known) < SAME_PART:
            return text
    return rf"{three_digits(value)}\," if value else "0"
