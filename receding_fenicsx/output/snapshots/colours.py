"""Stresses that pictures show, and their colours: colour maps, fringes, contour lines."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MaxNLocator

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.output.snapshots.view import View


@dataclass(frozen=True)
class Quantity:
    """A stress as pictures show it."""

    name: str  # key in :attr:`Fields.stress`
    symbol: str  # its symbol as mathematics
    colours: str = "RdBu_r"  # name of a colour map; if ``signed``, its middle is zero stress
    signed: bool = True  # the sign has a meaning
    fringes: bool = False  # shown as light and dark fringes


QUANTITIES = (
    Quantity("von_mises", r"\sigma_\mathrm{Mises}", "viridis", signed=False),
    Quantity("sxx", r"\sigma_{xx}"),
    Quantity("syy", r"\sigma_{yy}"),
    Quantity("sxy", r"\sigma_{xy}"),
    Quantity("max_shear", r"2\tau_\mathrm{max}", signed=False, fringes=True),
)


def quantity_of(name: str) -> Quantity:
    """Return the stress with this name; raise InputError if it is unknown."""
    known = {quantity.name: quantity for quantity in QUANTITIES}
    if name not in known:
        raise InputError(f"stress '{name}': is unknown; use one of {', '.join(known)}")
    return known[name]


@dataclass(frozen=True)
class Colours:
    """Colours of a field."""

    limits: tuple[float, float]  # values of the first and the last colour
    table: Array  # (k, 3 or 4) colours in [0, 1]
    label: str  # label of the colour bar
    note: str  # stress of one fringe, or ""
    extend: str  # where values lie beyond the limits: "neither", "min", "max" or "both"


def scaled(view: View, quantity: Quantity) -> Array:
    """Return a stress of a view; for fringes 2 tau_max, the difference of principal stresses."""
    return view.stress[quantity.name] * (2.0 if quantity.fringes else 1.0)


def colours_of(
    values: Array, quantity: Quantity, pressure_symbol: str, areas: Array | None = None
) -> tuple[Colours, Array]:
    """Choose the colours and the values of the contour lines (none for fringes) of a field.

    Args:
        values: (n,) field at the vertices.
        quantity: the stress.
        pressure_symbol: symbol of the pressure that it is divided by; "" for none.
        areas: (n,) area of each vertex; equal areas by default.
    """
    # a large body is almost free of stress far from its load: less than 0.02 of the largest does
    # not affect the range, from whose ends half a per cent of the area may lie beyond, as singular
    # points would take most of it
    order = np.argsort(values, kind="stable")
    order = order[np.abs(values[order]) > 0.02 * np.abs(values).max(initial=0.0)]
    low, high = 0.0, 0.0
    if len(order):
        weights = np.ones(len(order)) if areas is None else areas[order]
        below = np.cumsum(weights) - 0.5 * weights
        ends = np.array([0.005, 0.995]) * weights.sum()
        low, high = np.interp(ends, below, values[order]).tolist()
    divided = f"/{pressure_symbol}" if pressure_symbol else ""
    label = f"${quantity.symbol}{divided}$"
    if quantity.fringes:
        fringe = fringe_value(high)
        limits = (0.0, max(float(values.max()), fringe))
        grey = np.cos(np.pi * np.linspace(0.0, limits[1] / fringe, 4096)) ** 2
        note = f"one fringe {fringe:g}" + (rf"$\,{pressure_symbol}$" if pressure_symbol else "")
        return Colours(limits, np.stack([grey] * 3, axis=1), label, note, "neither"), np.empty(0)
    # zero is always part of the range
    low, high = min(low, 0.0), max(high, 0.0)
    largest = max(-low, high) or 1.0
    if high - low == 0.0:
        high = largest
    part = np.linspace(low, high, 256) / largest
    table = mpl.colormaps[quantity.colours](0.5 + 0.5 * part if quantity.signed else part)
    beyond = int(values.max() > high) + 2 * int(values.min() < low)
    extend = ("neither", "max", "min", "both")[beyond]
    # about nine contour lines
    levels = np.asarray(MaxNLocator(9).tick_values(low, high))
    return Colours((low, high), table, label, "", extend), levels


def fringe_value(largest: float) -> float:
    """Return a round stress of one fringe, of which at least ten fit the largest value."""
    if largest <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(largest / 10.0))
    return float(
        max(k * power for k in (1.0, 2.0, 5.0) if 10.0 * k * power <= largest * (1 + 1e-9))
    )
