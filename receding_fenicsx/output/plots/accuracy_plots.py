"""Figure of a search for a tolerance: error of each number over time."""

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
from receding_fenicsx.output.plots import style

MARKERS = "os^vDP"
HEIGHT, LEGEND_ROW = 2.5, 0.15
"""Height in inches of the figure without its legend, and of a row of that."""


def draw_search(search: Mapping[str, Any], folder: Path) -> Path:
    """Draw a search, the key "accuracy" of a summary, as ``accuracy.png`` in a folder."""
    make_folder(folder)
    path = folder / "accuracy.png"
    with mpl.rc_context(style.RC):
        style.save(error_over_time(search), path)
    return path


def error_over_time(search: Mapping[str, Any]) -> Figure:
    """Draw twice the relative estimates of the asked numbers over the seconds since the start."""
    way = search["way"]
    seconds = np.cumsum([level["seconds"] for level in way])
    last = way[-1]["numbers"]
    # numbers without an estimate first
    # largest number of numbers that are drawn: those with the largest errors on the last mesh
    names = sorted(last, key=lambda name: -(last[name]["relative"] or np.inf))[:12]
    figure = style.new_figure(style.COLUMN, HEIGHT + LEGEND_ROW * len(names))
    axes = figure.subplots()
    looks = zip(cycle(style.SERIES_COLOURS), cycle(MARKERS))
    for name, (colour, marker) in zip(names, looks, strict=False):
        errors = [(level["numbers"].get(name) or {}).get("relative") for level in way]
        doubled = np.array([np.nan if e is None else 2.0 * e for e in errors])
        label = name.replace("_", " ")
        if last[name]["relative"] is None:
            label += " (not converging)"
        axes.loglog(seconds, doubled, f"{marker}-", color=colour, label=label)
    if not any(e["relative"] for level in way for e in level["numbers"].values()):
        axes.set_ylim(0.1 * search["tolerance"], 10.0 * search["tolerance"])
    axes.axhline(search["tolerance"], **style.GUIDE)
    axes.annotate(
        "tolerance",
        (1.0, search["tolerance"]),
        xycoords=("axes fraction", "data"),
        xytext=(-3, 2),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=style.INK_OF_GUIDES,
    )
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
    return figure
