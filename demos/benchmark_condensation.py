"""Measures the way from a scene to its condensed system: seconds and memory by mesh and size.

Prints one row for each mesh (graded triangles, uniform squares), body (half, whole), order and
number of contact nodes of the whole contact: the stages mesh, assemble and condense, their sum, the
time that a factorisation of the interior alone takes (no Schur complement), and the peak memory of
the process. Times are medians over repetitions, with one BLAS thread a rank; compiling or loading
the forms comes before and is printed apart.

Runs alone and under mpirun; `--nodes 161 321` takes seconds, `--nodes 2561 --mesh graded` goes
further.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import itertools
import resource
import statistics
import time
from pathlib import Path

from mpi4py import MPI

from receding_fenicsx.bulk.body import interior_solver
from receding_fenicsx.bulk.condensation import condense
from receding_fenicsx.bulk.elasticity import build, warm_up
from receding_fenicsx.bulk.meshing import make_mesh
from receding_fenicsx.scene import Load, MeshOptions, Scene

comm = MPI.COMM_WORLD

TARGET_NODES, TARGET_SECONDS = 321, 1.0
"""From the scene to the condensed system on one rank in a second, with as many contact nodes."""
MESHES = {"graded": ("triangle", 1.3), "uniform": ("quadrilateral", 1.0)}
COLUMNS = ("mesh", "assemble", "condense", "sum", "interior")


def reset_peak() -> None:
    """Start the kernel's count of this process's peak memory anew, where it can be."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        pass


def peak_megabytes() -> float:
    """Return the peak memory of all ranks together since the last reset."""
    try:
        status = Path("/proc/self/status").read_text()
        own = next(int(line.split()[1]) for line in status.splitlines() if "VmHWM" in line)
    except (OSError, StopIteration):
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return comm.allreduce(own) / 1024.0


def now() -> float:
    """Return the time once every rank is here."""
    comm.barrier()
    return time.perf_counter()


def measure(scene: Scene, half: bool, repeat: int) -> tuple[dict[str, float], int, float]:
    """Return medians of the stages, the body's degrees of freedom, and the peak memory."""
    seconds: dict[str, list[float]] = {name: [] for name in COLUMNS}
    reset_peak()
    for _ in range(repeat):
        start = now()
        mesh = make_mesh(comm, scene, half)
        meshed = now()
        bulk = build(scene, mesh, half)
        built = now()
        condense(bulk)
        done = now()
        peak, dofs = peak_megabytes(), bulk.dofs
        before = now()
        interior_solver(bulk).destroy()
        seconds["mesh"].append(meshed - start)
        seconds["assemble"].append(built - meshed - bulk.seconds["forms"])
        seconds["condense"].append(done - built)
        seconds["sum"].append(done - start - bulk.seconds["forms"])
        seconds["interior"].append(now() - before)
        bulk.destroy()
    return {name: statistics.median(values) for name, values in seconds.items()}, dofs, peak


def main() -> None:
    """Measure every case and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=[161, 321, 641, 1281])
    parser.add_argument("--mesh", nargs="+", choices=list(MESHES), default=list(MESHES))
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    root = comm.rank == 0

    forms = {(MESHES[m][0], k): 0.0 for m in options.mesh for k in (1, 2)}
    for cell, degree in forms:
        forms[cell, degree] = warm_up(comm, cell, degree)
        if root:
            print(f"forms, {cell}s of order {degree}: {forms[cell, degree]:.2f} s")
    if root:
        heads = "".join(f"{name + ' s':>12}" for name in COLUMNS)
        print(f"\n{'mesh':<9}{'body':<7}order  nodes{'dofs':>9}{heads}{'peak MB':>9}")
    cases = itertools.product(options.nodes, options.mesh, (True, False), (1, 2))
    for nodes, mesh, half, degree in cases:
        cell, growth = MESHES[mesh]
        scene = Scene(
            mesh=MeshOptions((nodes - 1) // degree, cell, degree, growth),
            loads=(Load("p0", "top", (-1.0, 1.0), pressure=1.0),),
        )
        seconds, dofs, peak = measure(scene, half, options.repeat)
        if root:
            row = "".join(f"{seconds[name]:12.3f}" for name in COLUMNS)
            body = "half" if half else "whole"
            print(f"{mesh:<9}{body:<7}{degree:>5}{nodes:>7}{dofs:>9}{row}{peak:9.0f}", flush=True)
        if nodes <= TARGET_NODES and comm.size == 1:
            assert seconds["sum"] < TARGET_SECONDS, f"{seconds['sum']:.2f} s for {nodes} nodes"


if __name__ == "__main__":
    main()
