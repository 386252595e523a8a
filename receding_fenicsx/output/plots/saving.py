"""Layout of figures, solved once, and their files: PNG, PDF and other formats of Matplotlib."""

from __future__ import annotations

import gc
import logging
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox, BboxBase
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import new_file
from receding_fenicsx.output.plots import style

PNG_LEVEL = 3
"""Compression of PNG files: level 6 needs twice the time for a tenth fewer bytes."""
INCH = 0.0254
OBJECTS = 20_000
"""Number of new objects after which Python looks for unused ones while pictures are drawn."""


@contextmanager
def drawing() -> Iterator[None]:
    """Use Matplotlib with the style of all pictures, and collect unused objects seldom."""
    before = gc.get_threshold()
    gc.set_threshold(OBJECTS, *before[1:])
    try:
        with mpl.rc_context(style.RC):
            yield
    finally:
        gc.set_threshold(*before)


def lay_out(figure: Figure) -> None:
    """Compute the positions of a figure's parts, which then stay as they are."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    with drawing():
        figure.dpi = style.DPI
        style.agg_canvas(figure)
        for axes in figure.axes:
            _measure_once(axes)
        try:
            engine.execute(figure)
        finally:
            for axes in figure.axes:
                del axes.get_tightbbox
    figure.set_layout_engine("none")


def _measure_once(axes: Axes) -> None:
    """Let axes keep the size of their labels; the layout would measure them in each of its passes.

    ``del axes.get_tightbbox`` ends it.
    """
    measure = axes.get_tightbbox
    margins: list[Array | None] = []

    def tight_box(renderer: Any, **options: Any) -> Bbox | None:
        if not margins:
            found = measure(renderer, **options)
            margins.append(None if found is None else _extents(found) - _extents(axes.bbox))
            return found
        return None if margins[0] is None else Bbox.from_extents(*_extents(axes.bbox) + margins[0])

    axes.get_tightbbox = tight_box  # type: ignore[method-assign, assignment]


def _extents(box: BboxBase) -> Array:
    """Return left, bottom, right and top of a box."""
    return np.asarray(box.extents, dtype=float)


def save(figure: Figure, path: Path) -> None:
    """Save a figure in the format of the path's ending, without the date."""
    ending = path.suffix[1:]
    options: dict[str, dict[str, Any]] = {
        "pdf": {"metadata": {"CreationDate": None}},
        "svg": {"metadata": {"Date": None}},
    }
    # the PDF writer warns about the dates inside some systems' fonts
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    with drawing(), new_file(path, overwrite=True) as beside:
        if ending == "png":
            lay_out(figure)
            figure.dpi = style.DPI
            canvas = style.agg_canvas(figure)
            canvas.draw()
            beside.write_bytes(png_of(np.asarray(canvas.buffer_rgba())[:, :, :3], style.DPI))
        else:
            figure.savefig(beside, format=ending, **options.get(ending, {}))


def png_of(pixels: NDArray[np.uint8], dpi: float) -> bytes:
    """Return an image as PNG; each row is stored as its difference from the one above.

    Pillow tries five filters for each row, which takes longer than the compression.

    Args:
        pixels: (height, width, 3) red, green and blue.
        dpi: dots per inch.
    """
    height, width, _ = pixels.shape
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = 2  # filter "up"
    rows[:, 1:] = pixels.reshape(height, -1)
    rows[1:, 1:] -= rows[:-1, 1:].copy()
    metre = round(dpi / INCH)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", metre, metre, 1)),
        (b"IDAT", zlib.compress(rows.tobytes(), PNG_LEVEL)),
        (b"IEND", b""),
    ]
    parts = [b"\x89PNG\r\n\x1a\n"]
    for kind, data in chunks:
        check = struct.pack(">I", zlib.crc32(kind + data))
        parts += [struct.pack(">I", len(data)), kind, data, check]
    return b"".join(parts)
