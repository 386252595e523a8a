"""Line plots and zone maps of a record: the counterparts of the paper's Figs. 4 to 10.

Only the record is read; nothing is computed here but fits.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx.interface.contact import Array, State
from receding_fenicsx.interface.cycles import fit_power_law
from receding_fenicsx.interface.zones import zones
from receding_fenicsx.output.limits import limit_without_slip
from receding_fenicsx.output.record import Record
from receding_fenicsx.output.style import (
    COLUMN,
    GUIDE_COLOUR,
    PRESSURE_COLOUR,
    RC,
    SHEAR_COLOUR,
    STATE_COLOURS,
    STATE_INKS,
    STATE_LABELS,
)
from receding_fenicsx.output.zone_map import ZoneMap, zone_map
from receding_fenicsx.scene_file import from_toml

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_RATIO, PAPER_EXPONENT = 0.56, -3.1
"""What the paper states of the steady dissipation and of the slip increments (section 3.2)."""

QUIET = (State.STICK, State.SEPARATION)
"""States without slip."""

LABELLED_ZONE = 0.045
"""Width of a zone, over the width of the axes, from which its number is written into it."""

NARROW_ZONE = 0.02
"""Width of a slip zone, likewise, up to which an arrow points at it."""

FORMATS = ("png", "pdf")


@dataclass(frozen=True)
class Scales:
    """What lengths and loads are divided by, and what the axes say.

    Attributes:
        length: height of the body, 1 where it is not known.
        load: largest load factor.
        pressure: pressure that load factor 1 stands for, 1 where it is not known.
        x_label, load_label, p_label: text of the axes.
    """

    length: float
    load: float
    pressure: float
    x_label: str
    load_label: str
    p_label: str


def scales_of(record: Record) -> Scales:
    """Return the scales of a record's axes, from its scene where it has one."""
    name = record.load_names[0]
    symbol = f"{name[0]}_{{{name[1:]}}}" if len(name) > 1 and name[1:].isdigit() else name
    largest = float(np.abs(record.turning_points.load).max(initial=0.0)) or 1.0
    load_label = rf"${symbol}/{symbol}^{{\max}}$"
    if not record.scene_toml:
        return Scales(1.0, largest, 1.0, "$x$", load_label, f"tractions / ${symbol}$")
    scene = from_toml(record.scene_toml)
    pressure = scene.loads[0].pressure
    known = float(pressure) if isinstance(pressure, float | int) and len(scene.loads) == 1 else 1.0
    return Scales(
        scene.body.height, largest, known, "$x/h$", load_label, rf"$p/{symbol},\ q/{symbol}$"
    )


