"""Figure and page of ``speed_against_error.py`` from its CSV file.

**What to look for.** In the folder given by --out: ``speed`` (PNG and PDF) and ``report.md``: the
frontier, nodes of graded edges against those of equal elements, and the default that follows.
"""

import argparse
import csv
import math
from pathlib import Path
from typing import Any

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

import receding_fenicsx as rf

Row = dict[str, Any]
Array = NDArray[np.float64]

GOAL = 1e-3
"""Error at which families are compared: its seconds are read off the line through their runs."""
SMALLEST = 1e-6
"""Smaller errors are drawn at this value."""
GRADED, EQUAL = "triangles, order 2, graded", "triangles, order 2"
MARKERS = "os^vD*P"


def frontier(rows: list[Row]) -> list[Row]:
    """Return the runs that no other beats in both seconds and error, by seconds."""
    best: list[Row] = []
    for row in sorted(rows, key=lambda r: (r["seconds"], r["D"])):
        if not best or row["D"] < best[-1]["D"]:
            best.append(row)
    return best


def at_goal(rows: list[Row], cost: str, error: str, goal: float) -> float:
    """Return the cost of an error by a power law through the runs; NaN far below their errors."""
    known = [r for r in rows if np.isfinite(r[error]) and r[error] > 0.0]
    if len(known) < 2:
        return float("nan")
    if all(r[error] <= goal for r in known):
        return float(min(r[cost] for r in known))
    x, y = (np.log([r[k] for r in known]) for k in (error, cost))
    slope, start = np.polyfit(x, y, 1)
    if not slope < 0.0 or abs(np.log(goal) - np.clip(np.log(goal), x.min(), x.max())) > np.log(10):
        return float("nan")
    return float(np.exp(start + slope * np.log(goal)))


def power_law(rows: list[Row], error: str) -> tuple[float, float, float, Array]:
    """Return slope and start of the line through log error over log nodes, its error, the nodes."""
    x, y = np.log([[r["nodes"], r[error]] for r in rows if r[error] > 0.0]).T
    slope, start = np.polyfit(x, y, 1)
    return slope, start, float(np.std(y - start - slope * x) / np.sqrt(len(x) - 2)), x


