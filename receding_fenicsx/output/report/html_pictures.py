"""Figures and pictures of the body embedded in a report, with their captions."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

OTHER_CAPTIONS = {
    "accuracy": "Twice the estimated errors of the numbers over time, mesh by mesh.",
    "max_shear": "Isochromatic fringes: contours of the largest in-plane shear stress.",
    "von_mises": "Von Mises equivalent stress.",
}
"""Captions of pictures that are not in the registry of figures, by the end of the file name."""


@dataclass(frozen=True)
class Picture:
    """A picture as a data URL, with its name and caption; a wide one has the page's width."""

    name: str
    caption: str
    source: str
    wide: bool


def figures(paths: Sequence[Path], edges: set[str]) -> list[Picture]:
    """Return figures in the order of the registry; name the edge of those in an edge's folder."""
    if not paths:
        return []
    from PIL import Image

    from receding_fenicsx.output.plots.figures import FIGURES

    def entry(path: Path) -> str | None:
        names = (n for n, e in FIGURES.items() if e.each and path.stem.startswith(f"{n}_"))
        return path.stem if path.stem in FIGURES else next(names, None)

    order = [*FIGURES, None]
    shown = []
    for path in sorted(paths, key=lambda path: (order.index(entry(path)), str(path))):
        with Image.open(path) as image:
            # width in pixels above which a figure takes the width of the page
            wide = image.width > 1600
        name = entry(path)
        caption = f"On {path.parent.name}: " if path.parent.name in edges else ""
        caption += _caption(path) if name is None else FIGURES[name].caption or path.stem
        shown.append(Picture(path.stem, caption, _source("png", path.read_bytes()), wide))
    return shown


def snapshots(paths: Sequence[Path]) -> list[Picture]:
    """Return pictures of the body, reduced in size and as JPEG."""
    shown = []
    for path in paths:
        from PIL import Image

        with Image.open(path) as image:
            # approximate width in pixels of an embedded picture of the body: whole pixels are
            # averaged
            small = image.convert("RGB").reduce(max(1, round(image.width / 1200)))
        data = io.BytesIO()
        small.save(data, "JPEG", quality=90, subsampling=0)
        found = re.match(r"cycle(\d+)_leg(\d+)_s([\d.]+)", path.stem)
        where = f"Cycle {int(found[1])}, leg {found[2]}, s = {float(found[3]):g}. " if found else ""
        source = _source("jpeg", data.getvalue())
        shown.append(Picture(path.stem, where + _caption(path), source, True))
    return shown


def _caption(path: Path) -> str:
    """Return the caption of a picture that is no registered figure; its name if it has none."""
    return next((text for k, text in OTHER_CAPTIONS.items() if path.stem.endswith(k)), path.stem)


def _source(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
