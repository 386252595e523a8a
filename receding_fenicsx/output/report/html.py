"""``report.html``: a run on one page with all its pictures, without links to other files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from receding_fenicsx.atomic import new_file
from receding_fenicsx.output.report import accuracy, html_pictures
from receding_fenicsx.output.report import html_elements as html
from receding_fenicsx.output.report.limit import limit_lines
from receding_fenicsx.output.report.text import (
    corner_lines,
    extremes_of,
    fitted,
    headline_points,
    heads,
    length_format,
    limit_ranges,
    polygon_line,
    zones_header,
    zones_shown,
)
from receding_fenicsx.output.report.uniqueness import uniqueness_lines
from receding_fenicsx.store.summary_file import read_summary

FIRST_CYCLES = 20
"""Number of first cycles in the table of cycles, which also holds the last one."""


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
    summary: Mapping[str, Any],
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
    title = escape(str(summary["title"] or "Untitled run"))
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{escape(_lead(summary))}</p>',
    ]
    if summary.get("failure"):
        parts.append(f'<p class="failure">The run ended early: {escape(summary["failure"])}</p>')
    parts.append(_cards(summary))
    parts += html.section("Turning points", _turning_points(summary))
    edges = {row["edge"] for row in summary["turning_points"] if "edge" in row}
    parts += html.section("Figures", html_pictures.figures(figures, edges))
    parts += html.section("Stresses in the body", html_pictures.snapshots(snapshots))
    parts += html.section("Cycles", _cycles(summary))
    parts += html.section("Checks", _checks(summary))
    parts += html.section("Search for the tolerance", _search(summary))
    parts += html.section("Time and memory", _costs(summary))
    parts += html.section("Versions", html.table([], summary.get("versions", {}).items()))
    if scene_toml:
        parts += html.section("Scene", f"<pre>{escape(scene_toml)}</pre>")
    return html.page(title, parts)


def _lead(summary: Mapping[str, Any]) -> str:
    """Return size of the model, method and number of cycles."""
    method = {"events": "exact path (events)", "gauss-seidel": "Gauss-Seidel in load steps"}
    spared = {"mirror": ", half of the body modelled", "axisymmetric": ", axisymmetric"}
    return (
        f"{summary['nodes']} contact nodes ({summary['modelled_nodes']} modelled"
        f"{spared.get(summary['symmetry'], '')}), "
        f"{method.get(summary['method'], summary['method'])}, "
        f"{len(summary['dissipation_per_cycle'])} cycles after first loading"
    )


def _cards(summary: Mapping[str, Any]) -> str:
    """Return the headline numbers."""
    D, steady = summary["dissipation_per_cycle"], summary["steady"]
    cards = []
    if D:
        when = f", from cycle {steady['cycle']}" if steady["reached"] else ""
        cards.append(("steady state", f"{steady['kind']}{when}"))
    if D and D[0] and summary.get("dissipates", True):
        cards.append((f"dissipation of cycle {len(D)} over cycle 1", f"{D[-1] / D[0]:.5f}"))
    cards.append(("largest residual of the contact conditions", f"{summary['residual_max']:.1e}"))
    counted = "events" if summary["method"] == "events" else "sweeps"
    cards.append((counted, f"{summary[counted]:,}".replace(",", "\u202f")))
    if "timings" in summary:
        spent = sum(value for name, value in summary["timings"].items() if name != "pictures")
        cards.append(("time without pictures, s", f"{spent:.2f}"))
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in cards
    )
    return f'<dl class="cards">{items}</dl>'


def _turning_points(summary: Mapping[str, Any]) -> str:
    """Return the table of turning points of cycle 0, cycle 1 and the last cycle."""
    points = headline_points(summary)
    form = length_format(summary)
    rows = []
    for p in points:
        load = ", ".join(f"{name} = {value:z.6g}" for name, value in p["load"].items())
        half = [p["contact_half_width"], p["stick_half_width"]]
        below = [fitted(p.get(f"{k}_half_width_estimate"), form) for k in ("contact", "stick")]
        widths = [part for pair in zip(half, below, strict=True) for part in pair]
        edge = [p["edge"]] if "edge" in p else []
        rows.append([*edge, p["cycle"], load, *widths, *_extremes(p), zones_shown(p, summary)])
    head = ["cycle", "load", "contact half width", "fitted", "stick half width", "fitted"]
    head = ["edge", *head] if any("edge" in p for p in points) else head
    head = heads([*head, "p max", "q min", "q max"], summary)
    return html.table([*head, zones_header(summary)], rows)


def _extremes(point: Mapping[str, Any]) -> list[float | str]:
    """Return p_max, q_min and q_max; where stresses are singular, those at the corner in words."""
    values: list[float | str] = list(extremes_of(point))
    if not point.get("p_max_singular"):
        return values
    return ["singular", *("singular" if value else value for value in values[1:])]


def _cycles(summary: Mapping[str, Any]) -> str:
    """Return the table of cycles."""
    D, slip = summary["dissipation_per_cycle"], summary["slip_per_cycle_max"]
    if not D:
        return ""
    shown = sorted({*range(min(FIRST_CYCLES, len(D))), len(D) - 1})
    first_cycle = D[0] if summary.get("dissipates", True) else 0.0
    rows = [[k + 1, D[k], D[k] / first_cycle if first_cycle else None, slip[k]] for k in shown]
    first = (
        f"<p>Dissipation of the first loading: {html.value(summary['dissipation_first_loading'])}. "
        "All cycles are in summary.json.</p>"
    )
    head = ["cycle N", "dissipation D", "over cycle 1", "largest slip increment"]
    return first + html.table(head, rows, "{:z.8g}")


def _checks(summary: Mapping[str, Any]) -> str:
    """Return residual, energy balance, uniqueness and space errors."""
    rows = [
        [
            "largest residual of the contact and friction conditions, over the largest nodal force",
            f"{summary['residual_max']:.2e}",
        ],
        ["largest relative error of a leg's energy balance", f"{summary['energy_error_max']:.2e}"],
    ]
    rows += [[head, words] for head, words in uniqueness_lines(summary)]
    rows += [[words, error] for words, error in accuracy.error_rows(summary)]
    steady = summary["steady"]
    if steady.get("dissipation_limit"):
        rows.append(
            [
                f"extrapolated limit of the dissipation ({steady['trend']} law)",
                html.value(steady["dissipation_limit"]),
            ]
        )
    rows += [line.split(": ", 1) for line in limit_lines(summary) + polygon_line(summary)]
    rows += [line.split(": ", 1) for line in corner_lines(headline_points(summary))]
    if ranges := limit_ranges(summary):
        rows.append(["friction limit reached without slip in the last cycle, x from", ranges])
    return html.table([], rows)


def _search(summary: Mapping[str, Any]) -> str:
    """Return the meshes of a search for a tolerance; "" without one."""
    if "accuracy" not in summary:
        return ""
    table = html.table(accuracy.WAY_HEAD, accuracy.way_rows(summary))
    return f"<p>{escape(accuracy.verdict(summary))}.</p>{table}"


def _costs(summary: Mapping[str, Any]) -> str:
    """Return times and memory."""
    if "timings" not in summary:
        return ""
    rows = [[f"{name}, s", f"{value:.3f}"] for name, value in summary["timings"].items()]
    rows.append(["peak memory, MB", f"{summary['peak_memory_MB']:.0f}"])
    rows.append(["MPI ranks", summary["ranks"]])
    return html.table([], rows)
