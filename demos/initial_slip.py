"""Dependence of the steady state on the initial slip, and its map over friction and load range.

**Problem.** The paper's block, started not from rest but with a tangential displacement v0 at its
contact nodes, from which the first slip is counted.

**Equations.** Coulomb friction remembers: stick fixes v where it is. If normal and tangential
displacements are coupled (K_tn != 0), different initial slips may lead to different steady cycles;
without coupling all lead to the same dissipation.

**What to look for.** For hundreds of random initial slips on one condensed system: the steady
dissipation over the size of the slip, and which nodes never slip again. Over friction and minimum
load (hundreds of cells): the steady dissipation, and its spread over random initial slips.

The demo shows how to share work among ranks by mpi4py.futures (one rank does all by itself). Every
finished cell is a line of ``cells_N.csv``: a stopped run continues when it is started again
with the same --out. ``initial_slip.sbatch`` is a batch script for a cluster.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import sys
import time
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from mpi4py import MPI
from mpi4py.futures import MPICommExecutor

import matplotlib as mpl
import numpy as np

import receding_fenicsx as rf

BLOCK = Path(__file__).with_name("block.toml")
MAX_CYCLES = 400
PERMANENT_STICK = 1e-9
"""Dissipation density over the largest one below which a node counts as permanently stuck."""
SHAKEDOWN = 1e-6
"""Steady dissipation over the largest of a cycle 1 in the map, below which it counts as none."""
SLIP_SIZES = (0.03, 3.0)
"""Smallest and largest size of a random slip, over the largest slip of the first loading."""
MAP_SIZE = 2.0
"""Size of the random slips of the map."""
FRICTION, MINIMUM = 0.35, 1.0 / 3.0
"""Values of the paper."""


@dataclass(frozen=True)
class Task:
    """One history: seed 0 starts without slip, the others from a random one.

    ``size`` is that of the slip over the largest slip of the first loading; random when 0.
    """

    f: float
    minimum: float
    seed: int
    size: float = 0.0

    @property
    def key(self) -> str:
        """Name in the file of finished cells."""
        return f"{self.f:.12g},{self.minimum:.12g},{self.seed},{self.size:g}"


@dataclass(frozen=True)
class Cell:
    """Result of a task.

    Attributes:
        size: size of the initial slip over the largest slip of the first loading.
        first, steady: dissipation of cycle 1 and of the last cycle.
        cycles: cycles up to the steady state, or -1 where none was reached.
        stuck: one character a node of the whole contact, "1" where it never slips again.
    """

    size: float
    first: float
    steady: float
    cycles: int
    stuck: str

    @property
    def line(self) -> str:
        """Text in the file of finished cells."""
        return f"{self.size!r},{self.first!r},{self.steady!r},{self.cycles},{self.stuck}"


system: rf.ContactSystem
"""Set on every rank before work begins."""


def play(task: Task) -> Cell:
    """Evolve one history to its steady state."""
    body = replace(system, f=np.full(system.n, task.f))
    loop = np.array([[1.0], [task.minimum], [1.0]])
    history = rf.History(("p0",), np.array([[0.0], [1.0]]), loop, MAX_CYCLES, True)
    output = rf.OutputOptions(samples_per_leg=1, cycles=())
    size, slip = 0.0, None
    if task.seed:
        random = np.random.default_rng(task.seed)
        size = task.size or float(np.exp(random.uniform(*np.log(SLIP_SIZES))))
        largest = np.abs(
            rf.evolve(body, replace(history, cycles=1), output=output).turning_points.v
        )
        slip = size * largest[0].max() * random.uniform(-1.0, 1.0, body.n)
    try:
        record = rf.evolve(body, history, output=output, initial_slip=slip)
    except rf.SolveError:
        return Cell(size, np.nan, np.nan, -1, "")
    D, density = record.cycles.dissipation, record.cycles.dissipation_density[-1]
    touching = np.all(record.turning_points.state[-2:] != rf.State.SEPARATION, axis=0)
    stuck = touching & (density <= PERMANENT_STICK * record.cycles.dissipation_density[0].max())
    text = "".join("01"[bool(s)] for s in stuck)
    return Cell(size, float(D[0]), float(D[-1]), record.steady.cycle, text)


def read_cells(path: Path) -> dict[str, Cell]:
    """Read the finished cells of the same scene; skip a truncated line."""
    cells: dict[str, Cell] = {}
    if not path.is_file():
        return cells
    first_line, *lines = path.read_text().splitlines() or [""]
    if first_line != stamp():
        raise rf.InputError(f"{path} is of another scene; give another --out")
    for line in lines:
        parts = line.split(",")
        if len(parts) == 9 and len(parts[8]) in (0, 2 * system.n - 1):
            size, first, steady = (float(part) for part in parts[4:7])
            cells[",".join(parts[:4])] = Cell(size, first, steady, int(parts[7]), parts[8])
    return cells


def stamp() -> str:
    """Return the first line of the file of finished cells: a checksum of the scene."""
    return f"# scene {zlib.crc32(system.scene_toml.encode()):08x}"


def work(tasks: list[Task], path: Path) -> dict[str, Cell]:
    """Share the unfinished tasks among the ranks; return all cells on rank 0."""
    comm = MPI.COMM_WORLD
    with MPICommExecutor(comm, root=0) as executor:
        if executor is None:
            return {}
        cells = read_cells(path)
        left = [task for task in tasks if task.key not in cells]
        if len(left) < len(tasks):
            print(f"{len(tasks) - len(left)} of {len(tasks)} are finished already", flush=True)
        found = executor.map(play, left, chunksize=4, unordered=False)
        with path.open("w") as file:
            file.write(stamp() + "\n")
            file.writelines(f"{key},{cell.line}\n" for key, cell in cells.items())
            for task, cell in zip(left, progress(found, len(left)), strict=True):
                file.write(f"{task.key},{cell.line}\n")
                file.flush()
                cells[task.key] = cell
        return cells


def progress(cells: Iterable[Cell], total: int) -> Iterable[Cell]:
    """Show a bar on a terminal, a line every tenth elsewhere."""
    begin, shown = time.monotonic(), 0
    for done, cell in enumerate(cells, 1):
        yield cell
        left = (time.monotonic() - begin) / done * (total - done)
        if sys.stderr.isatty():
            bar = "#" * (40 * done // total)
            end = "\n" if done == total else ""
            print(f"\r[{bar:40}] {done}/{total}, {left:.0f} s left ", end=end, file=sys.stderr)
        elif 10 * done // total > shown:
            shown = 10 * done // total
            print(f"{done} of {total}, {left:.0f} s left", flush=True)


def draw_samples(cells: list[Cell], folder: Path) -> None:
    """Draw the steady dissipation over the slip's size, and the nodes that stick for good."""
    none, *others = cells
    ordered = sorted(others, key=lambda cell: cell.steady)
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.PAGE, 3.0)
        left, right = figure.subplots(1, 2)
        left.semilogx(
            [cell.size for cell in others],
            [cell.steady / none.steady for cell in others],
            "o",
            ms=3,
            color=rf.style.SERIES_COLOURS[0],
        )
        left.axhline(1.0, color="black", lw=0.8)
        left.text(SLIP_SIZES[1], 1.002, "no initial slip", va="bottom", ha="right", fontsize=8)
        left.margins(y=0.08)
        left.set(
            xlabel="initial slip over the largest of the first loading",
            ylabel="steady dissipation over that without initial slip",
        )
        image = np.array([[int(c) for c in cell.stuck] for cell in ordered])
        colours = mpl.colors.ListedColormap(["white", rf.style.STATE_COLOURS[rf.State.STICK]])
        x = np.linspace(-2.0, 2.0, image.shape[1])
        right.pcolormesh(x, np.arange(len(image)), image, cmap=colours, rasterized=True)
        right.set(
            xlabel="$x/h$", ylabel="initial slips, by steady dissipation", title="never slips again"
        )
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"initial_slip.{suffix}")


