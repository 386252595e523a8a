"""Figures of hysteresis loops of the loads, and of paths of single nodes through a cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import Friction
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.labels import Scales, is_word, load_symbol, scales_of
from receding_fenicsx.output.plots.loops import Loop, loop_of, representative_nodes, shown_cycles

FIRST_LOADING = {"color": style.GUIDE_COLOUR, "lw": 1.4}
LAST_WIDTH, WIDER, WIDEST = 0.8, 1.4, 4.2
"""Width of the last cycle's line in points, what each earlier one has more, and the most of it."""
ROW = 1.95
"""Height in inches of a row of loops."""
ROUND_OFF = 1e-9
"""Part of the largest position, displacement or traction below which a value is round-off."""


def hysteresis(
    record: Record, cycles: int | Sequence[int] | None = None, scales: Scales | None = None
) -> Figure:
    """Draw each load against its work-conjugate quantity; the areas of the loops are work.

    Forces and stresses are drawn upwards, displacements along, also where they are prescribed.

    Args:
        record: the record.
        cycles: cycles with samples; by default first loading, the first and the last cycle.
        scales: units; by default those of the record.

    Returns:
        The figure, one row for each load. Right of each loop is the difference from its chord, the
        straight line between the extreme loads of the last loop, which shows the loop's opening.

    Raises:
        InputError: the record has no samples of a cycle, or no displacements of the loads.
    """
    scales = scales or scales_of(record)
    paths = _paths(record, cycles)
    moves = moving_loads(paths)
    if not moves:
        raise InputError("hysteresis: no load changes, or the record has no load displacements")
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 0.75 + ROW * len(moves))
        panels = figure.subplots(len(moves), 2, squeeze=False)
        for n, (k, row) in enumerate(zip(moves, panels, strict=True)):
            what = _draw_loops(row, record, paths, k, scales)
            for m, note in enumerate((what, "less the chord of the last loop")):
                panel = style.panel_title(2 * n + m, 2 * len(moves), note)
                row[m].set_title(panel, loc="left", pad=4.0)
        figure.legend(handles=_cycle_handles(paths), loc="outside lower center", ncols=len(paths))
    return figure


def _draw_loops(
    row: Sequence[Axes], record: Record, paths: Sequence[Loop], k: int, scales: Scales
) -> str:
    """Draw a load against its work-conjugate quantity, and that less the chord; name it."""
    name = record.load_names[k]
    other = scales.conjugate(k, prescribed=bool(record.load_sign[k] > 0.0))
    delta, unit = other.symbol, other.unit
    delta = delta if is_word(name) else rf"{delta}_{{{load_symbol(name)}}}"
    largest, load_label = scales.load_axis(k, name)
    straight = _chord(paths[-1], k)
    most = max(float(np.abs(path.displacement[:, k]).max()) for path in paths) / abs(unit)
    for path in paths:
        load = path.load[:, k] / largest
        size = path.displacement[:, k] / unit
        bend = (path.displacement[:, k] - straight * path.load[:, k]) / unit
        bend = _without_round_off(bend - _offset(paths[-1], k, straight) / unit, most)
        # first loading is not a loop and lies far from the chord
        shown = (size, bend) if path.cycle or len(paths) == 1 else (size,)
        for axes, conjugate in zip(row, shown, strict=False):
            x, y = (load, conjugate) if other.upright else (conjugate, load)
            _draw_path(axes, x, y, path, paths)
    labels = (delta, rf"({delta} - \mathrm{{chord}})")
    for axes, symbol in zip(row, labels, strict=True):
        along, up = (f"${symbol}{other.behind}${other.bracket}", load_label)[
            :: 1 - 2 * other.upright
        ]
        axes.set(xlabel=along, ylabel=style.wrapped([up], ROW))
        axis: Literal["x", "y"] = "y" if other.upright else "x"
        axes.ticklabel_format(axis=axis, scilimits=(-2, 3), useMathText=True)
        style.ticks(axes.xaxis, 5)
    return other.name


def trajectories(
    record: Record,
    nodes: int | Sequence[int] | None = None,
    cycles: int | Sequence[int] | None = None,
    scales: Scales | None = None,
) -> Figure:
    """Draw paths of nodes in the planes of tractions (q, p) and displacements (v, w).

    Args:
        record: the record.
        nodes: contact nodes, one column each; by default representative nodes.
        cycles: cycles with samples; by default first loading, the first and the last cycle.
        scales: units; by default those of the record.

    Returns:
        The figure: above, (q, p) with the friction cone |q| <= f p; below, (v, w) with the plane
        w = -g0. Dots are turning points.

    Raises:
        InputError: the record has no samples of a cycle, no such node, or no node in contact.
    """
    scales = scales or scales_of(record)
    paths = _paths(record, cycles)
    chosen = representative_nodes(record) if nodes is None else selection.nodes(record, nodes)
    if not chosen:
        raise InputError("trajectories: no node is in contact in the sampled cycles; give nodes")
    with mpl.rc_context(style.RC):
        columns = len(chosen)
        figure = style.new_figure(max(style.COLUMN, 0.3 + 1.8 * columns), 4.3)
        panels = figure.subplots(2, columns, squeeze=False)
        reach = float(np.abs(record.x).max())
        for n, i in enumerate(chosen):
            above, below = panels[:, n]
            _draw_traction_path(above, record, paths, i, scales)
            _draw_displacement_path(below, record, paths, i, scales)
            below.set_ylim(*_normal_range(paths, chosen, scales))
            below.tick_params(labelleft=n == 0)
            x = float(record.x[i]) if abs(record.x[i]) > ROUND_OFF * reach else 0.0
            where = scales.position(x / scales.length, ".3g")
            above.set_title(style.panel_title(n, columns, where))
            for axes in (above, below):
                style.ticks(axes.xaxis, 3)
                style.ticks(axes.yaxis, 5)
                axes.ticklabel_format(scilimits=(-3, 4), useMathText=True)
        traction, slip = scales.peak_traction()[1], scales.elastic(1, 1)[1]
        panels[0, 0].set_ylabel(scales.with_unit(f"$p{traction}$", traction, stress=1))
        panels[1, 0].set_ylabel(scales.with_unit(f"$w{slip}$", slip, length=1))
        handles: list[Any] = _cycle_handles(paths)
        if np.any(record.friction.present[chosen]):
            handles.append(Patch(label=_cone_label(record), **style.CONE))
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_traction_path(
    axes: Axes, record: Record, paths: Sequence[Loop], node: int, scales: Scales
) -> None:
    """Draw p against q of a node, with its friction cone."""
    unit, divided = scales.peak_traction()
    largest = float(np.abs([path.p.max() for path in paths]).max())
    for path in paths:
        q = _without_round_off(path.q[:, node], largest)
        _draw_path(axes, q / unit, path.p[:, node] / unit, path, paths)
    _draw_cone(axes, record.friction[node])
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


