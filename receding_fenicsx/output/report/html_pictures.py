"""Figures and pictures of the body embedded in a report, with their captions."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

from receding_fenicsx.output.report import html_elements as html

PICTURE_WIDTH = 1200
"""Approximate width in pixels of an embedded picture of the body: whole pixels are averaged."""
WIDE_FIGURE = 1600
"""Width in pixels above which a figure takes the width of the page."""
JPEG_QUALITY = 90
OTHER_CAPTIONS = {
    "accuracy": "Twice the estimated errors of the numbers over time, mesh by mesh.",
    "max_shear": "Isochromatic fringes: contours of the largest in-plane shear stress.",
    "von_mises": "Von Mises equivalent stress.",
}
"""Captions of pictures that are not in the registry of figures, by the end of the file name."""


def figures(paths: Sequence[Path], edges: set[str]) -> str:
    """Return figures in the order of the registry; name the edge of those in an edge's folder."""
    if not paths:
        return ""
    from PIL import Image

    from receding_fenicsx.output.plots.figures import FIGURES

    def entry(path: Path) -> str | None:
        names = (n for n, e in FIGURES.items() if e.each and path.stem.startswith(f"{n}_"))
        return path.stem if path.stem in FIGURES else next(names, None)

    order = [*FIGURES, None]
    shown = []
    for path in sorted(paths, key=lambda path: (order.index(entry(path)), str(path))):
        with Image.open(path) as image:
            wide = image.width > WIDE_FIGURE
        name = entry(path)
        caption = f"On {path.parent.name}: " if path.parent.name in edges else ""
        caption += _caption(path) if name is None else FIGURES[name].caption or path.stem
        shown.append(html.figure(path.stem, caption, "png", path.read_bytes(), wide))
    return f'<div class="figures">{"".join(shown)}</div>'


def snapshots(paths: Sequence[Path]) -> str:
    """Return pictures of the body, reduced in size and as JPEG."""
    shown = []
    for path in paths:
        from PIL import Image

        with Image.open(path) as image:
            small = image.convert("RGB").reduce(max(1, round(image.width / PICTURE_WIDTH)))
        data = io.BytesIO()
        small.save(data, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        found = re.match(r"cycle(\d+)_leg(\d+)_s([\d.]+)", path.stem)
        where = f"Cycle {int(found[1])}, leg {found[2]}, s = {float(found[3]):g}. " if found else ""
        shown.append(html.figure(path.stem, where + _caption(path), "jpeg", data.getvalue(), True))
    return f'<div class="figures">{"".join(shown)}</div>' if shown else ""


def _caption(path: Path) -> str:
    """Return the caption of a picture that is no registered figure; its name if it has none."""
    return next((text for k, text in OTHER_CAPTIONS.items() if path.stem.endswith(k)), path.stem)
