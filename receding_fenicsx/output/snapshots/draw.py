"""Pictures of the stress field on the deformed body, with the contact's states and tractions.

pyvista draws the field, Matplotlib the page around it: one picture an instant and stress, as wide
as a journal page.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import MaxNLocator

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.bulk.fields import gather_fields, solve_fields
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.collect import Instant
from receding_fenicsx.interface.system import Array
from receding_fenicsx.mpi import on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.figures import save
from receding_fenicsx.output.snapshots import paraview
from receding_fenicsx.output.snapshots.layout import Colours, compose, layout_of
from receding_fenicsx.output.snapshots.render import Picture, find_renderer, renderer
from receding_fenicsx.output.snapshots.view import View, vertex_areas, view_of
from receding_fenicsx.scene.history import from_scene

if TYPE_CHECKING:
    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.two_bodies import Pair

FRINGES = 10
"""Isochromatic fringes between no shear and the largest shear in the plane, at least."""
SHADES = 4096
"""Colours of a bar of fringes."""
OUTLIERS = 0.5
"""Per cent of the area, beside singular points, that the colours need not tell apart."""
UNFELT = 0.02
"""Part of the largest value below which a field counts as nothing."""
CONTOURS = 9
"""Contour lines, about."""


@dataclass(frozen=True)
class Quantity:
    """What is drawn.

    Attributes:
        name: key of the stress.
        symbol: its mathematics.
        colours: name of a colour map; for ``signed`` ones its middle is zero stress.
        signed: both signs have a meaning.
        fringes: drawn as light and dark bands.
    """

    name: str
    symbol: str
    colours: str = "RdBu_r"
    signed: bool = True
    fringes: bool = False


QUANTITIES = (
    Quantity("von_mises", r"\sigma_\mathrm{Mises}", "viridis", signed=False),
    Quantity("sxx", r"\sigma_{xx}"),
    Quantity("syy", r"\sigma_{yy}"),
    Quantity("sxy", r"\sigma_{xy}"),
    Quantity("max_shear", r"2\tau_\mathrm{max}", signed=False, fringes=True),
)


IN_EVERY_RUN = tuple(q for q in QUANTITIES if q.name in ("von_mises", "max_shear"))
"""What a run draws without being asked: a picture takes about half a second."""


def quantity_of(name: str) -> Quantity:
    """Return the quantity with this name.

    Raises:
        InputError: there is none.
    """
    found = [quantity for quantity in QUANTITIES if quantity.name == name]
    if not found:
        known = ", ".join(quantity.name for quantity in QUANTITIES)
        raise InputError(f"stress '{name}': is unknown; use one of {known}")
    return found[0]


def snapshot(
    bulk: Bulk | Pair,
    instant: Instant | None,
    folder: Path,
    quantities: tuple[Quantity, ...] = QUANTITIES,
) -> list[Path] | None:
    """Draw the body at one instant; all ranks call this together.

    Args:
        bulk: the body.
        instant: state of the modelled contact nodes; only rank 0's is used.
        folder: folder of the pictures; the fields for ParaView go to ``fields`` beside it.
        quantities: what is drawn, a picture each.

    Returns:
        The files made, on rank 0; None elsewhere.

    Raises:
        RecedingError: nothing can be drawn off-screen on this machine.
    """
    comm, folder = bulk.comm, Path(folder)
    beside = folder.parent / "fields"

    def prepare() -> None:
        find_renderer()
        for place in (folder, beside):
            make_folder(place)

    on_root(comm, prepare)
    now: Instant = comm.bcast(instant)
    name = f"cycle{now.cycle:04d}_leg{now.leg}_s{now.s:.3f}"
    xdmf = beside / f"{name}.xdmf"
    parts = solve_fields(bulk, now.load, np.concatenate([now.v, now.state.w]))
    files = paraview.write_fields(parts, xdmf)
    fields = gather_fields(parts)

    def draw() -> list[Path]:
        assert fields is not None
        history = from_scene(bulk.scene)
        legs = len(history.path if now.cycle == 0 else history.loop) - 1
        for file in files:
            paraview.join_fields(file, paraview.time_of(now.cycle, now.leg, now.s, legs))
        paraview.join_instants(beside)
        view = view_of(bulk, fields, now)
        made = [folder / f"{name}_{quantity.name}.png" for quantity in quantities]
        for quantity, path in zip(quantities, made, strict=True):
            draw_view(view, quantity, path)
        return [*made, *files]

    return on_root(comm, draw)


def draw_view(view: View, quantity: Quantity, path: Path) -> None:
    """Draw one stress of a view into a file.

    Raises:
        RecedingError: nothing can be drawn off-screen on this machine.
    """
    values = scaled(view, quantity)
    with mpl.rc_context(style.RC):
        layout = layout_of(view)
        shown = layout.shows(view.moved)
        colours, levels = colours_of(
            values[shown], quantity, view.pressure_symbol, vertex_areas(view)[shown]
        )
        picture = Picture(
            points=view.moved,
            cells=view.cells,
            values=values,
            limits=colours.limits,
            colours=colours.table,
            levels=levels,
            window=layout.window,
            size=layout.pixels,
        )
        save(compose(view, layout, renderer.draw(picture), colours), path)


def scaled(view: View, quantity: Quantity) -> Array:
    """Return what is drawn of a view: for fringes twice the largest shear, which light counts."""
    return view.stress[quantity.name] * (2.0 if quantity.fringes else 1.0)


def colours_of(
    values: Array, quantity: Quantity, pressure_symbol: str, areas: Array | None = None
) -> tuple[Colours, Array]:
    """Choose the colours of a field, and the values of its contour lines.

    Args:
        values: (n,) field at the vertices.
        quantity: what it is.
        pressure_symbol: what it is divided by; "" for nothing.
        areas: (n,) what each vertex counts; all the same when left out.

    Returns:
        The colours, and the contour lines' values, none for fringes.
    """
    # where a large body hardly feels its load there is nothing to tell apart
    felt = np.abs(values) > UNFELT * np.abs(values).max(initial=0.0)
    counts = np.ones(len(values)) if areas is None else areas
    low, high = _quantiles(values[felt], counts[felt], np.array([OUTLIERS, 100.0 - OUTLIERS]) / 100)
    divided = f"/{pressure_symbol}" if pressure_symbol else ""
    label = f"${quantity.symbol}{divided}$"
    if quantity.fringes:
        apart = fringe_value(high)
        limits = (0.0, max(float(values.max()), apart))
        order = np.linspace(0.0, limits[1] / apart, SHADES)
        grey = np.cos(np.pi * order) ** 2
        note = f"one fringe {apart:g}" + (rf"$\,{pressure_symbol}$" if pressure_symbol else "")
        table = np.stack([grey] * 3, axis=1)
        return Colours(limits, table, label, note, "neither"), np.empty(0)
    # what is small beside the rest is not worth a sign of its own
    low, high = min(low, 0.0), max(high, 0.0)
    largest = max(-low, high) or 1.0
    if high - low == 0.0:
        high = largest
    part = np.linspace(low, high, 256) / largest
    table = mpl.colormaps[quantity.colours](0.5 + 0.5 * part if quantity.signed else part)
    above, below = values.max() > high, values.min() < low
    extend = {(0, 0): "neither", (1, 0): "max", (0, 1): "min", (1, 1): "both"}
    colours = Colours((low, high), table, label, "", extend[int(above), int(below)])
    return colours, np.asarray(MaxNLocator(CONTOURS).tick_values(low, high))


def _quantiles(values: Array, counts: Array, parts: Array) -> tuple[float, float]:
    """Values below which two parts of what the values count lie; zeros for no values."""
    if not len(values):
        return 0.0, 0.0
    order = np.argsort(values, kind="stable")
    below = np.cumsum(counts[order]) - 0.5 * counts[order]
    low, high = np.interp(parts * counts.sum(), below, values[order])
    return float(low), float(high)


def fringe_value(largest: float) -> float:
    """A round number that goes into the largest value at least ``FRINGES`` times."""
    if largest <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(largest / FRINGES))
    steps = [step * power for step in (1.0, 2.0, 5.0)]
    return float(max(step for step in steps if step * FRINGES <= largest * (1.0 + 1e-9)))
