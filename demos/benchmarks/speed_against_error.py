"""Speed against error: what each element, grading and method costs and how far it is off.

**Problem.** Six contacts: the paper's block, a block on an elastic block, a flat punch, the
sheared block with sharp corners and two coefficients of friction, a lap joint. What does a small
error of the dissipation cost?

**What to look for.** CPU seconds from the scene to the last cycle against the largest relative
error of the dissipations, by element, order, grading along the contact edge (its seconds hold the
runs that it takes its zone ends from) and method; the frontier of runs that no other beats in
both; the contact nodes with which graded edges are as good as equal elements; the default that
follows; the stress exponents fitted at sharp corners, beside their closed form.

``space.csv``, ``speed.png`` (and PDF) and ``report.md`` go to the folder of --out. One thread, CPU
seconds, with forms compiled before. The limit of each number is that of the finest graded mesh.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

import numpy as np
import speed_report

import receding_fenicsx as rf

DEMOS = Path(__file__).parents[1]
BARE = rf.OutputOptions(samples_per_leg=1, cycles=())
PAIR = """
[[body]]
name = "a"
position = [0.0, 2.0]
[[body]]
name = "b"
width = 8.0
height = 2.0
[material.a]
[material.b]
young = 2.0
[contact]
edge = "a.bottom"
against = "b.top"
friction = 0.35
[[load]]
name = "p0"
edge = "a.top"
span = [-1.0, 1.0]
pressure = 1.0
[[support]]
edge = "b.bottom"
fix = "xy"
[history]
cycles = 2
"""
"""The paper's block on a wider elastic one."""
SHEARED = ("history.cycles=2", "contact.friction=0.8", "load.Q.force=[1.6, 0.0]")
LESS = ("history.cycles=2", "contact.friction=0.5", "load.Q.force=[1.0, 0.0]")
PUNCH = ("history.rows=[[1.0]]", "history.cycle_rows=[[0.4], [1.0]]", "history.cycles=2")
CASES: dict[str, tuple[str, tuple[str, ...], tuple[int, ...], int]] = {
    "block": ("block.toml", ("history.cycles=2",), (60, 80, 120, 160, 240, 320, 480), 480),
    "two bodies": (PAIR, (), (20, 32, 40, 60, 80, 120, 160), 320),
    "punch": ("punch.toml", PUNCH, (32, 48, 64, 80, 120, 160, 320), 320),
    "sheared, f = 0.8": ("sheared_block.toml", SHEARED, (32, 48, 64, 80, 120, 160, 320), 320),
    "sheared, f = 0.5": ("sheared_block.toml", LESS, (32, 48, 64, 80, 120, 160, 320), 320),
    "lap joint": ("lap_joint.toml", (), (120, 180, 240, 360), 360),
}
"""Scene, overrides, numbers of equal elements, and that of the coarse run of the finest mesh."""
FAMILIES = {
    "triangles, order 2, graded": ("triangle", 2, True),
    "triangles, order 2": ("triangle", 2, False),
    "triangles, order 1": ("triangle", 1, False),
    "quadrilaterals, order 2": ("quadrilateral", 2, False),
    "quadrilaterals, order 1": ("quadrilateral", 1, False),
}
"""Cell, order, graded."""
RATIOS = (4.0, 8.0)
"""Size of the equal elements over that at zone ends, in the first grading and the second."""
STEPS = (10, 40)
"""Load steps a leg of Gauss-Seidel."""


def scene_of(case: str, elements: int, cell: str = "triangle", degree: int = 2) -> rf.Scene:
    """Return a case on a mesh of equal contact elements."""
    source, overrides, *_ = CASES[case]
    mesh = [f"mesh.contact_elements={elements}", f'mesh.cell="{cell}"', f"mesh.degree={degree}"]
    if source is PAIR:
        scene = rf.from_toml(source, mesh)
    else:
        scene = rf.read_scene(DEMOS / source, [*overrides, *mesh])
    return replace(scene, output=BARE, history=replace(scene.history, until=None))


def played(scene: rf.Scene) -> tuple[rf.Record, float]:
    """Go from the scene to its record; return it with the CPU seconds."""
    begin = time.process_time()
    system = rf.condense(scene, MPI.COMM_SELF)
    assert system is not None
    return rf.evolve(system, scene), time.process_time() - begin


def graded(case: str, elements: int) -> tuple[rf.Record, float]:
    """Play a case on a mesh graded by zone ends, twice: those of a run on equal elements first."""
    coarse = scene_of(case, elements)
    record, seconds = played(coarse)
    for ratio in RATIOS:
        record, more = played(rf.refined_at_zone_ends(coarse, record, ratio))
        seconds += more
    return record, seconds


