"""Hysteresis loops of the loads, and what chosen nodes go through in the planes of their forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import Array
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.loops import Loop, loop_of, shown_cycles, telling_nodes
from receding_fenicsx.output.plots.units import Scales, is_word, load_symbol, scales_of

FIRST_LOADING = {"color": style.GUIDE_COLOUR, "lw": 0.9}


ROUND_OFF = 1e-9
"""Part of the largest position, displacement or traction that is none."""


def hysteresis(
    record: Record, cycles: int | Sequence[int] | None = None, scales: Scales | None = None
) -> Figure:
    """Draw each load against its work-conjugate displacement: the loops' area is dissipation.

    For a prescribed displacement, the force that it takes is drawn over it.

    Args:
        record: the record.
        cycles: cycles with samples; first loading, the first and the last when left out.
        scales: units; the record's own when left out.

    Returns:
        The figure, a row a load: the loops, and on the right the same less the straight line that
        joins the last loop's extreme loads, which shows how far they open.

    Raises:
        InputError: the record has no samples of a cycle, or no displacements of the loads.
    """
    scales = scales or scales_of(record)
    paths = _paths(record, cycles)
    moves = moving_loads(paths)
    if not moves:
        raise InputError("hysteresis: no load moves, or the record has no load displacements")
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 0.75 + 1.95 * len(moves))
        panels = figure.subplots(len(moves), 2, squeeze=False)
        for n, (k, row) in enumerate(zip(moves, panels, strict=True)):
            name = record.load_names[k]
            prescribed = bool(record.load_sign[k] > 0.0)
            letter = "F" if prescribed else r"\delta"
            delta = letter if is_word(name) else rf"{letter}_{{{load_symbol(name)}}}"
            unit, behind = (1.0, "") if prescribed else scales.load_displacement()
            straight = _chord(paths[-1], k)
            most = max(float(np.abs(path.displacement[:, k]).max()) for path in paths) / unit
            for path in paths:
                load = path.load[:, k] / scales.load_max[k]
                size = path.displacement[:, k] / unit
                bend = (path.displacement[:, k] - straight * path.load[:, k]) / unit
                bend = _felt(bend - _offset(paths[-1], k, straight) / unit, most)
                # first loading is no loop and lies far from the chord
                shown = (size, bend) if path.cycle or len(paths) == 1 else (size,)
                for axes, conjugate in zip(row, shown, strict=False):
                    x, y = (load, conjugate) if prescribed else (conjugate, load)
                    _draw_path(axes, x, y, path, paths)
            labels = (rf"${delta}{behind}$", rf"$({delta} - \mathrm{{chord}}){behind}$")
            for m, (axes, label) in enumerate(zip(row, labels, strict=True)):
                ends = (label, scales.load_label(name))
                axes.set(xlabel=ends[prescribed], ylabel=ends[not prescribed])
                along = "y" if prescribed else "x"
                axes.ticklabel_format(axis=along, scilimits=(-2, 3), useMathText=True)
                style.ticks(axes.xaxis, 5)
                panel = style.panel_title(2 * n + m, 2 * len(moves), "")
                note = ("", "less the chord of the last loop")[m]
                axes.set_title(f"{panel}{note}", loc="left", pad=4.0)
        figure.legend(handles=_cycle_handles(paths), loc="outside lower center", ncols=len(paths))
    return figure


def trajectories(
    record: Record,
    nodes: int | Sequence[int] | None = None,
    cycles: int | Sequence[int] | None = None,
    scales: Scales | None = None,
) -> Figure:
    """Draw what nodes go through in the planes of tractions (q, p) and displacements (v, w).

    Args:
        record: the record.
        nodes: contact nodes, a column each; some that differ when left out.
        cycles: cycles with samples; first loading, the first and the last when left out.
        scales: units; the record's own when left out.

    Returns:
        The figure: above, (Q, P) over the node's weight in the friction cone |Q| <= f P; below,
        (v, w) over the plane w = -g0. Dots are turning points.

    Raises:
        InputError: the record has no samples of a cycle, no such node, or no node in contact.
    """
    scales = scales or scales_of(record)
    paths = _paths(record, cycles)
    chosen = telling_nodes(record) if nodes is None else selection.nodes(record, nodes)
    if not chosen:
        raise InputError("trajectories: no node touches in the sampled cycles; name nodes")
    unit, behind = scales.peak_traction()
    length, beside = scales.slip()
    reach, pressed = (float(np.abs(a).max()) for a in (record.x, [path.p.max() for path in paths]))
    most = max(float(np.abs(path.v).max()) for path in paths) / length or 1.0
    low, high = (f([f(path.w[:, chosen]) for path in paths]) / length for f in (np.min, np.max))
    room = 0.1 * (high - low) or 1.0
    lifted = low - room, high + room
    with mpl.rc_context(style.RC):
        columns = len(chosen)
        figure = style.new_figure(max(style.COLUMN, 0.3 + 1.8 * columns), 4.3)
        panels = figure.subplots(2, columns, squeeze=False)
        for n, i in enumerate(chosen):
            above, below = panels[:, n]
            for path in paths:
                _draw_path(
                    above, _felt(path.q[:, i], pressed) / unit, path.p[:, i] / unit, path, paths
                )
                _draw_path(below, path.v[:, i] / length, path.w[:, i] / length, path, paths)
            _draw_cone(above, float(record.f[i]))
            if np.any([path.w[:, i] > -record.g0[i] for path in paths][-1]):
                below.axhline(-float(record.g0[i]) / length, **style.GUIDE)
            x = float(record.x[i]) if abs(record.x[i]) > ROUND_OFF * reach else 0.0
            where = f"{scales.x_label[:-1]} = {x / scales.length:z.3g}$"
            above.set_title(style.panel_title(n, columns, where))
            below.set_ylim(*lifted)
            left, right = below.get_xlim()
            if right - left < ROUND_OFF * most:
                # a node that does not move
                below.set_xlim(-0.5 * most, 0.5 * most)
            below.tick_params(labelleft=n == 0)
            for axes in (above, below):
                style.ticks(axes.xaxis, 3)
                style.ticks(axes.yaxis, 5)
                axes.ticklabel_format(scilimits=(-3, 4), useMathText=True)
            above.set_xlabel(f"$q{behind}$")
            below.set_xlabel(f"$v{beside}$")
        panels[0, 0].set_ylabel(f"$p{behind}$")
        panels[1, 0].set_ylabel(f"$w{beside}$")
        handles: list[Any] = _cycle_handles(paths)
        if np.any(record.f[chosen] > 0.0):
            handles.append(Patch(label=r"friction cone, $|Q| \leq f P$", **style.CONE))
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _felt(values: Array, largest: float) -> Array:
    """Values, those that are round-off of the largest being zero."""
    return np.where(np.abs(values) > ROUND_OFF * largest, values, 0.0)


def _paths(record: Record, cycles: int | Sequence[int] | None) -> list[Loop]:
    chosen = shown_cycles(record) if cycles is None else selection.cycles(record, cycles)
    return [loop_of(record, cycle) for cycle in chosen]


def moving_loads(paths: Sequence[Loop]) -> list[int]:
    """Loads that change within the cycles, if any are shown, and have known displacements."""
    loops = [path for path in paths if path.cycle] or paths
    return [
        k
        for k in range(paths[0].load.shape[1] if paths else 0)
        if any(np.ptp(path.load[:, k]) > 0.0 for path in loops)
        and all(np.all(np.isfinite(path.displacement[:, k])) for path in paths)
    ]


def _chord(path: Loop, k: int) -> float:
    """Displacement per load between the extreme loads of a path."""
    low, high = np.argmin(path.load[:, k]), np.argmax(path.load[:, k])
    run = float(path.load[high, k] - path.load[low, k])
    return float(path.displacement[high, k] - path.displacement[low, k]) / run if run else 0.0


def _offset(path: Loop, k: int, straight: float) -> float:
    """Where the chord of a path meets zero load."""
    high = np.argmax(path.load[:, k])
    return float(path.displacement[high, k] - straight * path.load[high, k])


def _draw_path(axes: Axes, x: Array, y: Array, path: Loop, paths: Sequence[Loop]) -> None:
    look = _look(path, paths)
    axes.plot(x, y, **look)
    axes.plot(x[path.turning], y[path.turning], "o", color=look["color"], ms=2.6)


def _draw_cone(axes: Axes, f: float) -> None:
    """Fill |q| <= f p up to the top of the axes, and keep the axes' limits."""
    top = 1.05 * max(float(line.get_ydata().max()) for line in axes.lines)  # type: ignore[union-attr]
    top = top or 1.0
    left, right = axes.get_xlim()
    reach = 1.15 * max(abs(left), abs(right), f * top) or 1.0
    axes.fill_between([-f * top, 0.0, f * top], [top, 0.0, top], top, zorder=0, **style.CONE)
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
    if path.cycle == 0:
        return FIRST_LOADING
    numbers = [other.cycle for other in paths if other.cycle]
    colours = style.SERIES_COLOURS
    return {"color": colours[numbers.index(path.cycle) % len(colours)]}
