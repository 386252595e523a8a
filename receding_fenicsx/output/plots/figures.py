"""All figures of a record, as PNG and PDF, one journal column or a page wide.

A figure without data is omitted: a monotonic history has no slip per cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure

from receding_fenicsx.arrays import spread
from receding_fenicsx.atomic import make_folder
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.moment import moment_of
from receding_fenicsx.evolution.probe_history import probe_names
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.record_data import States
from receding_fenicsx.output.plots.branch_plots import branches, slip_mode
from receding_fenicsx.output.plots.cycle_plots import (
    dissipation_density,
    dissipation_per_cycle,
    slip_per_cycle,
)
from receding_fenicsx.output.plots.loop_plots import hysteresis, moving_loads, trajectories
from receding_fenicsx.output.plots.loops import (
    loop_of,
    representative_nodes,
    sampled_cycles,
    shown_cycles,
)
from receding_fenicsx.output.plots.probe_plots import probe_stresses
from receding_fenicsx.output.plots.series import first_unloading, legs_of, slip_lines
from receding_fenicsx.output.plots.style import save
from receding_fenicsx.output.plots.traction_plots import tractions
from receding_fenicsx.output.plots.units import Scales, scales_of
from receding_fenicsx.output.plots.zones.cycle_maps import cycle_maps
from receding_fenicsx.output.plots.zones.zone_plots import MAX_PANELS, zone_maps
from receding_fenicsx.timing import Tell

__all__ = [
    "branches",
    "cycle_maps",
    "dissipation_density",
    "dissipation_per_cycle",
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

FORMATS = ("png", "pdf")
Draw = Callable[[], Figure]
"""Draws a figure."""
UNLOADED_TO = 1.0 / 3.0
"""Part of the largest load at which the tractions of the first unloading are drawn."""
MAX_ROWS = 6
"""Largest number of rows of the overview of sampled cycles; each cycle begins a row."""
ALL_EDGES = ("dissipation_per_cycle", "hysteresis")
"""Figures of all contact edges together."""
PROBE = "probe_"
"""Beginning of the names of probes' figures."""


