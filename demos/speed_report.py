"""Figures and page of ``speed_against_error.py`` from its CSV files.

**What to look for.** In the folder given by --out: ``space_error`` and ``time_error`` (PNG and PDF)
and ``report.md``. The demo asserts the claims of the page.
"""

import argparse
import csv
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

import receding_fenicsx as rf

Row = dict[str, Any]

GOALS = (1e-2, 1e-3, 1e-4)
"""Errors for which the page gives advice."""
TITLES = {
    "centre_pressure": "centre pressure",
    "contact_half_width": "contact half-width",
    "stick_half_width": "stick half-width",
    "dissipation_first_cycle": "dissipation of cycle 1",
    "dissipation_ratio": "steady dissipation over cycle 1",
}
FASTER, READY_FASTER = 50.0, 3.0
"""Claimed gain over the grid: of the whole run, and up to the condensed system."""
TIME_ERROR = 1e-10
"""Largest round-off of the exact path when its legs are cut into parts."""
SMALLEST = 1e-7
"""Smaller errors are drawn at this value."""


def family(row: Row) -> str:
    """Return the name of a mesh family: cell, order, growth, body."""
    body = ", whole body" if row["whole"] else ""
    return f"{row['cell']}s, order {row['degree']}, growth {row['growth']:g}{body}"


