"""``report.html``: one page of a run that holds everything, pictures too, and needs no network."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from PIL import Image

from receding_fenicsx.atomic import new_file
from receding_fenicsx.output.report.text import (
    extremes_of,
    fitted,
    length_format,
    space_errors,
    zones_header,
    zones_shown,
)
from receding_fenicsx.output.storage.summary_file import read_summary

WIDEST = 1200
"""Dots that an embedded picture of the body is wide at most."""
PAGE_FIGURE = 1600
"""Dots from which a figure is as wide as the page."""
JPEG_QUALITY = 90
FIRST_CYCLES = 20
"""Cycles whose numbers stand in the table before the last one's."""

CAPTIONS = (
    ("fig04", "Tractions, friction cone and states at the largest load of the first loading."),
    ("fig05", "Zones of stick, slip and separation along the first unloading."),
    ("fig06", "Tractions on the first unloading; at what load stands above the states."),
    ("fig07", "Zones along the ninth cycle."),
    ("fig08", "Slip gained in each cycle at some nodes, and its power of N."),
    (
        "fig09",
        "Zones along the last cycle; a dashed line is where nodes reach the friction limit "
        "without slipping.",
    ),
    ("fig10", "Dissipation of each cycle over that of the first."),
    ("zones_by_cycle", "Zones along all cycles that were sampled."),
    ("dissipation_density", "Where along the contact edge energy is dissipated in a cycle."),
    ("hysteresis", "Each load against its work-conjugate displacement; the area is work."),
    (
        "trajectories",
        "What single nodes go through: tractions in the friction cone above, displacements "
        "below. Dots are turning points.",
    ),
    (
        "tractions_last_cycle",
        "Tractions, friction cone and states at the last cycle's turning points.",
    ),
    ("max_shear", "Isochromatic fringes of the largest shear in the plane."),
    ("von_mises", "Equivalent stress after von Mises."),
)
"""What stands below a picture, by a part of its file's name."""

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 Georgia, 'Times New Roman', serif; color: #1b1b1b; background: #fff;
  max-width: 1080px; margin: 2rem auto 4rem; padding: 0 1.2rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .2rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .6rem; border-bottom: 1px solid #bbb; }
p.lead { color: #555; margin-top: 0; }
p.failure { border-left: 4px solid #d55e00; padding: .4rem .8rem; background: #fdf1ea; }
dl.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(200px, 1fr)); gap: .7rem;
  margin: 1.2rem 0; }
