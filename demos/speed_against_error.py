"""Speed against error: cost and error of each mesh, element and method.

**Problem.** The paper's block. What does an error of 1 %, 0.1 % or 0.01 % cost?

**What to look for.**

* Space: CPU seconds of every stage and peak memory against the error of five headline numbers, over
  mesh size, element, growth and half or whole body. The limit is the mean of the finest meshes of
  two element families, and their difference its uncertainty.
* Time: Gauss-Seidel over load steps a leg and over tolerances, with and without over-relaxation and
  polish, against the exact path on the same mesh.
* The whole run against a uniform grid of 320 by 80 squares with plain sweeps, as in the paper.
* Advice: mesh and element for 1 %, 0.1 % and 0.01 %, and their cost.

CSV files, log-log figures and ``report.md`` go to the folder of --out; ``speed_report.py`` makes
figures and page anew from the CSV files; ``error_estimates.py`` compares error estimates with true
errors. One thread; times are CPU seconds (user and system), medians over repetitions, with forms
compiled before.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import csv
import resource
import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

import error_estimates
import numpy as np
import speed_report

import receding_fenicsx as rf

Row = dict[str, Any]

BLOCK = Path(__file__).with_name("block.toml")
BARE = rf.OutputOptions(samples_per_leg=1, cycles=())
CELLS = ("triangle", "quadrilateral")
CYCLES = 60
"""Cycles of the space study: the dissipation is within 1e-6 of its steady value then."""
TIME_CYCLES = 3
"""Cycles of the time study."""
STOPS = 7
"""Parts into which the legs of the exact path are cut to see that it has no time error."""
STEPS = (10, 20, 40, 80, 160, 320)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10)


@dataclass(frozen=True)
class Mesh:
    """One way to mesh the block."""

    cell: str
    degree: int
    growth: float
    nodes: int
    whole: bool = False

    def scene(self, cycles: int = CYCLES, solver: rf.SolverOptions | None = None) -> rf.Scene:
        """The block on this mesh."""
        overrides = [
            f'mesh.cell="{self.cell}"',
            f"mesh.degree={self.degree}",
            f"mesh.growth={self.growth}",
            f"mesh.contact_elements={(self.nodes - 1) // self.degree}",
            f"history.cycles={cycles}",
        ]
        scene = rf.read_scene(BLOCK, overrides)
        return replace(
            scene,
            history=replace(scene.history, until=None),
            solver=replace(solver or scene.solver, symmetry="none" if self.whole else "auto"),
            output=BARE,
        )

    def condense(self, mark: Callable[[str], None] | None = None) -> rf.ContactSystem:
        """Go from the scene to the condensed system."""
        system = rf.condense(self.scene(), MPI.COMM_SELF, mark)
        assert system is not None
        return system


TIME_MESH = Mesh("triangle", 2, 1.25, 81)
GRID = Mesh("quadrilateral", 1, 1.0, 321, whole=True)
"""320 by 80 squares."""
FAMILIES = (
    *((cell, 2, growth, False) for growth in (1.1, 1.25, 1.4, 1.6) for cell in CELLS),
    *((cell, 1, 1.25, False) for cell in CELLS),
    ("quadrilateral", 1, 1.0, False),
    ("triangle", 2, 1.25, True),
    ("quadrilateral", 1, 1.0, True),
)
"""Cell, order, growth, whole body."""


def cyclic(cycles: int) -> rf.History:
    """Return the paper's history: to p0, then so many times to p0/3 and back."""
    return rf.History(("p0",), np.array([[0.0], [1.0]]), np.array([[1.0], [1 / 3], [1.0]]), cycles)


def swept(steps: int, relaxation: float, polish: bool, tolerance: float) -> rf.SolverOptions:
    """Return the options of Gauss-Seidel."""
    return rf.SolverOptions(
        "gauss-seidel",
        steps,
        over_relaxation=relaxation,
        polish=polish,
        change_tolerance=tolerance,
        residual_tolerance=tolerance,
        max_sweeps=100000,
    )


def peak_megabytes(reset: bool = False) -> float:
    """Return this process's peak memory since the last reset, where the kernel tells it."""
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if "VmHWM" in line) / 1024.0
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def whole_way(mesh: Mesh, cycles: int, repeat: int, solver: rf.SolverOptions | None = None) -> Row:
    """Measure scene to record, stage by stage."""
    runs: list[dict[str, float]] = []
    walls = []
    peak_megabytes(reset=True)
    for _ in range(repeat):
        marks: list[tuple[str, float]] = []

        def mark(stage: str, into: list[tuple[str, float]] = marks) -> None:
            into.append((stage, time.process_time()))

        begin = time.perf_counter()
        system = mesh.condense(mark)
        mark("evolve")
        record = rf.evolve(system, mesh.scene(cycles, solver))
        mark("end")
        walls.append(time.perf_counter() - begin)
        runs.append({f"{a[0]}_s": b[1] - a[1] for a, b in pairwise(marks)})
    seconds = {stage: statistics.median(run[stage] for run in runs) for stage in runs[0]}
    total = sum(seconds.values())
    row = {
        **asdict(mesh),
        "method": "exact events" if solver is None else "Gauss-Seidel",
        "cycles": cycles,
        **seconds,
        "ready_s": total - seconds["evolve_s"],
        "cpu_s": total,
        "wall_s": statistics.median(walls),
        "peak_MB": peak_megabytes(),
        "residual": record.residual_max,
        **{name: number.value for name, number in rf.headline(record).items()},
    }
    print(f"{row['method']}, {mesh}: {total:.3f} s", flush=True)
    return row


