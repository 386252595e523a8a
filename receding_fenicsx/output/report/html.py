"""``report.html``: a run on one page with all its pictures, without links to other files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import jinja2

from receding_fenicsx.atomic import new_file
from receding_fenicsx.output.report import html_pictures
from receding_fenicsx.output.report.cycles import ratio_words
from receding_fenicsx.output.report.run import model_line
from receding_fenicsx.output.report.section import Summary, shown
from receding_fenicsx.output.report.summary import SECTIONS
from receding_fenicsx.output.report.turning_points import TURNING_POINTS
from receding_fenicsx.store.summary_file import read_summary


def write_report(folder: Path, scene_toml: str) -> Path:
    """Write ``report.html`` from ``summary.json``, figures and snapshots of a run.

    Args:
        folder: folder of the run.
        scene_toml: text of its scene; "" for none.

    Returns:
        The file; an existing one is replaced.

    Raises:
        InputError: the folder holds no summary, or the page cannot be written.
    """
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
    """Return the report as HTML that refers to no other file.

    Args:
        summary: contents of ``summary.json``.
        scene_toml: text of the scene; "" for none.
        figures: PNG files of figures.
        snapshots: PNG files of pictures of the body.
    """
    edges = {row["edge"] for row in summary["turning_points"] if "edge" in row}
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["shown"] = shown
    return environment.get_template("template.html").render(
        summary=summary,
        title=summary["title"] or "Untitled run",
        lead=model_line(summary),
        cards=_cards(summary),
        sections=[section for section in SECTIONS if section.rows(summary)],
        before_pictures=TURNING_POINTS,
        pictures={
            "Figures": html_pictures.figures(figures, edges),
            "Stresses in the body": html_pictures.snapshots(snapshots),
        },
        scene_toml=scene_toml,
    )


def _cards(summary: Summary) -> list[tuple[str, str]]:
    """Return the headline numbers, each with its name."""
    steady = summary["steady"]
    cards = []
    if summary["dissipation_per_cycle"]:
        when = f", from cycle {steady['cycle']}" if steady["reached"] else ""
        cards.append(("steady state", f"{steady['kind']}{when}"))
    if ratio := ratio_words(summary):
        cards.append(ratio)
    cards.append(("largest residual of the contact conditions", f"{summary['residual_max']:.1e}"))
    counted = "events" if summary["method"] == "events" else "sweeps"
    cards.append((counted, f"{summary[counted]:,}".replace(",", "\u202f")))
    if "timings" in summary:
        spent = sum(value for name, value in summary["timings"].items() if name != "pictures")
        cards.append(("time without pictures, s", f"{spent:.2f}"))
    return cards
