"""Page of a picture: colours of the field, marks, tractions, captions, loads of a film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import MOST_TOLD
from receding_fenicsx.output.plots.traction_plots import draw_tractions
from receding_fenicsx.output.snapshots.render import Pixels
from receding_fenicsx.output.snapshots.view import Strip, View, outline
from receding_fenicsx.scene.options import in_unit


@dataclass(frozen=True)
class Quantity:
    """A stress as pictures show it."""

    name: str  # key in :attr:`Fields.stress`
    symbol: str  # its symbol as mathematics
    signed: bool = True  # the sign has a meaning: the middle of the colours is zero stress
    fringes: bool = False  # shown as light and dark fringes


QUANTITIES = (
    Quantity("von_mises", r"\sigma_\mathrm{Mises}", signed=False),
    Quantity("sxx", r"\sigma_{xx}"),
    Quantity("syy", r"\sigma_{yy}"),
    Quantity("sxy", r"\sigma_{xy}"),
    Quantity("max_shear", r"2\tau_\mathrm{max}", signed=False, fringes=True),
)


def quantity_of(name: str) -> Quantity:
    """Return the stress with this name; raise InputError if it is unknown."""
    known = {quantity.name: quantity for quantity in QUANTITIES}
    if name not in known:
        raise InputError(f"stress '{name}': is unknown; use one of {', '.join(known)}")
    return known[name]


@dataclass(frozen=True)
class Colours:
    """Colours of a field."""

    limits: tuple[float, float]  # values of the first and the last colour
    table: Array  # (k, 3 or 4) colours in [0, 1]
    label: str  # label of the colour bar
    note: str  # stress of one fringe, or ""
    extend: str = "neither"  # where values lie beyond the limits: or "min", "max", "both"
    levels: Array = field(default_factory=lambda: np.empty(0))  # values of contour lines


def colours_of(
    values: Array, quantity: Quantity, pressure_symbol: str, areas: Array | None = None
) -> Colours:
    """Choose colours and contour lines (not of fringes) of a field (n,) at vertices with areas."""
    # a large body is almost free of stress far from its load: less than 0.02 of the largest does
    # not affect the range, from whose ends half a per cent of the area may lie beyond, as singular
    # points would take most of it
    order = np.argsort(values, kind="stable")
    order = order[np.abs(values[order]) > 0.02 * np.abs(values).max(initial=0.0)]
    low, high = 0.0, 0.0
    if len(order):
        weights = np.ones(len(order)) if areas is None else areas[order]
        below = np.cumsum(weights) - 0.5 * weights
        ends = np.array([0.005, 0.995]) * weights.sum()
        low, high = np.interp(ends, below, values[order]).tolist()
    divided = f"/{pressure_symbol}" if pressure_symbol else ""
    label = f"${quantity.symbol}{divided}$"
    if quantity.fringes:
        fringe = fringe_value(high)
        limits = (0.0, max(float(values.max()), fringe))
        grey = np.cos(np.pi * np.linspace(0.0, limits[1] / fringe, 4096)) ** 2
        note = f"one fringe {fringe:g}" + (rf"$\,{pressure_symbol}$" if pressure_symbol else "")
        return Colours(limits, np.stack([grey] * 3, axis=1), label, note)
    # zero is always part of the range
    low, high = min(low, 0.0), max(high, 0.0)
    largest = max(-low, high) or 1.0
    if high - low == 0.0:
        high = largest
    part = np.linspace(low, high, 256) / largest
    blue_to_red, one_sided = mpl.colormaps["RdBu_r"], mpl.colormaps["viridis"]
    table = blue_to_red(0.5 + 0.5 * part) if quantity.signed else one_sided(part)
    beyond = int(values.max() > high) + 2 * int(values.min() < low)
    extend = ("neither", "max", "min", "both")[beyond]
    # about nine contour lines
    levels = np.asarray(MaxNLocator(9).tick_values(low, high))
    return Colours((low, high), table, label, "", extend, levels)


def fringe_value(largest: float) -> float:
    """Return a round stress of one fringe, of which at least ten fit the largest value."""
    if largest <= 0.0:
        return 1.0
    part = 0.1 * largest * (1.0 + 1e-9)
    power = 10.0 ** np.floor(np.log10(part))
    return float(max(k * power for k in (1.0, 2.0, 5.0) if k * power <= part))


# inches: left of all axes and their width, which leaves 0.98 for the colour bar or a film's loads;
# foot and height of the axes of the tractions, foot of the body's axes
LEFT, WIDTH = 0.62, style.PAGE - 0.62 - 0.98
LOW, TRACTIONS, FOOT = 0.64, 0.95, 0.64 + 0.95 + 0.06


@dataclass(frozen=True)
class Layout:
    """Size of a page, and the part of the plane that the body's axes show."""

    # left, right, bottom and top of the body's axes in the view's coordinates
    window: tuple[float, float, float, float]
    height: float  # of the body's axes in inches
    dpi: float  # dots per inch

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the body's axes in pixels."""
        return round(WIDTH * self.dpi), round(self.height * self.dpi)


