"""Figure of the steady states from many starts: dissipation of each, and states of their nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from receding_fenicsx.evolution.limit.starts import SteadyStates
from receding_fenicsx.interface.law import State
from receding_fenicsx.output.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
