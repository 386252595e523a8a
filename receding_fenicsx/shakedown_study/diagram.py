"""Diagram of Bree's kind: both limits over the mean of one load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.shakedown.limits import Certificates, lower_limit, upper_limit
from receding_fenicsx.interface.shakedown.margins import Margins
from receding_fenicsx.interface.shakedown.programs import minimise

POINTS, MANY_NODES, FEW_POINTS = 25, 60, 9
"""Mean loads of a diagram; fewer where more than ``MANY_NODES`` nodes need a program each."""
BEYOND = 1.5
"""Part of the range at the upper limit by which the mean varies where no limit bounds it."""
INSIDE = 1e-3
"""Distance of the outermost means from those that just can be held, over their interval."""


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
    """Return changes of a mean load over which a residual slip holds the contact.

    Args:
        margins: margins with the scene's mean loads.
        load: number of the load.
        width: largest change.
    """
    ends = []
    for sign in (-1.0, 1.0):
        G = np.hstack([margins.G, sign * width * margins.by_load[:, [load]]])[: len(margins.kind)]
        cost = np.append(np.zeros(margins.G.shape[1]), -1.0)
        ends.append(sign * width * -minimise(cost, G, margins.c[: len(G)], 1.0).value)
    low, high = ends
    room = INSIDE * (high - low)
    n = POINTS if len(margins.targets) <= MANY_NODES else FEW_POINTS
    # a mean load that cannot vary leaves one point
    return np.linspace(low + room, high - room, n) if high > low else np.zeros(1)


def limits_at(margins: Margins, load: int, changes: Sequence[float]) -> list[tuple[float, float]]:
    """Return both limits for changes of one mean load; NaN where a program fails its checks."""
    found = []
    proofs: Certificates = {}
    for change in changes:
        moved = replace(margins, c=margins.c + change * margins.by_load[:, load])
        try:
            upper = upper_limit(moved)
            lower, proofs = lower_limit(moved, upper, None, proofs)
        except SolveError:
            found.append((np.nan, np.nan))
            continue
        top = -upper.value
        low = top if lower is None else min(lower.answer.value, top)
        found.append((low * margins.range_scale, top * margins.range_scale))
    return found


def draw(diagram: Diagram, path: Path) -> None:
    """Draw a diagram: mean load along, load range up."""
    import matplotlib as mpl

    from receding_fenicsx.output.plots import style
    from receding_fenicsx.output.plots.saving import save

    x, lower, upper = diagram.mean, diagram.lower, diagram.upper
    with mpl.rc_context(style.RC):
        figure = style.new_figure(style.COLUMN, 2.9)
        axes = figure.subplots()
        top = 1.25 * float(upper[np.isfinite(upper)].max(initial=0.0)) or 1.0
        high = np.minimum(upper, top)
        axes.fill_between(x, 0.0, np.minimum(lower, top), color=SAFE, lw=0)
        axes.fill_between(x, np.minimum(lower, top), high, color=DEPENDS, lw=0)
        axes.plot(x, upper, color="black", label=r"$\lambda_2$")
        axes.plot(x, lower, color="black", ls=(0, (4, 2)), label=r"$\lambda_1$")
        axes.axvline(diagram.given, **style.GUIDE)
        entries = [
            mpl.patches.Patch(fc="white", ec="black", lw=0.4, label="slips for ever"),
            mpl.patches.Patch(fc=DEPENDS, ec="black", lw=0.4, label="depends on the start"),
            mpl.patches.Patch(fc=SAFE, ec="black", lw=0.4, label="shakes down"),
        ]
        handles = [*axes.get_legend_handles_labels()[0], *entries]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, columnspacing=1.0)
        axes.set(xlim=(x.min(), x.max()) if len(x) > 1 else None, ylim=(0.0, top))
        axes.set(xlabel=f"mean load factor of {diagram.load}", ylabel=r"load range $\lambda$")
        save(figure, path)


SAFE, DEPENDS = "#bdbdbd", "#e6e6e6"
"""Fill of the regions in which the contact shakes down, and in which it depends on the start."""
