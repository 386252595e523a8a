"""Measures the interface: speed of exact events and Gauss-Seidel, accuracy, and where they end.

Prints five tables, each alone by its option:

* --speed: the exact path by number of contact nodes of the half block (events and trial rate solves
  a cycle, microseconds an event, a cycle before and after it has settled, how the cost of an event
  grows), many settled cycles, and load steps of Gauss-Seidel with and without its accelerations;
* --accuracy: error of Gauss-Seidel against the exact path over its steps per leg;
* --sweep: the block over friction, Poisson's ratio, elements and load range; what is refused, why;
* --random: random condensed systems under random loads; what is refused;
* --sizes: CPU time of three scenes in which round-off grows, over the number of contact nodes, and
  the power of it between neighbouring sizes.

The systems of the first three come through the package's own mesh and condensation. Work is done on
the first rank with one BLAS thread; times are medians. ``--csv FOLDER`` also writes the tables.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import csv
import itertools
import statistics
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.scene.history import History, history_from_scene
from receding_fenicsx.scene.model import OutputOptions, SolverOptions
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.studies import run as study

SCENE = Path(__file__).parents[1] / "block.toml"
HIGH, LOW = np.array([1.0]), np.array([1.0 / 3.0])
NO_SAMPLES = OutputOptions(samples_per_leg=1, cycles=())
Row = list[object]
LISTED = 10
"""Refused random systems that are printed; --csv lists all."""


def block(nodes: int = 161, *overrides: str) -> ContactSystem:
    """Condense half of the paper's block with quadratic elements to so many contact nodes."""
    elements = f"mesh.contact_elements={nodes - 1}"
    system = study.condense(read_scene(SCENE, [elements, *overrides]), MPI.COMM_SELF)
    assert system is not None
    return system


def cyclic(cycles: int, minimum: float = 1.0 / 3.0) -> History:
    """Return the paper's history: to 1, then so many times down and up again."""
    return History(("p0",), np.array([[0.0], [1.0]]), np.array([[1.0], [minimum], [1.0]]), cycles)


def table(name: str, heads: Iterable[str], rows: Iterable[Row], folder: Path | None) -> None:
    """Print a table as its rows come, and write it as CSV."""
    heads, kept = list(heads), []
    print(f"\n{name}\n" + "".join(f"{head:>15}" for head in heads), flush=True)
    for row in rows:
        texts = [f"{value:.4g}" if isinstance(value, float) else str(value) for value in row]
        print("".join(f"{text:>15}" for text in texts), flush=True)
        kept.append(texts)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / f"{name.split(':')[0].replace(' ', '_')}.csv").open("w") as file:
            csv.writer(file).writerows([heads, *kept])


class Player:
    """Plays cycles of the block on an exact path and counts."""

    def __init__(self, system: ContactSystem) -> None:
        """Load the body for the first time."""
        n = system.n
        rest = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, dtype=np.int8))
        self.path = EventPath(system)
        begin = time.perf_counter()
        leg = self.path.trace_leg(rest, (np.zeros(1), HIGH), 0.0)
        self.first_loading = time.perf_counter() - begin
        self.state, self.scale = leg.end, leg.force_scale

    def cycle(self) -> tuple[float, int, int]:
        """Play one cycle; return its seconds, events and trial rate solves."""
        trials, events, begin = self.trials(), 0, time.perf_counter()
        for ends in ((HIGH, LOW), (LOW, HIGH)):
            leg = self.path.trace_leg(self.state, ends, self.scale)
            self.state, self.scale = leg.end, leg.force_scale
            events += len(leg.events)
        return time.perf_counter() - begin, events, self.trials() - trials

    def trials(self) -> int:
        """Return how many sets of rates were worked out."""
        return self.path.trials


