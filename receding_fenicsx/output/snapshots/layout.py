"""The page around a rendered field: outlines, plane, loads, states, tractions, colour bar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from receding_fenicsx.interface.law import STATE_NAMES
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.interface.system import Array
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.units import position_label
from receding_fenicsx.output.snapshots.render import Pixels
from receding_fenicsx.output.snapshots.view import Strip, View

STATE_OF_NAME = {name: state for state, name in STATE_NAMES.items()}
INK = "#202020"

LEFT, RIGHT = 0.62, 0.98
"""Inches beside the body: axis of the tractions, colour bar."""
TICK_HEIGHT = 0.18
"""Inches of a colour bar for each of its labels: those of a flat body would lie on each other."""
ABOVE, BETWEEN, TRACTIONS, BELOW = 0.3, 0.06, 0.95, 0.64
"""Inches above the body, between body and tractions, of the tractions, below them."""
TALLEST = 4.5
"""Inches that the body may be high."""
BAND = (0.03, 0.115)
"""Distance of the band of states from the contact edge, over the body's smaller extent."""
THINNEST = 0.13
"""Inches that the band is high at least."""
NEAR = 1.5
"""How far from its middle a small contact's surroundings are shown, over its length."""
ENDS = 1e-6
"""Part of the body's length that a contact edge along the whole of it may be shorter."""
NUMBERED = 0.025
"""Part of the contact edge that a zone must cover to have its number in the band."""


@dataclass(frozen=True)
class Colours:
    """How a field is coloured.

    Attributes:
        limits: values of the first and the last colour.
        table: (k, 3 or 4) colours in [0, 1].
        label: what the field is.
        note: what else is to be said of the colours, or "".
        extend: "neither", "min", "max" or "both": values beyond the limits occur.
    """

    limits: tuple[float, float]
    table: Array
    label: str
    note: str
    extend: str