def plot_all(
    record: Record,
    folder: Path,
    unloading: Record | None = None,
    stepped: Record | None = None,
) -> list[Path]:
    """Draw every figure that the records allow, as PNG and PDF.

    Args:
        record: first loading, and cycles if any.
        folder: where the files go; made if needed.
        unloading: a record of first loading and complete unloading, for Fig. 5.
        stepped: the same history by another method, to be marked in Fig. 10.

    Returns:
        The files made.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    # the PDF writer warns about the dates inside some systems' fonts
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    look: dict[Any, Any] = {**RC, "figure.constrained_layout.use": True}

    def save(name: str, draw: Callable[..., Figure], *arguments: Any) -> None:
        import matplotlib.pyplot as plt

        with mpl.rc_context(look):
            figure = draw(*arguments)
            for suffix in FORMATS:
                made.append(folder / f"{name}.{suffix}")
                figure.savefig(made[-1])
            plt.close(figure)

    table = record.turning_points
    if len(table.s):
        save("fig04_tractions_first_loading", tractions, record, _last_row(record, 0))
    if unloading is not None:
        last = (0, int(unloading.turning_points.leg.max()))
        save("fig05_zones_unloading", zone_maps, unloading, [(*last, "unloading")])
    n_cycles = len(record.cycles.dissipation)
    if n_cycles:
        first_leg = np.flatnonzero((table.cycle == 1) & (table.leg == 0))
        save("fig06_tractions_minimum", tractions, record, int(first_leg[0]))
    kept = sorted(set(record.samples.cycle.tolist()) - {0})
    middle = [c for c in kept if c < n_cycles]
    for cycle, name in ((max(middle, default=0), "fig07"), (n_cycles if kept else 0, "fig09")):
        if cycle:
            legs = np.unique(record.samples.leg[record.samples.cycle == cycle])
            maps = [(cycle, int(leg), _leg_title(record, cycle, int(leg))) for leg in legs]
            save(f"{name}_zones_cycle_{cycle}", zone_maps, record, maps, name == "fig09")
    if n_cycles >= 5 and len(slip_nodes(record)):
        save("fig08_slip_increments", slip_increments, record)
    if n_cycles >= 2:
        save("fig10_dissipation", dissipation, record, stepped)
    if n_cycles:
        save("dissipation_density", dissipation_density, record)
    return made


def _last_row(record: Record, cycle: int) -> int:
    return int(np.flatnonzero(record.turning_points.cycle == cycle)[-1])


def _leg_title(record: Record, cycle: int, leg: int) -> str:
    start, end = leg_ends(record, cycle, leg)
    way = "unloading" if np.abs(end).sum() < np.abs(start).sum() else "loading"
    return f"cycle {cycle}, {way}"


def leg_ends(record: Record, cycle: int, leg: int) -> tuple[Array, Array]:
    """Return the load factors at the start and at the end of a leg."""
    table = record.turning_points
    row = int(np.flatnonzero((table.cycle == cycle) & (table.leg == leg))[0])
    end = table.load[row]
    return (table.load[row - 1] if row else np.zeros_like(end)), end


def tractions(record: Record, row: int) -> Figure:
    """Draw p and q over x with the friction cone and the states (Figs. 4 and 6).

    Args:
        record: the record.
        row: turning point, a row of ``record.turning_points``.
    """
    import matplotlib.pyplot as plt

    table, scale = record.turning_points, scales_of(record)
    # tractions are divided by the instantaneous load; an unloaded contact by the largest one
    load = float(np.abs(table.load[row]).max()) or scale.load
    unit = load * scale.pressure
    x = record.x / scale.length
    p, q = table.p[row] / unit, table.q[row] / unit
    figure, (strip, axes) = plt.subplots(
        2, 1, sharex=True, figsize=(COLUMN, 2.7), height_ratios=(1, 12)
    )
    _state_strip(strip, record, table.state[row], scale)
    axes.fill_between(x, -record.f * p, record.f * p, color=GUIDE_COLOUR, alpha=0.25, lw=0)
    axes.plot(x, p, color=PRESSURE_COLOUR, label="normal traction $p$")
    axes.plot(x, q, color=SHEAR_COLOUR, label="shear traction $q$")
    axes.fill_between([], [], [], color=GUIDE_COLOUR, alpha=0.25, lw=0, label=r"$|q|\leq fp$")
    axes.axhline(0.0, color="black", lw=0.5)
    axes.set(xlabel=scale.x_label, ylabel=scale.p_label, xlim=(x[0], x[-1]))
    # room above the curves for the legend
    axes.set_ylim(1.15 * min(q.min(), 0.0) - 0.02, 1.45 * p.max() + 1e-12)
    axes.legend(loc="upper center", ncols=3, columnspacing=1.0, handlelength=1.4)
    fraction = table.load[row][0] / scale.load
    strip.set_title(f"{scale.load_label} = {fraction:.3g}, cycle {table.cycle[row]}")
    return figure


def _state_strip(axes: Axes, record: Record, state: np.ndarray, scale: Scales) -> None:
    """Draw the states as a band of colours with the paper's numbers."""
    x = record.x / scale.length
    for name, x0, x1 in zones(x, state):
        kind = next(s for s in State if STATE_LABELS[s].endswith(name))
        axes.axvspan(x0, x1, color=STATE_COLOURS[kind], lw=0)
        if x1 - x0 > LABELLED_ZONE * (x[-1] - x[0]):
            axes.text(
                0.5 * (x0 + x1),
                0.45,
                str(int(kind)),
                ha="center",
                va="center",
                transform=axes.get_xaxis_transform(),
                color=STATE_INKS[kind],
            )
    axes.set_yticks([])
    axes.tick_params(bottom=False, top=False)