def event_rows(sizes: list[int], costs: list[float]) -> Iterable[Row]:
    """Yield one row a size; append the cost of an event in cycles 3 to 5 to ``costs``."""
    for nodes in sizes:
        system = block(nodes)
        seconds: list[float] = []
        first: list[float] = []
        for _ in range(3 if nodes <= 641 else 1):
            player = Player(system)
            # in the second cycle it is found out which nodes can be left out
            early = [player.cycle() for _ in range(5)][2:]
            seconds.append(statistics.median(second for second, _, _ in early))
            _, events, trials = early[0]
            first.append(player.first_loading)
        settle, last = (250, 20) if nodes <= 321 else (0, 0)
        for _ in range(settle):
            player.cycle()
        settled = [player.cycle()[0] for _ in range(last)]
        cost = statistics.median(seconds) / events
        costs.append(cost)
        yield [
            nodes,
            1e3 * statistics.median(first),
            events,
            trials,
            1e6 * cost,
            1e3 * statistics.median(seconds),
            1e3 * statistics.median(settled) if settled else "-",
        ]


def settled_rows(nodes: int, cycles: int) -> Iterable[Row]:
    """Yield time, residual and energy error of many cycles after the block has settled."""
    system = block(nodes)
    times = [time.perf_counter()]
    warm = evolve(system, cyclic(300), output=NO_SAMPLES)
    times.append(time.perf_counter())
    record = evolve(system, cyclic(300 + cycles), output=NO_SAMPLES)
    times.append(time.perf_counter())
    D = record.cycles.dissipation
    yield [
        nodes,
        cycles,
        (times[2] - times[1]) - (times[1] - times[0]),
        record.residual_max,
        record.energy_error_max,
        float(np.ptp(D[300:]) / D[0]),
        warm.steady.cycle,
    ]


def sweep_rows(nodes: int, steps: int) -> Iterable[Row]:
    """Yield the time of a load step with each set of accelerations, over the first unloading."""
    system = block(nodes)
    n = system.n
    plain = None
    for omega, polish in ((1.0, False), (1.5, False), (1.0, True), (1.5, True)):
        options = GaussSeidelOptions(omega, polish, 1e-8, 1e-8)
        now = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, dtype=np.int8))
        now = solve_step(system, now, HIGH, options).end
        seconds, sweeps, worst = [], [], 0.0
        for k in range(1, steps + 1):
            load = HIGH + k / 40 * (LOW - HIGH)
            begin = time.perf_counter()
            step = solve_step(system, now, load, options)
            seconds.append(time.perf_counter() - begin)
            sweeps.append(step.sweeps)
            worst, now = max(worst, step.residual), step.end
        median = statistics.median(seconds)
        plain = plain or median
        yield [omega, polish, statistics.median(sweeps), median, plain / median, worst]


def speed(options: argparse.Namespace) -> None:
    """Measure events by size, settled cycles, and Gauss-Seidel."""
    costs: list[float] = []
    heads = ["nodes", "first ms", "events", "trials", "us an event", "cycle 3-5 ms", "settled ms"]
    sizes = options.nodes
    table("events by size", heads, event_rows(sizes, costs), options.csv)
    if len(sizes) > 1:
        slopes = np.diff(np.log(costs)) / np.diff(np.log(sizes))
        print("cost of an event ~ nodes^" + ", ".join(f"{slope:.2f}" for slope in slopes))
        assert slopes.max() < 2.3, "an event costs more than the square of the nodes"
    heads = ["nodes", "cycles", "seconds", "residual", "energy error", "spread of D", "steady at"]
    table("settled cycles", heads, settled_rows(161, options.cycles), options.csv)
    heads = ["relaxation", "polish", "sweeps", "s a step", "gain", "residual"]
    table("gauss-seidel steps", heads, sweep_rows(161, 10), options.csv)


def accuracy(options: argparse.Namespace) -> None:
    """Compare Gauss-Seidel with the exact path over the steps of a leg."""
    system = block(81)
    exact = evolve(system, cyclic(1), output=NO_SAMPLES)
    steps = [10, 20, 40, 80, 160, 320, 640]
    errors: list[float] = []

    def rows() -> Iterable[Row]:
        for count in steps:
            solver = SolverOptions(method="gauss-seidel", steps_per_leg=count)
            begin = time.perf_counter()
            record = evolve(system, cyclic(1), solver, NO_SAMPLES)
            seconds = time.perf_counter() - begin
            a, b = record.turning_points, exact.turning_points
            force = max(np.abs(a.P - b.P).max(), np.abs(a.Q - b.Q).max()) / b.P.max()
            D = record.cycles.dissipation[0] / exact.cycles.dissipation[0] - 1.0
            errors.append(abs(D))
            yield [count, seconds, float(D), float(force), record.energy_error_max]

    heads = ["steps a leg", "seconds", "error of D_1", "error of force", "energy error"]
    table("gauss-seidel against events", heads, rows(), options.csv)
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    print(f"error of the dissipation of cycle 1 ~ steps^{slope:.2f}")