def limits(space: list[Row]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the mean of the finest two meshes, and their relative difference."""
    one, two = space[:2]
    mean = {name: 0.5 * (one[name] + two[name]) for name in rf.HEADLINE_NAMES}
    return mean, {name: abs(one[name] - two[name]) / mean[name] for name in rf.HEADLINE_NAMES}


def errors(row: Row, limit: dict[str, float]) -> dict[str, float]:
    """Return relative errors; one cycle has no steady ratio."""
    known = [name for name in limit if row["cycles"] > 1 or name != "dissipation_ratio"]
    return {name: abs(row[name] / limit[name] - 1.0) for name in known}


def cheapest_as_good(
    space: list[Row], other: Row, limit: dict[str, float], each: bool = True
) -> Row:
    """Return the cheapest mesh of half the body that is no worse than another.

    Args:
        space: rows of the space study.
        other: the row to compare with.
        limit: the limits.
        each: no worse in any number; else its largest error is not above the other's largest.
    """
    floor = limits(space)[1]
    wrong = errors(other, limit)
    most = {name: wrong[name] if each else max(wrong.values()) for name in wrong}
    # an error below what the limit is known to is not told from it
    allowed = {name: max(most[name], floor[name]) for name in most}
    good = [
        row
        for row in space[2:]
        if not row["whole"] and all(errors(row, limit)[k] <= allowed[k] for k in allowed)
    ]
    return min(good, key=lambda row: float(row["ready_s"]))


def advice(space: list[Row], goal: float, limit: dict[str, float], names: list[str]) -> Row | None:
    """Return the cheapest mesh within the goal.

    It counts only when all finer ones of its family are within the goal too: an error may vanish
    by chance. None is found where the limit itself is not known to the goal.
    """
    good = []
    if any(limits(space)[1][name] > goal for name in names):
        return None
    for row in space[2:]:
        finer = [r for r in space[2:] if family(r) == family(row) and r["nodes"] >= row["nodes"]]
        within = all(errors(r, limit)[name] <= goal for r in finer for name in names)
        if within and not row["whole"]:
            good.append(row)
    return min(good, key=lambda row: float(row["cpu_s"]), default=None)


def draw_space(space: list[Row], folder: Path) -> None:
    """Draw each number's error over the CPU time of the whole way."""
    limit, floor = limits(space)
    figure = rf.style.new_figure(rf.style.PAGE, 4.9)
    axes = figure.subplots(2, 3)
    for panel, name in zip(axes.flat, rf.HEADLINE_NAMES, strict=False):
        for k, label in enumerate(dict.fromkeys(map(family, space[2:]))):
            own = [row for row in space[2:] if family(row) == label]
            panel.loglog(
                [row["cpu_s"] for row in own],
                [max(errors(row, limit)[name], SMALLEST) for row in own],
                color=rf.style.SERIES_COLOURS[k % 6],
                ls=("-", "--", ":")[k // 6],
                marker="os^vDP*XH<>dp"[k],
                lw=0.8,
                ms=3.5,
                label=label,
            )
        panel.axhline(max(floor[name], SMALLEST), color=rf.style.GUIDE_COLOUR, lw=0.8, ls=":")
        panel.set_title(TITLES[name])
        # the seconds may span less than a decade
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    for panel in axes[:, 0]:
        panel.set_ylabel("relative error")
    for panel in (*axes[1, :2], axes[0, 2]):
        panel.set_xlabel("CPU seconds, scene to last cycle")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    axes[1, 2].axis("off")
    axes[1, 2].legend(handles, labels, loc="center", fontsize=7.5, handlelength=2.4)
    save(figure, folder, "space_error")


def draw_time(times: list[Row], folder: Path) -> None:
    """Draw the time error of dissipation and forces over steps and CPU time."""
    figure = rf.style.new_figure(rf.style.PAGE, 3.0)
    left, middle, right = figure.subplots(1, 3)
    exact = times[0]
    for k, method in enumerate(dict.fromkeys(row["method"] for row in times[1:])):
        own = [row for row in times if row["method"] == method]
        steps = method != "by tolerance"
        label = method if steps else "Gauss-Seidel, 40 steps, tolerance $10^{-3}$ to $10^{-10}$"
        style: Row = {
            "color": rf.style.SERIES_COLOURS[k],
            "marker": "os^vD"[k],
            "lw": 0.8,
            "ms": 3.5,
        }
        if steps:
            left.loglog([r["steps"] for r in own], [r["dissipation"] for r in own], **style)
        seconds = [row["seconds"] for row in own]
        middle.loglog(seconds, [row["dissipation"] for row in own], **style, label=label)
        right.loglog(seconds, [row["force"] for row in own], **style)
    for panel, key in ((middle, "dissipation"), (right, "force")):
        label = "exact events (to round-off)"
        panel.axvline(exact["seconds"], color="black", lw=1.1, label=label)
        panel.set_xlabel("CPU seconds")
        panel.set_ylabel(f"error of {'nodal forces' if key == 'force' else 'cycle 1'}")
    steps_drawn = np.array([10.0, 320.0])
    start = times[1]["dissipation"]
    left.loglog(steps_drawn, start * (10.0 / steps_drawn) ** 2, **rf.style.GUIDE)
    left.text(60.0, start * 0.012, "order 2", ha="right", fontsize=8)
    left.set(xlabel="load steps a leg", ylabel="error of the dissipation of cycle 1")
    middle.set_ylabel("error of the dissipation of cycle 1")
    handles, labels = middle.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=7.5)
    save(figure, folder, "time_error")


def save(figure: Any, folder: Path, name: str) -> None:
    """Write a figure as PNG and PDF."""
    for suffix in ("png", "pdf"):
        figure.savefig(folder / f"{name}.{suffix}")


def describe(row: Row | None) -> str:
    """Say what to take, and what it costs."""
    if row is None:
        return "not told: the limit is not known that well, or no mesh reaches it"
    return (
        f"{family(row)}, {row['nodes']} contact nodes: {row['ready_s']:.2f} s to the condensed "
        f"system, {row['evolve_s']:.2f} s for {row['cycles']} cycles, {row['peak_MB']:.0f} MB"
    )


def page(space: list[Row], times: list[Row], grid: list[Row]) -> list[str]:
    """Return the lines of the page; raise where it would claim what is not so."""
    limit, floor = limits(space)
    swept, ours, on_grid, as_good, no_worse = grid
    exact = times[0]
    wanted = asdict(rf.MeshOptions())
    default = next(
        row
        for row in space[2:]
        if not row["whole"]
        and all(row[key] == wanted[key] for key in ("cell", "degree", "growth"))
        and row["nodes"] == wanted["degree"] * wanted["contact_elements"] + 1
    )
    faster, ready = swept["cpu_s"] / ours["cpu_s"], on_grid["ready_s"] / as_good["ready_s"]
    assert faster >= FASTER and ready >= READY_FASTER, (faster, ready)
    assert max(exact["force"], exact["dissipation"]) <= TIME_ERROR, exact
    bulk = [name for name in rf.HEADLINE_NAMES if "width" not in name]
    compared = [
        f"| {row['method']}, {family(row)} | {row['nodes']} | {row['cpu_s']:.3f} | "
        f"{max(errors(row, limit).values()):.1e} |"
        for row in (swept, ours)
    ]
    condensed = [
        f"| {family(row)} | {row['nodes']} | {row['ready_s']:.3f} | "
        f"{max(errors(row, limit).values()):.1e} |"
        for row in (on_grid, as_good, no_worse)
    ]
    goals = [
        f"| {100 * goal:g} % | {describe(advice(space, goal, limit, bulk))} | "
        f"{describe(advice(space, goal, limit, list(rf.HEADLINE_NAMES)))} |"
        for goal in GOALS
    ]
    return [
        "# Speed against error",
        "",
        "The paper's block, f = 0.35, ν = 0.3, load p0 to p0/3. CPU seconds on one thread.",
        "",
        "| number | limit of two families | they differ by |",
        "| --- | --- | --- |",
        *(
            f"| {rf.HEADLINE_NAMES[name]} | {limit[name]:.6g} | {floor[name]:.0e} |"
            for name in rf.HEADLINE_NAMES
        ),
        "",
        "## Space",
        "",
        "![Error over CPU time](space_error.png)",
        "",
        "Dotted: difference of the two families that make the limit. All numbers: `space.csv`.",
        "",
        "## Time",
        "",
        "![Gauss-Seidel against the exact path](time_error.png)",
        "",
        "On 81 contact nodes, three cycles; all numbers: `time.csv`. The exact path, stopped "
        "six times on every leg, differs from itself by "
        f"{exact['force']:.0e} in forces and {exact['dissipation']:.0e} in dissipation: it has no "
        f"time error. It took {exact['seconds']:.3f} s.",
        "",
        "## Against a uniform grid of 320 by 80 squares",
        "",
        "| whole way, one cycle | nodes | CPU s | largest error |",
        "| --- | --- | --- | --- |",
        *compared,
        "",
        f"Faster by {faster:.0f} times, and worse in no number.",
        "",
        "| scene to condensed system | nodes | CPU s | largest error |",
        "| --- | --- | --- | --- |",
        *condensed,
        "",
        f"Faster by {ready:.1f} times at no larger an error, by "
        f"{on_grid['ready_s'] / no_worse['ready_s']:.1f} times where no number may be worse.",
        "",
        "## Estimated errors (`run --error`)",
        "",
        "![Estimated over true errors](error_estimates.png)",
        "",
        "Every point is one number of one scene on one mesh: `error_estimates.csv`.",
        "",
        "## Advice",
        "",
        "| error | pressure and dissipation | half-widths too |",
        "| --- | --- | --- |",
        *goals,
        "",
        "Take exact events: load steps cost more and add an error of their own. The default, "
        f"{describe(default)}, has a largest error of {max(errors(default, limit).values()):.1e}.",
    ]


def read_csv(path: Path) -> list[Row]:
    """Read rows, numbers as numbers."""

    def value(text: str) -> Any:
        if text in ("True", "False"):
            return text == "True"
        try:
            return int(text) if text.isdecimal() else float(text)
        except ValueError:
            return text

    with path.open() as file:
        return [{k: value(v) for k, v in row.items()} for row in csv.DictReader(file)]


def write(folder: Path) -> None:
    """Write figures and page into the folder of the CSV files."""
    space, times, grid = (read_csv(folder / f"{name}.csv") for name in ("space", "time", "grid"))
    with mpl.rc_context(rf.style.RC):
        draw_space(space, folder)
        draw_time(times, folder)
    lines = page(space, times, grid)
    (folder / "report.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines[-10:]))


def main() -> None:
    """Make figures and page anew."""
    parser = argparse.ArgumentParser(description="Figures and page of speed_against_error.")
    parser.add_argument("--out", type=Path, default=Path("results/speed_against_error"))
    folder = parser.parse_args().out
    rf.on_root(MPI.COMM_WORLD, lambda: write(folder))


if __name__ == "__main__":
    main()
