"""Zone maps of cycles of many legs: one continuous map a cycle, the load factors beside it."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.limit_nodes import LimitNodes, limit_nodes_of_cycles
from receding_fenicsx.output.plots import selection, style
from receding_fenicsx.output.plots.labels import Scales, load_text, scales_of
from receding_fenicsx.output.plots.series import leg_ends, legs_of, phases
from receding_fenicsx.output.plots.zones.zone_axes import add_legends, draw_limit, draw_map
from receding_fenicsx.output.plots.zones.zone_map import FLICKER, stacked_map

LEAST_HEIGHT, MOST_HEIGHT = 3.0, 5.6
"""Heights of the axes in inches, for few and many legs."""
LOADS_WIDTH = 0.85
"""Width of the axes of the loads in inches."""
LOAD_LINES = (
    {"color": "#000000", "lw": 1.0},
    {"color": "#009e73", "lw": 1.0, "dashes": (5, 1.5)},
    {"color": "#cc79a7", "lw": 1.4, "dashes": (1.2, 1.0)},
    {"color": "#56b4e9", "lw": 1.2, "dashes": (5, 1.2, 1.2, 1.2)},
)
"""Lines of the loads; none has the colour of a state."""


def cycle_maps(record: Record, cycles: int | Sequence[int], scales: Scales | None = None) -> Figure:
    """Draw the zones along whole cycles, with the load factors beside them.

    All legs of a cycle are stacked upwards, each of the same height; those of a harmonic history
    are drawn over the phase. Nodes whose slip in a settled
    cycle is negligible are shown as sticking; a dashed line shows where they reach the friction
    limit.

    Args:
        record: the record; it must hold samples of the cycles, which must have equal loads.
        cycles: one or several cycles, side by side.
        scales: units; by default those of the record.

    Returns:
        The figure; of a symmetric contact it shows x >= 0 only.

    Raises:
        InputError: the record has no samples of a cycle.
    """
    scales = scales or scales_of(record)
    chosen = selection.cycles(record, cycles)
    stills = limit_nodes_of_cycles(record, chosen)
    legs = [leg for _, leg in legs_of(record, chosen[-1])]
    angles = phases(record) if chosen[0] else None
    # height of a leg in inches between these limits
    height = float(np.clip(0.22 * len(legs), LEAST_HEIGHT, MOST_HEIGHT))
    with mpl.rc_context(style.RC):
        width = style.COLUMN if len(chosen) == 1 else style.PAGE
        # width of the labels and the room between axes in inches
        wide = (width - 0.6 - LOADS_WIDTH) / len(chosen)
        figure = style.new_figure(width, height + 1.1)
        ratios = [*[wide] * len(chosen), LOADS_WIDTH]
        *panels, beside = figure.subplots(
            1, len(ratios), sharey=True, gridspec_kw={"width_ratios": ratios}
        )
        shown: set[int] = set()
        dashed: list[LimitNodes] = []
        for n, (axes, cycle) in enumerate(zip(panels, chosen, strict=True)):
            still = stills.get(cycle)
            drawn = stacked_map(record, cycle, still.stuck if still else None, FLICKER)
            shown |= {int(state) for state, _ in drawn.pieces}
            numbers = [leg for _, leg in legs_of(record, cycle)]
            ends = np.arange(len(numbers) + 1.0) if angles is None else angles
            if angles is not None:
                drawn = drawn.moved_to((angles - angles[0]) / (angles[-1] - angles[0]))
            whole = float(ends[0]), float(ends[-1])
            draw_map(axes, drawn, whole, scales, (wide, height), len(numbers))
            if still and draw_limit(axes, record, still, numbers, ends, scales):
                dashed.append(still)
            name = f"cycle {cycle}" if cycle else "first loading"
            axes.set_title(style.panel_title(n, len(chosen), name))
            axes.set_xlabel(scales.x_label)
        if angles is None:
            panels[0].set_ylabel("leg of the cycle")
            panels[0].yaxis.set_major_locator(MaxNLocator(8, integer=True))
        else:
            style.phase_axis(panels[0].yaxis)
        _draw_loads(beside, record, chosen[-1], scales, ends)
        add_legends(figure, record, shown, dashed, len(chosen) > 1)
    return figure


def _draw_loads(axes: Axes, record: Record, cycle: int, scales: Scales, at: Array) -> None:
    """Draw the load factors at the ends of the legs of a cycle, upwards as the zones."""
    legs = legs_of(record, cycle)
    ends = [leg_ends(record, *leg) for leg in legs]
    load = np.array([ends[0][0], *(end for _, end in ends)]) / scales.load_max
    for k, name in enumerate(record.load_names):
        look = LOAD_LINES[k % len(LOAD_LINES)]
        axes.plot(load[:, k], at, label=load_text(name), **look)  # type: ignore[arg-type]
    axes.axvline(0.0, color=style.GUIDE_COLOUR, lw=0.4)
    reach = 1.08 * max(1.0, float(np.abs(load).max()))
    axes.set_xlim(-reach if load.min() < 0.0 else -0.08, reach)
    axes.set_xlabel("loads over\nlargest")
    axes.tick_params(labelleft=False)
    style.ticks(axes.xaxis, 2)
    axes.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        borderaxespad=0.2,
        labelspacing=0.2,
        handlelength=1.8,
    )