def sweep(options: argparse.Namespace) -> None:
    """Run the block over friction, Poisson's ratio, elements and load range."""
    refused: list[tuple[str, str]] = []
    minima = {"1 %": 0.99, "1/3": 1 / 3, "90 %": 0.1, "to zero": 0.0}

    def rows() -> Iterable[Row]:
        bodies = itertools.product(
            (0.0, 0.25, 0.3, 0.45, 0.49, 0.499),
            (("triangle", 2), ("triangle", 1), ("quadrilateral", 2), ("quadrilateral", 1)),
            (0.05, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0),
        )
        systems: dict[object, ContactSystem] = {}
        counts: dict[object, list[float]] = {}
        for nu, (cell, degree), f in bodies:
            key = nu, cell, degree
            if key not in systems:
                systems[key] = block(
                    41,
                    f"material.poisson={nu}",
                    f'mesh.cell="{cell}"',
                    f"mesh.degree={degree}",
                    f"mesh.contact_elements={80 // degree}",
                )
                counts[key] = [0, 0, 0.0, 0.0]
            system = replace(systems[key], f=np.full(systems[key].n, f))
            count = counts[key]
            for name, minimum in minima.items():
                count[0] += 1
                try:
                    record = evolve(system, cyclic(10, minimum), output=NO_SAMPLES)
                except SolveError as error:
                    count[1] += 1
                    case = f"nu {nu}, {cell}s of order {degree}, f {f}, range {name}"
                    refused.append((case, f"{type(error).__name__}: {error}"))
                else:
                    count[2] = max(count[2], record.residual_max)
                    count[3] = max(count[3], record.energy_error_max)
            if f == 3.0:
                yield [nu, f"{cell[:4]} {degree}", *count]

    heads = ["nu", "element", "cases", "refused", "residual", "energy error"]
    table("sweep of the block: f to 3", heads, rows(), options.csv)
    for case, reason in refused:
        print(f"refused: {case}: {reason}")


def random_case(seed: int, margin: float) -> tuple[ContactSystem, History]:
    """Return a random body whose friction couples with ``margin``, and a random polygon of loads.

    With margin under 1/2 the rate problem has one solution in every set of states.
    """
    rng = np.random.default_rng([seed, int(1e3 * margin)])
    n = int(rng.integers(2, 25))
    G = rng.standard_normal((2 * n, 3 * n))
    K = G @ G.T / (3 * n) + 0.2 * np.eye(2 * n)
    f = margin * np.linalg.eigvalsh(K[:n, :n]).min() / np.abs(K[:n, n:]).sum(axis=1).max()
    r_star = rng.standard_normal((2, 2 * n))
    r_star[0, n:] = np.abs(r_star[0, n:]) + 0.3
    x = np.arange(n, dtype=float)
    system = ContactSystem(
        x=x,
        points=np.stack([x, 0.0 * x], axis=1),
        weight=np.ones(n),
        K=0.5 * (K + K.T),
        r_star=r_star,
        load_names=("a", "b"),
        f=np.full(n, f),
        g0=rng.choice([0.0, 0.1], n) * rng.uniform(0.0, 1.0, n) * (seed % 2),
        held=np.zeros(2 * n, dtype=bool),
        rigid=np.zeros((2 * n, 0)),
    )
    corners = rng.uniform([0.1, -1.0], [1.5, 1.0], (int(rng.integers(2, 5)), 2))
    path = np.vstack([np.zeros(2), corners[:1]])
    return system, History(("a", "b"), path, np.vstack([corners, corners[:1]]), 3)


