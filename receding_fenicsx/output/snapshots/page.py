"""Page of a picture: rendered field, marks, tractions, colour bar, captions, loads of a film."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist, allow_rasterization
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import position_label
from receding_fenicsx.output.snapshots.body_marks import draw_loads, draw_outlines, draw_states
from receding_fenicsx.output.snapshots.colours import Colours
from receding_fenicsx.output.snapshots.layout import RIGHT, Layout
from receding_fenicsx.output.snapshots.render import Pixels
from receding_fenicsx.output.snapshots.view import View
from receding_fenicsx.scene.units import in_unit

Box = tuple[float, float, float, float]
"""Left, bottom, width and height in inches."""
CLOCK_BOX = (0.22, RIGHT - 0.5)
"""Distance of the curves of the loads from the tractions, and their width, in inches."""
CLOCK_MARGIN = 0.12
"""Room left and right of the curves of the loads in a film, over their length."""


@dataclass(frozen=True)
class Clock:
    """Position of a picture in a film, and what is the same in all pictures of the film.

    Attributes:
        time: (n,) time of the film's pictures, from 0 to 1.
        load: (n, n_loads) load factors at these times, each over its largest value.
        names: names of the loads as mathematics.
        now: time of this picture.
        now_load: (n_loads,) load factors of this picture, each over its largest value.
        tractions: limits of the axis of the tractions in all pictures.
        legend: place of the legend of the tractions in all pictures.
    """

    time: Array
    load: Array
    names: tuple[str, ...]
    now: float
    now_load: Array
    tractions: tuple[float, float]
    legend: str = "upper right"


class PixelImage(Artist):
    """An image with one pixel for each pixel of the page, drawn as it is."""

    def __init__(self, pixels: Pixels, corner: tuple[float, float]) -> None:
        """Place the image with its lower left corner at a point of the page, in inches."""
        super().__init__()
        self.set_zorder(1.0)
        opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
        self.rgba = np.concatenate([pixels, opaque], axis=2)[::-1]
        self.corner = corner

    @allow_rasterization
    def draw(self, renderer: RendererBase) -> None:
        """Draw the image."""
        assert self.figure is not None
        x, y = (round(inches * self.figure.dpi) for inches in self.corner)
        context = renderer.new_gc()
        renderer.draw_image(context, x, y, self.rgba)
        context.restore()


def compose(
    view: View,
    layout: Layout,
    pixels: Pixels,
    colours: Colours,
    clock: Clock | None = None,
    contours: tuple[Array, Array] | None = None,
) -> Figure:
    """Draw the page around the rendered field.

    Args:
        view: body and contact at the instant.
        layout: layout of the page.
        pixels: the rendered field.
        colours: its colours.
        clock: position in a film; None for a single picture.
        contours: field at the vertices, and the values at which contour lines are drawn.

    Returns:
        The page.
    """
    figure = Figure(figsize=(layout.width, layout.height), dpi=layout.dpi)
    body = _axes_at(figure, layout.body)
    body.add_artist(PixelImage(pixels, layout.body[:2]))
    if contours is not None:
        _draw_contours(body, view, *contours, layout.dpi)
    body.set_xlim(layout.window[0], layout.window[1])
    body.set_ylim(layout.window[2], layout.window[3])
    body.set_axis_off()
    draw_outlines(body, view)
    draw_states(body, view)
    draw_loads(body, view)
    _draw_tractions(_axes_at(figure, layout.tractions), view, layout, clock)
    if clock is not None:
        left, bottom, width, height = layout.tractions
        gap, wide = CLOCK_BOX
        box = (left + width + gap, bottom, wide, height)
        _draw_clock(_axes_at(figure, box), clock)
    _draw_colour_bar(figure, view, layout, colours)
    note = f"{colours.note} {view.stress_unit}" if colours.note else ""
    _write_captions(figure, view, layout, note.rstrip())
    return figure


def _draw_contours(axes: Axes, view: View, values: Array, levels: Array, dpi: float) -> None:
    """Draw the contour lines of a field."""
    inside = levels[(values.min() < levels) & (levels < values.max())]
    if not len(inside):
        return
    cells = view.cells
    if cells.shape[1] > 3:
        cells = np.vstack([cells[:, :3], cells[:, [0, 2, 3]]])
    # width of a contour line in pixels
    axes.tricontour(
        Triangulation(view.moved[:, 0], view.moved[:, 1], cells),
        values,
        levels=inside,
        colors="black",
        alpha=0.5,
        linewidths=72.0 / dpi,
        linestyles="solid",
        zorder=1.5,
    )


def _axes_at(figure: Figure, box: Box) -> Axes:
    """Add axes in a box of a page."""
    page = figure.get_size_inches()
    left, bottom, width, height = (a / b for a, b in zip(box, (*page, *page), strict=True))
    return figure.add_axes((left, bottom, width, height))


def _draw_colour_bar(figure: Figure, view: View, layout: Layout, colours: Colours) -> None:
    """Draw the colour bar beside the body, as high as the body, from its top downwards."""
    left, foot, width, height = layout.body
    *_, bottom, top = layout.window
    scale = height / (top - bottom)
    ends = np.clip([view.moved[:, 1].min(), view.moved[:, 1].max()], bottom, top)
    # smallest height of a colour bar in inches: room for its label. Beside a flat body it reaches
    # down beside the tractions
    tall = max(scale * float(ends[1] - ends[0]), 0.7)
    base = foot + scale * float(ends[1] - bottom) - tall
    bar = figure.colorbar(
        ScalarMappable(Normalize(*colours.limits), ListedColormap(colours.table.tolist())),
        cax=_axes_at(figure, (left + width + 0.1, base, 0.13, tall)),
        label=in_unit(colours.label, view.stress_unit),
        extend=colours.extend,
        extendfrac=0.03,
    )
    # labels of a flat body's colour bar would overlap
    # smallest distance in inches of the labels of a colour bar
    # largest number of labels of a colour bar
    labels = min(max(int(tall / 0.18), 1), 6)
    bar.locator = MaxNLocator(labels, steps=[1, 2, 2.5, 5, 10])
    bar.update_ticks()
    bar.ax.tick_params(direction="out", right=True)


def _write_captions(figure: Figure, view: View, layout: Layout, note: str) -> None:
    """Write instant and exaggeration above the body, the legend of the states below the page."""
    left, _, width, _ = layout.body
    top = 1.0 - 0.08 / layout.height
    begin, end = left / layout.width, (left + width) / layout.width
    figure.text(begin, top, view.caption, ha="left", va="top")
    moved = f"displacements × {view.factor:g}"
    moved = f"{note}, {moved}" if note else moved
    figure.text(end, top, moved, ha="right", va="top", color=style.INK_OF_GUIDES)
    present = view.f.present if len(view.strips) == 1 else view.friction
    figure.legend(
        handles=style.state_patches([1, 2, 3, 4] if view.friction else [1, 2], present),
        loc="lower center",
        bbox_to_anchor=(0.5 * (begin + end), 0.0),
        ncols=4,
        columnspacing=1.6,
    )


def _draw_clock(axes: Axes, clock: Clock) -> None:
    """Draw the loads over the film's time, with a dot at the time of the picture."""
    for k, name in enumerate(clock.names):
        colour = "black" if len(clock.names) == 1 else style.SERIES_COLOURS[k % 6]
        axes.plot(clock.time, clock.load[:, k], color=colour, lw=0.9, label=name)
        axes.plot(clock.now, clock.now_load[k], "o", color=colour, ms=5.0, clip_on=False)
    # keep the dots clear of the numbers at the axis
    axes.set_xlim(-CLOCK_MARGIN, 1.0 + CLOCK_MARGIN)
    axes.set_xticks([])
    low, high = min(0.0, float(clock.load.min())), max(0.0, float(clock.load.max()))
    room = 0.06 * (high - low)
    axes.set_ylim(low - room, high + room)
    axes.yaxis.tick_right()
    ticks = sorted({low, high})
    axes.set_yticks(ticks, [f"${value:z.2g}$" for value in ticks])
    # "-0.33" has to fit between the axes and the edge of the page
    axes.tick_params(left=False, pad=2.0, labelsize=6.5)
    if len(clock.names) == 1:
        # a word is wider than these axes
        between = "\n" if r"\mathrm" in clock.names[0] else " "
        axes.set_xlabel(f"{clock.names[0]}{between}over time", labelpad=3.0)
    else:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), fontsize=7.0, labelspacing=0.2)