@dataclass(frozen=True)
class Layout:
    """Where things are on the page, in inches, and which part of the plane the body's axes show.

    Attributes:
        width, height: of the page.
        body: left, bottom, width and height of the body's axes.
        tractions: likewise of the tractions'.
        window: left, right, bottom and top in units of the view.
        dpi: dots per inch.
    """

    width: float
    height: float
    body: tuple[float, float, float, float]
    tractions: tuple[float, float, float, float]
    window: tuple[float, float, float, float]
    dpi: float

    def shows(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether points (n, 2) are within the body's axes."""
        left, right, bottom, top = self.window
        x, y = points.T
        return (left <= x) & (x <= right) & (bottom <= y) & (y <= top)

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the body's axes in dots."""
        return round(self.body[2] * self.dpi), round(self.body[3] * self.dpi)


DIAL_ROOM = 0.12
"""Room beside the ends of the time in the dial of a film, over the time."""


@dataclass(frozen=True)
class Clock:
    """Where a picture stands in a film.

    Attributes:
        time: (n,) progress of the film at the ends of its legs and between.
        load: (n, n_loads) each load over its largest value then.
        names: the loads' names as mathematics.
        now: progress at the picture.
        now_load: (n_loads,) loads over their largest values at the picture.
        tractions: limits of the tractions' axis.
        legend: where the legend of the tractions lies on none of them in any picture.
    """

    time: Array
    load: Array
    names: tuple[str, ...]
    now: float
    now_load: Array
    tractions: tuple[float, float]
    legend: str = "upper right"


def layout_of(*views: View, dpi: float = style.DPI) -> Layout:
    """Arrange a page that suits one view, or several of the same body."""
    corners = np.vstack([_corners(view) for view in views])
    margin = 0.03 * views[0].size
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    if views[0].near:
        around = _span(views[0])
        low, high = np.maximum(low, around[0]), np.minimum(high, around[1])
    width = style.PAGE - LEFT - RIGHT
    scale = min(width / (high[0] - low[0]), TALLEST / (high[1] - low[1]))
    # a narrow body stands in the middle
    spare = 0.5 * (width / scale - (high[0] - low[0]))
    low[0], high[0] = low[0] - spare, high[0] + spare
    height = float(scale * (high[1] - low[1]))
    bottom = BELOW + TRACTIONS + BETWEEN
    return Layout(
        width=style.PAGE,
        height=bottom + height + ABOVE,
        body=(LEFT, bottom, width, height),
        tractions=(LEFT, BELOW, width, TRACTIONS),
        window=(float(low[0]), float(high[0]), float(low[1]), float(high[1])),
        dpi=dpi,
    )


def _corners(view: View) -> Array:
    """(2, 2) lowest and highest coordinates of all that is drawn of a view."""
    shown = [view.points, view.moved]
    if view.rigid:
        shown += [strip.place - _band(view, strip)[1] * strip.normal for strip in view.strips]
    shown += [end for arrows in view.arrows for end in (arrows.tails, arrows.heads)]
    points = np.vstack(shown)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def compose(
    view: View, layout: Layout, pixels: Pixels, colours: Colours, clock: Clock | None = None
) -> Figure:
    """Put the page together around the rendered field.

    Args:
        view: what is shown.
        layout: where.
        pixels: the field.
        colours: its colours.
        clock: place in a film, if it is of one.

    Returns:
        The page.
    """
    figure = Figure(figsize=(layout.width, layout.height), dpi=layout.dpi)
    page = (layout.width, layout.height) * 2

    def axes_at(box: tuple[float, float, float, float]) -> Axes:
        left, bottom, width, height = (a / b for a, b in zip(box, page, strict=True))
        return figure.add_axes((left, bottom, width, height))

    body = axes_at(layout.body)
    body.imshow(pixels, extent=layout.window, interpolation="antialiased", aspect="auto", zorder=1)
    body.set_xlim(layout.window[0], layout.window[1])
    body.set_ylim(layout.window[2], layout.window[3])
    body.set_axis_off()
    _draw_outlines(body, view)
    _draw_band(body, view)
    _draw_loads(body, view)
    _draw_tractions(axes_at(layout.tractions), view, layout, clock)
    if clock is not None:
        left, bottom, width, height = layout.tractions
        _draw_clock(axes_at((left + width + 0.22, bottom, RIGHT - 0.45, height)), clock)
    left, _, width, height = layout.body
    scale = height / (layout.window[3] - layout.window[2])
    ends = np.clip(
        [view.moved[:, 1].min(), view.moved[:, 1].max()], layout.window[2], layout.window[3]
    )
    base = layout.body[1] + scale * float(ends[0] - layout.window[2])
    tall = scale * float(ends[1] - ends[0])
    bar = figure.colorbar(
        ScalarMappable(Normalize(*colours.limits), ListedColormap(colours.table.tolist())),
        cax=axes_at((left + width + 0.1, base, 0.13, tall)),
        label=colours.label,
        extend=colours.extend,
        extendfrac=0.03,
    )
    most = min(max(int(tall / TICK_HEIGHT), 1), 6)
    bar.locator = MaxNLocator(most, steps=[1, 2, 2.5, 5, 10])
    bar.update_ticks()
    bar.ax.tick_params(direction="out", right=True)
    top = 1.0 - 0.08 / layout.height
    begin, end = left / layout.width, (left + width) / layout.width
    figure.text(begin, top, view.caption, ha="left", va="top")
    moved = f"displacements × {view.factor:g}"
    moved = f"{colours.note}, {moved}" if colours.note else moved
    figure.text(end, top, moved, ha="right", va="top", color=style.INK_OF_GUIDES)
    figure.legend(
        handles=style.state_patches([1, 2, 3, 4] if view.friction else [1, 2], view.friction),
        loc="lower center",
        bbox_to_anchor=(0.5 * (begin + end), 0.0),
        ncols=4,
        columnspacing=1.6,
    )
    return figure


def _draw_outlines(axes: Axes, view: View) -> None:
    """Draw the outline before and after deformation, and the plane below the contact edge."""
    before = LineCollection(list(view.points[view.edges]), colors=style.GUIDE_COLOUR)
    before.set(linewidths=0.6, linestyles=[(0, (3, 2))], zorder=2)
    after = LineCollection(list(view.moved[view.edges]), colors="black", capstyle="round")
    after.set(linewidths=0.8, zorder=3)
    axes.add_collection(before)
    axes.add_collection(after)
    for strip in view.strips if view.rigid else ():
        _draw_plane(axes, view, strip)


def _draw_plane(axes: Axes, view: View, strip: Strip) -> None:
    """Draw the rigid plane below a contact edge; the only one goes on beyond the edge."""
    direction, first = strip.direction, strip.place[0]
    shown = view.points if len(view.strips) == 1 else strip.place
    along = (shown - first) @ direction
    ends = np.array([along.min() - 0.05 * view.size, along.max() + 0.05 * view.size])
    bare = first + ends[:, None] * direction - strip.gap[[0, -1], None] * strip.normal
    plane = strip.place - strip.gap[:, None] * strip.normal
    if np.ptp(strip.x) > (1.0 - ENDS) * np.ptp(along):
        # of a shorter contact edge it is not known what the body would meet beyond it
        plane = np.vstack([bare[:1], plane, bare[1:]])
    plane = plane - 0.01 * view.size * strip.normal
    axes.plot(plane[:, 0], plane[:, 1], color="black", lw=1.3, zorder=4, clip_on=view.near)


def _band(view: View, strip: Strip) -> tuple[float, float]:
    """Distances of the band of states from the contact edge; it stands clear of the plane."""
    below = float(strip.gap.max())
    inner, outer = (part * view.size for part in BAND)
    inch = float(np.ptp(_span(view)[:, 0])) / (style.PAGE - LEFT - RIGHT)
    return below + inner, below + max(outer, inner + THINNEST * inch)


def _span(view: View) -> Array:
    """(2, 2) lowest and highest coordinates of what a view shows of the body."""
    if not view.near:
        return np.stack([view.points.min(axis=0), view.points.max(axis=0)])
    places = np.vstack([strip.place for strip in view.strips])
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    reach = NEAR * float(np.linalg.norm(np.ptp(places, axis=0)))
    return np.stack([middle - reach, middle + reach])


def _draw_band(axes: Axes, view: View) -> None:
    """Draw the states: as a band below the plane, or as a coloured line between two bodies."""
    for strip in view.strips:
        if view.rigid:
            _draw_boxes(axes, view, strip)
        else:
            _draw_line(axes, strip)


def _draw_line(axes: Axes, strip: Strip) -> None:
    """Draw the states between two bodies as a line in their colours."""
    found = zones(strip.x, strip.state)
    pieces = []
    for _, a, b in found:
        x = np.concatenate([[a], strip.x[(strip.x > a) & (strip.x < b)], [b]])
        pieces.append(np.stack([np.interp(x, strip.x, part) for part in strip.moved.T], axis=1))
    colours = [style.STATE_COLOURS[STATE_OF_NAME[name]] for name, _, _ in found]
    whole = LineCollection(pieces, colors="black", linewidths=4.4, capstyle="butt", zorder=4)
    axes.add_collection(whole)
    line = LineCollection(pieces, colors=colours, linewidths=3.4, capstyle="butt", zorder=5)
    axes.add_collection(line)


def _draw_boxes(axes: Axes, view: View, strip: Strip) -> None:
    """Draw the states as a band below the plane, with their numbers."""
    foot = strip.place[0] - strip.x[0] * strip.direction
    inner, outer = (depth * strip.normal for depth in _band(view, strip))
    boxes, fills = [], []
    for name, a, b in zones(strip.x, strip.state):
        state = STATE_OF_NAME[name]
        ends = foot + np.array([[a], [b]]) * strip.direction
        boxes.append(np.vstack([ends - inner, ends[::-1] - outer]))
        fills.append(style.STATE_COLOURS[state])
        if b - a > NUMBERED * np.ptp(strip.x):
            middle = boxes[-1].mean(axis=0)
            axes.annotate(
                str(int(state)),
                middle,
                xytext=(0.0, -0.3),
                textcoords="offset points",
                ha="center",
                va="center_baseline",
                fontsize=7.0,
                color=style.STATE_INKS[state],
                zorder=6,
            )
    axes.add_collection(
        PolyCollection(boxes, facecolors=fills, edgecolors="black", linewidths=0.4, zorder=5)
    )


def _draw_loads(axes: Axes, view: View) -> None:
    for arrows in view.arrows:
        for tail, head in zip(arrows.tails, arrows.heads, strict=True):
            if view.near and not axes.viewLim.contains(*head):
                continue
            axes.annotate(
                "",
                head,
                xytext=tail,
                zorder=7,
                annotation_clip=False,
                arrowprops={
                    "arrowstyle": "-|>,head_length=0.35,head_width=0.14",
                    "lw": 0.8,
                    "color": INK,
                    "shrinkA": 0.0,
                    "shrinkB": 0.0,
                },
            )
        if arrows.joined:
            axes.plot(*arrows.tails.T, color=INK, lw=0.8, zorder=7)


def _draw_clock(axes: Axes, clock: Clock) -> None:
    """Draw the loads over the film's time, and where it stands."""
    for k, name in enumerate(clock.names):
        colour = "black" if len(clock.names) == 1 else style.SERIES_COLOURS[k % 6]
        axes.plot(clock.time, clock.load[:, k], color=colour, lw=0.9, label=name)
        axes.plot(clock.now, clock.now_load[k], "o", color=colour, ms=5.0, clip_on=False)
    # the dots stay clear of the numbers beside the dial
    axes.set_xlim(-DIAL_ROOM, 1.0 + DIAL_ROOM)
    axes.set_xticks([])
    low, high = min(0.0, float(clock.load.min())), max(0.0, float(clock.load.max()))
    room = 0.06 * (high - low)
    axes.set_ylim(low - room, high + room)
    axes.yaxis.tick_right()
    axes.set_yticks(sorted({low, high}))
    axes.tick_params(left=False, pad=2.0)
    if len(clock.names) == 1:
        # a word is wider than the dial
        between = "\n" if r"\mathrm" in clock.names[0] else " "
        axes.set_xlabel(f"{clock.names[0]}{between}over time", labelpad=3.0)
    else:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), fontsize=7.0, labelspacing=0.2)