def random(options: argparse.Namespace) -> None:
    """Evolve thousands of random systems."""
    refusals: list[Row] = []

    def rows() -> Iterable[Row]:
        for margin in (0.49, 1.0, 2.0, 5.0, 20.0):
            before = len(refusals)
            residual = energy = 0.0
            slips = events = 0
            for seed in range(options.seeds):
                system, history = random_case(seed, margin)
                try:
                    record = evolve(system, history, output=NO_SAMPLES)
                except SolveError as error:
                    tried = "all sets" in str(error)
                    refusals.append([margin, seed, type(error).__name__, tried, str(error)])
                    continue
                residual = max(residual, record.residual_max)
                energy = max(energy, record.energy_error_max)
                events += record.n_events
                state = record.turning_points.state
                slips += bool(np.any(state > State.SEPARATION))
            new = refusals[before:]
            jumps = [row for row in new if row[2] == "NoQuasiStaticContinuation"]
            proved, others = sum(bool(row[3]) for row in jumps), len(new) - len(jumps)
            yield [
                margin,
                options.seeds,
                slips,
                events,
                len(jumps),
                proved,
                others,
                residual,
                energy,
            ]
            assert margin > 0.5 or not new, f"refused where a path exists: {new}"

    heads = ["margin", "systems", "slipping", "events", "jumps", "all tried", "otherwise"]
    table("random systems", [*heads, "residual", "energy error"], rows(), options.csv)
    for margin, seed, _, _, reason in refusals[:: max(1, len(refusals) // LISTED)]:
        print(f"refused: margin {margin}, seed {seed}: {reason}")
    if options.csv is not None:
        with (options.csv / "refused.csv").open("w") as file:
            csv.writer(file).writerows([["margin", "seed", "kind", "tried", "reason"], *refusals])


TRIALS = Path(__file__).parents[2] / "tests" / "trials"
SIZES = {
    TRIALS / "strip_on_wall.toml": (200, 300, 400, 500, 600),
    TRIALS / "roller.toml": (200, 240, 280, 320, 360),
    SCENE.with_name("sheared_polygon.toml"): (128, 160, 224, 320, 448),
}
"""Elements on the contact edges of scenes whose displacements carry much round-off."""


def size_rows() -> Iterable[Row]:
    """Yield one row a scene and size: CPU seconds of the history alone, and how they grow."""
    for path, sizes in SIZES.items():
        before: tuple[int, float] | None = None
        for elements in sizes:
            scene = read_scene(path, [f"mesh.contact_elements={elements}"])
            system = study.condense(scene, MPI.COMM_SELF)
            assert system is not None
            seconds = []
            for _ in range(3):
                begin = time.process_time()
                record = evolve(system, history_from_scene(scene), output=NO_SAMPLES)
                seconds.append(time.process_time() - begin)
            cost, power = statistics.median(seconds), float("nan")
            if before is not None:
                power = float(np.log(cost / before[1]) / np.log(system.n / before[0]))
            before = system.n, cost
            yield [path.stem, system.n, record.n_events, cost, power, record.residual_max]


def sizes(options: argparse.Namespace) -> None:
    """Measure the cost over the number of nodes where round-off grows."""
    heads = ("scene", "nodes", "events", "CPU s", "power", "residual")
    table("sizes: cost where round-off grows", heads, size_rows(), options.csv)


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = {"speed": speed, "accuracy": accuracy, "sweep": sweep, "random": random, "sizes": sizes}
    for name, work in parts.items():
        parser.add_argument(f"--{name}", action="store_true", help=work.__doc__)
    parser.add_argument("--nodes", type=int, nargs="+", default=[81, 161, 321, 641, 1281])
    parser.add_argument("--cycles", type=int, default=10000, help="settled cycles (default 10000)")
    parser.add_argument("--seeds", type=int, default=1000, help="random systems a margin")
    parser.add_argument("--csv", type=Path, help="folder for the tables as CSV")
    options = parser.parse_args()
    # PETSc starts on all ranks together
    from petsc4py import PETSc  # noqa: F401

    if MPI.COMM_WORLD.rank == 0:
        asked = [name for name in parts if getattr(options, name)] or list(parts)
        for name in asked:
            parts[name](options)


if __name__ == "__main__":
    main()
