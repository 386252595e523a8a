"""Drawings over the rendered field: outlines, rigid plane, contact states, load arrows."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots.layout import band_depths
from receding_fenicsx.output.snapshots.view import Strip, View

ARROW_COLOUR = "#202020"
MIN_NUMBERED_ZONE = 0.025
"""Smallest length, over that of the contact edge, of a zone that has its number in the band."""


def draw_outlines(axes: Axes, view: View) -> None:
    """Draw the undeformed and the deformed outline, and rigid planes below contact edges."""
    before = LineCollection(list(view.points[view.edges]), colors=style.GUIDE_COLOUR)
    before.set(linewidths=0.6, linestyles=[(0, (3, 2))], zorder=2)
    after = LineCollection(list(view.moved[view.edges]), colors="black", capstyle="round")
    after.set(linewidths=0.8, zorder=3)
    axes.add_collection(before)
    axes.add_collection(after)
    for strip in view.strips:
        if strip.rigid:
            _draw_plane(axes, view, strip)


def _draw_plane(axes: Axes, view: View, strip: Strip) -> None:
    """Draw the rigid plane below a contact edge, beyond it if it is the only contact edge."""
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


def draw_states(axes: Axes, view: View) -> None:
    """Draw the states, as a band below the plane or as a coloured line between two bodies."""
    for strip in view.strips:
        if strip.rigid:
            _draw_band(axes, view, strip)
        else:
            _draw_line(axes, strip)


def _draw_line(axes: Axes, strip: Strip) -> None:
    """Draw the states between two bodies as a coloured line on the first body's edge."""
    found = zones(strip.x, strip.state)
    pieces = []
    for _, a, b in found:
        x = np.concatenate([[a], strip.x[(strip.x > a) & (strip.x < b)], [b]])
        pieces.append(np.stack([np.interp(x, strip.x, part) for part in strip.moved.T], axis=1))
    colours = [style.STATE_COLOURS[style.STATE_OF_NAME[name]] for name, _, _ in found]
    whole = LineCollection(pieces, colors="black", linewidths=4.4, capstyle="butt", zorder=4)
    axes.add_collection(whole)
    line = LineCollection(pieces, colors=colours, linewidths=3.4, capstyle="butt", zorder=5)
    axes.add_collection(line)


def _draw_band(axes: Axes, view: View, strip: Strip) -> None:
    """Draw the states as a band below the plane, with their numbers."""
    foot = strip.place[0] - strip.x[0] * strip.direction
    inner, outer = (depth * strip.normal for depth in band_depths(view, strip))
    boxes, fills = [], []
    for name, a, b in zones(strip.x, strip.state):
        state = style.STATE_OF_NAME[name]
        ends = foot + np.array([[a], [b]]) * strip.direction
        boxes.append(np.vstack([ends - inner, ends[::-1] - outer]))
        fills.append(style.STATE_COLOURS[state])
        if b - a > MIN_NUMBERED_ZONE * np.ptp(strip.x):
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


def draw_loads(axes: Axes, view: View) -> None:
    """Draw the arrows of the loads; in a close-up only those that end in it."""
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
                    "color": ARROW_COLOUR,
                    "shrinkA": 0.0,
                    "shrinkB": 0.0,
                },
            )
        if arrows.joined:
            axes.plot(*arrows.tails.T, color=ARROW_COLOUR, lw=0.8, zorder=7)
