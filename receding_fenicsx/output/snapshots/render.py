"""Off-screen rendering of fields on plane meshes by pyvista, in a separate process.

VTK ends the whole process if a graphics library is missing or conflicts with another one. It never
runs in the process, or the MPI job, of the study: one process draws all pictures.
"""

from __future__ import annotations

import ctypes.util
import os
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx import workers
from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import RecedingError

Pixels = NDArray[np.uint8]
"""(height, width, 3) red, green, blue, from the top row downwards."""


def start() -> None:
    """Start the process that renders; it loads its libraries while others compute."""
    workers.submit("pictures", lambda: bool(_window()))


def render(
    points: Array,
    cells: Ints,
    values: Array,
    limits: tuple[float, float],
    colours: Array,
    window: tuple[float, float, float, float],
    size: tuple[int, int],
) -> Pixels:
    """Return the image of a field at vertices (n, 2) of cells (m, 3 or 4), white beside them.

    ``limits`` are the values of the first and the last colour, ``window`` is what is shown (left,
    right, bottom, top), ``size`` is in pixels. RecedingError: no off-screen rendering.
    """
    try:
        picture = points, cells, values, limits, colours, window, size
        job = workers.submit("pictures", _render, *picture)
        return workers.result("pictures", job, 120.0)  # seconds
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecedingError(
            f"off-screen rendering failed ({reason}); install libosmesa6 (or libegl1), "
            "then see receding-fenicsx doctor"
        ) from None


@cache
def _window() -> Any:
    """Return the window of this process that all pictures are drawn in."""
    windows = {"EGL": "vtkEGLRenderWindow", "OSMesa": "vtkOSOpenGLRenderWindow"}
    found = [name for library, name in windows.items() if ctypes.util.find_library(library)]
    if not found:  # VTK would crash
        raise RecedingError("neither EGL nor OSMesa was found")
    # without its name VTK looks for a display first, and complains
    os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = found[0]
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, border=False)
    plotter.set_background("white")
    plotter.disable_anti_aliasing()
    # VTK creates its window at the first picture
    plotter.screenshot(None, return_img=True)
    return plotter


def _render(*picture: Any) -> Pixels:
    """Render a picture in this process; each pixel is the mean of two by two samples."""
    points, cells, values, limits, colours, window, size = picture
    plotter = _window()
    import pyvista as pv
    from matplotlib.colors import ListedColormap
    from PIL import Image

    faces = np.hstack([np.full((len(cells), 1), cells.shape[1]), cells]).ravel()
    mesh = pv.PolyData(np.column_stack([points, np.zeros(len(points))]), faces=faces)
    mesh.point_data["field"] = values
    plotter.clear_actors()
    plotter.render_window.SetSize(2 * size[0], 2 * size[1])
    plotter.add_mesh(
        mesh,
        scalars="field",
        cmap=ListedColormap(colours.tolist()),
        n_colors=len(colours),
        clim=limits,
        lighting=False,
        show_scalar_bar=False,
        interpolate_before_map=True,
        reset_camera=False,
        render=False,
    )
    left, right, bottom, top = window
    middle = (0.5 * (left + right), 0.5 * (bottom + top))
    plotter.camera_position = [(*middle, 1.0), (*middle, 0.0), (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * (top - bottom)
    plotter.camera.clipping_range = (0.5, 1.5)
    plotter.render()
    fine = plotter.screenshot(None, return_img=True)
    return np.asarray(Image.fromarray(np.ascontiguousarray(fine)).reduce(2), dtype=np.uint8)
