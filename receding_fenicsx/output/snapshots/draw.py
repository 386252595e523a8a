"""Pictures of a stress on the deformed body, with states and tractions of the contact.

pyvista renders the field, Matplotlib draws the page around it: one picture for each instant and
stress, as wide as a journal page. The next field is rendered while a page is drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import make_folder
from receding_fenicsx.bulk.fields import gather_cell_stresses, gather_fields, solve_fields
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots import paraview, render
from receding_fenicsx.output.snapshots.colours import (
    QUANTITIES,
    Colours,
    Quantity,
    colours_of,
    scaled,
)
from receding_fenicsx.output.snapshots.layout import Layout, layout_of
from receding_fenicsx.output.snapshots.page import Clock, compose
from receding_fenicsx.output.snapshots.vertices import merge_axis, vertex_areas
from receding_fenicsx.output.snapshots.view import View, view_of
from receding_fenicsx.output.snapshots.whole_contact import whole_contact
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.timing import Countdown, Say

if TYPE_CHECKING:
    from receding_fenicsx.bulk.stack import Stack


def snapshots(
    bulk: Stack,
    instants: Sequence[Instant],
    folder: Path,
    quantities: tuple[Quantity, ...] = QUANTITIES,
    say: Say | None = None,
) -> list[Path] | None:
    """Draw the body at some instants, and write its fields for ParaView; collective.

    Args:
        bulk: the body.
        instants: states of the modelled contact nodes, on all ranks.
        folder: folder of the pictures; the fields for ParaView go to ``fields`` next to it.
        quantities: stresses, one picture each.
        say: called on rank 0 with the progress.

    Returns:
        The files written, on rank 0; None elsewhere.

    Raises:
        RecedingError: off-screen rendering does not work on this machine.
    """
    comm, folder = bulk.comm, Path(folder)
    beside = folder.parent / "fields"

    def prepare() -> None:
        render.find_renderer()
        for place in (folder, beside):
            make_folder(place)

    on_root(comm, prepare)
    solved = [_solve(bulk, now, beside / f"{_name(now)}.xdmf") for now in instants]

    def draw() -> list[Path]:
        made: list[Path] = []
        sheets: list[Sheet] = []
        paths: list[Path] = []
        for now, view in zip(instants, solved, strict=True):
            layout = layout_of(given(view))
            for quantity in quantities:
                sheets += sheets_of([given(view)], quantity, layout)
                paths.append(folder / f"{_name(now)}_{quantity.name}.png")
        tell = Countdown(say, "pictures of the body:")
        with mpl.rc_context(style.RC):
            for path, page in zip(paths, draw_sheets(sheets), strict=True):
                tell(len(made), len(paths), path.stem)
                style.save(page, path)
                made.append(path)
        return [*made, *[beside / f"{_name(now)}.xdmf" for now in instants]]

    return on_root(comm, draw)


def _name(now: Instant) -> str:
    """Return the name of an instant's files."""
    return f"cycle{now.cycle:04d}_leg{now.leg}_s{now.s:.3f}"


def _solve(bulk: Stack, now: Instant, file: Path) -> View | None:
    """Solve for the fields of an instant and write them; return its view on rank 0; collective."""
    parts = solve_fields(bulk, now.load, np.concatenate([now.v, now.state.w]))
    fields, cell_stress = gather_fields(parts), gather_cell_stresses(parts)

    def write() -> View:
        assert fields is not None and cell_stress is not None
        history = history_from_scene(bulk.scene)
        legs = len(history.path if now.cycle == 0 else history.loop) - 1
        merged = merge_axis(fields) if bulk.body.half else fields
        grid = paraview.grid_of(merged, cell_stress, whole_contact(bulk, now))
        paraview.write_instant(file, grid, paraview.time_of(now.cycle, now.leg, now.s, legs))
        return view_of(bulk, fields, now)

    return on_root(bulk.comm, write)


@dataclass(frozen=True)
class Sheet:
    """Everything of a page before the field is rendered.

    Attributes:
        view: body and contact at the instant.
        layout: layout of the page.
        values: (n,) field at the vertices.
        colours: its colours.
        levels: values at which contour lines are drawn.
        clock: position in a film; None for a single picture.
    """

    view: View
    layout: Layout
    values: Array
    colours: Colours
    levels: Array
    clock: Clock | None


def sheets_of(
    views: Sequence[View],
    quantity: Quantity,
    layout: Layout,
    clocks: Sequence[Clock | None] = (),
) -> list[Sheet]:
    """Return the sheets of a stress of several views of a body with the same layout and colours.

    Args:
        views: the views, all in the same units.
        quantity: the stress.
        layout: layout of the pages.
        clocks: position of each page in a film; empty for single pictures.
    """
    values = [scaled(view, quantity) for view in views]
    seen = [layout.shows(view.moved) for view in views]
    colours, levels = colours_of(
        np.concatenate([v[at] for v, at in zip(values, seen, strict=True)]),
        quantity,
        views[0].pressure_symbol,
        np.concatenate(
            [vertex_areas(v.points, v.cells)[at] for v, at in zip(views, seen, strict=True)]
        ),
    )
    return [
        Sheet(view, layout, field, colours, levels, clock)
        for view, field, clock in zip(views, values, clocks or [None] * len(views), strict=True)
    ]


def draw_sheets(sheets: Sequence[Sheet]) -> Iterator[Figure]:
    """Yield the pages of sheets; the next field is rendered while a page is drawn."""
    coming = [_begin(sheet) for sheet in sheets[:1]]
    for n, sheet in enumerate(sheets):
        pixels = render.finish(coming.pop())
        coming = [_begin(later) for later in sheets[n + 1 : n + 2]]
        contours = (sheet.values, sheet.levels) if len(sheet.levels) else None
        yield compose(sheet.view, sheet.layout, pixels, sheet.colours, sheet.clock, contours)


def _begin(sheet: Sheet) -> Future[render.Pixels]:
    """Begin to render the field of a sheet."""
    picture = render.Picture(
        points=sheet.view.moved,
        cells=sheet.view.cells,
        values=sheet.values,
        limits=sheet.colours.limits,
        colours=sheet.colours.table,
        window=sheet.layout.window,
        size=sheet.layout.pixels,
    )
    return render.begin(picture)