def plot_all(
    record: Record,
    folder: str | Path,
    formats: str | Iterable[str] = FORMATS,
    tell: Tell | None = None,
    everything: bool = True,
) -> list[Path]:
    """Draw and save the figures that a record has data for.

    With several contact edges the figures of each edge are in a folder of its name.

    Args:
        record: the record.
        folder: folder of the files, created if necessary; existing files are replaced.
        formats: file formats, as endings.
        tell: called with the name of each figure before it is drawn.
        everything: draw all figures, not only those of :func:`main_figures`.

    Returns:
        The files.

    Raises:
        InputError: a format is unknown, or the folder cannot be created.
    """
    folder = Path(folder)
    formats = (formats,) if isinstance(formats, str) else tuple(formats)
    known = FigureCanvasBase.get_supported_filetypes()
    for ending in formats:
        if ending not in known:
            raise InputError(f"format '{ending}': is unknown; use some of {', '.join(known)}")
    made: list[Path] = []
    edges = record.by_edge()
    for edge, part in edges.items():
        alone = len(edges) == 1
        for name, figure in draw_all(part, everything):
            whole = alone or name.endswith(ALL_EDGES) or name.startswith(PROBE)
            place = folder if whole else folder / edge.replace("/", "_")
            make_folder(place)
            files = [place / f"{name}.{ending}" for ending in formats]
            if set(files) <= set(made):
                continue
            if tell is not None:
                tell(name, len(made) // len(formats))
            for path in files:
                save(figure, path)
            made += files
    return made


def draw_all(
    record: Record,
    everything: bool = True,
) -> Iterator[tuple[str, Figure]]:
    """Yield the name and the figure of everything that :func:`plot_all` writes."""
    for name, draw in _every_figure(record, scales_of(record)):
        if everything or name.startswith(PROBE) or name in main_figures(record):
            yield name, draw()


def main_figures(record: Record) -> tuple[str, ...]:
    """Return the names of the figures that answer a scene's question, besides its probes.

    Cycles are run for their end, everything else for the first loading and unloading.
    """
    last = int(record.turning_points.cycle.max(initial=0))
    zones = "zones_last_cycle" if last > 1 else "zones_first_unloading"
    tractions_at = "tractions_last_cycle" if last > 0 else "tractions_first_loading"
    return (tractions_at, zones, "dissipation_per_cycle", "hysteresis")


def _every_figure(record: Record, scales: Scales) -> Iterator[tuple[str, Draw]]:
    yield from _first_loading(record, scales)
    yield from _first_unloading(record, scales)
    last = int(record.turning_points.cycle.max(initial=0))
    if slip_lines(record, scales.length):
        yield "slip_per_cycle", partial(slip_per_cycle, record, scales)
    if legs_of(record, last) and last > 1:
        yield "zones_last_cycle", partial(zone_maps, record, last, scales)
    yield from _sampled_zones(record, scales)
    if len(record.cycles.dissipation) > 1 and record.dissipates:
        yield "dissipation_per_cycle", partial(dissipation_per_cycle, record, scales)
    if np.any(record.cycles.dissipation_density > 0.0):
        yield "dissipation_density", partial(dissipation_density, record, scales)
    if last > 0 and shown_cycles(record):
        paths = [loop_of(record, cycle) for cycle in shown_cycles(record)]
        if moving_loads(paths):
            yield "hysteresis", partial(hysteresis, record, scales=scales)
        if representative_nodes(record):
            yield "trajectories", partial(trajectories, record, scales=scales)
    if last > 0:
        table = record.turning_points
        rows = np.flatnonzero((table.cycle == last) & np.any(table.P > 0.0, axis=1))
        if len(rows):
            chosen = [moment_of(record, table, int(row)) for row in spread(rows, MAX_PANELS)]
            yield "tractions_last_cycle", partial(tractions, record, chosen, scales)
    for name in probe_names(record) if len(record.turning_points.s) else ():
        yield f"{PROBE}{name}", partial(probe_stresses, record, name, scales)


def _sampled_zones(record: Record, scales: Scales) -> Iterator[tuple[str, Draw]]:
    """Yield the zones of several sampled cycles, as panels or, of many legs, as continuous maps."""
    sampled = [cycle for cycle in sampled_cycles(record) if cycle]
    if len(sampled) < 2:
        return
    legs = len(legs_of(record, sampled[0]))
    if legs > MAX_PANELS:
        several = sorted({sampled[0], sampled[len(sampled) // 2], sampled[-1]})
        yield "zones_by_cycle", partial(cycle_maps, record, several, scales)
        return
    columns = 2 if legs == 4 else min(legs, 3)
    most = MAX_ROWS // -(-legs // columns)
    several = sampled if len(sampled) <= most else [*sampled[: most - 1], sampled[-1]]
    shown = [leg for cycle in several for leg in legs_of(record, cycle)]
    yield "zones_by_cycle", partial(zone_maps, record, shown, scales, columns=columns)


def _first_loading(record: Record, scales: Scales) -> Iterator[tuple[str, Draw]]:
    """Yield the tractions at the turning point of cycle 0 with the largest loads."""
    table = record.turning_points
    rows = np.flatnonzero((table.cycle == 0) & np.any(table.P > 0.0, axis=1))
    if len(rows):
        size = np.abs(table.load[rows] / scales.load_max).sum(axis=1)
        row = int(rows[np.argmax(size)])
        moment = moment_of(record, table, row)
        yield "tractions_first_loading", partial(tractions, record, [moment], scales)


def _first_unloading(record: Record, scales: Scales) -> Iterator[tuple[str, Draw]]:
    """Yield the zones along the first unloading, and the tractions at a third of the load."""
    where = first_unloading(record)
    if where is None:
        return
    cycle, leg = where
    if where in legs_of(record, cycle):
        yield "zones_first_unloading", partial(zone_maps, record, [where], scales)
    instants: list[tuple[float, int, States, int]] = []
    for table in (record.samples, record.turning_points):
        here = (table.cycle == cycle) & (table.leg == leg) & np.any(table.P > 0.0, axis=1)
        for row in np.flatnonzero(here):
            off = abs(np.abs(table.load[row] / scales.load_max).max() - UNLOADED_TO)
            instants.append((off, len(instants), table, int(row)))
    if instants:
        _, _, table, row = min(instants, key=lambda instant: instant[:2])
        moment = moment_of(record, table, row)
        yield "tractions_first_unloading", partial(tractions, record, [moment], scales)
