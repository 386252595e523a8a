"""Off-screen rendering of fields on plane meshes by pyvista, in a separate process.

VTK ends the whole process if a graphics library is missing or conflicts with another library. It
therefore never runs in the process, or the MPI job, of the study, which starts one process for all
pictures and sends it the fields.
"""

from __future__ import annotations

import ctypes.util
import os
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx import workers
from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import RecedingError

POOL = "renderer"
RENDERERS = {"EGL": "vtkEGLRenderWindow", "OSMesa": "vtkOSOpenGLRenderWindow"}
"""Libraries of off-screen rendering, and VTK's window class for each."""
TIMEOUT = 120.0
"""Largest time of one picture in seconds."""
SAMPLES = 2
"""Number of samples along each side of a pixel, of which its colour is the mean."""
ADVICE = "install libosmesa6 (or libegl1), then see receding-fenicsx doctor"

Pixels = NDArray[np.uint8]
"""(height, width, 3) red, green, blue."""


@dataclass(frozen=True)
class Picture:
    """A field on a plane mesh.

    Attributes:
        points: (n, 2) vertices.
        cells: (m, 3 or 4) vertices around each cell.
        values: (n,) field.
        limits: values of the first and the last colour.
        colours: (k, 3 or 4) colours in [0, 1].
        window: left, right, bottom and top of what is shown; white beside the mesh.
        size: width and height in pixels.
    """

    points: Array
    cells: NDArray[np.int64]
    values: Array
    limits: tuple[float, float]
    colours: Array
    window: tuple[float, float, float, float]
    size: tuple[int, int]


def start() -> None:
    """Start the process that draws; it loads its libraries while others compute."""
    workers.submit(POOL, _load)


def begin(picture: Picture) -> Future[Pixels]:
    """Begin to draw a picture."""
    return workers.submit(POOL, _draw, picture)


def finish(job: Future[Pixels]) -> Pixels:
    """Wait for a picture.

    Raises:
        RecedingError: off-screen rendering does not work on this machine.
    """
    try:
        return workers.result(POOL, job, TIMEOUT)
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecedingError(f"off-screen rendering failed ({reason}); {ADVICE}") from None


def find_renderer() -> str:
    """Return the name of a window class that VTK can use on this machine.

    Raises:
        RecedingError: no library for off-screen rendering was found; VTK would crash without one.
    """
    for library, window in RENDERERS.items():
        if ctypes.util.find_library(library):
            return window
    raise RecedingError(f"no off-screen renderer: neither EGL nor OSMesa was found; {ADVICE}")


def _load() -> None:
    """Open the window."""
    _window()


@cache
def _window() -> Any:
    """Return the window of this process that all pictures are drawn in."""
    # without its name VTK looks for a display first, and complains
    os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = find_renderer()
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=[SAMPLES, SAMPLES], border=False)
    plotter.set_background("white")
    plotter.disable_anti_aliasing()
    # VTK creates its window at the first picture
    plotter.screenshot(None, return_img=True)
    return plotter


def _draw(picture: Picture) -> Pixels:
    """Draw a picture in this process."""
    from PIL import Image

    plotter = _window()
    _show(plotter, picture)
    plotter.render()
    fine = plotter.screenshot(None, return_img=True)
    return np.asarray(Image.fromarray(np.ascontiguousarray(fine)).reduce(SAMPLES), dtype=np.uint8)


def _show(plotter: Any, picture: Picture) -> None:
    """Put a field into an empty window and point the camera at it."""
    from matplotlib.colors import ListedColormap

    plotter.clear_actors()
    plotter.window_size = [SAMPLES * length for length in picture.size]
    plotter.add_mesh(
        _mesh(picture),
        scalars="field",
        cmap=ListedColormap(picture.colours.tolist()),
        n_colors=len(picture.colours),
        clim=picture.limits,
        lighting=False,
        show_scalar_bar=False,
        interpolate_before_map=True,
        reset_camera=False,
        render=False,
    )
    left, right, bottom, top = picture.window
    middle = (0.5 * (left + right), 0.5 * (bottom + top))
    plotter.camera_position = [(*middle, 1.0), (*middle, 0.0), (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * (top - bottom)
    plotter.camera.clipping_range = (0.5, 1.5)


def _mesh(picture: Picture) -> Any:
    """Return the mesh with its field as VTK data."""
    import pyvista as pv

    width = picture.cells.shape[1]
    faces = np.hstack([np.full((len(picture.cells), 1), width), picture.cells]).ravel()
    points = np.column_stack([picture.points, np.zeros(len(picture.points))])
    mesh = pv.PolyData(points, faces=faces)
    mesh.point_data["field"] = picture.values
    return mesh
