"""Tables and figure of ``error_estimates.py``.

**What to look for.** In the folder given by --out: ``error_estimates.md`` with the share of numbers
whose true error is within twice the estimate and the median of estimate over true error, by family
of meshes, kind of number, scene and kind of mesh, and every failure; ``error_estimates`` (PNG and
PDF): estimates over true errors. Bold: below 95 %, or a median outside 1 to 10; the exit code is 1
where a figure over all families is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

Row = dict[str, Any]

FACTORS = {"--error": (2.0, 2.5, 4.0), "search": (2.5, 6.25), "graded search": (2.5, 6.25)}
"""Families of estimates: how many times coarser the other meshes are."""
COVERED, MEDIAN = 0.95, (1.0, 10.0)
"""Wanted share within twice the estimate, and range of the median of estimate over true error."""
GROUPS = {"pressure": "pressures", "displacement": "displacements", "dissipation": "dissipations"}
"""Numbers of the picture by a part of their names; the others are zone ends."""


def of_number(row: Row) -> str:
    """Return the kind of a number: its name without edge or load, both ends of a zone alike."""
    return row["number"].partition("[")[0].replace("_left", "_end").replace("_right", "_end")


def table(rows: list[Row], of: Callable[[Row], str], title: str) -> tuple[list[str], bool]:
    """Return shares and medians by a key, and whether those of all families are as wanted."""
    lines = [f"| {title} | all | {' | '.join(FACTORS)} |", "| --- " * (2 + len(FACTORS)) + "|"]
    holds = True
    for key in dict.fromkeys(of(row) for row in rows):
        cells = []
        for families in ((*FACTORS,), *((family,) for family in FACTORS)):
            own = [row for row in rows if of(row) == key and row["family"] in families]
            told = [row["estimate"] / row["true"] for row in own if row["told"]]
            share = float(np.mean([row["within"] for row in own])) if own else 1.0
            median = float(np.median(told)) if told else np.nan
            wanted = share >= COVERED and not (median < MEDIAN[0] or median > MEDIAN[1])
            holds &= wanted or len(families) == 1
            text = f"{100 * share:.1f} % of {len(own)}" + (f", {median:.1f}" if told else "")
            cells.append((text if wanted else f"**{text}**") if own else "")
        lines.append(f"| {key} | {' | '.join(cells)} |")
    return [*lines, ""], holds


def draw(rows: list[Row], folder: Path) -> None:
    """Draw estimates over true errors, relative to the size of the number."""
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.PAGE, 3.1)
        panels = figure.subplots(1, len(FACTORS), sharex=True, sharey=True)
        groups = [*GROUPS.values(), "zone ends"]
        for panel, family in zip(panels, FACTORS, strict=True):
            for k, group in enumerate(groups):
                own = [
                    (row["true"] / row["size"], row["estimate"] / row["size"])
                    for row in rows
                    if row["family"] == family and row["told"] and group_of(row) == group
                ]
                panel.loglog(
                    *np.array(own).reshape(-1, 2).T,
                    "os^v"[k], ms=2.2, mew=0, color=rf.style.SERIES_COLOURS[k], label=group,
                )  # fmt: skip
            ends = np.array([1e-6, 1.0])
            panel.loglog(ends, ends, color="black", lw=0.8)
            panel.loglog(
                ends, 0.5 * ends, color="black", lw=0.8, ls="--", label="true = 2 × estimate"
            )
            panel.set(title=family, xlim=ends, ylim=ends, xlabel="true relative error", aspect=1)
        panels[0].set_ylabel("estimated relative error")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, markerscale=2)
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"error_estimates.{suffix}")


def group_of(row: Row) -> str:
    """Return the group of a number in the picture."""
    return next((group for part, group in GROUPS.items() if part in row["number"]), "zone ends")


def report(rows: list[Row], folder: Path) -> bool:
    """Write tables, failures and figure; return whether all shares and medians are as wanted."""
    draw(rows, folder)
    lines = [
        "# Estimated against true errors",
        "",
        "Share within twice the estimate, median of estimate over true error.",
        "",
    ]
    holds = True
    for title, of in {
        "family": lambda row: "all",
        "number": of_number,
        "scene": lambda row: row["scene"],
        "mesh": lambda row: row["mesh"].rpartition(" ")[0],
    }.items():
        text, wanted = table(rows, of, title)
        lines, holds = lines + text, holds and wanted
    lines += ["## Failures", ""]
    lines += [
        "| family | scene | mesh | number | estimate | true |", "| --- " * 6 + "|",
        *(
            f"| {row['family']} | {row['scene']} | {row['mesh']} | {row['number']} | "
            f"{row['estimate'] / row['size']:.1e} | {row['true'] / row['size']:.1e} |"
            for row in rows
            if not row["within"]
        ),
    ]  # fmt: skip
    (folder / "error_estimates.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines), flush=True)
    return holds
