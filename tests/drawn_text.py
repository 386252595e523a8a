"""All texts of a figure, whether they can be read, and the states that legends name."""

from __future__ import annotations

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from receding_fenicsx.output.plots import style


def check_texts(figure: Figure, name: str) -> None:
    """Assert that all texts of a figure are on its page and none lies on another."""
    boxes = text_boxes(figure)
    page = figure.bbox
    for i, (text, box) in enumerate(boxes):
        assert page.x0 <= box.x0, f"{name}: {text}"
        assert box.x1 <= page.x1, f"{name}: {text}"
        assert page.y0 <= box.y0, f"{name}: {text}"
        assert box.y1 <= page.y1, f"{name}: {text}"
        for other, beside in boxes[:i]:
            assert not box.overlaps(beside), f"{name}: '{text}' on '{other}'"


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
