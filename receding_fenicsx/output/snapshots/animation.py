"""Films of one cycle as MP4 and GIF: a stress on the body, states and tractions, loads over time.

All frames have the same units and colours. FFmpeg (of imageio-ffmpeg) writes both.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import make_folder, new_file
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.mpi import on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.plots.labels import load_symbol, peak, pressure_of
from receding_fenicsx.output.snapshots.colours import Quantity
from receding_fenicsx.output.snapshots.draw import draw_pages
from receding_fenicsx.output.snapshots.page import Clock, layout_of, traction_limits
from receding_fenicsx.output.snapshots.view import largest_factors, units_of, view_of
from receding_fenicsx.timing import Countdown, Say

if TYPE_CHECKING:
    from receding_fenicsx.bulk.stack import Stack

Frame = NDArray[np.uint8]
"""(height, width, 3) array of red, green and blue."""


@dataclass(frozen=True)
class Scenario:
    """The instants of a film."""

    instants: list[Instant]  # states of the modelled contact nodes, in order of time
    time: Array  # (n,) time of each instant in the film, from 0 to 1


def animate(
    bulk: Stack,
    scenario: Scenario | None,
    quantity: Quantity,
    path: Path,
    say: Say | None = None,
) -> list[Path] | None:
    """Make a film of rank 0's scenario, ``path`` with endings .mp4 and .gif; collective."""
    film: Scenario = bulk.comm.bcast(scenario)
    fields: list[Fields] = []
    tell = Countdown(say, "fields:")
    for now in film.instants:
        where = f"cycle {now.cycle}, leg {now.leg}, s = {now.s:.3f}"
        tell(len(fields), len(film.instants), where)
        found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
        if found is not None:
            # keep one stress only: all stresses of all frames would take much memory
            fields.append(replace(found, stress={quantity.name: found.stress[quantity.name]}))

    def write() -> list[Path]:
        frames = draw_frames(bulk, film, fields, quantity, say)
        make_folder(path.parent)
        if say is not None:
            say("coding the film")
        made = [path.with_name(f"{path.name}{ending}") for ending in (".mp4", ".gif")]
        for file in made:
            write_film(file, frames)
        return made

    return on_root(bulk.comm, write)


def draw_frames(
    bulk: Stack,
    film: Scenario,
    fields: list[Fields],
    quantity: Quantity,
    say: Say | None = None,
) -> list[Frame]:
    """Draw the frames of a film, on rank 0."""
    largest = largest_factors(bulk.scene)
    symbol = pressure_of(bulk.scene, bulk.scene.load_names)[1]
    units = units_of(bulk, fields, largest, peak(symbol) if symbol else "")
    views = [
        view_of(bulk, found, now, units) for found, now in zip(fields, film.instants, strict=True)
    ]
    limits = np.array([traction_limits(view) for view in views])
    load = np.array([now.load for now in film.instants]) / largest
    first = Clock(
        time=film.time,
        load=load,
        names=tuple(f"${load_symbol(name)}$" for name in bulk.scene.load_names),
        now=0.0,
        now_load=load[0],
        tractions=(float(limits[:, 0].min()), float(limits[:, 1].max())),
        legend=free_place(views[0].x, np.array([view.p for view in views])),
    )
    clocks = [
        replace(first, now=float(now), now_load=part)
        for now, part in zip(film.time, load, strict=True)
    ]
    frames: list[Frame] = []
    tell = Countdown(say, "frames:")
    # dots per inch for a width of 1280 pixels
    for page in draw_pages(views, quantity, layout_of(*views, dpi=171.0), clocks):
        tell(len(frames), len(views), f"time {clocks[len(frames)].now:.2f} of 1")
        canvas = FigureCanvasAgg(page)
        with mpl.rc_context(style.RC):
            canvas.draw()
        frames.append(np.array(canvas.buffer_rgba())[:, :, :3])
    return frames


def free_place(x: Array, p: Array) -> str:
    """Return the place of a legend where p (n, N) is the lowest in all n pictures."""
    third = np.clip((3.0 * (x - x[0]) / (x[-1] - x[0])).astype(int), 0, 2)
    highest = [float(np.nanmax(p[:, third == k])) for k in (2, 0, 1)]
    return ("upper right", "upper left", "upper center")[int(np.argmin(highest))]


def write_film(path: Path, frames: list[Frame]) -> None:
    """Write frames as an MP4 file, coded as H.264, or as an endless GIF with one palette."""
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
