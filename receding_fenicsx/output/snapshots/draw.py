"""Pictures of a stress on the deformed body, with states and tractions of the contact.

pyvista renders the field, Matplotlib draws the page around it: one picture for each instant and
stress, as wide as a journal page.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.bulk.fields import gather_cell_stresses, gather_fields, solve_fields
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.mpi import on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.figures import save
from receding_fenicsx.output.snapshots import paraview
from receding_fenicsx.output.snapshots.colours import QUANTITIES, Quantity, colours_of, scaled
from receding_fenicsx.output.snapshots.layout import Layout, layout_of
from receding_fenicsx.output.snapshots.page import Clock, compose
from receding_fenicsx.output.snapshots.render import Picture, find_renderer, renderer
from receding_fenicsx.output.snapshots.vertices import merge_axis, vertex_areas
from receding_fenicsx.output.snapshots.view import View, view_of
from receding_fenicsx.output.snapshots.whole_contact import whole_contact
from receding_fenicsx.scene.history import from_scene

if TYPE_CHECKING:
    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.two_bodies import Pair


def snapshot(
    bulk: Bulk | Pair,
    instant: Instant | None,
    folder: Path,
    quantities: tuple[Quantity, ...] = QUANTITIES,
) -> list[Path] | None:
    """Draw the body at one instant, and write its fields for ParaView; collective.

    Args:
        bulk: the body.
        instant: state of the modelled contact nodes, on rank 0.
        folder: folder of the pictures; the fields for ParaView go to ``fields`` next to it.
        quantities: stresses, one picture each.

    Returns:
        The files written, on rank 0; None elsewhere.

    Raises:
        RecedingError: off-screen rendering does not work on this machine.
    """
    comm, folder = bulk.comm, Path(folder)
    beside = folder.parent / "fields"

    def prepare() -> None:
        find_renderer()
        for place in (folder, beside):
            make_folder(place)

    on_root(comm, prepare)
    now: Instant = comm.bcast(instant)
    name = f"cycle{now.cycle:04d}_leg{now.leg}_s{now.s:.3f}"
    xdmf = beside / f"{name}.xdmf"
    parts = solve_fields(bulk, now.load, np.concatenate([now.v, now.state.w]))
    fields, cell_stress = gather_fields(parts), gather_cell_stresses(parts)

    def draw() -> list[Path]:
        assert fields is not None and cell_stress is not None
        history = from_scene(bulk.scene)
        legs = len(history.path if now.cycle == 0 else history.loop) - 1
        merged = merge_axis(fields) if bulk.body.half else fields
        grid = paraview.grid_of(merged, cell_stress, whole_contact(bulk, now))
        paraview.write_instant(xdmf, grid, paraview.time_of(now.cycle, now.leg, now.s, legs))
        view = view_of(bulk, fields, now)
        made = [folder / f"{name}_{quantity.name}.png" for quantity in quantities]
        for quantity, path in zip(quantities, made, strict=True):
            draw_view(view, quantity, path)
        return [*made, xdmf]

    return on_root(comm, draw)


def draw_view(view: View, quantity: Quantity, path: Path) -> None:
    """Draw one stress of a view into a file.

    Raises:
        RecedingError: off-screen rendering does not work on this machine.
    """
    with mpl.rc_context(style.RC):
        (page,) = draw_pages([view], quantity, layout_of(view))
        save(page, path)


def draw_pages(
    views: list[View],
    quantity: Quantity,
    layout: Layout,
    clocks: Sequence[Clock | None] = (),
) -> Iterator[Figure]:
    """Draw a stress of several views of a body on pages with the same layout and colours.

    Args:
        views: the views, all in the same units.
        quantity: the stress.
        layout: layout of the pages.
        clocks: position of each page in a film; empty for single pictures.

    Yields:
        The pages, one for each view.
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
    for view, field, clock in zip(views, values, clocks or [None] * len(views), strict=True):
        picture = Picture(
            points=view.moved,
            cells=view.cells,
            values=field,
            limits=colours.limits,
            colours=colours.table,
            levels=levels,
            window=layout.window,
            size=layout.pixels,
        )
        yield compose(view, layout, renderer.draw(picture), colours, clock)