def zone_maps(
    record: Record, maps: list[tuple[int, int, str]], limit_reached: bool = False
) -> Figure:
    """Draw the zones of some legs in the (x, load) plane (the paper's Figs. 5, 7 and 9).

    Args:
        record: the record.
        maps: cycle, leg and title of each panel.
        limit_reached: mark nodes that reach the friction limit in the cycle without ever slipping.
    """
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure, panels = plt.subplots(
        len(maps), 1, sharex=True, squeeze=False, figsize=(COLUMN, 0.75 + 2.1 * len(maps))
    )
    for axes, (cycle, leg, title) in zip(panels[:, 0], maps, strict=True):
        _draw_zone_map(axes, record, cycle, leg, limit_reached)
        axes.set_title(title)
    handles: list[Any] = [
        Patch(facecolor=STATE_COLOURS[s], edgecolor="black", lw=0.4, label=STATE_LABELS[s])
        for s in State
    ]
    if limit_reached and limit_without_slip(record, maps[0][0]).any():
        handles.append(Line2D([], [], ls=(0, (2, 1.5)), color=SHEAR_COLOUR, label="limit, no slip"))
    panels[-1, 0].set_xlabel(scales_of(record).x_label)
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.5)
    return figure


def _draw_zone_map(axes: Axes, record: Record, cycle: int, leg: int, limit_reached: bool) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    found, scale = zone_map(record, cycle, leg), scales_of(record)
    start, end = (float(load[0]) / scale.load for load in leg_ends(record, cycle, leg))

    def place(points: Array) -> Array:
        return np.stack([points[..., 0] / scale.length, start + (end - start) * points[..., 1]], -1)

    for state in State:
        pieces = [place(polygon) for kind, polygon in found.pieces if kind == state]
        colour = STATE_COLOURS[state]
        axes.add_collection(PolyCollection(pieces, facecolor=colour, edgecolor=colour, lw=0.2))
    lines = found.boundaries
    barely = np.zeros(len(lines), dtype=bool)
    if limit_reached:
        nodes = np.flatnonzero(limit_without_slip(record, cycle))
        reach = record.x[nodes]
        middle = lines[..., 0].mean(axis=1)
        spacing = float(np.diff(record.x).max())
        barely = np.array([np.any(np.abs(reach - x) < spacing) for x in middle], dtype=bool)
    axes.add_collection(LineCollection(list(place(lines[~barely])), colors="black", lw=0.6))
    axes.add_collection(
        LineCollection(list(place(lines[barely])), colors=SHEAR_COLOUR, lw=1.2, ls=(0, (2, 1.5)))
    )
    x = record.x / scale.length
    _number_zones(axes, x, found, start, end)
    axes.set(ylabel=scale.load_label, xlim=(x[0], x[-1]), ylim=sorted((start, end)))


def _number_zones(axes: Axes, x: Array, found: ZoneMap, start: float, end: float) -> None:
    """Write the paper's numbers into the zones, or point at those that are too narrow for one."""
    done: list[tuple[float, float]] = []
    width = x[-1] - x[0]
    for s in (0.5, 0.25, 0.75, 0.12, 0.88):
        level = start + (end - start) * s
        for name, x0, x1 in zones(x, found.states(s)):
            kind = next(state for state in State if STATE_LABELS[state].endswith(f"  {name}"))
            middle = 0.5 * (x0 + x1)
            near = any(abs(middle - c) < 0.12 * width and abs(s - t) < 0.3 for c, t in done)
            if x1 - x0 > LABELLED_ZONE * width and not near:
                ink = STATE_INKS[kind]
                axes.text(middle, level, str(int(kind)), color=ink, ha="center", va="center")
                done.append((middle, s))
            elif s == 0.5 and x1 - x0 <= NARROW_ZONE * width and kind not in QUIET:
                _point_at(axes, middle, level, kind)


def _point_at(axes: Axes, x: float, level: float, kind: State) -> None:
    """Point an arrow from the middle at a zone too narrow for its number."""
    axes.annotate(
        str(int(kind)),
        (x, level),
        (-26 if x > 0 else 26, 0),
        textcoords="offset points",
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "->", "lw": 0.7},
    )


def slip_nodes(record: Record, count: int = 4) -> np.ndarray:
    """Choose nodes on the right whose slip increments can be followed over many cycles."""
    first, last = 4, min(20, len(record.cycles.slip_increment))
    increments = np.abs(record.cycles.slip_increment[first - 1 : last])
    scale = np.abs(record.cycles.slip_increment).max(initial=0.0)
    reach = np.abs(record.x).max()
    moving = np.all(increments > 1e-9 * scale, axis=0) if len(increments) else np.zeros(0, bool)
    nodes = np.flatnonzero(moving & (record.x > 0.25 * reach) & (record.x <= 0.4 * reach))
    if len(nodes) == 0:
        nodes = np.flatnonzero(moving & (record.x > 0.0))
    return (
        nodes[np.unique(np.linspace(0, len(nodes) - 1, count).astype(int))] if len(nodes) else nodes
    )


