"""What a figure shows: its texts, whether they can be read, and the looks of what it draws."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from numpy.typing import ArrayLike

from receding_fenicsx.output.plots import style


def check_page(figure: Figure, name: str) -> None:
    """Assert that no text is on another, legends are beside the axes, curves and ticks in them."""
    boxes, page = text_boxes(figure), figure.bbox
    for i, (text, box) in enumerate(boxes):
        assert page.contains(*box.min) and page.contains(*box.max), f"{name}: {text}"
        for other, beside in boxes[:i]:
            assert not box.overlaps(beside), f"{name}: '{text}' on '{other}'"
    for legend in figure.legends:
        box = legend.get_window_extent()
        assert not any(box.overlaps(axes.bbox) for axes in figure.axes), f"{name}: legend on axes"
    for axes in filter(lambda axes: axes.axison, figure.axes):
        for k, axis in enumerate((axes.xaxis, axes.yaxis)):
            low, high = np.sort(axis.get_view_interval())
            slack, ticks = 1e-9 * (high - low), axis.get_majorticklocs()
            shown = ticks[np.abs(ticks - 0.5 * (low + high)) <= 0.5 * (high - low) + slack]
            assert axis.get_scale() == "log" or 1 != len(shown) < 10, f"{name}: {shown}"
            for line in axes.lines:
                values, moved = np.asarray(line.get_xydata())[:, k], line.get_transform()
                beyond = (values < low - slack) | (values > high + slack)
                free = not moved.contains_branch_seperately(axes.transData)[k]
                assert free or not beyond.any(), f"{name}: {line.get_label()}, {values[beyond]}"


def text_boxes(figure: Figure) -> list:
    """Return every text that is drawn with its box in dots."""
    with mpl.rc_context(style.RC):
        figure.draw_without_rendering()
    hidden = {id(label) for axes in figure.axes for label in labels_beyond(axes)}
    found = []
    for text in figure.findobj(Text):
        shown = text.get_visible() and text.get_text().strip() and id(text) not in hidden
        box = text.get_window_extent()
        if shown and box.width > 0.0:
            found.append((text.get_text(), box))
    return found


def labels_beyond(axes: Axes) -> list[Text]:
    """Return the labels of ticks that lie beyond the axes' limits: they are not drawn."""
    found = []
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        low, high = sorted(limits)
        slack = 1e-9 * (high - low)
        for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
            if not low - slack <= tick.get_loc() <= high + slack:
                found += [tick.label1, tick.label2]
    return found


def names_of_colours(figure: Figure) -> dict[str, str]:
    """Return the name of each state by the colour that the legends of a figure give it."""
    patches = [patch for legend in figure.legends for patch in legend.get_patches()]
    labels = {to_hex(patch.get_facecolor()): str(patch.get_label()) for patch in patches}
    return {colour: label[3:] for colour, label in labels.items() if label[0].isdigit()}


REPORTS = Path(__file__).parent / "output" / "reports"
"""Folder of the texts that tell what figures show."""

NUMBER = re.compile(r"(-?\d+(?:\.\d+)?(?:e[-+]\d+)?)")


def check_words(found: list[str], known: Path) -> None:
    """Assert that lines are those of a file; numbers may differ by a last digit of four."""

    def alike(line: str, other: str) -> bool:
        parts, others = NUMBER.split(line), NUMBER.split(other)
        if parts[::2] != others[::2]:
            return False
        pairs = zip(parts[1::2], others[1::2], strict=True)
        return all(np.isclose(float(a), float(b), rtol=2e-3, atol=1e-12) for a, b in pairs)

    now = Path(tempfile.gettempdir()) / known.name
    lines = known.read_text(encoding="utf-8").splitlines() if known.is_file() else []
    pairs = zip_longest(found, lines, fillvalue="")
    wrong = [pair for pair in pairs if not alike(*pair)]
    if wrong:
        now.write_text("\n".join([*found, ""]), encoding="utf-8")
    assert not wrong[:3], f"{len(wrong)} lines are not those of {known}; all are in {now}"