def space_rows(repeat: int, sizes: list[int]) -> list[Row]:
    """Measure all meshes; the first two are the finest ones, which make the limit."""
    rows = []
    for cell, degree, growth, whole in FAMILIES:
        for nodes in sizes:
            if nodes <= 321 or not (whole or growth == 1.0):
                mesh = Mesh(cell, degree, growth, nodes, whole)
                rows.append(whole_way(mesh, CYCLES, repeat if nodes < 400 else 1))
    # last, so that their memory is not counted with the others'
    return [whole_way(Mesh(cell, 2, 1.05, 1281), CYCLES, 1) for cell in CELLS] + rows


def time_rows(mesh: Mesh, repeat: int) -> Iterable[Row]:
    """Measure the methods on one mesh against its exact path."""
    system, history = mesh.condense(), cyclic(TIME_CYCLES)

    def play(
        solver: rf.SolverOptions | None, path: rf.History, times: int
    ) -> tuple[rf.Record, float]:
        seconds = []
        for _ in range(times):
            begin = time.process_time()
            record = rf.evolve(system, path, solver, BARE)
            seconds.append(time.process_time() - begin)
        return record, statistics.median(seconds)

    exact, seconds = play(None, history, repeat)

    def row(method: str, record: rf.Record, took: float, every: int = 1, **more: object) -> Row:
        a, b = record.turning_points, exact.turning_points
        force = max(np.abs(a.P[::every] - b.P).max(), np.abs(a.Q[::every] - b.Q).max())
        D, E = record.cycles.dissipation, exact.cycles.dissipation
        found = {
            "method": method,
            **more,
            "seconds": took,
            "force": float(force / np.abs(b.P).max()),
            "dissipation": float(abs(D[0] / E[0] - 1.0)),
            "ratio": float(abs(D[-1] / D[0] / (E[-1] / E[0]) - 1.0)),
            "residual": record.residual_max,
            "sweeps": record.sweeps,
        }
        print(f"{method} {more}: {took:.3f} s, {found['dissipation']:.1e}", flush=True)
        return found

    # the exact path has no steps: stopping it on the way must change nothing
    down = np.linspace(1.0, 1 / 3, STOPS + 1)[:, None]
    loop = np.vstack([down, down[-2::-1]])
    stopped, _ = play(None, rf.History(("p0",), history.path, loop, TIME_CYCLES), 1)
    yield row("exact events", stopped, seconds, STOPS)
    for polish in (False, True):
        for relaxation in (1.0, 1.5):
            name = "Gauss-Seidel" + ", over-relaxed" * (relaxation > 1.0) + ", polished" * polish
            for steps in STEPS:
                record, seconds = play(swept(steps, relaxation, polish, 1e-8), history, 1)
                yield row(name, record, seconds, steps=steps, tolerance=1e-8)
    for tolerance in TOLERANCES:
        record, seconds = play(swept(40, 1.0, False, tolerance), history, 1)
        yield row("by tolerance", record, seconds, steps=40, tolerance=tolerance)


def grid_rows(space: list[Row], repeat: int) -> list[Row]:
    """Measure one cycle on the uniform grid, swept plainly, and on a mesh that is no worse.

    Returns:
        The grid swept; by events, the cheapest mesh that is worse in no number; and of ``space``
        the grid by events, the cheapest mesh whose largest error is not above the grid's, and the
        cheapest one that is worse in no number.
    """
    first = whole_way(GRID, 1, repeat, swept(40, 1.0, False, 1e-8))
    limit = speed_report.limits(space)[0]
    same = asdict(GRID)
    on_grid = next(row for row in space if all(row[key] == same[key] for key in same))
    chosen = speed_report.cheapest_as_good(space, first, limit)
    ours = whole_way(Mesh(**{key: chosen[key] for key in same}), 1, max(repeat, 5))
    rest = [speed_report.cheapest_as_good(space, on_grid, limit, each) for each in (False, True)]
    return [first, ours, on_grid, *rest]


def write_csv(path: Path, rows: Iterable[Row]) -> None:
    """Write rows with one or more sets of columns."""
    rows = list(rows)
    heads = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w") as file:
        writer = csv.DictWriter(file, heads)
        writer.writeheader()
        writer.writerows(rows)


def study_all(folder: Path, parts: list[str], repeat: int, sizes: list[int]) -> None:
    """Measure the chosen parts, and write the report."""
    folder.mkdir(parents=True, exist_ok=True)
    for cell in CELLS:
        for degree in (1, 2):
            Mesh(cell, degree, 1.3, 41).condense()  # compiles the forms
    if "space" in parts:
        write_csv(folder / "space.csv", space_rows(repeat, sizes))
    if "time" in parts:
        write_csv(folder / "time.csv", time_rows(TIME_MESH, repeat))
    if "grid" in parts:
        space = speed_report.read_csv(folder / "space.csv")
        write_csv(folder / "grid.csv", grid_rows(space, repeat))
    if "estimates" in parts:
        error_estimates.compare(folder)
    speed_report.write(folder)


def main() -> None:
    """Make the report."""
    parser = argparse.ArgumentParser(description="Speed against error.")
    parser.add_argument("--out", type=Path, default=Path("results/speed_against_error"))
    parts = ("space", "time", "grid", "estimates")
    parser.add_argument("--parts", nargs="+", choices=parts, default=list(parts))
    parser.add_argument("--repeat", type=int, default=3, help="repetitions of a measurement")
    parser.add_argument("--nodes", type=int, nargs="+", default=[41, 81, 161, 241, 321, 521, 641])
    options = parser.parse_args()
    asked = options.out, options.parts, options.repeat, options.nodes
    rf.on_root(MPI.COMM_WORLD, lambda: study_all(*asked))


if __name__ == "__main__":
    main()
