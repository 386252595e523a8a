"""Pictures of a stress on the deformed body, and films of a cycle as MP4 and GIF.

One picture for each instant and stress, as wide as a journal page: pyvista renders the field,
Matplotlib draws the page around it. All frames of a film have the same units and colours.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import InputError, RecedingError
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.branches.critical_friction import CriticalFriction
from receding_fenicsx.interface.law import Friction, State
from receding_fenicsx.interface.system import ContactState
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_symbol, peak, pressure_of
from receding_fenicsx.output.snapshots import paraview
from receding_fenicsx.output.snapshots.page import (
    QUANTITIES,
    Clock,
    Layout,
    Quantity,
    colours_of,
    compose,
    layout_of,
    quantity_of,
)
from receding_fenicsx.output.snapshots.render import render
from receding_fenicsx.output.snapshots.view import (
    Units,
    View,
    largest_factors,
    units_of,
    vertex_areas,
    view_of,
    whole_contact,
)
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
    """Draw stresses at instants into a folder; write ``fields`` beside it; collective."""
    comm, beside = bulk.comm, folder.parent / "fields"
    names = [f"cycle{now.cycle:04d}_leg{now.leg}_s{now.s:.3f}" for now in instants]
    solved = [fields_at(bulk, now.load, np.concatenate([now.v, now.state.w])) for now in instants]

    def draw() -> list[Path]:
        make_folder(folder)
        make_folder(beside)
        history, files = history_from_scene(bulk.scene), [beside / f"{n}.xdmf" for n in names]
        # all fields first: they need no graphics library
        for now, file, fields in zip(instants, files, map(given, solved), strict=True):
            legs = len(history.path if now.cycle == 0 else history.loop) - 1
            grid = paraview.grid_of(fields, whole_contact(bulk, now))
            # time counts cycles
            paraview.write_instant(file, grid, now.cycle + (now.leg + now.s) / legs)
        made: list[Path] = []
        tell, count = Countdown(say, "pictures of the body:"), len(instants) * len(quantities)
        for name, now, fields in zip(names, instants, map(given, solved), strict=True):
            view = view_of(bulk, fields, now)
            for quantity in quantities:
                path = folder / f"{name}_{quantity.name}.png"
                tell(len(made), count, path.stem)
                for page in draw_pages([view], quantity, layout_of(view)):
                    style.save(page, path)
                made.append(path)
        return [*made, *files]

    return on_root(comm, draw)


def draw_pages(
    views: Sequence[View],
    quantity: Quantity,
    layout: Layout,
    clocks: Sequence[Clock | None] = (None,),
) -> Iterator[Figure]:
    """Yield the pages of a stress of several views with the same units, layout and colours."""
    # fringes show 2 tau_max, the difference of principal stresses
    values = [view.stress[quantity.name] * (1.0 + quantity.fringes) for view in views]
    left, right, bottom, top = layout.window
    x, y = np.concatenate([view.moved for view in views]).T
    seen = (left <= x) & (x <= right) & (bottom <= y) & (y <= top)
    areas = np.concatenate([vertex_areas(view.points, view.cells) for view in views])[seen]
    symbol = views[0].pressure_symbol
    colours = colours_of(np.concatenate(values)[seen], quantity, symbol, areas)
    for view, field, clock in zip(views, values, clocks, strict=True):
        shown = colours.limits, colours.table, layout.window, layout.pixels
        pixels = render(view.moved, view.cells, field, *shown)
        with mpl.rc_context(style.RC):
            page = compose(view, layout, pixels, colours, clock, field)
        yield page


def draw_mode(bulk: Stack, critical: CriticalFriction | None, file: Path) -> Path | None:
    """Draw the body deformed by a slip mode (rank 0's), without loads, at the mode's friction."""
    n, none = len(bulk.contact.x), np.zeros(len(bulk.scene.load_names))
    critical = given(bulk.comm.bcast(critical))
    if len(critical.signs) != n or not critical.mode.any():
        raise InputError(
            f"slip mode: a mode of the scene's {n} contact nodes is needed, not one of "
            f"{len(critical.signs)} with largest entry {np.abs(critical.mode).max():g}"
        )
    signs = critical.signs
    force = np.abs(critical.reactions).reshape(2, n).max(axis=0)
    slips = np.where(signs > 0.0, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    # reaction over the largest one below which a node without a direction of slip is open
    stays = np.where(force > 1e-9 * force.max(), State.STICK, State.SEPARATION)
    states = np.where(signs != 0.0, slips, stays).astype(np.int8)
    state = ContactState(critical.mode, critical.reactions, states)
    now = Instant(0, 0, 0.0, none, critical.mode[:n], state)
    parts = fields_at(bulk, none, critical.mode)

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


def animate(
    bulk: Stack,
    instants: Sequence[Instant],
    time: Array,
    quantity: Quantity,
    path: Path,
    say: Say | None = None,
) -> list[Path] | None:
    """Make a film, ``path`` with .mp4 and .gif, of instants at times from 0 to 1; collective."""
    fields: list[Fields] = []
    tell = Countdown(say, "fields:")
    for now in instants:
        where = f"cycle {now.cycle}, leg {now.leg}, s = {now.s:.3f}"
        tell(len(fields), len(instants), where)
        found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
        if found is not None:
            # keep one stress only: all stresses of all frames would take much memory
            fields.append(replace(found, stress={quantity.name: found.stress[quantity.name]}))

    def write() -> list[Path]:
        largest = largest_factors(bulk.scene)
        symbol = pressure_of(bulk.scene, bulk.scene.load_names)[1]
        units = units_of(bulk, fields, largest, peak(symbol) if symbol else "")
        views = [view_of(bulk, *now, units) for now in zip(fields, instants, strict=True)]
        # the legend is where p is the lowest in all pictures
        x, p = views[0].x, np.array([view.p for view in views])
        third = np.clip((3.0 * (x - x[0]) / (x[-1] - x[0])).astype(int), 0, 2)
        highest = [float(np.nanmax(p[:, third == k])) for k in (2, 0, 1)]
        legend = ("upper right", "upper left", "upper center")[int(np.argmin(highest))]
        known = np.isfinite(views[0].p)
        shown = [(view.p[known], view.q[known], view.f[known]) for view in views]
        limits = np.array([style.focus(p, np.concatenate([q, *f.limits(p)])) for p, q, f in shown])
        both = float(limits[:, 0].min()), float(limits[:, 1].max())
        load = np.array([now.load for now in instants]) / largest
        names = tuple(f"${load_symbol(name)}$" for name in bulk.scene.load_names)
        clocks = [
            Clock(time, load, names, float(now), part, both, legend)
            for now, part in zip(time, load, strict=True)
        ]
        frames: list[NDArray[np.uint8]] = []
        tell = Countdown(say, "frames:")
        # dots per inch for a width of 1280 pixels
        for page in draw_pages(views, quantity, layout_of(*views, dpi=171.0), clocks):
            tell(len(frames), len(views), f"time {clocks[len(frames)].now:.2f} of 1")
            canvas = FigureCanvasAgg(page)
            with mpl.rc_context(style.RC):
                canvas.draw()
            frames.append(np.array(canvas.buffer_rgba())[:, :, :3])
        make_folder(path.parent)
        if say is not None:
            say("coding the film")
        made = [path.with_name(f"{path.name}{ending}") for ending in (".mp4", ".gif")]
        for file in made:
            write_film(file, frames)
        return made

    return on_root(bulk.comm, write)


def write_film(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    """Write frames (height, width, 3) as MP4, coded as H.264, or as endless GIF of one palette."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        program = get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise RecedingError(f"film: {error}; pip install imageio-ffmpeg") from None
    # H.264 needs an even number of pixels
    height, width = (n - n % 2 for n in frames[0].shape[:2])
    if path.suffix == ".mp4":
        coding = "-c:v libx264 -crf 20 -pix_fmt yuv420p -movflags +faststart -f mp4"
    else:  # at most 800 pixels wide, of one palette
        coding = "-f gif -filter_complex scale=min(800\\,iw):-1:flags=lanczos,split[a][b];"
        coding += "[a]palettegen[c];[b][c]paletteuse=dither=none"
    with new_file(path, overwrite=True) as beside, tempfile.TemporaryFile() as raw:
        # the last frame stays for half a second before the film starts again
        for frame in [*frames, *[frames[-1]] * 6]:
            raw.write(np.ascontiguousarray(frame[:height, :width]).tobytes())
        raw.seek(0)
        command = [program, "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
        command += ["-s", f"{width}x{height}", "-r", "12", "-i", "pipe:0"]
        command += [*coding.split(), str(beside)]
        # FFmpeg reads a file, not a pipe: PETSc would end the job at a broken pipe
        done = subprocess.run(
            command, stdin=raw, capture_output=True, env=child_environment(), timeout=300.0
        )
        if done.returncode != 0:
            last = (done.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
            raise RecedingError(f"film: FFmpeg failed ({last})")
