"""Figures of shakedown: diagram of both limits, and steady states from many starts."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.shakedown.opening import Opening
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_text
from receding_fenicsx.studies.shakedown.diagram import Diagram
from receding_fenicsx.studies.starts import SteadyStates

SAFE, DEPENDS = "#bdbdbd", "#e6e6e6"
"""Fill of the regions in which the contact shakes down, and in which it depends on the start."""


def diagram_figure(diagram: Diagram, opening: Opening | None = None) -> Figure:
    """Draw both limits: mean load along, load range up; a dot for the range with opening nodes."""
    x, lower, upper = diagram.mean, diagram.lower, diagram.upper
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 2.9)
        axes = figure.subplots()
        seen = np.append(upper[np.isfinite(upper)], 0.0 if opening is None else opening.value)
        top = 1.25 * float(seen.max()) or 1.0
        high = np.minimum(upper, top)
        axes.fill_between(x, 0.0, np.minimum(lower, top), color=SAFE, lw=0)
        axes.fill_between(x, np.minimum(lower, top), high, color=DEPENDS, lw=0)
        axes.plot(x, upper, color="black", label=r"$\lambda_2$")
        axes.plot(x, lower, color="black", ls=(0, (4, 2)), label=r"$\lambda_1$")
        axes.axvline(diagram.given, **style.GUIDE)
        if opening is not None:
            dot = [diagram.given], [opening.value]
            axes.plot(*dot, "o", color="black", ms=4, zorder=5, label="opens without slip")
        entries = [
            mpl.patches.Patch(fc="white", ec="black", lw=0.4, label="slips for ever, or opens"),
            mpl.patches.Patch(fc=DEPENDS, ec="black", lw=0.4, label="depends on the start"),
            mpl.patches.Patch(fc=SAFE, ec="black", lw=0.4, label="shakes down"),
        ]
        handles = [*axes.get_legend_handles_labels()[0], *entries]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, columnspacing=1.0)
        axes.set(xlim=(x.min(), x.max()) if len(x) > 1 else None, ylim=(0.0, top))
        axes.set(
            xlabel=f"mean load factor of {load_text(diagram.load)}", ylabel=r"load range $\lambda$"
        )
    return figure


def steady_states_figure(states: SteadyStates) -> Figure:
    """Draw dissipation per cycle of each start, sorted, beside the states of the nodes."""
    order = np.argsort(states.dissipation, kind="stable")
    rows = np.arange(len(order))
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.PAGE, 3.0)
        left, right = figure.subplots(1, 2, sharey=True)
        kinds = np.array(states.kind)[order]
        for kind, colour in zip(dict.fromkeys(kinds), style.SERIES_COLOURS, strict=False):
            of_kind = kinds == kind
            D = states.dissipation[order][of_kind]
            left.plot(D, rows[of_kind], "o", ms=3, color=colour, label=kind)
        style.ticks(left.xaxis, 4)
        left.legend(loc="lower right")
        left.set(xlabel="dissipation per cycle of the steady state", ylabel="starts, sorted")
        found = np.unique(states.state)
        colours = mpl.colors.ListedColormap([style.STATE_COLOURS[s] for s in State])
        places = np.arange(len(states.x)) if len(states.x) < 2 else states.x
        right.pcolormesh(
            places, rows, states.state[order], cmap=colours, vmin=0.5, vmax=4.5, rasterized=True
        )
        right.set(xlabel="$x$")
        figure.legend(
            handles=style.state_patches(found), loc="outside upper center", ncols=len(found)
        )
    return figure
