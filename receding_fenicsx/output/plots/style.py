"""Style of all pictures: colours of states, fonts, sizes.

Forward and backward slip are orange and blue of the Okabe-Ito set, which all kinds of colour vision
distinguish; stick and separation are greys. The four differ in greyscale print too.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cbook import is_math_text
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Patch
from matplotlib.textpath import text_to_path
from matplotlib.ticker import MaxNLocator, MultipleLocator
from numpy.typing import ArrayLike

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.description import STATE_COLOURS as STATE_COLOURS
from receding_fenicsx.interface.law import STATE_NAMES, State
from receding_fenicsx.interface.measures.zones import FRICTIONLESS_CONTACT

# colour of text on each state's fill
STATE_INKS = {state: "#ffffff" if state == State.BACKWARD_SLIP else "#000000" for state in State}
STATE_OF_NAME = {name: state for state, name in STATE_NAMES.items()}  # names as zones have them
PRESSURE_COLOUR, SHEAR_COLOUR = "#000000", "#d55e00"
GUIDE_COLOUR, INK_OF_GUIDES = "#808080", "#505050"
"""Colours of friction cone, reference lines and undeformed outlines, and of secondary text."""
GUIDE: dict[str, Any] = {"color": GUIDE_COLOUR, "dashes": (3, 2), "lw": 0.8}
"""Style of reference lines."""
CONE: dict[str, Any] = {"fc": "#ececec", "ec": GUIDE_COLOUR, "ls": (0, (3, 2)), "lw": 0.7}
"""Style of the friction cone |q| <= f p."""
SERIES_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
COLUMN, PAGE = 3.54, 7.48  # widths in inches of a column (90 mm) and a journal page (190 mm)
DPI, NOTEBOOK_DPI = 300, 150  # of PNG files, and in a notebook
RC: dict[Any, Any] = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 9.0,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.pad": 5.2,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.top": True,
    "ytick.right": True,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
    "axes.unicode_minus": True,
}
"""Settings of Matplotlib; the fonts are part of Matplotlib, so figures are the same everywhere."""


class NotebookFigure(Figure):
    """A figure that needs no window system and that a notebook displays."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        with mpl.rc_context(RC):
            self.savefig(data, format="png", dpi=NOTEBOOK_DPI)
        return data.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches."""
    return NotebookFigure(figsize=(width, height), layout="constrained")


def save(figure: Figure, path: Path) -> None:
    """Save a figure in the format of the path's ending, without the date."""
    ending, dpi = path.suffix[1:], figure.dpi
    if ending not in FigureCanvasAgg.filetypes:
        known = ", ".join(sorted(FigureCanvasAgg.filetypes))
        raise InputError(f"{path}: figures have no format '{ending}'; use one of {known}")
    date = {"pdf": "CreationDate", "svg": "Date"}.get(ending)
    # the PDF writer warns about the dates inside some systems' fonts
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    with mpl.rc_context(RC), new_file(path, overwrite=True) as beside:
        if ending != "png":
            figure.savefig(beside, format=ending, metadata={date: None} if date else None)
            return
        # savefig() draws each figure twice, level 6 takes twice as long for a tenth of the size
        figure.dpi = RC["savefig.dpi"]
        try:
            FigureCanvasAgg(figure).print_png(beside, pil_kwargs={"compress_level": 2})
        finally:
            figure.dpi = dpi


def ticks(axis: Axis, most: int = 5) -> None:
    """Set a largest number of round ticks on an axis."""
    axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))


def focus(p: Array, others: Array) -> tuple[float, float]:
    """Return limits of an axis of p and others that cut off a peak at a corner of the contact."""
    touching = p[p > 0.0]
    top = float(touching.max(initial=0.0))
    # the tractions of a tenth of the contact nodes may belong to the peak at a corner; it is shown
    # up to 2.5 times the others
    usual = 2.5 * float(np.percentile(touching, 90.0)) if len(touching) else 0.0
    low = float(others.min(initial=0.0))
    if top > usual > 0.0:
        low, top = low * usual / top, usual
    room = 0.06 * (top - low) or 1.0
    return low - room, top + room


def phase_axis(axis: Axis) -> None:
    """Label an axis of the angles of a harmonic history in degrees."""
    axis.set_major_locator(MultipleLocator(60.0))
    axis.set_label_text(r"phase $\theta$ (°)")


def wrapped(pieces: Sequence[str], inches: float) -> str:
    """Join pieces of a label by commas, in lines of this width; wider pieces break at spaces."""
    lines: list[str] = []
    for n, piece in enumerate(pieces):
        text = piece + ("," if n + 1 < len(pieces) else "")
        # mathematics has spaces of its own
        words = re.findall(r"(?:\\.|\$(?:\\.|[^$\\])*\$|\S)+", text)
        whole = lines and _width(f"{lines[-1]} {text}") <= inches
        for k, word in enumerate([text] if whole else words):
            longer = not whole and (k == 0 or _width(f"{lines[-1]} {word}") > inches)
            lines = [*lines, word] if longer else [*lines[:-1], f"{lines[-1]} {word}"]
    return "\n".join(lines)


def _width(text: str) -> float:
    """Return the width in inches of one line of a title or the label of an axis."""
    font = FontProperties(family=RC["font.family"], size=RC["axes.titlesize"])
    math = is_math_text(text)
    plain = text if math else text.replace(r"\$", "$")
    return text_to_path.get_text_width_height_descent(plain, font, ismath=math)[0] / 72.0


def state_patches(states: Iterable[int], friction: ArrayLike = True) -> list[Patch]:
    """Return legend entries of states, in order; without friction stick is called contact."""
    labels = {state: f"{state.value}  {STATE_NAMES[state]}" for state in State}
    if not np.all(friction):
        both = f"{labels[State.STICK]}, or {FRICTIONLESS_CONTACT} without friction"
        labels[State.STICK] = both if np.any(friction) else f"1  {FRICTIONLESS_CONTACT}"
    return [
        Patch(fc=STATE_COLOURS[State(s)], ec="black", lw=0.4, label=labels[State(s)])
        for s in sorted({int(s) for s in states})
    ]


def state_mesh(axes: Axes, x: ArrayLike, y: ArrayLike, states: ArrayLike) -> None:
    """Fill the cells of a grid with the colours of states."""
    colours = ListedColormap([STATE_COLOURS[s] for s in State])
    axes.pcolormesh(x, y, states, cmap=colours, vmin=0.5, vmax=4.5, rasterized=True)


def panel_title(n: int, panels: int, text: str) -> str:
    """Return a panel's title, lettered when there are several: a to z, aa, ab and so on."""
    first, last = divmod(n, len(ascii_lowercase))
    letters = (ascii_lowercase[first - 1] if first else "") + ascii_lowercase[last]
    return f"({letters}) {text}" if panels > 1 else text
