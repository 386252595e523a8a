"""Estimated against true space errors, over scenes whose limits are known.

You will see, for fourteen scenes on several meshes, how the estimate of ``run --error`` compares
with the true error: one point for each headline number, mesh and scene, and the share of them where
the true error is within twice the estimate. Limits come from computed values (frictionless block)
or from the finest meshes of two element families; pairs whose error is not told from the
uncertainty of the limit count for the share, not for the ratio.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

import matplotlib as mpl
import numpy as np

from receding_fenicsx import reference, study
from receding_fenicsx.errors import on_root
from receding_fenicsx.estimate import headline, space_errors
from receding_fenicsx.evolution import evolve
from receding_fenicsx.output.record import Record
from receding_fenicsx.output.style import COLUMN, GUIDE_COLOUR, RC, SERIES_COLOURS, new_figure
from receding_fenicsx.scene import OutputOptions, Scene
from receding_fenicsx.scene_file import read_scene

BLOCK = Path(__file__).with_name("block.toml")
CYCLES = 10

SCENES = {
    "the paper's block": [],
    "friction 0.2": ["contact.friction=0.2"],
    "friction 0.6": ["contact.friction=0.6"],
    "friction 0.2 + 0.1 x^2": ['contact.friction="0.2+0.1*x**2"'],
    "no friction": ["contact.friction=0.0"],
    "Poisson's ratio 0": ["material.poisson=0.0"],
    "Poisson's ratio 0.45": ["material.poisson=0.45"],
    "plane stress": ['material.kinematics="plane stress"'],
    "narrow load": ["load.p0.span=[-0.25, 0.25]"],
    "wide load": ["load.p0.span=[-1.5, 1.5]"],
    "load to a tenth": ["history.minimum=0.1"],
    "twice as high": ["body.height=2.0"],
    "twice as long": ["body.width=8.0"],
    "frictionless, narrow load": ["contact.friction=0.0", "load.p0.span=[-0.25, 0.25]"],
}
MESHES = (
    ("triangle", 2, 1.25, 64),
    ("triangle", 2, 1.25, 128),
    ("triangle", 2, 1.1, 128),
    ("quadrilateral", 2, 1.3, 128),
    ("triangle", 1, 1.3, 128),
    ("quadrilateral", 1, 1.1, 128),
)
"""Cell, order, growth, nodes of the contact less one."""
FINEST = tuple((cell, 2, 1.1, 640) for cell in ("triangle", "quadrilateral"))
COMPUTED = {
    "frictionless, narrow load": {
        "centre_pressure": reference.BLOCK.p[0],
        "contact_half_width": reference.BLOCK.half_width,
    }
}
"""Limits known without finite elements."""

COVERED = 0.95
"""Share of pairs whose true error must be within twice the estimate (and the floor)."""
MEDIAN = (0.5, 10.0)
"""Range of the median of estimate over true error."""
ROUND_OFF = 1e-9
"""Relative error that no estimate is asked to see."""


def solve(scene: Scene) -> Record:
    """Go from a scene to its record."""
    system = study.condense(scene, MPI.COMM_SELF)
    assert system is not None
    return evolve(system, replace(scene, output=OutputOptions(1, ())))


def meshed(scene: Scene, mesh: tuple[str, int, float, int]) -> Scene:
    """Return the scene on another mesh."""
    cell, degree, growth, nodes = mesh
    options = replace(
        scene.mesh, cell=cell, degree=degree, growth=growth, contact_elements=nodes // degree
    )
    return replace(scene, mesh=options)


def pairs(name: str) -> Iterator[dict[str, Any]]:
    """Yield, for each mesh and number of a scene, estimate, true error and floor."""
    scene = read_scene(BLOCK, [f"history.cycles={CYCLES}", *SCENES[name]])
    scene = replace(scene, history=replace(scene.history, until=None))
    one, two = (headline(solve(meshed(scene, mesh))) for mesh in FINEST)
    for mesh in MESHES:
        coarse = meshed(scene, mesh)
        record = solve(coarse)
        spacing = float(np.diff(record.x).max())
        for number, found in space_errors(coarse, record, solve).items():
            a, b = one[number], two[number]
            limit, unsure = 0.5 * (a.value + b.value), abs(a.value - b.value)
            if "width" in number:
                unsure += 0.5 * (a.known_to + b.known_to)
            if number in COMPUTED.get(name, {}):
                limit, unsure = COMPUTED[name][number], 0.0
            floor = ROUND_OFF * abs(limit) + unsure
            if "width" in number:
                floor += 0.5 * spacing
            true = abs(found["value"] - limit)
            yield {
                "scene": name, "mesh": " ".join(map(str, mesh)), "number": number,
                "value": found["value"], "limit": limit, "true": true,
                "estimate": found["error"], "floor": floor,
                "within": true <= 2.0 * found["error"] + floor, "told": true > 2.0 * unsure,
            }  # fmt: skip


def draw(rows: list[dict[str, Any]], folder: Path) -> None:
    """Draw estimates over true errors, relative to the limit."""
    with mpl.rc_context(RC):
        figure = new_figure(COLUMN, 3.4)
        axes = figure.subplots()
        for k, number in enumerate(dict.fromkeys(row["number"] for row in rows)):
            own = [row for row in rows if row["number"] == number and row["limit"] and row["told"]]
            axes.loglog(
                [max(row["true"] / row["limit"], 1e-7) for row in own],
                [max(row["estimate"] / row["limit"], 1e-7) for row in own],
                "os^vD"[k],
                ms=2.6,
                mew=0,
                color=SERIES_COLOURS[k],
                label=number.replace("_", " "),
            )
        ends = np.array([1e-7, 1.0])
        axes.loglog(ends, ends, color="black", lw=0.8)
        axes.loglog(ends, 0.5 * ends, color=GUIDE_COLOUR, lw=0.8, ls="--")
        axes.set(xlabel="true relative error", ylabel="estimated relative error")
        axes.set(xlim=(1e-6, 1.0), ylim=(1e-6, 1.0))
        axes.legend(fontsize=7, loc="upper left", handletextpad=0.2)
        axes.text(4e-5, 8e-6, "true = 2 × estimate", rotation=45, fontsize=7, color=GUIDE_COLOUR)
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"error_estimates.{suffix}")


def compare(folder: Path) -> None:
    """Compare all, write table and figure."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in SCENES:
        rows += list(pairs(name))
        share = np.mean([row["within"] for row in rows if row["scene"] == name])
        print(f"{name}: {share:.0%} of the true errors within twice the estimate", flush=True)
    with (folder / "error_estimates.csv").open("w") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, folder)
    covered = float(np.mean([row["within"] for row in rows]))
    median = float(np.median([row["estimate"] / row["true"] for row in rows if row["told"]]))
    print(f"{len(rows)} pairs: {covered:.1%} within twice the estimate; median ratio {median:.2f}")
    assert covered >= COVERED and MEDIAN[0] <= median <= MEDIAN[1]


def main() -> None:
    """Compare estimated with true errors."""
    parser = argparse.ArgumentParser(description="Estimated against true space errors.")
    parser.add_argument("--out", type=Path, default=Path("results/speed_against_error"))
    folder = parser.parse_args().out
    on_root(MPI.COMM_WORLD, lambda: compare(folder))


if __name__ == "__main__":
    main()
