"""Off-screen rendering of fields on plane meshes by pyvista, in a separate process.

VTK ends the whole process if a graphics library is missing or conflicts with another library. It
therefore never runs in the process, or the MPI job, of the study, which starts ``serve`` once and
sends it the pictures to draw.
"""

from __future__ import annotations

import atexit
import ctypes.util
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.environment import child_environment
from receding_fenicsx.errors import RecedingError

RENDERERS = {"EGL": "vtkEGLRenderWindow", "OSMesa": "vtkOSOpenGLRenderWindow"}
"""Libraries of off-screen rendering, and VTK's window class for each."""
TIMEOUT = 120.0
"""Largest time of one picture in seconds."""
NO_SIGNAL = getattr(socket, "MSG_NOSIGNAL", 0)
"""Flag that replaces SIGPIPE by an error: PETSc ends the job at this signal."""
ADVICE = "install libosmesa6 (or libegl1), then see receding-fenicsx doctor"

Pixels = NDArray[np.uint8]
"""(height, width, 4) red, green, blue, opacity."""


@dataclass(frozen=True)
class Picture:
    """A field on a plane mesh.

    Attributes:
        points: (n, 2) vertices.
        cells: (m, 3 or 4) vertices around each cell.
        values: (n,) field.
        limits: values of the first and the last colour.
        colours: (k, 3 or 4) colours in [0, 1].
        levels: values at which contour lines are drawn.
        window: left, right, bottom and top of what is shown.
        size: width and height in pixels.
    """

    points: Array
    cells: NDArray[np.int64]
    values: Array
    limits: tuple[float, float]
    colours: Array
    levels: Array
    window: tuple[float, float, float, float]
    size: tuple[int, int]


class Renderer:
    """A process that renders pictures; it starts with the first picture."""

    def __init__(self) -> None:
        """Start no process yet."""
        self.process: subprocess.Popen[bytes] | None = None
        self.line: socket.socket | None = None
        self.log: IO[bytes] | None = None

    def draw(self, picture: Picture) -> Pixels:
        """Draw a picture.

        Raises:
            RecedingError: off-screen rendering does not work on this machine.
        """
        if self.process is None:
            self._start()
        assert self.process is not None
        assert self.line is not None
        timer = threading.Timer(TIMEOUT, self.process.kill)
        timer.start()
        try:
            self.line.sendall(pickle.dumps(picture), NO_SIGNAL)
            with self.line.makefile("rb") as answers:
                answer = pickle.load(answers)
        except (OSError, EOFError, pickle.UnpicklingError):
            raise RecedingError(
                f"off-screen rendering failed ({self._last_words()}); {ADVICE}"
            ) from None
        finally:
            timer.cancel()
        if isinstance(answer, str):
            raise RecedingError(f"off-screen rendering failed ({answer}); {ADVICE}")
        return np.asarray(answer, dtype=np.uint8)

    def close(self) -> None:
        """End the process, if there is one."""
        process, self.process = self.process, None
        if process is not None:
            assert self.line is not None
            self.line.close()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _start(self) -> None:
        window = find_renderer()
        root = str(Path(__file__).resolve().parents[2])
        program = f"import sys; sys.path.insert(0, {root!r}); from {__name__} import serve; serve()"
        self.log = tempfile.TemporaryFile()
        self.line, other = socket.socketpair()
        with other:
            self.process = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=other.fileno(),
                stdout=other.fileno(),
                stderr=self.log,
                # without the window's name VTK looks for a display first, and complains
                env={"VTK_DEFAULT_OPENGL_WINDOW": window, **child_environment()},
            )

    def _last_words(self) -> str:
        """End the process; return the last line that it wrote, or its exit status."""
        process, self.process = self.process, None
        assert process is not None
        assert self.log is not None
        assert self.line is not None
        self.line.close()
        process.kill()
        status = process.wait()
        self.log.seek(0)
        lines = self.log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"the rendering process ended with status {status}"


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


def serve() -> None:
    """Draw pictures read from standard input until it ends; main program of the process."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with answers
    while True:
        try:
            picture = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer: Any = draw(picture)
        except Exception as error:
            answer = f"{type(error).__name__}: {error}".splitlines()[0]
        pickle.dump(answer, answers)
        answers.flush()


def draw(picture: Picture) -> Pixels:
    """Draw a picture in this process."""
    import pyvista as pv
    from matplotlib.colors import ListedColormap

    plotter = pv.Plotter(off_screen=True, window_size=list(picture.size), border=False)
    try:
        plotter.set_background("white")
        mesh = _mesh(pv, picture)
        plotter.add_mesh(
            mesh,
            scalars="field",
            cmap=ListedColormap(picture.colours.tolist()),
            n_colors=len(picture.colours),
            clim=picture.limits,
            lighting=False,
            show_scalar_bar=False,
            interpolate_before_map=True,
        )
        low, high = float(picture.values.min()), float(picture.values.max())
        inside = [level for level in picture.levels.tolist() if low < level < high]
        if inside:
            lines = mesh.contour(inside, scalars="field")
            plotter.add_mesh(lines, color="black", opacity=0.5, line_width=2.0, lighting=False)
        left, right, bottom, top = picture.window
        middle = (0.5 * (left + right), 0.5 * (bottom + top))
        plotter.camera_position = [(*middle, 1.0), (*middle, 0.0), (0.0, 1.0, 0.0)]
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 0.5 * (top - bottom)
        plotter.camera.clipping_range = (0.5, 1.5)
        plotter.enable_anti_aliasing("ssaa")
        pixels = plotter.screenshot(None, return_img=True, transparent_background=True)
    finally:
        plotter.close()
    return np.ascontiguousarray(pixels)


def _mesh(pv: Any, picture: Picture) -> Any:
    """Return the mesh with its field as VTK data."""
    width = picture.cells.shape[1]
    faces = np.hstack([np.full((len(picture.cells), 1), width), picture.cells]).ravel()
    points = np.column_stack([picture.points, np.zeros(len(picture.points))])
    mesh = pv.PolyData(points, faces=faces)
    mesh.point_data["field"] = picture.values
    return mesh
