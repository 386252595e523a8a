"""Measures the way from a scene to its condensed system: time, memory and growth.

Prints a row for each mesh (graded triangles, uniform squares), body (half, whole), order and number
of contact nodes of the whole contact: seconds to mesh, to assemble, to factorise the interior alone
(no Schur complement), to condense, and for a dense Cholesky factorisation of the condensed system's
size, 2N modelled nodes; and the peak memory of condensing. Then how time and memory grow, and the
three ratios that condensing is measured by.

Times are medians of the processor time of the busiest rank, with one BLAS thread: on an idle
machine the clock's, on a busy one nearly the same. Compiling the forms is left out.

Runs alone and under mpirun; `--nodes 161 321` takes seconds.
"""

import argparse
import contextlib
import ctypes
import itertools
import statistics
import time
from collections import defaultdict
from pathlib import Path

from mpi4py import MPI

import numpy as np
from scipy.linalg import cholesky

from receding_fenicsx.bulk.body import interior_solver
from receding_fenicsx.bulk.elasticity import build, warm_up
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.stack import Stack, condense
from receding_fenicsx.scene.model import Load, MeshOptions, Scene

comm = MPI.COMM_WORLD

MESHES = {"graded": ("triangle", 1.3), "uniform": ("quadrilateral", 1.0)}
LARGEST = {"graded": 2561, "uniform": 641}
"""Contact nodes up to which each mesh is measured unless `--all`: squares fill the whole body."""
MOST_MEGABYTES = 2000
"""Peak memory of condensing, over all of these cases."""
STAGES = ("mesh", "assemble", "interior", "condense", "cholesky")


def processor_time() -> float:
    """Return the processor time of the rank that has spent most."""
    return comm.allreduce(time.process_time(), MPI.MAX)


def memory(word: str) -> float:
    """Return megabytes of all ranks together: "VmRSS" now, "VmHWM" at most since the reset."""
    status = Path("/proc/self/status").read_text().splitlines()
    return comm.allreduce(next(int(line.split()[1]) for line in status if word in line)) / 1024.0


def forget_peak() -> None:
    """Count the peak memory anew, where the kernel lets us."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def give_back() -> None:
    """Give the memory that is free back to the system, where the C library is GNU's."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def dense_cholesky(size: int) -> None:
    """Factorise a dense matrix on rank 0."""
    if comm.rank == 0:
        matrix = np.full((size, size), 1.0 / size) + np.eye(size)
        cholesky(matrix, overwrite_a=True, check_finite=False)


def measure(scene: Scene, half: bool, repeat: int) -> dict[str, float]:
    """Return medians of the stages, the numbers of unknowns, and the peak memory of condensing."""
    spent = defaultdict(list)
    give_back()
    for _ in range(repeat):
        clock = processor_time()

        def lap(stage: str) -> None:
            nonlocal clock
            now = processor_time()
            spent[stage].append(now - clock)
            clock = now

        (mesh,) = make_meshes(comm, scene, half)
        lap("mesh")
        bulk = build(scene, mesh)
        lap("assemble")
        interior_solver(bulk)
        lap("interior")
        forget_peak()
        clock = processor_time()
        condense(Stack(scene, (bulk,)))
        lap("condense")
        peak, size = memory("VmHWM"), 2 * len(bulk.contact.node)
        clock = processor_time()
        dense_cholesky(size)
        lap("cholesky")
        dofs = bulk.dofs
        bulk.destroy()
    row = {stage: statistics.median(spent[stage]) for stage in STAGES}
    return row | {"dofs": dofs, "size": size, "MB": peak}


def show_growth(rows: dict[tuple[str, str, int, int], dict[str, float]], base: float) -> None:
    """Fit powers of the number of nodes to the time and the memory of the three largest sizes."""
    print("\ngrowth of condensing with the number n of contact nodes, from the three largest n:")
    for case in dict.fromkeys(key[:3] for key in rows):
        largest = sorted(key for key in rows if key[:3] == case)[-3:]
        if len(largest) < 3:
            continue
        n = np.log([key[3] for key in largest])
        seconds = np.polyfit(n, np.log([rows[key]["condense"] for key in largest]), 1)[0]
        megabytes = np.polyfit(n, np.log([rows[key]["MB"] - base for key in largest]), 1)[0]
        name = f"{case[0]:<8} {case[1]:<6} order {case[2]}"
        print(f"  {name}: time n^{seconds:.1f}, memory n^{megabytes:.1f}")


def show_ratios(rows: dict[tuple[str, str, int, int], dict[str, float]]) -> None:
    """Print the three ratios that condensing is measured by, the worst over the cases."""
    ratios, uniform, memory = [], [], []
    for (mesh, body, degree, n), row in rows.items():
        if mesh == "graded" and n <= 1281:
            ratios.append(row["condense"] / (5.0 * row["interior"] + 1.5 * row["cholesky"]))
        if (mesh, body, degree, n) == ("uniform", "whole", 1, 641):
            uniform.append(row["condense"] / row["interior"])
        if mesh == "graded" and n == 2561:
            memory.append(row["MB"])
    print()
    for text, values, most in (
        ("graded up to 1281 nodes: condense / (5 interior + 1.5 cholesky)", ratios, 1.0),
        ("uniform 640 x 160 squares: condense / interior", uniform, 1.5),
        ("graded, 2561 nodes: peak memory in MB", memory, 2000.0),
    ):
        if values:
            verdict = "met" if max(values) <= most else "NOT met"
            print(f"{text}: {max(values):.2f}, at most {most:g} wanted: {verdict}")


def main() -> None:
    """Measure every case and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=[161, 321, 641, 1281, 2561])
    parser.add_argument("--mesh", nargs="+", choices=list(MESHES), default=list(MESHES))
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--all", action="store_true", help="large uniform meshes too (10 GB)")
    options = parser.parse_args()
    root = comm.rank == 0

    for mesh, degree in itertools.product(options.mesh, (1, 2)):
        seconds = warm_up(comm, MESHES[mesh][0], degree)
        if root:
            print(f"forms, {MESHES[mesh][0]}s of order {degree}: {seconds:.2f} s")
    base = memory("VmRSS")
    heads = "".join(f"{name + ' s':>12}" for name in STAGES)
    if root:
        print(f"\n{comm.size} rank(s)")
        print(f"{'mesh':<9}{'body':<7}order  nodes{'dofs':>9}{heads}{'peak MB':>9}")
    rows = {}
    for mesh, body, degree, n in itertools.product(
        options.mesh, ("half", "whole"), (1, 2), options.nodes
    ):
        if n > LARGEST[mesh] and not options.all:
            continue
        cell, growth = MESHES[mesh]
        scene = Scene(
            mesh=MeshOptions((n - 1) // degree, cell, degree, growth),
            loads=(Load("p0", "top", (-1.0, 1.0), pressure=1.0),),
        )
        row = rows[mesh, body, degree, n] = measure(scene, body == "half", options.repeat)
        assert options.all or row["MB"] < MOST_MEGABYTES
        if root:
            times = "".join(f"{row[name]:12.3f}" for name in STAGES)
            print(
                f"{mesh:<9}{body:<7}{degree:>5}{n:>7}{row['dofs']:>9}{times}{row['MB']:9.0f}",
                flush=True,
            )
    if root:
        show_growth(rows, base)
        show_ratios(rows)


if __name__ == "__main__":
    main()