def slip_increments(record: Record) -> Figure:
    """Draw the slip per cycle over the cycle's number, with its power law (the paper's Fig. 8)."""
    import matplotlib.pyplot as plt

    scale = scales_of(record)
    figure, axes = plt.subplots(figsize=(COLUMN, 2.8))
    increments = np.abs(record.cycles.slip_increment)
    N = np.arange(1, len(increments) + 1)
    fitted = (N >= 4) & (N <= 20)
    slopes = []
    for shade, node in zip(np.linspace(0.0, 0.65, 4), slip_nodes(record), strict=False):
        y = increments[:, node] / scale.length
        seen = y > 1e-12 * y.max()
        axes.loglog(
            N[seen],
            y[seen],
            "o",
            ms=2.5,
            mew=0,
            color=str(shade),
            label=f"{scale.x_label} = {record.x[node] / scale.length:.3g}",
        )
        slopes.append(fit_power_law(N[fitted].astype(float), y[fitted]))
        line = y[3] * (N / 4.0) ** slopes[-1].exponent
        axes.loglog(N[fitted], line[fitted], "-", lw=0.8, color=str(shade))
    mean = float(np.mean([s.exponent for s in slopes]))
    error = float(np.max([s.uncertainty for s in slopes]))
    axes.text(
        0.05,
        0.07,
        rf"fit, $4\leq N\leq 20$: $N^{{{mean:.2f}\pm{error:.2f}}}$"
        + "\n"
        + rf"paper: $N^{{{PAPER_EXPONENT}}}$",
        transform=axes.transAxes,
    )
    axes.set(xlabel="cycle $N$", ylabel=r"slip increment $|\Delta v_i|/h$")
    if scale.x_label == "$x$":
        axes.set_ylabel(r"slip increment $|\Delta v_i|$")
    axes.legend(loc="upper right")
    return figure


def dissipation(record: Record, stepped: Record | None = None) -> Figure:
    """Draw the dissipation per cycle over that of cycle 1 (the paper's Fig. 10)."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(COLUMN, 2.6))
    D = record.cycles.dissipation
    N = np.arange(1, len(D) + 1)
    first = D[0] or 1.0
    axes.semilogx(
        N, D / first, "o-", ms=2.5, lw=0.8, color=PRESSURE_COLOUR, label=_METHODS[record.method]
    )
    if stepped is not None and len(stepped.cycles.dissipation):
        other = stepped.cycles.dissipation
        axes.semilogx(
            np.arange(1, len(other) + 1),
            other / first,
            "x",
            ms=4,
            mew=0.9,
            color=SHEAR_COLOUR,
            label=_METHODS[stepped.method],
        )
    if D[0] > 0.0:
        axes.axhline(D[-1] / first, color=GUIDE_COLOUR, ls="--", lw=0.8)
        axes.text(1.1, D[-1] / first, f"{D[-1] / first:.4f}", va="bottom", color="#444444")
    axes.set(xlabel="cycle $N$", ylabel="dissipation $D_N/D_1$", xlim=(0.9, 1.1 * len(D)))
    axes.legend(loc="upper right")
    return figure


_METHODS = {"events": "exact path", "gauss-seidel": "Gauss–Seidel"}


def dissipation_density(record: Record) -> Figure:
    """Draw where along the contact energy is dissipated, in the first and in the last cycle."""
    import matplotlib.pyplot as plt

    scale = scales_of(record)
    figure, axes = plt.subplots(figsize=(COLUMN, 2.5))
    density, x = record.cycles.dissipation_density, record.x / scale.length
    axes.fill_between(x, density[-1], color=STATE_COLOURS[State.BACKWARD_SLIP], lw=0, alpha=0.8)
    axes.plot(x, density[0], color=PRESSURE_COLOUR, label="cycle 1")
    if len(density) > 1:
        axes.plot(x, density[-1], color=SHEAR_COLOUR, label=f"cycle {len(density)}")
    axes.set(
        xlabel=scale.x_label,
        ylabel="dissipation per cycle and length",
        xlim=(x[0], x[-1]),
        ylim=(0.0, 1.2 * density.max() + 1e-300),
    )
    axes.legend(loc="upper center", ncols=2)
    return figure
