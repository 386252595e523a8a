"""Sections of a report in their order; their numbers, the console, and the file report.html.

The page holds all pictures of a run and refers to no other file.
"""

from __future__ import annotations

import base64
import io
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from receding_fenicsx.arrays import aligned
from receding_fenicsx.atomic import new_file
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.report import contact, run
from receding_fenicsx.output.report.section import Section, Summary, Told, shown
from receding_fenicsx.store.run_folder import read_summary

SECTIONS = {
    section.name: section
    for section in (
        Section("", summary=run.model),
        Section("Warnings", run.tell_warnings, run.warnings),
        Section("Turning points", contact.tell_points, contact.turning_points, headed=True),
        Section("Steady state and limit", run.tell_steady, run.steady_state),
        Section("Cycles", run.tell_cycles, run.cycles, headed=True, form="{:z.8g}"),
        Section("Forces", run.tell_forces, run.forces, headed=True, form="{:z.6g}"),
        Section("Fatigue parameters", contact.tell_fatigue, fatigue_summary, headed=True),
        Section("Checks", contact.tell_checks, contact.checks),
        Section("Space errors", run.tell_errors),
        Section("Search for the tolerance", run.tell_search, headed=True),
        Section("Time and memory", run.tell_costs),
        Section("Versions", lambda summary: Told(list(summary.get("versions", {}).items()))),
    )
}
"""Sections in the order of the file report.html; pictures stand behind the turning points."""


def summarise(record: Record, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the summary of a record in the scene's units; extra keys replace those of it."""
    found: dict[str, Any] = {}
    for section in SECTIONS.values():
        found |= section.summary(record)
    return {**found, **(extra or {})}


def run_table(summary: Summary, everything: bool = False) -> str:
    """Return what a run prints: its answer in at most nine lines of at most 100 characters.

    They tell turning points of the last cycle and of the first loading, warnings, steady state,
    uniqueness, residual, time; with ``everything`` all sections of the report instead.
    """
    told = {name: section.tell(summary) for name, section in SECTIONS.items()}
    title = (
        f"{summary['title'] or 'untitled'}: {summary['nodes']} contact nodes, "
        f"{summary['modelled_nodes']} modelled, method {summary['method']}"
    )
    head = _wrapped([title])
    if everything:
        for name, (rows, _, note) in told.items():
            section = SECTIONS[name]
            if len(rows) > section.headed:
                cells = [[shown(cell, section.form) for cell in row] for row in rows]
                head += ["", name, *([note] if note else []), *aligned(cells)]
        return "\n".join(head)
    # most important first
    names = "Warnings", "Search for the tolerance", "Steady state and limit", "Fatigue parameters"
    lines = [
        line for name in (*names, "Space errors", "Forces", "Checks") for line in told[name].lines
    ]
    lines[-1] = "; ".join([lines[-1], *told["Time and memory"].lines])
    body = _wrapped(lines)
    # the command line adds where the files are, as the tenth line
    left = 9 - len(head)
    # the last turning point of each contact edge at least, below the heads of the columns
    room = left - 1 - min(len({point.get("edge") for point in summary["turning_points"]}), 3)
    if len(body) > room:
        body = [*body[: room - 1], "the rest is in report.html"]
    return "\n".join([*head, *contact.console_table(summary, left - len(body) - 1), *body])


def _wrapped(lines: Sequence[str]) -> list[str]:
    wrapped = [textwrap.wrap(line, 100, subsequent_indent="  ") for line in lines]
    return [part for parts in wrapped for part in parts]


def write_report(folder: Path, scene_toml: str) -> Path:
    """Write the file report.html from ``summary.json``, figures and snapshots of a run."""
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
    import jinja2

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
        *((head, ratio) for head, ratio in run.ratio_words(summary)),
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
