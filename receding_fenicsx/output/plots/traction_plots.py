"""Figures of tractions and states along the contact edge, and of stresses at probes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.moment import Moment, recovered_tractions
from receding_fenicsx.evolution.probes import ProbeHistory
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import Friction
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.measures.fatigue import fatigue, short_cracks
from receding_fenicsx.measures.limit_nodes import shown_states
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import Scales, load_pieces
from receding_fenicsx.output.plots.series import phases


@mpl.rc_context(style.RC)
def tractions(record: Record, moments: Moment | Sequence[Moment]) -> Figure:
    """Draw tractions, friction cone and states along the contact edge, a panel for each instant.

    Instants are those of the record, such as ``record.at(9, "minimum")``; states are shown as
    :func:`~receding_fenicsx.measures.limit_nodes.shown_states` returns them.
    """
    scales = Scales(record)
    moments = [moments] if isinstance(moments, Moment) else moments
    if not isinstance(moments, Sequence) or {type(moment) for moment in moments} != {Moment}:
        raise InputError(
            "tractions: give an instant, as record.at() returns it, or a list of some, not "
            f"{moments!r}"
        )
    panels, texts = len(moments), []
    for n, moment in enumerate(moments):
        # the leg and its load, or below it several loads; 2.9 inches are a panel's width
        leg, loads = load_pieces(moment, scales)
        head = [leg] if len(loads) > 1 else []
        rest = style.wrapped(loads if head else [leg, *loads], 2.9)
        texts.append(style.panel_title(n, panels, "\n".join([*head, rest])))
    # inches: 0.14 for a further line of a title
    lines = sum(text.count("\n") for text in texts)
    figure = style.new_figure(style.COLUMN, 0.95 + 1.75 * panels + 0.14 * lines)
    grid = figure.add_gridspec(2 * panels, 1, height_ratios=[0.09, 1.0] * panels)
    axes: Axes | None = None
    x, friction = record.x / scales.length, bool(np.any(record.friction.present))
    shown = [replace(m, state=shown_states(record, m.cycle, m.state)) for m in moments]
    for n, moment in enumerate(shown):
        band = figure.add_subplot(grid[2 * n], sharex=axes)
        axes = figure.add_subplot(grid[2 * n + 1], sharex=band)
        for name, a, b in zones(x, moment.state, record.begins_on_axis):
            kind = style.STATE_OF_NAME[name]
            band.axvspan(a, b, fc=style.STATE_COLOURS[kind], ec="black", lw=0.4)
            if b - a > 0.03 * np.ptp(x):  # room for the number
                look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7.5}
                band.text(0.5 * (a + b), 0.46, str(int(kind)), color=style.STATE_INKS[kind], **look)
        band.set_ylim(0.0, 1.0)
        band.tick_params(axis="both", length=0.0, labelleft=False, labelbottom=False)
        band.set_title(texts[n], pad=6.0)
        unit, used = 1.0, record.weight > 0.0
        if scales.pressure_symbol:  # the pressure acting then
            unit = abs(next(iter(moment.load.values()))) * scales.pressure or 1.0
        p, q = (part[used] / unit for part in recovered_tractions(record, moment))
        shear, law = q if friction else None, record.traction_law(unit)[used]
        guides = [begin for _, begin, _ in zones(x, moment.state)[1:]]
        label = draw_tractions(axes, x[used], p, shear, law, guides, scales.divided)
        axes.set_xlim(*scales.ends)
        style.ticks(axes.yaxis, 7)
        axes.set_ylabel(scales.with_unit(label, scales.divided, stress=1))
        axes.tick_params(labelbottom=n == panels - 1)
        if n == panels - 1:
            axes.set_xlabel(scales.x_label)
    if friction:
        cone = rf"$\pm f p{scales.divided}$"
        # two coefficients need no formula: the cone is drawn between both limits
        cone_alone = record.f_backward is None and record.friction.is_cone
        label = f"friction cone, {cone}" if cone_alone else "friction limits"
        curves = [
            Line2D([], [], color=style.PRESSURE_COLOUR, label=f"$p{scales.divided}$"),
            Line2D([], [], color=style.SHEAR_COLOUR, label=f"$q{scales.divided}$"),
            Patch(label=label, **style.CONE),
        ]
        # in a row, unless the pressure has a long name
        ncols = 3 if len(cone) < 28 else 2
        figure.legend(handles=curves, loc="outside upper center", ncols=ncols)
    states = np.unique([moment.state for moment in shown])
    patches = style.state_patches(states, record.friction.present)
    figure.legend(handles=patches, loc="outside lower center", ncols=2, columnspacing=1.4)
    return figure


def draw_tractions(
    axes: Axes,
    x: Array,
    p: Array,
    q: Array | None,
    law: Friction,
    guides: list[float],
    divided: str,
) -> str:
    """Draw p over x, with friction q and the cone, and ends of zones; return the axis' label."""
    low, high = law.limits(p)
    axes.axhline(0.0, color="black", lw=0.4)
    for place in guides:
        axes.axvline(place, color=style.GUIDE_COLOUR, lw=0.4, dashes=(1, 2))
    axes.plot(x, p, color=style.PRESSURE_COLOUR, label=f"$p{divided}$")
    axes.set_ylim(*style.focus(p, np.concatenate([*([] if q is None else [q]), high, low])))
    if q is None:
        return f"$p{divided}$"
    axes.fill_between(x, low, high, **style.CONE)
    axes.plot(x, q, color=style.SHEAR_COLOUR, label=f"$q{divided}$")
    return f"$p{divided}$,  $q{divided}$"


