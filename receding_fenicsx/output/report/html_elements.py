"""HTML elements of a report: page, sections, tables and embedded figures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

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


def page(title: str, parts: Sequence[str]) -> str:
    """Return a page with a title and parts of its body."""
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def section(title: str, content: str) -> list[str]:
    """Return a heading and its content; nothing if there is no content."""
    return [f"<h2>{title}</h2>", content] if content else []


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], form: str = "{:z.5g}") -> str:
    """Return a table of rows of cells; "" without rows."""
    lines = []
    for row in rows:
        cells = []
        for cell in row:
            kind = ' class="n"' if isinstance(cell, int | float) else ""
            cells.append(f"<td{kind}>{escape(value(cell, form))}</td>")
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return table_of_lines(head, lines) if lines else ""


def table_of_lines(head: Sequence[str], lines: Sequence[str]) -> str:
    """Return a table of rows in HTML."""
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    top = f"<thead><tr>{names}</tr></thead>" if head else ""
    return f'<div class="wide"><table>{top}<tbody>{"".join(lines)}</tbody></table></div>'


def value(cell: object, form: str = "{:z.5g}") -> str:
    """Format a cell; None is a dash."""
    if cell is None:
        return "\u2013"
    return form.format(cell) if isinstance(cell, float) else str(cell)


def figure(name: str, caption: str, kind: str, data: bytes, wide: bool) -> str:
    """Return a figure with its picture inside; a wide one takes the width of the page."""
    text = base64.b64encode(data).decode("ascii")
    place = ' class="page"' if wide else ""
    return (
        f'<figure{place}><img alt="{escape(name)}" src="data:image/{kind};base64,{text}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
