"""Figures of studies: branches, slip mode at critical friction, search for a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.branches import BranchTree
from receding_fenicsx.interface.branches.critical_friction import CriticalFriction
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import is_word, load_symbol, load_text
from receding_fenicsx.output.plots.series import in_time


@mpl.rc_context(style.RC)
def branches(tree: BranchTree) -> Figure:
    """Draw each load against its work-conjugate displacement along the first twelve branches.

    A cross is the last turning point of a branch that ends on the next leg. Samples are drawn where
    the records have them. Each branch is shifted a little, as parts of them may coincide.
    """
    paths = [in_time(branch.record)[1][:2] for branch in tree.branches[:12]]  # from rest
    names = tree[0].record.load_names
    moves = [k for k in range(len(names)) if any(np.any(load[:, k]) for load, _ in paths)]
    if not moves:
        raise InputError("branches: no branch comes to the end of its first leg, nothing to draw")
    width = style.COLUMN if len(moves) == 1 else style.PAGE
    figure = style.new_figure(width, 2.6 + 0.17 * len(paths))
    panels = figure.subplots(1, len(moves), squeeze=False)[0]
    for n, (k, axes) in enumerate(zip(moves, panels, strict=True)):
        for number, (branch, (load, moved)) in enumerate(zip(tree.branches, paths, strict=False)):
            colour = style.SERIES_COLOURS[number % len(style.SERIES_COLOURS)]
            # each branch is 2 points to the right of and below the one before: they may coincide
            shift = number * 2.0 / 72.0, -number * 2.0 / 72.0
            moving = mpl.transforms.ScaledTranslation(*shift, figure.dpi_scale_trans)
            beside = {"color": colour, "transform": axes.transData + moving}
            label = f"branch {number}: {branch.name}{', then ends' if branch.failure else ''}"
            axes.plot(moved[:, k], load[:, k], lw=1.4, label=label, **beside)
            axes.update_datalim(np.stack([moved[:, k], load[:, k]], axis=1))
            axes.autoscale_view()
            if branch.failure:
                axes.plot(moved[-1:, k], load[-1:, k], "x", ms=8.0, mew=1.6, zorder=5, **beside)
        name = names[k]
        symbol = "U" if is_word(name) else f"U_{{{load_symbol(name)}}}"
        axes.set(xlabel=f"${symbol}$", ylabel=load_text(name))
        axes.ticklabel_format(axis="x", scilimits=(-2, 3), useMathText=True)
        if len(moves) > 1:
            axes.set_title(style.panel_title(n, len(moves), load_text(name)), loc="left", pad=4.0)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=1)
    return figure


@mpl.rc_context(style.RC)
def slip_mode(system: ContactSystem, critical: CriticalFriction) -> Figure:
    """Draw the slip mode at critical friction over the contact edge.

    Above v as lines in the colour of the assumed direction of slip, and the gap of open nodes;
    below the changes of p and q.
    """
    if not critical.mode.any():
        raise InputError("slip_mode: no slip mode was found; the contact has no coupling")
    whole, n = mirror_of(system), system.n
    x, v, w = whole.odd(system.x), whole.odd(critical.mode[:n]), whole.even(critical.mode[n:])
    signs, weight = whole.odd(critical.signs), whole.total(system.weight)
    safe = np.where(weight > 0.0, weight, np.inf)
    q = whole.odd_total(critical.reactions[:n]) / safe
    p = whole.total(critical.reactions[n:]) / safe
    open_ = np.where(signs == 0.0, np.maximum(w, 0.0), 0.0)
    figure = style.new_figure(style.PAGE, 4.0)
    above, below = figure.subplots(2, 1, sharex=True)
    # gap of open nodes, over the largest displacement of a mode, that is drawn
    if open_.max() > 0.01:
        above.fill_between(x, 0.0, open_, color="#c3cad3", label="$w$, open nodes")
    for sign, state in ((1.0, State.FORWARD_SLIP), (-1.0, State.BACKWARD_SLIP)):
        name = "forward" if sign > 0.0 else "backward"
        look = {"color": style.STATE_COLOURS[state], "lw": 1.6}
        above.vlines(x[signs == sign], 0.0, v[signs == sign], **look)
        above.plot([], [], label=f"$v$, {name} assumed", **look)
    above.plot(x, np.where(signs == 0.0, np.nan, v), color="#000000", lw=0.7)
    above.set_ylabel("displacement / largest")
    size = max(float(np.abs(p).max()), float(np.abs(q).max()))
    below.plot(x, p / size, color=style.PRESSURE_COLOUR, label=r"$\dot p$")
    below.plot(x, q / size, color=style.SHEAR_COLOUR, label=r"$\dot q$")
    below.set(xlabel="$x$", ylabel=r"$\dot p$, $\dot q$ / largest")
    title = rf"slip mode at $\varphi f$, $\varphi$ = {critical.factor:.4g}; none below "
    title += rf"$\varphi$ = {critical.lower_bound:.4g}"
    above.set_title(title, loc="left", pad=4.0)
    for axes in (above, below):
        axes.axhline(0.0, **style.GUIDE)
        axes.legend(loc="best")
    return figure


@mpl.rc_context(style.RC)
def draw_search(search: Mapping[str, Any], folder: Path) -> None:
    """Draw twice the estimates of a search over its seconds as ``accuracy.png`` in a folder."""
    way, tolerance = search["way"], search["tolerance"]
    seconds = np.cumsum([level["seconds"] for level in way])
    last = way[-1]["numbers"]
    # the twelve numbers with the largest errors on the last mesh; those without an estimate first
    names = sorted(last, key=lambda name: -(last[name]["relative"] or np.inf))[:12]
    figure = style.new_figure(style.COLUMN, 2.5 + 0.15 * len(names))
    axes = figure.subplots()
    for name, colour, marker in zip(
        names, cycle(style.SERIES_COLOURS), cycle("os^vDP"), strict=False
    ):
        errors = [(level["numbers"].get(name) or {}).get("relative") for level in way]
        doubled = np.array([np.nan if e is None else 2.0 * e for e in errors])
        label = name.replace("_", " ")
        label += " (not converging)" if last[name]["relative"] is None else ""
        axes.loglog(seconds, doubled, f"{marker}-", color=colour, label=label)
    if not any(e["relative"] for level in way for e in level["numbers"].values()):
        axes.set_ylim(0.1 * tolerance, 10.0 * tolerance)
    axes.axhline(tolerance, **style.GUIDE)
    look: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "fontsize": 8}
    look |= {"xycoords": ("axes fraction", "data"), "color": style.INK_OF_GUIDES}
    axes.annotate("tolerance", (1.0, tolerance), xytext=(-3, 2), **look)
    axes.set(xlabel="seconds since the start", ylabel="2 × estimated relative error")
    axes.set_xlim(seconds[0] / 1.5, seconds[-1] * 1.5)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    # ratio of times below which ticks between the powers of ten have labels
    if seconds[-1] < 100.0 * seconds[0]:
        axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="x", which="both", pad=4.0)
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    figure.legend(loc="outside lower left", fontsize=7.5, labelspacing=0.2, borderpad=0.1)
    make_folder(folder)
    style.save(figure, folder / "accuracy.png")
