"""Off-screen rendering of fields on plane meshes by VTK, in a separate process.

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
            self.child = ChildProcess(f"{__name__}:stage", window)

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
            words = child.last_words()
            raise RecedingError(f"off-screen rendering failed ({words}); {ADVICE}") from None
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


def stage() -> Work:
    """Return the function that draws pictures in this process, all in one window."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - the classes that draw
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

    window, scene = vtkRenderWindow(), vtkRenderer()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.AddRenderer(scene)
    scene.SetBackground(1.0, 1.0, 1.0)
    scene.GetActiveCamera().SetParallelProjection(True)
    # VTK opens its window at the first picture
    window.SetSize(SAMPLES, SAMPLES)
    window.Render()

    def draw(picture: Picture, send: Callable[[Pixels], None]) -> None:
        from PIL import Image

        scene.RemoveAllViewProps()
        scene.AddActor(_actor(picture))
        left, right, bottom, top = picture.window
        camera = scene.GetActiveCamera()
        middle = (0.5 * (left + right), 0.5 * (bottom + top))
        camera.SetPosition(*middle, 1.0)
        camera.SetFocalPoint(*middle, 0.0)
        camera.SetParallelScale(0.5 * (top - bottom))
        camera.SetClippingRange(0.5, 1.5)
        window.SetSize(*(SAMPLES * length for length in picture.size))
        window.Render()
        send(np.asarray(Image.fromarray(_pixels_of(window)).reduce(SAMPLES)))

    return draw


def _actor(picture: Picture) -> Any:
    """Return the field of a picture as VTK draws it: colours of interpolated values."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkLookupTable, vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    if len(picture.values) != len(picture.points):
        raise ValueError(f"{len(picture.values)} values at {len(picture.points)} vertices")
    mesh, points, cells, table = vtkPolyData(), vtkPoints(), vtkCellArray(), vtkLookupTable()
    flat = np.column_stack([picture.points, np.zeros(len(picture.points))])
    points.SetData(numpy_to_vtk(flat, deep=True))
    count, width = picture.cells.shape
    begin = np.arange(0, count * width + 1, width, dtype=np.int64)
    corners = np.ascontiguousarray(picture.cells, dtype=np.int64).ravel()
    cells.SetData(numpy_to_vtkIdTypeArray(begin, deep=True), numpy_to_vtkIdTypeArray(corners, True))
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    mesh.GetPointData().SetScalars(numpy_to_vtk(np.asarray(picture.values, float), deep=True))
    opaque = np.column_stack([picture.colours[:, :3], np.ones(len(picture.colours))])
    table.SetNumberOfTableValues(len(opaque))
    table.SetTable(numpy_to_vtk(np.round(255.0 * opaque).astype(np.uint8), deep=True))
    table.SetRange(*picture.limits)
    mapper, actor = vtkPolyDataMapper(), vtkActor()
    mapper.SetInputData(mesh)
    mapper.SetLookupTable(table)
    mapper.SetUseLookupTableScalarRange(True)
    mapper.SetInterpolateScalarsBeforeMapping(True)
    actor.SetMapper(mapper)
    actor.GetProperty().SetLighting(False)
    return actor


def _pixels_of(window: Any) -> Pixels:
    """Return what a window shows."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    width, height = window.GetSize()
    pixels = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
    return np.ascontiguousarray(vtk_to_numpy(pixels).reshape(height, width, 3)[::-1])
