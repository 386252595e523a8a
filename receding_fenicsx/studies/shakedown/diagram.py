"""Diagram of Bree's kind: both limits over the mean of one load; figures of shakedown."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.shakedown.limits import Certificates, lower_limit, upper_limit
from receding_fenicsx.interface.shakedown.margins import Margins
from receding_fenicsx.interface.shakedown.opening import Opening
from receding_fenicsx.interface.shakedown.programs import minimise
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_text
from receding_fenicsx.studies.starts import SteadyStates


@dataclass(frozen=True)
class Diagram:
    """Limits over the mean of one load.

    Attributes:
        load: name of the load.
        mean: (n,) its mean load factors.
        lower, upper: (n,) limits; NaN where they were not found.
        given: the mean load factor of the scene.
    """

    load: str
    mean: Array
    lower: Array
    upper: Array
    given: float


def means(margins: Margins, load: int, width: float) -> Array:
    """Return changes of a mean load, up to a width, over which a slip holds the contact."""
    ends = []
    for sign in (-1.0, 1.0):
        G = np.hstack([margins.G, sign * width * margins.by_load[:, [load]]])[: len(margins.kind)]
        cost = np.append(np.zeros(margins.G.shape[1]), -1.0)
        ends.append(sign * width * -minimise(cost, G, margins.c[: len(G)], 1.0).value)
    low, high = ends
    room = 1e-3 * (high - low)  # the outermost means just can be held
    n = 25 if len(margins.targets) <= 60 else 9  # each node needs a program
    # a mean load that cannot vary leaves one point
    return np.linspace(low + room, high - room, n) if high > low else np.zeros(1)


def limits_at(margins: Margins, load: int, changes: Sequence[float]) -> list[tuple[float, float]]:
    """Return both limits for changes of one mean load; NaN where they were not found."""
    found = []
    proofs: Certificates = {}
    for change in changes:
        moved = replace(margins, c=margins.c + change * margins.by_load[:, load])
        low = top = np.nan
        # a point whose programs fail, or that no slip holds, is left out of the diagram
        with suppress(SolveError, InputError):
            upper = upper_limit(moved)
            top = -upper.value if upper.value < np.inf else np.nan
            lower, proofs = lower_limit(moved, upper, certificates=proofs)
            low = top if lower is None else min(lower.value, top)
        found.append((low * margins.range_scale, top * margins.range_scale))
    return found


def diagram_figure(diagram: Diagram, opening: Opening | None = None) -> Figure:
    """Draw both limits: mean load along, load range up; a dot for the range with opening nodes."""
    x, lower, upper = diagram.mean, diagram.lower, diagram.upper
    safe, depends = "#bdbdbd", "#e6e6e6"  # where it shakes down, and depends on the start
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 2.9)
        axes = figure.subplots()
        seen = np.append(upper[np.isfinite(upper)], 0.0 if opening is None else opening.value)
        top = 1.25 * float(seen.max()) or 1.0
        high = np.minimum(upper, top)
        axes.fill_between(x, 0.0, np.minimum(lower, top), color=safe, lw=0)
        axes.fill_between(x, np.minimum(lower, top), high, color=depends, lw=0)
        axes.plot(x, upper, color="black", label=r"$\lambda_2$")
        axes.plot(x, lower, color="black", ls=(0, (4, 2)), label=r"$\lambda_1$")
        axes.axvline(diagram.given, **style.GUIDE)
        if opening is not None:
            dot = [diagram.given], [opening.value]
            axes.plot(*dot, "o", color="black", ms=4, zorder=5, label="opens without slip")
        entries = [
            mpl.patches.Patch(fc="white", ec="black", lw=0.4, label="slips for ever, or opens"),
            mpl.patches.Patch(fc=depends, ec="black", lw=0.4, label="depends on the start"),
            mpl.patches.Patch(fc=safe, ec="black", lw=0.4, label="shakes down"),
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
