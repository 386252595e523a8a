"""``report.html``: a run on one page with all its pictures, without links to other files."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jinja2

from receding_fenicsx.atomic import new_file
from receding_fenicsx.output.report.run import ratio_words
from receding_fenicsx.output.report.section import Summary, shown
from receding_fenicsx.output.report.summary import SECTIONS
from receding_fenicsx.store.run_folder import read_summary


def write_report(folder: Path, scene_toml: str) -> Path:
    """Write ``report.html`` from ``summary.json``, figures and snapshots of a run."""
    path = Path(folder) / "report.html"
    pictures = {
        kind: sorted((Path(folder) / kind).rglob("*.png")) for kind in ("figures", "snapshots")
    }
    text = report_html(read_summary(Path(folder) / "summary.json"), scene_toml, **pictures)
    with new_file(path, overwrite=True) as beside:
        beside.write_text(text, encoding="utf-8")
    return path


def report_html(
    summary: Summary,
    scene_toml: str = "",
    figures: Sequence[Path] = (),
    snapshots: Sequence[Path] = (),
) -> str:
    """Return the report as HTML that refers to no other file; pictures are PNG files."""
    edges = {row["edge"] for row in summary["turning_points"] if "edge" in row}
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["shown"] = shown
    sections = [(section, section.tell(summary)) for section in SECTIONS.values()]
    return environment.get_template("template.html").render(
        summary=summary,
        cards=_cards(summary),
        sections=[(s, told) for s, told in sections if len(told.rows) > s.headed],
        pictures={
            "Figures": _figures(figures, edges),
            "Stresses in the body": [_snapshot(path) for path in snapshots],
        },
        scene_toml=scene_toml,
    )


def _cards(summary: Summary) -> list[tuple[str, str]]:
    """Return the headline numbers, each with its name."""
    steady, counted = summary["steady"], "events" if summary["method"] == "events" else "sweeps"
    when = f", from cycle {steady['cycle']}" if steady["reached"] else ""
    times = summary.get("timings", {})
    spent = sum(value for name, value in times.items() if name != "pictures")
    return [
        *[("steady state", f"{steady['kind']}{when}")] * bool(summary["dissipation_per_cycle"]),
        *((head, ratio) for head, ratio in ratio_words(summary)),
        ("largest residual of the contact conditions", f"{summary['residual_max']:.1e}"),
        (counted, f"{summary[counted]:,}".replace(",", "\u202f")),
        *[("time without pictures, s", f"{spent:.2f}")] * bool(times),
    ]


class Picture(NamedTuple):
    """A picture as a data URL, with its name and caption; a wide one has the page's width."""

    name: str
    caption: str
    source: str
    wide: bool


def _figures(paths: Sequence[Path], edges: set[str]) -> list[Picture]:
    """Return figures in the order of the registry; name the edge of those in an edge's folder."""
    if not paths:
        return []
    from PIL import Image

    from receding_fenicsx.output.plots.figures import FIGURES

    def entry(path: Path) -> str | None:
        names = (n for n, e in FIGURES.items() if e.each and path.stem.startswith(f"{n}_"))
        return path.stem if path.stem in FIGURES else next(names, None)

    order = [*FIGURES, None]
    found = []
    for path in sorted(paths, key=lambda path: (order.index(entry(path)), str(path))):
        with Image.open(path) as image:
            wide = image.width > 1600  # pixels; narrower ones stand side by side
        name = entry(path)
        caption = f"On {path.parent.name}: " if path.parent.name in edges else ""
        caption += _caption(path) if name is None else FIGURES[name].caption or path.stem
        found.append(Picture(path.stem, caption, _source("png", path.read_bytes()), wide))
    return found


def _snapshot(path: Path) -> Picture:
    """Return a picture of the body, reduced in size and as JPEG."""
    from PIL import Image

    data = io.BytesIO()
    with Image.open(path) as image:
        # about 1200 pixels wide; whole pixels are averaged
        small = image.convert("RGB").reduce(max(1, round(image.width / 1200)))
        small.save(data, "JPEG", quality=90, subsampling=0)
    found = re.match(r"cycle(\d+)_leg(\d+)_s([\d.]+)", path.stem)
    where = f"Cycle {int(found[1])}, leg {found[2]}, s = {float(found[3]):g}. " if found else ""
    return Picture(path.stem, where + _caption(path), _source("jpeg", data.getvalue()), True)


def _caption(path: Path) -> str:
    """Return the caption of a picture that is no registered figure; its name if it has none."""
    known = {
        "accuracy": "Twice the estimated errors of the numbers over time, mesh by mesh.",
        "max_shear": "Isochromatic fringes: contours of the largest in-plane shear stress.",
        "von_mises": "Von Mises equivalent stress.",
    }
    return next((text for end, text in known.items() if path.stem.endswith(end)), path.stem)


def _source(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