def _normal_range(
    paths: Sequence[Loop], nodes: Sequence[int], scales: Scales
) -> tuple[float, float]:
    """Return the common range of w of several nodes."""
    unit, _ = scales.elastic(1, 1)
    low, high = (f([f(path.w[:, nodes]) for path in paths]) / unit for f in (np.min, np.max))
    room = 0.1 * (high - low) or 1.0
    return low - room, high + room


def _without_round_off(values: Array, largest: float) -> Array:
    """Return values with 0 in place of round-off of the largest."""
    return np.where(np.abs(values) > ROUND_OFF * largest, values, 0.0)


def _paths(record: Record, cycles: int | Sequence[int] | None) -> list[Loop]:
    chosen = shown_cycles(record) if cycles is None else selection.cycles(record, cycles)
    return [loop_of(record, cycle) for cycle in chosen]


def moving_loads(paths: Sequence[Loop]) -> list[int]:
    """Return the loads that change within the paths and have known displacements."""
    loops = [path for path in paths if path.cycle] or paths
    return [
        k
        for k in range(paths[0].load.shape[1] if paths else 0)
        if any(np.ptp(path.load[:, k]) > 0.0 for path in loops)
        and all(np.all(np.isfinite(path.displacement[:, k])) for path in paths)
    ]


def _chord(path: Loop, k: int) -> float:
    """Return the displacement per load between the extreme loads of a path."""
    low, high = np.argmin(path.load[:, k]), np.argmax(path.load[:, k])
    run = float(path.load[high, k] - path.load[low, k])
    return float(path.displacement[high, k] - path.displacement[low, k]) / run if run else 0.0


def _offset(path: Loop, k: int, straight: float) -> float:
    """Return the displacement at zero load on the chord of a path."""
    high = np.argmax(path.load[:, k])
    return float(path.displacement[high, k] - straight * path.load[high, k])


def _cone_label(record: Record) -> str:
    if record.f_backward is None:
        return r"friction cone, $|q| \leq f p$"
    return r"friction cone, $-f_\mathrm{forward} p \leq q \leq f_\mathrm{backward} p$"


def _draw_path(axes: Axes, x: Array, y: Array, path: Loop, paths: Sequence[Loop]) -> None:
    look = _look(path, paths)
    axes.plot(x, y, **look)
    # largest number of turning points of a cycle that have dots
    if np.count_nonzero(path.turning) > 40:
        return
    # size of the last cycle's turning points
    dots = 2.4 + look["lw"] - LAST_WIDTH
    axes.plot(x[path.turning], y[path.turning], "o", color=look["color"], ms=dots)


def _draw_cone(axes: Axes, friction: Friction) -> None:
    """Fill the friction cone up to the top of the axes, and set their limits."""
    top = 1.05 * max(float(line.get_ydata().max()) for line in axes.lines)  # type: ignore[union-attr]
    top = top or 1.0
    left, right = axes.get_xlim()
    low, high = (float(limit) for limit in friction.limits(np.asarray(top)))
    reach = 1.15 * max(abs(left), abs(right), -low, high) or 1.0
    axes.fill_between([low, 0.0, high], [top, 0.0, top], top, zorder=0, **style.CONE)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-0.04 * top, top)


def _cycle_handles(paths: Sequence[Loop]) -> list[Line2D]:
    return [
        Line2D(
            [],
            [],
            label=f"cycle {path.cycle}" if path.cycle else "first loading",
            **_look(path, paths),
        )
        for path in paths
    ]


def _look(path: Loop, paths: Sequence[Loop]) -> dict[str, Any]:
    """Return colour and width of a cycle: earlier ones are wider, to be seen below later ones."""
    later = len(paths) - 1 - [other.cycle for other in paths].index(path.cycle)
    width = LAST_WIDTH + min(later * WIDER, WIDEST)
    if path.cycle == 0:
        return FIRST_LOADING
    numbers = [other.cycle for other in paths if other.cycle]
    colours = style.SERIES_COLOURS
    return {"color": colours[numbers.index(path.cycle) % len(colours)], "lw": width}