def traction_limits(view: View) -> tuple[float, float]:
    """Return the limits of an axis of p, q and the friction limits, at the nodes with weight."""
    known = np.isfinite(view.p)
    p, q = view.p[known], view.q[known]
    return style.focus(p, np.concatenate([q, *view.f[known].limits(p)]))


def _draw_tractions(axes: Axes, view: View, layout: Layout, clock: Clock | None) -> None:
    """Draw p, q and the friction limits along the first contact edge.

    Below a horizontal edge each position stands under its place in the picture.
    """
    known = np.isfinite(view.p)
    divided = f"/{view.pressure_symbol}" if view.pressure_symbol else ""
    axes.axhline(0.0, color="black", lw=0.4)
    low, high = view.f[known].limits(view.p[known])
    curves = [(view.p, style.PRESSURE_COLOUR, "p")]
    if view.friction:
        curves.append((view.q, style.SHEAR_COLOUR, "q"))
        axes.fill_between(view.x[known], low, high, **style.CONE)
    for _, begin, _ in zones(view.x, view.state)[1:]:
        axes.axvline(begin, color=style.GUIDE_COLOUR, lw=0.4, dashes=(1, 2))
    for values, colour, name in curves:
        axes.plot(view.x[known], values[known], color=colour, label=f"${name}{divided}$")
    axes.set_ylim(*(traction_limits(view) if clock is None else clock.tractions))
    strip = view.strips[0]
    if abs(strip.normal[1]) == 1.0:
        shown = (np.array(layout.window[:2]) - strip.place[0, 0]) / strip.direction[0] + strip.x[0]
        axes.set_xlim(shown[0], shown[1])
    else:
        axes.set_xlim(strip.x[0], strip.x[-1])
    # one place in all pictures of a film
    place = "best" if clock is None else clock.legend
    axes.legend(loc=place, borderaxespad=0.2, handlelength=1.2)  # type: ignore[call-overload]
    label = position_label(view.length_symbol, view.radial, view.own_units)
    which = f" on {view.strips[0].name}" if len(view.strips) > 1 else ""
    axes.set_xlabel(label + which, labelpad=1.0)
    symbols = ",  ".join(f"${name}{divided}$" for *_, name in curves)
    axes.set_ylabel(in_unit(symbols, view.stress_unit))
    style.ticks(axes.yaxis, 5)
