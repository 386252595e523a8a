"""Off-screen rendering of fields on plane meshes by pyvista, in a separate process.

VTK ends the whole process if a graphics library is missing or conflicts with another library. It
therefore never runs in the process, or the MPI job, of the study, which starts one process for all
pictures and sends it the fields.
"""

from __future__ import annotations

import atexit
import ctypes.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.output.plots.child_process import ChildProcess, Work

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


class Renderer:
    """A process that renders pictures; it starts with the first picture, or by ``start``."""

    def __init__(self) -> None:
        """Start no process yet."""
        self.child: ChildProcess | None = None

    def start(self) -> None:
        """Start the process if there is none; it loads its libraries while others compute.

        Raises:
            RecedingError: no library for off-screen rendering was found.
        """
        if self.child is None:
            # without the window's name VTK looks for a display first, and complains
            window = {"VTK_DEFAULT_OPENGL_WINDOW": find_renderer()}
            self.child = ChildProcess(f"{__name__}:prepare", window)

    def draw(self, picture: Picture) -> Pixels:
        """Draw a picture.

        Raises:
            RecedingError: off-screen rendering does not work on this machine.
        """
        self.start()
        assert self.child is not None
        try:
            self.child.ask(picture)
            answer = self.child.answer(TIMEOUT)
        except (OSError, EOFError):
            child, self.child = self.child, None
            reason = child.kill()
            raise RecedingError(f"off-screen rendering failed ({reason}); {ADVICE}") from None
        if isinstance(answer, Exception):
            raise RecedingError(f"off-screen rendering failed ({answer}); {ADVICE}")
        return np.asarray(answer, dtype=np.uint8)

    def close(self) -> None:
        """End the process, if there is one."""
        child, self.child = self.child, None
        if child is not None:
            child.close()


renderer = Renderer()
"""Renderer of all pictures of this process."""
atexit.register(renderer.close)


def find_renderer() -> str:
    """Return the name of a window class that VTK can use on this machine.

    Raises:
        RecedingError: no library for off-screen rendering was found; VTK would crash without one.
    """
    for library, window in RENDERERS.items():
        if ctypes.util.find_library(library):
            return window
    raise RecedingError(f"no off-screen renderer: neither EGL nor OSMesa was found; {ADVICE}")


def prepare() -> Work:
    """Return the function that draws pictures in this process, all in one window."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=[SAMPLES, SAMPLES], border=False)
    plotter.set_background("white")
    plotter.disable_anti_aliasing()
    # VTK creates its window at the first picture
    plotter.screenshot(None, return_img=True)

    def draw(picture: Picture, send: Callable[[Pixels], None]) -> None:
        from PIL import Image

        _show(plotter, picture)
        plotter.render()
        fine = plotter.screenshot(None, return_img=True)
        send(np.asarray(Image.fromarray(np.ascontiguousarray(fine)).reduce(SAMPLES)))

    return draw


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