def draw_map(
    cells: dict[str, Cell], axes: tuple[np.ndarray, np.ndarray, int], folder: Path
) -> None:
    """Draw the steady dissipation and its spread over friction and minimum load."""
    f, minimum, seeds = axes
    grid = [
        [[cells[Task(a, b, s, MAP_SIZE).key] for s in range(seeds)] for b in minimum] for a in f
    ]
    D = np.array([[[c.steady for c in cell] for cell in row] for row in grid])
    first = np.array([[cell[0].first for cell in row] for row in grid])
    stuck = np.array([[[c.stuck.count("1") for c in cell] for cell in row] for row in grid])
    alive = D.max(axis=2) > SHAKEDOWN * np.nanmax(first)
    spread = np.ptp(D, axis=2) / np.where(alive, D.max(axis=2), np.nan)
    panels = (
        (
            "steady dissipation over cycle 1 (grey: none)",
            np.where(alive, D[:, :, 0] / first, np.nan),
        ),
        ("spread of steady dissipation", spread),
        ("spread of permanent stick", np.ptp(stuck, axis=2) / (2 * system.n - 1)),
    )
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.PAGE, 2.7)
        for panel, (title, values) in zip(figure.subplots(1, 3), panels, strict=True):
            panel.set_facecolor(rf.style.STATE_COLOURS[rf.State.STICK])
            image = panel.pcolormesh(f, minimum, values.T, cmap="viridis", vmin=0, rasterized=True)
            figure.colorbar(image, ax=panel)
            panel.plot(FRICTION, MINIMUM, "k+", ms=6)
            panel.set(title=title, xlabel="$f$")
        figure.axes[0].set_ylabel("minimum load over $p_0$")
        for suffix in ("png", "pdf"):
            figure.savefig(folder / f"initial_slip_map.{suffix}")


