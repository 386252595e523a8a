"""Figures of tractions, friction limit and states along the contact edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.moment import Moment, recovered_tractions
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.measures.limit_nodes import shown_states
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import Scales, load_pieces, scales_of

TITLE_WIDTH, LINE = 2.9, 0.14
"""Largest width of a panel's title, and height of a line of it after the first, in inches."""
MIN_NUMBERED_ZONE = 0.03
"""Smallest length, over that of the contact edge, of a zone that has its number in the band."""


def tractions(
    record: Record, moments: Moment | Sequence[Moment], scales: Scales | None = None
) -> Figure:
    """Draw tractions, the friction cone and the states along the contact edge.

    Args:
        record: the record.
        moments: instants of the record, one panel each, such as ``record.at(9, "minimum")``.
        scales: units; by default those of the record.

    Returns:
        The figure. States are those of
        :func:`~receding_fenicsx.measures.limit_nodes.shown_states`.

    Raises:
        InputError: the argument is not one or several instants.
    """
    scales = scales or scales_of(record)
    moments = [moments] if isinstance(moments, Moment) else moments
    if not isinstance(moments, Sequence) or {type(moment) for moment in moments} != {Moment}:
        raise InputError(
            "tractions: give an instant, as record.at() returns it, or a list of some, not "
            f"{moments!r}"
        )
    panels = len(moments)
    with mpl.rc_context(style.RC):
        texts = [
            style.panel_title(n, panels, _title(record, moment, scales))
            for n, moment in enumerate(moments)
        ]
        lines = sum(text.count("\n") for text in texts)
        figure = style.new_figure(style.COLUMN, 0.95 + 1.75 * panels + LINE * lines)
        grid = figure.add_gridspec(2 * panels, 1, height_ratios=[0.09, 1.0] * panels)
        axes: Axes | None = None
        shown = [
            replace(moment, state=shown_states(record, moment.cycle, moment.state))
            for moment in moments
        ]
        for n, moment in enumerate(shown):
            band = figure.add_subplot(grid[2 * n], sharex=axes)
            axes = figure.add_subplot(grid[2 * n + 1], sharex=band)
            _draw_band(band, record, moment.state, scales)
            band.set_title(texts[n], pad=6.0)
            _draw_curves(axes, record, moment, scales)
            axes.tick_params(labelbottom=n == panels - 1)
            if n == panels - 1:
                axes.set_xlabel(scales.x_label)
        p, q, cone = scales.traction_labels()
        friction = bool(np.any(record.friction.present))
        if friction:
            # two coefficients need no formula: the cone is drawn between both limits
            one = record.f_backward is None
            curves = [
                Line2D([], [], color=style.PRESSURE_COLOUR, label=p),
                Line2D([], [], color=style.SHEAR_COLOUR, label=q),
                Patch(label=f"friction cone, {cone}" if one else "friction cone", **style.CONE),
            ]
            # in a row, unless the unit has a long name
            # length of the friction cone's label below which three labels fit in a row
            ncols = 3 if len(cone) < 28 else 2
            figure.legend(handles=curves, loc="outside upper center", ncols=ncols)
        states = np.unique([moment.state for moment in shown])
        patches = style.state_patches(states, record.friction.present)
        figure.legend(handles=patches, loc="outside lower center", ncols=2, columnspacing=1.4)
    return figure


def _title(record: Record, moment: Moment, scales: Scales) -> str:
    """Return the leg of an instant and its load, or below it several loads."""
    leg, loads = load_pieces(record, moment, scales)
    if len(loads) > 1:
        return f"{leg}\n{style.wrapped(loads, TITLE_WIDTH)}"
    return style.wrapped([leg, *loads], TITLE_WIDTH)


def _draw_band(axes: Axes, record: Record, state: NDArray[np.int8], scales: Scales) -> None:
    """Draw the states as a band of colours with their numbers."""
    x = record.x / scales.length
    for name, a, b in zones(x, state, record.begins_on_axis):
        kind = style.STATE_OF_NAME[name]
        axes.axvspan(a, b, fc=style.STATE_COLOURS[kind], ec="black", lw=0.4)
        if b - a > MIN_NUMBERED_ZONE * np.ptp(x):
            axes.text(
                0.5 * (a + b),
                0.46,
                str(int(kind)),
                ha="center",
                va="center",
                fontsize=7.5,
                color=style.STATE_INKS[kind],
            )
    axes.set_ylim(0.0, 1.0)
    axes.tick_params(
        left=False, right=False, bottom=False, top=False, labelleft=False, labelbottom=False
    )


def _draw_curves(axes: Axes, record: Record, moment: Moment, scales: Scales) -> None:
    """Draw recovered p and q, and the friction cone, at the nodes with weight."""
    used = record.weight > 0.0
    x = record.x[used] / scales.length
    unit = scales.traction_unit(moment)
    p, q = (part[used] / unit for part in recovered_tractions(record, moment))
    low, high = record.friction[used].limits(p)
    axes.axhline(0.0, color="black", lw=0.4)
    for _, begin, _ in zones(record.x / scales.length, moment.state)[1:]:
        axes.axvline(begin, color=style.GUIDE_COLOUR, lw=0.4, dashes=(1, 2))
    labels = list(scales.traction_labels()[:1])
    axes.plot(x, p, color=style.PRESSURE_COLOUR)
    if np.any(record.friction.present):
        labels = list(scales.traction_labels()[:2])
        axes.fill_between(x, low, high, **style.CONE)
        axes.plot(x, q, color=style.SHEAR_COLOUR)
    axes.set_xlim(*scales.ends(record.x))
    axes.set_ylim(*style.focus(p, np.concatenate([q, high, low])))
    style.ticks(axes.yaxis, 7)
    axes.set_ylabel(scales.with_unit(",  ".join(labels), scales.pressure_symbol, stress=1))
