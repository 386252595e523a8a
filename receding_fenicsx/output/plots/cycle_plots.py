"""Figures of cycles: slip, dissipation and its density; loops of loads; paths of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import series, style
from receding_fenicsx.output.plots.labels import MOST_TOLD, Scales, is_word, load_symbol, scales_of
from receding_fenicsx.output.plots.series import Loop


@mpl.rc_context(style.RC)
def slip_per_cycle(record: Record, scales: Scales | None = None) -> Figure:
    """Draw the slip increment of each cycle at some nodes, with fitted powers of N."""
    scales = scales or scales_of(record)
    unit, behind = scales.elastic(1, 1)
    lines = series.slip_lines(record, scales.length, unit)
    if not lines:
        raise InputError("slip per cycle: no node slips in enough cycles; run more cycles")
    fitted = series.fitted_cycles(record).astype(float)
    figure = style.new_figure(style.COLUMN, 3.6)
    axes = figure.subplots()
    for line, colour in zip(lines, style.SERIES_COLOURS, strict=False):
        label = f"{scales.position(line.x, '.2f')}:  $N^{{{line.fit.exponent:.2f}}}$"
        axes.loglog(line.N, line.slip, "o", color=colour, ms=2.4, label=label)
        axes.loglog(fitted, line.factor * fitted**line.fit.exponent, color=colour, lw=0.8)
    axes.set_xlabel("cycle $N$")
    # a word for the pressure needs its own line
    between = "\n" if scales.pressure_symbol.startswith(r"\mathrm") else " "
    symbol = scales.with_unit(rf"$|\Delta v_i|{behind}$", behind, length=1)
    axes.set_ylabel(f"slip gained in a cycle,{between}{symbol}")
    title = f"fitted over {fitted[0]:.0f} ≤ $N$ ≤ {fitted[-1]:.0f}"
    figure.legend(loc="outside lower center", ncols=2, title=title, title_fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def dissipation_per_cycle(
    record: Record, scales: Scales | None = None, stepped: Record | None = None
) -> Figure:
    """Draw the dissipation of each cycle over that of the first; also that of another method."""
    names = {"events": "exact events", "gauss-seidel": "Gauss-Seidel"}
    figure = style.new_figure(style.COLUMN, 2.4)
    axes = figure.subplots()
    ratio = record.cycles.dissipation / record.cycles.dissipation[0]
    N = np.arange(1, len(ratio) + 1)
    label, colours = names.get(record.method, record.method), style.SERIES_COLOURS
    axes.plot(N, ratio, "o-", color=colours[0], ms=2.4, lw=0.8, label=label)
    if stepped is not None and len(stepped.cycles.dissipation):
        other = stepped.cycles.dissipation / stepped.cycles.dissipation[0]
        label, count = names.get(stepped.method, stepped.method), np.arange(1, len(other) + 1)
        axes.plot(count, other, "s", mfc="none", mec=colours[1], ms=4.5, mew=0.7, label=label)
        axes.legend(loc="upper right")
    look: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8.0, "ha": "right"}
    axes.annotate(f"{ratio[-1]:.4f}", (float(N[-1]), ratio[-1]), xytext=(-4, 5), **look)
    axes.set(xlabel="cycle $N$", ylabel="dissipation, $D_N/D_1$")
    axes.set_ylim(0.0, 1.1 * float(ratio.max()))
    # largest number of cycles on a linear axis; more are on a logarithmic one
    if len(ratio) > 40:
        axes.set_xscale("log")
        axes.set_xlim(0.9, 1.15 * len(ratio))
        axes.xaxis.set_major_formatter(ScalarFormatter())
    else:
        axes.set_xlim(0.0, 1.03 * len(ratio) + 0.5)
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    return figure


@mpl.rc_context(style.RC)
def dissipation_density(record: Record, scales: Scales | None = None) -> Figure:
    """Draw the dissipation per contact area in the first and the last cycle."""
    scales = scales or scales_of(record)
    unit, behind = scales.elastic(2, 1)
    density, used = record.cycles.dissipation_density / unit, record.weight > 0.0
    figure = style.new_figure(style.COLUMN, 2.4)
    axes = figure.subplots()
    rows = sorted({0, len(density) - 1})
    # the first cycle is wider, to be seen where the last one lies on it
    widths = (2.4, 0.9)[-len(rows) :]
    for row, colour, width in zip(rows, style.SERIES_COLOURS, widths, strict=False):
        x, label = record.x[used] / scales.length, f"cycle {row + 1}"
        axes.plot(x, density[row][used], color=colour, lw=width, label=label)
    axes.set_xlim(*scales.ends(record.x))
    axes.set_ylim(0.0, None)
    axes.ticklabel_format(axis="y", scilimits=(-2, 3), useMathText=True)
    symbol = scales.with_unit(f"$d{behind}$", behind, stress=1, length=1)
    axes.set(xlabel=scales.x_label, ylabel=f"dissipation density\n{symbol}")
    figure.legend(loc="outside upper center", ncols=len(rows))
    return figure


ROUND_OFF = 1e-9
"""Part of the largest position, displacement or traction below which a value is round-off."""


@mpl.rc_context(style.RC)
def hysteresis(
    record: Record, cycles: int | Sequence[int] | None = None, scales: Scales | None = None
) -> Figure:
    """Draw each load against its work-conjugate quantity; the areas of the loops are work.

    Forces and stresses are drawn upwards, displacements along, also where they are prescribed.
    There is a row for each load that changes in the cycles, by default first loading, first and
    last cycle. Right of each loop is its difference from the chord, the straight line between the
    extreme loads of the last loop.
    """
    scales, paths = scales or scales_of(record), _paths(record, cycles)
    moves = moving_loads(paths)
    if not moves:
        raise InputError(
            f"hysteresis: no load or more than {MOST_TOLD} change, or the record has no load "
            "displacements"
        )
    height = 1.95  # inches of a row of loops
    figure = style.new_figure(style.PAGE, 0.75 + height * len(moves))
    panels = figure.subplots(len(moves), 2, squeeze=False)
    for n, (k, row) in enumerate(zip(moves, panels, strict=True)):
        name = record.load_names[k]
        other = scales.conjugate(k, prescribed=bool(record.load_sign[k] > 0.0))
        delta = other.symbol if is_word(name) else rf"{other.symbol}_{{{load_symbol(name)}}}"
        largest, load_label = scales.load_axis(k, name)
        # displacement per load between the extreme loads of the last loop, and at zero load
        last, moved = paths[-1].load[:, k], paths[-1].displacement[:, k]
        low, high = np.argmin(last), np.argmax(last)
        run = float(last[high] - last[low])
        slope = float(moved[high] - moved[low]) / run if run else 0.0
        offset = float(moved[high] - slope * last[high]) / other.unit
        most = max(float(np.abs(path.displacement[:, k]).max()) for path in paths)
        for path in paths:
            load, size = path.load[:, k] / largest, path.displacement[:, k] / other.unit
            bend = (path.displacement[:, k] - slope * path.load[:, k]) / other.unit - offset
            bend = _without_round_off(bend, most / abs(other.unit))
            # first loading is not a loop and lies far from the chord
            shown = (size, bend) if path.cycle or len(paths) == 1 else (size,)
            for axes, conjugate in zip(row, shown, strict=False):
                x, y = (load, conjugate) if other.upright else (conjugate, load)
                _draw_path(axes, x, y, path, paths)
        notes = (other.name, "less the chord of the last loop")
        labels = (delta, rf"({delta} - \mathrm{{chord}})")
        for m, (axes, symbol, note) in enumerate(zip(row, labels, notes, strict=True)):
            own = f"${symbol}{other.behind}${other.bracket}"
            along, up = (load_label, own) if other.upright else (own, load_label)
            axes.set(xlabel=along, ylabel=style.wrapped([up], height))
            axis: Literal["x", "y"] = "y" if other.upright else "x"
            axes.ticklabel_format(axis=axis, scilimits=(-2, 3), useMathText=True)
            style.ticks(axes.xaxis, 5)
            panel = style.panel_title(2 * n + m, 2 * len(moves), note)
            axes.set_title(panel, loc="left", pad=4.0)
    figure.legend(handles=_cycle_handles(paths), loc="outside lower center", ncols=len(paths))
    return figure


@mpl.rc_context(style.RC)
def trajectories(
    record: Record,
    nodes: int | Sequence[int] | None = None,
    cycles: int | Sequence[int] | None = None,
    scales: Scales | None = None,
) -> Figure:
    """Draw paths of nodes in the planes of tractions (q, p) and displacements (v, w).

    Above is (q, p) with the friction cone |q| <= f p, below (v, w) with the plane w = -g0; dots are
    turning points. Each node has a column; by default there are representative nodes, and first
    loading, first and last cycle.
    """
    scales, paths = scales or scales_of(record), _paths(record, cycles)
    if nodes is None:
        chosen = series.representative_nodes(record)
        if not chosen:
            raise InputError("trajectories: no node touches in the sampled cycles; give nodes")
    else:
        chosen = series.whole_numbers(nodes, "node")
        if not chosen or not 0 <= min(chosen) <= max(chosen) < len(record.x):
            raise InputError(f"nodes {chosen}: name some of 0 to {len(record.x) - 1}")
    columns = len(chosen)
    figure = style.new_figure(max(style.COLUMN, 0.3 + 1.8 * columns), 4.3)
    panels = figure.subplots(2, columns, squeeze=False)
    # one range of w for all nodes
    unit, slip = scales.elastic(1, 1)
    low, high = (f([f(path.w[:, chosen]) for path in paths]) / unit for f in (np.min, np.max))
    room = 0.1 * (high - low) or 1.0
    for n, i in enumerate(chosen):
        above, below = panels[:, n]
        _draw_traction_path(above, record, paths, i, scales)
        _draw_displacement_path(below, record, paths, i, scales)
        below.set_ylim(low - room, high + room)
        below.tick_params(labelleft=n == 0)
        x = _without_round_off(record.x[i], float(np.abs(record.x).max()))
        where = scales.position(float(x) / scales.length, ".3g")
        above.set_title(style.panel_title(n, columns, where))
        for axes in (above, below):
            style.ticks(axes.xaxis, 3)
            style.ticks(axes.yaxis, 5)
            axes.ticklabel_format(scilimits=(-3, 4), useMathText=True)
    traction = scales.peak_traction()[1]
    panels[0, 0].set_ylabel(scales.with_unit(f"$p{traction}$", traction, stress=1))
    panels[1, 0].set_ylabel(scales.with_unit(f"$w{slip}$", slip, length=1))
    handles: list[Any] = _cycle_handles(paths)
    if np.any(record.friction.present[chosen]):
        cone = r"$|q| \leq f p$"
        if not record.friction.is_cone:
            cone = r"$|q| \leq \min(f p + c, t)$"
        elif record.f_backward is not None:
            cone = r"$-f_\mathrm{forward} p \leq q \leq f_\mathrm{backward} p$"
        handles.append(Patch(label=f"friction cone, {cone}", **style.CONE))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_traction_path(
    axes: Axes, record: Record, paths: Sequence[Loop], node: int, scales: Scales
) -> None:
    """Draw p against q of a node, with its friction cone up to the top of the axes."""
    unit, divided = scales.peak_traction()
    largest = float(np.abs([path.p.max() for path in paths]).max())
    for path in paths:
        q = _without_round_off(path.q[:, node], largest)
        _draw_path(axes, q / unit, path.p[:, node] / unit, path, paths)
    top = 1.05 * max(float(path.p[:, node].max()) for path in paths) / unit or 1.0
    left, right = axes.get_xlim()
    law = record.traction_law(unit)[node]
    low, high = (float(limit) for limit in law.limits(np.asarray(top)))
    reach = 1.15 * max(abs(left), abs(right), -low, high) or 1.0
    if law.is_cone:
        axes.fill_between([low, 0.0, high], [top, 0.0, top], top, zorder=0, **style.CONE)
    else:
        p = np.linspace(0.0, top, 200)
        axes.fill_betweenx(p, *law.limits(p), zorder=0, **style.CONE)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-0.04 * top, top)
    axes.set_xlabel(scales.with_unit(f"$q{divided}$", divided, stress=1))


def _draw_displacement_path(
    axes: Axes, record: Record, paths: Sequence[Loop], node: int, scales: Scales
) -> None:
    """Draw w against v of a node, with the plane w = -g0 if the node separates from it."""
    unit, divided = scales.elastic(1, 1)
    for path in paths:
        _draw_path(axes, path.v[:, node] / unit, path.w[:, node] / unit, path, paths)
    if np.any(paths[-1].w[:, node] > -record.g0[node]):
        axes.axhline(-float(record.g0[node]) / unit, **style.GUIDE)
    largest = max(float(np.abs(path.v).max()) for path in paths) / unit or 1.0
    left, right = axes.get_xlim()
    if right - left < ROUND_OFF * largest:
        # the node does not move
        axes.set_xlim(-0.5 * largest, 0.5 * largest)
    axes.set_xlabel(scales.with_unit(f"$v{divided}$", divided, length=1))


def _without_round_off(values: Array, largest: float) -> Array:
    """Return values with 0 in place of round-off of the largest."""
    return np.where(np.abs(values) > ROUND_OFF * largest, values, 0.0)


def _paths(record: Record, cycles: int | Sequence[int] | None) -> list[Loop]:
    requested = series.requested_cycles(record, cycles) if cycles is not None else None
    return [series.loop_of(record, cycle) for cycle in requested or series.shown_cycles(record)]


def moving_loads(paths: Sequence[Loop]) -> list[int]:
    """Return the loads that change within the paths and have known displacements.

    None of more than ``MOST_TOLD``, such as the unit loads of one that travels.
    """
    loops = [path for path in paths if path.cycle] or paths
    found = [
        k
        for k in range(paths[0].load.shape[1] if paths else 0)
        if any(np.ptp(path.load[:, k]) > 0.0 for path in loops)
        and all(np.all(np.isfinite(path.displacement[:, k])) for path in paths)
    ]
    return found if len(found) <= MOST_TOLD else []


def _draw_path(axes: Axes, x: Array, y: Array, path: Loop, paths: Sequence[Loop]) -> None:
    look = _look(path, paths)
    axes.plot(x, y, **look)
    # largest number of turning points of a cycle that have dots
    if np.count_nonzero(path.turning) <= 40:
        dots = 1.6 + look["lw"]
        axes.plot(x[path.turning], y[path.turning], "o", color=look["color"], ms=dots)


def _cycle_handles(paths: Sequence[Loop]) -> list[Line2D]:
    names = [f"cycle {path.cycle}" if path.cycle else "first loading" for path in paths]
    looks = [_look(path, paths) for path in paths]
    return [Line2D([], [], label=name, **look) for name, look in zip(names, looks, strict=True)]


def _look(path: Loop, paths: Sequence[Loop]) -> dict[str, Any]:
    """Return colour and width of a cycle: earlier ones are wider, to be seen below later ones."""
    if path.cycle == 0:
        return {"color": style.GUIDE_COLOUR, "lw": 1.4}
    numbers = [other.cycle for other in paths if other.cycle]
    place, colours = numbers.index(path.cycle), style.SERIES_COLOURS
    width = 0.8 + min(1.4 * (len(numbers) - 1 - place), 4.2)
    return {"color": colours[place % len(colours)], "lw": width}