def layout_of(*views: View, dpi: float = style.DPI) -> Layout:
    """Return the layout of a page for one view, or for several views of the same body."""
    shown = []
    for view in views:
        shown += [view.points, view.moved]
        shown += [end for arrows in view.arrows for end in (arrows.tails, arrows.heads)]
        rigid = [strip for strip in view.strips if strip.rigid]
        shown += [strip.place - band_depths(view, strip)[1] * strip.normal for strip in rigid]
    margin, everything = 0.03 * views[0].size, np.vstack(shown)
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    if views[0].near:
        around = visible_box(views[0])
        low, high = np.maximum(low, around[0]), np.minimum(high, around[1])
    # at most 4.5 inches high
    scale = min(WIDTH / (high[0] - low[0]), 4.5 / (high[1] - low[1]))
    # a narrow body is centred
    spare = 0.5 * (WIDTH / scale - (high[0] - low[0]))
    window = float(low[0] - spare), float(high[0] + spare), float(low[1]), float(high[1])
    return Layout(window, float(scale * (high[1] - low[1])), dpi)


def band_depths(view: View, strip: Strip) -> tuple[float, float]:
    """Return the distances of the band of states from the contact edge, below the plane."""
    below = float(strip.gap.max())
    inner, outer = 0.03 * view.size, 0.115 * view.size
    inch = float(np.ptp(visible_box(view)[:, 0])) / WIDTH
    # smallest height of the band of states in inches
    return below + inner, below + max(outer, inner + 0.13 * inch)


def visible_box(view: View) -> Array:
    """Return (2, 2) lowest and highest coordinates of the part of the body that a view shows."""
    if not view.near:
        return np.stack([view.points.min(axis=0), view.points.max(axis=0)])
    places = np.vstack([strip.place for strip in view.strips])
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    # half the width of a close-up of a small contact, over the contact's length
    reach = 1.5 * float(np.linalg.norm(np.ptp(places, axis=0)))
    return np.stack([middle - reach, middle + reach])


@dataclass(frozen=True)
class Clock:
    """Position of a picture in a film, and what is the same in all pictures of the film."""

    time: Array  # (n,) time of the film's pictures, from 0 to 1
    load: Array  # (n, n_loads) load factors at these times, each over its largest value
    names: tuple[str, ...]  # names of the loads as mathematics
    now: float  # time of this picture
    now_load: Array  # (n_loads,) load factors of this picture, each over its largest value
    tractions: tuple[float, float]  # limits of the axis of the tractions in all pictures
    legend: str = "upper right"  # place of the legend of the tractions in all pictures