dl.cards div { border: 1px solid #ccc; border-radius: 4px; padding: .5rem .8rem; }
dl.cards dt { color: #555; font-size: .82rem; line-height: 1.3; }
dl.cards dd { margin: .1rem 0 0; font-size: 1.25rem; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .7rem .25rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid #888; font-weight: 600; }
td { border-bottom: 1px solid #e4e4e4; }
td.n, th.n { text-align: right; white-space: nowrap; }
td.yes { color: #00694f; } td.no { color: #b34700; font-weight: 600; }
div.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(440px, 1fr));
  gap: 1.6rem; align-items: start; }
figure { margin: 0; } figure.page { grid-column: 1 / -1; }
figure img { max-width: 100%; height: auto; }
figcaption { font-size: .88rem; color: #444; }
pre { background: #f6f6f6; padding: .8rem; overflow-x: auto; font-size: .82rem; line-height: 1.4; }
@media (max-width: 560px) { div.figures { grid-template-columns: 1fr; } }
@media print { figure, table { break-inside: avoid; } }
"""


def write_report(folder: Path, scene_toml: str) -> Path:
    """Write ``report.html`` from a run's ``summary.json``, figures and snapshots.

    Args:
        folder: folder of the run.
        scene_toml: text of its scene, "" for none.

    Returns:
        The file, which replaces an older one.

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
    """Return the page as text.

    Args:
        summary: what ``summary.json`` holds.
        scene_toml: text of the scene, "" for none.
        figures: PNG files of figures.
        snapshots: PNG files of pictures of the body.

    Returns:
        HTML that refers to nothing outside itself.
    """
    title = escape(str(summary["title"] or "Untitled run"))
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{escape(_lead(summary))}</p>',
    ]
    if summary.get("failure"):
        parts.append(f'<p class="failure">The run ended early: {escape(summary["failure"])}</p>')
    parts.append(_cards(summary))
    parts += _section("Against the paper", _paper(summary))
    parts += _section("Turning points", _turning_points(summary))
    edges = {row["edge"] for row in summary["turning_points"] if "edge" in row}
    parts += _section("Figures", _figures(figures, edges, bool(summary.get("paper"))))
    parts += _section("The body", _bodies(snapshots))
    parts += _section("Cycles", _cycles(summary))
    parts += _section("How far to trust it", _trust(summary))
    parts += _section("Time and memory", _costs(summary))
    parts += _section("Versions", _table([], summary.get("versions", {}).items()))
    if scene_toml:
        parts += _section("Scene", f"<pre>{escape(scene_toml)}</pre>")
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _lead(summary: Mapping[str, Any]) -> str:
    method = {"events": "exact path, event by event", "gauss-seidel": "Gauss-Seidel in load steps"}
    spared = {"mirror": ", half of the body modelled", "axisymmetric": ", axisymmetric"}
    return (
        f"{summary['nodes']} contact nodes ({summary['modelled_nodes']} modelled"
        f"{spared.get(summary['symmetry'], '')}), "
        f"{method.get(summary['method'], summary['method'])}, "
        f"{len(summary['dissipation_per_cycle'])} cycles after first loading"
    )


def _cards(summary: Mapping[str, Any]) -> str:
    """The headline numbers."""
    D, steady = summary["dissipation_per_cycle"], summary["steady"]
    cards = []
    if D:
        when = f", from cycle {steady['cycle']}" if steady["reached"] else ""
        cards.append(("steady state", f"{steady['kind']}{when}"))
    if D and D[0]:
        cards.append((f"dissipation of cycle {len(D)} over cycle 1", f"{D[-1] / D[0]:.5f}"))
    cards.append(("largest residual of the contact law", f"{summary['residual_max']:.1e}"))
    counted = "events" if summary["method"] == "events" else "sweeps"
    cards.append((counted, f"{summary[counted]:,}".replace(",", "\u202f")))
    if "timings" in summary:
        cards.append(("seconds without pictures", f"{_seconds(summary):.2f}"))
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in cards
    )
    return f'<dl class="cards">{items}</dl>'


def _paper(summary: Mapping[str, Any]) -> str:
    rows = summary.get("paper") or []
    verdict = {True: ("agrees", "yes"), False: ("differs", "no"), None: ("too few cycles", "")}
    lines = []
    for row in rows:
        text, kind = verdict[row["agrees"]]
        cells = [row["quantity"], row["paper"], row["ours"]]
        shown = "".join(f"<td>{escape(_value(cell))}</td>" for cell in cells)
        lines.append(f'<tr>{shown}<td class="{kind}">{text}</td></tr>')
    return _rows(["quantity", "paper", "here", ""], lines) if rows else ""


def _turning_points(summary: Mapping[str, Any]) -> str:
    points = summary["turning_points"]
    last = max((p["cycle"] for p in points), default=0)
    form = length_format(summary)
    rows = []
    for p in points:
        if p["cycle"] not in (0, 1, last):
            continue
        load = ", ".join(f"{name} = {value:z.6g}" for name, value in p["load"].items())
        half = [p["contact_half_width"], p["stick_half_width"]]
        below = [fitted(p.get(f"{k}_half_width_estimate"), form) for k in ("contact", "stick")]
        widths = [part for pair in zip(half, below, strict=True) for part in pair]
        edge = [p["edge"]] if "edge" in p else []
        rows.append([*edge, p["cycle"], load, *widths, *extremes_of(p), zones_shown(p, summary)])
    head = ["cycle", "load", "contact half width", "fitted", "stick half width", "fitted"]
    head = ["edge", *head] if any("edge" in p for p in points) else head
    return _table([*head, "p max", "q min", "q max", zones_header(summary)], rows)


def _cycles(summary: Mapping[str, Any]) -> str:
    D, slip = summary["dissipation_per_cycle"], summary["slip_per_cycle_max"]
    if not D:
        return ""
    shown = sorted({*range(min(FIRST_CYCLES, len(D))), len(D) - 1})
    rows = [[k + 1, D[k], D[k] / D[0] if D[0] else None, slip[k]] for k in shown]
    first = (
        f"<p>First loading dissipates {_value(summary['dissipation_first_loading'])}. "
        "summary.json holds all cycles.</p>"
    )
    head = ["cycle N", "dissipation D", "over cycle 1", "largest slip gained"]
    return first + _table(head, rows, "{:z.8g}")


def _trust(summary: Mapping[str, Any]) -> str:
    rows = [
        [
            "largest residual of Signorini's and Coulomb's laws, over the largest nodal force",
            f"{summary['residual_max']:.2e}",
        ],
        ["largest relative error of a leg's energy balance", f"{summary['energy_error_max']:.2e}"],
    ]
    margin = summary.get("friction_margin")
    if margin is not None:
        rows.append(
            [
                "largest f |K_tn| / K_tt of a node: below 1 a node by itself has one answer; that "
                "proves nothing for all together",
                f"{margin:.3g}",
            ]
        )
    rows += [[words, error] for words, error in space_errors(summary)]
    steady = summary["steady"]
    if steady.get("dissipation_limit"):
        rows.append(
            [
                f"dissipation goes on by a {steady['trend']} law towards",
                _value(steady["dissipation_limit"]),
            ]
        )
    if summary.get("limit_without_slip"):
        ranges = ", ".join(
            " on ".join([f"{a:z.4g} to {b:z.4g}", *edge])
            for a, b, *edge in summary["limit_without_slip"]
        )
        rows.append(["friction limit reached without slip in the last cycle, x from", ranges])
    return _table([], rows)


def _costs(summary: Mapping[str, Any]) -> str:
    if "timings" not in summary:
        return ""
    rows = [[f"{name}, seconds", f"{value:.3f}"] for name, value in summary["timings"].items()]
    rows.append(["peak memory, MB", f"{summary['peak_memory_MB']:.0f}"])
    rows.append(["MPI ranks", summary["ranks"]])
    return _table([], rows)


def _figures(paths: Sequence[Path], edges: set[str], paper: bool) -> str:
    """Figures in the order of their captions; those of several edges are in folders of theirs."""
    parts = [part for part, _ in CAPTIONS]

    def place(path: Path) -> tuple[int, str]:
        return next((k for k, part in enumerate(parts) if part in path.stem), 99), str(path)

    shown = []
    for path in sorted(paths, key=place):
        with Image.open(path) as image:
            wide = image.width > PAGE_FIGURE
        caption = f"On {path.parent.name}: " if path.parent.name in edges else ""
        caption += _caption(path)
        number = re.match(r"fig(\d+)_", path.stem)
        if number and paper:
            caption += f" The paper's Fig. {int(number[1])}."
        shown.append(_figure(path.stem, caption, "png", path.read_bytes(), wide))
    return f'<div class="figures">{"".join(shown)}</div>' if shown else ""


def _bodies(paths: Sequence[Path]) -> str:
    """Pictures of the body; they are many and large, so they lose what is not seen."""
    shown = []
    for path in paths:
        with Image.open(path) as image:
            size = WIDEST, round(image.height * WIDEST / image.width)
            small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        data = io.BytesIO()
        small.save(data, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        found = re.match(r"cycle(\d+)_leg(\d+)_s([\d.]+)", path.stem)
        where = f"Cycle {int(found[1])}, leg {found[2]}, s = {float(found[3]):g}. " if found else ""
        shown.append(_figure(path.stem, where + _caption(path), "jpeg", data.getvalue(), True))
    return f'<div class="figures">{"".join(shown)}</div>' if shown else ""


def _caption(path: Path) -> str:
    return next((text for part, text in CAPTIONS if part in path.stem), path.stem)


def _figure(name: str, caption: str, kind: str, data: bytes, wide: bool) -> str:
    text = base64.b64encode(data).decode("ascii")
    page = ' class="page"' if wide else ""
    return (
        f'<figure{page}><img alt="{escape(name)}" src="data:image/{kind};base64,{text}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _section(title: str, content: str) -> list[str]:
    return [f"<h2>{title}</h2>", content] if content else []


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]], form: str = "{:z.5g}") -> str:
    lines = []
    for row in rows:
        cells = []
        for cell in row:
            kind = ' class="n"' if isinstance(cell, int | float) else ""
            cells.append(f"<td{kind}>{escape(_value(cell, form))}</td>")
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return _rows(head, lines) if lines else ""


def _rows(head: Sequence[str], lines: Sequence[str]) -> str:
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    top = f"<thead><tr>{names}</tr></thead>" if head else ""
    return f'<div class="wide"><table>{top}<tbody>{"".join(lines)}</tbody></table></div>'


def _value(value: object, form: str = "{:z.5g}") -> str:
    if value is None:
        return "\u2013"
    return form.format(value) if isinstance(value, float) else str(value)


def _seconds(summary: Mapping[str, Any]) -> float:
    return sum(value for name, value in summary["timings"].items() if name != "pictures")
