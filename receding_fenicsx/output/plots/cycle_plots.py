"""Figures of cycles: slip, dissipation and its density; loops of loads; paths of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import series, style
from receding_fenicsx.output.plots.labels import MOST_TOLD, Scales, is_word, load_symbol
from receding_fenicsx.output.plots.series import Loop


@mpl.rc_context(style.RC)
def slip_per_cycle(record: Record) -> Figure:
    """Draw the slip increment of each cycle at some nodes, with fitted powers of N."""
    scales = Scales(record)
    unit, symbol = scales.elastic(r"|\Delta v_i|", 1, 1)
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
    axes.set_ylabel(f"slip gained in a cycle,{between}{symbol}")
    title = f"fitted over {fitted[0]:.0f} ≤ $N$ ≤ {fitted[-1]:.0f}"
    figure.legend(loc="outside lower center", ncols=2, title=title, title_fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def dissipation_per_cycle(record: Record, stepped: Record | None = None) -> Figure:
    """Draw the dissipation of each cycle over that of the first; also that of another method."""
    names = {"events": "exact events", "gauss-seidel": "Gauss-Seidel"}
    figure = style.new_figure(style.COLUMN, 2.4)
    axes = figure.subplots()
    blue, orange = style.SERIES_COLOURS[:2]
    looks: list[dict[str, Any]] = [
        {"marker": "o", "color": blue, "ms": 2.4, "lw": 0.8},
        {"marker": "s", "ls": "", "mfc": "none", "mec": orange, "ms": 4.5, "mew": 0.7},
    ]
    for found, look in zip([record, stepped], looks, strict=True):
        if found is not None and len(D := found.cycles.dissipation):
            label = names.get(found.method, found.method)
            axes.plot(np.arange(1, len(D) + 1), D / D[0], label=label, **look)
    if len(axes.lines) > 1:
        axes.legend(loc="upper right")
    ratio = record.cycles.dissipation / record.cycles.dissipation[0]
    look = {"textcoords": "offset points", "fontsize": 8.0, "ha": "right"}
    axes.annotate(f"{ratio[-1]:.4f}", (len(ratio), ratio[-1]), xytext=(-4, 5), **look)
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
def dissipation_density(record: Record) -> Figure:
    """Draw the dissipation per contact area in the first and the last cycle."""
    scales = Scales(record)
    unit, symbol = scales.elastic("d", 2, 1)
    density, used = record.cycles.dissipation_density / unit, record.weight > 0.0
    figure = style.new_figure(style.COLUMN, 2.4)
    axes = figure.subplots()
    rows = sorted({0, len(density) - 1})
    # the first cycle is wider, to be seen where the last one lies on it
    widths = (2.4, 0.9)[-len(rows) :]
    for row, colour, width in zip(rows, style.SERIES_COLOURS, widths, strict=False):
        x, label = record.x[used] / scales.length, f"cycle {row + 1}"
        axes.plot(x, density[row][used], color=colour, lw=width, label=label)
    axes.set_xlim(*scales.ends)
    axes.set_ylim(0.0, None)
    axes.ticklabel_format(axis="y", scilimits=(-2, 3), useMathText=True)
    axes.set(xlabel=scales.x_label, ylabel=f"dissipation density\n{symbol}")
    figure.legend(loc="outside upper center", ncols=len(rows))
    return figure


@mpl.rc_context(style.RC)
def hysteresis(record: Record, cycles: int | Sequence[int] | None = None) -> Figure:
    """Draw each load against its work-conjugate quantity; the areas of the loops are work.

    Forces and stresses are drawn upwards, displacements along. There is a row for each load that
    changes; cycles are by default first loading, first and last cycle. Right of each loop is its
    difference from the chord between the extreme loads of the last loop.
    """
    scales, paths = Scales(record), series.paths_of(record, cycles)
    moves, looks = moving_loads(paths), _looks(paths)
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
        kind, prescribed = scales.kinds[k], bool(record.load_sign[k] > 0.0)
        one, behind, upright = scales.conjugate(k, prescribed)
        delta = kind.symbol if is_word(name) else rf"{kind.symbol}_{{{load_symbol(name)}}}"
        largest, load_label = scales.load_axis(k, name)
        # displacement per load between the extreme loads of the last loop, and at zero load
        last, moved = paths[-1].load[:, k], paths[-1].displacement[:, k]
        low, high = np.argmin(last), np.argmax(last)
        run = float(last[high] - last[low])
        slope = float(moved[high] - moved[low]) / run if run else 0.0
        offset = float(moved[high] - slope * last[high]) / one
        most = max(float(np.abs(path.displacement[:, k]).max()) for path in paths)
        for path, look in zip(paths, looks, strict=True):
            load, size = path.load[:, k] / largest, path.displacement[:, k] / one
            bend = (path.displacement[:, k] - slope * path.load[:, k]) / one - offset
            bend = _without_round_off(bend, most / abs(one))
            # first loading is not a loop and lies far from the chord
            shown = (size, bend) if path.cycle or len(paths) == 1 else (size,)
            for axes, conjugate in zip(row, shown, strict=False):
                x, y = (load, conjugate) if upright else (conjugate, load)
                _draw_path(axes, x, y, path.turning, look)
        notes = (kind.conjugate, "less the chord of the last loop")
        labels = (delta, rf"({delta} - \mathrm{{chord}})")
        for m, (axes, symbol, note) in enumerate(zip(row, labels, notes, strict=True)):
            own = f"${symbol}{behind}"
            along, up = (load_label, own) if upright else (own, load_label)
            axes.set(xlabel=along, ylabel=style.wrapped([up], height))
            axis: Literal["x", "y"] = "y" if upright else "x"
            axes.ticklabel_format(axis=axis, scilimits=(-2, 3), useMathText=True)
            style.ticks(axes.xaxis, 5)
            panel = style.panel_title(2 * n + m, 2 * len(moves), note)
            axes.set_title(panel, loc="left", pad=4.0)
    handles = [Line2D([], [], **look) for look in looks]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(paths))
    return figure


@mpl.rc_context(style.RC)
def trajectories(
    record: Record,
    nodes: int | Sequence[int] | None = None,
    cycles: int | Sequence[int] | None = None,
) -> Figure:
    """Draw paths of nodes: above (q, p) with the friction cone, below (v, w) with plane w = -g0.

    Dots are turning points. By default there are representative nodes, and first loading, first and
    last cycle.
    """
    scales, paths = Scales(record), series.paths_of(record, cycles)
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
    unit, w_label = scales.elastic("w", 1, 1)
    low, high = (f([f(path.w[:, chosen]) for path in paths]) / unit for f in (np.min, np.max))
    room = 0.1 * (high - low) or 1.0
    for n, i in enumerate(chosen):
        _draw_node(panels[0, n], panels[1, n], record, paths, i, scales)
        panels[1, n].set_ylim(low - room, high + room)
        panels[1, n].tick_params(labelleft=n == 0)
        x = _without_round_off(record.x[i], float(np.abs(record.x).max()))
        where = scales.position(float(x) / scales.length, ".3g")
        panels[0, n].set_title(style.panel_title(n, columns, where))
        for axes in panels[:, n]:
            style.ticks(axes.xaxis, 3)
            style.ticks(axes.yaxis, 5)
            axes.ticklabel_format(scilimits=(-3, 4), useMathText=True)
    panels[0, 0].set_ylabel(scales.peak_traction("p")[1])
    panels[1, 0].set_ylabel(w_label)
    handles: list[Artist] = [Line2D([], [], **look) for look in _looks(paths)]
    if np.any(record.friction.present[chosen]):
        cone = r"$|q| \leq f p$"
        if not record.friction.is_cone:
            cone = r"$|q| \leq \min(f p + c, t)$"
        elif record.f_backward is not None:
            cone = r"$-f_\mathrm{forward} p \leq q \leq f_\mathrm{backward} p$"
        handles.append(Patch(label=f"friction cone, {cone}", **style.CONE))
    ncols = len(handles) if columns > 2 else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=ncols)
    return figure


def _draw_node(
    above: Axes, below: Axes, record: Record, paths: Sequence[Loop], node: int, scales: Scales
) -> None:
    """Draw p against q of a node with its friction cone, and w against v with the plane w = -g0."""
    (unit, q_label), (slip, v_label) = scales.peak_traction("q"), scales.elastic("v", 1, 1)
    largest = max(float(path.p.max()) for path in paths)
    for path, look in zip(paths, _looks(paths), strict=True):
        q, p = _without_round_off(path.q[:, node], largest), path.p[:, node]
        _draw_path(above, q / unit, p / unit, path.turning, look)
        _draw_path(below, path.v[:, node] / slip, path.w[:, node] / slip, path.turning, look)
    # the cone reaches the top of the axes
    top = 1.05 * max(float(path.p[:, node].max()) for path in paths) / unit or 1.0
    law = record.traction_law(unit)[node]
    low, high = (float(limit) for limit in law.limits(np.asarray(top)))
    reach = 1.15 * max(*map(abs, above.get_xlim()), -low, high) or 1.0
    p = np.linspace(0.0, top, 2 if law.is_cone else 200)
    above.fill_betweenx(p, *law.limits(p), zorder=0, **style.CONE)
    above.set_xlim(-reach, reach)
    above.set_ylim(-0.04 * top, top)
    above.set_xlabel(q_label)
    if np.any(paths[-1].w[:, node] > -record.g0[node]):
        below.axhline(-float(record.g0[node]) / slip, **style.GUIDE)
    largest = max(float(np.abs(path.v).max()) for path in paths) / slip or 1.0
    if np.ptp(below.get_xlim()) < 1e-9 * largest:
        # the node does not move
        below.set_xlim(-0.5 * largest, 0.5 * largest)
    below.set_xlabel(v_label)


def _without_round_off(values: Array, largest: float) -> Array:
    """Return values with 0 in place of round-off of the largest."""
    return np.where(np.abs(values) > 1e-9 * largest, values, 0.0)


def moving_loads(paths: Sequence[Loop]) -> list[int]:
    """Return the loads that change and whose displacements are known; none if too many to tell."""
    loops = [path for path in paths if path.cycle] or paths
    moves = np.any([np.ptp(path.load, axis=0) > 0.0 for path in loops], axis=0)
    known = np.all([np.isfinite(path.displacement).all(axis=0) for path in paths], axis=0)
    found = np.flatnonzero(moves & known).tolist()
    return found if len(found) <= MOST_TOLD else []


def _draw_path(
    axes: Axes, x: Array, y: Array, turning: NDArray[np.bool_], look: dict[str, Any]
) -> None:
    """Draw a cycle, and its turning points as dots unless these are more than 40."""
    axes.plot(x, y, **look)
    if np.count_nonzero(turning) <= 40:
        axes.plot(x[turning], y[turning], "o", color=look["color"], ms=1.6 + look["lw"])


def _looks(paths: Sequence[Loop]) -> list[dict[str, Any]]:
    """Return name, colour and width of cycles: earlier ones are wider, to be seen below later."""
    looks = {0: {"label": "first loading", "color": style.GUIDE_COLOUR, "lw": 1.4}}
    numbers = [path.cycle for path in paths if path.cycle]
    for place, cycle in enumerate(numbers):
        colour = style.SERIES_COLOURS[place % len(style.SERIES_COLOURS)]
        width = 0.8 + min(1.4 * (len(numbers) - 1 - place), 4.2)
        looks[cycle] = {"label": f"cycle {cycle}", "color": colour, "lw": width}
    return [looks[path.cycle] for path in paths]