def _draw_tractions(axes: Axes, view: View, layout: Layout, clock: Clock | None) -> None:
    """Draw p, q and the friction cone along the edge, below the body where that edge is level."""
    known = np.isfinite(view.p)
    divided = f"/{view.pressure_symbol}" if view.pressure_symbol else ""
    axes.axhline(0.0, color="black", lw=0.4)
    limit = (view.f * view.p)[known]
    curves = [(view.p, style.PRESSURE_COLOUR, "p")]
    if view.friction:
        curves.append((view.q, style.SHEAR_COLOUR, "q"))
        axes.fill_between(view.x[known], -limit, limit, **style.CONE)
    for _, begin, _ in zones(view.x, view.state)[1:]:
        axes.axvline(begin, color=style.GUIDE_COLOUR, lw=0.4, dashes=(1, 2))
    for values, colour, name in curves:
        axes.plot(view.x[known], values[known], color=colour, label=f"${name}{divided}$")
    if clock is None:
        others = np.concatenate([view.q[known], limit, -limit])
        axes.set_ylim(*style.focus(view.p[known], others))
    else:
        axes.set_ylim(*clock.tractions)
    strip = view.strips[0]
    if abs(strip.normal[1]) == 1.0:
        # below the picture, each position under its place
        shown = (np.array(layout.window[:2]) - strip.place[0, 0]) / strip.direction[0] + strip.x[0]
        axes.set_xlim(shown[0], shown[1])
    else:
        axes.set_xlim(strip.x[0], strip.x[-1])
    # in a film the legend must not jump
    place = "best" if clock is None else clock.legend
    axes.legend(loc=place, borderaxespad=0.2, handlelength=1.2)  # type: ignore[call-overload]
    label = position_label(view.length_symbol, view.axisymmetric)
    which = f" on {view.strips[0].name}" if len(view.strips) > 1 else ""
    axes.set_xlabel(label + which, labelpad=1.0)
    axes.set_ylabel(",  ".join(f"${name}{divided}$" for *_, name in curves))
    style.ticks(axes.yaxis, 5)