@mpl.rc_context(style.RC)
def probe_stresses(record: Record, name: str) -> Figure:
    """Draw the stresses at a probe.

    Of one point along the first loading, cycle 1 and the last cycle; of several points over the
    distance along them, at turning points of the last cycle.
    """
    scales, probe, angles = Scales(record), record.probe(name), phases(record)
    draw = _along_path if len(probe.points) == 1 else _along_points
    stresses = np.concatenate([probe.stress, probe.von_mises[..., None]], axis=-1)
    figure, first = draw(probe, stresses, scales, angles)
    handles, labels = first.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


@mpl.rc_context(style.RC)
def fatigue_along(record: Record, name: str) -> Figure:
    """Draw Smith, Watson and Topper's parameter along a probe, and the angle of its plane."""
    found, probe = fatigue(record)[name]["swt"], record.probe(name)
    points = probe.points
    level = bool(np.ptp(points[:, 1]) <= 1e-9 * np.ptp(points[:, 0]))
    x = points[:, 0] if level else _distances(probe)
    figure = style.new_figure(style.COLUMN, 3.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    upper.plot(x, found.value, color=style.PRESSURE_COLOUR)
    upper.set_ylabel(r"$\sigma_{n,\max}\,\Delta\varepsilon_n/2$")
    tells = found.value > 1e-3 * found.value.max(initial=0.0)
    lower.plot(x[tells], found.angle[tells], ".", ms=2.5, color=style.SHEAR_COLOUR)
    lower.set(xlabel="$x$" if level else "distance along the points", ylabel="plane (°)")
    lower.set(ylim=(-5.0, 185.0), yticks=(0, 45, 90, 135, 180), xlim=(x.min(), x.max()))
    return figure


@mpl.rc_context(style.RC)
def crack_along(record: Record, name: str) -> Figure:
    """Draw stress intensities of cracks over their depth along a probe: ends of their ranges."""
    crack = short_cracks(record)[name]
    figure = style.new_figure(style.COLUMN, 2.8)
    axes = figure.subplots()
    both = ((crack.k_i, "$K_I$", "-"), (crack.k_ii, "$K_{II}$", "--"))
    for (k, label, line), colour in zip(both, style.SERIES_COLOURS, strict=False):
        axes.fill_between(crack.depth, k.min(axis=0), k.max(axis=0), color=colour, alpha=0.15)
        axes.plot(crack.depth, k.max(axis=0), line, color=colour, label=label)
        axes.plot(crack.depth, k.min(axis=0), line, color=colour)
    if np.any(np.isfinite(crack.threshold)):
        axes.plot(crack.depth, crack.threshold, ":k", label=r"threshold of $\Delta K_I$")
    if 0.0 < crack.arrest < np.inf:
        axes.axvline(crack.arrest, label="arrest", **style.GUIDE)
    axes.axhline(0.0, color=style.GUIDE_COLOUR, lw=0.5)
    axes.set(xlabel="depth of the crack", ylabel="stress intensity", xlim=(0.0, crack.depth[-1]))
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _along_path(
    probe: ProbeHistory, stresses: Array, scales: Scales, angles: Array | None
) -> tuple[Figure, Axes]:
    """Draw stresses at one point against the position on the legs of some cycles."""
    shown = sorted({0, min(1, int(probe.cycle[-1])), int(probe.cycle[-1])})
    figure = style.new_figure(style.PAGE if len(shown) > 1 else style.COLUMN, 2.5)
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for n, (panel, cycle) in enumerate(zip(panels, shown, strict=True)):
        start = np.flatnonzero(probe.cycle == cycle - 1)[-1:]
        rows = np.concatenate([start, np.flatnonzero(probe.cycle == cycle)])
        path = np.where(probe.cycle[rows] < cycle, 0.0, probe.leg[rows] + probe.s[rows])
        drawn = stresses[rows, 0]
        if cycle == 0:
            path, drawn = np.append(0.0, path), np.pad(drawn, [(1, 0), (0, 0)])
        elif angles is not None:
            path = np.interp(path, np.arange(len(angles)), angles)
        _draw_stresses(panel, path, drawn, scales)
        text = f"cycle {cycle}" if cycle else "first loading"
        panel.set_title(style.panel_title(n, len(shown), text))
        legs = int(probe.leg[rows].max()) + 1
        panel.set(xlim=(0.0, legs), xlabel="legs of the cycle" if cycle else "legs from rest")
        for leg in range(1, legs if legs <= 12 else 1):  # more are a curve
            panel.axvline(leg, **style.GUIDE)
        style.ticks(panel.xaxis)
        if cycle and angles is not None:
            panel.set_xlim(angles[0], angles[-1])
            style.phase_axis(panel.xaxis)
        if n:
            panel.set_ylabel("")
    return figure, panels[0]


def _along_points(
    probe: ProbeHistory, stresses: Array, scales: Scales, angles: Array | None
) -> tuple[Figure, Axes]:
    """Draw stresses along the points at up to four turning points of the last cycle."""
    rows = np.flatnonzero((probe.cycle == probe.cycle[-1]) & (probe.kind == "turning point"))
    chosen = rows[np.linspace(0, len(rows) - 1, min(len(rows), 4)).astype(int)]
    distance = _distances(probe) / scales.length
    figure = style.new_figure(style.COLUMN, 0.8 + 1.7 * len(chosen))
    panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for n, (panel, row) in enumerate(zip(panels, chosen, strict=True)):
        _draw_stresses(panel, distance, stresses[row], scales, "o" if len(distance) <= 12 else "")
        leg, cycle = int(probe.leg[row]), int(probe.cycle[row])
        text = f"end of leg {leg}, cycle {cycle}"
        if angles is not None and cycle:
            text = f"cycle {cycle}, phase ${angles[leg + 1]:.0f}$°"
        panel.set_title(style.panel_title(n, len(chosen), text))
        panel.set_xlim(0.0, distance[-1])
    over = f"$/{scales.length_symbol}$" if scales.length_symbol else ""
    panels[-1].set_xlabel(scales.with_unit(f"distance along the points{over}", over, length=1))
    return figure, panels[0]


def _distances(probe: ProbeHistory) -> Array:
    """Return the distances of a probe's points along them from the first one."""
    steps = np.linalg.norm(np.diff(probe.points, axis=0), axis=1)
    return np.append(0.0, np.cumsum(steps))


def _draw_stresses(axes: Axes, x: Array, values: Array, scales: Scales, marker: str = "") -> None:
    """Draw the lines of all stresses, which differ in greyscale too."""
    unit, symbol = scales.peak_traction(r"\sigma")
    plane, round_ = ("xx", "yy", "zz", "xy"), ("rr", "zz", r"\theta\theta", "rz")
    indices = [*(round_ if scales.axisymmetric else plane), r"\mathrm{v}"]
    dashes = (None, (4, 1.5), (1, 1), (4, 1, 1, 1), None)
    colours = (*style.SERIES_COLOURS[:4], style.PRESSURE_COLOUR)
    for k, (index, dash, colour) in enumerate(zip(indices, dashes, colours, strict=True)):
        label = rf"$\sigma_{{{index}}}$"
        (line,) = axes.plot(x, values[:, k] / unit, marker=marker, color=colour, label=label)
        if dash:
            line.set_dashes(dash)
    axes.axhline(0.0, color=style.GUIDE_COLOUR, lw=0.5)
    axes.set_ylabel(symbol)
