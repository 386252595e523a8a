"""Figures of slip and dissipation per cycle and of the dissipation density."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import Scales, scales_of
from receding_fenicsx.output.plots.series import fitted_cycles, slip_lines


@mpl.rc_context(style.RC)
def slip_per_cycle(record: Record, scales: Scales | None = None) -> Figure:
    """Draw the slip increment of each cycle at some nodes, with fitted powers of N.

    Raises:
        InputError: the record has too few cycles, or no node slips in all of them.
    """
    scales = scales or scales_of(record)
    unit, behind = scales.elastic(1, 1)
    lines = slip_lines(record, scales.length, unit)
    if not lines:
        raise InputError("slip per cycle: no node slips in enough cycles; run more cycles")
    fitted = fitted_cycles(record).astype(float)
    figure = style.new_figure(style.COLUMN, 3.6)
    axes = figure.subplots()
    for line, colour in zip(lines, style.SERIES_COLOURS, strict=False):
        label = f"{scales.position(line.x, '.2f')}:  $N^{{{line.fit.exponent:.2f}}}$"
        axes.loglog(line.N, line.slip, "o", color=colour, ms=2.4, label=label)
        axes.loglog(fitted, line.at(fitted), color=colour, lw=0.8)
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
    """Draw the dissipation of each cycle over that of the first.

    Args:
        record: the record.
        scales: units; by default those of the record.
        stepped: record of the same history by another method, drawn as well.

    Returns:
        The figure.
    """
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
    axes.annotate(
        f"{ratio[-1]:.4f}",
        (float(N[-1]), ratio[-1]),
        xytext=(-4, 5),
        textcoords="offset points",
        fontsize=8.0,
        ha="right",
    )
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