def numbers(record: rf.Record) -> dict[str, list[float]]:
    """Return the dissipations, and the fitted ends of zones, of a record."""
    found = rf.summarise(record)
    ends = [end["value"] for p in found["turning_points"] for end in p.get("zone_ends") or []]
    return {"D": [D for D in found["dissipation_per_cycle"] if D], "ends": ends}


def row_of(case: str, kind: str, limit: rf.Record, run: tuple[rf.Record, float]) -> dict[str, Any]:
    """Return errors and cost of a run."""
    record, seconds = run
    own, exact = numbers(record), numbers(limit)
    D = np.array(own["D"]) / np.array(exact["D"]) - 1.0
    ends = np.nan
    if len(own["ends"]) == len(exact["ends"]):
        length = limit.x[-1] - limit.x[0]
        ends = np.abs(np.array(own["ends"]) - exact["ends"]).max(initial=0.0) / length
    row = {"case": case, "kind": kind, "nodes": len(record.x), "seconds": seconds}
    row |= {"D": float(np.abs(D).max()), "ends": float(ends), "residual": record.residual_max}
    print(f"{case}, {kind}: {row['nodes']} nodes, {seconds:.2f} s, D {row['D']:.1e}", flush=True)
    return row


def rows_of(case: str) -> list[dict[str, Any]]:
    """Measure one case."""
    _, _, sizes, finest = CASES[case]
    limit, _ = graded(case, finest)
    rows = []
    for kind, (cell, degree, is_graded) in FAMILIES.items():
        if cell == "quadrilateral" and scene_of(case, sizes[0]).body.mesh is not None:
            continue  # its .geo file makes triangles
        for size in sizes:
            elements = size if degree == 2 else 2 * size
            run = (
                graded(case, size // 4 * 2)
                if is_graded
                else played(scene_of(case, elements, cell, degree))
            )
            rows.append(row_of(case, kind, limit, run))
    for steps in STEPS:
        scene = scene_of(case, sizes[1])
        solver = replace(scene.solver, method="gauss-seidel", steps_per_leg=steps)
        run = played(replace(scene, solver=solver))
        rows.append(row_of(case, f"Gauss-Seidel, {steps} steps", limit, run))
    return rows


def corner_table() -> list[str]:
    """Return fitted stress exponents at corners of the sheared block, pressed and sheared."""
    lines = ["", "## Exponents at sharp corners", "", "| f | elements | closed form | fitted |"]
    lines += ["| --- " * 4 + "|"]
    for f, elements, refine in (
        *((f, n, ()) for f in (0.5, 0.8) for n in (100, 200, 400)),
        *((f, 40, (rf.Refinement(3e-6, growth=1.2),)) for f in (0.5, 0.8)),
    ):
        scene = scene_of(f"sheared, f = {f}", elements)
        once = replace(scene.history, cycles=1)
        record, _ = played(replace(scene, history=once, mesh=replace(scene.mesh, refine=refine)))
        corners = [c for p in rf.summarise(record)["turning_points"][:2] for c in p["corners"]]
        fitted = ", ".join(f"{c['fitted']:.4f}" if c["fitted"] else "-" for c in corners)
        count = f"{(len(record.x) - 1) // 2}{' graded' if refine else ''}"
        lines.append(f"| {f} | {count} | {corners[0]['exponent']:.4f} | {fitted} |")
    return lines


def study(folder: Path, cases: list[str]) -> None:
    """Measure the cases, and write the report."""
    folder.mkdir(parents=True, exist_ok=True)
    for cell in ("triangle", "quadrilateral"):
        for degree in (1, 2):
            played(scene_of("block", 40, cell, degree))  # compiles the forms
    speed_report.write_csv(folder / "space.csv", [row for case in cases for row in rows_of(case)])
    speed_report.write(folder)
    corners = corner_table()
    print("\n".join(corners))
    with (folder / "report.md").open("a") as page:
        page.write("\n".join(corners) + "\n")


def main() -> None:
    """Make the report."""
    parser = argparse.ArgumentParser(description="Speed against error.")
    parser.add_argument("--out", type=Path, default=Path("results/speed_against_error"))
    parser.add_argument("--cases", nargs="+", choices=[*CASES], default=[*CASES])
    options = parser.parse_args()
    rf.on_root(MPI.COMM_WORLD, lambda: study(options.out, options.cases))


if __name__ == "__main__":
    main()
