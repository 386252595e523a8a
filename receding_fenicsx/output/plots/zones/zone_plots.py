"""Figures of zone maps, one panel for each leg."""

from __future__ import annotations

from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.limit_nodes import LimitNodes, limit_nodes_of_cycles
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.labels import Scales, leg_pieces, scales_of
from receding_fenicsx.output.plots.series import leg_ends
from receding_fenicsx.output.plots.zones.cycle_maps import cycle_maps
from receding_fenicsx.output.plots.zones.zone_axes import add_legends, draw_limit, draw_map
from receding_fenicsx.output.plots.zones.zone_map import FLICKER, zone_map

PANEL_HEIGHT = 1.85
"""Approximate height of a panel's axes in inches."""
BETWEEN = 0.2
"""Approximate width in inches between two panels in a row."""
MAX_PANELS = 6
"""Largest number of legs of a cycle that have a panel each; more are one continuous map."""


def zone_maps(
    record: Record,
    legs: int | list[tuple[int, int]],
    scales: Scales | None = None,
    columns: int = 1,
) -> Figure:
    """Draw zone maps of legs, one panel each.

    Nodes whose slip in a settled cycle is negligible are shown as sticking; a dashed line shows
    where they reach the friction limit.

    Args:
        record: the record; it must hold samples of the legs.
        legs: list of (cycle, leg), or a cycle for all its legs. A cycle of more than ``MAX_PANELS``
            legs is one map, see :func:`~receding_fenicsx.output.plots.zones.cycle_maps.cycle_maps`.
        scales: units; by default those of the record.
        columns: largest number of panels in a row; if greater than 1, the figure is as wide as a
            page, and each cycle begins a row.

    Returns:
        The figure; of a symmetric contact it shows x >= 0 only.

    Raises:
        InputError: the record has no samples of a leg.
    """
    scales = scales or scales_of(record)
    shown_legs = selection.legs(record, legs)
    if not isinstance(legs, list) and len(shown_legs) > MAX_PANELS:
        return cycle_maps(record, [shown_legs[0][0]], scales)
    stills = limit_nodes_of_cycles(record, [cycle for cycle, _ in shown_legs])
    with mpl.rc_context(style.RC):
        places = _places(shown_legs, columns)
        rows = places[-1][0] + 1
        width = style.COLUMN if columns == 1 else style.PAGE
        # approximate width in inches of the axes of a figure with one column
        inches = ((2.95 - style.COLUMN + width) / columns, PANEL_HEIGHT)
        wide = inches[0] if columns == 1 else inches[0] - BETWEEN
        titles = _titles(record, shown_legs, scales, wide)
        lines = 1 + max(title.count("\n") for title in titles)
        figure = style.new_figure(width, 0.9 + (PANEL_HEIGHT + 0.1 + 0.15 * lines) * rows)
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for place in set(np.ndindex(grid.shape)) - set(places):
            grid[place].set_axis_off()
        shown: set[int] = set()
        dashed: list[LimitNodes] = []
        sides = [load_axis(record, *where, scales) for where in shown_legs]
        for n, ((row, column), (cycle, leg)) in enumerate(zip(places, shown_legs, strict=True)):
            axes, still = grid[row, column], stills.get(cycle)
            drawn = zone_map(record, cycle, leg, still.stuck if still else None, FLICKER)
            shown |= {int(state) for state, _ in drawn.pieces}
            axes.set_title(titles[n])
            begin, end, label = sides[n]
            draw_map(axes, drawn, (begin, end), scales, inches)
            if column == 0 or label != sides[n - 1][2]:
                axes.set_ylabel(label)
            if still and draw_limit(axes, record, still, [leg], (begin, end), scales):
                dashed.append(still)
            if (row + 1, column) not in places:
                axes.set_xlabel(scales.x_label)
                axes.tick_params(labelbottom=True)
        add_legends(figure, record, shown, dashed, columns > 1)
    return figure


def _titles(
    record: Record, legs: list[tuple[int, int]], scales: Scales, inches: float
) -> list[str]:
    """Return the panels' titles, broken into lines that fit their width."""
    texts = [style.wrapped(leg_pieces(record, *leg, scales), inches - 0.25) for leg in legs]
    return [style.panel_title(n, len(legs), text) for n, text in enumerate(texts)]


def _places(legs: list[tuple[int, int]], columns: int) -> list[tuple[int, int]]:
    """Return row and column of each leg's panel."""
    places = [(0, 0)]
    for (before, _), (cycle, _) in pairwise(legs):
        row, column = places[-1]
        full = column + 1 == columns or (columns > 1 and cycle != before)
        places.append((row + 1, 0) if full else (row, column + 1))
    return places


def load_axis(record: Record, cycle: int, leg: int, scales: Scales) -> tuple[float, float, str]:
    """Return the vertical axis of a zone map: values at both ends of the leg, and its label.

    If one load alone changes, it is this load in the scene's units or over its largest value,
    else s.
    """
    begin, end = leg_ends(record, cycle, leg)
    changing = np.flatnonzero(begin != end)
    if len(changing) != 1:
        return 0.0, 1.0, "position $s$ on the leg"
    k = int(changing[0])
    unit, label = scales.load_axis(k, record.load_names[k])
    return float(begin[k]) / unit, float(end[k]) / unit, label
