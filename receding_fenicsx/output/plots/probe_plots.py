"""Figures of the probes: stresses along the load path, and along the points of a probe."""

from __future__ import annotations

from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.evolution.probe_history import ProbeHistory
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import Scales, scales_of
from receding_fenicsx.output.plots.series import CURVED_LEGS, phases

PLANE = (r"\sigma_{xx}", r"\sigma_{yy}", r"\sigma_{zz}", r"\sigma_{xy}", r"\sigma_\mathrm{v}")
"""Symbols of the stresses; the last is von Mises' equivalent stress."""
ROUND = (r"\sigma_{rr}", r"\sigma_{zz}", r"\sigma_{\theta\theta}", r"\sigma_{rz}", PLANE[-1])
"""The same in an axisymmetric body."""
DASHES: tuple[tuple[float, ...], ...] = ((), (4, 1.5), (1, 1), (4, 1, 1, 1), ())
"""Dashes of the stresses' lines, so that they differ in greyscale too."""
MAX_PANELS = 4
"""Largest number of turning points in a figure along the points of a probe."""


def probe_stresses(record: Record, name: str, scales: Scales | None = None) -> Figure:
    """Draw the stresses at a probe.

    Of one point: along the load path of the first loading, of cycle 1 and of the last cycle. Of
    several: against the distance along them, at turning points of the last cycle.

    Args:
        record: the record.
        name: name of the probe.
        scales: units; by default those of the record.

    Returns:
        The figure.

    Raises:
        InputError: the record has no such probe.
    """
    scales = scales or scales_of(record)
    probe = record.probe(name)
    with mpl.rc_context(style.RC):
        if len(probe.points) == 1:
            figure = _along_path(probe, scales, phases(record))
        else:
            figure = _along_points(probe, scales, phases(record))
    return figure


def _along_path(probe: ProbeHistory, scales: Scales, angles: Array | None) -> Figure:
    """Draw stresses at one point against the position on the legs of some cycles."""
    unit, suffix = scales.peak_traction()
    shown = sorted({0, min(1, int(probe.cycle[-1])), int(probe.cycle[-1])})
    figure = style.new_figure(style.PAGE if len(shown) > 1 else style.COLUMN, 2.5)
    axes = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    values = _stresses(probe)[:, 0] / unit
    for n, (panel, cycle) in enumerate(zip(axes, shown, strict=True)):
        rows = np.flatnonzero(probe.cycle == cycle)
        start = np.flatnonzero(probe.cycle == cycle - 1)[-1:]
        rows = np.concatenate([start, rows])
        path = np.where(probe.cycle[rows] < cycle, 0.0, probe.leg[rows] + probe.s[rows])
        if cycle == 0:
            path, first = np.concatenate([[0.0], path]), np.zeros((1, values.shape[1]))
            _draw(panel, path, np.vstack([first, values[rows]]), scales)
        else:
            if angles is not None:
                path = np.interp(path, np.arange(len(angles)), angles)
            _draw(panel, path, values[rows], scales)
        text = f"cycle {cycle}" if cycle else "first loading"
        panel.set_title(style.panel_title(n, len(shown), text))
        legs = int(probe.leg[rows].max()) + 1
        panel.set(xlim=(0.0, legs), xlabel="legs of the cycle" if cycle else "legs from rest")
        if legs <= CURVED_LEGS:
            for leg in range(1, legs):
                panel.axvline(leg, **style.GUIDE)
        style.ticks(panel.xaxis)
        if cycle and angles is not None:
            panel.set_xlim(angles[0], angles[-1])
            style.phase_axis(panel.xaxis)
    axes[0].set_ylabel(scales.with_unit(f"$\\sigma{suffix}$", suffix, stress=1))
    _add_legend(figure, axes[0])
    return figure


def _along_points(probe: ProbeHistory, scales: Scales, angles: Array | None) -> Figure:
    """Draw stresses along the points at turning points of the last cycle."""
    unit, suffix = scales.peak_traction()
    rows = np.flatnonzero((probe.cycle == probe.cycle[-1]) & (probe.kind == "turning point"))
    chosen: Ints = rows[np.linspace(0, len(rows) - 1, min(len(rows), MAX_PANELS)).astype(int)]
    steps = [float(np.hypot(*(b - a))) for a, b in pairwise(probe.points)]
    distance = np.concatenate([[0.0], np.cumsum(steps)]) / scales.length
    figure = style.new_figure(style.COLUMN, 0.8 + 1.7 * len(chosen))
    axes = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    values = _stresses(probe) / unit
    for n, (panel, row) in enumerate(zip(axes, chosen, strict=True)):
        _draw(panel, distance, values[row], scales, "o" if len(distance) <= 12 else "")
        leg, cycle = int(probe.leg[row]), int(probe.cycle[row])
        text = f"end of leg {leg}, cycle {cycle}"
        if angles is not None and cycle:
            text = f"cycle {cycle}, phase ${angles[leg + 1]:.0f}$°"
        panel.set_title(style.panel_title(n, len(chosen), text))
        panel.set_ylabel(scales.with_unit(f"$\\sigma{suffix}$", suffix, stress=1))
        panel.set_xlim(0.0, distance[-1])
    over = f"$/{scales.length_symbol}$" if scales.length_symbol else ""
    label = scales.with_unit(f"distance along the points{over}", over, length=1)
    axes[-1].set_xlabel(label)
    _add_legend(figure, axes[0])
    return figure


def _stresses(probe: ProbeHistory) -> Array:
    """Return (n, points, 5): the stresses of ``PLANE``."""
    return np.concatenate([probe.stress, probe.von_mises[..., None]], axis=-1)


def _draw(axes: Axes, x: Array, values: Array, scales: Scales, marker: str = "") -> None:
    """Draw the lines of all stresses."""
    symbols = ROUND if scales.axisymmetric else PLANE
    for k, symbol in enumerate(symbols):
        colour = style.PRESSURE_COLOUR if k == len(symbols) - 1 else style.SERIES_COLOURS[k]
        (line,) = axes.plot(x, values[:, k], marker=marker, color=colour, label=f"${symbol}$")
        if DASHES[k]:
            line.set_dashes(DASHES[k])
    axes.axhline(0.0, color=style.GUIDE_COLOUR, lw=0.5)


def _add_legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
