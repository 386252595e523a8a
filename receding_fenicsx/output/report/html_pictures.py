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
LAST_PLACE = 99
"""Order of figures without a caption of their own."""

CAPTIONS = (
    (
        "tractions_first_loading",
        "Tractions, friction cone and states at the largest load of the first loading.",
    ),
    ("zones_first_unloading", "Zones of stick, slip and separation along the first unloading."),
    (
        "tractions_first_unloading",
        "Tractions during the first unloading; the load is given above the states.",
    ),
    ("slip_per_cycle", "Slip increment of each cycle at some nodes, with fitted power of N."),
    (
        "zones_last_cycle",
        "Zones along the last cycle. Dashed line: nodes that reach the friction limit without "
        "slip.",
    ),
    ("dissipation_per_cycle", "Dissipation of each cycle over that of cycle 1."),
    ("zones_by_cycle", "Zones along all sampled cycles."),
    ("dissipation_density", "Dissipation per contact area in a cycle, along the contact edge."),
    ("hysteresis", "Loads against their work-conjugate displacements; the area of a loop is work."),
    (
        "trajectories",
        "Paths of single nodes: tractions with the friction cone (above), displacements "
        "(below). Dots are turning points.",
    ),
    (
        "tractions_last_cycle",
        "Tractions, friction cone and states at the turning points of the last cycle.",
    ),
    ("accuracy", "Twice the estimated errors of the numbers over time, mesh by mesh."),
    ("probe_", "Stresses at a probe, whose name is in that of the file."),
    ("max_shear", "Isochromatic fringes: contours of the largest in-plane shear stress."),
    ("von_mises", "Von Mises equivalent stress."),
)
"""Captions of pictures, by a part of the file name."""


def figures(paths: Sequence[Path], edges: set[str]) -> str:
    """Return figures in the order of their captions; name the edge of those in an edge's folder."""
    parts = [part for part, _ in CAPTIONS]

    def place(path: Path) -> tuple[int, str]:
        return next((k for k, part in enumerate(parts) if part in path.stem), LAST_PLACE), str(path)

    shown = []
    for path in sorted(paths, key=place):
        from PIL import Image

        with Image.open(path) as image:
            wide = image.width > WIDE_FIGURE
        caption = f"On {path.parent.name}: " if path.parent.name in edges else ""
        caption += _caption(path)
        shown.append(html.figure(path.stem, caption, "png", path.read_bytes(), wide))
    return f'<div class="figures">{"".join(shown)}</div>' if shown else ""


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
    """Return the caption of a picture; its name if it has none."""
    return next((text for part, text in CAPTIONS if part in path.stem), path.stem)
