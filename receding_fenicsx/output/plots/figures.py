"""All figures of a record: a registry of figures, each with the data that it needs.

A figure without data is omitted: a monotonic history has no slip per cycle. Files are PNG and PDF,
one journal column or a page wide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.arrays import over_largest, spread
from receding_fenicsx.atomic import make_folder
from receding_fenicsx.evolution.moment import Moment, moment_of
from receding_fenicsx.evolution.probes import probe_names
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.fatigue import fatigue, short_cracks
from receding_fenicsx.output.plots import series
from receding_fenicsx.output.plots.cycle_plots import (
    dissipation_density,
    dissipation_per_cycle,
    hysteresis,
    moving_loads,
    slip_per_cycle,
    trajectories,
)
from receding_fenicsx.output.plots.study_plots import branches, slip_mode
from receding_fenicsx.output.plots.style import save
from receding_fenicsx.output.plots.traction_plots import (
    crack_along,
    fatigue_along,
    probe_stresses,
    tractions,
)
from receding_fenicsx.output.plots.zone_plots import MAX_PANELS, cycle_maps, zone_maps

__all__ = [
    "FIGURES",
    "branches",
    "crack_along",
    "cycle_maps",
    "dissipation_density",
    "dissipation_per_cycle",
    "draw_all",
    "fatigue_along",
    "figure",
    "hysteresis",
    "plot_all",
    "probe_stresses",
    "save",
    "slip_mode",
    "slip_per_cycle",
    "tractions",
    "trajectories",
    "zone_maps",
]


def __dir__() -> list[str]:
    """Return the figures and what saves them, for completion."""
    return __all__


Draw = Callable[[Record, Any], Figure]


@dataclass
class figure:
    """Register a function ``draw(record, found)`` as a figure of every record that has data for it.

    ``needs`` returns ``found`` from a record; without it the figure is omitted.
    """

    name: str  # of the file, without ending
    needs: Callable[[Record], Any]
    caption: str = ""  # text below it in the report
    # it answers a scene's question, so that all runs draw it; or a function of the last cycle
    main: bool | Callable[[int], bool] = False
    all_edges: bool = False  # it shows all contact edges together; others are drawn for each edge
    each: bool = False  # needs returns names, and draw is called for each: a figure name_NAME

    def __call__(self, draw: Draw) -> Draw:
        """Register the function."""
        self.draw = draw
        FIGURES[self.name] = self
        return draw


FIGURES: dict[str, figure] = {}
"""Registered figures by name, in the order in which runs draw them and reports show them."""


def plot_all(
    record: Record,
    folder: str | Path,
    formats: str | Iterable[str] = ("png", "pdf"),
    everything: bool = True,
) -> list[Path]:
    """Draw and save the figures that a record has data for; existing files are replaced.

    With several contact edges the figures of each are in a folder of its name. Formats are endings
    of files. Not ``everything``: only those that answer a scene's question.
    """
    folder = Path(folder)
    formats = (formats,) if isinstance(formats, str) else tuple(formats)
    made: list[Path] = []
    edges = record.by_edge()
    for edge, part in edges.items():
        for name, entry, draw in _drawings(part, everything):
            whole = len(edges) == 1 or entry.all_edges
            place = folder if whole else folder / edge.replace("/", "_")
            files = [place / f"{name}.{ending}" for ending in formats]
            if set(files) <= set(made):
                continue
            make_folder(place)
            drawn = draw()
            for path in files:
                save(drawn, path)
            made += files
    return made


def draw_all(record: Record, everything: bool = True) -> Iterator[tuple[str, Figure]]:
    """Yield the name and the figure of everything that :func:`plot_all` writes."""
    for name, _, draw in _drawings(record, everything):
        yield name, draw()


def _drawings(
    record: Record, everything: bool
) -> Iterator[tuple[str, figure, Callable[[], Figure]]]:
    """Yield name, entry and drawing function of the figures that a record has data for."""
    last = last_cycle(record)
    for name, entry in FIGURES.items():
        main = entry.main(last) if callable(entry.main) else entry.main
        found: Any = entry.needs(record) if everything or main else None
        # an array has a length, but no truth value
        if len(found) == 0 if isinstance(found, Sized) else not found:
            continue
        for own, what in [(f"{name}_{k}", k) for k in found] if entry.each else [(name, found)]:
            yield own, entry, partial(entry.draw, record, what)


def last_cycle(record: Record) -> int:
    """Return the last cycle of a record; 0 for a first loading alone."""
    return int(record.turning_points.cycle.max(initial=0))


# -- the figures of the package, in the order of the report --------------------------------------


def _largest_first_load(record: Record) -> Moment | None:
    """Return the turning point of cycle 0 with the largest loads in contact."""
    table = record.turning_points
    rows = np.flatnonzero((table.cycle == 0) & np.any(table.P > 0.0, axis=1))
    size = np.abs(over_largest(table.load[rows], table.load)).sum(axis=1)
    return moment_of(record, table, int(rows[np.argmax(size)])) if len(rows) else None


figure(
    "tractions_first_loading",
    needs=_largest_first_load,
    caption="Tractions, friction cone and states at the largest load of the first loading.",
    main=lambda last: last == 0,
)(tractions)
figure(
    "zones_first_unloading",
    needs=lambda record: [
        where
        for where in [series.first_unloading(record)]
        if where is not None and where in series.legs_of(record, where[0])
    ],
    caption="Zones of stick, slip and separation along the first unloading.",
    main=lambda last: last <= 1,
)(zone_maps)


def _third_of_load(record: Record) -> Moment | None:
    """Return the instant of the first unloading where about a third of the largest load is left."""
    cycle, leg = series.first_unloading(record) or (-1, -1)
    instants: list[tuple[float, Moment]] = []
    for table in (record.samples, record.turning_points):
        here = (table.cycle == cycle) & (table.leg == leg) & np.any(table.P > 0.0, axis=1)
        parts = np.abs(over_largest(table.load, record.turning_points.load))
        off = np.abs(parts.max(axis=1, initial=0.0) - 1.0 / 3.0)
        if np.any(here):
            row = int(np.argmin(np.where(here, off, np.inf)))
            instants.append((float(off[row]), moment_of(record, table, row)))
    return min(instants, key=lambda instant: instant[0])[1] if instants else None


figure(
    "tractions_first_unloading",
    needs=_third_of_load,
    caption="Tractions during the first unloading; the load is given above the states.",
)(tractions)
figure(
    "slip_per_cycle",
    needs=series.slip_lines,
    caption="Slip increment of each cycle at some nodes, with fitted power of N.",
)(lambda record, _: slip_per_cycle(record))
figure(
    "zones_last_cycle",
    needs=lambda record: series.legs_of(record, max(last_cycle(record), 2)),
    caption="Zones along the last cycle. Dashed line: nodes that reach the friction limit without "
    "slip.",
    main=True,
)(lambda record, legs: zone_maps(record, legs[0][0]))


@figure(
    "zones_by_cycle",
    needs=lambda record: [cycle for cycle in series.sampled_cycles(record) if cycle][1:],
    caption="Zones along all sampled cycles.",
)
def _(record: Record, _later: Any) -> Figure:
    """Draw zones of several cycles as panels or, of many legs, as continuous maps."""
    sampled = [cycle for cycle in series.sampled_cycles(record) if cycle]
    legs = len(series.legs_of(record, sampled[0]))
    if legs > MAX_PANELS:
        return cycle_maps(record, sorted({sampled[0], sampled[len(sampled) // 2], sampled[-1]}))
    columns = 2 if legs == 4 else min(legs, 3)
    most = 6 // -(-legs // columns)  # rows that fit a page; each cycle begins one
    several = sampled if len(sampled) <= most else [*sampled[: most - 1], sampled[-1]]
    shown = [leg for cycle in several for leg in series.legs_of(record, cycle)]
    return zone_maps(record, shown, columns=columns)


figure(
    "dissipation_per_cycle",
    needs=lambda record: len(record.cycles.dissipation) > 1 and record.dissipates,
    caption="Dissipation of each cycle over that of cycle 1.",
    main=True,
    all_edges=True,
)(lambda record, _: dissipation_per_cycle(record))
figure(
    "dissipation_density",
    needs=lambda record: bool(np.any(record.cycles.dissipation_density > 0.0)),
    caption="Dissipation per contact area in a cycle, along the contact edge.",
)(lambda record, _: dissipation_density(record))
figure(
    "hysteresis",
    needs=lambda record: last_cycle(record) > 0 and moving_loads(series.paths_of(record)),
    caption="Loads against their work-conjugate displacements; the area of a loop is work.",
    main=True,
    all_edges=True,
)(lambda record, _: hysteresis(record))
figure(
    "trajectories",
    needs=lambda record: last_cycle(record) and series.representative_nodes(record),
    caption="Paths of single nodes: tractions with the friction cone (above), displacements "
    "(below). Dots are turning points.",
)(trajectories)


def _turning_points_of_last_cycle(record: Record) -> list[Moment]:
    table, last = record.turning_points, last_cycle(record)
    rows = np.flatnonzero((table.cycle == last) & np.any(table.P > 0.0, axis=1))
    return [moment_of(record, table, int(r)) for r in spread(rows, MAX_PANELS)] if last else []


figure(
    "tractions_last_cycle",
    needs=_turning_points_of_last_cycle,
    caption="Tractions, friction cone and states at the turning points of the last cycle.",
    main=True,
)(tractions)
figure(
    "probe",
    needs=lambda record: probe_names(record) if len(record.turning_points.s) else (),
    caption="Stresses at a probe, whose name is in that of the file.",
    main=True,
    all_edges=True,
    each=True,
)(probe_stresses)
figure(
    "fatigue",
    needs=lambda record: [name for name in fatigue(record) if len(record.probe(name).points) > 1],
    caption="Smith, Watson and Topper's parameter along a probe, and the normal of its plane.",
    main=True,
    all_edges=True,
    each=True,
)(fatigue_along)
figure(
    "crack",
    needs=lambda record: list(short_cracks(record)),
    caption="Stress intensities over the depth of a crack along a probe, over the last cycle.",
    all_edges=True,
    each=True,
)(crack_along)
