"""Layout of a picture's page: boxes of its parts in inches, visible part of the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots.view import Strip, View

LEFT, RIGHT = 0.62, 0.98
"""Margins in inches: left for the axis of the tractions, right for the colour bar."""
ABOVE, BETWEEN, TRACTIONS, BELOW = 0.3, 0.06, 0.95, 0.64
"""Inches above the body, between body and tractions, of the tractions, below the tractions."""
STATE_BAND = (0.03, 0.115)
"""Distances of the band of states from the contact edge, over the size of the view."""


@dataclass(frozen=True)
class Layout:
    """Boxes of a page in inches, and the part of the plane that the body's axes show.

    Attributes:
        width, height: of the page.
        body: left, bottom, width and height of the body's axes.
        tractions: left, bottom, width and height of the axes of the tractions.
        window: left, right, bottom and top of the body's axes in the view's coordinates.
        dpi: dots per inch.
    """

    width: float
    height: float
    body: tuple[float, float, float, float]
    tractions: tuple[float, float, float, float]
    window: tuple[float, float, float, float]
    dpi: float

    def shows(self, points: Array) -> NDArray[np.bool_]:
        """Return (n,) whether points (n, 2) lie within the body's axes."""
        left, right, bottom, top = self.window
        x, y = points.T
        return (left <= x) & (x <= right) & (bottom <= y) & (y <= top)

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the body's axes in pixels."""
        return round(self.body[2] * self.dpi), round(self.body[3] * self.dpi)


def layout_of(*views: View, dpi: float = style.DPI) -> Layout:
    """Return the layout of a page for one view, or for several views of the same body."""
    corners = np.vstack([_corners(view) for view in views])
    margin = 0.03 * views[0].size
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    if views[0].near:
        around = visible_box(views[0])
        low, high = np.maximum(low, around[0]), np.minimum(high, around[1])
    width = style.PAGE - LEFT - RIGHT
    # largest height of the body in inches
    scale = min(width / (high[0] - low[0]), 4.5 / (high[1] - low[1]))
    # a narrow body is centred
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
    """Return (2, 2) lowest and highest coordinates of everything drawn of a view."""
    shown = [view.points, view.moved]
    shown += [
        strip.place - band_depths(view, strip)[1] * strip.normal
        for strip in view.strips
        if strip.rigid
    ]
    shown += [end for arrows in view.arrows for end in (arrows.tails, arrows.heads)]
    points = np.vstack(shown)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def band_depths(view: View, strip: Strip) -> tuple[float, float]:
    """Return the distances of the band of states from the contact edge, below the plane."""
    below = float(strip.gap.max())
    inner, outer = (part * view.size for part in STATE_BAND)
    inch = float(np.ptp(visible_box(view)[:, 0])) / (style.PAGE - LEFT - RIGHT)
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