def compose(
    view: View,
    layout: Layout,
    pixels: Pixels,
    colours: Colours,
    clock: Clock | None = None,
    values: Array | None = None,
) -> Figure:
    """Draw the page around the image of the field, whose values have contour lines."""
    figure = Figure(figsize=(style.PAGE, FOOT + layout.height + 0.3), dpi=layout.dpi)
    body = _axes_at(figure, (LEFT, FOOT, WIDTH, layout.height))
    # one pixel of the image for each of the page, behind the axes
    figure.figimage(pixels, round(LEFT * layout.dpi), round(FOOT * layout.dpi), zorder=-1)
    levels = colours.levels
    if values is not None and np.any(lines := (values.min() < levels) & (levels < values.max())):
        parts = ([0, 1, 2], [0, 2, 3])[: view.cells.shape[1] - 2]
        cells = np.vstack([view.cells[:, part] for part in parts])
        mesh = Triangulation(view.moved[:, 0], view.moved[:, 1], cells)
        look: dict[str, Any] = {"colors": "black", "alpha": 0.5, "linestyles": "solid"}
        look |= {"linewidths": 72.0 / layout.dpi, "zorder": 1.5}  # a pixel
        body.tricontour(mesh, values, levels=levels[lines], **look)
    body.set_xlim(layout.window[0], layout.window[1])
    body.set_ylim(layout.window[2], layout.window[3])
    body.set_axis_off()
    edges = outline(view.cells)
    before, after = list(view.points[edges]), list(view.moved[edges])
    dashed: dict[str, Any] = {"colors": style.GUIDE_COLOUR, "linestyles": [(0, (3, 2))]}
    body.add_collection(LineCollection(before, linewidths=0.6, zorder=2, **dashed))
    whole = LineCollection(after, colors="black", capstyle="round", linewidths=0.8, zorder=3)
    body.add_collection(whole)
    for strip in view.strips:
        if strip.rigid:
            _draw_plane(body, view, strip)
        else:
            _draw_line(body, strip)
    _draw_loads(body, view)
    _draw_tractions(_axes_at(figure, (LEFT, LOW, WIDTH, TRACTIONS)), view, layout, clock)
    if clock is not None:
        # right of the tractions
        _draw_clock(_axes_at(figure, (LEFT + WIDTH + 0.22, LOW, 0.48, TRACTIONS)), clock)
    _draw_colour_bar(figure, view, layout, colours)
    # instant and exaggeration above the body, the legend of the states below the page
    top, begin, end = 1.0 - 0.08 / figure.get_figheight(), LEFT / style.PAGE, LEFT + WIDTH
    figure.text(begin, top, view.caption, ha="left", va="top")
    note = f"{colours.note} {view.stress_unit}".rstrip() + ", " if colours.note else ""
    right = f"{note}displacements × {view.factor:g}"
    ink = style.INK_OF_GUIDES
    figure.text(end / style.PAGE, top, right, ha="right", va="top", color=ink)
    present = view.f.present if len(view.strips) == 1 else view.friction
    patches = style.state_patches([1, 2, 3, 4] if view.friction else [1, 2], present)
    place = (LEFT + 0.5 * WIDTH) / style.PAGE, 0.0
    look = {"loc": "lower center", "bbox_to_anchor": place, "columnspacing": 1.6}
    figure.legend(handles=patches, ncols=4, **look)
    return figure


def _axes_at(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Add axes in a box (left, bottom, width, height) of a page, in inches."""
    page = figure.get_size_inches()
    left, bottom, width, height = (a / b for a, b in zip(box, (*page, *page), strict=True))
    return figure.add_axes((left, bottom, width, height))


def _draw_colour_bar(figure: Figure, view: View, layout: Layout, colours: Colours) -> None:
    """Draw the colour bar beside the body, as high as the body, from its top downwards."""
    *_, bottom, top = layout.window
    scale = layout.height / (top - bottom)
    ends = np.clip([view.moved[:, 1].min(), view.moved[:, 1].max()], bottom, top)
    # 0.7 inches have room for its label; beside a flat body it reaches down beside the tractions
    tall = max(scale * float(ends[1] - ends[0]), 0.7)
    base = FOOT + scale * float(ends[1] - bottom) - tall
    bar = figure.colorbar(
        ScalarMappable(Normalize(*colours.limits), ListedColormap(colours.table.tolist())),
        cax=_axes_at(figure, (LEFT + WIDTH + 0.1, base, 0.13, tall)),
        label=in_unit(colours.label, view.stress_unit),
        extend=colours.extend,
        extendfrac=0.03,
    )
    # at most six labels, 0.18 inches apart: those of a flat body's bar would overlap
    labels = min(max(int(tall / 0.18), 1), 6)
    bar.locator = MaxNLocator(labels, steps=[1, 2, 2.5, 5, 10])
    bar.update_ticks()
    bar.ax.tick_params(direction="out", right=True)


def _draw_clock(axes: Axes, clock: Clock) -> None:
    """Draw the loads over the film's time, with a dot at the time of the picture."""
    for k, name in enumerate(clock.names):
        colour = "black" if len(clock.names) == 1 else style.SERIES_COLOURS[k % 6]
        axes.plot(clock.time, clock.load[:, k], color=colour, lw=0.9, label=name)
        axes.plot(clock.now, clock.now_load[k], "o", color=colour, ms=5.0, clip_on=False)
    # keep the dots clear of the numbers at the axis
    axes.set_xlim(-0.12, 1.12)
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
    elif len(clock.names) <= MOST_TOLD:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), fontsize=7.0, labelspacing=0.2)


