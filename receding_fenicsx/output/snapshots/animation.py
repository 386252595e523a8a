"""A film of one cycle: the body with a stress, the contact's states and tractions, the loads.

The frames are pictures as of :mod:`snapshots`, all in the same units and colours. FFmpeg, which
comes with imageio-ffmpeg, makes an MP4 of them; a GIF needs only Pillow.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.evolution.collect import Instant
from receding_fenicsx.interface.system import Array
from receding_fenicsx.mpi import on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.units import load_symbol, peak, pressure_of
from receding_fenicsx.output.snapshots.draw import Quantity, colours_of, scaled
from receding_fenicsx.output.snapshots.layout import Clock, compose, layout_of
from receding_fenicsx.output.snapshots.render import Picture, find_renderer, renderer
from receding_fenicsx.output.snapshots.view import (
    View,
    largest_factors,
    units_of,
    vertex_areas,
    view_of,
)

if TYPE_CHECKING:
    from receding_fenicsx.bulk.body import Bulk
    from receding_fenicsx.bulk.two_bodies import Pair

FILM_DPI = 171.0
"""Dots per inch of a frame: 1280 wide."""
GIF_WIDTH = 800
GIF_COLOURS = 96
FRAMES_PER_SECOND = 12
HELD = 6
"""Frames that the film stands still at the end, before it starts again."""
PATIENCE = 300.0
"""Seconds that FFmpeg may take."""

Frame = NDArray[np.uint8]
"""(height, width, 3) red, green, blue."""


@dataclass(frozen=True)
class Scenario:
    """The instants of a film.

    Attributes:
        instants: states of the modelled contact nodes in their order.
        time: (n,) progress of the film at each, from 0 to 1.
    """

    instants: list[Instant]
    time: Array


def animate(
    bulk: Bulk | Pair, scenario: Scenario | None, quantity: Quantity, path: Path
) -> list[Path] | None:
    """Make a film; all ranks call this together.

    Args:
        bulk: the body.
        scenario: its instants; only rank 0's is used.
        quantity: the stress that is drawn.
        path: the files without their endings, ``.mp4`` and ``.gif``.

    Returns:
        The files made, on rank 0; None elsewhere.

    Raises:
        RecedingError: nothing can be drawn off-screen on this machine, or FFmpeg failed.
    """
    on_root(bulk.comm, find_renderer)
    film: Scenario = bulk.comm.bcast(scenario)
    fields = []
    for now in film.instants:
        found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
        if found is not None:
            # the other stresses of all frames would be much to keep
            stress = {quantity.name: found.stress[quantity.name]}
            fields.append(Fields(found.points, found.cells, found.displacement, stress))

    def write() -> list[Path]:
        frames = draw_frames(bulk, film, fields, quantity)
        make_folder(path.parent)
        made = [path.with_name(f"{path.name}{ending}") for ending in (".mp4", ".gif")]
        write_mp4(made[0], frames)
        write_gif(made[1], frames)
        return made

    return on_root(bulk.comm, write)


def draw_frames(
    bulk: Bulk | Pair, film: Scenario, fields: list[Fields], quantity: Quantity
) -> list[Frame]:
    """Draw the frames of a film, on rank 0."""
    largest = largest_factors(bulk.scene)
    symbol = pressure_of(bulk.scene, bulk.load_names)[1]
    units = units_of(bulk, fields, largest, peak(symbol) if symbol else "")
    views = [
        view_of(bulk, found, now, units) for found, now in zip(fields, film.instants, strict=True)
    ]
    values = [scaled(view, quantity) for view in views]
    limits = np.array([style.focus(*_tractions(view)) for view in views])
    legend = free_place(views[0].x, np.array([view.p for view in views]))
    load = np.array([now.load for now in film.instants]) / largest
    frames = []
    with mpl.rc_context(style.RC):
        layout = layout_of(*views, dpi=FILM_DPI)
        seen = [layout.shows(view.moved) for view in views]
        colours, levels = colours_of(
            np.concatenate([v[here] for v, here in zip(values, seen, strict=True)]),
            quantity,
            units.symbol,
            np.concatenate([vertex_areas(v)[here] for v, here in zip(views, seen, strict=True)]),
        )
        for view, field, now, part in zip(views, values, film.time, load, strict=True):
            clock = Clock(
                time=film.time,
                load=load,
                names=tuple(_load_name(name) for name in bulk.load_names),
                now=float(now),
                now_load=part,
                tractions=(float(limits[:, 0].min()), float(limits[:, 1].max())),
                legend=legend,
            )
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
            pixels = renderer.draw(picture)
            canvas = FigureCanvasAgg(compose(view, layout, pixels, colours, clock))
            canvas.draw()
            frames.append(np.array(canvas.buffer_rgba())[:, :, :3])
    return frames


def free_place(x: Array, p: Array) -> str:
    """Return where above the contact, to the right, left or middle, the pressure stays lowest.

    Args:
        x: (N,) positions.
        p: (n, N) tractions in the pictures of a film; nan where a node stands for no length.
    """
    third = np.clip((3.0 * (x - x[0]) / (x[-1] - x[0])).astype(int), 0, 2)
    highest = [float(np.nanmax(p[:, third == k])) for k in (2, 0, 1)]
    return ("upper right", "upper left", "upper center")[int(np.argmin(highest))]


def _tractions(view: View) -> tuple[Array, Array]:
    """p, and what is drawn with it, where they are known."""
    known = np.isfinite(view.p)
    limit = (view.f * view.p)[known]
    return view.p[known], np.concatenate([view.q[known], limit, -limit])


def write_mp4(path: Path, frames: list[Frame]) -> None:
    """Write frames as H.264, which every browser and presentation shows.

    Raises:
        RecedingError: FFmpeg is missing or failed.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        program = get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise RecedingError(f"film: {error}; pip install imageio-ffmpeg") from None
    # the coder wants even numbers of dots
    height, width = (n - n % 2 for n in frames[0].shape[:2])
    with new_file(path, overwrite=True) as beside, tempfile.TemporaryFile() as raw:
        for frame in [*frames, *[frames[-1]] * HELD]:
            raw.write(np.ascontiguousarray(frame[:height, :width]).tobytes())
        raw.seek(0)
        command = [program, "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
        command += ["-s", f"{width}x{height}", "-r", str(FRAMES_PER_SECOND), "-i", "pipe:0"]
        command += ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p"]
        command += ["-movflags", "+faststart", "-f", "mp4", str(beside)]
        # FFmpeg reads a file, not a pipe: PETSc would end the job at a broken one
        done = subprocess.run(
            command, stdin=raw, capture_output=True, env=child_environment(), timeout=PATIENCE
        )
        if done.returncode != 0:
            last = (done.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
            raise RecedingError(f"film: FFmpeg failed ({last})")


def write_gif(path: Path, frames: list[Frame]) -> None:
    """Write frames as an endless GIF with one palette for all."""
    from PIL import Image

    height, width = frames[0].shape[:2]
    size = min(width, GIF_WIDTH), round(height * min(width, GIF_WIDTH) / width)
    small = [Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS) for frame in frames]
    sheet = Image.new("RGB", (size[0], size[1] * 3))
    for n, k in enumerate((0, len(small) // 2, len(small) - 1)):
        sheet.paste(small[k], (0, n * size[1]))
    # the colours that have a meaning are kept as they are, the others share what is left
    kept = [*style.STATE_COLOURS.values(), style.SHEAR_COLOUR]
    others = sheet.quantize(GIF_COLOURS - len(kept), method=Image.Quantize.MEDIANCUT).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette(
        [round(255.0 * part) for colour in kept for part in to_rgb(colour)] + list(others or [])
    )
    pages = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in small]
    step = 1000 / FRAMES_PER_SECOND
    with new_file(path, overwrite=True) as beside:
        pages[0].save(
            beside,
            format="GIF",
            save_all=True,
            append_images=pages[1:],
            duration=[round(step)] * (len(pages) - 1) + [round(step * (HELD + 1))],
            loop=0,
        )


def _load_name(name: str) -> str:
    return f"${load_symbol(name)}$"