def main() -> None:
    """Evolve all histories and draw them."""
    global system
    parser = argparse.ArgumentParser(description="Steady states from random initial slips.")
    parser.add_argument("--out", type=Path, default=Path("results/initial_slip"))
    parser.add_argument("--nodes", type=int, default=81, help="contact nodes of the whole block")
    parser.add_argument("--samples", type=int, default=200, help="random slips at the paper's f")
    parser.add_argument("--map", type=int, nargs=2, default=(20, 15), metavar=("F", "MINIMUM"))
    parser.add_argument("--seeds", type=int, default=5, help="initial slips in a cell of the map")
    options = parser.parse_args()
    comm, folder = MPI.COMM_WORLD, options.out
    scene = rf.read_scene(BLOCK, [f"mesh.contact_elements={(options.nodes - 1) // 2}"])
    # by every rank for itself, so that the digits do not depend on the number of ranks
    condensed = rf.condense(scene, MPI.COMM_SELF)
    assert condensed is not None
    system = condensed
    f, minimum = np.linspace(0.1, 1.05, options.map[0]), np.linspace(0.05, 0.9, options.map[1])
    samples = [Task(FRICTION, MINIMUM, seed) for seed in range(options.samples + 1)]
    cells_of_map = [
        Task(a, b, s, MAP_SIZE) for a in f for b in minimum for s in range(options.seeds)
    ]
    if comm.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
    cells = work(samples + cells_of_map, folder / f"cells_{options.nodes}.csv")
    if comm.rank == 0:
        found = [cells[task.key] for task in samples]
        draw_samples(found, folder)
        draw_map(cells, (f, minimum, options.seeds), folder)
        steady = np.array([cell.steady for cell in found])
        spread = float(np.ptp(steady) / steady[0])
        failed = sum(cell.cycles < 0 for cell in cells.values())
        print(
            f"{options.samples} initial slips at f = {FRICTION}: steady dissipation "
            f"{steady.min() / steady[0]:.3f} to {steady.max() / steady[0]:.3f} of that without; "
            f"{failed} of {len(cells)} histories reached no steady state; figures in {folder}"
        )
        assert all(cell.cycles > 0 for cell in found), "no steady state was reached"
        assert spread > 0.05, "the steady state hardly depends on the initial slip"


if __name__ == "__main__":
    main()