def gains(rows: list[Row]) -> list[str]:
    """Return the table of contact nodes with which equal and graded edges have the same error."""
    lines = [
        "| contact | number | error | equal elements | graded | ratio |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for case in dict.fromkeys(row["case"] for row in rows):
        for error, words in (("D", "dissipation"), ("ends", "zone ends")):
            equal, graded = (
                [r for r in rows if r["case"] == case and r["kind"] == kind]
                for kind in (EQUAL, GRADED)
            )
            if min(sum(r[error] > 0.0 for r in kind) for kind in (equal, graded)) < 4:
                continue
            laws = [power_law(kind, error) for kind in (equal, graded)]
            # the smallest error that both kinds reach; the coarsest graded mesh may be below it
            goal = max(slope * x.max() + start for slope, start, _, x in laws)
            nodes = [max((goal - start) / slope, x.min()) for slope, start, _, x in laws]
            ratio = float(np.exp(nodes[1] - nodes[0]))
            scatter = ratio * math.hypot(*(e / slope for slope, _, e, _ in laws))
            lines.append(
                f"| {case} | {words} | {np.exp(goal):.1e} | {np.exp(nodes[0]):.0f} | "
                f"{np.exp(nodes[1]):.0f} | {ratio:.2f} ± {scatter:.2f} |"
            )
    return lines


def choice(rows: list[Row]) -> tuple[list[str], str]:
    """Return the table of seconds for the goal, and the kind with the smallest mean of them."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    kinds = list(dict.fromkeys(r["kind"] for r in rows if not r["kind"].startswith("Gauss")))
    lines = [f"| | {' | '.join(cases)} |", "| --- " * (len(cases) + 1) + "|"]
    means = {}
    for kind in kinds:
        seconds = [
            at_goal([r for r in rows if r["case"] == c and r["kind"] == kind], "seconds", "D", GOAL)
            for c in cases
        ]
        shown = ["-" if np.isnan(s) else f"{s:.2f}" for s in seconds]
        lines.append(f"| {kind} | {' | '.join(shown)} |")
        reached = [s for s in seconds if not np.isnan(s)]
        means[kind] = (-len(reached), float(np.exp(np.mean(np.log(reached)))) if reached else 0.0)
    return lines, min(means, key=lambda kind: means[kind])


def kind_of(row: Row) -> str:
    """Return the name of a row's line: one for all steps of Gauss-Seidel."""
    return "Gauss-Seidel in steps" if "Gauss" in row["kind"] else row["kind"]


def draw(rows: list[Row], folder: Path) -> None:
    """Draw errors over seconds, a panel for each contact, and the frontier."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    kinds = list(dict.fromkeys(kind_of(row) for row in rows))
    figure = rf.style.new_figure(rf.style.PAGE, 5.2)
    axes = figure.subplots(2, 3)
    for panel, case in zip(axes.flat, cases, strict=False):
        own = [row for row in rows if row["case"] == case]
        best = frontier(own)
        panel.loglog(
            [r["seconds"] for r in best],
            [max(r["D"], SMALLEST) for r in best],
            color="0.8",
            lw=6.0,
            solid_capstyle="round",
            label="frontier",
        )
        for k, kind in enumerate(kinds):
            runs = [r for r in own if kind_of(r) == kind]
            panel.loglog(
                [r["seconds"] for r in runs],
                [max(r["D"], SMALLEST) for r in runs],
                color=rf.style.SERIES_COLOURS[k % 6],
                marker=MARKERS[k],
                lw=0.8,
                ms=4.0,
                label=kind,
            )
        panel.set_title(case)
        panel.set_xlabel("CPU seconds")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    for panel in axes[:, 0]:
        panel.set_ylabel("error of dissipation")
    for panel in axes.flat[len(cases) :]:
        panel.axis("off")
    handles, labels = max(
        (p.get_legend_handles_labels() for p in axes.flat), key=lambda h: len(h[1])
    )
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7.5)
    for suffix in ("png", "pdf"):
        figure.savefig(folder / f"speed.{suffix}")


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write rows with the same columns."""
    with path.open("w") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def read_csv(path: Path) -> list[Row]:
    """Read the rows, numbers as numbers."""
    if not path.is_file():
        raise SystemExit(f"{path}: no such file; run the benchmark first, or give its --out")

    def value(text: str) -> str | float:
        try:
            return float(text)
        except ValueError:
            return text

    with path.open() as file:
        return [{key: value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def write(folder: Path) -> None:
    """Write figure and page into the folder of the CSV file."""
    rows = read_csv(folder / "space.csv")
    with mpl.rc_context(rf.style.RC):
        draw(rows, folder)
    table, best = choice(rows)
    lines = [
        "# Speed against error",
        "",
        "![Error over CPU seconds](speed.png)",
        "",
        "Largest relative error of the dissipations against the finest graded mesh; grey: the runs "
        "that no other beats.",
        "",
        f"## CPU seconds for an error of {100 * GOAL:g} %",
        "",
        *table,
        "",
        f"The default that follows: {best}. A dash: the runs do not come near that error.",
        "",
        "## Contact nodes for the same error",
        "",
        "Single meshes scatter, as zones end between nodes: by power laws through the errors of "
        "all meshes, at the smallest one that both kinds reach. Zone ends: the largest error of an "
        "end over the length of the edge.",
        "",
        *gains(rows),
        "",
        f"Largest residual of the contact law: {max(row['residual'] for row in rows):.0e}.",
    ]
    (folder / "report.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines[6:]))
    assert max(row["residual"] for row in rows) < 1e-9


def main() -> None:
    """Make figure and page anew."""
    parser = argparse.ArgumentParser(description="Figure and page of speed_against_error.")
    parser.add_argument("--out", type=Path, default=Path("results/speed_against_error"))
    folder = parser.parse_args().out
    rf.on_root(MPI.COMM_WORLD, lambda: write(folder))


if __name__ == "__main__":
    main()
