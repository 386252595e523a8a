"""Pictures of a stress on the deformed body, with states and tractions of the contact.

One picture for each instant and stress, as wide as a journal page: pyvista renders the field,
Matplotlib draws the page around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from receding_fenicsx.atomic import make_folder
from receding_fenicsx.bulk.fields import gather_cell_stresses, gather_fields, solve_fields
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.branches.critical_friction import CriticalFriction
from receding_fenicsx.interface.law import Friction, State
from receding_fenicsx.interface.system import ContactState
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots import paraview
from receding_fenicsx.output.snapshots.colours import (
    QUANTITIES,
    Quantity,
    colours_of,
    quantity_of,
    scaled,
)
from receding_fenicsx.output.snapshots.page import Clock, Layout, compose, layout_of
from receding_fenicsx.output.snapshots.render import render, start
from receding_fenicsx.output.snapshots.view import Units, View, units_of, view_of
from receding_fenicsx.output.snapshots.whole_body import merge_axis, vertex_areas, whole_contact
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
    """Draw the body at some instants, one picture for each stress; collective.

    The pictures go to ``folder``, the fields for ParaView to ``fields`` next to it. Rank 0 gets the
    files.
    """
    comm, beside = bulk.comm, folder.parent / "fields"

    def prepare() -> None:
        start()
        make_folder(folder)
        make_folder(beside)

    on_root(comm, prepare)
    names = [f"cycle{now.cycle:04d}_leg{now.leg}_s{now.s:.3f}" for now in instants]
    fields = [beside / f"{name}.xdmf" for name in names]
    solved = [_solve(bulk, now, file) for now, file in zip(instants, fields, strict=True)]

    def draw() -> list[Path]:
        made: list[Path] = []
        tell, count = Countdown(say, "pictures of the body:"), len(instants) * len(quantities)
        for name, view in zip(names, solved, strict=True):
            layout = layout_of(given(view))
            for quantity in quantities:
                path = folder / f"{name}_{quantity.name}.png"
                tell(len(made), count, path.stem)
                for page in draw_pages([given(view)], quantity, layout):
                    style.save(page, path)
                made.append(path)
        return [*made, *fields]

    return on_root(comm, draw)


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
        # time counts cycles
        paraview.write_instant(file, grid, now.cycle + (now.leg + now.s) / legs)
        return view_of(bulk, fields, now)

    return on_root(bulk.comm, write)


def draw_pages(
    views: Sequence[View],
    quantity: Quantity,
    layout: Layout,
    clocks: Sequence[Clock | None] = (None,),
) -> Iterator[Figure]:
    """Yield the pages of a stress of several views with the same units, layout and colours."""
    values = [scaled(view, quantity) for view in views]
    seen = np.concatenate([layout.shows(view.moved) for view in views])
    areas = np.concatenate([vertex_areas(view.points, view.cells) for view in views])[seen]
    symbol = views[0].pressure_symbol
    colours, levels = colours_of(np.concatenate(values)[seen], quantity, symbol, areas)
    for view, field, clock in zip(views, values, clocks, strict=True):
        shown = colours.limits, colours.table, layout.window, layout.pixels
        pixels = render(view.moved, view.cells, field, *shown)
        contours = (field, levels) if len(levels) else None
        with mpl.rc_context(style.RC):
            page = compose(view, layout, pixels, colours, clock, contours)
        yield page


def draw_mode(bulk: Stack, critical: CriticalFriction | None, file: Path) -> Path | None:
    """Draw the body deformed by a slip mode (rank 0's), without loads, at the mode's friction."""
    n, none = len(bulk.contact.x), np.zeros(len(bulk.scene.load_names))

    def checked() -> CriticalFriction:
        found = given(critical)
        if len(found.signs) != n or not found.mode.any():
            raise InputError(
                f"slip mode: a mode of the scene's {n} contact nodes is needed, not one of "
                f"{len(found.signs)} with largest entry {np.abs(found.mode).max():g}"
            )
        return found

    critical = bulk.comm.bcast(on_root(bulk.comm, checked))
    signs = critical.signs
    force = np.abs(critical.reactions).reshape(2, n).max(axis=0)
    slips = np.where(signs > 0.0, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    # reaction over the largest one below which a node without a direction of slip is open
    stays = np.where(force > 1e-9 * force.max(), State.STICK, State.SEPARATION)
    states = np.where(signs != 0.0, slips, stays).astype(np.int8)
    state = ContactState(critical.mode, critical.reactions, states)
    now = Instant(0, 0, 0.0, none, critical.mode[:n], state)
    parts = gather_fields(solve_fields(bulk, none, critical.mode))

    def draw() -> Path:
        fields = given(parts)
        view = view_of(bulk, fields, now, Units(units_of(bulk, [fields], none).factor, 1.0, ""))
        f = [critical.factor * c for c in (view.f.forward, view.f.backward)]
        text = rf"changes in a slip mode, slip as assumed, $\varphi$ = {critical.factor:.4g}"
        view = replace(view, caption=text, f=Friction(*f))
        for page in draw_pages([view], quantity_of("von_mises"), layout_of(view)):
            style.save(page, file)
        return file

    return on_root(bulk.comm, draw)