def check_figures(drawn: Iterable[tuple[str, Figure]], known: Path) -> None:
    """Assert that figures show what a file tells, on their pages, and no text on another."""
    found = []
    for name, figure in drawn:
        check_page(figure, name)
        found += told(figure, name)
    check_words(found, known)


def check_curves(axes: Axes, *known: tuple[ArrayLike, ArrayLike], guides: bool = True) -> None:
    """Assert that the lines of axes are these (x, y), in the order in which they are drawn.

    Without ``guides`` those of two points, and dots, are left out.
    """
    lines = [line for line in axes.lines if guides or len(line.get_xdata()) > 2]  # type: ignore[arg-type]
    lines = [line for line in lines if guides or line.get_linestyle() != "None"]
    assert len(lines) == len(known), [line.get_label() for line in lines]
    for line, both in zip(lines, known, strict=True):
        for drawn, values in zip(line.get_data(), both, strict=True):
            size = float(np.nanmax(np.abs(np.asarray(values, dtype=float)), initial=0.0))
            wide = np.broadcast_to(values, np.shape(drawn))
            here: Any = np.asarray(drawn)
            assert np.allclose(here, wide, 1e-9, 1e-9 * size, equal_nan=True), line.get_label()


def check_area(area: Any, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> None:
    """Assert that an area lies between two curves over x."""
    corners = np.concatenate([path.vertices for path in area.get_paths()])
    for place, *ends in zip(np.asarray(x), np.asarray(low), np.asarray(high), strict=True):
        y = corners[np.isclose(corners[:, 0], place), 1]
        np.testing.assert_allclose([y.min(), y.max()], ends, rtol=1e-9)


def told(figure: Figure, name: str) -> list[str]:
    """Return the words of a figure and the looks of what it draws; where that lies is not told."""
    lines = [f"-- {name}", *(f"text: {t.get_text()}" for t in figure.texts)]
    lines += [_entries(legend) for legend in figure.legends]
    for axes in figure.axes:
        title = f"{axes.get_title()} {axes.get_title(loc='left')}"
        labels = [f"{a.get_scale()} {a.label.get_text()}" for a in (axes.xaxis, axes.yaxis)]
        lines += [f"== {title}", f"axes: {'; '.join(labels)}"] if axes.axison else ["== no axes"]
        lines.append(f"drawn: {'; '.join(sorted(set(_looks(axes))))}")
        if legend := axes.get_legend():
            lines.append(f"inside {_entries(legend)}")
    return [" ".join(line.split()) for line in lines]


def _entries(legend: Legend) -> str:
    """Colours and texts of a legend."""
    found = []
    for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
        own: Any = handle
        colour = own.get_color() if hasattr(own, "get_color") else own.get_facecolor()
        found.append(f"{to_hex(colour)} {text.get_text()}")
    return f"legend: {'; '.join(found)}"


def _looks(axes: Axes) -> Iterator[str]:
    """Curves, areas and texts by their looks."""
    for line in axes.lines:
        if np.isfinite(line.get_xydata()).all(axis=1).any():
            dash = f"{line.get_linestyle()} {line.get_marker()} {line.get_linewidth():.2g}"
            yield f"line {to_hex(line.get_color())} {dash}"
    for shape in axes.collections:
        colours = to_rgba_array(shape.get_facecolor())
        if not len(colours):
            colours = to_rgba_array(shape.get_edgecolor())
        shades = [] if isinstance(shape, QuadMesh) else np.unique(colours, axis=0)
        yield " ".join([type(shape).__name__, *(to_hex(shade) for shade in shades)])
    yield from (f"patch {to_hex(patch.get_facecolor())}" for patch in axes.patches)
    yield from (f"'{text.get_text()}' {to_hex(text.get_color())}" for text in axes.texts)
