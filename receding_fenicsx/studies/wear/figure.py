"""Figures of a wear study: profiles at some of its cycles, zones over the cycles."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.law import State
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.report.checks import CRITERIA
from receding_fenicsx.studies.wear.result import WearStudy


def profiles_figure(study: WearStudy) -> Figure:
    """Draw worn depth and pressure over x at some numbers of cycles, evenly by the depth."""
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 4.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        for row, colour in zip(study.shown(5), style.SERIES_COLOURS, strict=False):
            upper.plot(study.x, study.pressure[row], color=colour)
            label = f"{study.cycles[row]:,.0f} cycles"
            lower.plot(study.x, -study.depth[row], color=colour, label=label)
        upper.set_ylabel("$p$")
        lower.set(xlabel="$x$", ylabel="worn depth, downwards", xlim=_seen(study))
        upper.set_ylim(bottom=0.0)
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def fatigue_figure(study: WearStudy) -> Figure:
    """Draw the worst fatigue parameters over the wear cycles, each over its value at the start."""
    found = study.fatigue()
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 2.8)
        axes = figure.subplots()
        cycles = [one["cycles"] for one in found]
        for k, name in enumerate(found[0]["parameters"]):
            value = np.array([one["parameters"][name]["max"] for one in found])
            if value[0] > 0.0:
                axes.plot(
                    cycles,
                    value / value[0],
                    marker="os^vDx"[k],
                    mfc="none",
                    color=style.SERIES_COLOURS[k],
                    label=CRITERIA[name],
                )
        axes.set(xlabel="cycles", ylabel="worst value over that at the start", ylim=(0.0, None))
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def zones_figure(study: WearStudy) -> Figure:
    """Draw stick, slip and separation over the cycles upwards."""
    zone, cycles = study.zone, np.append(study.cycles, study.cycles[-1])
    edges = np.concatenate([study.x[:1], 0.5 * (study.x[1:] + study.x[:-1]), study.x[-1:]])
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 3.2)
        axes = figure.subplots()
        colours = mpl.colors.ListedColormap([style.STATE_COLOURS[s] for s in State])
        axes.pcolormesh(edges, cycles, zone, cmap=colours, vmin=0.5, vmax=4.5, rasterized=True)
        axes.set(xlabel="$x$", ylabel="cycles", xlim=_seen(study))
        if cycles[-1] > 0.0:
            axes.set_yscale("symlog", linthresh=max(1.0, 1e-3 * cycles[-1]))
        names = {State.STICK: "stick", State.SEPARATION: "separation", State.FORWARD_SLIP: "slip"}
        patches = [
            mpl.patches.Patch(fc=style.STATE_COLOURS[s], ec="black", lw=0.4, label=name)
            for s, name in names.items()
            if np.any(zone == s)
        ]
        figure.legend(handles=patches, loc="outside upper center", ncols=len(patches))
    return figure


def _seen(study: WearStudy) -> tuple[float, float]:
    """Return the ends of what touches in any row, with some room."""
    touches: Array = study.x[np.any(study.zone != State.SEPARATION, axis=0)]
    if not len(touches):
        touches = study.x
    room = 0.1 * float(np.ptp(touches))
    return float(touches.min()) - room, float(touches.max()) + room