def _draw_tractions(axes: Axes, view: View, layout: Layout, clock: Clock | None) -> None:
    """Draw p, q and the friction limits along the first contact edge, at the nodes with weight."""
    known, strip = np.isfinite(view.p), view.strips[0]
    divided = f"/{view.pressure_symbol}" if view.pressure_symbol else ""
    guides = [begin for _, begin, _ in zones(strip.x, strip.state)[1:]]
    q = view.q[known] if view.friction else None
    shown = view.x[known], view.p[known], q, view.f[known], guides, divided
    curves = draw_tractions(axes, *shown)
    if clock is not None:
        axes.set_ylim(*clock.tractions)
    if abs(strip.normal[1]) == 1.0:
        ends = (np.array(layout.window[:2]) - strip.place[0, 0]) / strip.direction[0] + strip.x[0]
        axes.set_xlim(ends[0], ends[1])
    else:
        axes.set_xlim(strip.x[0], strip.x[-1])
    # one place in all pictures of a film
    place = "best" if clock is None else clock.legend
    axes.legend(loc=place, borderaxespad=0.2, handlelength=1.2)  # type: ignore[call-overload]
    which = f" on {strip.name}" if len(view.strips) > 1 else ""
    axes.set_xlabel(view.x_label + which, labelpad=1.0)
    axes.set_ylabel(in_unit(curves, view.stress_unit))
    style.ticks(axes.yaxis, 5)


def _draw_plane(axes: Axes, view: View, strip: Strip) -> None:
    """Draw the rigid plane below a contact edge, and the states with their numbers below it."""
    direction, first = strip.direction, strip.place[0]
    shown = view.points if len(view.strips) == 1 else strip.place
    along = (shown - first) @ direction
    ends = np.array([along.min() - 0.05 * view.size, along.max() + 0.05 * view.size])
    flat = first + ends[:, None] * direction - strip.gap[[0, -1], None] * strip.normal
    plane = strip.place - strip.gap[:, None] * strip.normal
    # missing part of the body's length with which a contact edge still counts as the whole edge
    if np.ptp(strip.x) > (1.0 - 1e-6) * np.ptp(along):
        # beyond a shorter contact edge no plane is known
        plane = np.vstack([flat[:1], plane, flat[1:]])
    plane = plane - 0.01 * view.size * strip.normal
    axes.plot(plane[:, 0], plane[:, 1], color="black", lw=1.3, zorder=4, clip_on=view.near)
    foot = first - strip.x[0] * direction
    inner, outer = (depth * strip.normal for depth in band_depths(view, strip))
    boxes, fills = [], []
    for name, a, b in zones(strip.x, strip.state):
        state = style.STATE_OF_NAME[name]
        ends = foot + np.array([[a], [b]]) * direction
        boxes.append(np.vstack([ends - inner, ends[::-1] - outer]))
        fills.append(style.STATE_COLOURS[state])
        if b - a > 0.025 * np.ptp(strip.x):  # room for the number
            look: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 7.0}
            look |= {"xytext": (0.0, -0.3), "textcoords": "offset points", "zorder": 6}
            look["color"] = style.STATE_INKS[state]
            axes.annotate(str(int(state)), boxes[-1].mean(axis=0), **look)
    band: dict[str, Any] = {"edgecolors": "black", "linewidths": 0.4, "zorder": 5}
    axes.add_collection(PolyCollection(boxes, facecolors=fills, **band))


def _draw_line(axes: Axes, strip: Strip) -> None:
    """Draw the states between two bodies as a coloured line on the first body's edge."""
    found = zones(strip.x, strip.state)
    pieces = []
    for _, a, b in found:
        x = np.concatenate([[a], strip.x[(strip.x > a) & (strip.x < b)], [b]])
        pieces.append(np.stack([np.interp(x, strip.x, part) for part in strip.moved.T], axis=1))
    colours = [style.STATE_COLOURS[style.STATE_OF_NAME[name]] for name, _, _ in found]
    for look, width, zorder in (("black", 4.4, 4), (colours, 3.4, 5)):
        line = LineCollection(pieces, colors=look, linewidths=width, capstyle="butt", zorder=zorder)
        axes.add_collection(line)


def _draw_loads(axes: Axes, view: View) -> None:
    """Draw the arrows of the loads; in a close-up only those that end in it."""
    look: dict[str, Any] = {"arrowstyle": "-|>,head_length=0.35,head_width=0.14", "lw": 0.8}
    look |= {"color": "#202020", "shrinkA": 0.0, "shrinkB": 0.0}
    for arrows in view.arrows:
        for tail, head in zip(arrows.tails, arrows.heads, strict=True):
            if not view.near or axes.viewLim.contains(*head):
                place: dict[str, Any] = {"xytext": tail, "annotation_clip": False}
                axes.annotate("", head, zorder=7, arrowprops=look, **place)
        if arrows.joined:
            axes.plot(*arrows.tails.T, color="#202020", lw=0.8, zorder=7)
