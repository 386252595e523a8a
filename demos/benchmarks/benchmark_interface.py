"""Measures the interface: speed of exact events and of Gauss-Seidel, by number of nodes.

* --speed: the exact path by number of contact nodes of the half block (events and trial rate solves
  a cycle, microseconds an event, a cycle before and after it has settled, how the cost of an event
  grows), many settled cycles, and load steps of Gauss-Seidel with and without its accelerations;
* --sizes: CPU time of three scenes in which round-off grows, over the number of contact nodes, and
  the power of it between neighbouring sizes.

The systems come through the package's own mesh and condensation. Work is done on the first rank;
times are medians. ``--csv FOLDER`` also writes the tables.
"""

import argparse
import csv
import statistics
import time
from collections.abc import Iterable
from pathlib import Path

from mpi4py import MPI

import numpy as np

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.scene.history import History, history_from_scene
from receding_fenicsx.scene.model import OutputOptions
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.studies import run as study

SCENE = Path(__file__).parents[1] / "block.toml"
HIGH, LOW = np.array([1.0]), np.array([1.0 / 3.0])
NO_SAMPLES = OutputOptions(samples_per_leg=1, cycles=())
Row = list[object]


def block(nodes: int = 161) -> ContactSystem:
    """Condense half of the paper's block with quadratic elements to so many contact nodes."""
    scene = read_scene(SCENE, [f"mesh.contact_elements={nodes - 1}"])
    system = study.condense(scene, MPI.COMM_SELF)
    assert system is not None
    return system


def cyclic(cycles: int) -> History:
    """Return the paper's history: to 1, then so many times down and up again."""
    return History(("p0",), np.array([[0.0], HIGH]), np.array([HIGH, LOW, HIGH]), cycles)


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
    parts = {"speed": speed, "sizes": sizes}
    for name, work in parts.items():
        parser.add_argument(f"--{name}", action="store_true", help=work.__doc__)
    parser.add_argument("--nodes", type=int, nargs="+", default=[81, 161, 321, 641, 1281])
    parser.add_argument("--cycles", type=int, default=10000, help="settled cycles (default 10000)")
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
